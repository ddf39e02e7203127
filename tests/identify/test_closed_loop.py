"""identify --case: an identified machine under the law and the limits of another case."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import Patch, Screen, assert_one_line, run

import grosmc_mj as gm
from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment

LOGS = Path(gm.__file__).parent / "experiments/cases/logs"
ARM = """
[plant]
system = "arm"
[run]
duration = "1 s"
start = { "joint angle" = "0.1 rad" }
[task]
reference = ["0"]
[[controller]]
law = "pd"
frequency = 1
damping = 1
[[disturbance]]
input = "torque"
amplitude = "0.3 N m"
[[requirement]]
input_below = "100 N m"
[[requirement]]
state = "joint rate"
stays_within = "0.1 rad/s"
"""


def case(path: Path, text: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def test_an_identified_machine_runs_as_the_other_case_with_the_fitted_numbers(
    tmp_path: Path, capsys: Screen
) -> None:
    loop = case(tmp_path / "loop.toml", ARM)
    log = LOGS / "arm.csv"
    assert run("identify", log, "logs/arm", "--case", loop, "--out", tmp_path) == cli.DONE
    written = tmp_path / "identify_logs_arm_arm.toml"
    machine = Experiment.load(written)
    fitted = {table.number: table.nominal for table in machine.file.uncertain}
    assert list(fitted) == ["edit.link.mass_scale", "edit.joint.damping"]
    other = Experiment.load(loop).changed(fitted)
    trajectories = [case.run("physics", "pd").trajectory for case in (machine, other)]
    assert np.array_equal(trajectories[0].state, trajectories[1].state)

    capsys.readouterr()
    assert run("run", written, "--no-figures", "--out", tmp_path) == cli.DIFFERS
    answer = capsys.readouterr().out
    assert "1 of 2 requirements is not kept" in answer
    assert "joint rate stays within 0.1 rad/s" in answer


SERVO = """
[plant]
system = "servo"
[run]
duration = "1 s"
[[controller]]
law = "{law}"
{more}
"""


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "loop.toml: there is no such file"),
        (ARM, "has the states joint angle [rad], joint rate [rad/s], must have those of"),
        (SERVO.split("[[controller]]")[0], "there is no [[controller]]"),
        (
            SERVO.format(law="lqr", more='[computing]\ndelay = "3 ms"'),
            "which does not have these tables as this case has them: [computing]; write",
        ),
        (
            SERVO.format(law="own:law", more=""),
            "own.py must be beside",
        ),
        (
            SERVO.format(law="lqr", more='[[requirement]]\ninput_below = "3 A"\nof = ["grosmc"]'),
            "unknown controller 'grosmc'",
        ),
    ],
    ids=["missing", "other states", "no law", "other computer", "Python elsewhere", "other law"],
)
def test_a_case_that_gives_no_closed_loop_is_refused_before_the_work(
    text: str | None, words: str, tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.setattr("grosmc_mj.identify.replay.simulate", lambda *_, **__: pytest.fail("ran"))
    shutil.copy(LOGS / "servo.csv", tmp_path)
    machine = case(tmp_path / "machine.toml", SERVO.format(law="lqr", more=""))
    loop = tmp_path / "other" / "loop.toml"
    if text is not None:
        case(loop, text)
        loop.with_name("own.py").write_text("def law(t, x, memory, p, u):\n    u[0] = 0.0\n")
    log = tmp_path / "servo.csv"
    fitted = ("--fit", "edit.shaft.damping")
    assert run("identify", log, machine, "--case", loop, *fitted) == cli.WRONG
    error = capsys.readouterr().err
    assert words in error
    assert_one_line(error)
