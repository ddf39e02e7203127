"""Mistakes in case files, each with the line that mends it."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import Screen, assert_one_line, run

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError

CASE = """
[plant]
system = "servo"
[run]
duration = "0.1 s"
{run}
[[controller]]
law = "lqr"
{more}
"""
LATIN = b"caf\xe9.toml"


def refusal(folder: Path, text: str) -> str:
    """The line that refuses a case file."""
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ArgumentError) as refused:
        Experiment.load(path)
    line = str(refused.value)
    assert "\n" not in line
    return line


@pytest.mark.parametrize("key", ["timestep", "control_period"])
def test_a_time_of_zero_is_no_default(key: str, tmp_path: Path) -> None:
    text = CASE.format(run=f'{key} = "0 s"', more="")
    assert f"run: {key}: 0 s must be above 0 s" in refusal(tmp_path, text)


def test_a_duration_of_zero_is_refused(tmp_path: Path) -> None:
    text = CASE.format(run="", more="").replace("0.1 s", "0 s")
    assert "run: duration: 0 s must be above 0 s" in refusal(tmp_path, text)


def test_a_sampling_of_zero_is_refused(tmp_path: Path) -> None:
    text = CASE.format(run="", more='[log]\nsampling = "0 s"')
    assert "log: sampling: 0 s must be above 0 s" in refusal(tmp_path, text)


def test_laws_that_would_share_a_file_are_refused(tmp_path: Path) -> None:
    more = 'name = "a/b"\n[[controller]]\nlaw = "lqr"\nname = "a_b"'
    words = "controllers 'a/b' and 'a_b' would share the file of a_b: give one another name"
    assert words in refusal(tmp_path, CASE.format(run="", more=more))


def test_a_start_that_is_no_number_is_told_so(tmp_path: Path) -> None:
    text = CASE.format(run='start = { "rotor angle" = nan }', more="")
    assert "run: start: rotor angle: nan must be finite" in refusal(tmp_path, text)


def test_a_missing_table_is_shown_with_its_own_keys(tmp_path: Path) -> None:
    text = '[plant]\nsystem = "servo"\n[run]\nduration = "1 s"\n'
    assert "there is no [[controller]]: it has the keys law, switching" in refusal(tmp_path, text)


@pytest.mark.parametrize(
    ("value", "words"),
    [("2 s", 'write "2 s"'), ("-1.5e-3 rad/s", 'write "-1.5e-3 rad/s"'), ("5 %", 'write "5 %"')],
)
def test_a_quantity_without_quotes_is_shown_with_them(
    value: str, words: str, tmp_path: Path
) -> None:
    text = CASE.format(run=f"timestep = {value}", more="")
    assert f"a number with a unit is a text: {words}" in refusal(tmp_path, text)


def test_a_share_in_per_cent_is_shown_as_a_number(tmp_path: Path) -> None:
    text = CASE.format(run="", more='[computing]\nmissed = "5 %"')
    assert "'5 %' must be a number without a unit: write 0.05" in refusal(tmp_path, text)


def test_a_law_of_another_plant_is_told_whose_it_is(tmp_path: Path) -> None:
    text = CASE.format(run="", more="").replace('law = "lqr"', 'law = "cart-ism"')
    assert "law 'cart-ism' is there for cart_pendulum alone: take" in refusal(tmp_path, text)


def test_a_wrong_timestep_is_told_before_a_requirement_that_cannot_be_judged(
    tmp_path: Path,
) -> None:
    more = '[[requirement]]\nsettles_within = "0.095 s"'
    text = CASE.format(run='control_period = "1 ms"\ntimestep = "0.3 ms"', more=more)
    assert "period 0.001 s is no multiple of the timestep" in refusal(tmp_path, text)


def test_a_load_beyond_all_numbers_has_no_filter(tmp_path: Path) -> None:
    more = (
        '[[sensor]]\nof = "rotor angle"\nnoise = "1 mrad"\n'
        '[[estimator]]\nof = ["rotor angle", "rotor speed"]\nlaw = "kalman"\nload = "1e99 A"'
    )
    assert "kalman: no steady filter" in refusal(tmp_path, CASE.format(run="", more=more))


def test_a_function_that_makes_no_controller_is_named(tmp_path: Path) -> None:
    text = CASE.format(run="", more="").replace('law = "lqr"', 'law = "numpy:zeros"')
    assert "numpy:zeros makes no controller: TypeError" in refusal(tmp_path, text)


def test_a_model_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.xml").write_bytes(b'<mujoco model="\xff"/>')
    text = CASE.format(run="", more="").replace('system = "servo"', 'model = "bad.xml"')
    assert "is no text in UTF-8" in refusal(tmp_path, text)


def test_a_law_without_surface_is_not_asked_for_its_surface(tmp_path: Path) -> None:
    more = (
        '[[controller]]\nlaw = "grosmc"\n'
        '[[requirement]]\nof = ["lqr", "grosmc"]\nno_reaching_phase = true'
    )
    path = tmp_path / "mine.toml"
    path.write_text(CASE.format(run="", more=more), encoding="utf-8")
    (limit,) = Experiment.load(path).limits
    assert limit.laws == ("grosmc",)


def test_a_file_whose_name_is_no_text_is_refused(tmp_path: Path, capsys: Screen) -> None:
    path = tmp_path / LATIN.decode("utf-8", "surrogateescape")
    path.write_text(CASE.format(run="", more=""), encoding="utf-8")
    assert run("run", path) == 2
    assert_one_line(capsys.readouterr().err)


def test_a_file_in_place_of_the_folder_is_named(tmp_path: Path, capsys: Screen) -> None:
    (tmp_path / "file").write_text("")
    assert run("run", "servo/nominal", "--out", tmp_path / "file") == 2
    error = capsys.readouterr().err
    assert_one_line(error)
    assert "is a file, and a folder is needed" in error
