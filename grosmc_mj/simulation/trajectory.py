"""What a simulation leaves behind."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, replace
from enum import Enum
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arguments import require
from grosmc_mj.arrays import Array
from grosmc_mj.columns import SignalColumn, arrow_table, read_columns, write_columns
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.physics.hidden_states import HiddenState
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
        until, ended = self.time[-1], {each.name.lower() for each in np.ravel(self.status)}
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
        return arrow_table(*self._columns(sliding_unit))

    def to_pandas(self) -> Any:
        """The same as a pandas frame, indexed by time; pandas must be installed.

        Raises:
            ArgumentError: For a batch.
            SetupError: Without pandas.
        """
        if find_spec("pandas") is None:
            raise SetupError("pandas is not installed; run: pip install pandas")
        return self.to_arrow().to_pandas().set_index("time")

    def save(self, path: str | Path, *, sliding_unit: str = "") -> Path:
        """Write one run as ``.parquet``, ``.npz`` or ``.csv``, by the ending.

        A column is a signal with its unit: ``time``, each state by its name, the inputs as they
        were applied and as they were asked for, ``s``, ``v``, memory, forces and torques, what of
        a machine no law sees; a unit that nothing here knows is left empty. A row is an instant;
        what is held over an interval stands at its beginning, and the last row has none. The first
        two formats keep all of the run, for ``load_trajectory``.

        Args:
            path: The file.
            sliding_unit: Unit of s, which the law's design knows.

        Returns:
            Where it is.

        Raises:
            ArgumentError: For a batch, or another ending.
            SetupError: If it cannot be written.
        """
        file, (columns, about) = Path(path), self._columns(sliding_unit)
        if file.suffix == ".csv":  # which cannot be read again as a run
            columns = [each for each in columns if each.name not in about["groups"]["physics"]]
        write_columns(file, columns, about)
        return file

    def _columns(self, sliding_unit: str = "") -> tuple[list[SignalColumn], dict[str, Any]]:
        """The signals, and what else the run is."""
        if self.state.ndim != 2:
            raise ArgumentError(f"a batch of {len(self)} runs: take one of them, trajectory[i]")
        system = self.system
        groups: list[tuple[str, list[tuple[str, str]], Array | None]] = [
            ("state", [(each.name, each.unit) for each in system.states], self.state),
            ("input", [(each.name, each.unit) for each in system.inputs], self.input),
            ("command", [(f"{u.name} asked", u.unit) for u in system.inputs], self.command),
            ("sliding", _numbered("s", sliding_unit, self.sliding), self.sliding),
            ("weighed", _numbered("v", "", self.weighed), self.weighed),
            ("wrench", _wrench_names(system) if self.wrench is not None else [], self.wrench),
            ("physics", _numbered("mjSTATE_FULLPHYSICS", "", self.physics), self.physics),
        ]
        if self.physics is not None and self.unseen:
            rows = np.stack([each.of(self.physics) for each in self.unseen], axis=1)
            groups.append(("unseen", [(each.name, each.unit) for each in self.unseen], rows))
        if self.seen is not None:
            names = [(f"{each.name} seen", each.unit) for each in system.states]
            groups.insert(1, ("seen", names, self.seen))
        remembered = [each for each in self.memory.dtype.names or () if each not in _NOT_SAVED]
        for name in remembered:
            rows = self.memory[name]
            groups.append((f"memory {name}", _numbered(f"memory {name}", "", rows), rows))
        columns = [SignalColumn("time", "s", self.time)]
        named: dict[str, list[str]] = {}
        for group, names, rows in groups:
            taken = {each.name for each in columns}
            named[group] = [f"{group} {n}" if n in taken else n for n, _ in names]
            for name, (_, unit), values in zip(named[group], names, _by_column(rows), strict=True):
                columns.append(SignalColumn(name, unit, _lengthened(values, len(self.time))))
        about = {
            "system": system.name,
            "states": [list(astuple(each)) for each in system.states],
            "inputs": [list(astuple(each)) for each in system.inputs],
            "controlled": list(system.controlled),
            "bodies": list(system.bodies),
            "groups": named,
            "unseen": [astuple(each) for each in self.unseen],
            "memory": {
                name: list(self.memory.dtype[name].shape) for name in self.memory.dtype.names or ()
            },
            "one_axis": {
                "sliding": self.sliding is not None and self.sliding.ndim == 1,
                "weighed": self.weighed.ndim == 1,
                "input": self.input.ndim == 1,
            },
            "status": np.ravel(self.status)[0].name,
            "valid_until": float(np.ravel(self.valid_until)[0]),
            "versions": versions(),
        }
        return columns, about

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
        signals = {name: getattr(self, name) for name in lengths}
        cut = {
            name: rows if rows is None else rows[run, : lengths[name]]
            for name, rows in signals.items()
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
    """Names of the columns of a signal: its own if it has one."""
    count = _by_column(rows)
    return [(name if len(count) == 1 else f"{name} {i + 1}", unit) for i in range(len(count))]


def _wrench_names(system: System) -> list[tuple[str, str]]:
    """Names of the columns of the wrenches."""
    kinds = (("force", "N"), ("torque", "N m"))
    return [
        (f"{kind} {axis} on {body}", unit)
        for body in system.bodies
        for kind, unit in kinds
        for axis in "xyz"
    ]


def _by_column(rows: Array | None) -> list[Array]:
    """The columns of (N,) or (N, m); none of None."""
    return [] if rows is None else list(rows.reshape(len(rows), math.prod(rows.shape[1:])).T)


def _lengthened(values: Array, rows: int) -> Array:
    """With NaN at the end of what is held over intervals."""
    return np.append(values, [np.nan] * (rows - len(values)))


def load_trajectory(path: str | Path) -> Trajectory:
    """A run that ``Trajectory.save`` wrote as ``.parquet`` or ``.npz``; nothing is executed.

    Its system has the names and units of the run's and, if it is none of the package, no equations.

    Raises:
        ArgumentError: If there is no such file, or it is another one.
    """
    require("path", path, (str, Path), "the path of a file")
    file = Path(path)
    columns, about = read_columns(file)
    try:
        return _restored({column.name: column.values for column in columns}, about)
    except ArgumentError as error:
        raise ArgumentError(f"{file}: holds no trajectory: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise ArgumentError(f"{file}: holds no trajectory: {error!r}") from None


def _restored(found: Mapping[str, Array], about: Mapping[str, Any]) -> Trajectory:
    """A trajectory from its columns and what is said about them.

    Raises:
        ArgumentError: If the columns are not real numbers at increasing instants, a row for each.
    """
    groups, time = about["groups"], found["time"]
    for name, values in found.items():
        if values.dtype.kind not in "fiu":
            raise ArgumentError(f"{name} has values of type {values.dtype}, must be real numbers")
        if values.ndim != 1 or len(values) != len(time):
            raise ArgumentError(
                f"{name} has shape {values.shape}, must have a row for each of {len(time)} instants"
            )
    if not (len(time) and np.all(np.isfinite(time)) and np.all(np.diff(time) > 0)):
        raise ArgumentError("time must be finite and increasing")

    def rows(group: str) -> Array | None:
        names = groups[group]
        held = group not in _INSTANTS
        if not names:
            return None
        made = np.column_stack([found[name][: len(time) - held] for name in names])
        single = about["one_axis"].get("input" if group == "command" else group, False)
        return made[:, 0].copy() if single else made

    fields = [(name, np.float64, tuple(shape)) for name, shape in about["memory"].items()]
    memory = np.zeros(len(time) - 1, np.dtype(fields))
    for name, _, shape in fields:
        held = rows(f"memory {name}") if f"memory {name}" in groups else None
        memory[name] = 0.0 if held is None else held.reshape(-1, *shape)
    states = tuple(Signal(*each) for each in about["states"])
    inputs = tuple(Signal(*each) for each in about["inputs"])
    shipped = SYSTEMS.get(about["system"])
    if shipped is None or (shipped.states, shipped.inputs) != (states, inputs):
        shipped = System(
            about["system"], about["system"], states, inputs, NoEquations(about["system"]),
            controlled=tuple(about["controlled"]), bodies=tuple(about["bodies"]),
        )  # fmt: skip
    given: dict[str, Any] = {
        group: rows(group)
        for group in ("state", "command", "input", "sliding", "weighed", "wrench", "physics")
    }
    given["seen"] = rows("seen") if "seen" in groups else None
    # Files of earlier versions have none.
    given["unseen"] = tuple(HiddenState(*each) for each in about.get("unseen", ()))
    ended: Any = Status[about["status"]]
    until: Any = np.float64(about["valid_until"])
    return Trajectory(
        system=shipped, time=time, memory=memory, status=ended, valid_until=until, **given
    )


def why_ended(status: Status, system: System, controller: Controller, time: float, x: Array) -> str:
    """One line for a run that could not go on; empty for one that could.

    Args:
        status: How it ended.
        system: The plant's.
        controller: Whose law it was.
        time: Up to which the run is valid [s].
        x: State there, (n,).
    """
    where = f"{system.name} under {controller.name} at t = {time:g} s"
    if status is Status.COMPLETED:
        return ""
    if status is Status.DIVERGED:
        return f"{where}: the state grew without bound; try a smaller control period or timestep"
    if status is Status.SINGULAR_PLANT:
        return f"{where}: the plant is singular at {system.singularity}"
    at = ", ".join(f"{value:.4g}" for value in x)
    if status is Status.UNDEFINED_INPUT:
        return f"{where}: the law returned no finite number at x = ({at})"
    linearizing = controller.design is not None and controller.design.linearizing
    if not (linearizing and system.linearizable(x)):
        return f"{where}: the law is undefined outside {system.region}"
    return (
        f"{where}: the law is undefined at x = ({at}): the decoupling matrix E(x) of eq. (21) is "
        "singular there"
    )
