"""identify --case: an identified machine under the law and the limits of another case."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from commands import Patch, Screen, assert_one_line, run
from identify_logs import LOGS, fit_of_arm, short_arm_log

from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment

ARM: dict[str, Any] = {
    "run": {"duration": "1 s", "start": {"joint angle": "0.1 rad"}},
    "task": {"reference": ["0"]},
    "controller": {"law": "pd", "frequency": 1, "damping": 1},
    "disturbance": {"input": "torque", "amplitude": "0.3 N m"},
    "requirement": [
        {"input_below": "100 N m"},
        {"state": "joint rate", "stays_within": "0.1 rad/s"},
    ],
}


def test_an_identified_machine_runs_as_the_other_case_with_the_fitted_numbers(
    tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setattr("grosmc_mj.identify.fit.fit", fit_of_arm)
    loop = cases.write(tmp_path, "arm", name="loop", **ARM)
    log = short_arm_log(tmp_path)
    assert (
        run("identify", log, "logs/arm", "--case", loop, "--horizon", 0.4, "--out", tmp_path)
        == cli.DONE
    )
    machine = Experiment.load(tmp_path / "identify_logs_arm_arm.toml")
    fitted = {table.number: table.nominal for table in machine.file.uncertain}
    assert list(fitted) == ["edit.link.mass_scale", "edit.joint.damping"]

    other = Experiment.load(loop).changed(fitted)
    runs = [experiment.run("physics", "pd") for experiment in (machine, other)]
    assert np.array_equal(runs[0].trajectory.state, runs[1].trajectory.state)
    kept = [judgement.kept for judgement in runs[0].requirements]
    assert kept == [judgement.kept for judgement in runs[1].requirements] == [True, False]


LOOPS: dict[str, tuple[str, dict[str, Any], str]] = {
    "other states": (
        "arm",
        ARM,
        "has the states joint angle [rad], joint rate [rad/s], must have those of",
    ),
    "other computer": (
        "servo",
        {"computing": {"delay": "3 ms"}},
        "which does not have these tables as this case has them: [computing]; write",
    ),
    "Python elsewhere": ("servo", {"law": "own:law"}, "own.py must be beside"),
    "other law": (
        "servo",
        {"requirement": {"input_below": "3 A", "of": ["grosmc"]}},
        "unknown controller 'grosmc'",
    ),
}


def refused(folder: Path, loop: Path, capsys: Screen) -> str:
    """The line by which a loop is refused for a servo."""
    machine = cases.write(folder, "servo", name="machine")
    fitted = ("--fit", "edit.shaft.damping")
    assert run("identify", LOGS / "servo.csv", machine, "--case", loop, *fitted) == cli.WRONG
    error = capsys.readouterr().err
    assert_one_line(error)
    return error


@pytest.mark.parametrize(("base", "tables", "words"), LOOPS.values(), ids=LOOPS)
def test_a_case_that_gives_no_closed_loop_is_refused_before_the_work(
    base: str,
    tables: dict[str, Any],
    words: str,
    tmp_path: Path,
    monkeypatch: Patch,
    capsys: Screen,
) -> None:
    monkeypatch.setattr("grosmc_mj.identify.replay.simulate", lambda *_, **__: pytest.fail("ran"))
    other = tmp_path / "other"
    other.mkdir()
    (other / "own.py").write_text("def law(t, x, memory, p, u):\n    u[0] = 0.0\n")
    loop = cases.write(other, base, name="loop", **tables)
    assert words in refused(tmp_path, loop, capsys)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "loop.toml: there is no such file"),
        ('plant = { system = "servo" }\nrun = { duration = "1 s" }', "there is no [[controller]]"),
    ],
)
def test_a_loop_without_a_file_or_a_law_is_one_line(
    text: str | None, words: str, tmp_path: Path, capsys: Screen
) -> None:
    loop = tmp_path / "loop.toml"
    if text is not None:
        loop.write_text(text, encoding="utf-8")
    assert words in refused(tmp_path, loop, capsys)
