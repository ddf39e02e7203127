"""What estimators make of measurements, at each sample of the law.

- ``levant``: A. Levant, "Robust exact differentiation via sliding mode technique", Automatica 34,
  1998, with the gains 1.5 sqrt(L) and 1.1 L, by implicit Euler (V. Acary and B. Brogliato,
  "Implicit Euler numerical scheme and chattering-free implementation of sliding mode systems",
  Systems & Control Letters 59, 2010), solved in closed form: no chatter of its own.
- ``high-gain`` and ``eso``: H. K. Khalil, "High-gain observers in nonlinear feedback control",
  2017, and Z. Gao, "Scaling and bandwidth-parameterization based controller tuning", ACC 2003, as
  current observers with all poles at exp(-w T).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.jitable import jitable
from grosmc_mj.loop.design_model import Advance
from grosmc_mj.loop.numbers import ESO, FILTERED, HIGH_GAIN, LEVANT
from grosmc_mj.loop.sensing import measured_at, ring_row

# Entries of a row of ``LoopMemory.rates``.
_BEGUN, _POSITION, _RATE, _LOAD, _LAST, _AT = range(6)


@jitable
def levant(position: float, rate: float, y: float, L: float, T: float) -> tuple[float, float]:
    """Position and rate after a sample y, T after the last one, with |y''| <= L."""
    a, b = 1.5 * math.sqrt(L) * T, 1.1 * L * T * T
    ahead = position + T * rate - y
    if abs(ahead) <= b:
        # The surface is reached: the selection of sgn(0) that holds it there.
        return y, rate - ahead / T
    root = 0.5 * (math.sqrt(a * a + 4.0 * (abs(ahead) - b)) - a)
    sign = 1.0 if ahead > 0.0 else -1.0
    return y + sign * root * root, rate - sign * 1.1 * L * T


@jitable
def _update(row: Any, kind: float, number: float, y: float, T: float, gained: float) -> None:
    """Bring an estimator up to a sample y, T after the last; the model's rate gained ``gained``."""
    position, rate = row[_POSITION], row[_RATE]
    if kind == LEVANT:
        row[_POSITION], row[_RATE] = levant(position, rate, y, number, T)
        return
    if kind in (HIGH_GAIN, ESO):
        pole = math.exp(-number * T)
        if kind == HIGH_GAIN:
            e = y - (position + T * rate)
            row[_POSITION] = y - pole * pole * e
            row[_RATE] = rate + (1.0 - pole) * (1.0 - pole) * e / T
            return
        load = row[_LOAD]
        e = y - (position + T * rate + 0.5 * T * (gained + T * load))
        part = 1.0 - pole
        row[_POSITION] = y - pole * pole * pole * e
        row[_RATE] = rate + gained + T * load + 1.5 * part * part * (1.0 + pole) * e / T
        row[_LOAD] = load + part * part * part * e / (T * T)
        return
    slope = (y - row[_LAST]) / T
    kept = math.exp(-T / number) if kind == FILTERED else 0.0
    row[_POSITION], row[_RATE] = y, kept * rate + (1.0 - kept) * slope


@jitable
def put_out(a: int, j: int, loop: Any, q: Any) -> float:
    """Input j as it was put out in timestep a, within the limits that the law knows."""
    asked = q.rest[j] if a < 0 else loop.queue[ring_row(a, loop.queue), j]
    return min(q.known_limit[j], max(-q.known_limit[j], asked))


@cache
def moving_by_a_period(m: int, move: Advance) -> Callable[[int, float, Any, Any], None]:
    """Jitable (i, t, memory, p): move ``loop.model`` from the last sample to that of timestep i.

    Under the mean of the m inputs of that time, earlier by the dead time that the law knows.
    """

    @jitable
    def moved(i: int, t: float, memory: Any, p: Any) -> None:
        loop, q = memory.loop, p.loop
        count, end = int(q.stride), i - int(q.dead)
        for j in range(m):
            total = 0.0
            for a in range(end - count, end):
                total += put_out(a, j, loop, q)
            loop.mean[j] = total / count
        move(t - q.period, loop.mean, memory, p, q.period)

    return moved


