"""Trajectories: the result of a simulation, and its files."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, one_line, unknown_name, value_text
from grosmc_mj.ground.fields import Is, checked_call
from grosmc_mj.ground.files import LARGEST_TABLE, atomic_write, require_regular
from grosmc_mj.ground.versions import versions
from grosmc_mj.ground.wording import counted
from grosmc_mj.mechanics.physics.edit import HiddenState
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import SYSTEMS, Signal, System


class Status(Enum):
    """End of a run; ``UNDEFINED_INPUT`` if the law returned no finite number."""

    COMPLETED = 0
    UNDEFINED_LAW = 1
    SINGULAR_PLANT = 2
    DIVERGED = 3
    UNDEFINED_INPUT = 4


# Signals with a row for each instant, and for each interval between two.
_INSTANTS = ("state", "physics")
_DISTURBANCES = ("wrench", "input_disturbance", "output_disturbance", "rate_disturbance")
_INTERVALS = ("command", "input", "acting", "sliding", "weighed", "memory", "seen", *_DISTURBANCES)
# Key of the description in a file.
_ABOUT = "grosmc_mj"
_PARQUET = ".parquet"
_FORMATS = (_PARQUET, ".csv")


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One run, or a batch of them with one more axis in front of every array.

    With N timesteps, arrays over instants have N + 1 rows (t = 0 ... N h) and arrays over
    intervals have N: row i holds over [t_i, t_{i+1}). After the end of a run that stopped early
    the rows repeat its last valid ones; without recording N is 1. With m > 1 inputs those of
    command, input, input_disturbance, sliding and weighed have one more axis at the end,
    (..., N, m).

    Attributes:
        system: The plant's system, which names the states and gives their units.
        time: Instants, exactly i h [s], (N + 1,).
        state: x, (..., N + 1, n).
        command: What the law asked for, in the unit of ``system.input``, (..., N).
        input: What the actuator applied, without a disturbance of the input, (..., N).
        sliding: s at the samples, held between them, (..., N); None if the law has no surface.
        weighed: The input v that the law's index weighs, (..., N).
        memory: The law's memory after its last sample by the fields of its dataclass, a
            structured array, (..., N); zeros where an unrecorded run ended early.
        wrench: [force, torque] of each of ``system.bodies``, (..., N, 6 * bodies); None if no
            disturbance on a body was given.
        physics: mjSTATE_FULLPHYSICS at each instant, (..., N + 1, size), to replay the run
            exactly; None on an analytic plant.
        status: How each run ended, () or (nsim,).
        valid_until: Time up to which each run is valid [s], () or (nsim,).
        seen: What sensors and estimators told of x at the last sample, (..., N, n); None for a
            law that knows it.
        unseen: What of ``physics`` no law sees, such as twists and currents of a machine; of a
            batch one such tuple for each run.
        accumulated: Values of the accumulator, a structured array, () or (nsim,); None without
            any.
        input_disturbance: Disturbances of the inputs, in their units, (..., N); None if none was
            given.
        output_disturbance: Disturbances of the states as they are measured, (..., N, n); None if
            none was given.
        rate_disturbance: Disturbances of the rates of states, (..., N, n); None if none was given.
        acting: The input as it acts on the plant, with its disturbance, (..., N): of a motor the
            torque at its joint. None where it was not computed, see ``acting.with_acting``.
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
    accumulated: Any = None
    input_disturbance: Array | None = None
    output_disturbance: Array | None = None
    rate_disturbance: Array | None = None
    acting: Array | None = None

    @property
    def applied(self) -> Array:
        """The input as it acts if motors stand in its place, else what the actuators give."""
        return self.input if self.acting is None else self.acting

    @property
    def disturbed(self) -> NDArray[np.bool_] | None:
        """Whether a disturbance acts in each interval of one run, (N,); None if none was given."""
        acts = None
        for name in _DISTURBANCES:
            rows = getattr(self, name)
            if rows is None:
                continue
            nonzero = np.any(rows != 0, axis=tuple(range(1, rows.ndim)))
            acts = nonzero if acts is None else acts | nonzero
        return acts

    def __repr__(self) -> str:
        """System, number of instants and how it ended, without rows."""
        runs = "" if self.state.ndim == 2 else f"{counted(len(self.state), 'run')}, "
        endings = sorted({status.name.lower() for status in np.ravel(self.status)})
        return (
            f"Trajectory({self.system.name}: {runs}{len(self.time)} instants, "
            f"0 to {self.time[-1]:g} s, {', '.join(endings)})"
        )

    def to_arrow(
        self, *, sliding_unit: str = "", further: Mapping[str, tuple[str, Array]] | None = None
    ) -> Any:
        """Return the signals of one run as a ``pyarrow.Table``; a column each, see ``save``.

        Args:
            sliding_unit: Unit of s, which the law's design knows.
            further: Unit and values at all instants, (N + 1,), of further columns by their names.

        Raises:
            ArgumentError: For a batch.
        """
        if self.state.ndim != 2:
            raise ArgumentError(
                f"a batch of {counted(len(self), 'run')}: take one of them, trajectory[i]"
            )

        # Unit and values of each column by its name.
        columns = {"time": ("s", self.time)}
        signals = {}
        for signal, labels, rows in self._signals(sliding_unit):
            names = [f"{signal} {name}" if name in columns else name for name, _ in labels]
            signals[signal] = names, rows.shape[1:]

            # A signal that is held over intervals has no value at the last instant.
            held = np.full((len(self.time), len(names)), np.nan)
            # Of a run that ends in its first step it has none at all.
            held[: len(rows)] = rows.reshape(len(rows), len(names))
            for name, (_, unit), values in zip(names, labels, held.T, strict=True):
                columns[name] = unit, values
        columns.update(further or {})

        about = {
            "system": self.system.name,
            "states": [astuple(state) for state in self.system.states],
            "inputs": [astuple(signal) for signal in self.system.inputs],
            "controlled": self.system.controlled,
            "bodies": self.system.bodies,
            "signals": signals,
            "unseen": [astuple(state) for state in self.unseen],
            "status": np.ravel(self.status)[0].name,
            "valid_until": float(np.ravel(self.valid_until)[0]),
            "versions": versions(),
        }
        return _table(columns, json.dumps(about))

    def _signals(self, sliding_unit: str) -> list[tuple[str, _Labels, Array]]:
        """Name, labels of its columns and rows of each signal that this run has."""
        states = self.system.states
        inputs = self.system.inputs
        rates = [(f"disturbance of the rate of {x.name}", x.rate_unit) for x in states]
        signals: list[tuple[str, _Labels, Array | None]] = [
            ("state", _labels(states), self.state),
            ("seen", _labels(states, "{} seen"), self.seen),
            ("input", _labels(inputs, "{}" if self.acting is None else "{} given"), self.input),
            ("acting", _labels(inputs), self.acting),
            ("command", _labels(inputs, "{} asked"), self.command),
            ("sliding", _numbered("s", sliding_unit, self.sliding), self.sliding),
            ("weighed", _numbered("v", "", self.weighed), self.weighed),
            ("wrench", _wrench_labels(self.system), self.wrench),
            (
                "input_disturbance",
                _labels(inputs, "disturbance of {}"),
                self.input_disturbance,
            ),
            (
                "output_disturbance",
                _labels(states, "disturbance of measured {}"),
                self.output_disturbance,
            ),
            ("rate_disturbance", rates, self.rate_disturbance),
            ("physics", _numbered("mjSTATE_FULLPHYSICS", "", self.physics), self.physics),
        ]
        if self.physics is not None and self.unseen:
            hidden = np.stack([state.of(self.physics) for state in self.unseen], axis=1)
            signals.append(("unseen", _labels(self.unseen), hidden))
        for field in self.memory.dtype.names or ():
            name = f"memory {field}"
            rows = self.memory[field]
            signals.append((name, _numbered(name, "", rows), rows))
        return [(name, labels, rows) for name, labels, rows in signals if rows is not None]

    def save(
        self,
        path: str | Path,
        *,
        sliding_unit: str = "",
        further: Mapping[str, tuple[str, Array]] | None = None,
    ) -> Path:
        """Write one run as ``.parquet`` or ``.csv``, by the ending.

        A column is a signal with its unit: ``time``, each state by its name, the inputs as they
        were applied and as they were asked for, ``s``, ``v``, memory, disturbances, what of a
        machine no law sees; a unit that nothing here knows is left empty. A row is an instant;
        what is held over an interval stands at its beginning, and the last row has none. Parquet
        keeps all of the run, for ``load_trajectory``; columns of CSV are called ``name [unit]``,
        without brackets where no unit is known.

        Args:
            path: The file.
            sliding_unit: Unit of s, which the law's design knows.
            further: Unit and values at all instants, (N + 1,), of further columns by their names;
                ``load_trajectory`` leaves them out.

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

        table = self.to_arrow(sliding_unit=sliding_unit, further=further)
        with atomic_write(file) as part:
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
        """Return one run of a batch, cut where it stopped being valid."""
        end = int(np.searchsorted(self.time, self.valid_until[run] * (1 + 1e-12), side="right"))
        lengths = {**dict.fromkeys(_INSTANTS, end), **dict.fromkeys(_INTERVALS, end - 1)}
        cut = {}
        for name, length in lengths.items():
            rows = getattr(self, name)
            cut[name] = None if rows is None else rows[run, :length]
        return replace(
            self,
            time=self.time[:end],
            status=self.status[run],
            valid_until=self.valid_until[run],
            unseen=self.unseen[run],
            accumulated=None if self.accumulated is None else self.accumulated[run],
            **cut,
        )


