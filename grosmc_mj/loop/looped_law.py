"""A law among its sensors, computer and actuators, as a law of the plant."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.control.law import Law, around
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.actuating import actuating
from grosmc_mj.loop.counter import uniform
from grosmc_mj.loop.design_model import Advance
from grosmc_mj.loop.estimating import (
    filtering,
    moving_by_a_period,
    put_out,
    rate_estimating,
)
from grosmc_mj.loop.sensing import ring_row, sensing


@cache
def looped_law_of(
    law: Law,
    n: int,
    m: int,
    advance: Advance | None,
    observers: frozenset[str],
    predicts: bool,
) -> Law:
    """The law in a loop of n states and m inputs."""
    inner = jitable(law)
    sense, actuate = sensing(n), actuating(m)
    expect, estimate = rate_estimating(n, m, advance if "eso" in observers else None)
    observe, foresee, recall, learn = _nothing, _nothing, _nothing, _nothing
    if advance is not None and "kalman" in observers:
        observe = filtering(n, m, advance)
    if advance is not None and predicts:
        foresee, (recall, learn) = foreseeing(n, m, advance), load_learning(n, m, advance)

    @jitable
    def late(k: int, q: Any) -> float:
        """By how many timesteps sample k is late."""
        if q.jitter == 0.0:
            return 0.0
        return math.floor(uniform(q.seed, q.run, n, k) * (q.jitter + 1.0)) * 1.0

    def looped_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        loop, q = memory.loop, p.loop
        i, k = int(loop.step), int(loop.sample)
        row = ring_row(i, loop.past)
        for j in range(n):
            loop.past[row, j] = x[j]
        if loop.step >= loop.due:
            t_k = k * q.period
            if k > 0:
                expect(i, t_k, memory, p)
                recall(i, t_k, memory, p)
            sense(i, loop, q)
            estimate(i, t_k, memory, p)
            observe(i, t_k, memory, p)
            if k > 0 and i - q.stride >= q.age:
                learn(i, t_k, memory, p)
            for j in range(n):
                loop.model[j] = loop.seen[j]
            foresee(i, t_k, memory, p)
            for j in range(n):
                loop.believed[j] = loop.model[j]
            inner(t_k + q.ahead, loop.believed, memory, p, u)
            missed = q.missed > 0.0 and uniform(q.seed, q.run, n + 1, k) < q.missed
            for j in range(m):
                loop.asked[j] = u[j]
            for j in range(m):
                if not math.isfinite(u[j]):
                    return
            for j in range(m):
                if not missed:
                    loop.output[j] = u[j]
            loop.sample = k + 1.0
            loop.due = (k + 1) * q.stride + late(k + 1, q)
        row = ring_row(i, loop.queue)
        for j in range(m):
            loop.queue[row, j] = loop.output[j]
        actuate(i, loop, q)
        loop.step = i + 1.0
        for j in range(m):
            u[j] = loop.given[j]

    return around(looped_law, law)


@jitable
def _nothing(i: int, t: float, memory: Any, p: Any) -> None:
    """Where nothing is observed or foreseen."""


@cache
def load_learning(n: int, m: int, move: Advance) -> tuple[Callable[..., None], Callable[..., None]]:
    """What the design model misses of the state's rate: two jitable (i, t, memory, p).

    The first, before a sample, moves what was seen at the last one by a period; the second lets
    ``loop.missed`` follow what is seen instead, through a lag.
    """
    moved = moving_by_a_period(m, move)

    @jitable
    def recall(i: int, t: float, memory: Any, p: Any) -> None:
        loop = memory.loop
        for j in range(n):
            loop.model[j] = loop.seen[j]
        moved(i, t, memory, p)
        for j in range(n):
            loop.believed[j] = loop.model[j]

    @jitable
    def learn(i: int, t: float, memory: Any, p: Any) -> None:
        loop, q = memory.loop, p.loop
        for j in range(n):
            rate = (loop.seen[j] - loop.believed[j]) / q.period
            loop.missed[j] += q.learning * (rate - loop.missed[j])

    return recall, learn


@cache
def foreseeing(n: int, m: int, move: Advance) -> Callable[..., None]:
    """Jitable (i, t, memory, p): move ``loop.model`` on by the dead time that the law knows.

    Timesteps with one input, up to a control period of them, are one step of the model.
    """

    @jitable
    def foresee(i: int, t: float, memory: Any, p: Any) -> None:
        loop, q = memory.loop, p.loop
        # Until it is as old as its sensors say, what is seen is the start.
        dead = int(q.dead) - int(q.age) + min(i, int(q.age))
        a = i - dead
        while a < i:
            for j in range(m):
                loop.mean[j] = put_out(a, j, loop, q)
            count, same = 1, True
            while same and a + count < i and count < q.stride:
                for j in range(m):
                    same = same and put_out(a + count, j, loop, q) == loop.mean[j]
                if same:
                    count += 1
            at = t + q.ahead + (a - i) * q.timestep
            move(at, loop.mean, memory, p, count * q.timestep)
            a += count
        for j in range(n):
            loop.model[j] += loop.missed[j] * (dead * q.timestep)

    return foresee
