"""What sensors make of the state."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.jitable import jitable
from grosmc_mj.loop.counter import normal

# Whole multiples beyond this are no longer told apart by a float64.
_EXACT = 2.0**52


@jitable
def quantized(value: float, q: float) -> float:
    """The nearest multiple of q; the value itself for q = 0."""
    if q > 0.0 and abs(value) < _EXACT * q:
        return q * math.floor(value / q + 0.5)
    return value


@jitable
def ring_row(i: int, ring: Any) -> int:
    """Where a ring, of a power of two rows, keeps timestep i: no division, which is slow."""
    return i & (ring.shape[0] - 1)


@jitable
def measured_at(i: int, delay: int, period: int) -> int:
    """The timestep of what a sensor tells in timestep i; before its first, the start."""
    a = i - delay
    if a > 0 and period > 0:
        a -= a % period
    return max(a, 0)


@cache
def sensing(n: int) -> Callable[[int, Any, Any], None]:
    """Jitable (i, loop, q): write into ``loop.seen`` what n states look like in timestep i."""

    @jitable
    def sense(i: int, loop: Any, q: Any) -> None:
        for j in range(n):
            a = measured_at(i, int(q.sensors[j, 4]), int(q.sensors[j, 5]))
            value, noise = loop.past[ring_row(a, loop.past), j], q.sensors[j, 1]
            value += q.sensors[j, 2] + q.sensors[j, 3] * (a * q.timestep)
            if noise > 0.0:
                value += noise * normal(q.seed, q.run, j, a)
            loop.seen[j] = quantized(value, q.sensors[j, 0])

    return sense
