"""Cleaning of logs: what is used of them, turns of angles, late columns, and hints."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.logs.log import GAP, SHORTEST_PIECE
from grosmc_mj.experiments.logs.table import LogTable, Window
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.theory.plants import Signal

# Of an input: the largest share of samples at its largest or smallest value before it saturates.
_SATURATED = 0.5
_TURN = 2 * math.pi
# Steps that differ from a turn by less than this share of it are jumps, of an angle whose other
# steps are smaller than that.
_NEAR_A_TURN = 0.2


def pieces_of(time: Array, used: NDArray[np.bool_]) -> list[slice]:
    """The samples that are used, from gap to gap, without what is too short.

    Args:
        time: Instants of the samples [s], (N,).
        used: Which of them are used, (N,).

    Raises:
        ArgumentError: If nothing is left.
    """
    steps = np.diff(time)
    ends = (steps > GAP * np.median(steps)) | (used[1:] != used[:-1])
    borders = [0, *(np.flatnonzero(ends) + 1).tolist(), len(time)]
    pieces = [slice(a, b) for a, b in itertools.pairwise(borders) if used[a]]
    pieces = [piece for piece in pieces if piece.stop - piece.start >= SHORTEST_PIECE]
    if not pieces:
        raise ArgumentError(
            f"gaps, and use, mask and delays of [log], leave no {SHORTEST_PIECE} samples in a row"
        )
    return pieces


def used_samples(time: Array, table: LogTable) -> NDArray[np.bool_]:
    """Which samples the case file uses, (N,).

    Args:
        time: Instants from the first sample on [s], (N,).
        table: The file's ``[log]``.

    Raises:
        ArgumentError: If a window holds no sample.
    """
    used = np.ones(len(time), bool)
    if table.use is not None:
        used = _within(time, table.use, "use")
    for window in table.mask:
        used = used & ~_within(time, window, "mask")
    return used


def _within(time: Array, window: Window, key: str) -> NDArray[np.bool_]:
    """Which samples lie in a window, (N,)."""
    first, last = window
    within = (time >= first) & (time <= last)
    if not np.any(within):
        raise ArgumentError(
            f"[log] {key}: {first:g} to {last:g} s holds no sample: the log is from 0 to "
            f"{time[-1]:g} s, counted from its first sample on"
        )
    return within


def unwrapped(signal: Signal, values: Array) -> Array:
    """An angle without jumps of a turn, (N,).

    Raises:
        ArgumentError: If the signal is no angle.
    """
    if signal.unit != "rad":
        raise ArgumentError(
            f"[log.columns] {signal.name}: periodic is for angles, not for {signal.unit or 1}"
        )
    return np.unwrap(values, period=_TURN)


def turn_notes(time: Array, outputs: Mapping[str, Array], states: Sequence[Signal]) -> list[str]:
    """A line for each angle that jumps by a turn.

    Args:
        time: Instants of the samples [s], (N,).
        outputs: The measured states by name, (N,) each.
        states: All states, with their units.
    """
    notes = []
    for state in states:
        if state.unit != "rad" or state.name not in outputs:
            continue
        steps = np.abs(np.diff(outputs[state.name]))
        jumps = np.flatnonzero(np.abs(steps - _TURN) < _NEAR_A_TURN * _TURN)
        if len(jumps) and np.median(steps) < _NEAR_A_TURN * _TURN:
            key = state.name if state.name.isidentifier() else f'"{state.name}"'
            notes.append(
                f"{state.name} jumps by a turn, {len(jumps)} times, first at "
                f"{time[jumps[0] + 1]:.4g} s: write periodic = true into [log.columns.{key}]"
            )
    return notes


def unknown_notes(time: Array, shown: Mapping[str, NDArray[np.bool_]]) -> list[str]:
    """A line for each signal that some samples do not show.

    Args:
        time: Instants of the samples [s], (N,).
        shown: By signal, whether a sample shows it, (N,).
    """
    notes = []
    for name, is_shown in shown.items():
        unknown = time[~is_shown]
        if len(unknown):
            notes.append(
                f"no message shows {name} at {len(unknown)} of {len(time)} samples, first at "
                f"{unknown[0]:.4g} s: they are left out"
            )
    return notes


def require_excited(inputs: Sequence[Signal], u: Array) -> None:
    """Refuse inputs, (N, m), that never change, or are at their end most of the time.

    Raises:
        ArgumentError: If one does.
    """
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
                f"{signal.name} is at its end of {end:g}{unit_after(signal.unit)} for "
                f"{100 * share:.0f} % of the log: it saturates; log a run with smaller inputs"
            )
