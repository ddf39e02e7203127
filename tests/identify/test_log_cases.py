"""Logs of the measured machines of the repository, and of cases that once went wrong."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from commands import Screen, run
from event_metrics import event_metrics

import grosmc_mj
from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import MeasuredTable
from grosmc_mj.experiments.measured import MeasuredResult, results_of_logs
from grosmc_mj.experiments.requirements.optimum import compare_with_optimum

MEASURED = Path(__file__).parents[2] / "measured"
CASES = Path(__file__).with_name("log_cases")
SERVO = Path(grosmc_mj.__file__).parent / "experiments/cases/logs/servo.csv"
SAC = MEASURED / "pendulum/sac_cmd.parquet"
STEPS = MEASURED / "dc_servo/pid_step.parquet"
CART_POLE = MEASURED / "cart_pole/train_0.parquet"


def answer_of(command: str, log: Path, case: str, folder: Path) -> Any:
    """The result of a command on a log and a case, beside which another one may be written."""
    assert run(command, log, copied(folder) / f"{case}.toml", "--out", folder) == cli.DONE
    (path,) = folder.glob("*.json")
    return json.loads(path.read_text(encoding="utf-8"))


def copied(folder: Path) -> Path:
    """A folder with the cases, whose models are beside them and in measured/."""
    cases = folder / "tests/identify/log_cases"
    shutil.copytree(CASES, cases)
    (folder / "measured").symlink_to(MEASURED)
    return cases


def errors_by_rung(log: Path, case: str, folder: Path) -> dict[str, np.ndarray]:
    """Prediction errors of the first measured state by rung."""
    document = answer_of("compare", log, case, folder)
    first = document["errors"][0]["state"]
    rows = [row for row in document["errors"] if row["state"] == first]
    return {row["rung"]: np.array(row["rms"]) for row in rows}


def log_of_its_own(case: str, step: int, folder: Path) -> Path:
    """The log of a case's own run: torque and angle, one of so many rows."""
    experiment = Experiment.load(CASES / f"{case}.toml")
    saved = experiment.run(plant="physics", law="lqr").trajectory.save(folder / "run.csv")
    columns = ["time [s]", "torque [N m]", "pivot [rad]"]
    table = pyarrow.csv.read_csv(saved).select(columns)
    log = folder / "own.parquet"
    # No input begins with the last state.
    pq.write_table(table.take(list(range(0, len(table) - 1, step))), log)
    return log


def test_a_bias_of_the_pendulum_s_encoder_counts_once(tmp_path: Path) -> None:
    """As [[sensor]] bias and as the offset of a column."""
    offset = errors_by_rung(SAC, "with_offset", tmp_path / "offset")
    sensor = errors_by_rung(SAC, "with_sensor", tmp_path / "sensor")
    assert sensor["loop"] == pytest.approx(offset["physics"], rel=1e-6)
    assert offset["physics"][-1] < 0.11


# A command that is held for 20 ms, logged each time or twenty times.
@pytest.mark.parametrize(("case", "step"), [("exact20", 20), ("exact", 1), ("exact20", 1)])
def test_an_exact_log_of_the_pendulum_is_predicted_exactly(
    case: str, step: int, tmp_path: Path
) -> None:
    log = log_of_its_own(case, step, tmp_path)
    errors = errors_by_rung(log, case, tmp_path)
    assert errors["physics"].max() < 1e-12


@pytest.mark.parametrize("step", [20, 1])
def test_a_pendulum_that_is_too_heavy_leaves_no_white_residual(step: int, tmp_path: Path) -> None:
    arguments = (
        copied(tmp_path) / "heavier.toml",
        "--fit",
        "edit.pivot.armature",
        "--out",
        tmp_path,
    )
    assert run("identify", log_of_its_own("exact20", step, tmp_path), *arguments) == cli.DONE
    (path,) = tmp_path.glob("identification*.json")
    (row,) = json.loads(path.read_text())["held_out"]
    assert row["white"] is False


def test_a_bad_guess_of_damping_is_no_slip(tmp_path: Path, capsys: Screen) -> None:
    answer_of("identify", STEPS, "guessed", tmp_path)
    assert "seems to" not in capsys.readouterr().out


