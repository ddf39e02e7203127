"""The camera's place: as the model has it, or further back if something would leave the picture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from grosmc_mj.arrays import Array

# The part of the picture, from its middle, that what moves may fill.
_MARGIN = 0.92
# Further back than this [m] nothing can be told apart.
_FURTHEST = 60.0
# Width over height of a window as it opens.
_WINDOW = 1.5
_ROOM = 1.4


class Placement(NamedTuple):
    """How far the camera is moved from its place in the model, along its own axes [m]."""

    right: float = 0.0
    up: float = 0.0
    back: float = 0.0

    def apply(self, scene: mujoco.MjvScene) -> None:
        """Move the cameras of an updated scene."""
        for camera in scene.camera:
            axes = _axes(camera)
            camera.pos[:] = camera.pos + np.array(self) @ axes


def _axes(camera: Any) -> Array:
    """The camera's right, up and back, in world axes, (3, 3)."""
    forward, up = np.array(camera.forward, float), np.array(camera.up, float)
    return np.array([np.cross(forward, up), up, -forward])


def visible_height(camera: Any, point: Array) -> float:
    """Height of what the picture shows at the distance of a point [m]."""
    depth = -(_axes(camera)[2] @ (np.asarray(point, float) - camera.pos))
    return float((camera.frustum_top - camera.frustum_bottom) / camera.frustum_near * depth)


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
    names = [model.camera(i).name for i in range(model.ncam)]
    camera = names.index("fixed") if "fixed" in names else 0
    axes = data.cam_xmat[camera].reshape(3, 3).T
    eye = data.cam_xpos[camera] + np.array(place(model, camera, [data], _WINDOW)) @ axes
    # Motors of a machine move without anything to see.
    moving = [
        body
        for body in range(1, model.nbody)
        if model.body_weldid[body] != 0 and model.body_geomnum[body]
    ]
    depth = -float(axes[2] @ (data.xipos[moving].mean(axis=0) - eye))
    forward = -axes[2]
    fields = (model.cam_fovy[camera], model.vis.global_.fovy)
    own, wide = (math.tan(math.radians(field) / 2) for field in fields)
    free.type = mujoco.mjtCamera.mjCAMERA_FREE
    free.lookat[:] = eye + depth * forward
    free.distance = depth * own / wide
    free.azimuth = math.degrees(math.atan2(forward[1], forward[0]))
    free.elevation = math.degrees(math.asin(forward[2]))
    if mujoco.mjtJoint.mjJNT_SLIDE in model.jnt_type:
        free.type = mujoco.mjtCamera.mjCAMERA_TRACKING
        free.trackbodyid = moving[0]
        # Its centre of mass is in the middle now, which is low in a cart with a pole.
        free.distance *= _ROOM


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
    scene, eye, option = mujoco.MjvScene(model, 1000), mujoco.MjvCamera(), mujoco.MjvOption()
    free = camera < 0
    if free:
        mujoco.mjv_defaultFreeCamera(model, eye)
    else:
        eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
    seen, slope = [], 1.0
    for data in poses:
        mujoco.mjv_updateScene(
            model, data, option, None, eye, mujoco.mjtCatBit.mjCAT_STATIC.value, scene
        )
        view = scene.camera[0]
        slope = float((view.frustum_top - view.frustum_bottom) / 2 / view.frustum_near)
        seen.append((_corners(model, data) - np.array(view.pos, float)) @ _axes(view).T)
    right, up, back = np.concatenate(seen).T
    slopes = {"right": _MARGIN * slope * aspect, "up": _MARGIN * slope}
    extents = {"right": right, "up": up}
    # In view at a distance -back: |right| <= slope * -back, and so for up.
    if not free and all(np.all(np.abs(extents[side]) <= slopes[side] * -back) for side in slopes):
        return Placement()
    needed, moves = -np.inf if free else 0.0, {}
    for side, tangent in slopes.items():
        most = float((extents[side] + tangent * back).max())
        least = float((extents[side] - tangent * back).min())
        needed = max(needed, (most - least) / (2 * tangent))
        moves[side] = (most + least) / 2
    return Placement(moves["right"], moves["up"], min(needed, _FURTHEST))


def _corners(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Corners of the boxes around the drawn geoms of moving bodies, in world axes, (n, 3)."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    found = []
    for geom in range(model.ngeom):
        if model.body_weldid[model.geom_bodyid[geom]] == 0 or model.geom_group[geom] > 2:
            continue
        centre, half = np.split(model.geom_aabb[geom], 2)
        rotation = data.geom_xmat[geom].reshape(3, 3)
        found.append(data.geom_xpos[geom] + (centre + signs * half) @ rotation.T)
    return np.concatenate(found) if found else np.zeros((1, 3))
