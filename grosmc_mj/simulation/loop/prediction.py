"""Prediction: the state at the instant when the law's output arrives, by the design model.

The model's error in a period, a load say, is learned and goes on in the prediction.
"""

from __future__ import annotations

from typing import Any

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.simulation.loop.sent import put_out, sample_after, sample_in
from grosmc_mj.theory.control.matrices import copy

# A law that predicts learns the error of its model at this rate times one over its dead time. If it
# learns faster, a wrong inertia makes it ring; if slower, a load misleads it for longer.
LEARNING = 0.1


@jitable
def move_by_a_period(k: int, clock: int, software: Any) -> None:
    """Move ``software.x`` from the last sample to sample k by the design model.

    The input is the mean of the outputs in that time, earlier by the dead time that it knows.

    Args:
        k: Number of the sample, from 1.
        clock: The clock at the sample, in ticks.
        software: Software of the loop.
    """
    setup = software.setup[0]
    count = int(setup.stride)
    end = clock - int(setup.dead)
    first = sample_in(end - count, k, software)

    for j in range(len(software.inputs)):
        total = 0.0
        number = first
        for tick in range(end - count, end):
            number = sample_after(number, tick, k, software)
            total += put_out(number, j, software)
        software.mean[j] = total / count

    start = k * setup.period - setup.period
    software.advance(start, software.x, software.mean, setup.period, software.address)


@jitable
def expect(k: int, clock: int, software: Any) -> None:
    """Write into ``software.predicted``, before a sample, the last measurements a period later."""
    copy(software.seen, software.x)
    move_by_a_period(k, clock, software)
    copy(software.x, software.predicted)


@jitable
def learn(software: Any) -> None:
    """Let the missed rate follow the error of ``expect`` after a sample, through a lag."""
    setup = software.setup[0]
    for j in range(len(software.states)):
        state = software.states[j]
        rate = (software.seen[j] - software.predicted[j]) / setup.period
        state.missed += setup.learning * (rate - state.missed)


@jitable
def predict(k: int, clock: int, software: Any) -> None:
    """Move ``software.x`` from sample k on by the dead time that the software knows.

    Ticks with the same input, up to a control period of them, are one step of the model.

    Args:
        k: Number of the sample, from 0.
        clock: The clock at the sample, in ticks.
        software: Software of the loop.
    """
    setup = software.setup[0]
    m = len(software.inputs)
    arrival = k * setup.period + setup.ahead
    # Until they are as old as their sensors say, measurements are those of the start.
    dead = int(setup.dead) - int(setup.age) + min(clock, int(setup.age))

    tick = clock - dead
    number = sample_in(tick, k, software)
    while tick < clock:
        number = sample_after(number, tick, k, software)
        for j in range(m):
            software.mean[j] = put_out(number, j, software)

        # Further ticks with this input.
        count = 1
        same = True
        while same and tick + count < clock and count < setup.stride:
            following = sample_after(number, tick + count, k, software)
            for j in range(m):
                same = same and put_out(following, j, software) == software.mean[j]
            if same:
                count += 1

        start = arrival + (tick - clock) * setup.tick
        h = count * setup.tick
        software.advance(start, software.x, software.mean, h, software.address)
        tick += count

    for j in range(len(software.states)):
        software.x[j] += software.states[j].missed * (dead * setup.tick)
