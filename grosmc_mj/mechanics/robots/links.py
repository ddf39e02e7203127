"""Links of a robot's compiled model, as the numbers of ``RigidBodies``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.robots.nominal import gears
from grosmc_mj.mechanics.robots.rigid_bodies import (
    AXIS,
    MOMENT,
    OFFSET,
    WEIGHTLESS,
    RigidBodies,
)


@dataclass(frozen=True)
class _Frame:
    """Place of a body in a link that it is fixed to.

    Attributes:
        link: Index of the link.
        rotation: Rotation from axes of the body to those of the link, (3, 3).
        origin: Origin of the body in the link [m], (3,).
    """

    link: int
    rotation: Array
    origin: Array

    def moved(self, position: Array, quaternion: Array) -> _Frame:
        """Frame of a body at a position and orientation in this one."""
        return _Frame(
            self.link,
            self.rotation @ _rotation(quaternion),
            self.origin + self.rotation @ position,
        )


def rigid_bodies(model: mujoco.MjModel) -> RigidBodies:
    """Read the links of a model: bodies that are fixed to each other are one link.

    Args:
        model: A tree of n hinges and slides with linear dampers and springs, and of a joint one
            ideal actuator at most. Contacts, limits, dry friction and fluids are not read.
    """
    n = model.njnt
    vectors = np.zeros((n, 4, 3))
    mounting = np.zeros((n, 3, 3))
    inertia = np.zeros((n, 3, 3))
    mass = np.zeros(n)
    weightless = np.zeros(n)
    before = np.zeros(n)

    frames = [_Frame(n, np.eye(3), np.zeros(3))]
    for body in range(1, model.nbody):
        parent = frames[model.body_parentid[body]]
        frame = parent.moved(model.body_pos[body], model.body_quat[body])
        first = model.body_jntadr[body]
        for joint in range(first, first + model.body_jntnum[body]):
            anchor = model.jnt_pos[joint]
            before[joint] = frame.link
            mounting[joint] = frame.rotation
            vectors[joint, OFFSET] = frame.origin + frame.rotation @ anchor
            vectors[joint, AXIS] = model.jnt_axis[joint]
            frame = _Frame(joint, np.eye(3), -anchor)
        frames.append(frame)
        if frame.link == n:
            # Fixed to the ground.
            continue

        own_mass = model.body_mass[body]
        borne = model.body_gravcomp[body] * own_mass
        centre = frame.origin + frame.rotation @ model.body_ipos[body]
        axes = frame.rotation @ _rotation(model.body_iquat[body])
        mass[frame.link] += own_mass
        weightless[frame.link] += borne
        vectors[frame.link, MOMENT] += own_mass * centre
        vectors[frame.link, WEIGHTLESS] += borne * centre
        inertia[frame.link] += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia[frame.link] += own_mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))

    drives = _drives(model)
    return RigidBodies(
        before=before,
        slides=(model.jnt_type == int(mujoco.mjtJoint.mjJNT_SLIDE)).astype(float),
        rest=model.qpos0.copy(),
        vectors=vectors,
        mounting=mounting,
        inertia=inertia,
        mass=mass,
        weightless=weightless,
        armature=drives.armature,
        damping=drives.damping,
        stiffness=model.jnt_stiffness.copy(),
        spring=model.qpos_spring.copy(),
        gear=drives.gear,
        gravity=model.opt.gravity.copy(),
    )


class _Drives(NamedTuple):
    """Gear, damping and armature of each joint with its input, as ``RigidBodies``."""

    gear: Array
    damping: Array
    armature: Array


def _drives(model: mujoco.MjModel) -> _Drives:
    """Read the joints and inputs of a model; an input's damping and armature are at its shaft."""
    driven = model.actuator_trnid[:, 0]
    squared = model.actuator_gear[:, 0] ** 2
    drives = _Drives(np.ones(model.njnt), model.dof_damping.copy(), model.dof_armature.copy())
    drives.gear[driven] = gears(model)
    drives.damping[driven] += squared * model.actuator_damping
    drives.armature[driven] += squared * model.actuator_armature
    return drives


def _rotation(quaternion: Array) -> Array:
    """Rotation matrix of a unit quaternion, (3, 3)."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
