"""Nominal model of a robot in MuJoCo: the dynamics that its laws know, for whole trajectories."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edits import write_inertia
from grosmc_mj.mechanics.physics.files import compile_spec
from grosmc_mj.mechanics.physics.mjdata import forward

_WITHOUT = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    | mujoco.mjtDisableBit.mjDSBL_CONTACT
    | mujoco.mjtDisableBit.mjDSBL_SENSOR
)


def nominal_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile the model of a robot with its dynamics only: no looks or contacts.

    Bodies that do not move against each other are one, which leaves the dynamics as they are
    and makes them fast. There is no fluid in it: no law knows of one.

    Args:
        spec: The robot, not changed.
    """
    full = compile_spec(spec)
    lean = spec.copy()
    lean.option.enableflags = 0
    lean.option.density = 0.0
    lean.option.viscosity = 0.0
    lean.option.disableflags |= int(_WITHOUT)
    for part in (*lean.keys, *lean.sensors, *lean.tendons, *lean.excludes):
        lean.delete(part)

    # The effect of gravcomp depends on each body.
    if np.any(full.body_gravcomp):
        return compile_spec(lean)

    for index, body in enumerate(lean.bodies[1:], start=1):
        write_inertia(body, full.body_mass[index], full, index)
    for part in (*lean.geoms, *lean.sites, *lean.cameras, *lean.lights):
        lean.delete(part)
    lean.compiler.fusestatic = True
    return compile_spec(lean)


def gears(model: mujoco.MjModel) -> Array:
    """Torque or force at its joint for one unit of each ideal input of a model, (m,)."""
    return model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0]


def inertia(model: mujoco.MjModel, q: ArrayLike) -> Array:
    """M(q) of a nominal model with the armature of joints and inputs, (n, n)."""
    n = model.nv
    data = forward(model, np.append(q, np.zeros(n)))
    M = np.zeros((n, n))
    mujoco.mj_fullM(model, data, M)
    return M


def bias(model: mujoco.MjModel, q: ArrayLike, dq: ArrayLike) -> Array:
    """h(q, q') - passive of a nominal model, (n,): see ``rigid_bodies.inverse_dynamics``."""
    data = forward(model, np.append(q, dq))
    return data.qfrc_bias - data.qfrc_passive
