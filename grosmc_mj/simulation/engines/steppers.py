"""What moves a plant by a timestep: equations by RK4, an mjData by MuJoCo."""

from __future__ import annotations

from abc import ABC, abstractmethod

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.plants import Plant, System
from grosmc_mj.simulation.engines.runge_kutta import runge_kutta_step
from grosmc_mj.simulation.machine.unseen import starts

# A state beyond this has diverged; MuJoCo's own bound.
LARGEST = mujoco.mjMAXVAL


class Stepper(ABC):
    """What moves one simulation of a plant by a timestep, under the input and wrench that it holds.

    Overflows of a diverging run are the caller's to silence, as is MuJoCo's printing.

    Attributes:
        x: State after the last step, (n,), moved in place.
    """

    x: Array

    @abstractmethod
    def restart(self, x0: Array) -> None:
        """Go to a start, (n,), with neither input nor wrench."""

    @abstractmethod
    def hold(self, u: Array) -> None:
        """Hold an input from now on, (m,)."""

    @abstractmethod
    def push(self, w: Array) -> None:
        """Apply a wrench from now on: [force, torque] of each body, flattened, (6 * bodies,)."""

    @abstractmethod
    def step(self) -> bool:
        """One timestep; False if the state diverged."""

    def physics(self) -> Array | None:
        """mjSTATE_FULLPHYSICS as it is now; None of equations."""
        return None


class EquationStepper(Stepper):
    """Moves equations by RK4, as the native engine does.

    Args:
        plant: As equations.
        timestep: [s].
    """

    def __init__(self, plant: Plant, timestep: float) -> None:
        system, self._parameters, self._h = plant.system, plant.parameters, timestep
        n = len(system.states)
        self.x, self._scratch = np.zeros(n), np.zeros((3, n))
        self._u, self._w = np.zeros(len(system.inputs)), np.zeros(6 * len(system.bodies))
        self._rk4 = runge_kutta_step(system)

    def restart(self, x0: Array) -> None:
        """Go to a start, (n,)."""
        self.x[:], self._u[:], self._w[:] = x0, 0.0, 0.0

    def hold(self, u: Array) -> None:
        """Hold an input, (m,)."""
        self._u[:] = u

    def push(self, w: Array) -> None:
        """Apply a wrench, (6 * bodies,)."""
        self._w[:] = w

    def step(self) -> bool:
        """One step of RK4."""
        try:
            self._rk4(self.x, self._u, self._w, self._parameters, self._h, *self._scratch)
        except (ArithmeticError, ValueError):  # where C goes on with infinities and NaN
            return False
        return bool(np.all(np.abs(self.x) < LARGEST))


class PhysicsStepper(Stepper):
    """Moves an mjData by MuJoCo.

    Args:
        system: Names of the joints, and of the bodies that wrenches act on.
        model: The compiled model.
        data: What is moved; it may belong to somebody else.

    Attributes:
        model: The model.
        data: What is moved.
    """

    def __init__(self, system: System, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._system = system
        self.model, self.data, self.x = model, data, np.zeros(len(system.states))
        self._bodies = [model.body(name).id for name in system.bodies]
        self._n = system.degrees_of_freedom
        self._size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)

    def restart(self, x0: Array) -> None:
        """Reset the mjData to a start, (n,)."""
        mujoco.mj_resetData(self.model, self.data)
        qpos, qvel = starts(self.model, self._system, np.array(x0, float)[None])
        self.data.qpos[:], self.data.qvel[:] = qpos[0], qvel[0]
        self.x[:] = x0

    def hold(self, u: Array) -> None:
        """Hold an input, (m,), which MuJoCo clamps to the actuators' range."""
        self.data.ctrl[:] = u

    def push(self, w: Array) -> None:
        """Apply a wrench, (6 * bodies,), at the bodies' centres of mass."""
        self.data.xfrc_applied[self._bodies] = w.reshape(-1, 6)

    def step(self) -> bool:
        """One step of MuJoCo."""
        data, n = self.data, self._n
        mujoco.mj_step(self.model, data)
        self.x[:n], self.x[n:] = data.qpos[:n], data.qvel[:n]
        return not np.any(data.warning.number)

    def physics(self) -> Array:
        """mjSTATE_FULLPHYSICS as it is now."""
        state = np.zeros(self._size)
        mujoco.mj_getState(self.model, self.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        return state


def stepper_of(plant: Plant, timestep: float) -> Stepper:
    """What moves one simulation of a plant, to be restarted first.

    Args:
        plant: Analytic or in MuJoCo.
        timestep: Of an analytic plant [s]; a model in MuJoCo has its own.
    """
    if plant.kind != "physics":
        return EquationStepper(plant, timestep)
    model = plant.model_with_userdata(0)
    return PhysicsStepper(plant.system, model, mujoco.MjData(model))