@cache
def rate_estimating(
    n: int, m: int, advance: Advance | None
) -> tuple[Callable[..., None], Callable[..., None]]:
    """What a sample asks of estimators of rates, before and after its measurements.

    Args:
        n: Number of states.
        m: Number of inputs.
        advance: The design model, which extended-state observers need; None without them.

    Returns:
        Two jitable (i, t, memory, p). The first looks at the state of the last sample; the second
        puts estimates in place of what is not measured.
    """
    if advance is not None:
        moved = moving_by_a_period(m, advance)

        @jitable
        def gains(i: int, t: float, memory: Any, p: Any) -> None:
            """Write into ``loop.total`` what the design model's states gain in a period."""
            loop, q = memory.loop, p.loop
            for j in range(n):
                loop.model[j] = loop.seen[j]
            for row in range(len(q.estimators)):
                place, of = int(q.estimators[row, 2]), int(q.estimators[row, 1])
                if of >= 0 and q.estimators[row, 0] == ESO:
                    loop.model[place] = loop.rates[row, _POSITION]
                    loop.model[of] = loop.rates[row, _RATE]
            for j in range(n):
                loop.believed[j] = loop.model[j]
            moved(i, t, memory, p)
            for j in range(n):
                loop.total[j] = loop.model[j] - loop.believed[j]

    else:

        @jitable
        def gains(i: int, t: float, memory: Any, p: Any) -> None:
            return

    @jitable
    def estimate(i: int, t: float, memory: Any, p: Any) -> None:
        loop, q = memory.loop, p.loop
        for row in range(len(q.estimators)):
            of, position = int(q.estimators[row, 1]), int(q.estimators[row, 2])
            if of < 0:
                continue
            y, period = loop.seen[position], int(q.sensors[position, 5])
            own, kind, number = loop.rates[row], q.estimators[row, 0], q.estimators[row, 3]
            at = measured_at(i, int(q.sensors[position, 4]), period)
            if own[_BEGUN] == 0.0:
                own[_BEGUN], own[_POSITION], own[_LAST], own[_AT] = 1.0, y, y, at
                if q.estimators[row, 4] != 0.0:
                    own[_RATE] = loop.past[ring_row(i, loop.past), of]
            elif at > own[_AT]:
                # A sensor of its own pace has a clock; else the computer's own pace is believed.
                T = (at - own[_AT]) * q.timestep if period > 0 else q.period
                _update(own, kind, number, y, T, loop.total[of])
                own[_LAST], own[_AT] = y, at
            loop.seen[of] = own[_RATE]

    return gains, estimate


@cache
def filtering(n: int, m: int, move: Advance) -> Callable[..., None]:
    """Jitable (i, t, memory, p): the Kalman filter's step, and what it gives of the state.

    Args:
        n: Number of states.
        m: Number of inputs.
        move: The design model.
    """
    moved = moving_by_a_period(m, move)

    @jitable
    def step(i: int, t: float, memory: Any, p: Any) -> None:
        loop, q = memory.loop, p.loop
        # Until a sensor tells something new there is nothing to correct by.
        fresh = loop.sample == 0.0 or i > q.oldest
        for j in range(n):
            loop.model[j] = loop.observed[j]
            if loop.sample == 0.0 and q.settled != 0.0:
                loop.model[j] = loop.past[ring_row(i, loop.past), j]
        if loop.sample > 0.0 and fresh:
            moved(i, t, memory, p)
        for j in range(n):
            loop.observed[j] = loop.model[j]
            for k in range(n):
                if fresh and q.gain[j, k] != 0.0:
                    loop.observed[j] += q.gain[j, k] * (loop.seen[k] - loop.model[k])
        for j in range(n):
            if q.filtered[j] != 0.0:
                loop.seen[j] = loop.observed[j]

    return step
