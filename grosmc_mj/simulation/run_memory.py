"""Memory in which the engines make runs of a problem, one after the other."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import pack
from grosmc_mj.simulation.kernel import ANSWERED, DisturbanceRun, KernelRun, PlantRun
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.steppers import Stepper


class RunMemory:
    """Memory for runs on one stepper; each begins with ``begin``.

    Args:
        problem: Simulations.
        number: Number of the first one.
        record: Record for their rows.
        stepper: Stepper of their plants.
        plant: Plant in the engine, see ``PlantRun``.
        of_engine: Other fields of ``KernelRun`` in which the engines differ.

    Attributes:
        problem: Simulations.
        record: Record for their rows.
        stepper: Stepper of their plants.
        run: The run of the kernel.
    """

    def __init__(
        self,
        problem: Problem,
        number: int,
        record: Record,
        stepper: Stepper,
        plant: PlantRun,
        **of_engine: Any,
    ) -> None:
        self.problem = problem
        self.record = record
        self.stepper = stepper

        now = np.zeros(problem.width)
        signals = {name: now[columns] for name, columns in problem.columns.items()}
        numbers, values = problem.disturbances_of(number)
        disturbances = DisturbanceRun(
            numbers=numbers,
            values=values,
            sums=now[problem.disturbed_columns],
            **{part: signals.pop(part) for part in problem.disturbed},
        )
        # A loop writes the measured state into its column; the law gets it in an array of its own.
        signals["seen"] = np.zeros(problem.x0.shape[1])
        accumulator = problem.accumulators[number]
        self.run = KernelRun(
            address=0,
            progress=np.zeros(4, np.int64),
            keep=0 if problem.record else problem.steps - 1,
            stride=problem.stride,
            h=problem.timestep,
            period=problem.control_period,
            plant=plant,
            disturbances=disturbances,
            now=now,
            **signals,
            accumulated=record.accumulated[number].copy(),
            accumulator_numbers=pack(accumulator.numbers) if accumulator else np.zeros(0),
            rows=record.rows.reshape(-1, record.rows.shape[2]),
            # It needs some of the arrays above.
            loop=cast(Any, None),
            **of_engine,
        )

    def begin(self, number: int, memory: Array) -> None:
        """Bring one simulation to its start; its loop is begun by the engine.

        Args:
            number: Number of the simulation.
            memory: Memory of its law, flat.
        """
        problem = self.problem
        run = self.run
        x0 = problem.x0[number]
        rows = self.record.rows.shape[1]
        self.stepper.restart(x0)
        run.progress[:] = 0, problem.steps, ANSWERED, number * rows + 1
        run.now[:] = 0.0
        run.seen[:] = 0.0
        run.x[:] = x0
        run.memory[:] = memory

        first_row = self.record.rows[number, 0]
        first_row[problem.columns["x"]] = x0
        if self.stepper.recorded_size:
            self.stepper.read(first_row[problem.width :])
