"""The scene of a film: the place of the camera, and the marks that are added to MuJoCo's scene.

The camera is the model's own, moved if a body would not fit or would be a speck. Light, floor and
background are added to a model that has none, and what moves without a colour has that of the law.
The marks are the ghost and the disturbance as arrows and arcs.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edits import COLOUR
from grosmc_mj.output.palette import DISTURBANCE, OPTIMUM, red_green_blue

# Id of MuJoCo's own camera, which shows the whole model from above.
FREE_CAMERA = -1
# Part of the picture, from its middle, that moving bodies may fill, and that they fill at least
# before the camera of a model's author is moved.
_FILLED = 0.86
_LEAST_FILLED = 0.25
_MUCH_LARGER = 1.5
# Largest move in, as a part of the distance of the nearest body.
_NEAREST = 0.9
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
# A ghost of all that moves stands behind it: in front it would darken the whole machine.
_FURTHER_GHOST = 1.015

# Distance of the background, as a part of the largest distance that is drawn.
_REACH = 0.9
# Depth of a floor below the model, as a part of the model's extent.
_BELOW = 0.02
# Darker than they look: they are lit, and the background shines.
_FLOOR = np.array([0.72, 0.74, 0.76, 1.0], np.float32)
_BACKGROUND = np.array([0.56, 0.60, 0.64, 1.0], np.float32)
_LIGHT_DIRECTION = np.array([0.35, 0.45, -0.82])
# Distance of a light from the model's middle, and half the width of the square in which it casts
# shadows, as parts of the model's extent. From further away shadows are speckled.
_LIGHT_DISTANCE = 2.0
LIT = 2.0
# Lines on the floor: their distance and height above it, as parts of the model's extent, their
# number to each side, and their width [pixel of the oversampled picture].
_CELL = 0.25
_ABOVE = 0.002
_CELLS = 24
_LINE = 2.0
_LINE_COLOUR = np.array([0.70, 0.72, 0.74, 1.0], np.float32)
# MuJoCo's colour of a geom whose model gives it none.
_NO_COLOUR = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
# Part of white in the colour of every second body of a chain, so that links can be told apart.
_PALER = 0.4

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
    """Find the move of a camera that fills the picture with the moving bodies.

    A camera of the model stays where its author put it if every moving body is in view and they
    fill a fair part of the picture. Otherwise the camera goes along its line of sight, in or out,
    and in its own plane to the middle.

    Args:
        model: Model.
        camera: Id of the camera.
        states: Full states of the film, or some of them, (N, size).
        aspect: Width of the picture over its height.

    Returns:
        Move to its right, up and back [m], (3,).
    """
    data = mujoco.MjData(model)
    corners = []
    shown = _moving(model)
    if camera == FREE_CAMERA:
        shown = shown | _small(model)
    for state in states:
        pose(model, data, state)
        eye, axes = _view(model, data, camera)
        corners.append((_corners(model, data, shown) - eye) @ axes)
    points = np.concatenate(corners)
    aside = points[:, :2]
    distance = -points[:, 2:]

    # At a distance d, |right| and |up| are in view up to slopes * d.
    fovy = model.vis.global_.fovy if camera == FREE_CAMERA else model.cam_fovy[camera]
    slopes = _FILLED * math.tan(math.radians(fovy) / 2) * np.array([aspect, 1])
    in_view = bool(np.all(np.abs(aside) <= slopes * distance))
    if in_view and camera != FREE_CAMERA:
        filled = np.ptp(aside / (slopes * distance), axis=0).max() / 2
        if filled >= _LEAST_FILLED:
            return np.zeros(3)

    most = (aside - slopes * distance).max(axis=0)
    least = (aside + slopes * distance).min(axis=0)
    back = ((most - least) / (2 * slopes)).max()
    nearest = max(0.0, float(distance.min()))
    return np.array([*(most + least) / 2, np.clip(back, -_NEAREST * nearest, _FURTHEST)])


def _view(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> tuple[Array, Array]:
    """Return place (3,) and axes to the right, up and back (3, 3) of a camera."""
    if camera != FREE_CAMERA:
        return data.cam_xpos[camera], data.cam_xmat[camera].reshape(3, 3)

    free = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, free)
    scene = mujoco.MjvScene(model, 1)
    mujoco.mjv_updateCamera(model, data, free, scene)
    eye = np.mean([eye.pos for eye in scene.camera], axis=0)
    return eye, _axes(scene.camera[0])


def _axes(camera: Any) -> Array:
    """Return the axes of a scene's camera to its right, up and back, a column each, (3, 3)."""
    forward = np.array(camera.forward, float)
    up = np.array(camera.up, float)
    return np.column_stack([np.cross(forward, up), up, -forward])


