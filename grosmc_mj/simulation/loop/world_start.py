"""The world's half of a loop as a run begins: rows of its parts, and room for delayed signals."""

from __future__ import annotations

import numpy as np

from grosmc_mj.simulation.loop.actuators import ACTUATOR, kept_in_a_timestep
from grosmc_mj.simulation.loop.delay import COMPUTER
from grosmc_mj.simulation.loop.ring import ring
from grosmc_mj.simulation.loop.rows import rows_of
from grosmc_mj.simulation.loop.sensors import SENSOR
from grosmc_mj.simulation.loop.task import LoopTask
from grosmc_mj.simulation.loop.world import World


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
