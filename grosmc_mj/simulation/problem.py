"""A simulation that has been checked and is ready to run, and what an engine returns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import Plant, System
from grosmc_mj.records import record_dtype
from grosmc_mj.simulation.disturbances import Disturbance, is_known, wrench_table
from grosmc_mj.simulation.law_errors import FailedInCompiledCodeError


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
    def profiles_known(self) -> bool:
        """Whether compiled code knows the profiles of all disturbances."""
        return all(is_known(each.profile) for items in self.disturbances for each in items)

    @cached_property
    def pushed_in_compiled_code(self) -> bool:
        """Whether the native engine makes the wrenches as it goes, without a table.

        A recorded run needs the table all the same.
        """
        return self.disturbed and self.profiles_known and not self.record

    @cached_property
    def wrenches(self) -> Array | None:
        """Disturbances at each timestep, (1 or nsim, steps, 6 * bodies), or None.

        Asks every profile once for each timestep, when first needed.

        Raises:
            ArgumentError: If a body is unknown, or a profile gives no finite number.
        """
        return self.wrenches_at(np.arange(self.steps))

    def wrenches_at(self, steps: NDArray[np.int64]) -> Array | None:
        """Disturbances in some of the timesteps, (1 or nsim, len(steps), 6 * bodies), or None.

        Raises:
            ArgumentError: As ``wrenches``.
        """
        if not self.disturbed:
            return None
        bodies, instants = self.system.bodies, steps * self.timestep
        nothing = np.zeros((len(instants), 6 * len(bodies)))
        tables = [wrench_table(items, bodies, instants) for items in self.disturbances]
        return np.stack([nothing if table is None else table for table in tables])

    def alone(self, run: int) -> Problem:
        """One of the simulations, of which the end only is kept."""
        lists = self.disturbances
        return replace(
            self,
            plants=self.plants[run : run + 1],
            controllers=self.controllers[run : run + 1],
            x0=self.x0[run : run + 1],
            disturbances=lists if len(lists) == 1 else lists[run : run + 1],
            record=False,
        )

    def wrench(self, run: int) -> Array | None:
        """Disturbances of one simulation, (steps, 6 * bodies)."""
        return None if self.wrenches is None else self.wrenches[min(run, len(self.wrenches) - 1)]


# What an engine notes while a law is at work: left behind, the law has raised an error.
FAILED = -1


def refuse_failed(problem: Problem, status: NDArray[Any]) -> None:
    """Refuse to go on after a law that raised an error in compiled code.

    Args:
        problem: What is run.
        status: What is noted of each simulation, (nsim,).

    Raises:
        FailedInCompiledCodeError: If one did.
    """
    failed = np.flatnonzero(status == FAILED)
    if len(failed):
        run = int(failed[0])
        raise FailedInCompiledCodeError(problem.controllers[run].name, run)


@dataclass(eq=False)
class Record:
    """Rows of all simulations as an engine writes them.

    Attributes:
        x: States after each kept step, (nsim, rows, n).
        u: Commands of each kept step, (nsim, rows, m).
        memory: Memory of the law in each kept step, flat, (nsim, rows, size).
        status: ``Status`` values, (nsim,).
        valid: Number of valid steps, (nsim,).
        physics: mjSTATE_FULLPHYSICS after each kept step, (nsim, rows, size), or None.
        start: The same before the first step, (nsim, size), or None.
    """

    x: Array
    u: Array
    memory: Array
    status: NDArray[np.int64]
    valid: NDArray[np.int64]
    physics: Array | None = None
    start: Array | None = None

    @classmethod
    def empty(cls, problem: Problem) -> Record:
        """Room for everything that the problem wants kept."""
        nsim, rows = len(problem.x0), problem.steps if problem.record else 1
        return cls(
            x=np.zeros((nsim, rows, problem.x0.shape[1])),
            u=np.zeros((nsim, rows, len(problem.system.inputs))),
            memory=np.zeros((nsim, rows, problem.memory_dtype.itemsize // 8)),
            status=np.zeros(nsim, np.int64),
            valid=np.full(nsim, problem.steps, np.int64),
        )
