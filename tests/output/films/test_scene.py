"""Scenes of films: surroundings, the place of the camera, marks of wrenches, and ghosts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edits import COLOUR
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output import palette
from grosmc_mj.output.films.scene import (
    FREE_CAMERA,
    _corners,
    _view,
    add_ghost,
    add_wrenches,
    default_camera,
    place,
    surroundings_of,
)
from grosmc_mj.output.films.storyboard import film_model
from grosmc_mj.theory.plants import SYSTEMS

# Part of a picture that moving bodies may fill.
FILLED = 0.86
# Width of a picture over its height, and the field of view [deg].
ASPECT = 1.5
FOV = 40.0
# Positions in a scene are single precision.
SINGLE = 1e-5
GREEN = palette.red_green_blue(palette.DISTURBANCE)


@cache
def shipped(system: str) -> mujoco.MjModel:
    return MujocoPlant.load(system).model


def model_of(*parts: str, assets: str = "") -> mujoco.MjModel:
    world = f"<worldbody>{''.join(parts)}</worldbody>"
    return mujoco.MjModel.from_xml_string(f"<mujoco>{assets}{world}</mujoco>")


def state_of(model: mujoco.MjModel, *qpos: float) -> Array:
    data = mujoco.MjData(model)
    if qpos:
        data.qpos[:] = qpos
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, state, full)
    return state


def updated_scene(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> mujoco.MjvScene:
    """Scene as mujoco.Renderer makes it, without OpenGL."""
    scene = mujoco.MjvScene(model, 1000)
    eye = mujoco.MjvCamera()
    eye.type = mujoco.mjtCamera.mjCAMERA_FIXED
    eye.fixedcamid = camera
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, everything, scene)
    return scene


# Surroundings


LINK = "<body><joint/><geom size='.1' {}/>{}</body>"
CAMERA = f"<camera name='hall' pos='0 -4 0' xyaxes='1 0 0 0 0 1' fovy='{FOV}'/>"
MATERIAL = "<asset><material name='m'/></asset>"


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_model_with_surroundings_keeps_its_own(system: str) -> None:
    model = shipped(system)
    added = surroundings_of(model, state_of(model)[None])
    assert (added.light, added.floor, added.background) == (None, None, False)
    assert not added.uncoloured


def test_a_bare_model_stands_on_a_floor_in_light_before_a_background() -> None:
    """It is a chain of three balls of 0.1 m, whose extent is 0.2 m."""
    model = model_of(LINK.format("", LINK.format("", LINK.format("", ""))), CAMERA)
    added = surroundings_of(model, state_of(model)[None])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = updated_scene(model, data, 0)
    balls, lights = scene.ngeom, scene.nlight
    colour = np.array([0.0, 0.5, 1.0])
    added.paint(scene, colour)
    added.add(scene)

    # Links are dark and pale in turn.
    painted = [geom.rgba[:3] for geom in scene.geoms[:balls]]
    pale = 0.6 * colour + 0.4
    np.testing.assert_allclose(painted, [colour, pale, colour], rtol=0, atol=SINGLE)
    assert scene.nlight == lights + 1
    planes = [g for g in scene.geoms[balls : scene.ngeom] if g.type == mujoco.mjtGeom.mjGEOM_PLANE]
    floor, background = planes
    assert floor.pos[2] == pytest.approx(-0.1 - 0.02 * model.stat.extent, abs=SINGLE)
    assert background.pos[1] > 0.1


@pytest.mark.parametrize(
    "model",
    [
        model_of(LINK.format("rgba='1 0 0 1'", "")),
        model_of(LINK.format("", LINK.format("material='m'", "")), assets=MATERIAL),
    ],
    ids=["colour", "material"],
)
def test_a_model_that_colours_what_moves_keeps_its_colours(model: mujoco.MjModel) -> None:
    assert not surroundings_of(model, state_of(model)[None]).uncoloured


# Cameras


def placement(model: mujoco.MjModel, camera: int = 0) -> Array:
    """Shift of a camera for the model's own pose."""
    return place(model, camera, state_of(model)[None], ASPECT)


CUBE = "<body pos='{} {} {}'>{}<geom type='box' size='.1 .1 .1'/></body>"
HAND = "<joint/><camera name='hand'/>"


def cubes(*centres: tuple[float, float, float], fixed: str = "") -> mujoco.MjModel:
    """Moving cubes of 0.2 m, before a camera that looks along y from 4 m away."""
    return model_of(*(CUBE.format(*centre, "<joint/>") for centre in centres), fixed, CAMERA)


def test_the_camera_centres_moving_bodies() -> None:
    """Two cubes of which the nearer sides span 6.2 m by 0.4 m, 3.9 m away."""
    model = cubes((-1.0, 0.0, 0.2), (5.0, 0.0, 0.0))
    back = 3.1 / (ASPECT * FILLED * math.tan(math.radians(FOV) / 2)) - 3.9
    assert placement(model) == pytest.approx([2.0, 0.1, back], abs=SINGLE)


