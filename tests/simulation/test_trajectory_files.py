"""Trajectories as files."""

from __future__ import annotations

import csv
import itertools
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import sympy as sp
from cases import write
from commands import run
from numpy.typing import NDArray

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.ground.errors import ArgumentError, UndefinedLawError
from grosmc_mj.theory.plants import SYSTEMS


@cache
def result(case: str = "servo/case1", duration: float = 0.01) -> RunResult:
    return Experiment.load(case).changed(duration=duration).run(law="grosmc")


FIELDS = (
    "time",
    "state",
    "command",
    "input",
    "sliding",
    "weighed",
    "wrench",
    "physics",
    "status",
    "valid_until",
)


class Stored(NamedTuple):
    """A run, and the one that its file is read as."""

    written: Any
    loaded: Any


@pytest.fixture(scope="module", params=["servo/case1", "two_link_arm/case2", "maglev/warm"])
def stored(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Stored:
    written = result(request.param).trajectory
    file = written.save(tmp_path_factory.mktemp("stored") / "run.parquet")
    return Stored(written, gm.load_trajectory(file))


@pytest.mark.parametrize("name", FIELDS)
def test_a_run_is_read_as_it_was_written(stored: Stored, name: str) -> None:
    np.testing.assert_array_equal(getattr(stored.written, name), getattr(stored.loaded, name))


def test_a_file_keeps_the_memory(stored: Stored) -> None:
    written, loaded = stored.written.memory, stored.loaded.memory
    assert set(loaded.dtype.names or ()) == set(written.dtype.names or ())
    for name in written.dtype.names or ():
        np.testing.assert_array_equal(written[name], loaded[name])


def test_a_file_keeps_the_system(stored: Stored) -> None:
    """A shipped one is the very object that was written."""
    written, loaded = stored.written.system, stored.loaded.system
    for name in ("states", "inputs", "controlled", "bodies"):
        assert getattr(written, name) == getattr(loaded, name)
    assert (loaded is written) == (written.name in SYSTEMS)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_run_that_ends_in_its_first_step_is_written(ending: str, tmp_path: Path) -> None:
    """The pole starts below the horizontal, where no law is defined: there is one instant."""
    nominal = Experiment.load("cart_pendulum/nominal")
    with pytest.raises(UndefinedLawError) as ended:
        gm.simulate(
            nominal.plant("physics"),
            nominal.law("physics", "fl-lqr"),
            [0.0, 1.6, 0.0, 0.0],
            duration=0.1,
            control_period=1e-3,
        )
    written: Any = ended.value.trajectory
    file = written.save(tmp_path / f"run.{ending}")
    assert written.state.tolist() == [[0.0, 1.6, 0.0, 0.0]]
    if ending == "csv":
        (row,) = csv.DictReader(file.read_text(encoding="utf-8").splitlines())
        assert (row["pole angle [rad]"], row["force [N]"]) == ("1.6", "")
    else:
        loaded = gm.load_trajectory(file)
        assert loaded.state.tolist() == written.state.tolist()
        assert (loaded.input.shape, loaded.memory.shape) == ((0,), (0,))


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File of a run on a machine."""
    folder = tmp_path_factory.mktemp("machine")
    return result("cart_pendulum/machine", 0.05).save(folder / "run.parquet")


def test_columns_say_their_units(machine: Path) -> None:
    schema = gm.load_trajectory(machine).to_arrow().schema
    unit = {field.name: field.metadata[b"unit"].decode() for field in schema}
    expected = {
        "pole angle": "rad",
        "force": "N",
        "force asked": "N",
        "slider twist": "m",
        "force winding": "A",
        "slider friction bristle": "m",
        "hinge friction bristle": "rad",
    }
    assert unit | expected == unit
    assert pq.read_schema(machine).field("s").metadata[b"unit"] == b"rad/s"


def test_states_of_a_machine_are_among_the_columns(machine: Path) -> None:
    run: Any = gm.load_trajectory(machine)
    table = run.to_arrow()
    # The motor's coordinate comes after slider and hinge.
    twist = table["slider twist"].to_numpy()
    np.testing.assert_array_equal(twist, run.physics[:, 3] - run.state[:, 0])
    assert np.abs(table["force winding"].to_numpy()).max() > 1.0
    # A held input has no value at the last instant.
    assert np.isnan(table["force"].to_numpy()[-1])


def test_a_file_says_the_version_that_wrote_it(machine: Path) -> None:
    description = json.loads(pq.read_schema(machine).metadata[b"grosmc_mj"])
    assert description["versions"]["grosmc_mj"] == gm.__version__


def test_a_file_keeps_every_field_of_a_users_memory() -> None:
    plant = gm.MujocoPlant.load("servo").analytic()
    like = gm.chapter_controller("lqr", plant)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        memory.first += 1.0
        u[0] = 0.0

    counting = gm.custom_controller("counting", law, like, memory={"first": 0.0})
    run = gm.simulate(plant, counting, [1.0, 0.0], duration=3e-3, engine="python")
    assert run.to_arrow()["memory first"].to_pylist()[:3] == [1.0, 2.0, 3.0]


def test_two_signals_of_one_name_are_distinguished() -> None:
    """A plant whose state is called v, as the signal that the index weighs is."""
    plant = gm.affine_plant(
        "cart",
        states={"p": "m", "v": "m/s"},
        inputs={"force": "N"},
        f=[sp.Symbol("v"), 0],
        g=[0, 1],
        h=[sp.Symbol("p")],
        parameters={},
    )
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    task = gm.Task(plant, error, gm.control.Setpoint(), np.eye(2), 1.0)
    run = gm.simulate(plant, gm.linearized_lqr(task), [1.0, 0.0], duration=0.01)
    names = run.to_arrow().schema.names
    assert names[:6] == ["time", "p", "v", "force", "force asked", "weighed v"]


def changed(folder: Path, change: Callable[[pa.Table], pa.Table]) -> Path:
    """A run's file with another table."""
    pq.write_table(change(result().trajectory.to_arrow()), folder / "bad.parquet")
    return folder / "bad.parquet"


def with_column(folder: Path, name: str, values: NDArray[Any]) -> Path:
    """A run's file with other values in one of its columns."""

    def change(table: pa.Table) -> pa.Table:
        return table.set_column(table.schema.get_field_index(name), name, pa.array(values))

    return changed(folder, change)


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
        (lambda folder: changed(folder, lambda run: run.drop_columns("rotor angle")), NO_RUN),
        # A table that describes no run.
        (lambda folder: changed(folder, lambda run: run.replace_schema_metadata(None)), NO_RUN),
    ],
)
def test_files_that_are_of_no_run_are_refused(
    call: Callable[[Path], Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match=words):
        gm.load_trajectory(call(tmp_path))


def test_the_command_run_saves_its_runs(tmp_path: Path) -> None:
    case = write(tmp_path, "servo", controller=[{"law": "lqr"}, {"law": "pid", "kp": 1}])
    assert run("run", "--save", "csv", case, "--no-figures", "--out", tmp_path) == 0
    names = sorted(path.name for path in (tmp_path / "trajectories").iterdir())
    plants_and_laws = itertools.product(("corrected", "physics"), ("lqr", "pid"))
    assert names == [f"mine.{plant}.{law}.csv" for plant, law in plants_and_laws]


def test_a_csv_has_units_in_its_heading(tmp_path: Path) -> None:
    text = result().save(tmp_path / "run.csv").read_text("utf-8")
    rows = list(csv.reader(text.splitlines()))
    assert rows[0][:4] == ["time [s]", "rotor angle [rad]", "rotor speed [rad/s]", "current [A]"]
    # The unit of v is that of a law, which a run does not know.
    assert "v" in rows[0]
    assert float(rows[5][1]) == result().trajectory.state[4, 0]
    # A held input has no value at the last instant.
    assert rows[-1][3] == ""
