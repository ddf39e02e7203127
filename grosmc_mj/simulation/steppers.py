"""Steppers: they move a plant by a timestep, equations by RK4, an mjData by MuJoCo.

A stepper holds one simulation of a plant. Its arrays ``q``, ``v``, ``u``, ``warnings``, ``bodies``,
``forces`` and ``rates`` are views of the state that it moves, and mean the same as in
``kernel.PlantRun``.
``model`` and ``data`` are the arguments of ``advance``: an mjModel and an mjData, or the numbers
and the arrays of equations. Overflows of a diverging run are the caller's to silence, and so are
MuJoCo's warnings.
"""

from __future__ import annotations

import copy
import ctypes
from functools import cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.compiler import compile_c
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.records import pack, record_dtype
from grosmc_mj.ground.compilation.structures import record_at
from grosmc_mj.mechanics.machine.drive_friction import has_drive_friction
from grosmc_mj.mechanics.physics.hidden_states import starts
from grosmc_mj.simulation.drive_friction import FrictionStepper, compiled_read, compiled_step
from grosmc_mj.simulation.guard import c_address, cannot_step
from grosmc_mj.simulation.kernel import STEP, PlantRun
from grosmc_mj.theory.plants import Plant, System
from grosmc_mj.theory.plants.runge_kutta import runge_kutta_step

# A state beyond this bound has diverged; it is MuJoCo's own.
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
        self._system = plant.system
        self._step = _step_of(plant.system)
        self._block = np.zeros(1, _block_dtype(plant.system))
        self._block["h"] = timestep

        # The same memory as attributes, for plain Python.
        arrays = {name: self._block[name][0] for name in self._block.dtype.names or ()}
        arrays["h"] = timestep
        self.data = SimpleNamespace(**arrays)
        self.q = self.data.x
        self.v = np.zeros(0)
        self.u = self.data.u
        self.warnings = self.data.warnings
        self.forces = self.data.w.reshape(-1, 6)
        self.bodies = np.arange(len(self.forces))
        self.rates = self.data.rates

        self.model = plant.parameters
        # It refuses parameters that are no numbers.
        self._numbers_dtype = record_dtype(plant.parameters)
        self._numbers = pack(plant.parameters)

    def write(self, plant: Any) -> None:
        """Give the equations the numbers of a plant."""
        if plant.parameters is not self.model:
            self.model = plant.parameters
            self._numbers[:] = pack(plant.parameters)

    def restart(self, x0: Array) -> None:
        """Go to a start, (n,), with neither input nor disturbance."""
        self.q[:] = x0
        self.u[:] = 0.0
        self.forces[:] = 0.0
        self.rates[:] = 0.0
        self.warnings[:] = 0

    def advance(self, model: Any, data: Any) -> None:
        """Make one step of RK4."""
        try:
            self._step(model, data)
        except (ArithmeticError, ValueError):  # where C goes on with infinities and NaN
            data.warnings[0] = 1

    def read(self, state: Array) -> None:
        """Write nothing: equations have no mjSTATE_FULLPHYSICS."""

    def compiled(self) -> PlantRun:
        """Plant in a run of compiled code: addresses of a step, the numbers and the state."""
        return plant_run(
            self,
            step=_compiled_step(self._system, self._numbers_dtype).address,
            # Never called: there is nothing to read.
            read=c_address("mj_getState"),
            model=self._numbers.ctypes.data,
            data=self._block.ctypes.data,
        )


def _block_dtype(system: System) -> np.dtype[Any]:
    """Memory of a step of equations: timestep, state, input, disturbances and scratch."""
    n = len(system.states)
    sizes = {
        "x": n,
        "u": len(system.inputs),
        "w": 6 * len(system.bodies),
        "rates": n,
        "slope": n,
        "stage": n,
        "total": n,
    }
    arrays = [(name, np.float64, (size,)) for name, size in sizes.items()]
    return np.dtype([("h", np.float64), *arrays, ("warnings", np.int32, (2,))])


# One compiled function serves all steppers of a system.
@cache
def _step_of(system: System) -> Any:
    """Jitable (p, d): one step of RK4 of the equations with numbers p in such a block d."""
    rk4 = runge_kutta_step(system)
    n = len(system.states)
    largest = LARGEST

    @jitable
    def step(p: Any, d: Any) -> None:
        x = d.x
        rk4(x, d.u, d.w, d.rates, p, d.h, d.slope, d.stage, d.total)
        for i in range(n):
            if not abs(x[i]) < largest:
                d.warnings[0] = 1

    return step


@cache
def _compiled_step(system: System, numbers_dtype: np.dtype[Any]) -> Any:
    """Compile a step to a C function of the addresses of the numbers and the block."""
    step = _step_of(system)
    block_dtype = _block_dtype(system)

    def at(numbers: int, block: int) -> None:
        step(record_at(numbers, numbers_dtype), record_at(block, block_dtype))

    return compile_c(at, *STEP.args)


