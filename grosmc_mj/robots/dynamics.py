"""Inverse dynamics of a nominal model, by MuJoCo, for a law in both engines.

The law of a robot needs M(q), the Coriolis and gravity torques and the passive ones of the model
that it believes in, while the plant is another one. Each run has an mjData of the nominal model
of its own, found by an address in the law's memory; compiled code reaches MuJoCo's C function by
its name. So no address of a process enters what is cached on disk, or a law's parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import llvmlite.binding
import mujoco
import numba
import numpy as np
from numba.core import types
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import array_at, pointer
from grosmc_mj.physics.files import compile_spec
from grosmc_mj.physics.mjdata import mujoco_library, scratch
from grosmc_mj.physics.writing import write_inertia


def _of_model_and_data(name: str) -> Any:
    """MuJoCo's C function of that name, for an mjModel and an mjData."""
    return types.ExternalFunction(name, types.void(types.voidptr, types.voidptr))


# What inverse dynamics needs of ``mj_inverse``, which does twice as much: recursive Newton-Euler.
mj_kinematics, mj_com_pos = _of_model_and_data("mj_kinematics"), _of_model_and_data("mj_comPos")
mj_com_vel, mj_passive = _of_model_and_data("mj_comVel"), _of_model_and_data("mj_passive")
mj_rne = types.ExternalFunction(
    "mj_rne", types.void(types.voidptr, types.voidptr, types.int32, types.voidptr)
)

_WITHOUT = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
)
# Bytes of scratch memory in each mjData: inverse dynamics of a few bodies need less than 2 kB.
_ARENA = 1 << 16


@dataclass(frozen=True)
class InWorkspace:
    """A nominal plant without numbers of its own: the run's workspace has its model."""


# What compiled code finds of it: the addresses of both, of the joints' armature and of arrays.
_ARRAYS = ("qpos", "qvel", "qacc", "qfrc_passive", "qfrc_inverse")
_ARRAYS = (*_ARRAYS, "cinert", "xpos", "xmat", "subtree_com")
WORKSPACE = np.dtype([(name, np.int64) for name in ("model", "data", "armature", *_ARRAYS)])


class NominalData:
    """The nominal model and an mjData of it, for one run of a law."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        arrays = [getattr(self._data, name).ctypes.data for name in _ARRAYS]
        armature = model.dof_armature.ctypes.data
        self._addresses = np.array([model._address, self._data._address, armature, *arrays])

    @property
    def address(self) -> float:
        """Where the ``WORKSPACE`` is."""
        return float(self._addresses.ctypes.data)


def nominal_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The model of a robot with its dynamics only: nothing to see, to touch or to actuate.

    Bodies that do not move against each other are one, which leaves the dynamics as they are
    and makes them fast. An mjData has 0.44 MB whatever its model, most of it for statistics of
    MuJoCo's solver; a thread has one at a time.

    Args:
        spec: The robot, not changed.
    """
    lean, full = spec.copy(), compile_spec(spec)
    lean.memory, lean.nuserdata = _ARENA, 0
    lean.option.enableflags = 0
    for flag in _WITHOUT:
        lean.option.disableflags |= int(flag)
    for part in (*lean.keys, *lean.sensors, *lean.tendons, *lean.actuators, *lean.excludes):
        lean.delete(part)
    # What a fluid or gravcomp does depends on each body, and on its geoms.
    if not (lean.option.density or lean.option.viscosity or np.any(full.body_gravcomp)):
        for index, body in enumerate(lean.bodies[1:], start=1):
            write_inertia(body, full.body_mass[index], full, index)
        for part in (*lean.geoms, *lean.sites, *lean.cameras, *lean.lights):
            lean.delete(part)
        lean.compiler.fusestatic = True
    return compile_spec(lean)


def inertia(model: mujoco.MjModel, q: ArrayLike) -> Array:
    """M(q) of a nominal model with the joints' armature, (n, n)."""
    M, data = np.zeros((model.nv, model.nv)), _moving(model, q, np.zeros(model.nv))
    mujoco.mj_fullM(model, data, M)
    return M


def bias(model: mujoco.MjModel, q: ArrayLike, dq: ArrayLike) -> Array:
    """h(q, q') - passive of a nominal model, (n,): see ``inverse_dynamics``."""
    data = _moving(model, q, dq)
    return data.qfrc_bias - data.qfrc_passive


def _moving(model: mujoco.MjModel, q: ArrayLike, dq: ArrayLike) -> mujoco.MjData:
    """All that depends on position and velocity."""
    data = scratch(model)
    data.qpos[:], data.qvel[:] = q, dq
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    return data


@cache
def inverse_dynamics(n: int) -> Callable[[float, Any, Any, Any], None]:
    """tau = M(q) a + h(q, q') - passive of a robot of n joints, in Python and in compiled code.

    Returns:
        A function (workspace, x, a, tau) of the address of a ``NominalData``, the state x, (2 n,),
        and the accelerations a, (n,), which writes tau, (n,); tau may be a.
    """
    load_mujoco()

    @numba.njit
    def torque(workspace: float, x: Any, a: Any, tau: Any) -> None:
        arrays = array_at(np.int64(workspace), (1,), WORKSPACE)[0]
        m, d = pointer(arrays.model), pointer(arrays.data)
        armature = array_at(arrays.armature, (n,), np.float64)
        qpos = array_at(arrays.qpos, (n,), np.float64)
        qvel = array_at(arrays.qvel, (n,), np.float64)
        qacc = array_at(arrays.qacc, (n,), np.float64)
        for i in range(n):
            qpos[i] = x[i]
            qvel[i] = x[i + n]
            qacc[i] = a[i]
        mj_kinematics(m, d)
        mj_com_pos(m, d)
        mj_com_vel(m, d)
        mj_passive(m, d)
        result = pointer(arrays.qfrc_inverse)
        mj_rne(m, d, np.int32(1), result)
        # M a + h of the bodies, what drives the joints, and what acts without an input.
        bodies = array_at(result, (n,), np.float64)
        passive = array_at(arrays.qfrc_passive, (n,), np.float64)
        for i in range(n):
            tau[i] = bodies[i] + armature[i] * qacc[i] - passive[i]

    return torque


@cache
def load_mujoco() -> None:
    """Let compiled code find MuJoCo's C functions by name.

    Raises:
        SetupError: If the library is not where its Python package has it.
    """
    llvmlite.binding.load_library_permanently(str(mujoco_library()))
