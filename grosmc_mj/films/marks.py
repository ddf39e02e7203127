"""What a film adds to the scene: the ghost, the disturbance as arrows and arcs, the tip's path."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.films.board import Trace
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
# The site whose path is drawn.
_TIP = "tip"
_LINE, _DOT, _APART = 0.0035, 0.0045, 0.022
_LOOKS = 1000
# A longer trail has its older part left out: as many frames.
_TRAIL = 400
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


def trace_site(model: mujoco.MjModel) -> int:
    """Id of the site whose path a film may draw, named ``tip`` or ``.../tip``; -1 if none is."""
    names = [model.site(index).name.split("/")[-1] for index in range(model.nsite)]
    return names.index(_TIP) if _TIP in names else -1


def site_path(model: mujoco.MjModel, site: int, qpos: Array) -> Array:
    """Where a site is at positions (N, nq); returns (N, 3)."""
    data, path = mujoco.MjData(model), np.empty((len(qpos), 3))
    for row, q in zip(path, qpos, strict=True):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        row[:] = data.site_xpos[site]
    return path


def add_trace(scene: mujoco.MjvScene, trace: Trace, frame: int) -> None:
    """Draw where the site has been up to a frame as a line, and where it should be as dots.

    Args:
        scene: An updated scene.
        trace: The paths.
        frame: The last one that is drawn.
    """
    been, wanted = trace.been[max(0, frame + 1 - _TRAIL) : frame + 1], trace.wanted
    unit = visible_height(scene.camera[0], trace.been[0])
    if wanted is not None:
        for point in _apart(wanted[:: len(wanted) // _LOOKS + 1], _APART * unit):
            add_dot(scene, _DOT * unit, point, (*red_green_blue(OPTIMUM), 1.0))
    paint = (*red_green_blue(trace.colour), 1.0)
    for start, end in itertools.pairwise(been):
        # A capsule without length has no direction.
        if np.any(start != end):
            add_connector(scene, _GEOM.mjGEOM_CAPSULE, _LINE * unit, start, end, paint)


def _apart(path: Array, least: float) -> list[Array]:
    """The points of a path that are this far from all before; its second round adds none."""
    kept = [path[0]]
    for point in path[1:]:
        if np.linalg.norm(np.array(kept) - point, axis=1).min() >= least:
            kept.append(point)
    return kept
