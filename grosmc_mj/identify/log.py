"""Logs of a machine: time, inputs and measured states, from CSV or Parquet."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, one_line
from grosmc_mj.experiments.file.schema import ColumnTable, LogTable
from grosmc_mj.experiments.file.units import number_in
from grosmc_mj.plants import Signal, System

# A log of fewer samples tells nothing; a step of the time this many times the median is a gap.
_FEWEST, _GAP = 50, 3.0
# A header such as "rotor angle [deg]" or "u (V)".
_HEADER = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
_TIME = ("time", "t")
# Of an input: the largest share of samples at its largest or smallest value before it saturates.
_SATURATED = 0.5


@dataclass(frozen=True, eq=False)
class Log:
    """A log of a machine.

    Attributes:
        name: Of its file.
        time: Instants of the samples [s], rising from 0, (N,).
        inputs: Held from their instants on, in the plant's units, (N, m).
        outputs: The measured states by name, in the plant's units, (N,) each.
        pieces: The samples between two gaps.
    """

    name: str
    time: Array
    inputs: Array
    outputs: Mapping[str, Array]
    pieces: Sequence[slice]

    @property
    def period(self) -> float:
        """Median time between two samples [s]."""
        return float(np.median(np.diff(self.time)))

    def between(self, start: float, stop: float) -> Log:
        """The part of it from one share of its time to another, such as 0.7 to 1."""
        ends = start * self.time[-1], stop * self.time[-1]
        first, last = (int(np.searchsorted(self.time, end, side="right")) for end in ends)
        first = 0 if start == 0 else first
        pieces = [
            slice(max(piece.start, first), min(piece.stop, last))
            for piece in self.pieces
            if min(piece.stop, last) - max(piece.start, first) > 2
        ]
        return replace(self, pieces=pieces)


def read_log(path: Path, system: System, table: LogTable | None) -> Log:
    """A log, with its columns matched to the inputs and states of a system.

    A column is matched by its header, the name or the symbol of the signal with its unit in
    brackets, or by the case file's ``[log]``.

    Raises:
        ArgumentError: If it cannot be read, or nothing can be learned from it.
    """
    table, columns = table or LogTable(), _columns(path)
    time = _time(path, columns, table)
    try:
        inputs = [_signal(columns, signal, table) for signal in system.inputs]
        outputs = {state.name: _signal(columns, state, table) for state in system.states}
    except ArgumentError as error:
        raise ArgumentError(f"{path}: {error}") from None
    if missing := [s.name for s, u in zip(system.inputs, inputs, strict=True) if u is None]:
        raise ArgumentError(
            f"{path} has no column of the input {missing[0]!r}, only "
            f"{', '.join(columns)}: name its column in the case file's [log]"
        )
    measured = {name: y for name, y in outputs.items() if y is not None}
    if not measured:
        names = ", ".join(state.name for state in system.states)
        raise ArgumentError(
            f"{path} has no column of a state ({names}), only {', '.join(columns)}: name one in "
            "the case file's [log]"
        )
    u = np.column_stack([u for u in inputs if u is not None])
    _require_excited(path, system.inputs, u)
    step = np.diff(time)
    ends = np.flatnonzero(step > _GAP * np.median(step)) + 1
    borders = [0, *ends.tolist(), len(time)]
    pieces = [slice(a, b) for a, b in itertools.pairwise(borders) if b - a > 2]
    return Log(path.name, time - time[0], u, measured, pieces)


def _columns(path: Path) -> dict[str, Array]:
    """The columns of numbers of a file."""
    if not path.is_file():
        raise ArgumentError(f"{path} is no file: name a CSV or Parquet file")
    try:
        if path.suffix.lower() == ".parquet":
            read = pq.read_table(path)
        else:
            read = pyarrow.csv.read_csv(path)
        columns = {
            name: np.asarray(read[name].to_numpy(zero_copy_only=False), float)
            for name in read.column_names
            if pa.types.is_integer(kind := read[name].type) or pa.types.is_floating(kind)
        }
    except (OSError, ValueError, pa.ArrowException) as error:
        raise ArgumentError(f"{path}: cannot be read: {one_line(str(error))[:160]}") from None
    rows = max(map(len, columns.values()), default=0)
    if rows < _FEWEST:
        raise ArgumentError(
            f"{path} has {rows} rows of numbers: a log has {_FEWEST} at least, better some seconds"
        )
    return columns


def _time(path: Path, columns: Mapping[str, Array], table: LogTable) -> Array:
    """The instants of the samples [s]."""
    rows = len(next(iter(columns.values())))
    names = [table.time] if table.time else _TIME
    for header, values in columns.items():
        name, unit = _parts(header)
        if header in names or name.lower() in names:
            time = values * _factor(unit, "s", "")
            if not np.all(np.diff(time) > 0):
                row = int(np.argmin(np.diff(time) > 0)) + 2
                raise ArgumentError(
                    f"{path}: the time does not rise at row {row}: sort or cut the log there"
                )
            return time
    if table.sampling is None:
        raise ArgumentError(
            f"{path} has no column of the time, only {', '.join(columns)}: call one time [s], or "
            "give the case file a [log] with sampling"
        )
    return np.arange(rows) * table.sampling


def _signal(columns: Mapping[str, Array], signal: Signal, table: LogTable) -> Array | None:
    """A signal in its own unit; None if the log does not have it."""
    named = table.columns.get(signal.name)
    for header, values in columns.items():
        name, unit = _parts(header)
        plain = name.replace("_", " ").lower()
        if named is not None and header != named.column:
            continue
        if named is None and plain not in (signal.name.lower(), signal.symbol.lower()):
            continue
        if not np.all(np.isfinite(values)):
            row = int(np.argmin(np.isfinite(values))) + 2
            raise ArgumentError(f"{header} is no number in row {row}: fill or cut it")
        named = named or ColumnTable(column=header)
        factor = _factor(named.unit or unit, signal.unit, header)
        return named.sign * factor * named.scale * (values - named.offset)
    if named is not None:
        raise ArgumentError(f"[log] names the column {named.column!r}: there is none")
    return None


def _parts(header: str) -> tuple[str, str]:
    match = _HEADER.fullmatch(header)
    return (match["name"], match["unit"] or "") if match else (header, "")


def _factor(written: str, unit: str, header: str) -> float:
    """From a written unit to that of a signal; 1 where none is written."""
    if not written or written == unit or unit in ("", "1"):
        return 1.0
    try:
        return number_in(f"1 {written}", unit)
    except ArgumentError as error:
        raise ArgumentError(f"{header}: {error}") from None


def _require_excited(path: Path, inputs: Sequence[Signal], u: Array) -> None:
    """Refuse inputs that never change, or are at their end most of the time."""
    if not np.any(np.ptp(u, axis=0) > 0):
        raise ArgumentError(
            f"{path}: the input is {u[0, 0]:g} {inputs[0].unit} all the time, so that nothing can "
            "be learned: log a run with steps or a sweep"
        )
    for signal, values in zip(inputs, u.T, strict=True):
        end = max((values.min(), values.max()), key=lambda end: np.mean(values == end))
        share = float(np.mean(values == end))
        if share > _SATURATED and len(np.unique(values)) > len(values) // 10:
            raise ArgumentError(
                f"{path}: {signal.name} is at its end of {end:g} {signal.unit} for "
                f"{100 * share:.0f} % of the log: it saturates; log a run with smaller inputs"
            )


def held(time: Array, values: Array, delay: float, grid: Array) -> Array:
    """The mean over each interval of a grid of inputs that are held, later by a delay.

    Args:
        time: Instants from which they are held [s], (N,).
        values: (N, m).
        delay: [s]; the result depends on it without jumps.
        grid: Ends of the intervals [s], (K + 1,).

    Returns:
        (K, m).
    """
    widths = np.diff(time, append=time[-1] + (time[-1] - time[-2]))
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values * widths[:, None], axis=0)])
    ends = np.append(time, time[-1] + widths[-1])
    integral = np.column_stack(
        [np.interp(grid - delay, ends, column, left=math.nan) for column in sums.T]
    )
    before = np.isnan(integral[:, :1])
    integral = np.where(before, values[0] * (grid - delay - time[0])[:, None], integral)
    return np.diff(integral, axis=0) / np.diff(grid)[:, None]


def noise_of(values: Array) -> float:
    """Standard deviation of white noise on a smooth signal, from its third differences."""
    return float(np.std(np.diff(values, 3)) / math.sqrt(20.0))


def resolution_of(values: Array) -> float:
    """The step of an encoder; 0 for none."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if 0 < len(steps) < len(values) // 3 else 0.0
