"""Logs of the measured machines of the repository: how they are read, events of a swing-up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pyarrow.csv
import pyarrow.parquet as pq
import pytest
from event_metrics import event_metrics
from identify_logs import LOGS

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import MeasuredTable
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.experiments.measured import MeasuredResult, results_of_logs
from grosmc_mj.experiments.requirements.metrics import Metric
from grosmc_mj.experiments.requirements.optimum import compare_with_optimum
from grosmc_mj.theory.plants import Signal, System, find_system

MEASURED = Path(__file__).parents[2] / "measured"
CART_POLE = MEASURED / "cart_pole/train_0.parquet"
RECORDED = LogTable.model_validate(
    {
        "columns": {
            "force": {"column": "Q", "scale": 6.21},
            "cart position": {"column": "position"},
            "pendulum angle": {"column": "angle"},
        }
    }
)


def cart_pole() -> System:
    """The signals of a cart with a pendulum, whose inputs and states have these names."""
    system = find_system("cart_pendulum")
    force = Signal("force", "F", "N")
    position = replace(system.states[0], name="cart position", unit="m")
    angle = replace(system.states[1], name="pendulum angle", unit="rad")
    return replace(system, inputs=(force,), states=(position, angle, *system.states[2:]))


def test_a_csv_file_of_a_recorder_with_a_comment_is_its_parquet_file(tmp_path: Path) -> None:
    """Instants of a text are subtracted before they are rounded, those of Parquet are floats."""
    path = tmp_path / "commented.csv"
    with path.open("wb") as file:
        file.write(b"# Saving: 0.02 s\n")
        pyarrow.csv.write_csv(pq.read_table(CART_POLE), file)
    as_csv = read_log(path, cart_pole(), RECORDED)
    as_parquet = read_log(CART_POLE, cart_pole(), RECORDED)
    assert as_csv.time == pytest.approx(as_parquet.time, abs=1e-12)
    assert np.array_equal(as_csv.inputs, as_parquet.inputs)
    assert np.array_equal(as_csv.states["pendulum angle"], as_parquet.states["pendulum angle"])


def test_a_cart_pole_that_turns_over_is_told_how_to_be_read() -> None:
    (note,) = read_log(CART_POLE, cart_pole(), RECORDED).notes
    assert note.startswith("pendulum angle jumps by a turn, 6 times")


@pytest.mark.slow
def test_compare_tells_the_rung_that_explains_a_log_and_a_load_that_moves_nothing(
    printed: Any, tmp_path: Path
) -> None:
    """The shaft turns about -y, the load about z."""
    lines = (LOGS / "servo.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "servo.csv").write_text("".join(lines[:800]), encoding="utf-8")
    load = {"body": "rotor", "torque": ["0 N m", "0 N m", "1 N m"], "label": "load"}
    only = {"compare": ["physics"]}
    cases.write(tmp_path, "logs/servo", name="loaded", disturbance=load, plant=only)
    printed("compare", "servo.csv", "loaded.toml", "--horizon", 0.5)


# -- the swing-up of a pendulum --------------------------------------------------------------------


@pytest.fixture(scope="module")
def swing_up() -> MeasuredResult:
    """The pendulum of DFKI, swung up by energy shaping and held by LQR, as a run of its case."""
    case = Experiment.load(MEASURED / "pendulum/swing_up.toml").changed(laws=["energy_lqr"])
    (result,) = results_of_logs(case, [MeasuredTable(log="energy_shaping_cmd.parquet")])
    return result


def events_of(result: MeasuredResult, turns: int = 0, *, periodic: bool) -> Mapping[str, Metric]:
    """Metrics of the event that the pivot is upright within 0.2 rad, some turns further."""
    law = result.controller
    run = result.trajectory
    turned = replace(run, state=run.state + np.array([2 * np.pi * turns, 0.0]))
    comparison = compare_with_optimum(turned, law)
    return event_metrics(turned, law, comparison, "pivot", 0.2, periodic=periodic)


def test_the_swing_up_of_the_pendulum_has_its_measured_events(swing_up: MeasuredResult) -> None:
    """Upright after 4.44 s, by 4 swings, the last one to 1.95 rad."""
    events = events_of(swing_up, periodic=True)
    assert events["reached"].value == pytest.approx(4.44, abs=0.005)
    assert events["swings"].value == 4
    assert events["last_peak"].value == pytest.approx(1.95, abs=0.005)


def test_the_final_error_of_the_pendulum_is_its_largest_one_in_the_last_tenth(
    swing_up: MeasuredResult,
) -> None:
    run = swing_up.trajectory
    late = np.abs(run.state[run.time >= 0.9 * run.time[-1], 0] + np.pi)
    final_error = events_of(swing_up, periodic=True)["final_error"].value
    assert final_error == pytest.approx(late.max(), abs=1e-4)


@pytest.mark.parametrize(("periodic", "note"), [(True, ""), (False, "not reached")])
def test_minus_pi_is_pi_only_for_a_periodic_angle(
    swing_up: MeasuredResult, periodic: bool, note: str
) -> None:
    assert events_of(swing_up, turns=1, periodic=periodic)["reached"].note == note