# Name and unit of each column of a signal.
_Labels = list[tuple[str, str]]


def _labels(signals: Sequence[Any], pattern: str = "{}") -> _Labels:
    """Labels of named signals with a unit; the pattern takes the name."""
    return [(pattern.format(signal.name), signal.unit) for signal in signals]


def _numbered(name: str, unit: str, rows: Array | None) -> _Labels:
    """Labels of a signal, (N,) or (N, ...), with numbers from 1 if it has several columns."""
    count = 0 if rows is None else math.prod(rows.shape[1:])
    if count == 1:
        return [(name, unit)]
    return [(f"{name} {i + 1}", unit) for i in range(count)]


def _wrench_labels(system: System) -> _Labels:
    """Labels of the wrenches."""
    labels = []
    for body in system.bodies:
        for kind, unit in (("force", "N"), ("torque", "N m")):
            labels += [(f"{kind} {axis} on {body}", unit) for axis in "xyz"]
    return labels


def _table(columns: Mapping[str, tuple[str, Array]], about: str) -> Any:
    """Columns with their units as a ``pyarrow.Table``; NaN becomes a missing value.

    Args:
        columns: Unit, empty where it is not known, and values, (N + 1,), of each by its name.
        about: Description of the run.
    """
    import pyarrow as pa

    fields = []
    arrays = []
    for name, (unit, values) in columns.items():
        fields.append(pa.field(name, pa.float64(), metadata={"unit": unit}))
        arrays.append(pa.array(values, pa.float64(), from_pandas=True))
    return pa.table(arrays, schema=pa.schema(fields, metadata={_ABOUT: about}))


