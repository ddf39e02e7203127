"""An event of a run: a signal reaches a band around its target, and the swings before it.

The event is the instant at which the error enters the band and stays there up to the end of the
run. A swing is a reversal of the signal before that: it has left its start by more than the half
width of the band, and then turns back by more than that, so that noise makes no swings.
"""

from __future__ import annotations

import math
from typing import Any

from grosmc_mj.jitable import jitable


@jitable
def wrapped(angle: float, turn: float) -> float:
    """Return an angle between minus and plus half a turn, or itself if the turn is 0."""
    if turn == 0.0:
        return angle
    return angle - turn * math.floor(angle / turn + 0.5)


@jitable
def note_event(i: int, t: float, error: float, value: float, band: float, values: Any) -> None:
    """Accumulate an instant of an event.

    Args:
        i: Number of the event.
        t: Time of the instant [s]; 0 at the first.
        error: Error, which shall be in the band.
        value: Signal whose reversals are counted.
        band: Half width of the band.
        values: ``Accumulated`` of the run.
    """
    outside = abs(error) > band
    if outside:
        values.reached[i] = math.inf
    elif math.isinf(values.reached[i]):
        values.reached[i] = t

    _note_reversal(i, t, value, band, values)
    if outside:
        values.swings[i] = values.reversals[i]
        values.last_peak[i] = values.peak[i]


@jitable
def _note_reversal(i: int, t: float, value: float, band: float, values: Any) -> None:
    """Follow a signal to its extremes; one from which it turns back is a reversal."""
    moved = value - values.extreme[i]
    if t == 0.0:
        values.extreme[i] = value
        return

    direction = values.direction[i]
    turns = direction * moved < 0.0 and abs(moved) > band
    if turns:
        values.reversals[i] += 1.0
        values.peak[i] = abs(values.extreme[i])
        # It is known only when the signal has turned back, which may be within the band.
        if values.extreme_time[i] < values.reached[i]:
            values.swings[i] = values.reversals[i]
            values.last_peak[i] = values.peak[i]

    leaves_start = direction == 0.0 and abs(moved) > band
    if turns or leaves_start:
        values.direction[i] = math.copysign(1.0, moved)
    if turns or leaves_start or direction * moved > 0.0:
        values.extreme[i] = value
        values.extreme_time[i] = t
