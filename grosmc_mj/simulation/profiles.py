"""Courses in time that Python and compiled code compute by the same formula."""

from __future__ import annotations

import math

from grosmc_mj.jitable import jitable

# Which formula: a number, so that it can lie beside the others in mjData.userdata.
CONSTANT, PULSE, SINE = 0.0, 1.0, 2.0

# An instant counts as reached when it is this close [s]: k times h is not exact in binary.
_INSTANT = 1e-9


@jitable
def pulse(t: float, start: float, stop: float) -> float:
    """1 for start <= t < stop [s], else 0."""
    return 1.0 if start - _INSTANT <= t < stop - _INSTANT else 0.0


@jitable
def sine_from(t: float, frequency: float, onset: float, phase: float) -> float:
    """sin(frequency t + phase) for t >= onset, else 0; in rad/s, s and rad."""
    if t < onset - _INSTANT:
        return 0.0
    return math.sin(frequency * t + phase)


@jitable
def course(kind: float, t: float, a: float, b: float, c: float) -> float:
    """The value at t [s] of the formula of this kind with its numbers, in their order above."""
    if kind == PULSE:
        return pulse(t, a, b)
    if kind == SINE:
        return sine_from(t, a, b, c)
    return 1.0
