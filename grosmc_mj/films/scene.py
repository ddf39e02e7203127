"""The scene of a film: the place of the camera, and the marks that are added to MuJoCo's scene.

The camera is the model's own, further back if a body would not fit. The marks are the ghost and the
disturbance as arrows and arcs.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.results.palette import DISTURBANCE, OPTIMUM, red_green_blue

# Id of MuJoCo's own camera, which shows the whole model from above.
FREE_CAMERA = -1
# Part of the picture, from its middle, that moving bodies may fill.
_FILLED = 0.92
# Largest move back [m]: from further away nothing can be told apart.
_FURTHEST = 60.0
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
# Geom group of the models' indicators, which show the controlled coordinates.
INDICATOR = 2
_GHOST = (*red_green_blue(OPTIMUM), 0.27)
_WRENCH = np.array([*red_green_blue(DISTURBANCE), 1.0], np.float32)
# Length of an arrow, radius of an arc, length of its head and thickness, as parts of the picture's
# height, so that they read the same from any distance.
_ARROW = 0.30
_RADIUS = 0.14
_HEAD = 0.055
_THICK = 0.013
# Sweep of the arc of the largest torque: a whole turn would hide where it begins.
_SWEEP = math.radians(300)
_SEGMENTS = 28
# A smaller part of the largest one is not drawn.
_FAINT = 0.02
# Marks stand nearer to the camera, on the same line of sight, so that nothing hides them.
_NEARER_MARK = 0.8
_NEARER_GHOST = 0.985

_GEOM = mujoco.mjtGeom


def camera_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """Names of the cameras of a model."""
    return tuple(model.camera(i).name for i in range(model.ncam))


def default_camera(model: mujoco.MjModel) -> int:
    """Id of the camera that moves along with a body, else of ``fixed``.

    Without these, the first that stands still, since one on a hand would not show the hand;
    ``FREE_CAMERA`` if there is none.
    """
    tracking = model.cam_mode == mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    fixed = np.array(camera_names(model)) == "fixed"
    still = model.body_weldid[model.cam_bodyid] == 0
    for kind in (tracking, fixed, still):
        cameras = np.flatnonzero(kind)
        if len(cameras):
            return int(cameras[0])
    return FREE_CAMERA


def place(
    model: mujoco.MjModel,
    camera: int,
    states: Array,
    aspect: float,
) -> Array:
    """Find the least move of a camera that keeps every moving body in the picture.

    Nothing is moved if all is in view from the camera's own place, nor is MuJoCo's own camera.
    Otherwise the camera goes back along its line of sight and, in its own plane, to the middle.

    Args:
        model: Model.
        camera: Id of the camera.
        states: Full states of the film, or some of them, (N, size).
        aspect: Width of the picture over its height.

    Returns:
        Move to its right, up and back [m], (3,).
    """
    if camera == FREE_CAMERA:
        return np.zeros(3)

    data = mujoco.MjData(model)
    corners = []
    for state in states:
        pose(model, data, state)
        axes = data.cam_xmat[camera].reshape(3, 3)
        corners.append((_corners(model, data) - data.cam_xpos[camera]) @ axes)
    points = np.concatenate(corners)
    aside = points[:, :2]
    distance = -points[:, 2:]

    # At a distance d, |right| and |up| are in view up to slopes * d.
    half = math.tan(math.radians(model.cam_fovy[camera]) / 2)
    slopes = _FILLED * half * np.array([aspect, 1])
    if np.all(np.abs(aside) <= slopes * distance):
        return np.zeros(3)
    most = (aside - slopes * distance).max(axis=0)
    least = (aside + slopes * distance).min(axis=0)
    back = np.clip(((most - least) / (2 * slopes)).max(), 0.0, _FURTHEST)
    return np.array([*(most + least) / 2, back])


def pose(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> None:
    """Put a stored state into the data and compute the positions for drawing."""
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_fwdPosition(model, data)


def _corners(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Corners of the boxes around the drawn geoms of moving bodies, in world axes, (n, 3)."""
    drawn = (model.body_weldid[model.geom_bodyid] != 0) & (model.geom_group <= 2)
    centre, half = np.split(model.geom_aabb[drawn][:, None], 2, axis=2)
    rotation = data.geom_xmat[drawn].reshape(-1, 3, 3)
    corners = (centre + _CORNERS * half) @ rotation.transpose(0, 2, 1)
    return (data.geom_xpos[drawn][:, None] + corners).reshape(-1, 3)


