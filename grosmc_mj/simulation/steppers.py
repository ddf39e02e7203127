"""Steppers: they move a plant by a timestep, equations by RK4, an mjData by MuJoCo.

A stepper holds one simulation of a plant, under the input and wrench that it is given. Its arrays
``q``, ``v``, ``u``, ``warnings``, ``bodies`` and ``forces`` are views of what is moved, and mean
what they do in ``kernel.KernelRun``; ``model`` and ``data`` are what ``advance`` takes: an mjModel
and an mjData, or the numbers and the arrays of equations. Overflows of a diverging run are the
caller's to silence, as is MuJoCo's printing.
"""

from __future__ import annotations

import ctypes
from functools import cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import compile_c
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.hidden_states import starts
from grosmc_mj.plants import Plant, System
from grosmc_mj.plants.runge_kutta import runge_kutta_step
from grosmc_mj.records import pack, record_dtype
from grosmc_mj.simulation.guard import c_address, cannot_step
from grosmc_mj.simulation.kernel import STEP
from grosmc_mj.structures import record_at

# A state beyond this has diverged; MuJoCo's own bound.
LARGEST = mujoco.mjMAXVAL
_FULL_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


class EquationStepper:
    """Moves equations by RK4; they have no mjSTATE_FULLPHYSICS.

    Args:
        plant: Plant as equations.
        timestep: [s].
    """

    size = 0
    recorded_size = 0

    def __init__(self, plant: Plant, timestep: float) -> None:
        self._system, self._block = plant.system, np.zeros(1, _block_dtype(plant.system))
        self._block["h"] = timestep
        parts = {name: self._block[name][0] for name in self._block.dtype.names or ()}
        self.data = SimpleNamespace(**{**parts, "h": timestep})
        self.q, self.u, self.v = self.data.x, self.data.u, np.zeros(0)
        self.warnings, self.forces = self.data.warnings, self.data.w.reshape(-1, 6)
        self.bodies, self._step = np.arange(len(self.forces)), _step_of(plant.system)
        self._dtype, self._numbers = record_dtype(plant.parameters), pack(plant.parameters)
        self.model = plant.parameters

    def write(self, plant: Any) -> None:
        """Give the equations the numbers of a plant."""
        if plant.parameters is not self.model:
            self.model, self._numbers[:] = plant.parameters, pack(plant.parameters)

    def restart(self, x0: Array) -> None:
        """Go to a start, (n,), with neither input nor wrench."""
        self.q[:], self.u[:], self.forces[:], self.warnings[:] = x0, 0.0, 0.0, 0

    def advance(self, model: Any, data: Any) -> None:
        """One step of RK4."""
        try:
            self._step(model, data)
        except (ArithmeticError, ValueError):  # where C goes on with infinities and NaN
            data.warnings[0] = 1

    def read(self, state: Array) -> None:
        """Equations have no mjSTATE_FULLPHYSICS."""

    def addresses(self) -> tuple[int, int, int]:
        """For compiled code: a step, the numbers and the state."""
        step = _compiled_step(self._system, self._dtype)
        return step.address, self._numbers.ctypes.data, self._block.ctypes.data


@cache
def _block_dtype(system: System) -> np.dtype[Any]:
    """Memory of a step of equations: timestep, state, input, wrenches and scratch space."""
    n, m, nw = len(system.states), len(system.inputs), 6 * len(system.bodies)
    names = ("x", n), ("u", m), ("w", nw), ("slope", n), ("stage", n), ("total", n)
    arrays = [(name, np.float64, (size,)) for name, size in names]
    return np.dtype([("h", np.float64), *arrays, ("warnings", np.int32, (2,))])


@cache
def _step_of(system: System) -> Any:
    """Jitable (p, d): one step of RK4 of the equations with numbers p in such a block d."""
    rk4, n, largest = runge_kutta_step(system), len(system.states), LARGEST

    @jitable
    def step(p: Any, d: Any) -> None:
        x = d.x
        rk4(x, d.u, d.w, p, d.h, d.slope, d.stage, d.total)
        for i in range(n):
            if not abs(x[i]) < largest:
                d.warnings[0] = 1

    return step


