"""A simulation that has been checked and is ready to run, and the rows that an engine writes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import Plant, System
from grosmc_mj.records import pack, record_dtype
from grosmc_mj.simulation.disturbances import Disturbance, packed


@dataclass(frozen=True, eq=False)
class Meters:
    """Metrics that are accumulated while a run goes on.

    Attributes:
        note: Jitable (t, x, u, memory, p, meters, numbers): note the timestep that begins at t [s]
            in the state x, (n,), under the input u, (m,), of the law with memory and p.
        start: Their values as a run begins, a dataclass of numbers and arrays.
        numbers: What ``note`` needs to know, another one.
    """

    note: Callable[[float, Any, Any, Any, Any, Any, Any], None]
    start: Any
    numbers: Any

    @property
    def kind(self) -> tuple[Any, ...]:
        """Properties shared by the runs of one batch."""
        return self.note, record_dtype(self.start), record_dtype(self.numbers)


@dataclass(frozen=True, eq=False)
class Problem:
    """One or many simulations of one system under one law.

    Attributes:
        plants: One per simulation, all analytic or all in MuJoCo.
        controllers: One per simulation, with the same law.
        meters: One per simulation, which note alike; None for none.
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
    meters: tuple[Meters | None, ...]
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
    def looped(self) -> bool:
        """Whether the law is in a loop with sensors and actuators."""
        return self.controller.loop is not None

    @property
    def disturbed(self) -> bool:
        """Whether anything acts on any of the simulations."""
        return any(self.disturbances)

    @cached_property
    def columns(self) -> dict[str, slice]:
        """Where the signals are in a row, by their names in ``KernelRun``; ``seen`` of a loop."""
        n, m, looped = self.x0.shape[1], len(self.system.inputs), self.looped
        wrenches = 6 * len(self.system.bodies) if self.disturbed else 0
        sizes = {"x": n, "command": m, "memory": self.memory_dtype.itemsize // 8, "w": wrenches,
                 "given": m * looped, "seen": n * looped}  # fmt: skip
        ends = np.cumsum(list(sizes.values())).tolist()
        return {name: slice(end - sizes[name], end) for name, end in zip(sizes, ends, strict=True)}

    @property
    def width(self) -> int:
        """Numbers in a row."""
        return list(self.columns.values())[-1].stop

    @cached_property
    def pushes(self) -> list[tuple[Array, Array]]:
        """What ``packed`` makes of the one list of disturbances, or of each.

        Raises:
            ArgumentError: As ``packed``.
        """
        bodies, steps = self.system.bodies, range(self.steps)
        return [packed(items, bodies, steps, self.timestep) for items in self.disturbances]

    def pushes_of(self, run: int) -> tuple[Array, Array]:
        """The same of one simulation."""
        return self.pushes[min(run, len(self.pushes) - 1)]


@dataclass(eq=False)
class Record:
    """Record of all simulations, written by an engine.

    Attributes:
        rows: The signals at the start and after each kept step, and behind them
            mjSTATE_FULLPHYSICS, (nsim, kept steps + 1, width + size).
        status: ``Status`` values, (nsim,).
        valid: Number of valid steps, (nsim,).
        meters: Accumulated metrics, flat, (nsim, size).
    """

    rows: Array
    status: NDArray[np.int64]
    valid: NDArray[np.int64]
    meters: Array

    @classmethod
    def empty(cls, problem: Problem, size: int = 0) -> Record:
        """Room for everything that the problem wants kept.

        Args:
            problem: What is run.
            size: Numbers in mjSTATE_FULLPHYSICS; 0 of equations.
        """
        nsim, kept = len(problem.x0), problem.steps if problem.record else 1
        starts = [pack(meters.start) if meters else np.zeros(0) for meters in problem.meters]
        return cls(
            rows=np.zeros((nsim, kept + 1, problem.width + size)),
            status=np.zeros(nsim, np.int64),
            valid=np.full(nsim, problem.steps, np.int64),
            meters=np.array(starts),
        )
