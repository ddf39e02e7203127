"""The Kinova Jaco arm that dm_control ships, and the references that it tracks."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.output.films.offscreen import without_graphics
from grosmc_mj.theory.control.references import FourierSeries, ReferenceFunction, fourier_series

JOINTS = tuple(f"joint_{i}" for i in range(1, 7))
# The site where the fingers meet, and the body that holds a payload.
TIP = "jaco_hand/pinchsite"
HAND = "jaco_hand/hand"
# An elbow-up pose in the middle of the workspace, away from joint limits and singularities [rad].
HOME = (0.0, 3.6, 1.6, 1.2, 1.9, 0.0)

# Sines: amplitudes and integer multiples of the base frequency for each joint. The wrist can
# accelerate by 3.4 rad/s² (6.8 N m over an armature of 2 kg m²), of which gravity, friction and
# the payload need a half.
_AMPLITUDES = (0.4, 0.25, 0.25, 0.3, 0.3, 0.4)
_MULTIPLES = (1, 2, 1, 2, 1, 2)
_SINE_PERIOD = 8.0

# The figure of eight, in the plane across the arm: half width and half height [m].
_EIGHT = (0.12, 0.06)
_EIGHT_PERIOD = 8.0
# Points of it for inverse kinematics, and harmonics of the Fourier series through them.
_SAMPLES = 48
_HARMONICS = 8


def jaco(timestep: float = 1e-3) -> Robot:
    """The six joints of the arm under torque control, with the hand rigid.

    dm_control drives the joints by velocity servos of 30.5 and 6.8 N m; their place is taken by
    torques within these limits.

    Args:
        timestep: Of physics [s].

    Raises:
        SetupError: If dm_control is not installed.
    """
    try:
        with without_graphics():
            from dm_control.entities.manipulators import kinova
    except ImportError as error:
        raise SetupError(
            "the Jaco arm comes with dm_control, which is not installed: pip install dm_control"
        ) from error
    arm = kinova.JacoArm()
    arm.attach(kinova.JacoHand())
    model: Any = arm.mjcf_model
    _stage(model)
    return Robot.from_mjcf(model, joints=JOINTS, timestep=timestep)


def _stage(model: Any) -> None:
    """A sky, a floor, lights and a camera: the entity has none. Nothing touches the floor.

    The site ``tip`` is where the fingers meet, whose path films draw.
    """
    site = model.find("site", TIP)
    hand = model.find("body", HAND)
    hand.add("site", name="tip", pos=site.pos, group=4)

    model.asset.add(
        "texture",
        name="sky",
        type="skybox",
        builtin="gradient",
        rgb1=(0.93, 0.95, 0.98),
        rgb2=(0.8, 0.85, 0.92),
        width=256,
        height=256,
    )
    model.visual.headlight.set_attributes(ambient=(0.35,) * 3, diffuse=(0.5,) * 3)

    world = model.worldbody
    world.add(
        "geom",
        name="floor",
        type="plane",
        size=(1, 1, 0.1),
        rgba=(0.85, 0.87, 0.9, 1),
        contype=0,
        conaffinity=0,
    )
    world.add("light", name="lamp", pos=(-0.9, -0.7, 2.2), dir=(0.35, 0.3, -1))
    world.add(
        "camera",
        name="fixed",
        pos=(-1.3, -0.3, 0.68),
        xyaxes=(0.403, -0.915, 0.0, 0.227, 0.1, 0.969),
    )


def joint_sines(robot: Robot) -> tuple[ReferenceFunction, FourierSeries]:
    """Sines about the home pose, each joint with its own amplitude, of a common period of 8 s."""
    n = robot.joints
    sine = np.zeros((n, max(_MULTIPLES)))
    sine[range(n), np.array(_MULTIPLES) - 1] = _AMPLITUDES
    series = FourierSeries(2 * math.pi / _SINE_PERIOD, np.array(HOME), np.zeros_like(sine), sine)
    return fourier_series(n, sine.shape[1]), series


def figure_of_eight(robot: Robot, scale: float = 1.0) -> tuple[ReferenceFunction, FourierSeries]:
    """Tip along a figure of eight about its home, the hand's orientation kept.

    Inverse kinematics at samples of the curve gives joint angles, of which a cut Fourier series
    is made: smooth, and with exact derivatives.

    Args:
        robot: The arm.
        scale: Of the curve.

    Raises:
        ArgumentError: If the curve leaves the arm's reach.
    """
    angles = np.arange(_SAMPLES) * (2 * math.pi / _SAMPLES)
    samples = _inverse_kinematics(robot, eight_of_tip(robot, angles, scale))
    series = FourierSeries.through(samples, 2 * math.pi / _EIGHT_PERIOD, _HARMONICS)
    return fourier_series(robot.joints, _HARMONICS), series


def eight_of_tip(robot: Robot, angle: Array, scale: float = 1.0) -> Array:
    """The figure of eight at its angles (N,); returns (N, 3) [m]."""
    width, height = _EIGHT
    across = scale * width * np.sin(angle)
    up = scale * height * np.sin(2 * angle)
    home = _tip(robot, np.array(HOME))
    return home + np.stack([np.zeros_like(angle), across, up], axis=1)


def tip_path(robot: Robot, q: Array) -> Array:
    """Position of the nominal arm's tip at joint angles (N, 6); returns (N, 3) [m]."""
    return np.array([_tip(robot, row) for row in q])


def _tip(robot: Robot, q: Array) -> Array:
    """Position of the tip [m], (3,), at joint angles (6,)."""
    model = robot.plant.model
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    return data.site(TIP).xpos.copy()


def _inverse_kinematics(robot: Robot, points: Array) -> Array:
    """Joint angles that bring the tip to each point in turn, with the orientation of home."""
    from dm_control import mujoco as dm_mujoco
    from dm_control.mujoco.wrapper import MjModel
    from dm_control.utils.inverse_kinematics import qpos_from_site_pose

    physics: Any = dm_mujoco.Physics.from_model(MjModel(robot.plant.model))
    physics.data.qpos[:] = HOME
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    orientation = np.zeros(4)
    mujoco.mju_mat2Quat(orientation, physics.named.data.site_xmat[TIP])

    angles = []
    for point in points:
        result = qpos_from_site_pose(physics, TIP, target_pos=point, target_quat=orientation)
        if not result.success:
            raise ArgumentError(
                f"the arm cannot bring its tip to {np.round(point, 3).tolist()} m as at home: "
                f"{result.err_norm:.2g} m off"
            )
        # The next search begins where this one ended.
        physics.data.qpos[:] = result.qpos
        angles.append(result.qpos)
    return np.array(angles)