def _write_csv(table: Any, file: Path) -> None:
    """Write a run's columns with their units; the state of physics is left out."""
    import pyarrow.csv

    labels = []
    for field in table.schema:
        # Of a unit that nothing here knows there are no brackets.
        unit = field.metadata[b"unit"].decode()
        labels.append(f"{field.name} [{unit}]" if unit else field.name)
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
        raise ArgumentError(f"there is no file {value_text(str(path), str)}")
    require_regular(file, LARGEST_TABLE)
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
    """Read a trajectory from its table.

    Raises:
        Exception: Of any class, if the table holds no run.
    """
    wrong = [f"{field.name}: {field.type}" for field in table.schema if field.type != "double"]
    if wrong:
        raise ArgumentError(f"columns must be real numbers, not {', '.join(wrong)}")
    time = table["time"].to_numpy()
    if not (len(time) and np.all(np.isfinite(time)) and np.all(np.diff(time) > 0)):
        raise ArgumentError("time must be finite and increasing")

    about = json.loads(table.schema.metadata[_ABOUT.encode()])
    signals: dict[str, Any] = dict.fromkeys(("sliding", "wrench", "physics", "seen", "acting"))
    memory: dict[str, Array] = {}
    for signal, (names, shape) in about["signals"].items():
        rows = _rows(table, names)
        if signal not in _INSTANTS:
            rows = rows[:-1]
        rows = np.ascontiguousarray(rows).reshape(len(rows), *shape)
        if signal.startswith("memory "):
            memory[signal.removeprefix("memory ")] = rows
        else:
            signals[signal] = rows
    # Its columns are columns of physics, too.
    signals.pop("unseen", None)

    sizes = {"state": about["states"], "command": about["inputs"], "input": about["inputs"]}
    for signal, described in sizes.items():
        rows = signals[signal]
        if math.prod(rows.shape[1:]) != len(described) or rows.ndim > 2:
            raise ArgumentError(f"{signal} must have {len(described)} numbers at each instant")
    return Trajectory(
        system=_system(about),
        time=time,
        memory=_memory(memory, len(time) - 1),
        status=Status[about["status"]],  # pyright: ignore[reportArgumentType]
        valid_until=np.float64(about["valid_until"]),  # pyright: ignore[reportArgumentType]
        unseen=tuple(HiddenState(*row) for row in about["unseen"]),
        **signals,
    )


