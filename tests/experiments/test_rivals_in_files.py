"""The rivals in case files: by their names, with what is wrong told in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment

SOUND = """
[plant]
system = "{system}"
compare = ["physics"]
[run]
duration = "0.1 s"
engine = "python"
[[controller]]
law = "{law}"
{numbers}
"""


def loaded(folder: Path, system: str, law: str, numbers: str = "") -> Experiment:
    path = folder / "mine.toml"
    path.write_text(SOUND.format(system=system, law=law, numbers=numbers), encoding="utf-8")
    return Experiment.load(path)


@pytest.mark.parametrize(
    ("system", "laws"),
    [
        ("servo", ("lqi", "pid", "adrc", "adaptive")),
        ("cart_pendulum", ("lqi", "pid", "adrc")),
        ("arm", ("lqi", "pid", "adrc", "adaptive")),
    ],
)
def test_they_have_their_numbers_in_the_system_s_base(tmp_path: Path, system: str, laws: tuple):
    for law in laws:
        run = loaded(tmp_path, system, law).run()
        assert not run.ended
        assert run.controller.name == law


def test_a_number_of_the_file_counts_and_may_have_its_unit(tmp_path: Path):
    made = [
        loaded(tmp_path, "arm", "adrc", text).law("physics", "adrc").designed.gains["bandwidth"]
        for text in ("", "bandwidth = 50", 'bandwidth = "10 Hz"')
    ]
    assert made == [200.0, 50.0, pytest.approx(62.83185307179586)]


@pytest.mark.parametrize(
    ("system", "law", "numbers", "said"),
    [
        ("arm", "lqi", "integral_weight = 0", "integral_weight = 0 must be finite and positive"),
        ("arm", "lqi", "integral_wait = 1", "unknown key 'integral_wait': did you mean"),
        ("arm", "lqi", 'integral_weight = "big"', "integral_weight = 'big' must be a number"),
        ("arm", "lqi", "integral_weight = [1, 2]", "integral_weight = [1, 2] must be a number"),
        ("arm", "lqi", "limit = -1", "limit = -1 must be positive"),
        ("arm", "pid", "frequency = -2", "frequency = -2 must be above 0"),
        ("arm", "pid", 'frequency = "2 m"', 'frequency: "2 m" cannot be converted to rad/s'),
        ("arm", "adrc", "bandwidth = nan", "bandwidth = nan must be finite"),
        ("arm", "adrc", 'switching = "implicit"', "it does not switch, so it has no switching"),
        ("arm", "adaptive", "adaptation = 0", "adaptation = 0 must be finite and positive"),
        ("cart_pendulum", "adaptive", "frequency = 1\nadaptation = 1", "has no torques Y theta"),
        ("servo", "pd", "", "pd needs frequency"),
        ("two_link_arm", "adaptive", "frequency = 1\nadaptation = 1", "must be its joints, q1, q2"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(tmp_path: Path, system, law, numbers, said):
    with pytest.raises(ArgumentError) as refused:
        loaded(tmp_path, system, law, numbers)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)