def test_an_added_mass_leaves_a_model_its_law_s_colours() -> None:
    ball = '<geom size="0.1"/>'
    load = f'<geom size="0.05" rgba="{" ".join(map(str, COLOUR))}"/>'
    model = model_of(f"<body><joint/>{ball}{load}</body>")
    assert surroundings_of(model, state_of(model)[None]).uncoloured == {0: 0.0}


@pytest.mark.parametrize("camera", [0, FREE_CAMERA])
@pytest.mark.parametrize("centres", [[(0.3, 0, 0), (-0.3, 0, 0)], [(0, 0, 9), (0, 0, -5)]])
def test_moving_bodies_fill_the_picture(camera: int, centres: Any) -> None:
    """From the placed camera the furthest corner lies where bodies may end."""
    model = cubes(*centres)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    eye, axes = _view(model, data, camera)
    points = (_corners(model, data, model.geom_group <= 2) - eye) @ axes - placement(model, camera)
    fovy = FOV if camera == 0 else model.vis.global_.fovy
    slopes = math.tan(math.radians(fovy) / 2) * np.array([ASPECT, 1])
    assert np.abs(points[:, :2] / -points[:, 2:] / slopes).max() == pytest.approx(FILLED, rel=1e-3)


@pytest.mark.parametrize(("beyond", "moved"), [(-0.01, False), (0.01, True)])
def test_the_camera_moves_no_more_than_it_must(beyond: float, moved: bool) -> None:
    """The second cube makes them fill a fair part of the picture."""
    edge = FILLED * math.tan(math.radians(FOV) / 2) * 3.9
    left = -ASPECT * edge + 0.1 - beyond
    top = edge - 0.1 + beyond
    model = cubes((left, 0.0, top), (0.0, 0.0, 0.0))
    assert placement(model).any() == moved


@pytest.mark.parametrize(("filled", "moved"), [(0.26, False), (0.24, True)])
def test_the_camera_comes_nearer_to_bodies_that_fill_less_than_a_quarter(
    filled: float, moved: bool
) -> None:
    """A quarter of the part that bodies may fill; the near sides of the cubes are 3.9 m away."""
    edge = ASPECT * FILLED * math.tan(math.radians(FOV) / 2) * 3.9
    apart = filled * edge - 0.1
    shift = placement(cubes((-apart, 0.0, 0.0), (apart, 0.0, 0.0)))
    assert (shift[2] < 0) == moved


@pytest.mark.parametrize(("half", "shown"), [(0.14, True), (0.16, False)])
def test_mujoco_s_own_camera_shows_what_stands_if_it_is_not_much_larger(
    half: float, shown: bool
) -> None:
    """Up to one and a half times as large as what moves, such as a motor beside an arm."""
    motor = f"<body pos='3 0 0'><geom type='box' size='{half} {half} {half}'/></body>"
    model = cubes((0, 0, 0), fixed=motor)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    eye, axes = _view(model, data, FREE_CAMERA)
    moving = (data.geom_xpos[0] - eye) @ axes - placement(model, FREE_CAMERA)
    assert (abs(moving[0]) > 0.5) == shown


def test_the_camera_centres_all_poses_together() -> None:
    """A cart that ends 6 m to the right of where it starts."""
    model = shipped("cart_pendulum")
    ends = np.array([state_of(model, 0.0, 0.0), state_of(model, 6.0, 0.0)])
    shift = place(model, model.camera("fixed").id, ends, ASPECT)
    assert shift[0] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_default_camera_of_a_shipped_model_is_where_its_author_put_it(system: str) -> None:
    """It moves along where something travels; pictures of the nominal start need no shift."""
    model = shipped(system)
    camera = default_camera(model)
    assert model.camera(camera).name == ("follow" if system == "cart_pendulum" else "fixed")
    x0 = find_experiment(system, "nominal").x0[: model.nq]
    assert not place(model, camera, state_of(model, *x0)[None], ASPECT).any()


@pytest.mark.parametrize(
    ("model", "camera"),
    [(model_of(CUBE.format(0, 0, 0, HAND)), FREE_CAMERA), (cubes((0.0, 0.0, 0.0)), 0)],
    ids=["on a hand", "still"],
)
def test_a_camera_on_a_hand_is_no_default(model: mujoco.MjModel, camera: int) -> None:
    """It would not show the hand."""
    assert default_camera(model) == camera


# Wrenches and ghosts


@cache
def posed() -> tuple[mujoco.MjModel, mujoco.MjData, int]:
    """A cart as a film has it, in some pose, and its default camera."""
    model = film_model(shipped("cart_pendulum"), 320, 240)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3
    mujoco.mj_forward(model, data)
    return model, data, default_camera(model)


