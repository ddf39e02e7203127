"""Description of simulations, their metrics, and the record that an engine writes.

``Problem`` has been checked and is ready to run; ``Record`` has its rows, which need memory.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import pack, record_dtype
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.disturbances import AnyDisturbance, packed, widths
from grosmc_mj.simulation.loop.applied import AppliedLoop
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant, System

_GB = 1e9
# Share of the machine's memory from which on a command says what its runs take.
_MUCH = 0.1


@dataclass(frozen=True, eq=False)
class Accumulator:
    """Metrics that the engines accumulate at each timestep of a run.

    Attributes:
        note: Jitable (t, x, u, memory, p, values, numbers): accumulate the timestep that begins at
            t [s] in the state x, (n,), under the input u, (m,), of the law with memory and p. It
            changes ``values`` in place and reads ``numbers``.
        start: ``values`` as a run begins, a dataclass of numbers and arrays.
        numbers: Constants of the run, a dataclass of numbers and arrays.
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
        loops: One per simulation, around its controller; None for ideal ones.
        accumulators: One per simulation, with the same ``note``; None for no metrics.
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
    loops: tuple[AppliedLoop | None, ...]
    accumulators: tuple[Accumulator | None, ...]
    x0: Array
    steps: int
    stride: int
    timestep: float
    control_period: float
    disturbances: tuple[tuple[AnyDisturbance, ...], ...]
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
        return self.loops[0] is not None

    # The columns and every list of disturbances need it.
    @cached_property
    def disturbed(self) -> dict[str, int]:
        """Number of signals of each part that is disturbed in any simulation, see ``widths``."""
        return widths(itertools.chain.from_iterable(self.disturbances), self.system)

    # The engines ask for it in each run.
    @cached_property
    def columns(self) -> dict[str, slice]:
        """Columns of a row by the names of the signals in ``KernelRun``.

        MuJoCo's time comes first and x behind it: together they are mjSTATE_FULLPHYSICS of a model
        without hidden states.
        """
        n = self.x0.shape[1]
        m = len(self.system.inputs)
        sizes = {"engine_time": 1, "x": n, "command": m, "memory": self.memory_dtype.itemsize // 8}
        # Side by side: ``disturb`` writes them as one array.
        sizes.update(self.disturbed)
        sizes["given"] = m if self.looped else 0
        sizes["seen"] = n if self.looped else 0

        columns = {}
        start = 0
        for name, size in sizes.items():
            columns[name] = slice(start, start + size)
            start += size
        return columns

    @property
    def disturbed_columns(self) -> slice:
        """Columns of the sums of all disturbances."""
        parts = [self.columns[part] for part in self.disturbed]
        return slice(parts[0].start, parts[-1].stop)

    @property
    def width(self) -> int:
        """Number of signals in a row."""
        return self.columns["seen"].stop

    @property
    def record_size(self) -> int:
        """Size of the signals of all timesteps that are kept [byte], without hidden states."""
        kept = self.steps if self.record else 1
        return len(self.x0) * (kept + 1) * self.row_size

    @property
    def row_size(self) -> int:
        """Size of the signals of one timestep [byte]."""
        return self.x0.itemsize * self.width

    # Profiles that are no formula are called at every timestep, once.
    @cached_property
    def packed_disturbances(self) -> list[tuple[Array, Array]]:
        """Numbers of the one list of disturbances, or of each list, see ``packed``.

        Raises:
            ArgumentError: If ``packed`` refuses a disturbance.
        """
        return [self.packed(items, range(self.steps)) for items in self.disturbances]

    def packed(self, disturbances: Sequence[AnyDisturbance], steps: range) -> tuple[Array, Array]:
        """Numbers of disturbances and their values in some timesteps, see ``packed``."""
        return packed(disturbances, self.system, self.disturbed, steps, self.timestep)

    def disturbances_of(self, run: int) -> tuple[Array, Array]:
        """Numbers of the disturbances of one simulation."""
        if len(self.packed_disturbances) == 1:
            return self.packed_disturbances[0]
        return self.packed_disturbances[run]


@dataclass(eq=False)
class Record:
    """Record of all simulations, written by an engine.

    Attributes:
        rows: Signals at the start and after each kept step, and behind them mjSTATE_FULLPHYSICS of
            a model with hidden states, (nsim, kept steps + 1, width + size).
        status: ``Status`` values, (nsim,).
        valid: Number of valid steps, (nsim,).
        accumulated: Values of the accumulators, flat, (nsim, size).
    """

    rows: Array
    status: NDArray[np.int64]
    valid: NDArray[np.int64]
    accumulated: Array

    @classmethod
    def empty(cls, problem: Problem, size: int = 0) -> Record:
        """Record with room for every row that the problem keeps.

        Args:
            problem: Simulations.
            size: Numbers in a row behind the signals.
        """
        nsim = len(problem.x0)
        kept = problem.steps if problem.record else 1
        starts = {}
        for accumulator in dict.fromkeys(problem.accumulators):
            starts[accumulator] = _packed_start(accumulator)
        return cls(
            rows=np.zeros((nsim, kept + 1, problem.width + size)),
            status=np.zeros(nsim, np.int64),
            valid=np.full(nsim, problem.steps, np.int64),
            accumulated=np.array([starts[item] for item in problem.accumulators]),
        )


def _packed_start(accumulator: Accumulator | None) -> Array:
    """Values of an accumulator as a run begins, flat; nothing without metrics."""
    if accumulator is None:
        return np.zeros(0)
    return pack(accumulator.start)


# -- memory of recorded runs ----------------------------------------------------------------------


def machine_memory() -> int | None:
    """Return the memory of the machine [byte]; None where the system does not tell."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return None


def memory_words(size: int, runs: int, steps: int) -> str:
    """Return a clause on the memory that recorded runs take.

    Args:
        size: Size of their records [byte].
        runs: Number of runs.
        steps: Timesteps of each.
    """
    of_runs = f"the record of a run of {steps:,} timesteps takes"
    if runs > 1:
        of_runs = f"the records of {runs:,} runs of {steps:,} timesteps take"
    return f"{of_runs} at least {size / _GB:.3g} GB of memory"


def is_much_memory(size: int) -> bool:
    """Whether records of a size [byte] take so much of the machine's memory that one is told."""
    total = machine_memory()
    return total is not None and size > _MUCH * total


def require_memory(size: int, runs: int, steps: int) -> None:
    """Refuse recorded runs that do not fit into the machine's memory.

    Args:
        size: Size of their records [byte].
        runs: Number of runs.
        steps: Timesteps of each.

    Raises:
        ArgumentError: If the machine has less memory.
    """
    total = machine_memory()
    if total is None or size <= total:
        return
    raise ArgumentError(
        f"{memory_words(size, runs, steps)}, and this machine has {total / _GB:.3g} GB: take a "
        "shorter duration, a longer timestep or fewer runs at once"
    )
