"""The camera's place: as the model has it, or further back if something would leave the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from grosmc_mj.arrays import Array

# As MuJoCo counts.
FREE_CAMERA = -1
# The part of the picture, from its middle, that moving bodies may fill.
_FILLED = 0.92
# Further back than this [m] nothing can be told apart.
_FURTHEST = 60.0
# Width over height of a window as it opens.
_WINDOW = 1.5
# A tracking camera looks at a centre of mass, which is low in a cart with a pole.
_ROOM = 1.4
_CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


class Placement(NamedTuple):
    """How far the camera is moved from its place in the model, along its own axes [m]."""

    right: float = 0.0
    up: float = 0.0
    back: float = 0.0

    def apply(self, scene: mujoco.MjvScene) -> None:
        """Move the cameras of an updated scene."""
        for camera in scene.camera:
            camera.pos[:] = camera.pos + np.array(self) @ _axes(camera)


def _axes(camera: Any) -> Array:
    """The camera's right, up and back, in world axes, (3, 3)."""
    forward, up = np.array(camera.forward, float), np.array(camera.up, float)
    return np.array([np.cross(forward, up), up, -forward])


def visible_height(camera: Any, point: Array) -> float:
    """Height of what the picture shows at the distance of a point [m]."""
    depth = -(_axes(camera)[2] @ (np.asarray(point, float) - camera.pos))
    return float((camera.frustum_top - camera.frustum_bottom) / camera.frustum_near * depth)


def camera_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """The cameras of a model."""
    return tuple(model.camera(i).name for i in range(model.ncam))


def default_camera(model: mujoco.MjModel) -> int:
    """Id of ``follow``, if it moves along with a body, else ``fixed``.

    Without these, the first that stands still, since one on a hand would not show the hand;
    ``FREE_CAMERA`` if there is none.
    """
    tracking = model.cam_mode == mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    names = camera_names(model)
    if "follow" in names and tracking[names.index("follow")]:
        return names.index("follow")
    if "fixed" in names:
        return names.index("fixed")
    still = model.body_weldid[model.cam_bodyid] == 0
    return int(np.argmax(still)) if np.any(still) else FREE_CAMERA


def place(
    model: mujoco.MjModel, camera: int, poses: Iterable[mujoco.MjData], aspect: float
) -> Placement:
    """The least move of the camera that keeps every moving body in the picture.

    Nothing is moved if all is in view from the model's own place, whose picture is the one that
    the model's author meant. Otherwise the camera goes back along its line of sight and, in its
    own plane, to the middle of what there is to see. The free camera, which no author has
    placed, goes there in any case, and nearer too.

    Args:
        model: The model.
        camera: Id of the camera; -1 for the free one.
        poses: The poses of the film, or some of them; kinematics computed.
        aspect: Width of the picture over its height.
    """
    scene, eye = mujoco.MjvScene(model, 1), mujoco.MjvCamera()
    free = camera == FREE_CAMERA
    if free:
        mujoco.mjv_defaultFreeCamera(model, eye)
    else:
        eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
    view, seen = scene.camera[0], []
    for data in poses:
        mujoco.mjv_updateCamera(model, data, eye, scene)
        seen.append((_corners(model, data) - np.array(view.pos, float)) @ _axes(view).T)
    points = np.concatenate(seen)
    half = float((view.frustum_top - view.frustum_bottom) / 2 / view.frustum_near)
    # At a distance d, |right| and |up| are in view up to slopes * d.
    slopes, aside, distance = _FILLED * half * np.array([aspect, 1]), points[:, :2], -points[:, 2:]
    if not len(points) or (not free and np.all(np.abs(aside) <= slopes * distance)):
        return Placement()
    most = (aside - slopes * distance).max(axis=0)
    least = (aside + slopes * distance).min(axis=0)
    back = float(((most - least) / (2 * slopes)).max())
    right, up = ((most + least) / 2).tolist()
    return Placement(right, up, min(back if free else max(back, 0.0), _FURTHEST))


def _corners(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Corners of the boxes around the drawn geoms of moving bodies, in world axes, (n, 3)."""
    drawn = (model.body_weldid[model.geom_bodyid] != 0) & (model.geom_group <= 2)
    centre, half = np.split(model.geom_aabb[drawn][:, None], 2, axis=2)
    rotation = data.geom_xmat[drawn].reshape(-1, 3, 3)
    corners = (centre + _CORNERS * half) @ rotation.transpose(0, 2, 1)
    return (data.geom_xpos[drawn][:, None] + corners).reshape(-1, 3)


def aim(free: mujoco.MjvCamera, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let a free camera, which the mouse can turn, begin with the picture of the model's own.

    That is the model's camera ``fixed``, else its first; without one nothing is changed. What
    drives about on a slide is followed.

    Args:
        free: The camera of a window.
        model: The model.
        data: Its pose, kinematics computed.
    """
    if model.ncam == 0:
        return
    names = camera_names(model)
    camera = names.index("fixed") if "fixed" in names else 0
    axes = data.cam_xmat[camera].reshape(3, 3).T
    eye = data.cam_xpos[camera] + np.array(place(model, camera, [data], _WINDOW)) @ axes
    # Motors of a machine move without anything to see.
    moving = np.flatnonzero((model.body_weldid != 0) & (model.body_geomnum > 0))
    forward = -axes[2]
    depth = float(forward @ (data.xipos[moving].mean(axis=0) - eye))
    own, wide = np.tan(np.radians([model.cam_fovy[camera], model.vis.global_.fovy]) / 2)
    free.type = mujoco.mjtCamera.mjCAMERA_FREE
    free.lookat[:] = eye + depth * forward
    free.distance = depth * own / wide
    free.azimuth = math.degrees(math.atan2(forward[1], forward[0]))
    free.elevation = math.degrees(math.asin(forward[2]))
    if mujoco.mjtJoint.mjJNT_SLIDE in model.jnt_type:
        free.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        free.trackbodyid = moving[0]
        free.distance *= _ROOM
