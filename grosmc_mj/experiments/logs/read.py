"""Reading of a log: its columns as the inputs and states of a system, in their units."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.logs.clean import (
    pieces_of,
    require_excited,
    turn_notes,
    unknown_notes,
    unwrapped,
    used_samples,
)
from grosmc_mj.experiments.logs.columns import LogColumn, called, column_of, some
from grosmc_mj.experiments.logs.files import columns_of
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.experiments.logs.table import ColumnTable, LogTable
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ImplausibleWarning
from grosmc_mj.ground.units import number_in
from grosmc_mj.theory.plants import Signal, System

# Headers of the time.
_TIME = ("time", "t")
# A sampling of so many seconds is more likely one of milliseconds.
_LONG_STEP = 0.5
# Unit of an actuator's commands.
_CONTROL = "control"
# An instant counts as reached when it is this close [s].
_INSTANT = 1e-9
_SECONDS = Signal("time", "t", "s")


def read_log(
    path: Path,
    system: System,
    table: LogTable | None,
    gears: Mapping[str, float] | None = None,
    *,
    to_learn: bool = True,
) -> Log:
    """Read a log, with its columns matched to the inputs and states of a system.

    A column is matched by its header, the name or the symbol of the signal with its unit in
    brackets, or by the case file's ``[log]``.

    Args:
        path: A file of the kind CSV, Parquet, MCAP or MATLAB.
        system: The inputs and states.
        table: ``[log]`` of the case file; None if it has none.
        gears: Of each input whose actuator has one, the input for a command of 1.
        to_learn: Whether its inputs must move enough to learn from them, and signals be known at
            all samples that are used; otherwise they are NaN where no message shows them.

    Raises:
        ArgumentError: If it cannot be read, or nothing can be learned from it.
    """
    try:
        columns = columns_of(path)
        table = table or LogTable()
        log, used = _log_of(path.name, columns, system, table, gears or {}, to_learn=to_learn)
        if to_learn:
            require_excited(system.inputs, log.inputs[used])
        return log
    except ArgumentError as error:
        raise ArgumentError(f"{path}: {error}") from None


def _log_of(
    name: str,
    columns: Mapping[str, LogColumn],
    system: System,
    table: LogTable,
    gears: Mapping[str, float],
    *,
    to_learn: bool,
) -> tuple[Log, NDArray[np.bool_]]:
    """The log that columns of numbers are, and which of its samples are used.

    Where messages do not show a signal, the log is left out to learn from it, or else has NaN.
    """
    signals = [signal.name for signal in (*system.inputs, *system.states)]
    for named in table.columns:
        require_known("signal", named, signals, "[log.columns]: ")
    inputs = _inputs(columns, system, table, gears)
    measured = _measured(columns, system, table)
    notes = _take_clock(name, inputs, measured)

    # Messages of several topics are brought to the instants of the first measured state.
    first = next(iter(measured.values()))
    time = first.stamps
    if time is None:
        time = _time(columns, table, len(first.values))
    _require_rising(first, time)
    for column in (*inputs.values(), *measured.values()):
        _require_in_order(column)
    _require_as_long([*inputs.values(), *measured.values()], time)

    used = used_samples(time - time[0], table)
    shown = {}
    held = []
    for signal, column in inputs.items():
        delay = _delay(table, signal)
        held.append(_held_later(column, time, delay))
        shown[signal] = column.is_shown(time + delay, held=True)
        used = used & _is_inside(time, delay)
    outputs = {}
    for state, column in measured.items():
        delay = _delay(table, state)
        values = column.between(time)
        outputs[state] = np.interp(time + delay, time, values) if delay else values
        shown[state] = column.is_shown(time + delay, held=False)
        used = used & _is_inside(time, delay)
    notes += turn_notes(time - time[0], outputs, system.states)

    u = np.column_stack(held)
    if to_learn:
        notes += unknown_notes(time - time[0], shown)
        used = used & np.all(list(shown.values()), axis=0)
    else:
        for j, signal in enumerate(inputs):
            u[~shown[signal], j] = np.nan
        for state, values in outputs.items():
            outputs[state] = np.where(shown[state], values, np.nan)
    pieces = pieces_of(time, used)
    return Log(name, time - time[0], u, outputs, pieces, notes), used


def _take_clock(
    name: str, inputs: dict[str, LogColumn], measured: dict[str, LogColumn]
) -> list[str]:
    """Bring messages to one clock, and say which: the machine's if all of them have its stamps."""
    columns = [*inputs.values(), *measured.values()]
    if columns[0].stamps is None:
        return []

    without = [column.header for column in columns if column.stamped is None]
    if not without:
        for signals in (inputs, measured):
            for signal, column in signals.items():
                signals[signal] = replace(column, stamps=column.stamped)
        return [f"{name}: the time is header.stamp of its messages"]
    reason = ""
    if len(without) < len(columns):
        reason = f", since {without[0]} has no header.stamp"
    return [f"{name}: the time is when its messages were recorded{reason}"]