@cache
def _compiled_step(system: System, numbers_dtype: np.dtype[Any]) -> Any:
    """The same as a C function of the addresses of both."""
    step, block_dtype = _step_of(system), _block_dtype(system)

    def at(numbers: int, block: int) -> None:
        step(record_at(numbers, numbers_dtype), record_at(block, block_dtype))

    return compile_c(at, *STEP.args)


class PhysicsStepper:
    """Moves an mjData by MuJoCo.

    Args:
        system: Names of the joints, and of the bodies that wrenches act on.
        model: The compiled model.
        data: What is moved; it may belong to somebody else.
    """

    def __init__(self, system: System, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._system, self.model, self.data, n = system, model, data, system.degrees_of_freedom
        self.q, self.v, self.u = data.qpos[:n], data.qvel[:n], data.ctrl
        counts = data.warning.number
        # Between two counts is what MuJoCo notes of the last warning.
        numbers = (ctypes.c_int32 * (2 * len(counts) - 1)).from_address(counts.ctypes.data)
        self.warnings = np.ctypeslib.as_array(numbers)
        self.bodies = np.array([model.body(name).id for name in system.bodies], np.int64)
        self.forces = data.xfrc_applied
        self.size = mujoco.mj_stateSize(model, _FULL_PHYSICS)
        # Without hidden states it is the time and the state, which a row has anyway.
        self.recorded_size = 0 if self.size == 1 + 2 * n else self.size

    def write(self, plant: Any) -> None:
        """Write the edits of a plant, which shares this model, into it."""
        if plant.changes is not None:
            plant.template.write(plant.changes, self.model, self.data)

    def restart(self, x0: Array) -> None:
        """Reset the mjData to a start, (n,)."""
        mujoco.mj_resetData(self.model, self.data)
        n = len(self.q)
        self.q[:], self.v[:] = x0[:n], x0[n:]
        if self.model.nq > n:
            qpos, qvel = starts(self.model, self._system, np.array(x0, float)[None])
            self.data.qpos[:], self.data.qvel[:] = qpos[0], qvel[0]

    def advance(self, model: Any, data: Any) -> None:
        """One step of MuJoCo."""
        try:
            mujoco.mj_step(model, data)
        except mujoco.FatalError as error:
            raise cannot_step(str(error)) from error

    def read(self, state: Array) -> None:
        """Write mjSTATE_FULLPHYSICS as it is now, (size,)."""
        mujoco.mj_getState(self.model, self.data, state, _FULL_PHYSICS)

    def addresses(self) -> tuple[int, int, int]:
        """``mj_step`` itself, the mjModel and the mjData."""
        return c_address("mj_step"), self.model._address, self.data._address


Stepper = EquationStepper | PhysicsStepper


def shared_model(plant: Any) -> Any:
    """Model or system shared by the plants that one stepper moves."""
    if plant.kind != "physics":
        return plant.system
    return plant.undrawn_model if plant.changes is None else plant.template


class Steppers:
    """Steppers of one thread: plants of one model share one mjModel and one mjData.

    Args:
        timestep: Of equations [s]; a model in MuJoCo has its own.
    """

    def __init__(self, timestep: float) -> None:
        self._timestep, self._shared, self._plant = timestep, None, None
        self._stepper: Any = None

    def of(self, plant: Any) -> Stepper:
        """The stepper of a plant, to be restarted first; valid until the next call."""
        shared = shared_model(plant)
        if shared is not self._shared:
            self._shared, self._plant = shared, None
            if plant.kind != "physics":
                self._stepper = EquationStepper(plant, self._timestep)
            else:
                model = shared if plant.changes is None else shared.copy()
                self._stepper = PhysicsStepper(plant.system, model, mujoco.MjData(model))
        if plant is not self._plant:
            self._stepper.write(plant)
        self._plant = plant
        return self._stepper