def move(scene: mujoco.MjvScene, by: Array) -> None:
    """Move the cameras of an updated scene to their right, up and back [m], (3,)."""
    for camera in scene.camera:
        forward = np.array(camera.forward, float)
        up = np.array(camera.up, float)
        camera.pos[:] = camera.pos + by @ np.array([np.cross(forward, up), up, -forward])


def visible_height(camera: Any, point: Array) -> float:
    """Height that the picture of a scene's camera covers at the distance of a point [m]."""
    depth = np.array(camera.forward, float) @ (np.asarray(point, float) - camera.pos)
    return float((camera.frustum_top - camera.frustum_bottom) / camera.frustum_near * depth)


def _add(
    scene: Any,
    kind: Any,
    width: float,
    start: Array,
    end: Array,
) -> None:
    """Add a geom in the disturbance's colour from a point to another."""
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.ones(3), start, np.eye(3).ravel(), _WRENCH)
    # MuJoCo draws an arrow half as long as a connector of any other kind.
    if kind == _GEOM.mjGEOM_ARROW:
        end = 2 * end - start
    mujoco.mjv_connector(geom, kind, width, start, end)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    scene.ngeom += 1


def add_ghost(scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Add the indicators of a pose once more, translucent.

    Args:
        scene: Updated scene.
        model: Model; if it has no geom of the indicators' group, all that moves is drawn.
        data: Pose of the ghost, kinematics computed.
    """
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0
    option.geomgroup[INDICATOR] = 1
    if INDICATOR not in model.geom_group:
        option.geomgroup[:3] = 1
    option.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = 0
    moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
    first = scene.ngeom
    mujoco.mjv_addGeoms(model, data, option, mujoco.MjvPerturb(), moving, scene)
    eye = np.array(scene.camera[0].pos, float)
    for geom in scene.geoms[first : scene.ngeom]:
        geom.rgba[:] = _GHOST
        geom.matid = -1
        geom.specular = 0
        geom.shininess = 0
        geom.reflectance = 0
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        geom.pos[:] = eye + _NEARER_GHOST * (geom.pos - eye)


def add_wrenches(
    scene: mujoco.MjvScene,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    largest: Array,
) -> None:
    """Draw ``xfrc_applied``: an arrow for each force, an arc for each torque.

    Both are at the body's centre of mass, where the wrench acts; arrow and arc are as long as
    the force and the torque are large.

    Args:
        scene: Updated scene.
        model: Model.
        data: Data with the wrenches in ``xfrc_applied``.
        largest: Largest force [N] and largest torque [N m] of the film, (2,); 0 for none.
    """
    eye = np.array(scene.camera[0].pos, float)
    scale = np.where(largest, largest, 1)[:, None]
    for body in range(model.nbody):
        centre = eye + _NEARER_MARK * (data.xipos[body] - eye)
        unit = visible_height(scene.camera[0], centre)
        force, torque = data.xfrc_applied[body].reshape(2, 3) / scale
        if np.linalg.norm(force) > _FAINT:
            tip = centre + _ARROW * unit * force
            _add(scene, _GEOM.mjGEOM_ARROW, _THICK * unit, centre, tip)
        if np.linalg.norm(torque) > _FAINT:
            arc = centre + _RADIUS * unit * _arc(torque)
            for start, end in itertools.pairwise(arc):
                _add(scene, _GEOM.mjGEOM_CAPSULE, 0.75 * _THICK * unit, start, end)
            ahead = _HEAD * unit * (arc[-1] - arc[-2]) / np.linalg.norm(arc[-1] - arc[-2])
            _add(scene, _GEOM.mjGEOM_ARROW, 1.35 * _THICK * unit, arc[-1], arc[-1] + ahead)


def _arc(torque: Array) -> Array:
    """Points of a right-handed arc of radius 1 about an axis, as long as the axis, (n, 3)."""
    length = np.linalg.norm(torque)
    axis = torque / length
    up = np.array([0.0, 0.0, 1.0])
    if abs(axis[2]) >= 0.9:
        up = np.array([1.0, 0.0, 0.0])
    first = up - (up @ axis) * axis
    first /= np.linalg.norm(first)
    angles = np.linspace(0.0, length * _SWEEP, _SEGMENTS)[:, None]
    return np.cos(angles) * first + np.sin(angles) * np.cross(axis, first)