class PhysicsStepper:
    """Moves an mjData by MuJoCo.

    Args:
        system: System with the names of the joints, and of the bodies that wrenches act on.
        model: Compiled model; the friction of drives is written into it at each step.
        data: State that is moved; it may belong to the caller.
    """

    def __init__(
        self,
        system: System,
        model: mujoco.MjModel,
        data: mujoco.MjData,
    ) -> None:
        n = system.degrees_of_freedom
        self._system = system
        self.model = model
        self.data = data
        self.q = data.qpos[:n]
        self.v = data.qvel[:n]
        self.u = data.ctrl
        self.warnings = _warning_counts(data)
        self.forces = data.xfrc_applied
        self.bodies = np.array([model.body(name).id for name in system.bodies], np.int64)
        self.rates = np.zeros(0)

        self._friction = FrictionStepper(model, data) if has_drive_friction(model) else None

        self.size = mujoco.mj_stateSize(model, _FULL_PHYSICS)
        # Without hidden states it is the time and the state, which a row has anyway.
        self.recorded_size = 0 if self.size == 1 + 2 * n else self.size

    def write(self, plant: Any) -> None:
        """Write the edits of a plant, which shares this model, into it."""
        plant.write_edits(self.model, self.data)

    def restart(self, x0: Array) -> None:
        """Reset the mjData to a start, (n,)."""
        mujoco.mj_resetData(self.model, self.data)
        if self._friction is not None:
            self._friction.restart()
        n = len(self.q)
        self.q[:] = x0[:n]
        self.v[:] = x0[n:]
        # Coordinates that parts of a machine add start where the joints are.
        if self.model.nq > n:
            qpos, qvel = starts(self.model, self._system, np.array(x0, float)[None])
            self.data.qpos[:] = qpos[0]
            self.data.qvel[:] = qvel[0]

    def advance(self, model: Any, data: Any) -> None:
        """Make one step of MuJoCo."""
        try:
            if self._friction is not None:
                self._friction.advance()
            else:
                mujoco.mj_step(model, data)
        except mujoco.FatalError as error:
            raise cannot_step(str(error)) from error

    def read(self, state: Array) -> None:
        """Write mjSTATE_FULLPHYSICS as it is now, (size,)."""
        mujoco.mj_getState(self.model, self.data, state, _FULL_PHYSICS)

    def compiled(self) -> PlantRun:
        """Plant in a run of compiled code: addresses of MuJoCo's step, the mjModel and mjData."""
        if self._friction is not None:
            return plant_run(
                self,
                step=compiled_step().address,
                read=compiled_read().address,
                model=self._friction.address,
                data=self.data._address,
            )
        return plant_run(
            self,
            step=c_address("mj_step"),
            read=c_address("mj_getState"),
            model=self.model._address,
            data=self.data._address,
        )


def _warning_counts(data: mujoco.MjData) -> Any:
    """Counts of MuJoCo's warnings, in every other entry; between two is data of the last one."""
    counts = data.warning.number
    numbers = (ctypes.c_int32 * (2 * len(counts) - 1)).from_address(counts.ctypes.data)
    return np.ctypeslib.as_array(numbers)


Stepper = EquationStepper | PhysicsStepper


def plant_run(stepper: Stepper, *, step: Any, read: Any, model: Any, data: Any) -> PlantRun:
    """Plant of a stepper in a run, with functions and their arguments, see ``PlantRun``."""
    return PlantRun(
        step=step,
        read=read,
        model=model,
        data=data,
        q=stepper.q,
        v=stepper.v,
        u=stepper.u,
        warnings=stepper.warnings,
        bodies=stepper.bodies,
        forces=stepper.forces,
        rates=stepper.rates,
    )


def shared_model(plant: Any) -> Any:
    """Model or system that the plants of one stepper share."""
    if plant.kind != "physics":
        return plant.system
    return plant.shared


class Steppers:
    """Steppers of one thread: plants of one model share one mjModel and one mjData.

    Args:
        timestep: Timestep of equations [s]; a model in MuJoCo has its own.
    """

    def __init__(self, timestep: float) -> None:
        self._timestep = timestep
        self._shared: Any = None
        self._plant: Any = None
        self._stepper: Any = None

    def of(self, plant: Any) -> Stepper:
        """Stepper of a plant, to be restarted first; valid until the next call."""
        shared = shared_model(plant)
        if shared is not self._shared:
            self._shared = shared
            self._plant = None
            self._stepper = self._new(plant)
        if plant is not self._plant:
            self._stepper.write(plant)
            self._plant = plant
        return self._stepper

    def _new(self, plant: Any) -> Stepper:
        """Stepper for all plants that share the model of this one."""
        if plant.kind != "physics":
            return EquationStepper(plant, self._timestep)
        model = plant.stepped_model()
        if model is plant.shared and has_drive_friction(model):
            # Each thread writes its own limits of friction.
            model = copy.copy(model)
        return PhysicsStepper(plant.system, model, mujoco.MjData(model))
