"""Timesteps of a model with friction of its drives, whose limit depends on speed and torques.

MuJoCo takes the limit of a joint's dry friction from the model. Here it is written there before
each timestep, from the torques and speeds as it begins.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple

import mujoco
import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from grosmc_mj.ground.compilation.compiler import compile_c
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.structures import Vector, pointer, structure_at, structure_of
from grosmc_mj.mechanics.machine.drive_friction import NUMBERS, drive_frictions, friction_limit
from grosmc_mj.mechanics.physics.dry_friction import constraint_of
from grosmc_mj.simulation.guard import c_address
from grosmc_mj.simulation.kernel import READ, STEP

# Row of each part: its numbers; softness and damping of its constraint, see ``constraint_of``.
_FRICTION = np.dtype([(name, np.float64) for name in (*NUMBERS, "softness", "damping")])


class FrictionRun(NamedTuple):
    """A model, its state, and the friction of its drives.

    ``model`` and ``data`` are Python objects where it is not compiled, else addresses; so are the
    functions. The arrays are those of model and data, (nv,).

    Attributes:
        forward: MuJoCo's ``mj_forward``: (model, data).
        step: MuJoCo's ``mj_step``: (model, data).
        read: MuJoCo's ``mj_getState``: (model, data, address, kind of state).
        model: mjModel.
        data: mjData.
        parts: Rows of ``_FRICTION``.
        dofs: Degree of freedom of each part.
        limit: Limits of dry friction, which are written.
        damping: Damping of the joints.
        v: Speeds.
        acceleration: Accelerations.
        motor: Torques of the actuators.
        smooth: Torques of everything but constraints.
        constraint: Torques of all constraints.
    """

    forward: Annotated[Any, types.FunctionType(STEP)]
    step: Annotated[Any, types.FunctionType(STEP)]
    read: Annotated[Any, types.FunctionType(READ)]
    model: Annotated[Any, types.int64]
    data: Annotated[Any, types.int64]
    parts: Annotated[Any, types.Array(numba.from_dtype(_FRICTION), 1, "C")]
    dofs: Annotated[NDArray[np.int64], types.Array(types.int64, 1, "C")]
    limit: Vector
    damping: Vector
    v: Vector
    acceleration: Vector
    motor: Vector
    smooth: Vector
    constraint: Vector


@jitable
def friction_step(r: FrictionRun) -> None:
    """Write the limits of dry friction and make a timestep."""
    # Torques of this state and input; MuJoCo's step computes them too late.
    r.forward(r.model, r.data)
    for k in range(len(r.dofs)):
        p = r.parts[k]
        i = r.dofs[k]
        v = float(r.v[i])
        motor = float(r.motor[i])
        largest = float(r.limit[i])

        # Friction is the part of the constraints that the solver has for this acceleration.
        friction = -(float(r.acceleration[i]) + p.damping * v) / p.softness
        friction = max(-largest, min(largest, friction))

        # Damping of a joint is friction, not a load.
        load = float(r.smooth[i]) - motor + float(r.damping[i]) * v
        load += float(r.constraint[i]) - friction
        r.limit[i] = friction_limit(v, motor, load, p)
    r.step(r.model, r.data)


class FrictionStepper:
    """Moves an mjData whose model has friction of its drives.

    Args:
        model: Compiled model, which nobody else steps: the limits are written into it.
        data: State that is moved.

    Attributes:
        address: Address of its ``FrictionRun``, the first argument of the compiled functions.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        dofs: list[int] = []
        rows: list[tuple[float, ...]] = []
        for dof, numbers in drive_frictions(model):
            dofs.append(dof)
            rows.append((*numbers, *constraint_of(model, dof)))

        run = FrictionRun(
            forward=mujoco.mj_forward,
            step=mujoco.mj_step,
            read=mujoco.mj_getState,
            model=model,
            data=data,
            parts=np.array(rows, _FRICTION),
            dofs=np.array(dofs, np.int64),
            limit=model.dof_frictionloss,
            damping=model.dof_damping,
            v=data.qvel,
            acceleration=data.qacc,
            motor=data.qfrc_actuator,
            smooth=data.qfrc_smooth,
            constraint=data.qfrc_constraint,
        )
        names = _FRICTION.names or ()
        named_rows = [
            SimpleNamespace(**dict(zip(names, row, strict=True))) for row in run.parts.tolist()
        ]
        self._uncompiled = run._replace(parts=named_rows)
        self._limit_at_rest = run.limit.copy()

        # The structure has the addresses of the arrays of the run.
        self._run = run._replace(
            forward=c_address("mj_forward"),
            step=c_address("mj_step"),
            read=c_address("mj_getState"),
            model=model._address,
            data=data._address,
        )
        self._structure = structure_of(self._run)
        self.address = self._structure.ctypes.data

    def restart(self) -> None:
        """Write the limits of unloaded joints at rest, with which every run begins."""
        self._run.limit[:] = self._limit_at_rest

    def advance(self) -> None:
        """Make a timestep."""
        friction_step(self._uncompiled)


_run_at = structure_at(FrictionRun)


# One compiled function serves all models.
@cache
def compiled_step() -> Any:
    """Compile a step to a C function of the address of a ``FrictionRun``, see ``kernel.STEP``."""

    def entry(run: int, _data: int) -> None:
        friction_step(_run_at(pointer(run)))

    return compile_c(entry, *STEP.args)


@cache
def compiled_read() -> Any:
    """Compile a reading of mjSTATE_FULLPHYSICS of a ``FrictionRun``, see ``kernel.READ``."""

    def entry(run: int, _data: int, row: int, kind: int) -> None:
        r = _run_at(pointer(run))
        r.read(r.model, r.data, row, kind)

    return compile_c(entry, *READ.args)
