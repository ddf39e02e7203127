"""Logs of a machine: time, inputs and measured states, from CSV, Parquet or MCAP."""

from __future__ import annotations

import itertools
import json
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import (
    ArgumentError,
    GrosmcError,
    ImplausibleWarning,
    SetupError,
    one_line,
    value_text,
)
from grosmc_mj.experiments.file.schema import ColumnTable, LogTable
from grosmc_mj.experiments.file.units import number_in
from grosmc_mj.files import LARGEST_TABLE, require_regular
from grosmc_mj.identify.tables import csv_table, line_of, numbers_of
from grosmc_mj.plants import Signal, System

# A log of fewer samples tells nothing.
_FEWEST = 50
# A step of the time this many times the median is a gap.
_GAP = 3.0
# Fewer samples between two gaps have no curvature, and are left out.
SHORTEST_PIECE = 3
# A header such as "rotor angle [deg]" or "u (V)".
_HEADER = re.compile(r"\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
# Headers of the time.
_TIME = ("time", "t")
# Headers that a message lists, and letters of an error of a library that it quotes.
_LISTED = 12
_QUOTED = 160
# Of an input: the largest share of samples at its largest or smallest value before it saturates.
_SATURATED = 0.5
# Larger numbers come from damage; a time of nanoseconds since 1970 is smaller.
_LARGEST = 1e20
# A sampling of so many seconds is more likely one of milliseconds.
_LONG_STEP = 0.5


@dataclass(frozen=True, eq=False)
class _Column:
    """Numbers of a log.

    Attributes:
        header: Its header, or the path of a number in messages.
        values: NaN where the file has no number, (N,).
        stamps: Instants of messages [s], (N,); None for a column of a table.
        texts: The values as they stand in a CSV file; None for other files.
        file: The CSV file; None for other files.
    """

    header: str
    values: Array
    stamps: Array | None = None
    texts: pa.ChunkedArray | None = None
    file: Path | None = None

    def held(self, time: Array) -> Array:
        """The last value before each instant."""
        if self.stamps is None:
            return self.values
        last = np.searchsorted(self.stamps, time, side="right") - 1
        return self.values[last.clip(0)]

    def between(self, time: Array) -> Array:
        """The values at some instants, by straight lines."""
        if self.stamps is None:
            return self.values
        return np.interp(time, self.stamps, self.values)

    def name_and_unit(self) -> tuple[str, str]:
        """Name and unit in its header; a path of a message has no unit."""
        match = _HEADER.fullmatch(self.header)
        if self.stamps is not None or match is None:
            return self.header, ""
        return match["name"], match["unit"] or ""

    def place(self, index: int) -> str:
        """Words for where a value stands, such as ``line 102``."""
        if self.file is not None:
            return f"line {line_of(self.file, index)}"
        if self.stamps is not None:
            return f"message {index + 1}"
        return f"row {index + 1}"

    def require_numbers(self) -> None:
        """Refuse a value that is no number, or one that no machine has."""
        # False for NaN too.
        is_number = np.abs(self.values) <= _LARGEST
        if np.all(is_number):
            return

        index = int(np.argmin(is_number))
        value = value_text(self.values[index])
        if self.texts is not None:
            value = value_text(self.texts[index].as_py())
        raise ArgumentError(
            f"{self.header} is no number in {self.place(index)}, {value}: fill or cut it"
        )


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
        # An encoder repeats its values; of other sensors nearly every value is new.
        if 0 < len(steps) < len(values) // 3:
            return float(steps.min())
        return 0.0

    def deviation(self, state: str) -> float:
        """Standard deviation of a sensor's noise, at least that of its rounding."""
        rounding = float(self.resolution(state) / np.sqrt(12.0))
        span = float(np.ptp(self.outputs[state]))
        return max(self.noise(state), rounding, 1e-9 * span, 1e-12)

    def between(self, start: float, stop: float) -> Log:
        """The part of it from one share of its time to another, such as 0.7 to 1."""
        first = 0
        if start != 0:
            first = int(np.searchsorted(self.time, start * self.time[-1], side="right"))
        last = int(np.searchsorted(self.time, stop * self.time[-1], side="right"))

        parts = [slice(max(p.start, first), min(p.stop, last)) for p in self.pieces]
        pieces = [part for part in parts if part.stop - part.start >= SHORTEST_PIECE]
        return replace(self, pieces=pieces)


def read_log(path: Path, system: System, table: LogTable | None) -> Log:
    """Read a log, with its columns matched to the inputs and states of a system.

    A column is matched by its header, the name or the symbol of the signal with its unit in
    brackets, or by the case file's ``[log]``.

    Args:
        path: A file of the kind CSV, Parquet or MCAP.
        system: The inputs and states.
        table: ``[log]`` of the case file; None if it has none.

    Raises:
        ArgumentError: If it cannot be read, or nothing can be learned from it.
    """
    try:
        return _log_of(path.name, _columns(path), system, table or LogTable())
    except ArgumentError as error:
        raise ArgumentError(f"{path}: {error}") from None


def _log_of(
    name: str,
    columns: Mapping[str, _Column],
    system: System,
    table: LogTable,
) -> Log:
    """The log that columns of numbers are."""
    signals = [signal.name for signal in (*system.inputs, *system.states)]
    for named in table.columns:
        require_known("signal", named, signals, "[log.columns]: ")
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

    # Messages of several topics are brought to the instants of the first measured state.
    first = next(iter(measured.values()))
    time = first.stamps
    if time is None:
        time = _time(columns, table)
    _require_rising(first, time)
    u = np.column_stack([column.held(time) for column in inputs if column is not None])
    _require_excited(system.inputs, u)
    outputs = {state: column.between(time) for state, column in measured.items()}
    return Log(name, time - time[0], u, outputs, _pieces(time))


def _pieces(time: Array) -> list[slice]:
    """The samples between two gaps, without what is too short."""
    steps = np.diff(time)
    gaps = np.flatnonzero(steps > _GAP * np.median(steps)) + 1
    borders = [0, *gaps.tolist(), len(time)]
    return [slice(a, b) for a, b in itertools.pairwise(borders) if b - a >= SHORTEST_PIECE]


def join_logs(logs: Sequence[Log]) -> Log:
    """Several logs of one machine as one: a window never reaches from one into the next.

    Raises:
        ArgumentError: If they do not measure the same states.
    """
    log = logs[0]
    for following in logs[1:]:
        if log.outputs.keys() != following.outputs.keys():
            raise ArgumentError(
                f"{log.name} measures {', '.join(log.outputs)}, {following.name} "
                f"{', '.join(following.outputs)}: several logs must measure the same states"
            )
        log = _followed(log, following)
    return log


def _followed(log: Log, following: Log) -> Log:
    """Two logs as one, a gap between them.

    A sample in the gap, of no piece, holds the first input of the second log: before that log
    began its input was there.
    """
    gap = log.time[-1] + _GAP * log.period
    shift = gap + _GAP * following.period
    outputs = {}
    for name, values in following.outputs.items():
        outputs[name] = np.concatenate([log.outputs[name], values[:1], values])

    begin = len(log.time) + 1
    pieces = [slice(begin + piece.start, begin + piece.stop) for piece in following.pieces]
    return Log(
        name=f"{log.name} and {following.name}",
        time=np.concatenate([log.time, [gap], following.time + shift]),
        inputs=np.vstack([log.inputs, following.inputs[:1], following.inputs]),
        outputs=outputs,
        pieces=[*log.pieces, *pieces],
    )


def _columns(path: Path) -> dict[str, _Column]:
    """The columns of numbers of a file."""
    allowed = "name a file that ends in .csv, .parquet or .mcap"
    if not path.is_file():
        raise ArgumentError(f"there is no such file: {allowed}")
    require_regular(path, LARGEST_TABLE)
    kind = path.suffix.lower()
    if kind not in (".csv", ".parquet", ".mcap"):
        raise ArgumentError(f"is no log: {allowed}")

    try:
        if kind == ".mcap":
            columns = _messages(path)
        elif kind == ".parquet":
            columns = _number_columns(pq.ParquetFile(path).read())
        else:
            columns = _number_columns(csv_table(path), path)
    except GrosmcError:
        raise
    # Damaged files make the readers of each kind fail in ways of their own.
    except Exception as error:
        reason = one_line(str(error))[:_QUOTED] or type(error).__name__
        raise ArgumentError(f"cannot be read: {reason}") from None

    rows = max((len(column.values) for column in columns.values()), default=0)
    if rows < _FEWEST:
        raise ArgumentError(
            f"has {rows} rows of numbers; {_FEWEST} or more are needed: log some seconds"
        )
    return columns


def _number_columns(table: pa.Table, file: Path | None = None) -> dict[str, _Column]:
    """The columns of a table that have numbers; the file is that of a CSV table."""
    columns: dict[str, _Column] = {}
    for header, column in zip(table.column_names, table.columns, strict=True):
        name = header.strip()
        values = numbers_of(column)
        if values is None or not name:
            continue
        if name in columns:
            raise ArgumentError(f"two columns are called {name!r}: rename or remove one")
        texts = column if file is not None else None
        columns[name] = _Column(name, values, texts=texts, file=file)
    return columns


def _messages(path: Path) -> dict[str, _Column]:
    """The numbers of an MCAP file's messages, JSON or ROS 2, such as ``/joint_states.position[0]``.

    Their instants are those at which they were logged.
    """
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise SetupError("MCAP needs a library: pip install 'grosmc_mj[identify]'") from None
    rows: dict[str, list[tuple[int, float]]] = {}
    ros = DecoderFactory()
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            decode = ros.decoder_for(channel.message_encoding, schema)
            if channel.message_encoding == "json":
                content: Any = json.loads(message.data)
            elif decode is not None:
                content = decode(message.data)
            else:
                continue
            for name, value in _numbers(channel.topic, content):
                rows.setdefault(name, []).append((message.log_time, value))

    # Nanoseconds since 1970 do not fit into a float.
    begin = min((pairs[0][0] for pairs in rows.values()), default=0)
    columns = {}
    for name, pairs in rows.items():
        values = [value for _, value in pairs]
        stamps = [1e-9 * (stamp - begin) for stamp, _ in pairs]
        columns[name] = _Column(name, np.array(values), np.array(stamps))
    return columns


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
    listed = ", ".join(list(columns)[:_LISTED])
    if len(columns) > _LISTED:
        return f"{listed}, ..."
    return listed


def _time(columns: Mapping[str, _Column], table: LogTable) -> Array:
    """The instants of the samples [s]."""
    column = _named(columns, table.time) if table.time else _called(columns, _TIME)
    if column is not None:
        column.require_numbers()
        _, unit = column.name_and_unit()
        unit = table.time_unit or unit
        time = column.values * _factor(unit, "s", column.header)
        if not unit:
            _doubt_seconds(column.header, time)
        return time

    if table.sampling is None:
        raise ArgumentError(
            f"no column of the time, only {_some(columns)}: call one time [s], or give the "
            "case file a [log] with sampling"
        )
    rows = len(next(iter(columns.values())).values)
    return np.arange(rows) * table.sampling


def _doubt_seconds(header: str, time: Array) -> None:
    """Warn of instants without a unit whose steps are long for seconds."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if step >= _LONG_STEP:
        warnings.warn(
            f"{header}: it has no unit, and its steps are {step:.3g}: they are taken for seconds; "
            f'write "{header} [ms]" for milliseconds, or time_unit into [log]',
            ImplausibleWarning,
            stacklevel=2,
        )


def _require_rising(column: _Column, time: Array) -> None:
    """Refuse instants along a column that do not rise."""
    rises = np.diff(time) > 0
    if not np.all(rises):
        place = column.place(int(np.argmin(rises)) + 1)
        raise ArgumentError(f"the time does not rise in {place}: sort or cut the log there")


def _signal(columns: Mapping[str, _Column], signal: Signal, table: LogTable) -> _Column | None:
    """A signal in its own unit; None if the log does not have it."""
    named = table.columns.get(signal.name)
    if named is None:
        column = _called(columns, (signal.name, signal.symbol))
    else:
        column = _named(columns, named.column)
    if column is None:
        return None

    column.require_numbers()
    _, unit = column.name_and_unit()
    named = named or ColumnTable(column=column.header)
    scale = named.sign * _factor(named.unit or unit, signal.unit, column.header) * named.scale
    return replace(column, values=scale * (column.values - named.offset))


def _named(columns: Mapping[str, _Column], header: str) -> _Column:
    """The column that the case file names."""
    require_known("column", header, columns, "[log]: ")
    return columns[header]


def _called(columns: Mapping[str, _Column], names: Sequence[str]) -> _Column | None:
    """The column that is called by the first of some names, or else by the next one."""
    for name in names:
        found: list[_Column] = []
        for column in columns.values():
            called, _ = column.name_and_unit()
            if called.replace("_", " ").lower() == name.lower():
                found.append(column)
        if len(found) > 1:
            headers = " and ".join(column.header for column in found)
            raise ArgumentError(f"{headers} are both {name}: rename or remove one")
        if found:
            return found[0]
    return None


def _factor(written: str, unit: str, header: str) -> float:
    """Factor from a written unit to that of a signal; 1 where none is written."""
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
        # The end at which the input is more often, the lower one if both are as often.
        end = values.min()
        share = float(np.mean(values == end))
        share_at_largest = float(np.mean(values == values.max()))
        if share_at_largest > share:
            end = values.max()
            share = share_at_largest
        if share > _SATURATED and len(np.unique(values)) > len(values) // 10:
            raise ArgumentError(
                f"{signal.name} is at its end of {end:g} {signal.unit} for "
                f"{100 * share:.0f} % of the log: it saturates; log a run with smaller inputs"
            )


def held(
    time: Array,
    values: Array,
    delay: float,
    grid: Array,
) -> Array:
    """The mean over each interval of a grid of inputs that are held, later by a delay.

    Args:
        time: Instants from which they are held [s], (N,).
        values: (N, m).
        delay: [s]; the result depends on it without jumps.
        grid: Ends of the intervals [s], (K + 1,).

    Returns:
        (K, m).
    """
    # Integrals from the first instant to the ends of the held values.
    widths = np.diff(time, append=time[-1] + (time[-1] - time[-2]))
    ends = np.append(time, time[-1] + widths[-1])
    areas = np.cumsum(values * widths[:, None], axis=0)
    sums = np.vstack([np.zeros(values.shape[1]), areas])

    late = grid - delay
    integral = np.column_stack([np.interp(late, ends, column, left=math.nan) for column in sums.T])

    # Before the first instant the first value is held.
    before = np.isnan(integral[:, :1])
    first_held = values[0] * (late - time[0])[:, None]
    integral = np.where(before, first_held, integral)
    return np.diff(integral, axis=0) / np.diff(grid)[:, None]
