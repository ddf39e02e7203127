"""The software's half of a loop works alone, from what is measured."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from looped import ANGLE, CURRENT, SPEED, H, played, scripted, seen

from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor, apply_loop
from grosmc_mj.simulation.loop.counter import uniform
from grosmc_mj.simulation.loop.sent import keep_output
from grosmc_mj.simulation.loop.software import observe
from grosmc_mj.simulation.loop.world import Measured
from grosmc_mj.theory.plants import SERVO

STRIDE = 3
JITTER = 2
MISSED = 0.2
SAMPLES = 60
SEED = 3
X0 = (0.4, 3.0)
DELAY = 2
RESOLUTION = 1e-5

ESO = Estimator((SPEED,), law="eso", bandwidth=150.0)
UNSETTLED = Estimator((SPEED,), law="filtered", time_constant=0.01, settled=False)
KALMAN = Estimator((ANGLE, SPEED), law="kalman", load=1.0)


def instants() -> list[int]:
    """Clock at each sample, in ticks: each is late by its random number, the first is not."""
    clock = [0]
    for k in range(1, SAMPLES):
        share = uniform(SEED, 0, len(SERVO.states), k)
        clock.append(k * STRIDE + math.floor(share * (JITTER + 1)))
    return clock


def in_time(k: int) -> bool:
    """Whether the output of sample k is sent in time."""
    return uniform(SEED, 0, len(SERVO.states) + 1, k) >= MISSED


def measurements(angles: Array, period: int) -> Iterator[Measured]:
    """Readings of the angle by the description of its sensor, at each sample."""
    last = 0
    for k, tick in enumerate(instants()):
        at = max(tick - DELAY, 0)
        fresh = int(at > last)
        if period:
            at -= at % period
            fresh = (at - last) // period
        if k == 0:
            fresh = 1
        last = at

        angle = RESOLUTION * math.floor(angles[at] / RESOLUTION + 0.5)
        # The rate has no sensor: the software must not read it.
        yield Measured(np.array([angle, np.nan]), np.array([fresh, 1.0]), np.array([tick]))


@pytest.mark.parametrize("predict", [False, True])
@pytest.mark.parametrize(
    ("estimator", "period"),
    [
        (ESO, 0),
        (KALMAN, 0),
        (UNSETTLED, 0),
        (UNSETTLED, 2),
        (UNSETTLED, 4),
    ],
)
def test_the_software_needs_measurements_and_its_own_outputs_only(
    estimator: Estimator, period: int, predict: bool
) -> None:
    """Alone, from readings, clock and start, it gives the states of the run, to the bit."""
    u = np.random.default_rng(5).normal(size=SAMPLES)
    loop = Loop(
        Computing(delay=2 * H, jitter=JITTER * H, missed=MISSED),
        (Sensor(ANGLE, RESOLUTION, delay=DELAY * H, period=period * H),),
        (estimator,),
        (Actuator(CURRENT, delay=H),),
        seed=SEED,
    )
    run = played(u, loop, stride=STRIDE, x0=X0, modelled=True, predict=predict)

    script = scripted(u, STRIDE * H, modelled=True)
    periods = {"control_period": STRIDE * H, "timestep": H}
    applied = apply_loop(loop, script, SERVO, predict=predict, **periods)
    memory = applied.controller.memory()
    alone = applied.begin_uncompiled(np.array(X0), memory, np.zeros(2), np.zeros(2)).software
    for k, measured in enumerate(measurements(run.state[:, 0], period)):
        timestep = int(measured.clock[0])
        command = run.command[timestep : timestep + 1]
        observe(k, measured, alone)
        keep_output(k, command, in_time(k), measured, alone)

        np.testing.assert_array_equal(alone.seen, seen(run)[timestep])
        np.testing.assert_array_equal(alone.predicted, run.memory["x"][timestep])
