"""The world's half of a loop: sensors, actuators and the times of the computer.

It alone knows the true state, the timesteps of the physics, the random numbers, and how late a
sample or an output is. The software's half gets what is ``Measured``.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.structures import Matrix, Vector
from grosmc_mj.simulation.loop.actuators import ACTUATOR, kept_in_a_timestep
from grosmc_mj.simulation.loop.computer import COMPUTER
from grosmc_mj.simulation.loop.rows import ring, ring_row, row_objects, rows_of, rows_type
from grosmc_mj.simulation.loop.sensors import SENSOR, measure
from grosmc_mj.simulation.loop.task import LoopTask


class World(NamedTuple):
    """Sensors, computer and actuators of a run, for n states and m inputs.

    An ideal loop has no rows of sensors and actuators, and the kernel leaves it out.

    Attributes:
        computer: One row of ``COMPUTER``, (1,).
        sensors: Rows of ``SENSOR``, one for each state, (n,).
        actuators: Rows of ``ACTUATOR``, one for each input, (m,).
        past: True states of the last timesteps, in the units of the states, (a power of two, n).
        queue: Outputs of the computer in the last timesteps, which are on their way to the
            actuators, in the units of the inputs, (a power of two, m).
    """

    computer: Annotated[Any, rows_type(COMPUTER)]
    sensors: Annotated[Any, rows_type(SENSOR)]
    actuators: Annotated[Any, rows_type(ACTUATOR)]
    past: Matrix
    queue: Matrix

    def uncompiled(self) -> World:
        """Copy with rows as Python objects, for the stages as plain Python."""
        return self._replace(
            computer=row_objects(self.computer),
            sensors=row_objects(self.sensors),
            actuators=row_objects(self.actuators),
        )


class Measured(NamedTuple):
    """Measurements that reach the software at a sample of the law.

    Attributes:
        y: Newest measurement of each state, in its unit, (n,).
        fresh: How many measurements a sensor has made since the last sample of the law: 0 if ``y``
            is the one of the last sample; at most 1 for a sensor without a period of its own, (n,).
        clock: Reading of the computer's clock, in ticks of a timestep since the start, (1,).
    """

    y: Vector
    fresh: Vector
    clock: Vector


@jitable
def remember(i: int, x: Any, disturbance: Any, world: Any) -> None:
    """Keep the state of timestep i, (n,), for sensors whose measurements are late.

    A sensor reads the state with the disturbance of its measurement, (n,) or nothing, at the
    instant at which it measures.
    """
    row = ring_row(i, world.past)
    for j in range(len(world.sensors)):
        world.past[row, j] = x[j]
    for j in range(len(disturbance)):
        world.past[row, j] += disturbance[j]


@jitable
def sense(i: int, world: Any, measured: Any) -> int:
    """Sample the sensors in timestep i, and return the number k of the sample, from 0."""
    k = int(world.computer[0].sample)
    measured.clock[0] = i
    measure(i, k, world, measured)
    return k


def measured_states(n: int) -> Measured:
    """Room for the measurements of n states."""
    return Measured(y=np.zeros(n), fresh=np.zeros(n), clock=np.zeros(1))


def ideal_world(n: int, m: int) -> World:
    """World's half of an ideal loop of n states and m inputs: it has no parts."""
    return World(
        computer=np.zeros(0, COMPUTER),
        sensors=np.zeros(0, SENSOR),
        actuators=np.zeros(0, ACTUATOR),
        past=ring(0, n),
        queue=ring(0, m),
    )


def world_at_start(task: LoopTask) -> World:
    """World's half of a loop as a run begins."""
    h = task.timestep
    sensors = task.sensors
    actuators = task.actuators
    rest = task.rest

    computing = task.loop.computing
    computer = rows_of(
        [computing],
        COMPUTER,
        h,
        timestep=h,
        stride=task.stride,
        seed=task.loop.seed,
        run=task.run,
    )
    actuator_rows = rows_of(
        actuators,
        ACTUATOR,
        h,
        rest=rest,
        output=rest,
        rated=rest,
        first=rest,
        second=rest,
        kept=[kept_in_a_timestep(actuator, h) for actuator in actuators],
    )

    oldest = max(round(part.delay / h) + round(part.period / h) for part in sensors)
    latest = round(computing.delay / h) + max(round(part.delay / h) for part in actuators)
    return World(
        computer=computer,
        sensors=rows_of(sensors, SENSOR, h),
        actuators=actuator_rows,
        past=ring(oldest, len(sensors)),
        queue=ring(latest, len(actuators)),
    )
