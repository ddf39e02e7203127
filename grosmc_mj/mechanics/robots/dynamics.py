"""Dynamics of a robot's nominal model, by MuJoCo, for a law in both engines.

The law of a robot needs M(q), the Coriolis and gravity torques and the passive ones of the model
that it knows, while the plant is another one. Each run has an mjData of the nominal model of its
own, whose address is in the law's memory; compiled code calls MuJoCo's C functions by their names.
So no address of a process enters what is cached on disk, or a law's parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import llvmlite.binding
import mujoco
import numba
import numpy as np
from numba import types
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.structures import array_at, pointer
from grosmc_mj.mechanics.physics.edits import write_inertia
from grosmc_mj.mechanics.physics.files import compile_spec
from grosmc_mj.mechanics.physics.mjdata import forward, mujoco_library
from grosmc_mj.theory.control.matrices import copy

llvmlite.binding.load_library_permanently(str(mujoco_library()))


def _c_function(name: str, *more: Any) -> Any:
    """Declare MuJoCo's C function of a name, for an mjModel, an mjData and more arguments."""
    return types.ExternalFunction(name, types.void(types.voidptr, types.voidptr, *more))


# The stages of ``mj_inverse`` that inverse dynamics needs; it does twice as much.
mj_kinematics = _c_function("mj_kinematics")
mj_com_pos = _c_function("mj_comPos")
mj_com_vel = _c_function("mj_comVel")
mj_passive = _c_function("mj_passive")
mj_rne = _c_function("mj_rne", types.int32, types.voidptr)
mj_crb = _c_function("mj_crb")
mj_factor_m = _c_function("mj_factorM")
mj_solve_m = _c_function("mj_solveM", types.voidptr, types.voidptr, types.int32)

_WITHOUT = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    | mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_SENSOR
)
# Bytes of scratch memory in each mjData: inverse dynamics of a few bodies need less than 2 kB.
_ARENA = 1 << 16


@dataclass(frozen=True)
class InWorkspace:
    """A nominal plant without numbers of its own: the run's workspace has its model."""


# Addresses for compiled code: of both, of the joints' armature and of arrays of the mjData.
_ARRAYS = ("qpos", "qvel", "qacc", "qfrc_passive", "qfrc_inverse")
WORKSPACE = np.dtype([(name, np.int64) for name in ("model", "data", "armature", *_ARRAYS)])


class NominalData:
    """The nominal model and an mjData of it, for one run of a law."""

    def __init__(self, model: mujoco.MjModel) -> None:
        # Kept, for as long as their addresses are in use.
        self._model = model
        self._data = mujoco.MjData(model)
        armature = model.dof_armature.ctypes.data
        arrays = [getattr(self._data, name).ctypes.data for name in _ARRAYS]
        self._addresses = np.array([model._address, self._data._address, armature, *arrays])

    @property
    def address(self) -> float:
        """Address of the ``WORKSPACE``."""
        return float(self._addresses.ctypes.data)


def nominal_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile the model of a robot with its dynamics only: no looks, contacts or actuators.

    Bodies that do not move against each other are one, which leaves the dynamics as they are
    and makes them fast. An mjData has 0.44 MB whatever its model, most of it for statistics of
    MuJoCo's solver; a thread has one at a time.

    Args:
        spec: The robot, not changed.
    """
    full = compile_spec(spec)
    lean = spec.copy()
    lean.memory = _ARENA
    lean.nuserdata = 0
    lean.option.enableflags = 0
    lean.option.disableflags |= int(_WITHOUT)
    for part in (*lean.keys, *lean.sensors, *lean.tendons, *lean.actuators, *lean.excludes):
        lean.delete(part)

    # The effect of a fluid or of gravcomp depends on each body, and on its geoms.
    if lean.option.density or lean.option.viscosity or np.any(full.body_gravcomp):
        return compile_spec(lean)

    for index, body in enumerate(lean.bodies[1:], start=1):
        write_inertia(body, full.body_mass[index], full, index)
    for part in (*lean.geoms, *lean.sites, *lean.cameras, *lean.lights):
        lean.delete(part)
    lean.compiler.fusestatic = True
    return compile_spec(lean)


def inertia(model: mujoco.MjModel, q: ArrayLike) -> Array:
    """M(q) of a nominal model with the joints' armature, (n, n)."""
    n = model.nv
    data = forward(model, np.append(q, np.zeros(n)))
    M = np.zeros((n, n))
    mujoco.mj_fullM(model, data, M)
    return M


def bias(model: mujoco.MjModel, q: ArrayLike, dq: ArrayLike) -> Array:
    """h(q, q') - passive of a nominal model, (n,): see ``inverse_dynamics``."""
    data = forward(model, np.append(q, dq))
    return data.qfrc_bias - data.qfrc_passive


@numba.njit
def vector_at(address: int, n: int) -> Any:
    """View the n numbers at an address."""
    return array_at(address, (n,), np.float64)


@numba.njit
def set_state(w: Any, x: Any, n: int) -> None:
    """Bring the nominal model of a ``WORKSPACE`` to a state, (2 n,), with its passive torques."""
    m = pointer(w.model)
    d = pointer(w.data)
    qpos = vector_at(w.qpos, n)
    qvel = vector_at(w.qvel, n)
    for i in range(n):
        qpos[i] = x[i]
        qvel[i] = x[n + i]

    mj_kinematics(m, d)
    mj_com_pos(m, d)
    mj_com_vel(m, d)
    mj_passive(m, d)


@numba.njit
def inverse_dynamics(
    workspace: float,
    x: Any,
    a: Any,
    tau: Any,
) -> None:
    """Write tau = M(q) a + h(q, q') - passive of a robot, in Python and in compiled code.

    Args:
        workspace: Address of a ``NominalData``.
        x: State, (2 n,).
        a: Accelerations, (n,).
        tau: Torques, (n,); they may take the place of the accelerations.
    """
    n = len(tau)
    w = array_at(np.int64(workspace), (1,), WORKSPACE)[0]
    armature = vector_at(w.armature, n)
    passive = vector_at(w.qfrc_passive, n)
    qacc = vector_at(w.qacc, n)
    bodies = vector_at(w.qfrc_inverse, n)

    set_state(w, x, n)
    copy(a, qacc)
    mj_rne(pointer(w.model), pointer(w.data), np.int32(1), pointer(w.qfrc_inverse))

    # M a + h of the bodies, the motors' inertia, and the torques without an input.
    for i in range(n):
        tau[i] = bodies[i] + armature[i] * qacc[i] - passive[i]


@numba.njit
def forward_dynamics(
    workspace: float,
    x: Any,
    tau: Any,
    a: Any,
) -> None:
    """Write a = M(q)^-1 (tau - h(q, q') + passive), the inverse of ``inverse_dynamics``."""
    n = len(a)
    w = array_at(np.int64(workspace), (1,), WORKSPACE)[0]
    m = pointer(w.model)
    d = pointer(w.data)
    passive = vector_at(w.qfrc_passive, n)
    qacc = vector_at(w.qacc, n)
    force = vector_at(w.qfrc_inverse, n)

    set_state(w, x, n)
    mj_rne(m, d, np.int32(0), pointer(w.qfrc_inverse))
    for i in range(n):
        force[i] = tau[i] - force[i] + passive[i]

    mj_crb(m, d)
    mj_factor_m(m, d)
    mj_solve_m(m, d, pointer(w.qacc), pointer(w.qfrc_inverse), np.int32(1))
    copy(qacc, a)
