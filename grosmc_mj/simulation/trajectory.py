"""What a simulation leaves behind."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, one_line, shown, unknown_name
from grosmc_mj.fields import Is, checked_call
from grosmc_mj.files import written_aside
from grosmc_mj.physics.edit import HiddenState
from grosmc_mj.plants import SYSTEMS, Signal, System
from grosmc_mj.plants.equations import NoEquations
from grosmc_mj.versions import versions


class Status(Enum):
    """How a run ended; ``UNDEFINED_INPUT`` where the law returned no finite number."""

    COMPLETED = 0
    UNDEFINED_LAW = 1
    SINGULAR_PLANT = 2
    DIVERGED = 3
    UNDEFINED_INPUT = 4


# Of a law's memory: an address, and when it began.
_NOT_SAVED = ("workspace", "first")
# Signals with a row for each instant, and for each interval between two.
_INSTANTS = ("state", "physics")
_INTERVALS = ("command", "input", "sliding", "weighed", "memory", "wrench", "seen")
# Key of a file's description, and ending of files.
_ABOUT = "grosmc_mj"
_PARQUET = ".parquet"
_FORMATS = (_PARQUET, ".csv")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One run, or a batch of them with one more axis in front of every array.

    With N timesteps, arrays over instants have N + 1 rows (t = 0 ... N h) and arrays over
    intervals have N: row i holds over [t_i, t_{i+1}). After the end of a run that stopped early
    the rows repeat its last valid ones; without recording N is 1. With m > 1 inputs those of
    command, input, sliding and weighed have one more axis at the end, (..., N, m).

    Attributes:
        system: The plant's system, which names the states and gives their units.
        time: Instants, exactly i h [s], (N + 1,).
        state: x, (..., N + 1, n).
        command: What the law asked for, in the unit of ``system.input``, (..., N).
        input: What the actuator applied, (..., N).
        sliding: s at the samples, held between them, (..., N); None if the law has no surface.
        weighed: The input v that the law's index weighs, (..., N).
        memory: The law's memory after its last sample by the fields of its dataclass, a
            structured array, (..., N); zeros where an unrecorded run ended early.
        wrench: [force, torque] of each of ``system.bodies``, (..., N, 6 * bodies); None if no
            disturbance was given.
        physics: mjSTATE_FULLPHYSICS at each instant, (..., N + 1, size), to replay the run
            exactly; None on an analytic plant.
        status: How each run ended, () or (nsim,).
        valid_until: Time up to which each run is valid [s], () or (nsim,).
        seen: What sensors and estimators told of x at the last sample, (..., N, n); None for a
            law that knows it.
        unseen: What of ``physics`` no law sees, such as twists and currents of a machine; of a
            batch one such tuple for each run.
        meters: The accumulated metrics, a structured array, () or (nsim,); None without any.
    """

    system: System
    time: Array
    state: Array
    command: Array
    input: Array
    sliding: Array | None
    weighed: Array
    memory: NDArray[np.void]
    wrench: Array | None
    physics: Array | None
    status: NDArray[np.object_]
    valid_until: Array
    seen: Array | None = None
    unseen: tuple[Any, ...] = ()
    meters: Any = None

    def __repr__(self) -> str:
        """What it is, without its rows."""
        runs = "" if self.state.ndim == 2 else f"{len(self.state)} runs, "
        until, ended = self.time[-1], {status.name.lower() for status in np.ravel(self.status)}
        return (
            f"Trajectory({self.system.name}: {runs}{len(self.time)} instants, 0 to {until:g} s, "
            f"{', '.join(sorted(ended))})"
        )

    def to_arrow(self, *, sliding_unit: str = "") -> Any:
        """The signals of one run as a ``pyarrow.Table``; a column each, see ``save``.

        Args:
            sliding_unit: Unit of s, which the law's design knows.

        Raises:
            ArgumentError: For a batch.
        """
        if self.state.ndim != 2:
            raise ArgumentError(f"a batch of {len(self)} runs: take one of them, trajectory[i]")
        system, physics = self.system, self.physics
        unseen = [state.of(physics) for state in self.unseen if physics is not None]
        tables: list[tuple[str, list[tuple[str, str]], Array | None]] = [
            ("state", [(state.name, state.unit) for state in system.states], self.state),
            ("seen", [(f"{state.name} seen", state.unit) for state in system.states], self.seen),
            ("input", [(signal.name, signal.unit) for signal in system.inputs], self.input),
            ("command", [(f"{u.name} asked", u.unit) for u in system.inputs], self.command),
            ("sliding", _numbered("s", sliding_unit, self.sliding), self.sliding),
            ("weighed", _numbered("v", "", self.weighed), self.weighed),
            ("wrench", _wrench_labels(system), self.wrench),
            ("physics", _numbered("mjSTATE_FULLPHYSICS", "", physics), physics),
            ("unseen", [(state.name, state.unit) for state in self.unseen],
             np.stack(unseen, axis=1) if unseen else None),
            *((f"memory {name}", _numbered(f"memory {name}", "", rows), rows)
              for name in self.memory.dtype.names or () if name not in _NOT_SAVED
              for rows in [self.memory[name]]),
        ]  # fmt: skip
        columns, signals = [("time", "s", self.time)], {}
        for signal, labels, rows in tables:
            if rows is None:
                continue
            taken = {name for name, _, _ in columns}
            names = [f"{signal} {name}" if name in taken else name for name, _ in labels]
            signals[signal] = names, rows.shape[1:]
            # What is held over intervals has no value at the last instant.
            held = np.full((len(self.time), len(names)), np.nan)
            held[: len(rows)] = rows.reshape(len(rows), -1)
            units = [unit for _, unit in labels]
            columns += [row for row in zip(names, units, held.T, strict=True) if row[0]]
        about = {
            "system": system.name,
            "states": [astuple(state) for state in system.states],
            "inputs": [astuple(signal) for signal in system.inputs],
            "controlled": system.controlled,
            "bodies": system.bodies,
            "signals": signals,
            "unseen": [astuple(state) for state in self.unseen],
            "status": np.ravel(self.status)[0].name,
            "valid_until": float(np.ravel(self.valid_until)[0]),
            "versions": versions(),
        }
        return _table(columns, json.dumps(about))

    def save(self, path: str | Path, *, sliding_unit: str = "") -> Path:
        """Write one run as ``.parquet`` or ``.csv``, by the ending.

        A column is a signal with its unit: ``time``, each state by its name, the inputs as they
        were applied and as they were asked for, ``s``, ``v``, memory, forces and torques, what of
        a machine no law sees; a unit that nothing here knows is left empty. A row is an instant;
        what is held over an interval stands at its beginning, and the last row has none. Parquet
        keeps all of the run, for ``load_trajectory``; columns of CSV are called ``name [unit]``.

        Args:
            path: The file.
            sliding_unit: Unit of s, which the law's design knows.

        Returns:
            Where it is.

        Raises:
            ArgumentError: For a batch, or another ending.
            SetupError: If it cannot be written.
        """
        import pyarrow.parquet

        file = Path(path)
        if file.suffix not in _FORMATS:
            raise ArgumentError(unknown_name("ending", file.suffix, _FORMATS))

        table = self.to_arrow(sliding_unit=sliding_unit)
        with written_aside(file) as part:
            if file.suffix == _PARQUET:
                pyarrow.parquet.write_table(table, part)
            else:
                _write_csv(table, part)
        return file

    def __len__(self) -> int:
        """Number of runs in a batch.

        Raises:
            TypeError: For one run.
        """
        if self.state.ndim == 2:
            raise TypeError("one run has no length; a batch has")
        return len(self.state)

    def __getitem__(self, run: int) -> Trajectory:
        """One run of a batch, cut where it stopped being valid."""
        end = int(np.searchsorted(self.time, self.valid_until[run] * (1 + 1e-12), side="right"))
        lengths = {**dict.fromkeys(_INSTANTS, end), **dict.fromkeys(_INTERVALS, end - 1)}
        cut = {
            name: None if (rows := getattr(self, name)) is None else rows[run, :length]
            for name, length in lengths.items()
        }
        return replace(
            self,
            time=self.time[:end],
            status=self.status[run],
            valid_until=self.valid_until[run],
            unseen=self.unseen[run],
            meters=None if self.meters is None else self.meters[run],
            **cut,
        )


