"""Trajectories as files: what is written is what is read."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
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

each_ending = pytest.mark.parametrize("ending", [".parquet", ".npz"])


def result(case: str = "servo/case1", duration: float = 0.01) -> RunResult:
    return Experiment.load(case).varied(duration=duration).run(law="grosmc")


@each_ending
@pytest.mark.parametrize("case", ["servo/case1", "two_link_arm/case2", "maglev/warm"])
def test_a_run_is_read_as_it_was_written(case: str, ending: str, tmp_path: Path) -> None:
    run = result(case)
    ours, theirs = run.trajectory, gm.load_trajectory(run.save(tmp_path / f"run{ending}"))
    for name in (
        "time", "state", "command", "input", "sliding", "weighed", "wrench", "physics", "status",
        "valid_until",
    ):  # fmt: skip
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), err_msg=name)
    # Neither an address nor when the law began.
    kept = [name for name in ours.memory.dtype.names or () if name not in ("workspace", "first")]
    assert theirs.memory.dtype.names == tuple(kept)
    for name in kept:
        np.testing.assert_array_equal(ours.memory[name], theirs.memory[name])
    for name in ("states", "inputs", "controlled", "bodies"):
        assert getattr(ours.system, name) == getattr(theirs.system, name)
    assert (theirs.system is ours.system) == case.startswith(("servo", "two_link"))


def test_every_column_says_its_unit(tmp_path: Path) -> None:
    run = result("cart_pendulum/case2")
    table = run.trajectory.to_arrow()
    unit = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    expected = {"pole angle": "rad", "force": "N", "force asked": "N", "torque y on pole": "N m"}
    assert unit | expected == unit
    assert table["pole angle"].to_numpy()[0] == pytest.approx(-np.radians(10))
    # What is held has no value at the last instant.
    assert np.isnan(table["force"].to_numpy()[-1])
    written = pq.read_schema(run.save(tmp_path / "run.parquet"))
    assert written.field("s").metadata[b"unit"].decode() == "rad/s"
    assert json.loads(written.metadata[b"grosmc_mj"])["versions"]["grosmc_mj"] == gm.__version__


@each_ending
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
    plain, law = gm.MujocoPlant.load("servo"), result("servo/nominal").controller
    motors = [gm.machine.Motor("current", k, 1.0, bandwidth=100.0) for k in (0.1, 0.2)]
    batch = gm.simulate([plain.edited(one) for one in motors], law, [0.5, 0.0], duration=0.1)
    weak, strong = (batch[i].to_arrow()["current winding"].to_numpy() for i in range(2))
    # The current loop leaves a billionth of the back-EMF.
    np.testing.assert_allclose(weak[1:], 2 * strong[1:], rtol=1e-6)
    assert np.abs(weak).max() > 0.1


def test_a_csv_is_for_others(tmp_path: Path) -> None:
    run = result()
    rows = list(csv.reader(run.save(tmp_path / "run.csv").read_text("utf-8").splitlines()))
    assert rows[0][:4] == ["time [s]", "rotor angle [rad]", "rotor speed [rad/s]", "current [A]"]
    assert not any(name.startswith("mjSTATE") for name in rows[0])
    assert float(rows[5][1]) == run.trajectory.state[4, 0]
    assert rows[-1][3] == ""


def test_two_signals_of_one_name_are_told_apart() -> None:
    """A plant whose state is called v, as what the index weighs is."""
    plant = gm.affine_plant("cart", states={"p": "m", "v": "m/s"}, inputs={"force": "N"},
                            f=[sp.Symbol("v"), 0], g=[0, 1], h=[sp.Symbol("p")],
                            parameters={})  # fmt: skip
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    law = gm.linearized_lqr(gm.Task(plant, error, gm.control.Setpoint(), np.eye(2), 1.0))
    names = gm.simulate(plant, law, [1.0, 0.0], duration=0.01).to_arrow().schema.names
    assert names[:6] == ["time", "p", "v", "force", "force asked", "weighed v"]


def other(folder: Path, name: str, **arrays: Any) -> Path:
    """A file of arrays, or with another array in the place of one of a run's."""
    if name == "bad.npz":
        with np.load(result().save(folder / "run.npz")) as good:
            arrays = {**good, **arrays}
    np.savez(folder / name, **arrays)
    return folder / name


def bytes_of(folder: Path, name: str, content: bytes) -> Path:
    (folder / name).write_bytes(content)
    return folder / name


def batch() -> Any:
    servo, law = gm.MujocoPlant.load("servo"), result().controller
    return gm.simulate([servo], law, [0.0, 0.0], duration=0.01)


def lacking(folder: Path) -> Path:
    file = result().save(folder / "lacking.parquet")
    pq.write_table(pq.read_table(file).drop(["rotor angle"]), file)
    return file


LATE = np.r_[np.arange(10.0), 9.0]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda folder: other(folder, "other.npz", a=np.zeros(3)), "other.npz: holds no traj"),
        # A pickle is not opened.
        (lambda folder: other(folder, "pickle.npz", grosmc_mj=np.array({"a": 1}, dtype=object)),
         "pickle.npz: holds no traj"),
        (lambda folder: bytes_of(folder, "no.npz", b"PK\x03\x04 neither"), "no.npz: holds no traj"),
        (lambda folder: bytes_of(folder, "no.parquet", b"PAR1 no"), "no.parquet: holds no traj"),
        (lacking, "lacking.parquet: holds no traj"),
        (lambda folder: folder / "none.parquet", "there is no file"),
        (lambda folder: result().save(folder / "run.csv"), "read again from .parquet and .npz"),
        (lambda folder: result().save(folder / "run.txt"), r"unknown ending '\.txt'"),
        (lambda folder: batch().to_arrow(), r"take one of them, trajectory\[i\]"),
        # Rows that are not of their instants.
        *((lambda folder, label=label, bad=bad: other(folder, "bad.npz", **{label: bad}),
           r"bad\.npz: holds no trajectory") for label, bad in (
            ("time [s]", LATE),
            ("time [s]", np.where(LATE == 3, np.nan, LATE)),
            ("rotor angle [rad]", LATE[1:]),
            ("rotor angle [rad]", LATE * 1j),
            ("current [A]", LATE[:, None]),
        )),
    ],
)  # fmt: skip
def test_what_is_no_run_s_file_is_refused(
    call: Callable[[Path], Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=words):
        gm.load_trajectory(call(tmp_path))


def test_run_saves_what_it_ran(tmp_path: Path) -> None:
    case, out = "own_laws/transfer_function", str(tmp_path)
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", "--save", "csv", case, "--no-figures", "--out", out])
    assert not stop.value.code
    names = sorted(path.name for path in (tmp_path / "trajectories").iterdir())
    assert names == [f"own_laws_transfer_function.physics.{law}.csv" for law in ("lead", "lqr")]
