"""The reference engine: the kernel as plain Python, for any callable law, easy to step through."""

from __future__ import annotations

import sys
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import pack
from grosmc_mj.mechanics.physics.hooks import refuse_foreign_callback, warnings_counted_only
from grosmc_mj.simulation.disturbances import Disturbance, OutputDisturbance, disturb
from grosmc_mj.simulation.kernel import ANSWER, ANSWERED, LAST_STEP, NEXT_STEP, run_of
from grosmc_mj.simulation.law_inputs import sample_law
from grosmc_mj.simulation.loop.applied import LoopRun, ideal_loop
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.run_memory import RunMemory
from grosmc_mj.simulation.steppers import Steppers, plant_run
from grosmc_mj.simulation.trajectory import Status


class ClosedLoop(RunMemory):
    """A plant under a sampled law, which the caller advances.

    Overflows of a diverging run are the caller's to silence, and so are MuJoCo's warnings.

    Args:
        problem: Simulations.
        number: Number of this one.
        record: Record for its rows; None for none.
        steppers: Steppers of plants; new ones by default.

    Attributes:
        steps: Timesteps done.
        memory: Memory of the law.
        accumulated: Values of the accumulator so far; None without any.
        run: State of the kernel: ``run.x`` is the last valid state, ``run.plant.u`` the input.
    """

    def __init__(
        self,
        problem: Problem,
        number: int = 0,
        record: Record | None = None,
        steppers: Steppers | None = None,
    ) -> None:
        """Bring the plant to its start."""
        self._controller = problem.controllers[number]
        self._accumulator = problem.accumulators[number]
        steppers = steppers or Steppers(problem.timestep)
        stepper = steppers.of(problem.plants[number])
        # Without a record the caller may make any number of steps.
        kept = record or Record.empty(replace(problem, record=False), stepper.recorded_size)
        super().__init__(
            problem,
            number,
            kept,
            stepper,
            plant_run(
                stepper,
                step=stepper.advance,
                read=self._read,
                model=stepper.model,
                data=stepper.data,
            ),
            law=self._sample,
            note=self._note,
            p=np.zeros(0),
            # Rows in place of addresses, see ``_read``.
            physics=0,
            width=1 if stepper.recorded_size else 0,
        )
        if record is None:
            self.run = self.run._replace(keep=sys.maxsize)

        self.steps = 0
        self.memory = self._controller.memory()
        self.accumulated = None
        if self._accumulator is not None:
            self.accumulated = deepcopy(self._accumulator.start)
        self.run = self.run._replace(loop=self._begun_loop(number))
        self.begin(number, pack(self.memory))

    def _begun_loop(self, number: int) -> LoopRun:
        """Loop at the start of the run."""
        problem = self.problem
        run = self.run
        loop = problem.loops[number]
        if loop is None:
            return ideal_loop(len(run.seen), len(run.plant.u))
        seen = run.now[problem.columns["seen"]]
        return loop.begin_uncompiled(problem.x0[number], self.memory, seen, run.seen)

    def physics(self) -> Array:
        """Return mjSTATE_FULLPHYSICS as it is now, (size,); of equations nothing."""
        state = np.zeros(self.stepper.size)
        self.stepper.read(state)
        return state

    def advance(self, steps: int = 1) -> Status:
        """Make timesteps, with a sample of the law where one is due, under the disturbances.

        Returns:
            ``Status.COMPLETED``, or why the run cannot go on.
        """
        self.run.progress[LAST_STEP] = self.steps + steps
        run_of(looped=self.problem.looped)(self.run)
        self.steps = int(self.run.progress[NEXT_STEP])
        return Status(int(self.run.progress[ANSWER]) - ANSWERED)

    def advance_under(self, wrench: Array) -> Status:
        """Make one timestep under a wrench, (6 * bodies,), beside the disturbances.

        It may go on after the end of the run. Some disturbance of the problem must act on a body,
        if only with a wrench of zero.
        """
        problem = self.problem
        disturbances = [*problem.disturbances[0]]
        for body, of_body in zip(problem.system.bodies, wrench.reshape(-1, 6), strict=True):
            if of_body.any():
                pull: Any = of_body.tolist()
                disturbances.append(Disturbance(body, pull))
        steps = range(self.steps, self.steps + 1)
        numbers, values = problem.packed(disturbances, steps)
        disturbed = self.run.disturbances._replace(numbers=numbers, values=values)
        self.run = self.run._replace(disturbances=disturbed)
        return self.advance()

    def output_disturbance(self) -> Array:
        """Disturbance of the states as they would be measured now, (n,); empty without any.

        At the end of the run it is that of the last timestep.
        """
        problem = self.problem
        step = min(self.steps, problem.steps - 1)
        h = problem.timestep
        disturbances = self.run.disturbances
        signals = np.zeros(len(disturbances.sums))
        disturb(disturbances.numbers, disturbances.values, step, step * h, h, signals)

        start = problem.columns[OutputDisturbance.part].start - problem.disturbed_columns.start
        return signals[start : start + problem.disturbed[OutputDisturbance.part]]

    def _sample(self, t: float, _address: Any) -> int:
        """Sample the law for the input that is held from now on, see ``kernel.LAW``."""
        run = self.run
        if self.problem.system.singular(run.x):
            return ANSWERED + Status.SINGULAR_PLANT.value

        finite = sample_law(self._controller, t, run.seen, self.memory, run.command)
        run.memory[:] = pack(self.memory)
        if self.memory.undefined:
            return ANSWERED + Status.UNDEFINED_LAW.value
        if not finite:
            return ANSWERED + Status.UNDEFINED_INPUT.value
        return ANSWERED

    def _note(self, t: float, _address: Any) -> None:
        """Accumulate the metrics of a timestep, see ``kernel.NOTE``."""
        assert self._accumulator is not None
        self._accumulator.note(
            t,
            self.run.x,
            self.run.plant.u,
            self.memory,
            self._controller.parameters,
            self.accumulated,
            self._accumulator.numbers,
        )

    def _read(
        self,
        _model: Any,
        _data: Any,
        row: int,
        _kind: int,
    ) -> None:
        """Write mjSTATE_FULLPHYSICS into a row of the record."""
        self.stepper.read(self.run.rows[row, self.problem.width :])


def run_python(problem: Problem) -> Record:
    """Run every simulation of the problem, one after the other.

    Raises:
        ModelError: If MuJoCo cannot step the model.
        SetupError: If somebody else's callback is installed.
    """
    refuse_foreign_callback()
    steppers = Steppers(problem.timestep)
    record = Record.empty(problem, steppers.of(problem.plants[0]).recorded_size)
    # A diverging run overflows quietly, as in C; its status says that it diverged.
    with np.errstate(all="ignore"), warnings_counted_only():
        for number in range(len(problem.x0)):
            loop = ClosedLoop(problem, number, record, steppers)
            status = loop.advance(problem.steps)
            record.status[number] = status.value
            record.valid[number] = loop.steps
            if loop.accumulated is not None:
                record.accumulated[number] = pack(loop.accumulated)
    return record
