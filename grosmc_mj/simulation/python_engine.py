"""The reference engine: the kernel as plain Python, over any callable law, easy to step through."""

from __future__ import annotations

import sys
from copy import deepcopy
from dataclasses import replace
from typing import Any, cast

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.loop.controllers import ideal_loop
from grosmc_mj.physics.quiet import refuse_foreign_callback, warnings_counted_only
from grosmc_mj.records import pack
from grosmc_mj.simulation.kernel import ANSWERED, KernelRun, run_of
from grosmc_mj.simulation.law_inputs import write_inputs
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.steppers import Stepper, Steppers
from grosmc_mj.simulation.trajectory import Status


class ClosedLoop:
    """A plant under a sampled law, which the caller advances.

    Overflows of a diverging run are the caller's to silence, as is MuJoCo's printing.

    Args:
        problem: The simulations.
        number: Which of them.
        record: Where its rows go; None for nowhere.
        steppers: What moves plants.

    Attributes:
        steps: Timesteps done.
        memory: The law's memory.
        meters: Metrics accumulated so far; None without any.
        run: The kernel's view of it: ``run.x`` is the last valid state, ``run.u`` the input.
    """

    def __init__(
        self,
        problem: Problem,
        number: int = 0,
        record: Record | None = None,
        steppers: Steppers | None = None,
    ) -> None:
        """Put the plant at its start."""
        self._problem, self._controller = problem, problem.controllers[number]
        steppers, controller = steppers or Steppers(problem.timestep), self._controller
        self._stepper = stepper = steppers.of(problem.plants[number])
        self.steps, (self.memory, self._kept_alive) = 0, controller.begin()
        kept = record or Record.empty(replace(problem, record=False), stepper.size)
        meters, memory = problem.meters[number], self.memory
        self.meters = deepcopy(meters.start) if meters else None

        def read(_model: Any, _data: Any, row: int, _which: int) -> None:
            stepper.read(kept.rows[number, 1 + row, problem.width :])

        def note(t: float, x: Array, u: Array, *_flat: Any) -> None:
            assert meters is not None
            meters.note(t, x, u, memory, controller.parameters, self.meters, meters.numbers)

        r = kernel_run(
            problem, number, kept, stepper,
            step=stepper.advance, read=read, law=self._sample, note=note, p=np.zeros(0),
            model=stepper.model, data=stepper.data, physics=0, width=min(1, stepper.size),
        )  # fmt: skip
        loop = ideal_loop(len(r.seen), len(stepper.u))
        if controller.loop is not None:
            seen = r.now[problem.columns["seen"]]
            loop = controller.loop.begin_uncompiled(controller, memory, seen, r.seen)
        # Without a record there may be as many steps as somebody likes.
        self.run = r._replace(loop=loop, keep=r.keep if record else sys.maxsize)
        start(self.run, problem, number, stepper, pack(memory), kept.rows[number, 0])

    def physics(self) -> Array:
        """mjSTATE_FULLPHYSICS as it is now, (size,); of equations nothing."""
        state = np.zeros(self._stepper.size)
        self._stepper.read(state)
        return state

    def advance(self, steps: int = 1) -> Status:
        """Timesteps, with a new sample of the law where one is due, under the disturbances.

        Returns:
            Why the run cannot go on, or ``Status.COMPLETED`` for steps that were completed.
        """
        self.run.clock[1] = self.steps + steps
        run_of(looped=self._problem.looped)(self.run)
        self.steps = int(self.run.clock[0])
        return Status(int(self.run.clock[2]) - ANSWERED)

    def advance_under(self, wrench: Array) -> Status:
        """One timestep as ``advance``, but under a wrench, (6 * bodies,), and no disturbances."""
        self.run = self.run._replace(pushes=self.run.pushes[:0])
        self.run.forces[self.run.bodies] = wrench.reshape(-1, 6)
        return self.advance()

    def _sample(
        self, t: float, x: Array, seen: Array, memory: Array, p: Array, u: Array
    ) -> int:  # fmt: skip
        """Sample the law for the input that is held from now on."""
        if self._problem.system.singular(x):
            return ANSWERED + Status.SINGULAR_PLANT.value
        finite = write_inputs(self._controller, t, seen, self.memory, u)
        memory[:] = pack(self.memory)
        if self.memory.undefined:
            return ANSWERED + Status.UNDEFINED_LAW.value
        return ANSWERED if finite else ANSWERED + Status.UNDEFINED_INPUT.value


def kernel_run(
    problem: Problem, number: int, record: Record, stepper: Stepper, **of_engine: Any
) -> KernelRun:
    """Room for the kernel to compute a run of a problem in, see ``start``; its loop comes later.

    Args:
        problem: The simulations.
        number: Which of them.
        record: Where its rows go.
        stepper: What moves its plant.
        of_engine: The fields of ``KernelRun`` in which the engines differ.
    """
    meters, (pushes, values) = problem.meters[number], problem.pushes_of(number)
    now, loop = np.zeros(problem.width), cast(Any, None)
    signals = {name: now[columns] for name, columns in problem.columns.items()}
    return KernelRun(
        clock=np.zeros(3, np.int64),
        keep=0 if problem.record else problem.steps - 1,
        stride=problem.stride,
        h=problem.timestep,
        period=problem.control_period,
        q=stepper.q,
        v=stepper.v,
        u=stepper.u,
        warnings=stepper.warnings,
        pushes=pushes,
        values=values,
        bodies=stepper.bodies,
        forces=stepper.forces,
        now=now,
        **{**signals, "seen": np.zeros(problem.x0.shape[1])},
        meters=record.meters[number],
        meter_numbers=pack(meters.numbers) if meters else np.zeros(0),
        rows=record.rows[number, 1:],
        loop=loop,
        **of_engine,
    )


def start(
    r: KernelRun, problem: Problem, number: int, stepper: Stepper, memory: Array, row: Array
) -> None:
    """Bring a run to its start.

    Args:
        r: Room for it.
        problem: The simulations.
        number: Which of them.
        stepper: What moves its plant.
        memory: Of its law, flat.
        row: The record's first row.
    """
    stepper.restart(problem.x0[number])
    r.clock[:] = 0, problem.steps, ANSWERED
    r.now[:], r.seen[:] = 0.0, 0.0
    r.x[:], r.memory[:] = problem.x0[number], memory
    row[: len(r.x)] = r.x
    stepper.read(row[problem.width :])


def run_python(problem: Problem) -> Record:
    """Run every simulation of the problem, one after the other.

    Raises:
        ModelError: If MuJoCo cannot step the model.
        SetupError: If somebody else's callback is installed.
    """
    refuse_foreign_callback()
    steppers = Steppers(problem.timestep)
    record = Record.empty(problem, steppers.of(problem.plants[0]).size)
    # A diverging run overflows quietly, as in C; its state tells.
    with np.errstate(all="ignore"), warnings_counted_only():
        for number in range(len(problem.x0)):
            loop = ClosedLoop(problem, number, record, steppers)
            ended = loop.advance(problem.steps)
            record.status[number], record.valid[number] = ended.value, loop.steps
            if loop.meters is not None:
                record.meters[number] = pack(loop.meters)
    return record