def direction_to(point: Any) -> Array:
    """Direction of a point from the camera's place and axes: slopes to the right and up."""
    _, data, camera = posed()
    axes = data.cam_xmat[camera].reshape(3, 3)
    right, up, back = (np.asarray(point, float) - data.cam_xpos[camera]) @ axes
    return np.array([right, up]) / -back


def marks(wrench: Sequence[float], largest: Sequence[float]) -> list[Any]:
    """Geoms of a wrench on the pole.

    Args:
        wrench: Force [N] and torque [N m], (6,).
        largest: Largest force [N] and torque [N m] of the film.
    """
    model, data, camera = posed()
    data.body("pole").xfrc_applied[:] = wrench
    scene = updated_scene(model, data, camera)
    first = scene.ngeom
    add_wrenches(scene, model, data, np.array(largest))
    added = scene.geoms[first : scene.ngeom]
    assert all(np.allclose(geom.rgba, [*GREEN, 1.0]) for geom in added)
    return list(added)


@pytest.mark.parametrize("largest", [(5.0, 2.0), (0.0, 0.0)])
def test_without_a_wrench_there_is_no_mark(largest: tuple[float, float]) -> None:
    assert marks([0.0] * 6, largest) == []


def test_a_force_is_an_arrow_in_its_direction_at_the_body_as_long_as_it_is_large() -> None:
    force = np.array([3.0, 0.0, -4.0])
    (whole,) = marks([*force, 0, 0, 0], (5, 0))
    (quarter,) = marks([*force / 4, 0, 0, 0], (5, 0))
    assert whole.type == mujoco.mjtGeom.mjGEOM_ARROW
    np.testing.assert_allclose(whole.mat[:, 2], force / 5, atol=SINGLE)
    body = posed()[1].body("pole").xipos
    np.testing.assert_allclose(direction_to(whole.pos), direction_to(body), atol=1e-4)
    assert 4 * quarter.size[2] == pytest.approx(whole.size[2], rel=1e-5)


def chords_of(pieces: Sequence[Any]) -> Array:
    """Unit vectors from each piece of an arc to the next one, without the arrow's."""
    points = np.array([piece.pos for piece in pieces], float)
    chords = np.diff(points[:-1], axis=0)
    return chords / np.linalg.norm(chords, axis=1)[:, None]


def arc(torque: Array) -> SimpleNamespace:
    """Pieces of the arc of a torque, the sines by which it turns, and its angle.

    The largest torque of the film is 2 N m.
    """
    pieces = marks([0, 0, 0, *torque], (0.0, 2.0))
    chords = chords_of(pieces)
    axis = torque / np.linalg.norm(torque)
    sines = np.cross(chords[:-1], chords[1:]) @ axis
    angle = len(chords) * math.asin(sines[0])
    return SimpleNamespace(pieces=pieces, chords=chords, sines=sines, angle=angle)


@pytest.mark.parametrize("axis", [(0, -1, 0), (0, 0, 1), (0.6, 0.8, 0)])
def test_a_torque_is_an_arc_about_its_axis_right_handed_as_long_as_it_is_large(axis: Any) -> None:
    """The chords of a circle turn about its axis, all by the same angle."""
    whole = arc(2 * np.array(axis))
    *capsules, arrow = whole.pieces
    assert {piece.type for piece in capsules} == {mujoco.mjtGeom.mjGEOM_CAPSULE}
    assert arrow.type == mujoco.mjtGeom.mjGEOM_ARROW
    np.testing.assert_allclose(whole.chords @ axis, 0.0, rtol=0, atol=100 * SINGLE)
    np.testing.assert_allclose(whole.sines, whole.sines[0], rtol=0.02)
    assert whole.sines[0] > 0
    assert arrow.mat[:, 2] @ whole.chords[-1] > 0.9

    assert arc(np.array(axis)).angle == pytest.approx(whole.angle / 2, rel=0.02)
    assert 4.5 < whole.angle < 2 * math.pi


def test_the_ghost_is_the_indicator_alone_translucent_at_its_own_pose() -> None:
    model, data, camera = posed()
    ghost = mujoco.MjData(model)
    ghost.qpos[:] = data.qpos + 0.4
    mujoco.mj_forward(model, ghost)
    scene = updated_scene(model, data, camera)
    first = scene.ngeom
    add_ghost(scene, model, ghost)

    added = scene.geoms[first : scene.ngeom]
    indicators = np.flatnonzero(model.geom_group == 2)
    assert {geom.objid for geom in added} == set(indicators.tolist())
    assert all(0 < geom.rgba[3] < 1 for geom in added)
    expected = [direction_to(ghost.geom_xpos[geom.objid]) for geom in added]
    np.testing.assert_allclose(
        [direction_to(geom.pos) for geom in added], expected, rtol=0, atol=1e-4
    )
