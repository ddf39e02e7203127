"""A simulation that has been checked and is ready to run, and what an engine returns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import Plant, System
from grosmc_mj.records import record_dtype
from grosmc_mj.simulation.disturbances import Disturbance, packed, push


@dataclass(frozen=True, eq=False)
class Problem:
    """One or many simulations of one system under one law.

    Attributes:
        plants: One per simulation, all analytic or all in MuJoCo.
        controllers: One per simulation, with the same law.
        x0: Starts, (nsim, n).
        steps: Number of timesteps.
        stride: Timesteps in a control period.
        timestep: [s].
        control_period: [s].
        disturbances: One list for all simulations, or one for each.
        record: Whether every timestep is kept, or the last only.
        threads: For the native engine; 0 for all cores.
    """

    plants: tuple[Plant, ...]
    controllers: tuple[Controller, ...]
    x0: Array
    steps: int
    stride: int
    timestep: float
    control_period: float
    disturbances: tuple[tuple[Disturbance, ...], ...]
    record: bool
    threads: int

    @property
    def system(self) -> System:
        """The system of all the plants."""
        return self.plants[0].system

    @property
    def controller(self) -> Controller:
        """The first controller; the others differ in their numbers only."""
        return self.controllers[0]

    @property
    def memory_dtype(self) -> np.dtype[np.void]:
        """Layout of the law's memory."""
        return record_dtype(self.controller.memory())

    @property
    def disturbed(self) -> bool:
        """Whether anything acts on any of the simulations."""
        return any(self.disturbances)

    @cached_property
    def pushes(self) -> list[tuple[Array, Array]]:
        """What ``packed`` makes of the one list of disturbances, or of each.

        Raises:
            ArgumentError: As ``packed``.
        """
        bodies, steps = self.system.bodies, range(self.steps)
        return [packed(items, bodies, steps, self.timestep) for items in self.disturbances]

    def wrench(self, run: int, step: int) -> Array:
        """Disturbances of one simulation in one timestep, (6 * bodies,)."""
        w = np.zeros(6 * len(self.system.bodies))
        push(*self.pushes[min(run, len(self.pushes) - 1)], step, step * self.timestep, w)
        return w


@dataclass(eq=False)
class Record:
    """Rows of all simulations as an engine writes them.

    Attributes:
        x: States after each kept step, (nsim, rows, n).
        u: Commands of each kept step, (nsim, rows, m).
        memory: Memory of the law in each kept step, flat, (nsim, rows, size).
        status: ``Status`` values, (nsim,).
        valid: Number of valid steps, (nsim,).
        wrench: Disturbances in each kept step, (nsim, rows, 6 * bodies), or None.
        physics: mjSTATE_FULLPHYSICS after each kept step, (nsim, rows, size), or None.
        start: The same before the first step, (nsim, size), or None.
    """

    x: Array
    u: Array
    memory: Array
    status: NDArray[np.int64]
    valid: NDArray[np.int64]
    wrench: Array | None = None
    physics: Array | None = None
    start: Array | None = None

    @classmethod
    def empty(cls, problem: Problem, size: int = 0) -> Record:
        """Room for everything that the problem wants kept.

        Args:
            problem: What is run.
            size: Numbers in mjSTATE_FULLPHYSICS; 0 of equations.
        """
        nsim, rows = len(problem.x0), problem.steps if problem.record else 1
        return cls(
            x=np.zeros((nsim, rows, problem.x0.shape[1])),
            u=np.zeros((nsim, rows, len(problem.system.inputs))),
            memory=np.zeros((nsim, rows, problem.memory_dtype.itemsize // 8)),
            status=np.zeros(nsim, np.int64),
            valid=np.full(nsim, problem.steps, np.int64),
            wrench=np.zeros((nsim, rows, 6 * len(problem.system.bodies)))
            if problem.disturbed
            else None,
            physics=np.zeros((nsim, rows, size)) if size else None,
            start=np.zeros((nsim, size)) if size else None,
        )
