"""Trajectories as files: those that are written are read."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import sympy as sp
from campaign_cases import run
from numpy.typing import NDArray

import grosmc_mj as gm
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import RunResult


@cache
def result(case: str = "servo/case1", duration: float = 0.01) -> RunResult:
    return Experiment.load(case).varied(duration=duration).run(law="grosmc")


@pytest.mark.parametrize("case", ["servo/case1", "two_link_arm/case2", "maglev/warm"])
def test_a_run_is_read_as_it_was_written(case: str, tmp_path: Path) -> None:
    ours = result(case).trajectory
    theirs = gm.load_trajectory(result(case).save(tmp_path / "run.parquet"))
    for name in (
        "time", "state", "command", "input", "sliding", "weighed", "wrench", "physics", "status",
        "valid_until",
    ):  # fmt: skip
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    # Neither an address nor when the law began.
    kept = tuple(set(ours.memory.dtype.names or ()) - {"workspace", "first"})
    assert set(theirs.memory.dtype.names or ()) == set(kept)
    for name in kept:
        np.testing.assert_array_equal(ours.memory[name], theirs.memory[name])
    for name in ("states", "inputs", "controlled", "bodies"):
        assert getattr(ours.system, name) == getattr(theirs.system, name)
    assert (theirs.system is ours.system) == case.startswith(("servo", "two_link"))


def test_columns_say_their_units_and_states_of_a_machine_are_among_them(tmp_path: Path) -> None:
    run = result("cart_pendulum/machine", 0.05)
    file = run.save(tmp_path / "run.parquet")
    table = gm.load_trajectory(file).to_arrow()
    unit = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    expected = {"pole angle": "rad", "force": "N", "force asked": "N",
                "slider twist": "m", "force winding": "A", "slider friction bristle": "m",
                "hinge friction bristle": "rad"}  # fmt: skip
    assert unit | expected == unit
    # A held input has no value at the last instant.
    assert np.isnan(table["force"].to_numpy()[-1])
    state, physics = run.trajectory.state, run.trajectory.physics
    assert physics is not None
    # The motor's coordinate comes after slider and hinge.
    twist, current = (table[name].to_numpy() for name in ("slider twist", "force winding"))
    np.testing.assert_array_equal(twist, physics[:, 3] - state[:, 0])
    assert np.abs(current).max() > 1.0
    schema = pq.read_schema(file)
    assert schema.field("s").metadata[b"unit"] == b"rad/s"
    about = json.loads(schema.metadata[b"grosmc_mj"])
    assert about["versions"]["grosmc_mj"] == gm.__version__


def test_two_signals_of_one_name_are_distinguished() -> None:
    """A plant whose state is called v, as the signal that the index weighs is."""
    plant = gm.affine_plant("cart", states={"p": "m", "v": "m/s"}, inputs={"force": "N"},
                            f=[sp.Symbol("v"), 0], g=[0, 1], h=[sp.Symbol("p")],
                            parameters={})  # fmt: skip
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    law = gm.linearized_lqr(gm.Task(plant, error, gm.control.Setpoint(), np.eye(2), 1.0))
    names = gm.simulate(plant, law, [1.0, 0.0], duration=0.01).to_arrow().schema.names
    assert names[:6] == ["time", "p", "v", "force", "force asked", "weighed v"]


def with_column(folder: Path, name: str, values: NDArray[Any]) -> Path:
    """A run's file with other values in one of its columns."""
    table = result().trajectory.to_arrow()
    column = table.schema.get_field_index(name)
    pq.write_table(table.set_column(column, name, pa.array(values)), folder / "bad.parquet")
    return folder / "bad.parquet"


def without_column(folder: Path, name: str) -> Path:
    """A run's file that lacks one of its columns."""
    pq.write_table(result().trajectory.to_arrow().drop_columns(name), folder / "bad.parquet")
    return folder / "bad.parquet"


def without_description(folder: Path) -> Path:
    """A table that describes no run."""
    table = result().trajectory.to_arrow().replace_schema_metadata(None)
    pq.write_table(table, folder / "bad.parquet")
    return folder / "bad.parquet"


def written(path: Path) -> Path:
    path.write_bytes(b"PAR1 no")
    return path


def batch() -> Any:
    servo = gm.MujocoPlant.load("servo")
    return gm.simulate([servo], result().controller, [0.0, 0.0], duration=0.01)


NO_RUN = "holds no trajectory, or is damaged"
NOT_READ = "a run is read from .parquet alone: run it again and save it as .parquet"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda folder: written(folder / "no.parquet"), NO_RUN),
        (lambda folder: folder / "none.parquet", "there is no file"),
        (lambda folder: result().save(folder / "run.csv"), f"run.csv: {NOT_READ}"),
        # A file of an earlier version.
        (lambda folder: written(folder / "run.npz"), f"run.npz: {NOT_READ}"),
        (lambda folder: result().save(folder / "run.npz"), r"'\.npz'.* valid: \.parquet, \.csv"),
        (lambda folder: batch().to_arrow(), r"take one of them, trajectory\[i\]"),
        # Instants must increase, columns must be real numbers.
        (lambda folder: with_column(folder, "time", np.r_[np.arange(10.0), 9.0]), NO_RUN),
        (lambda folder: with_column(folder, "rotor angle", np.arange(11)), NO_RUN),
        (lambda folder: without_column(folder, "rotor angle"), NO_RUN),
        (without_description, NO_RUN),
    ],
)
def test_files_that_are_of_no_run_are_refused(
    call: Callable[[Path], Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=words):
        gm.load_trajectory(call(tmp_path))


def test_run_saves_its_runs_and_a_csv_is_for_others(tmp_path: Path) -> None:
    case = "own_laws/transfer_function"
    assert run("run", "--save", "csv", case, "--no-figures", "--out", tmp_path) == 0
    names = sorted(path.name for path in (tmp_path / "trajectories").iterdir())
    assert names == [f"own_laws_transfer_function.physics.{law}.csv" for law in ("lead", "lqr")]
    rows = list(csv.reader(result().save(tmp_path / "run.csv").read_text("utf-8").splitlines()))
    assert rows[0][:4] == ["time [s]", "rotor angle [rad]", "rotor speed [rad/s]", "current [A]"]
    assert float(rows[5][1]) == result().trajectory.state[4, 0]
    assert rows[-1][3] == ""