class Surroundings(NamedTuple):
    """Light, floor, background and colours that a model lacks.

    Attributes:
        light: Place of a light to add [m], (3,); None for none.
        floor: Height of a floor to add [m]; None for none.
        background: Whether to add a background; MuJoCo's own is black.
        cell: Distance of the lines on an added floor [m].
        uncoloured: For each geom to be drawn in the colour of the law, its part of white.
    """

    light: tuple[float, ...] | None
    floor: float | None
    background: bool
    cell: float
    uncoloured: Mapping[int, float]

    def paint(self, scene: mujoco.MjvScene, colour: Array) -> None:
        """Give geoms without a colour that of the law, (3,); the scene is updated."""
        if not self.uncoloured:
            return
        for geom in scene.geoms[: scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and geom.objid in self.uncoloured:
                white = self.uncoloured[geom.objid]
                geom.rgba[:3] = (1 - white) * colour + white

    def add(self, scene: mujoco.MjvScene) -> None:
        """Add them to an updated scene whose camera is in place."""
        camera = scene.camera[0]
        eye = np.array(camera.pos, float)
        facing = _axes(camera)
        back = facing[:, 2]
        reach = _REACH * float(camera.frustum_far)
        if self.light is not None:
            _add_light(scene, self.light)
        if self.floor is not None:
            below = np.array([eye[0], eye[1], self.floor])
            _add_plane(scene, below, np.eye(3), reach, _FLOOR)
            _add_lines(scene, self.floor, self.cell)
        if self.background:
            plane = _add_plane(scene, eye - reach * back, facing, reach, _BACKGROUND)
            plane.emission = 1.0


def surroundings_of(model: mujoco.MjModel, states: Array) -> Surroundings:
    """Return what a model lacks; a floor lies below the lowest point of all states (N, size)."""
    floor = None
    ground = (_GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_HFIELD)
    if not np.isin(model.geom_type, ground).any():
        data = mujoco.MjData(model)
        lowest = math.inf
        for state in states:
            pose(model, data, state)
            lowest = min(lowest, float(_corners(model, data, _drawn(model))[:, 2].min()))
        floor = lowest - _BELOW * model.stat.extent

    light = None
    if not model.nlight:
        middle = model.stat.center
        lamp = middle - _LIGHT_DISTANCE * model.stat.extent * _LIGHT_DIRECTION
        light = tuple(lamp.tolist())

    skies = model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX
    return Surroundings(
        light=light,
        floor=floor,
        background=not skies.any(),
        cell=_CELL * model.stat.extent,
        uncoloured=_uncoloured(model),
    )


def _uncoloured(model: mujoco.MjModel) -> dict[int, float]:
    """Return the moving geoms of a model that colours none of them, with their parts of white.

    What edits have added, such as a mass, keeps its own colour.
    """
    moving = np.flatnonzero(_moving(model))
    added = np.all(model.geom_rgba[moving] == np.array(COLOUR, np.float32), axis=1)
    moving = moving[~added]
    coloured = (model.geom_matid[moving] >= 0) | np.any(
        model.geom_rgba[moving] != _NO_COLOUR, axis=1
    )
    if coloured.any():
        return {}
    return {geom: _PALER * (_depth(model, geom) % 2) for geom in moving.tolist()}


def _depth(model: mujoco.MjModel, geom: int) -> int:
    """Return the number of moving bodies between the world and a geom."""
    depth = -1
    body = model.body_weldid[model.geom_bodyid[geom]]
    while body != 0:
        depth += 1
        body = model.body_weldid[model.body_parentid[body]]
    return depth


def _add_plane(
    scene: mujoco.MjvScene,
    centre: Array,
    axes: Array,
    half: float,
    colour: Array,
) -> Any:
    """Add a plane to a scene; its axes are the columns of a matrix, (3, 3)."""
    geom = scene.geoms[scene.ngeom]
    size = np.array([half, half, 1.0])
    mujoco.mjv_initGeom(geom, _GEOM.mjGEOM_PLANE, size, centre, axes.ravel(), colour)
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR
    geom.specular = 0
    geom.shininess = 0
    scene.ngeom += 1
    return geom


def _add_lines(scene: mujoco.MjvScene, floor: float, cell: float) -> None:
    """Add lines on a floor, which show that a camera or a cart moves."""
    height = floor + _ABOVE / _CELL * cell
    end = _CELLS * cell
    for line in np.linspace(-end, end, 2 * _CELLS + 1):
        for start, stop in (((line, -end), (line, end)), ((-end, line), (end, line))):
            geom = scene.geoms[scene.ngeom]
            kind = _GEOM.mjGEOM_LINE
            turn = np.eye(3).ravel()
            mujoco.mjv_initGeom(geom, kind, np.ones(3), np.zeros(3), turn, _LINE_COLOUR)
            mujoco.mjv_connector(geom, kind, _LINE, (*start, height), (*stop, height))
            geom.category = mujoco.mjtCatBit.mjCAT_DECOR
            scene.ngeom += 1


def _add_light(scene: mujoco.MjvScene, lamp: Sequence[float]) -> None:
    """Add a lamp above that casts shadows."""
    light = scene.lights[scene.nlight]
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.headlight = False
    light.texid = -1
    light.castshadow = True
    light.dir[:] = _LIGHT_DIRECTION
    light.pos[:] = lamp
    light.ambient[:] = 0.35
    light.diffuse[:] = 0.5
    light.specular[:] = 0.1
    light.attenuation[:] = (1, 0, 0)
    light.intensity = 0
    light.range = 100
    scene.nlight += 1


def pose(model: mujoco.MjModel, data: mujoco.MjData, state: Array) -> None:
    """Put a stored state into the data and compute the positions for drawing."""
    mujoco.mj_setState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_fwdPosition(model, data)


def _drawn(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Select the geoms that are drawn, (geoms,)."""
    return model.geom_group <= 2


def _moving(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Select the drawn geoms of moving bodies, (geoms,)."""
    return _drawn(model) & (model.body_weldid[model.geom_bodyid] != 0)


def _small(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Select the drawn geoms that are not much larger than a moving one, such as a motor, (geoms,).

    A plane has no size here.
    """
    sizes = model.geom_rbound
    largest = sizes[_moving(model)].max(initial=0.0)
    return _drawn(model) & (sizes > 0) & (sizes <= _MUCH_LARGER * largest)


def _corners(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    chosen: NDArray[np.bool_],
) -> Array:
    """Return the corners of the boxes around chosen geoms, in world axes, (n, 3)."""
    centre, half = np.split(model.geom_aabb[chosen][:, None], 2, axis=2)
    rotation = data.geom_xmat[chosen].reshape(-1, 3, 3)
    corners = (centre + _CORNERS * half) @ rotation.transpose(0, 2, 1)
    return (data.geom_xpos[chosen][:, None] + corners).reshape(-1, 3)


def move(scene: mujoco.MjvScene, by: Array) -> None:
    """Move the cameras of an updated scene to their right, up and back [m], (3,)."""
    for camera in scene.camera:
        camera.pos[:] = camera.pos + _axes(camera) @ by


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
    nearer = _NEARER_GHOST
    if INDICATOR not in model.geom_group:
        option.geomgroup[:3] = 1
        nearer = _FURTHER_GHOST
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
        geom.pos[:] = eye + nearer * (geom.pos - eye)


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
