"""Logs of a machine: time, inputs and measured states, from CSV, Parquet or MCAP."""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError, one_line
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


class _Column(NamedTuple):
    """Numbers of a log, with their own instants [s] where these are not the table's."""

    values: Array
    stamps: Array | None = None

    def held(self, time: Array) -> Array:
        """The last value before each instant."""
        if self.stamps is None:
            return self.values
        return self.values[(np.searchsorted(self.stamps, time, side="right") - 1).clip(0)]

    def between(self, time: Array) -> Array:
        """The values at some instants, by straight lines."""
        return self.values if self.stamps is None else np.interp(time, self.stamps, self.values)


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

    def noise(self, state: str) -> float:
        """Standard deviation of white noise on a smooth state, from its third differences."""
        pieces = [np.diff(self.outputs[state][piece], 3) for piece in self.pieces]
        return float(np.std(np.concatenate(pieces)) / math.sqrt(20.0))

    def resolution(self, state: str) -> float:
        """The step of its encoder; 0 for none."""
        values = self.outputs[state]
        steps = np.diff(np.unique(values))
        return float(steps.min()) if 0 < len(steps) < len(values) // 3 else 0.0

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
    try:
        return _log_of(path.name, _columns(path), system, table or LogTable())
    except ArgumentError as error:
        raise ArgumentError(f"{path}: {error}") from None


def _log_of(name: str, columns: Mapping[str, _Column], system: System, table: LogTable) -> Log:
    """The log that columns of numbers are."""
    inputs = [_signal(columns, signal, table) for signal in system.inputs]
    states = {state.name: _signal(columns, state, table) for state in system.states}
    for signal, column in zip(system.inputs, inputs, strict=True):
        if column is None:
            raise ArgumentError(
                f"no column of the input {signal.name!r}, only {_some(columns)}: name its column "
                "in the case file's [log]"
            )
    measured = {state: column for state, column in states.items() if column is not None}
    if not measured:
        raise ArgumentError(
            f"no column of a state ({', '.join(states)}), only {_some(columns)}: name one in the "
            "case file's [log]"
        )
    time = next(iter(measured.values())).stamps
    time = _time(columns, table) if time is None else time
    u = np.column_stack([column.held(time) for column in inputs if column is not None])
    _require_excited(system.inputs, u)
    outputs = {state: column.between(time) for state, column in measured.items()}
    step = np.diff(time)
    ends = np.flatnonzero(step > _GAP * np.median(step)) + 1
    borders = [0, *ends.tolist(), len(time)]
    pieces = [slice(a, b) for a, b in itertools.pairwise(borders) if b - a > 2]
    return Log(name, time - time[0], u, outputs, pieces)


def joined(logs: Sequence[Log]) -> Log:
    """Several logs of one machine as one: a window never reaches from one into the next.

    Raises:
        ArgumentError: If they do not measure the same states.
    """
    log = logs[0]
    for other in logs[1:]:
        if log.outputs.keys() != other.outputs.keys():
            raise ArgumentError(
                f"{log.name} measures {', '.join(log.outputs)}, {other.name} "
                f"{', '.join(other.outputs)}: several logs must measure the same states"
            )
        # A sample between them, of no piece: before the next log its first input was there.
        begin, end = len(log.time) + 1, log.time[-1] + _GAP * log.period
        shift = end + _GAP * other.period
        log = Log(
            name=f"{log.name} and {other.name}",
            time=np.concatenate([log.time, [end], other.time + shift]),
            inputs=np.vstack([log.inputs, other.inputs[:1], other.inputs]),
            outputs={
                name: np.concatenate([log.outputs[name], values[:1], values])
                for name, values in other.outputs.items()
            },
            pieces=[*log.pieces, *(slice(begin + p.start, begin + p.stop) for p in other.pieces)],
        )
    return log


def _columns(path: Path) -> dict[str, _Column]:
    """The columns of numbers of a file."""
    kind = path.suffix.lower()
    if not path.is_file() or kind not in (".csv", ".parquet", ".mcap"):
        why = "is no log" if path.is_file() else "there is no such file"
        raise ArgumentError(f"{why}: name a file that ends in .csv, .parquet or .mcap")
    try:
        if kind == ".mcap":
            columns = _messages(path)
        else:
            read = pq.read_table(path) if kind == ".parquet" else pyarrow.csv.read_csv(path)
            columns = {
                name: _Column(np.asarray(read[name].to_numpy(zero_copy_only=False), float))
                for name in read.column_names
                if pa.types.is_integer(t := read[name].type) or pa.types.is_floating(t)
            }
    except (OSError, ValueError, pa.ArrowException) as error:
        raise ArgumentError(f"cannot be read: {one_line(str(error))[:160]}") from None
    rows = max((len(column.values) for column in columns.values()), default=0)
    if rows < _FEWEST:
        raise ArgumentError(
            f"has {rows} rows of numbers; {_FEWEST} or more are needed: log some seconds"
        )
    return columns