def _inputs(
    columns: Mapping[str, LogColumn],
    system: System,
    table: LogTable,
    gears: Mapping[str, float],
) -> dict[str, LogColumn]:
    """The column of each input."""
    inputs = {}
    for signal in system.inputs:
        column = _signal(columns, signal, table, gears.get(signal.name))
        if column is None:
            raise ArgumentError(
                f"no column of the input {signal.name!r}, only {some(columns)}: name its column "
                "in the case file's [log]"
            )
        inputs[signal.name] = column
    return inputs


def _measured(
    columns: Mapping[str, LogColumn], system: System, table: LogTable
) -> dict[str, LogColumn]:
    """The column of each state that is measured."""
    measured = {}
    for state in system.states:
        column = _signal(columns, state, table, None)
        if column is not None:
            measured[state.name] = column
    if not measured:
        states = ", ".join(state.name for state in system.states)
        raise ArgumentError(
            f"no column of a state ({states}), only {some(columns)}: name one in the "
            "case file's [log]"
        )
    return measured


def _signal(
    columns: Mapping[str, LogColumn], signal: Signal, table: LogTable, gear: float | None
) -> LogColumn | None:
    """A signal in its own unit; None if the log does not have it."""
    named = table.columns.get(signal.name)
    if named is None:
        column = called(columns, (signal.name, signal.symbol))
    else:
        column = column_of(columns, named.column)
    if column is None:
        return None

    column.require_numbers()
    named = named or ColumnTable(column=column.header)
    factor = _factor(named.unit or column.unit, signal, column.header, gear)
    scale = named.sign * factor * named.scale
    values = scale * (column.values - named.offset)
    if named.periodic:
        values = unwrapped(signal, values)
    return replace(column, values=values)


def _factor(written: str, signal: Signal, header: str, gear: float | None) -> float:
    """Factor from a written unit to that of a signal; 1 where none is written."""
    if written == _CONTROL:
        if gear is None:
            raise ArgumentError(
                f"{header}: {signal.name} has no gear, which the unit {_CONTROL!r} is for: write "
                f"the unit of its numbers, such as {signal.unit!r}"
            )
        return gear
    if not written or written == signal.unit or signal.unit in ("", "1"):
        return 1.0
    try:
        return number_in(f"1 {written}", signal.unit)
    except ArgumentError as error:
        raise ArgumentError(f"{header}: {error}") from None


def _delay(table: LogTable, signal: str) -> float:
    """Delay with which a column shows its signal [s]."""
    if signal not in table.columns:
        return 0.0
    return table.columns[signal].delay


def _held_later(column: LogColumn, time: Array, delay: float) -> Array:
    """The last value before each instant of an input whose column is late by a delay [s]."""
    values = column.held(time)
    if not delay:
        return values
    last = np.searchsorted(time, time + delay + _INSTANT, side="right") - 1
    return values[last.clip(0)]


def _is_inside(time: Array, delay: float) -> NDArray[np.bool_]:
    """Which instants, (N,), a column that is late by a delay [s] has."""
    shown = time + delay
    return (shown > time[0] - _INSTANT) & (shown < time[-1] + _INSTANT)


def _time(columns: Mapping[str, LogColumn], table: LogTable, samples: int) -> Array:
    """The instants of the samples, from the first one on [s]."""
    column = column_of(columns, table.time) if table.time else called(columns, _TIME)
    if column is not None:
        column.require_numbers()
        if column.are_instants:
            return column.values
        unit = table.time_unit or column.unit
        time = column.from_first(_factor(unit, _SECONDS, column.header, None))
        if not unit:
            _doubt_seconds(column.header, time)
        return time

    if table.sampling is None:
        raise ArgumentError(
            f"no column of the time, only {some(columns)}: call one time [s], or give the "
            "case file a [log] with sampling"
        )
    return np.arange(samples) * table.sampling


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


def _require_rising(column: LogColumn, time: Array) -> None:
    """Refuse instants along a column that do not rise."""
    rises = np.diff(time) > 0
    if not np.all(rises):
        place = column.place(int(np.argmin(rises)) + 1)
        raise ArgumentError(f"the time does not rise in {place}: sort or cut the log there")


def _require_in_order(column: LogColumn) -> None:
    """Refuse messages whose stamps go back: what is held or between two of them is not clear."""
    if column.stamps is not None and np.any(np.diff(column.stamps) < 0):
        place = column.place(int(np.argmin(np.diff(column.stamps) >= 0)) + 1)
        raise ArgumentError(f"{column.header}: the time goes back in {place}: sort or cut the log")


def _require_as_long(columns: Sequence[LogColumn], time: Array) -> None:
    """Refuse columns of another length than the time; messages may have one."""
    for column in columns:
        if column.stamps is None and len(column.values) != len(time):
            raise ArgumentError(
                f"{column.header} has {len(column.values)} values, and the time {len(time)}"
            )
