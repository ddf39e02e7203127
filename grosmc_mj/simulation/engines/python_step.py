"""One simulation, a timestep at a time: the plant, the sampled law and the hold between samples."""

from __future__ import annotations

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.engines.inputs import ask
from grosmc_mj.simulation.engines.steppers import stepper_of
from grosmc_mj.simulation.trajectory import Status


class ClosedLoop:
    """A plant under a sampled law, which the caller advances by one timestep after the other.

    Overflows of a diverging run are the caller's to silence, as is MuJoCo's printing.

    Attributes:
        controller: The law and its numbers.
        steps: Timesteps done.
        x: State after them, (n,).
        u: Command held in the last one, (m,).
        memory: The law's memory.
        physics: () -> mjSTATE_FULLPHYSICS as it is now; None on an analytic plant.
    """

    def __init__(
        self,
        plant: Plant,
        controller: Controller,
        x0: Array,
        *,
        timestep: float,
        stride: int,
        control_period: float,
    ) -> None:
        """Put the plant at its start.

        Args:
            plant: Analytic or in MuJoCo.
            controller: The law and its numbers.
            x0: Start, (n,).
            timestep: Of an analytic plant [s]; a model in MuJoCo has its own.
            stride: Timesteps in a control period.
            control_period: Time between two samples of the law [s].
        """
        self.controller = controller
        self.memory, self._kept_alive = controller.begin()
        self.steps, self.u = 0, np.zeros(len(plant.system.inputs))
        self._stepper = stepper_of(plant, timestep)
        self._stepper.restart(x0)
        self.x, self.physics = self._stepper.x, self._stepper.physics
        self._system, self._stride, self._period = plant.system, stride, control_period

    def advance(self, wrench: Array) -> Status:
        """One timestep, with a new sample of the law where one is due.

        Args:
            wrench: [force, torque] of each of ``system.bodies``, flattened, (6 * bodies,).

        Returns:
            Why the run cannot go on, or ``Status.COMPLETED`` for a step that was completed.
        """
        if self.steps % self._stride == 0:
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
        if self._system.singular(self.x):
            return Status.SINGULAR_PLANT
        t = self.steps // self._stride * self._period
        finite = ask(self.controller, t, self.x, self.memory, self.u)
        self._stepper.hold(self.u)
        if self.memory.undefined:
            return Status.UNDEFINED_LAW
        return Status.COMPLETED if finite else Status.UNDEFINED_INPUT
