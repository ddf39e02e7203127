"""The reference engine: an ordinary loop over any callable law, easy to step through."""

from __future__ import annotations

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.records import pack
from grosmc_mj.simulation.engines.control_callback import refuse_foreign_callback
from grosmc_mj.simulation.engines.inputs import ask
from grosmc_mj.simulation.engines.steppers import stepper_of
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.quiet import warnings_counted_only
from grosmc_mj.simulation.trajectory import Status


class ClosedLoop:
    """A plant under a sampled law, which the caller advances by one timestep after the other.

    Overflows of a diverging run are the caller's to silence, as is MuJoCo's printing.

    Attributes:
        steps: Timesteps done.
        x: State after them, (n,).
        u: Command held in the last one, (m,).
        memory: The law's memory.
        physics: () -> mjSTATE_FULLPHYSICS as it is now; None on an analytic plant.
    """

    def __init__(self, problem: Problem, run: int = 0) -> None:
        """Put the plant at its start.

        Args:
            problem: What is run.
            run: Which of its simulations.
        """
        plant = problem.plants[run]
        self._problem, self._controller = problem, problem.controllers[run]
        self.memory, self._kept_alive = self._controller.begin()
        self.steps, self.u = 0, np.zeros(len(plant.system.inputs))
        self._stepper = stepper_of(plant, problem.timestep)
        self._stepper.restart(problem.x0[run])
        self.x, self.physics = self._stepper.x, self._stepper.physics

    def advance(self, wrench: Array) -> Status:
        """One timestep, with a new sample of the law where one is due.

        Args:
            wrench: [force, torque] of each of ``system.bodies``, flattened, (6 * bodies,).

        Returns:
            Why the run cannot go on, or ``Status.COMPLETED`` for a step that was completed.
        """
        if self.steps % self._problem.stride == 0:
            status = self._sample()
            if status is not Status.COMPLETED:
                return status
        self._stepper.push(wrench)
        if not self._stepper.step():
            return Status.DIVERGED
        self.steps += 1
        return Status.COMPLETED

    def _sample(self) -> Status:
        """Ask the law for the input that is held from now on."""
        if self._problem.system.singular(self.x):
            return Status.SINGULAR_PLANT
        t = self.steps // self._problem.stride * self._problem.control_period
        finite = ask(self._controller, t, self.x, self.memory, self.u)
        self._stepper.hold(self.u)
        if self.memory.undefined:
            return Status.UNDEFINED_LAW
        return Status.COMPLETED if finite else Status.UNDEFINED_INPUT


def run_python(problem: Problem) -> Record:
    """Run every simulation of the problem, one after the other.

    Raises:
        SetupError: If somebody else's control callback is installed.
    """
    refuse_foreign_callback()
    record = Record.empty(problem)
    # A diverging run overflows quietly, as in C; its state tells.
    with np.errstate(all="ignore"), warnings_counted_only():
        for run in range(len(problem.x0)):
            _run_one(problem, run, record)
    return record


def _run_one(problem: Problem, run: int, record: Record) -> None:
    """Run one simulation and write its rows."""
    loop = ClosedLoop(problem, run)
    wrenches, w = problem.wrench(run), np.zeros(6 * len(problem.system.bodies))
    state = loop.physics()
    if state is not None and record.physics is None:
        record.physics = np.zeros((*record.u.shape[:2], len(state)))
        record.start = np.zeros((len(record.u), len(state)))
    if state is not None and record.start is not None:
        record.start[run] = state
    for i in range(problem.steps):
        status = loop.advance(w if wrenches is None else wrenches[i])
        if status is not Status.COMPLETED:
            record.status[run], record.valid[run] = status.value, i
            return
        row = i if problem.record else 0
        record.x[run, row], record.u[run, row] = loop.x, loop.u
        record.memory[run, row] = pack(loop.memory)
        if record.physics is not None:
            record.physics[run, row] = loop.physics()