def _numbered(name: str, unit: str, rows: Array | None) -> list[tuple[str, str]]:
    """Name and unit of each column of a signal, (N,) or (N, ...)."""
    count = 0 if rows is None else math.prod(rows.shape[1:])
    return [(name if count == 1 else f"{name} {i + 1}", unit) for i in range(count)]


def _wrench_labels(system: System) -> list[tuple[str, str]]:
    """Name and unit of each column of the wrenches; no name of one that is not used."""
    labels = []
    for body in system.bodies:
        if body in system.pushes:
            labels += [(f"disturbance of {body}", system.pushes[body]), *[("", "")] * 5]
            continue
        for kind, unit in (("force", "N"), ("torque", "N m")):
            labels += [(f"{kind} {axis} on {body}", unit) for axis in "xyz"]
    return labels


def _table(columns: Sequence[tuple[str, str, Array]], about: str) -> Any:
    """Columns by their names with their units as a ``pyarrow.Table``; NaN is no value."""
    import pyarrow as pa

    fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit, _ in columns]
    arrays = [pa.array(values, pa.float64(), from_pandas=True) for _, _, values in columns]
    return pa.table(arrays, schema=pa.schema(fields, metadata={_ABOUT: about}))


def _write_csv(table: Any, file: Path) -> None:
    """Write a run's columns with their units; the state of physics is left out."""
    import pyarrow.csv

    labels = [f"{field.name} [{field.metadata[b'unit'].decode()}]" for field in table.schema]
    physics = [label for label in labels if label.startswith("mjSTATE")]
    pyarrow.csv.write_csv(table.rename_columns(labels).drop_columns(physics), file)


