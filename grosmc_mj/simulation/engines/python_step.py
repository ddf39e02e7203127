"""One simulation, a timestep at a time: the plant, the sampled law and the hold between samples."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.engines.inputs import ask
from grosmc_mj.simulation.engines.runge_kutta import runge_kutta_step
from grosmc_mj.simulation.trajectory import Status

# State, step under held input and wrench (False if it diverged), and the physics state.
Stepper = tuple[Array, Callable[[Array, Array], bool], Callable[[], Array | None]]

# A state beyond this has diverged; MuJoCo's own bound.
LARGEST = mujoco.mjMAXVAL


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
        self.x, self._step, self.physics = _stepper(plant, x0, timestep)
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
        if not self._step(self.u, wrench):
            return Status.DIVERGED
        self.steps += 1
        return Status.COMPLETED

    def _sample(self) -> Status:
        """Ask the law for the input that is held from now on."""
        if self._system.singular(self.x):
            return Status.SINGULAR_PLANT
        t = self.steps // self._stride * self._period
        finite = ask(self.controller, t, self.x, self.memory, self.u)
        if self.memory.undefined:
            return Status.UNDEFINED_LAW
        return Status.COMPLETED if finite else Status.UNDEFINED_INPUT


def _stepper(plant: Plant, x0: Array, h: float) -> Stepper:
    """How to move one simulation of a plant."""
    if plant.kind == "physics":
        return _physics_stepper(plant, x0)
    return _analytic_stepper(plant, x0, h)


def _analytic_stepper(plant: Plant, x0: Array, h: float) -> Stepper:
    x, scratch = x0.copy(), np.zeros((3, len(x0)))
    rk4 = runge_kutta_step(plant.system)

    def step(u: Array, w: Array) -> bool:
        try:
            rk4(x, u, w, plant.parameters, h, *scratch)
        except (ArithmeticError, ValueError):  # where C goes on with infinities and NaN
            return False
        return bool(np.all(np.abs(x) < LARGEST))

    return x, step, lambda: None


def _physics_stepper(plant: Plant, x0: Array) -> Stepper:
    model, system = plant.model_with_userdata(0), plant.system
    data, x, n = mujoco.MjData(model), x0.copy(), system.degrees_of_freedom
    data.qpos, data.qvel = x0[:n], x0[n:]
    bodies = [model.body(name).id for name in system.bodies]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)

    def step(u: Array, w: Array) -> bool:
        data.ctrl[:] = u
        data.xfrc_applied[bodies] = w.reshape(-1, 6)
        mujoco.mj_step(model, data)
        x[:n], x[n:] = data.qpos, data.qvel
        return not np.any(data.warning.number)

    def physics() -> Array:
        state = np.zeros(size)
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state

    return x, step, physics
