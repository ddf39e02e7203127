"""A run in a file: its signals with their units, its references and errors beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.csv
from cases import case

from grosmc_mj import load_trajectory


def test_a_saved_run_has_reference_and_error_of_each_output(tmp_path: Path) -> None:
    """With e = y_r - y and y_r = 2 + t, whose rate is 1 rad/s."""
    task = {"reference": ["2 + t"], "sign": -1, "Q": [1, 1], "R": 1}
    run = case("arm", law="fl-lqr", task=task).run("physics", "fl-lqr")
    columns = pyarrow.csv.read_csv(run.save(tmp_path / "run.csv"))
    time = columns["time [s]"].to_numpy()
    angle = columns["joint angle [rad]"].to_numpy()
    assert np.allclose(columns["joint angle reference [rad]"].to_numpy(), 2 + time)
    assert np.allclose(columns["joint angle error [rad]"].to_numpy(), 2 + time - angle)
    assert np.allclose(columns["joint rate reference [rad/s]"].to_numpy(), 1)


def test_a_saved_run_is_read_again_without_them(tmp_path: Path) -> None:
    run = case("servo").run("physics", "lqr")
    again = load_trajectory(run.save(tmp_path / "run.parquet"))
    assert np.array_equal(again.state, run.trajectory.state)
    assert np.array_equal(again.input, run.trajectory.input)


def test_columns_of_forces_and_torques_have_their_units(tmp_path: Path) -> None:
    load = {"body": "rotor", "torque": ["0 N m", "0.1 N m", "0 N m"]}
    run = case("servo", disturbance=load).run("physics", "lqr")
    columns = pyarrow.csv.read_csv(run.save(tmp_path / "run.csv"))
    torque = columns["torque y on rotor [N m]"].to_numpy(zero_copy_only=False)
    assert np.allclose(torque[:-1], 0.1)
    assert "force x on rotor [N]" in columns.column_names
