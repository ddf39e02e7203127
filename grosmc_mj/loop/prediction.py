"""Prediction: the state at the instant when the law's output arrives, by the design model.

The model's error in a period, a load say, is learned and goes on in the prediction.
"""

from __future__ import annotations

from typing import Any

from grosmc_mj.control.matrices import copy
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.delay import put_out

# A law that predicts learns the error of its model at this rate times one over its dead time. If it
# learns faster, a wrong inertia makes it ring; if slower, a load misleads it for longer.
LEARNING = 0.1


@jitable
def move_by_a_period(i: int, t: float, loop: Any) -> None:
    """Move ``loop.x`` from the last sample to that of timestep i, at t [s], by the design model.

    The input is the mean of the outputs in that time, earlier by the dead time that the law knows.
    """
    q = loop.computer[0]
    count = int(q.stride)
    end = i - int(q.dead)
    for j in range(len(loop.actuators)):
        total = 0.0
        for a in range(end - count, end):
            total += put_out(a, j, loop)
        loop.mean[j] = total / count
    loop.advance(t - q.period, loop.x, loop.mean, q.period, loop.address)


@jitable
def expect(i: int, t: float, loop: Any) -> None:
    """Write into ``loop.predicted``, before a sample, the last measurements moved by a period."""
    copy(loop.seen, loop.x)
    move_by_a_period(i, t, loop)
    copy(loop.x, loop.predicted)


@jitable
def learn(loop: Any) -> None:
    """Let the missed rate follow the error of ``expect`` after a sample, through a lag."""
    q = loop.computer[0]
    for j in range(len(loop.sensors)):
        sensor = loop.sensors[j]
        rate = (loop.seen[j] - loop.predicted[j]) / q.period
        sensor.missed += q.learning * (rate - sensor.missed)


@jitable
def predict(i: int, t: float, loop: Any) -> None:
    """Move ``loop.x`` from the sample of timestep i, at t [s], on by the known dead time.

    Timesteps with the same input, up to a control period of them, are one step of the model.
    """
    q = loop.computer[0]
    m = len(loop.actuators)
    # Until they are as old as their sensors say, measurements are those of the start.
    dead = int(q.dead) - int(q.age) + min(i, int(q.age))
    a = i - dead
    while a < i:
        for j in range(m):
            loop.mean[j] = put_out(a, j, loop)
        count = 1
        same = True
        while same and a + count < i and count < q.stride:
            for j in range(m):
                same = same and put_out(a + count, j, loop) == loop.mean[j]
            if same:
                count += 1
        start = t + q.ahead + (a - i) * q.timestep
        loop.advance(start, loop.x, loop.mean, count * q.timestep, loop.address)
        a += count
    for j in range(len(loop.sensors)):
        loop.x[j] += loop.sensors[j].missed * (dead * q.timestep)
