"""Trajectories as files: what is written is what is read."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj import cli
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import RunResult

_ARRAYS = ("time", "state", "command", "input", "sliding", "weighed", "wrench", "physics")
# An address, and when the law began.
_NOT_SAVED = ("workspace", "first")


def result(case: str, **changes: float) -> RunResult:
    return Experiment.load(case).varied(**changes).run(law="grosmc")


@pytest.mark.parametrize("ending", [".parquet", ".npz"])
@pytest.mark.parametrize("case", ["servo/case1", "two_link_arm/case2", "maglev/warm"])
def test_a_run_is_read_as_it_was_written(case: str, ending: str, tmp_path: Path) -> None:
    run = result(case, duration=0.05)
    found = gm.load_trajectory(run.save(tmp_path / f"run{ending}"))
    for name in _ARRAYS:
        ours, theirs = getattr(run.trajectory, name), getattr(found, name)
        assert (ours is None) == (theirs is None), name
        if ours is not None:
            np.testing.assert_array_equal(ours, theirs)
    kept = [name for name in run.trajectory.memory.dtype.names or () if name not in _NOT_SAVED]
    assert found.memory.dtype.names == tuple(kept)
    for name in kept:
        np.testing.assert_array_equal(run.trajectory.memory[name], found.memory[name])
    assert (found.status, found.valid_until) == (run.status, run.trajectory.valid_until)
    ours, theirs = run.trajectory.system, found.system
    for name in ("states", "inputs", "controlled", "bodies"):
        assert getattr(ours, name) == getattr(theirs, name)
    assert (theirs is ours) == case.startswith(("servo", "two_link"))


def test_every_column_says_its_unit(tmp_path: Path) -> None:
    run = result("cart_pendulum/case2", duration=0.02)
    table = run.trajectory.to_arrow()
    unit = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert unit["pole angle"] == "rad"
    assert unit["force"] == unit["force asked"] == "N"
    assert unit["torque y on pole"] == "N m"
    assert table["pole angle"].to_numpy()[0] == pytest.approx(-np.radians(10))
    # What is held has no value at the last instant.
    assert np.isnan(table["force"].to_numpy()[-1])
    # A workspace's address is no signal.
    assert "memory workspace" not in unit
    written = pq.read_schema(run.save(tmp_path / "run.parquet"))
    assert written.field("s").metadata[b"unit"].decode() == "rad/s"
    assert json.loads(written.metadata[b"grosmc_mj"])["versions"]["grosmc_mj"] == gm.__version__


@pytest.mark.parametrize("ending", [".parquet", ".npz"])
def test_what_of_a_machine_no_law_sees_is_saved_by_name(ending: str, tmp_path: Path) -> None:
    run = result("cart_pendulum/machine", duration=0.05)
    table = gm.load_trajectory(run.save(tmp_path / f"run{ending}")).to_arrow()
    units = {"slider twist": "m", "force winding": "A", "slider friction bristle": "m"}
    units["hinge friction bristle"] = "rad"
    assert {n: table.field(n).metadata[b"unit"].decode() for n in units} == units
    state, physics = run.trajectory.state, run.trajectory.physics
    assert physics is not None
    # The motor's coordinate comes after slider and hinge.
    twist, current = (table[name].to_numpy() for name in ("slider twist", "force winding"))
    np.testing.assert_array_equal(twist, physics[:, 3] - state[:, 0])
    assert np.abs(current).max() > 1.0


def test_a_batch_of_unlike_machines_keeps_what_each_one_has() -> None:
    """The current of a motor of twice the torque constant is a half for the same force."""
    plain, law = gm.MujocoPlant.load("servo"), result("servo/nominal", duration=0.01).controller
    motors = [gm.machine.Motor("current", k, 1.0, bandwidth=100.0) for k in (0.1, 0.2)]
    batch = gm.simulate([plain.edited(each) for each in motors], law, [0.5, 0.0], duration=0.1)
    first, second = batch[0], batch[1]
    weak, strong = (run.to_arrow()["current winding"].to_numpy() for run in (first, second))
    # The current loop leaves a billionth of the back-EMF.
    np.testing.assert_allclose(weak[1:], 2 * strong[1:], rtol=1e-6)
    assert np.abs(weak).max() > 0.1


def test_a_csv_is_for_others(tmp_path: Path) -> None:
    run = result("servo/case1", duration=0.01)
    file = run.save(tmp_path / "run.csv")
    rows = list(csv.reader(file.read_text(encoding="utf-8").splitlines()))
    assert rows[0][:4] == ["time [s]", "rotor angle [rad]", "rotor speed [rad/s]", "current [A]"]
    assert not any(name.startswith("mjSTATE") for name in rows[0])
    assert float(rows[5][1]) == run.trajectory.state[4, 0]
    assert rows[-1][3] == ""


def test_two_signals_of_one_name_are_told_apart() -> None:
    """A plant whose state is called v, as what the index weighs is."""
    plant = gm.affine_plant("cart", states={"p": "m", "v": "m/s"}, inputs={"force": "N"},
                            f=[sp.Symbol("v"), 0], g=[0, 1], h=[sp.Symbol("p")],
                            parameters={})  # fmt: skip
    task = gm.Task(plant, gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2)),
                   gm.control.Setpoint(), np.eye(2), 1.0)  # fmt: skip
    run = gm.simulate(plant, gm.linearized_lqr(task), [1.0, 0.0], duration=0.01)
    assert run.to_arrow().schema.names[:6] == [
        "time", "p", "v", "force", "force asked", "weighed v"
    ]  # fmt: skip


def test_other_files_are_refused(tmp_path: Path) -> None:
    run = result("servo/case1", duration=0.01)
    batch = gm.simulate([gm.MujocoPlant.load("servo")], run.controller, [0.0, 0.0], duration=0.01)
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    # A pickle is not opened.
    np.savez(tmp_path / "pickle.npz", grosmc_mj=np.array({"a": 1}, dtype=object))
    run.save(tmp_path / "run.csv")
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04 neither")
    (tmp_path / "bad.parquet").write_bytes(b"PAR1 no")
    lacking = run.save(tmp_path / "lacking.parquet")
    pq.write_table(pq.read_table(lacking).drop(["rotor angle"]), lacking)
    for call, words in (
        (lambda: gm.load_trajectory(tmp_path / "other.npz"), "holds no trajectory"),
        (lambda: gm.load_trajectory(tmp_path / "pickle.npz"), "holds no trajectory"),
        (lambda: gm.load_trajectory(tmp_path / "bad.npz"), "bad.npz: holds no trajectory"),
        (lambda: gm.load_trajectory(tmp_path / "bad.parquet"), "bad.parquet: holds no traj"),
        (lambda: gm.load_trajectory(lacking), "holds no trajectory"),
        (lambda: gm.load_trajectory(tmp_path / "none.parquet"), "there is no file"),
        (lambda: gm.load_trajectory(tmp_path / "run.csv"), "read again from .parquet and .npz"),
        (lambda: run.save(tmp_path / "run.txt"), r"unknown ending '\.txt'"),
        (lambda: batch.to_arrow(), r"take one of them, trajectory\[i\]"),
    ):
        with pytest.raises(ArgumentError, match=words):
            call()


LATE = np.r_[np.arange(10.0), 9.0]


@pytest.mark.parametrize(
    ("label", "bad"),
    [
        ("time [s]", LATE),
        ("time [s]", np.where(LATE == 3, np.nan, LATE)),
        ("rotor angle [rad]", LATE[1:]),
        ("rotor angle [rad]", LATE * 1j),
        ("current [A]", LATE[:, None]),
    ],
)
def test_rows_that_are_not_of_their_instants_are_refused(
    label: str, bad: Any, tmp_path: Path
) -> None:
    with np.load(result("servo/case1", duration=0.01).save(tmp_path / "run.npz")) as arrays:
        np.savez(tmp_path / "bad.npz", allow_pickle=False, **{**arrays, label: bad})
    with pytest.raises(ArgumentError, match=r"bad\.npz: holds no trajectory"):
        gm.load_trajectory(tmp_path / "bad.npz")


def test_run_saves_what_it_ran(tmp_path: Path) -> None:
    case, out = "own_laws/transfer_function", str(tmp_path)
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", "--save", "csv", case, "--no-figures", "--out", out])
    assert not stop.value.code
    names = sorted(path.name for path in (tmp_path / "trajectories").iterdir())
    begin = case.replace("/", "_")
    assert names == [f"{begin}.physics.{law}.csv" for law in ("lead", "lqr")]
