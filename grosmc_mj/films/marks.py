"""What a film adds to the scene: the ghost, and the disturbance as arrows and arcs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.films.camera import visible_height
from grosmc_mj.report.palette import DISTURBANCE, OPTIMUM, red_green_blue

# Geom groups of the models: what shows the controlled coordinate.
INDICATOR = 2
_GHOST = (*red_green_blue(OPTIMUM), 0.27)
_MARK = (*red_green_blue(DISTURBANCE), 1.0)
# Sizes as parts of the picture's height, so that they read the same from any distance.
_ARROW, _RADIUS, _THICK = 0.30, 0.14, 0.013
# A whole turn would hide where the arc begins.
_SWEEP = math.radians(300)
_SEGMENTS = 28
# Below this part of the largest one there is nothing to draw.
_FAINT = 0.02
# Marks stand nearer to the camera, on the same line of sight, so that nothing hides them.
_NEARER_MARK, _NEARER_GHOST = 0.8, 0.985

_GEOM = mujoco.mjtGeom
_ORIGIN, _UPRIGHT = np.zeros(3), np.eye(3).ravel()


def add_ghost(
    scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, option: mujoco.MjvOption
) -> None:
    """Add the indicators of a pose once more, translucent.

    Args:
        scene: An updated scene.
        model: The model; if it has no geom of the indicators' group, all that moves is drawn.
        data: The ghost's pose, kinematics computed.
        option: A drawing option of the film's own; its groups and flags are set here.
    """
    alone = bool(np.any(model.geom_group == INDICATOR))
    option.geomgroup[:] = [group == INDICATOR or (not alone and group < 3) for group in range(6)]
    option.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = 0
    first = scene.ngeom
    mujoco.mjv_addGeoms(
        model, data, option, mujoco.MjvPerturb(), mujoco.mjtCatBit.mjCAT_DYNAMIC.value, scene
    )
    eye = np.array(scene.camera[0].pos, float)
    for geom in scene.geoms[first : scene.ngeom]:
        geom.rgba[:] = _GHOST
        geom.matid = -1
        geom.specular = geom.shininess = geom.reflectance = 0
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        geom.pos[:] = eye + _NEARER_GHOST * (geom.pos - eye)


def add_wrenches(
    scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, largest: tuple[float, float]
) -> None:
    """Draw ``xfrc_applied``: an arrow for each force, an arc for each torque.

    Both are at the body's centre of mass, where the wrench acts; arrow and arc are as long as
    the force and the torque are large.

    Args:
        scene: An updated scene.
        model: The model.
        data: With the wrenches in ``xfrc_applied``.
        largest: Largest force [N] and largest torque [N m] of the film.
    """
    eye = np.array(scene.camera[0].pos, float)
    for body in range(1, model.nbody):
        force, torque = data.xfrc_applied[body, :3], data.xfrc_applied[body, 3:]
        centre = eye + _NEARER_MARK * (data.xipos[body] - eye)
        unit = visible_height(scene.camera[0], centre)
        if (part := _part(force, largest[0])) > _FAINT:
            tip = centre + force / np.linalg.norm(force) * part * _ARROW * unit
            add_connector(scene, _GEOM.mjGEOM_ARROW, _THICK * unit, centre, tip, _MARK)
        if (part := _part(torque, largest[1])) > _FAINT:
            points = list(_arc(centre, torque, _RADIUS * unit, part * _SWEEP))
            for start, end in itertools.pairwise(points):
                add_connector(scene, _GEOM.mjGEOM_CAPSULE, 0.75 * _THICK * unit, start, end, _MARK)
            ahead = points[-1] - points[-2]
            head = points[-1] + ahead / np.linalg.norm(ahead) * 0.055 * unit
            add_connector(scene, _GEOM.mjGEOM_ARROW, 1.35 * _THICK * unit, points[-1], head, _MARK)


def _part(vector: Array, largest: float) -> float:
    """Length of a vector as a part of the largest one."""
    return float(np.linalg.norm(vector)) / largest if largest else 0.0


def _arc(centre: Array, torque: Array, radius: float, sweep: float) -> Iterator[Array]:
    """Points of an arc about a torque's axis, from the top, right-handed."""
    axis = torque / np.linalg.norm(torque)
    up = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = up - (up @ axis) * axis
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    for angle in np.linspace(0.0, sweep, _SEGMENTS):
        yield centre + radius * (math.cos(angle) * first + math.sin(angle) * second)


def add_dot(
    scene: mujoco.MjvScene, radius: float, centre: Array, rgba: tuple[float, float, float, float]
) -> None:
    """Add a small sphere; a full scene has no room for more."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    size, paint = np.full(3, radius), np.array(rgba, np.float32)
    mujoco.mjv_initGeom(geom, _GEOM.mjGEOM_SPHERE, size, centre, _UPRIGHT, paint)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    scene.ngeom += 1


def add_connector(
    scene: mujoco.MjvScene,
    kind: Any,
    width: float,
    start: Array,
    end: Array,
    rgba: tuple[float, float, float, float],
) -> None:
    """Add one geom from a point to another; a full scene has no room for more."""
    if scene.ngeom >= scene.maxgeom:
        return
    if kind == _GEOM.mjGEOM_ARROW:
        # MuJoCo draws an arrow half as long as a connector of any other kind.
        end = 2 * end - start
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.ones(3), _ORIGIN, _UPRIGHT, np.array(rgba, np.float32))
    mujoco.mjv_connector(geom, kind, width, start, end)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    scene.ngeom += 1
