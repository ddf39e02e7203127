"""An event of a run: a signal reaches a band around its target, and the swings before it.

The event is the instant at which the error enters the band and stays there up to the end of the
run. A swing is a reversal of the signal before that: it has left its start by more than the half
width of the band, and then turns back by more than that, so that noise makes no swings.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

from grosmc_mj.experiments.requirements.accumulator import wrapped
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.compiler import compile_python


class Event(NamedTuple):
    """An event of one run.

    Attributes:
        reached: Instant of the event [s]; infinite if it does not come.
        swings: Number of the signal's reversals before it.
        last_peak: Magnitude of the signal at the last of them; 0 without one.
    """

    reached: float
    swings: float
    last_peak: float


def find_event(time: Array, error: Array, turn: float, signal: Array, band: float) -> Event:
    """Return the event of a recorded run.

    Args:
        time: Instants from 0 on [s], (N,).
        error: Error, which shall be in the band, (N,).
        turn: A turn of an error that counts modulo one, else 0.
        signal: Signal whose reversals are counted, (N,).
        band: Half width of the band.
    """
    return Event(*_compiled()(time, error, turn, signal, band))


# Compiled once for all runs.
@cache
def _compiled() -> Any:
    """Return the compiled ``_follow``."""
    return compile_python(_follow)


def _follow(
    time: Array, error: Array, turn: float, signal: Array, band: float
) -> tuple[float, float, float]:
    """Follow a signal from one extreme to the next, up to the event."""
    reached = math.inf
    swings = 0.0
    last_peak = 0.0
    # The sign of the motion is 0 until the signal leaves its start.
    direction = 0.0
    extreme = signal[0]
    extreme_time = 0.0
    reversals = 0.0
    peak = 0.0
    for t, e, value in zip(time, error, signal):  # noqa: B905
        outside = abs(wrapped(e, turn)) > band
        if outside:
            reached = math.inf
        elif math.isinf(reached):
            reached = t

        moved = value - extreme
        turns = direction * moved < 0.0 and abs(moved) > band
        if turns:
            reversals += 1.0
            peak = abs(extreme)
        # It is known only when the signal has turned back, which may be within the band.
        if outside or (turns and extreme_time < reached):
            swings = reversals
            last_peak = peak

        leaves_start = direction == 0.0 and abs(moved) > band
        if turns or leaves_start:
            direction = math.copysign(1.0, moved)
        if turns or leaves_start or direction * moved > 0.0:
            extreme = value
            extreme_time = t
    return reached, swings, last_peak
