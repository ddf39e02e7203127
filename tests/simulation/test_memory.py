"""The memory that recorded runs take, beside that of the machine."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases import write
from commands import Patch, Screen, run

import grosmc_mj as gm
from grosmc_mj import cli
from grosmc_mj.cli.commands import run as run_command
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation import problem
from grosmc_mj.simulation.problem import machine_memory

SERVO = Experiment.load("servo/nominal")


def simulated(runs: int, *, record: bool) -> gm.Trajectory:
    """Runs of a second, 1000 timesteps each."""
    return gm.simulate(
        SERVO.plant("physics"),
        SERVO.law("physics", "lqr"),
        [[1.0, 0.0]] * runs,
        duration=1.0,
        control_period=1e-3,
        record=record,
    )


def test_a_machine_has_more_memory_than_a_record_of_a_second() -> None:
    total = machine_memory()
    assert total is None or total > 1e8


def test_runs_that_do_not_fit_into_memory_are_refused(monkeypatch: Patch) -> None:
    # More than the signals of one run, less than those of 20.
    monkeypatch.setattr(problem, "machine_memory", lambda: 1_000_000)
    assert len(simulated(1, record=True).time) == 1001
    assert len(simulated(20, record=False)) == 20
    words = r"20 runs of 1,000 timesteps take at least .* this machine has 0.001 GB"
    with pytest.raises(ArgumentError, match=words):
        simulated(20, record=True)


def test_a_machine_that_does_not_tell_refuses_nothing(monkeypatch: Patch) -> None:
    monkeypatch.setattr(problem, "machine_memory", lambda: None)
    assert len(simulated(20, record=True)) == 20


def test_the_records_of_all_runs_of_a_case_are_counted() -> None:
    """Two laws on two plants, on which a record is as wide."""
    case = Experiment.load("servo/case1")
    one = case.changed(laws=["lqr"])
    assert case.record_size > one.record_size > 0
    longer = one.changed(duration=2 * one.duration)
    assert longer.record_size == pytest.approx(2 * one.record_size, rel=1e-3)


@pytest.mark.parametrize(("total", "code"), [(1000, cli.WRONG), (5000, cli.DONE)])
def test_the_command_says_what_runs_take_before_they_begin(
    total: int, code: int, tmp_path: Path, capsys: Screen, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(run_command, "_LONG", 0)
    monkeypatch.setattr(problem, "machine_memory", lambda: total)
    case = write(tmp_path, "servo")
    assert run("run", case, "--no-figures", "--out", tmp_path) == code
    assert "of 20 timesteps take at least" in capsys.readouterr().err
    assert (tmp_path / "mine.json").exists() == (code == cli.DONE)
