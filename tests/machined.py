"""A servo with parts of a machine, and what MuJoCo makes of it step by step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import BodyEdit, JointEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

# The rotor's inertia, and the torque of the servo's input.
J, GEAR = 0.0577, 0.667
HEAVY = BodyEdit("rotor", mass_scale=1e9)


def servo(*edits: Edit, timestep: float = 1e-4, integrator: Any = "RK4") -> MujocoPlant:
    """The servo without damping, with these edits and parts."""
    free = JointEdit("shaft", damping=0.0)
    return MujocoPlant.load("servo", edits=(free, *edits), timestep=timestep, integrator=integrator)


def stepped(
    plant: MujocoPlant,
    duration: float,
    read: Callable[[mujoco.MjData], object],
    u: Callable[[float], float] | float = 0.0,
    speed: float = 0.0,
    *,
    held: bool = False,
    start: float | None = None,
) -> Array:
    """Readings after each step of an open loop that begins at a speed of all joints [rad/s].

    A held speed is that of the servo's joint; ``start`` is the angle [rad] of the motor behind a
    transmission.
    """
    model = plant.model
    data, rows = mujoco.MjData(model), []
    data.qvel[:] = speed
    if start is not None:
        data.qpos[1] = start
    for _ in range(round(duration / model.opt.timestep)):
        data.ctrl[0] = u(data.time) if callable(u) else u
        if held:
            data.qvel[0] = speed
        mujoco.mj_step(model, data)
        rows.append(read(data))
    assert not data.warning.number.any()
    return np.array(rows, float)
