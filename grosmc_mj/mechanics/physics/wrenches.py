"""Effect of a wrench on the joints of a model, and the axes of the joints."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mjdata import scratch
from grosmc_mj.theory.plants import Plant


def joint_axes(plant: Plant, x: ArrayLike) -> dict[str, Array]:
    """Return the axis of each joint of the rigid system as a unit vector in world axes, (3,).

    Args:
        plant: The plant.
        x: State, (n,).
    """
    data = _placed(plant, np.asarray(x, float))
    model = plant.rigid.undrawn_model
    return {name: data.xaxis[model.joint(name).id].copy() for name in plant.system.joints}


def generalized_forces(plant: Plant, body: str, states: Sequence[Array]) -> Array:
    """Return Jᵀ of a body's centre of mass: force or torque at each joint by each unit wrench.

    Args:
        plant: The plant; of a machine its rigid system.
        body: Name of the body.
        states: N states, (n,) each.

    Returns:
        (N, joints, 6): for [force, torque] in world axes, in m or 1 for a hinge, in 1 for a slide.
    """
    model = plant.rigid.undrawn_model
    index = model.body(body).id
    effects = []
    for x in states:
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jacBodyCom(model, _placed(plant, x), jacobian[:3], jacobian[3:], index)
        effects.append(jacobian.T)
    return np.array(effects)


def _placed(plant: Plant, x: Array) -> mujoco.MjData:
    """Return an mjData with the bodies and joints of the rigid system where a state has them."""
    model = plant.rigid.undrawn_model
    data = scratch(model)
    data.qpos[:] = x[: model.nq]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data
