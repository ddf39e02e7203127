"""Prediction: the state at the instant when the law's output arrives, by the design model.

The model's error in a period, a load say, is learned and goes on in the prediction.
"""

from __future__ import annotations

from typing import Any

from grosmc_mj.control.matrices import copy
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.delay import put_out

# A law that predicts learns the error of its model at this part of one over its dead time: faster,
# a wrong inertia makes it ring; slower, a load goes on misleading it.
LEARNING = 0.1


@jitable
def move_by_a_period(i: int, t: float, loop: Any) -> None:
    """Move ``loop.x`` from the last sample to that of timestep i, at t [s], by the design model.

    Under the mean of the inputs of that time, earlier by the dead time that the law knows.
    """
    q = loop.computer[0]
    count, end = int(q.stride), i - int(q.dead)
    for j in range(len(loop.actuators)):
        total = 0.0
        for a in range(end - count, end):
            total += put_out(a, j, loop)
        loop.mean[j] = total / count
    loop.advance(t - q.period, loop.x, loop.mean, q.period, loop.address)


@jitable
def expect(i: int, t: float, loop: Any) -> None:
    """Before a sample: move the last measurements by a period, into ``loop.predicted``."""
    copy(loop.seen, loop.x)
    move_by_a_period(i, t, loop)
    copy(loop.x, loop.predicted)


@jitable
def learn(loop: Any) -> None:
    """After a sample: let the missed rate follow the error of ``expect``, through a lag."""
    q = loop.computer[0]
    for j in range(len(loop.sensors)):
        sensor = loop.sensors[j]
        rate = (loop.seen[j] - loop.predicted[j]) / q.period
        sensor.missed += q.learning * (rate - sensor.missed)


@jitable
def predict(i: int, t: float, loop: Any) -> None:
    """Move ``loop.x`` from the sample of timestep i, at t [s], on by the dead time that is known.

    Timesteps with one input, up to a control period of them, are one step of the model.
    """
    q, m = loop.computer[0], len(loop.actuators)
    # Until they are as old as their sensors say, measurements are those of the start.
    dead = int(q.dead) - int(q.age) + min(i, int(q.age))
    a = i - dead
    while a < i:
        for j in range(m):
            loop.mean[j] = put_out(a, j, loop)
        count, same = 1, True
        while same and a + count < i and count < q.stride:
            for j in range(m):
                same = same and put_out(a + count, j, loop) == loop.mean[j]
            if same:
                count += 1
        at, h = t + q.ahead + (a - i) * q.timestep, count * q.timestep
        loop.advance(at, loop.x, loop.mean, h, loop.address)
        a += count
    for j in range(len(loop.sensors)):
        loop.x[j] += loop.sensors[j].missed * (dead * q.timestep)
