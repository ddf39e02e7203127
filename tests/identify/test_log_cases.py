"""Logs of real machines, of a folder beside the checkout or in GROSMC_DATA."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import Screen, run
from event_metrics import event_metrics
from real_logs import DATA, MISSING

from grosmc_mj import cli
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import MeasuredTable
from grosmc_mj.experiments.measured import MeasuredResult, results_of_logs
from grosmc_mj.requirements.optimum import compare_with_optimum

CASES = DATA / "log_cases"

pytestmark = pytest.mark.skipif(not CASES.is_dir(), reason=MISSING)


def answer_of(command: str, log: str, case: str, folder: Path) -> Any:
    """The result of a command on a log and a case of one folder of the data."""
    assert run(command, CASES / log, CASES / case, "--out", folder) == cli.DONE
    (path,) = folder.glob("*.json")
    return json.loads(path.read_text(encoding="utf-8"))


def errors_by_rung(log: str, case: str, folder: Path) -> dict[str, np.ndarray]:
    """Prediction errors of the first measured state by rung."""
    document = answer_of("compare", log, case, folder)
    first = document["errors"][0]["state"]
    rows = [row for row in document["errors"] if row["state"] == first]
    return {row["rung"]: np.array(row["rms"]) for row in rows}


def test_a_bias_of_the_pendulum_s_encoder_counts_once(tmp_path: Path) -> None:
    """As [[sensor]] bias and as the offset of a column."""
    log = "compare_bias/sac_cmd.csv"
    offset = errors_by_rung(log, "compare_bias/with_offset.toml", tmp_path / "offset")
    sensor = errors_by_rung(log, "compare_bias/with_sensor.toml", tmp_path / "sensor")
    assert sensor["loop"] == pytest.approx(offset["physics"], rel=1e-6)
    assert offset["physics"][-1] < 0.11


@pytest.mark.parametrize(
    ("log", "case"),
    [("20ms.csv", "exact20"), ("1ms.csv", "exact"), ("held20_1ms.csv", "exact20")],
)
def test_an_exact_log_of_the_pendulum_is_predicted_exactly(
    log: str, case: str, tmp_path: Path
) -> None:
    errors = errors_by_rung(f"start_window/{log}", f"start_window/{case}.toml", tmp_path)
    assert errors["physics"].max() < 1e-12


@pytest.mark.parametrize("log", ["20ms.csv", "held20_1ms.csv"])
def test_a_pendulum_that_is_too_heavy_leaves_no_white_residual(log: str, tmp_path: Path) -> None:
    CASE = CASES / "always_white"
    arguments = (CASE / log, CASE / "heavier.toml", "--fit", "edit.pivot.armature")
    assert run("identify", *arguments, "--out", tmp_path) == cli.DONE
    (path,) = tmp_path.glob("identification*.json")
    (row,) = json.loads(path.read_text())["held_out"]
    assert row["white"] is False


def test_a_bad_guess_of_damping_is_no_slip(tmp_path: Path, capsys: Screen) -> None:
    answer_of("identify", "refused/step.csv", "refused/dc.toml", tmp_path)
    assert "seems to" not in capsys.readouterr().out


def test_bristles_that_are_unstable_in_a_fit_are_refused(tmp_path: Path, capsys: Screen) -> None:
    folder = CASES / "lugre_diverges"
    assert run("identify", folder / "step.csv", folder / "dcl.toml", "--out", tmp_path) == cli.WRONG
    assert "makes the bristles unstable: take a timestep of at most" in capsys.readouterr().err


def test_a_shaft_that_spins_on_unstable_bristles_is_refused(capsys: Screen) -> None:
    assert run("run", CASES / "lugre_diverges/spin.toml", "--no-figures") == cli.WRONG
    assert "at most 0.00024 s, a stiffness of at most 2.4" in capsys.readouterr().err


def test_a_csv_file_with_a_comment_is_read(tmp_path: Path) -> None:
    assert errors_by_rung("csv_comment/tr0.csv", "csv_comment/cp.toml", tmp_path)


def test_a_cart_pole_that_turns_over_is_told_how_to_be_read(tmp_path: Path, capsys: Screen) -> None:
    answer_of("compare", "wrap/wrapped.csv", "wrap/cp.toml", tmp_path)
    assert "hinge jumps by a turn, 6 times" in capsys.readouterr().out


def test_a_load_across_the_shaft_is_noted_in_a_file_of_its_own(
    tmp_path: Path, capsys: Screen
) -> None:
    """The shaft turns about -y, the load about z."""
    folder = CASES / "disturbance_ignored"
    for case in ("plain.toml", "load.toml"):
        assert run("compare", folder / "servo.csv", folder / case, "--out", tmp_path) == cli.DONE
    assert "no disturbance of the case moves anything along this log" in capsys.readouterr().out
    names = sorted(path.name for path in tmp_path.glob("*.json"))
    assert names == ["compare_load_servo.json", "compare_plain_servo.json"]


@pytest.fixture(scope="module")
def swing_up() -> MeasuredResult:
    """The pendulum of DFKI, swung up by energy shaping and held by LQR, as a run of its case."""
    case = Experiment.load(DATA / "pendulum/loop.toml")
    table = MeasuredTable(log="energy_shaping_cmd.csv")
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
    late = np.abs(run.state[run.time >= 6.3, 0] + np.pi)
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