def _rows(table: Any, names: Sequence[str]) -> Array:
    """Columns of a signal side by side, (N + 1, columns)."""
    return np.column_stack([table[name].to_numpy() for name in names])


def _memory(fields: dict[str, Array], length: int) -> NDArray[np.void]:
    """Memory of a law as a structured array, (N,), of its fields, (N, ...)."""
    kinds = [(name, np.float64, rows.shape[1:]) for name, rows in fields.items()]
    memory = np.zeros(length, np.dtype(kinds))
    for name, rows in fields.items():
        memory[name] = rows
    return memory


def _system(about: Any) -> System:
    """System of the package that a file names; one without equations if it is none of them."""
    states = tuple(Signal(*row) for row in about["states"])
    inputs = tuple(Signal(*row) for row in about["inputs"])
    name = about["system"]
    system = SYSTEMS.get(name)
    if system is not None and system.states == states and system.inputs == inputs:
        return system
    return System(
        name,
        name,
        states,
        inputs,
        None,
        controlled=tuple(about["controlled"]),
        bodies=tuple(about["bodies"]),
    )


def why_ended(
    status: Status,
    system: System,
    controller: Controller,
    time: float,
    x: Array,
    remedy: str,
) -> str:
    """Reason in one line why a run could not go on; empty for one that could.

    Args:
        status: How it ended.
        system: System of the plant.
        controller: Controller of the run.
        time: Time up to which the run is valid [s].
        x: State there, (n,).
        remedy: Advice for one whose state grew without bound.
    """
    if status is Status.COMPLETED:
        return ""
    values = ", ".join(f"{value:.4g}" for value in x)
    reason = ""
    if status is Status.DIVERGED:
        reason = f"the state grew without bound; {remedy}"
    elif status is Status.SINGULAR_PLANT:
        reason = f"the plant is singular at {system.singularity}"
    elif status is Status.UNDEFINED_INPUT:
        reason = f"the law returned no finite number at x = ({values})"
    elif controller.design is not None and controller.design.linearizing and system.linearizable(x):
        reason = (
            f"the law is undefined at x = ({values}): the decoupling matrix E(x) of eq. (21) is "
            "singular there"
        )
    else:
        reason = f"the law is undefined outside {system.region}"
    return f"{system.name} under {controller.name} at t = {time:g} s: {reason}"
