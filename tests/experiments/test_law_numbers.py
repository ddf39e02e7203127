"""Numbers of laws and of their switching laws, in a case file and by their paths."""

from pathlib import Path

import pytest

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.law_numbers import tunable_numbers
from grosmc_mj.experiments.number import Number
from grosmc_mj.ground.errors import ArgumentError

CASE = """
[plant]
system = "arm"
[run]
start = { "joint angle" = "20 deg" }
duration = "0.02 s"
[task]
Q = [10, 1]
R = 1
slope = 40
[laws.layer]
law = "grosmc"
k = "5 1/s"
epsilon = 3
switching = "boundary-layer"
width = 3
[laws.twist]
law = "grosmc"
k = 5
epsilon = 3
switching = "super-twisting"
[laws.own-twist]
law = "grosmc"
k = 5
epsilon = 3
switching = "super-twisting"
slope = 80
[laws.pid]
law = "pid"
frequency = "4 rad/s"
[[controller]]
law = "layer"
[[controller]]
law = "twist"
[[controller]]
law = "own-twist"
[[controller]]
law = "pid"
"""


def load(folder: Path, text: str = CASE) -> Experiment:
    file = folder / "case.toml"
    file.write_text(text)
    return Experiment.load(file)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return load(tmp_path_factory.mktemp("laws"))


def switching_of(case: Experiment, law: str) -> dict[str, float]:
    return vars(case.law("corrected", law).parameters.switching)


def test_a_switching_law_has_the_numbers_of_its_law(case: Experiment) -> None:
    assert switching_of(case, "layer")["width"] == 3.0
    assert switching_of(case, "twist")["slope"] == 40.0
    assert switching_of(case, "own-twist")["slope"] == 80.0
    assert case.law("corrected", "layer").parameters.k == 5.0


@pytest.mark.parametrize(
    ("path", "law", "key", "before"),
    [
        ("laws.layer.width", "layer", "width", 3.0),
        ("laws.layer.gain", "layer", "gain", 1.0),
        ("laws.twist.slope", "twist", "slope", 40.0),
        ("laws.own-twist.slope", "own-twist", "slope", 80.0),
        ("controller.twist.gain", "twist", "gain", 1.0),
    ],
)
def test_a_number_of_a_switching_law_is_set_by_its_path(
    path: str, law: str, key: str, before: float, case: Experiment
) -> None:
    number = Number.of(case, path)
    assert number.get(case) == before
    changed = number.set(case, 2.5)
    assert switching_of(changed, law)[key] == 2.5
    others = {"layer", "twist", "own-twist"} - {law}
    assert all(switching_of(changed, name) == switching_of(case, name) for name in others)


def test_an_asked_switching_law_reads_its_own_numbers_of_the_law(case: Experiment) -> None:
    asked = case.changed(switching="super-twisting")
    assert switching_of(asked, "layer")["slope"] == 40.0
    assert switching_of(asked, "own-twist")["slope"] == 80.0


@pytest.mark.parametrize(
    ("law", "line", "words"),
    [
        ("layer", "share = 0.1", "share is a number of adaptive: .* is 'boundary-layer'"),
        ("twist", "width = 1", "width is a number of boundary-layer: .* is 'super-twisting'"),
        ("layer", "widht = 1", "unknown key 'widht': did you mean 'width'"),
        ("twist", "gain = -1", "gain = -1 must be finite and not negative"),
        ("twist", 'gain = "big"', "gain = 'big' must be finite and not negative"),
        ("pid", "gain = 2", "unknown key 'gain'"),
        ("pid", "kp = 8", "pid needs kp .*, or frequency, .*, not kp and frequency"),
    ],
)
def test_a_number_that_a_law_does_not_have_is_refused(
    law: str, line: str, words: str, tmp_path: Path
) -> None:
    begin = f"[laws.{law}]\n"
    with pytest.raises(ArgumentError, match=words):
        load(tmp_path, CASE.replace(begin, f"{begin}{line}\n"))


def test_a_search_is_offered_the_numbers_of_a_law(case: Experiment) -> None:
    assert set(tunable_numbers(case, "layer")) == {"k", "epsilon", "gain", "width", "Q", "R"}
    of_pid = tunable_numbers(case, "pid")
    assert "frequency" in of_pid
    assert not {"kp", "ki", "kd", "limit", "Q"} & set(of_pid)


def test_numbers_that_a_search_is_offered_are_those_of_the_paths(case: Experiment) -> None:
    for law in ("layer", "twist", "pid"):
        for key, declared in tunable_numbers(case, law).items():
            if not declared.each:
                number = Number.of(case, f"laws.{law}.{key}")
                assert number.bounds.holds(number.get(case))
                assert number.bounds == declared