def test_bristles_that_are_unstable_in_a_fit_are_refused(tmp_path: Path, capsys: Screen) -> None:
    bristles = copied(tmp_path) / "bristles.toml"
    assert run("identify", STEPS, bristles, "--out", tmp_path) == cli.WRONG
    assert "makes the bristles unstable: take a timestep of at most" in capsys.readouterr().err


def test_a_shaft_that_spins_on_unstable_bristles_is_refused(capsys: Screen) -> None:
    assert run("run", CASES / "spinning.toml", "--no-figures") == cli.WRONG
    assert "at most 0.00024 s, a stiffness of at most 2.4" in capsys.readouterr().err


def test_a_csv_file_with_a_comment_is_read(tmp_path: Path) -> None:
    """As the recorder of the cart-pole writes it.

    Instants of a text are subtracted before they are rounded, those of Parquet are floats: 1e-15 s,
    which is 1e-9 of an error after a fit of the start.
    """
    log = tmp_path / "commented.csv"
    with log.open("wb") as file:
        file.write(b"# Saving: 0.02 s\n")
        pyarrow.csv.write_csv(pq.read_table(CART_POLE), file)
    as_csv = errors_by_rung(log, "cart_pole", tmp_path / "csv")
    as_parquet = errors_by_rung(CART_POLE, "cart_pole", tmp_path / "parquet")
    assert as_csv["physics"] == pytest.approx(as_parquet["physics"], rel=1e-6)


def test_a_cart_pole_that_turns_over_is_told_how_to_be_read(tmp_path: Path, capsys: Screen) -> None:
    answer_of("compare", CART_POLE, "cart_pole", tmp_path)
    assert "hinge jumps by a turn, 6 times" in capsys.readouterr().out


def test_a_load_across_the_shaft_is_noted_in_a_file_of_its_own(
    tmp_path: Path, capsys: Screen
) -> None:
    """The shaft turns about -y, the load about z."""
    for case in ("servo", "loaded_servo"):
        assert run("compare", SERVO, CASES / f"{case}.toml", "--out", tmp_path) == cli.DONE
    assert "no disturbance of the case moves anything along this log" in capsys.readouterr().out
    names = sorted(path.name for path in tmp_path.glob("*.json"))
    assert names == ["compare_loaded_servo_servo.json", "compare_servo_servo.json"]


@pytest.fixture(scope="module")
def swing_up() -> MeasuredResult:
    """The pendulum of DFKI, swung up by energy shaping and held by LQR, as a run of its case."""
    case = Experiment.load(MEASURED / "pendulum/swing_up.toml").changed(laws=["energy_lqr"])
    table = MeasuredTable(log="energy_shaping_cmd.parquet")
    (result,) = results_of_logs(case, [table])
    return result


def test_the_swing_up_of_the_pendulum_has_its_measured_events(swing_up: MeasuredResult) -> None:
    """Upright after 4.44 s within 0.2 rad, by 4 swings, the last one to 1.95 rad."""
    run = swing_up.trajectory
    law = swing_up.controller
    events = event_metrics(run, law, swing_up.comparison, "pivot", 0.2, periodic=True)
    assert events["reached"].value == pytest.approx(4.44, abs=0.005)
    assert events["swings"].value == 4
    assert events["last_peak"].value == pytest.approx(1.95, abs=0.005)


def test_the_final_error_of_the_pendulum_is_its_largest_one_in_the_last_tenth(
    swing_up: MeasuredResult,
) -> None:
    run = swing_up.trajectory
    law = swing_up.controller
    events = event_metrics(run, law, swing_up.comparison, "pivot", 0.2, periodic=True)
    late = np.abs(run.state[run.time >= 0.9 * run.time[-1], 0] + np.pi)
    assert events["final_error"].value == pytest.approx(late.max(), abs=1e-4)


@pytest.mark.parametrize(("periodic", "note"), [(True, ""), (False, "not reached")])
def test_minus_pi_is_pi_only_for_a_periodic_angle(
    swing_up: MeasuredResult, periodic: bool, note: str
) -> None:
    run = swing_up.trajectory
    other_turn = replace(run, state=run.state + np.array([2 * np.pi, 0.0]))
    comparison = compare_with_optimum(other_turn, swing_up.controller)
    law = swing_up.controller
    events = event_metrics(other_turn, law, comparison, "pivot", 0.2, periodic=periodic)
    assert events["reached"].note == note
