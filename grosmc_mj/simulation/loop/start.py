"""A loop as a run begins: its two halves, and what is measured between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.simulation.loop.software import Software, ideal_software, software_at_start
from grosmc_mj.simulation.loop.task import LoopTask
from grosmc_mj.simulation.loop.world import Measured, World, ideal_world, world_at_start


class LoopRun(NamedTuple):
    """A loop in a run.

    Attributes:
        world: Sensors, actuators and the times of the computer.
        measured: What reaches the software at a sample.
        software: Estimators, filter and prediction.
    """

    world: World
    measured: Measured
    software: Software


def ideal_loop(n: int, m: int) -> LoopRun:
    """Ideal loop of n states and m inputs, which the kernel leaves out."""
    return LoopRun(ideal_world(n, m), _measured(0), ideal_software(n, m))


def loop_at_start(task: LoopTask) -> LoopRun:
    """Numbers of a loop as a run begins.

    Raises:
        ArgumentError: If an estimator does not fit.
        GainError: If there is no Kalman filter.
    """
    n = len(task.system.states)
    return LoopRun(world_at_start(task), _measured(n), software_at_start(task))


def _measured(n: int) -> Measured:
    """Room for the measurements of n states."""
    return Measured(y=np.zeros(n), fresh=np.zeros(n), clock=np.zeros(1))
