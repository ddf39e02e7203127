"""What actuators make of what is asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.jitable import jitable
from grosmc_mj.loop.sensing import quantized, ring_row

# Entries of a row of ``LoopMemory.lags``.
_RATED, _FIRST, _SECOND = range(3)


@jitable
def lagged(u: float, tau: float, kept: float, order: int, row: Any) -> float:
    """The mean over a timestep of u behind one or two lags of tau timesteps, exp(-1/tau) kept.

    ``row`` has the lags' outputs, which are brought to the end of the timestep: with the input held
    they are exact, and so is the integral of what comes out.
    """
    first, second = row[_FIRST], row[_SECOND]
    row[_FIRST] = u + (first - u) * kept
    mean = u - tau * (row[_FIRST] - first)
    if order == 1:
        return mean
    row[_SECOND] = u + (second - u) * kept + (first - u) * kept / tau
    return mean - tau * (row[_SECOND] - second)


@cache
def actuating(m: int) -> Callable[[int, Any, Any], None]:
    """Jitable (i, loop, q): write into ``loop.given`` what m actuators give in timestep i."""

    @jitable
    def actuate(i: int, loop: Any, q: Any) -> None:
        for j in range(m):
            a = i - int(q.delay) - int(q.actuators[j, 0])
            u = q.rest[j] if a < 0 else loop.queue[ring_row(a, loop.queue), j]
            limit, change, tau = q.actuators[j, 2], q.actuators[j, 3], q.actuators[j, 4]
            u = min(limit, max(-limit, quantized(u, q.actuators[j, 1])))
            before = loop.lags[j, _RATED]
            u = min(before + change, max(before - change, u))
            loop.lags[j, _RATED] = u
            if tau > 0.0:
                u = lagged(u, tau, q.actuators[j, 7], int(q.actuators[j, 5]), loop.lags[j])
            dead = q.actuators[j, 6]
            if dead > 0.0:
                u = max(u - dead, 0.0) + min(u + dead, 0.0)
            loop.given[j] = u

    return actuate