@checked_call
def load_trajectory(path: Annotated[Any, Is((str, Path), "the path of a file")]) -> Trajectory:
    """Read a run that ``Trajectory.save`` wrote as ``.parquet``; nothing is executed.

    Its system has the names and units of the run's and, if it is none of the package, no equations.

    Raises:
        ArgumentError: If there is no such file, or it is another one.
    """
    import pyarrow.parquet

    file = Path(path)
    if not file.is_file():
        raise ArgumentError(f"there is no file {shown(str(path), str)}")
    if file.suffix != _PARQUET:
        raise ArgumentError(
            f"{file}: a run is read from {_PARQUET} alone: run it again and save it as {_PARQUET}"
        )
    try:
        return _restored(pyarrow.parquet.read_table(file))
    # pyarrow and numpy have no common class for what they cannot read.
    except Exception as error:
        reason = f"{type(error).__name__}: {one_line(str(error))}"
        raise ArgumentError(f"{file}: holds no trajectory, or is damaged: {reason}") from None


def _restored(table: Any) -> Trajectory:
    """A trajectory from its table.

    Raises:
        Exception: Of any class, if the table is none of a run.
    """
    if others := [
        f"{field.name}: {field.type}" for field in table.schema if field.type != "double"
    ]:
        raise ArgumentError(f"columns must be real numbers, not {', '.join(others)}")
    about, time = json.loads(table.schema.metadata[_ABOUT.encode()]), table["time"].to_numpy()
    if not (len(time) and np.all(np.isfinite(time)) and np.all(np.diff(time) > 0)):
        raise ArgumentError("time must be finite and increasing")
    signals: dict[str, Any] = dict.fromkeys(("sliding", "wrench", "physics", "seen"))
    memory: dict[str, Array] = {}
    for signal, (names, shape) in about["signals"].items():
        unused = np.zeros(len(time))
        rows = np.column_stack([table[name].to_numpy() if name else unused for name in names])
        rows = np.ascontiguousarray(rows if signal in _INSTANTS else rows[:-1])
        target = memory if signal.startswith("memory ") else signals
        target[signal.removeprefix("memory ")] = rows.reshape(len(rows), *shape)
    sizes = {"state": about["states"], "command": about["inputs"], "input": about["inputs"]}
    for signal, of in sizes.items():
        if math.prod(signals[signal].shape[1:]) != len(of) or signals[signal].ndim > 2:
            raise ArgumentError(f"{signal} must have {len(of)} numbers at each instant")
    signals.pop("unseen", None)  # columns of physics
    kinds = [(name, np.float64, rows.shape[1:]) for name, rows in memory.items()]
    remembered = np.zeros(len(time) - 1, np.dtype(kinds))
    for name, rows in memory.items():
        remembered[name] = rows
    states, inputs = (tuple(Signal(*row) for row in about[key]) for key in ("states", "inputs"))
    system = SYSTEMS.get(name := about["system"])
    if system is None or (system.states, system.inputs) != (states, inputs):
        system = System(
            name, name, states, inputs, NoEquations(name),
            controlled=tuple(about["controlled"]), bodies=tuple(about["bodies"]),
        )  # fmt: skip
    until: Any = np.float64(about["valid_until"])
    return Trajectory(
        system=system, time=time, memory=remembered, status=Status[about["status"]],  # pyright: ignore[reportArgumentType]
        valid_until=until, unseen=tuple(HiddenState(*row) for row in about["unseen"]), **signals,
    )  # fmt: skip


def why_ended(status: Status, system: System, controller: Controller, time: float, x: Array) -> str:
    """One line for a run that could not go on; empty for one that could.

    Args:
        status: How it ended.
        system: The plant's.
        controller: Whose law it was.
        time: Up to which the run is valid [s].
        x: State there, (n,).
    """
    if status is Status.COMPLETED:
        return ""
    at = ", ".join(f"{value:.4g}" for value in x)
    linearizing = controller.design is not None and controller.design.linearizing
    outside = f"the law is undefined outside {system.region}"
    if linearizing and system.linearizable(x):
        outside = (
            f"the law is undefined at x = ({at}): the decoupling matrix E(x) of eq. (21) is "
            "singular there"
        )
    why = {
        Status.DIVERGED: "the state grew without bound; try a smaller control period or timestep",
        Status.SINGULAR_PLANT: f"the plant is singular at {system.singularity}",
        Status.UNDEFINED_INPUT: f"the law returned no finite number at x = ({at})",
        Status.UNDEFINED_LAW: outside,
    }[status]
    return f"{system.name} under {controller.name} at t = {time:g} s: {why}"
