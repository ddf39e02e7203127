"""What a film adds to the scene: the ghost, the disturbance as arrows and arcs, the tip's path."""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.films.camera import visible_height
from grosmc_mj.results.palette import DISTURBANCE, OPTIMUM, red_green_blue

# Geom group of the models' indicators, which show the controlled coordinates.
INDICATOR = 2
_GHOST, _DOTS = (*red_green_blue(OPTIMUM), 0.27), (*red_green_blue(OPTIMUM), 1.0)
_FORCE = (*red_green_blue(DISTURBANCE), 1.0)
# Sizes as parts of the picture's height, so that they read the same from any distance.
_ARROW, _RADIUS, _HEAD, _THICK = 0.30, 0.14, 0.055, 0.013
_LINE, _DOT, _APART = 0.0035, 0.0045, 0.022
# A whole turn would hide where the arc begins.
_SWEEP, _SEGMENTS = math.radians(300), 28
# Frames of a path that are drawn: its newest for the line, as many of all for the dots.
_TRAIL, _DOTTED = 400, 1000
# Below this part of the largest one there is nothing to draw.
_FAINT = 0.02
# Marks stand nearer to the camera, on the same line of sight, so that nothing hides them.
_NEARER_MARK, _NEARER_GHOST = 0.8, 0.985

_GEOM = mujoco.mjtGeom


class Trace(NamedTuple):
    """The path of a site.

    Attributes:
        actual: Where it is at each frame, (frames, 3).
        reference: Where the ghost has it at each frame, (frames, 3), or None.
        colour: Of the path so far, red, green and blue from 0 to 1.
    """

    actual: Array
    reference: Array | None
    colour: tuple[float, float, float]


def _add(scene: Any, kind: Any, width: float, rgba: Any, start: Array, end: Any = None) -> None:
    """Add a sphere, or a geom from a point to another; a full scene has no room for more."""
    if scene.ngeom >= scene.maxgeom:
        return
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.full(3, width), start, np.eye(3).ravel(), np.float32(rgba))
    if end is not None:
        # MuJoCo draws an arrow half as long as a connector of any other kind.
        end = 2 * end - start if kind == _GEOM.mjGEOM_ARROW else end
        mujoco.mjv_connector(geom, kind, width, start, end)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    scene.ngeom += 1


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
    first, moving = scene.ngeom, mujoco.mjtCatBit.mjCAT_DYNAMIC.value
    mujoco.mjv_addGeoms(model, data, option, mujoco.MjvPerturb(), moving, scene)
    eye = np.array(scene.camera[0].pos, float)
    for geom in scene.geoms[first : scene.ngeom]:
        geom.rgba[:], geom.matid = _GHOST, -1
        geom.specular = geom.shininess = geom.reflectance = 0
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR
        geom.pos[:] = eye + _NEARER_GHOST * (geom.pos - eye)


def add_wrenches(
    scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, largest: ArrayLike
) -> None:
    """Draw ``xfrc_applied``: an arrow for each force, an arc for each torque.

    Both are at the body's centre of mass, where the wrench acts; arrow and arc are as long as
    the force and the torque are large.

    Args:
        scene: An updated scene.
        model: The model.
        data: With the wrenches in ``xfrc_applied``.
        largest: Largest force [N] and largest torque [N m] of the film, (2,).
    """
    eye = np.array(scene.camera[0].pos, float)
    sizes = np.linalg.norm(data.xfrc_applied.reshape(-1, 2, 3), axis=2)
    shares = np.divide(sizes, largest, out=np.zeros_like(sizes), where=np.asarray(largest) > 0)
    for body in np.flatnonzero(shares.max(axis=1) > _FAINT):
        centre = eye + _NEARER_MARK * (data.xipos[body] - eye)
        unit = visible_height(scene.camera[0], centre)
        force, torque = np.split(data.xfrc_applied[body], 2)
        if shares[body, 0] > _FAINT:
            tip = centre + _ARROW * unit * shares[body, 0] * force / sizes[body, 0]
            _add(scene, _GEOM.mjGEOM_ARROW, _THICK * unit, _FORCE, centre, tip)
        if shares[body, 1] > _FAINT:
            arc = centre + _RADIUS * unit * _arc(torque / sizes[body, 1], shares[body, 1])
            for start, end in itertools.pairwise(arc):
                _add(scene, _GEOM.mjGEOM_CAPSULE, 0.75 * _THICK * unit, _FORCE, start, end)
            ahead = (arc[-1] - arc[-2]) / np.linalg.norm(arc[-1] - arc[-2])
            head = arc[-1] + _HEAD * unit * ahead
            _add(scene, _GEOM.mjGEOM_ARROW, 1.35 * _THICK * unit, _FORCE, arc[-1], head)


def _arc(axis: Array, share: float) -> Array:
    """Points of a part of the arc of radius 1 about an axis, from the top, right-handed, (n, 3)."""
    up = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    first = up - (up @ axis) * axis
    first /= np.linalg.norm(first)
    angles = np.linspace(0.0, share * _SWEEP, _SEGMENTS)[:, None]
    return np.cos(angles) * first + np.sin(angles) * np.cross(axis, first)


def add_trace(scene: mujoco.MjvScene, trace: Trace, frame: int) -> None:
    """Draw where the site has been up to a frame as a line, and where it should be as dots.

    Args:
        scene: An updated scene.
        trace: The paths.
        frame: The last one that is drawn.
    """
    unit = visible_height(scene.camera[0], trace.actual[0])
    if trace.reference is not None:
        for point in _apart(trace.reference[:: len(trace.reference) // _DOTTED + 1], _APART * unit):
            _add(scene, _GEOM.mjGEOM_SPHERE, _DOT * unit, _DOTS, point)
    for start, end in itertools.pairwise(trace.actual[max(0, frame + 1 - _TRAIL) : frame + 1]):
        # A capsule without length has no direction.
        if np.any(start != end):
            _add(scene, _GEOM.mjGEOM_CAPSULE, _LINE * unit, (*trace.colour, 1.0), start, end)


def _apart(path: Array, least: float) -> list[Array]:
    """The points of a path that are this far from all before; its second round adds none."""
    kept = [path[0]]
    for point in path[1:]:
        if np.linalg.norm(np.array(kept) - point, axis=1).min() >= least:
            kept.append(point)
    return kept


def trace_site(model: mujoco.MjModel) -> int:
    """Id of the site whose path a film may draw, named ``tip`` or ``.../tip``; -1 if none is."""
    names = [model.site(index).name.split("/")[-1] for index in range(model.nsite)]
    return names.index("tip") if "tip" in names else -1


def site_path(model: mujoco.MjModel, site: int, qpos: Array) -> Array:
    """Where a site is at positions (N, nq); returns (N, 3)."""
    data, path = mujoco.MjData(model), np.empty((len(qpos), 3))
    for row, q in zip(path, qpos, strict=True):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        row[:] = data.site_xpos[site]
    return path