def _messages(path: Path) -> dict[str, _Column]:
    """The numbers of an MCAP file's messages, JSON or ROS 2, such as ``/joint_states.position[0]``.

    Their instants are those at which they were logged.
    """
    try:
        from mcap.exceptions import McapError
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise SetupError("MCAP needs a library: pip install 'grosmc_mj[identify]'") from None
    rows: dict[str, list[tuple[int, float]]] = {}
    ros = DecoderFactory()
    with path.open("rb") as file:
        try:
            for schema, channel, message in make_reader(file).iter_messages():
                if channel.message_encoding == "json":
                    content: Any = json.loads(message.data)
                elif decode := ros.decoder_for(channel.message_encoding, schema):
                    content = decode(message.data)
                else:
                    continue
                for name, value in _numbers(channel.topic, content):
                    rows.setdefault(name, []).append((message.log_time, value))
        except McapError as error:
            raise ValueError(str(error)) from None
    # Nanoseconds since 1970 do not fit into a float.
    begin = min((pairs[0][0] for pairs in rows.values()), default=0)
    return {
        name: _Column(
            np.array([value for _, value in pairs]),
            np.array([1e-9 * (stamp - begin) for stamp, _ in pairs]),
        )
        for name, pairs in rows.items()
    }


def _numbers(name: str, content: Any) -> Iterator[tuple[str, float]]:
    """The numbers of a message, with the paths to them."""
    if isinstance(content, bool | int | float):
        yield name, float(content)
    elif isinstance(content, Mapping):
        for key, part in content.items():
            yield from _numbers(f"{name}.{key}", part)
    elif isinstance(content, Sequence) and not isinstance(content, str | bytes):
        for index, part in enumerate(content):
            yield from _numbers(f"{name}[{index}]", part)
    else:
        for key in getattr(content, "__slots__", ()):
            yield from _numbers(f"{name}.{key}", getattr(content, key))


def _some(columns: Mapping[str, _Column]) -> str:
    """The headers, the first ones of many."""
    names = list(columns)
    return ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")


def _time(columns: Mapping[str, _Column], table: LogTable) -> Array:
    """The instants of the samples [s]."""
    names = [table.time] if table.time else _TIME
    for header, column in columns.items():
        name, unit = _parts(header)
        if header in names or name.lower() in names:
            time = column.values * _factor(unit, "s", "")
            if not np.all(np.diff(time) > 0):
                row = int(np.argmin(np.diff(time) > 0)) + 2
                raise ArgumentError(
                    f"the time does not rise at row {row}: sort or cut the log there"
                )
            return time
    if table.sampling is None:
        raise ArgumentError(
            f"no column of the time, only {_some(columns)}: call one time [s], or give the "
            "case file a [log] with sampling"
        )
    rows = len(next(iter(columns.values())).values)
    return np.arange(rows) * table.sampling


def _signal(columns: Mapping[str, _Column], signal: Signal, table: LogTable) -> _Column | None:
    """A signal in its own unit; None if the log does not have it."""
    named = table.columns.get(signal.name)
    for header, (values, stamps) in columns.items():
        name, unit = _parts(header) if stamps is None else (header, "")
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
        scale = named.sign * factor * named.scale
        return _Column(scale * (values - named.offset), stamps)
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


def _require_excited(inputs: Sequence[Signal], u: Array) -> None:
    """Refuse inputs that never change, or are at their end most of the time."""
    if not np.any(np.ptp(u, axis=0) > 0):
        raise ArgumentError(
            f"the input is {u[0, 0]:g} {inputs[0].unit} all the time, so that nothing can "
            "be learned: log a run with steps or a sweep"
        )
    for signal, values in zip(inputs, u.T, strict=True):
        end = max((values.min(), values.max()), key=lambda end: np.mean(values == end))
        share = float(np.mean(values == end))
        if share > _SATURATED and len(np.unique(values)) > len(values) // 10:
            raise ArgumentError(
                f"{signal.name} is at its end of {end:g} {signal.unit} for "
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
