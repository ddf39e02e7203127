"""Films before they are rendered: times, places, curves, marks and ghosts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import matplotlib as mpl
import mujoco
import numpy as np
import pytest
from hand_written import tip
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from mjcf import TREE
from shipped import TWO_LINK_CIRCLE, error_of, find_case, run_case

from grosmc_mj.experiments.catalogue import chapter_controller, find_experiments
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.output import palette
from grosmc_mj.output.films import frames
from grosmc_mj.output.films.film import Film, Format, Take
from grosmc_mj.output.films.frames import Storyboard
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
from grosmc_mj.output.films.storyboard import (
    Plot,
    PlotCurve,
    _draw,
    _style,
    film_model,
    inputs,
    outputs,
    storyboard,
    surfaces,
)
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.plants import SERVO, SYSTEMS
from grosmc_mj.theory.plants.system import System

pytestmark = pytest.mark.slow

SMALL = Format(480, 320, fps=10)
# Part of a picture that moving bodies may fill.
FILLED = 0.86
# Width of a picture over its height, and the field of view [deg].
ASPECT = 1.5
FOV = 40.0
# Positions in a scene are single precision.
SINGLE = 1e-5
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
GREEN = palette.red_green_blue(palette.DISTURBANCE)


@cache
def plant(system: str) -> MujocoPlant:
    return MujocoPlant.load(system)


def invented(
    model: mujoco.MjModel, system: System, speed: float = 1.0, end: int = 100
) -> Trajectory:
    """A run of 1 s whose first coordinate moves, pushed from 0.4 s to 0.6 s.

    Args:
        model: Compiled model.
        system: System of the model.
        speed: Speed of the first coordinate.
        end: End of the run [10 ms].
    """
    steps = 10 * end
    time = np.arange(steps + 1) / 1000
    physics = np.zeros((steps + 1, mujoco.mj_stateSize(model, FULL)))
    physics[:, 0] = time
    physics[:, 1] = speed * time

    wrench = np.zeros((1000, 6 * len(system.bodies)))
    wrench[400:600, -2] = 3.0

    signal = np.linspace(-3, 2, 1000)[:steps]
    m = len(system.inputs)
    if m == 1:
        u = signal
        s = 0.2 * signal
    else:
        u = signal[:, None] * np.arange(1, m + 1)
        s = 2 * u

    return Trajectory(
        system=system,
        time=time,
        state=physics[:, 1 : 1 + 2 * model.nq],
        command=u,
        input=u,
        sliding=s,
        weighed=u,
        memory=np.zeros(steps, [("v", np.float64)]),
        wrench=wrench[:steps],
        physics=physics,
        status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(end / 100),
    )


def servo(speed: float = 1.0, end: int = 100) -> Trajectory:
    return invented(plant("servo").model, SERVO, speed, end)


def take(label: str, colour: str, run: Trajectory) -> Take:
    """A run with a ghost at 1.5 rad."""
    ghost = np.full((len(run.time), 1), 1.5)
    return Take(label, colour, run, ghost, sliding_unit="A s")


def film(form: Format = SMALL) -> Film:
    """A film of one run of a servo."""
    return film_of_servo(form, servo())


def film_of_servo(form: Format, run: Trajectory) -> Film:
    return Film("A film", plant("servo").model, (take("A", "#D55E00", run),), form)


def film_of_two(first: Trajectory, second: Trajectory) -> Film:
    takes = (take("A", "#D55E00", first), take("B", "#0072B2", second))
    return Film("A film", plant("servo").model, takes, SMALL)


@cache
def result(system: str, case: str, controller: str = "lqr") -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


@cache
def case_film(system: str, case: str, form: Format = SMALL) -> Film:
    results = [result(system, case, "lqr"), result(system, case, "grosmc")]
    return film_of(results, form)


def recorded(plant: Any, **options: Any) -> Trajectory:
    law = chapter_controller("lqr", MujocoPlant.load("servo").analytic())
    return simulate(plant, law, [0.0, 0.0], duration=0.01, **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Format(height=361), "1280 x 361 pixels: both must be even"),
        (lambda: film(Format(stop=1.1)), "to 1.1 s shows nothing: .* end at 1 s"),
        (lambda: film(Format(camera="folow")), "camera 'folow': did you mean 'follow'"),
        (lambda: replace(film(), takes=()), "one to four runs, not 0"),
        (lambda: replace(film(), model=plant("arm").model), "a run of servo is not of this model"),
        (
            lambda: film_of_servo(SMALL, recorded(plant("servo").analytic())),
            "A: a film needs one recorded run in MuJoCo",
        ),
        (
            lambda: film_of_servo(SMALL, recorded(plant("servo"), record=False)),
            "was not recorded",
        ),
        (
            lambda: Take("A", "#D55E00", servo(), np.zeros((1000, 1))),
            r"must be \(1001, 1\)",
        ),
        (
            lambda: film_of([result("servo", "nominal"), result("servo", "case2")]),
            "runs of one case on one plant",
        ),
    ],
)
def test_a_film_that_cannot_be_made_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        make()


@pytest.mark.parametrize(
    ("speed", "start", "stop", "count"),
    [
        (1, 0.0, None, 24),
        (0.3, 0.123, 0.3, 14),
        (2, 0.5, 0.5001, 1),
    ],
)
def test_a_frame_shows_the_recorded_instant_nearest_to_its_own(
    speed: float, start: float, stop: float | None, count: int
) -> None:
    shown = film(Format(fps=24, speed=speed, start=start, stop=stop))
    expected = start + np.arange(count) * speed / 24
    np.testing.assert_allclose(shown.times, expected, rtol=0, atol=1e-12)

    (take,) = shown.takes
    errors = take.run.time[shown.rows(take)] - shown.times
    assert np.abs(errors).max() <= 0.5e-3 + 1e-12


def film_of_a_push() -> Film:
    return case_film("cart_pendulum", "case2", replace(SMALL, start=8.0, stop=12.0))


@pytest.mark.parametrize("index", [0, 1])
def test_a_scene_has_the_rows_of_its_instants(index: int) -> None:
    shown = film_of_a_push()
    take = shown.takes[index]
    scene = stage_of(shown).scenes[index]
    rows = shown.rows(take)
    np.testing.assert_array_equal(scene.physics, np.asarray(take.run.physics)[rows])

    # Cart and pole, of which the law controls the pole.
    ghost = np.asarray(take.ghost)[rows]
    np.testing.assert_array_equal(scene.ghost, np.column_stack([scene.physics[:, 1], ghost]))

    model = stage_of(shown).model
    bodies = [model.body(name).id for name in take.run.system.bodies]
    wrench = np.asarray(scene.wrench)[:, bodies].reshape(len(rows), -1)
    np.testing.assert_array_equal(wrench, np.asarray(take.run.wrench)[rows])


def test_the_largest_torque_is_that_of_all_scenes() -> None:
    stage = stage_of(film_of_a_push())
    torques = [np.asarray(scene.wrench)[..., 3:] for scene in stage.scenes]
    largest = float(np.abs(torques).max())
    assert stage.largest.tolist() == [0.0, largest]
    assert largest > 0


def test_a_run_that_ended_early_stays_there() -> None:
    shown = film_of_two(servo(), servo(end=50))
    whole, short = shown.takes
    assert list(shown.rows(whole)) == list(range(0, 1000, 100))
    assert list(shown.rows(short)) == [0, 100, 200, 300, 400, 500, 500, 500, 500, 500]


def test_a_run_that_ended_early_is_pushed_no_more() -> None:
    """It ends at 0.5 s in the middle of its push."""
    shown = film_of_two(servo(), servo(end=50))
    pushed = [np.any(scene.wrench, axis=(1, 2)) for scene in stage_of(shown).scenes]
    assert np.flatnonzero(pushed[0]).tolist() == [4, 5]
    assert np.flatnonzero(pushed[1]).tolist() == [4]


def stage_of(shown: Film) -> frames.Stage:
    """Return the stage of a film in MuJoCo."""
    stage = storyboard(shown).stage
    assert stage is not None
    return stage


# Surroundings, poster, equations


BARE = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"


def test_a_model_without_surroundings_gets_light_floor_and_background() -> None:
    model = mujoco.MjModel.from_xml_string(BARE)
    added = surroundings_of(model, state_of(model)[None])
    assert added.light is not None
    assert added.background
    assert list(added.uncoloured) == [0]
    assert added.floor is not None
    assert added.floor < -0.1


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_model_with_surroundings_keeps_its_own(system: str) -> None:
    model = plant(system).model
    added = surroundings_of(model, state_of(model)[None])
    assert (added.light, added.floor, added.background) == (None, None, False)
    assert not added.uncoloured


COLOURED = "<mujoco><worldbody><body><joint/><geom size='.1' {}/></body></worldbody></mujoco>"
MATERIAL = (
    "<mujoco><asset><material name='m'/></asset><worldbody><geom size='.1'/>"
    "<body><joint/><geom size='.1'/><geom size='.1' material='m'/></body></worldbody></mujoco>"
)


@pytest.mark.parametrize("xml", [COLOURED.format("rgba='1 0 0 1'"), MATERIAL])
def test_a_model_that_colours_what_moves_keeps_its_colours(xml: str) -> None:
    model = mujoco.MjModel.from_xml_string(xml)
    assert not surroundings_of(model, state_of(model)[None]).uncoloured


def test_links_of_a_chain_are_dark_and_pale_in_turn() -> None:
    link = "<body><joint/><geom size='.1'/>{}</body>"
    chain = link.format(link.format(link.format("")))
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{chain}</worldbody></mujoco>")
    parts = surroundings_of(model, state_of(model)[None]).uncoloured
    assert parts[0] == parts[2] == 0
    assert 0 < parts[1] < 1


def test_a_power_of_ten_stands_below_a_long_title() -> None:
    """The title is longer than the axes are wide."""
    title = "size of the sliding variable |s| [rad/s]"
    shown = film_of_two(servo(), servo())
    time = np.linspace(0, shown.stop, 9)
    with mpl.rc_context(_style(9)):
        figure = Figure(figsize=(2.6, 1.8), layout="constrained")
        canvas = FigureCanvasAgg(figure)
        axes = figure.subplots()
        _draw(axes, Plot(title, [PlotCurve(time, 4e-4 * time, {})]), shown)
        canvas.draw()

    (drawn_title,) = (text for text in axes.findobj(Text) if text.get_text() == title)
    power = axes.yaxis.get_offset_text()
    assert power.get_text()
    assert power.get_window_extent().x0 < drawn_title.get_window_extent().x1
    assert not power.get_window_extent().overlaps(drawn_title.get_window_extent())


def test_the_poster_shows_the_moment_at_which_runs_differ_most() -> None:
    """Runs at two speeds part more and more; the last frame is the tenth."""
    assert film_of_two(servo(), servo(speed=0.5)).poster_frame == 9


def test_an_optimum_has_the_colour_of_its_law() -> None:
    shown = case_film("cart_pendulum", "nominal")
    curves = outputs(shown).curves
    dashed = [curve.style["color"] for curve in curves if "ls" in curve.style]
    assert dashed == [take.colour for take in shown.takes]


def test_a_film_of_equations_shows_their_curves_alone() -> None:
    (experiment,) = find_experiments("maglev/warm")
    plant_name = experiment.plant_names[-1]
    shown = film_of([experiment.run(plant_name, "lqr")], SMALL)
    board = storyboard(shown)
    assert board.stage is None
    maker = frames.FrameMaker(board)
    plots = board.chart.areas[0][0]
    assert plots.stop - plots.start > SMALL.height / 2
    differs = np.any(maker.frame(5) != maker.frame(0), axis=2)
    assert differs[board.chart.areas[0]].any()


# Cameras


def state_of(model: mujoco.MjModel, *qpos: float) -> Array:
    data = mujoco.MjData(model)
    if qpos:
        data.qpos[:] = qpos
    state = np.zeros(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, state, FULL)
    return state


def placement(model: mujoco.MjModel, camera: int = 0) -> Array:
    """Shift of a camera for the model's own pose."""
    return place(model, camera, state_of(model)[None], ASPECT)


CUBE = "<body pos='{} {} {}'><joint/><geom type='box' size='.1 .1 .1'/>{}</body>"
HALL = f"<camera name='hall' pos='0 -4 0' xyaxes='1 0 0 0 0 1' fovy='{FOV}'/>"
HAND = "<camera name='hand'/>"


def cubes(*centres: tuple[float, float, float]) -> mujoco.MjModel:
    """Moving cubes of 0.2 m, before a camera that looks along y from 4 m away."""
    bodies = "".join(CUBE.format(*centre, "") for centre in centres)
    xml = f"<mujoco><worldbody>{bodies}{HALL}</worldbody></mujoco>"
    return mujoco.MjModel.from_xml_string(xml)


def cube_with_a_camera() -> mujoco.MjModel:
    """A moving cube that carries the only camera."""
    xml = f"<mujoco><worldbody>{CUBE.format(0, 0, 0, HAND)}</worldbody></mujoco>"
    return mujoco.MjModel.from_xml_string(xml)


def edge_of_the_picture() -> float:
    """Half the height that bodies may fill, at the near sides of the cubes [m]."""
    return FILLED * math.tan(math.radians(FOV) / 2) * 3.9


def test_the_camera_centres_moving_bodies() -> None:
    """Two cubes of which the nearer sides span 6.2 m by 0.4 m, 3.9 m away."""
    model = cubes((-1.0, 0.0, 0.2), (5.0, 0.0, 0.0))
    back = 3.1 / (ASPECT * FILLED * math.tan(math.radians(FOV) / 2)) - 3.9
    assert placement(model) == pytest.approx([2.0, 0.1, back], abs=SINGLE)


def test_the_camera_moves_sideways_to_a_body_beside_the_picture() -> None:
    model = cubes((4.0, 0.0, -2.5))
    assert placement(model)[:2] == pytest.approx([4.0, -2.5])


@pytest.mark.parametrize("camera", [0, FREE_CAMERA])
@pytest.mark.parametrize("centres", [[(0.3, 0, 0), (-0.3, 0, 0)], [(0, 0, 9), (0, 0, -5)]])
def test_moving_bodies_fill_the_picture(camera: int, centres: Any) -> None:
    """From the placed camera the furthest corner lies where bodies may end."""
    model = cubes(*centres)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    eye, axes = _view(model, data, camera)
    moving = model.geom_group <= 2
    points = (_corners(model, data, moving) - eye) @ axes - placement(model, camera)
    fovy = FOV if camera == 0 else model.vis.global_.fovy
    slopes = math.tan(math.radians(fovy) / 2) * np.array([ASPECT, 1])
    assert np.abs(points[:, :2] / -points[:, 2:] / slopes).max() == pytest.approx(FILLED, rel=1e-3)


@pytest.mark.parametrize(("beyond", "moved"), [(-0.01, False), (0.01, True)])
def test_the_camera_moves_no_more_than_it_must(beyond: float, moved: bool) -> None:
    edge = edge_of_the_picture()
    left = -ASPECT * edge + 0.1 - beyond
    top = edge - 0.1 + beyond
    # The second one makes them fill a fair part of the picture.
    model = cubes((left, 0.0, top), (0.0, 0.0, 0.0))
    assert placement(model).any() == moved


def test_the_camera_centres_all_poses_together() -> None:
    """A cart that ends 6 m to the right of where it starts."""
    model = plant("cart_pendulum").model
    ends = np.array([state_of(model, 0.0, 0.0), state_of(model, 6.0, 0.0)])
    shift = place(model, model.camera("fixed").id, ends, ASPECT)
    assert shift[0] == pytest.approx(3.0, abs=1e-3)


@pytest.mark.parametrize("system", SYSTEMS)
def test_the_default_camera_moves_along_where_something_travels(system: str) -> None:
    model = plant(system).model
    camera = "follow" if system == "cart_pendulum" else "fixed"
    assert model.camera(default_camera(model)).name == camera


@pytest.mark.parametrize("system", SYSTEMS)
def test_pictures_of_the_nominal_start_are_those_of_the_model_s_author(system: str) -> None:
    model = plant(system).model
    x0 = find_case(system, "nominal").x0[: model.nq]
    assert not place(model, default_camera(model), state_of(model, *x0)[None], ASPECT).any()


def test_a_camera_on_a_hand_is_no_default() -> None:
    """It would not show the hand."""
    assert default_camera(cube_with_a_camera()) == FREE_CAMERA
    assert default_camera(cubes((0.0, 0.0, 0.0))) == 0


def test_a_format_can_name_another_camera() -> None:
    shown = case_film("cart_pendulum", "nominal")
    fixed = replace(shown, format=replace(SMALL, camera="fixed"))
    assert shown.camera_name == "follow"
    assert fixed.camera_name == "fixed"


# Wrenches and ghosts in a scene


def updated_scene(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> mujoco.MjvScene:
    """Scene as mujoco.Renderer makes it, without OpenGL."""
    scene = mujoco.MjvScene(model, 1000)
    eye = mujoco.MjvCamera()
    eye.type = mujoco.mjtCamera.mjCAMERA_FIXED
    eye.fixedcamid = camera
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, everything, scene)
    return scene


@cache
def posed() -> tuple[mujoco.MjModel, mujoco.MjData, int]:
    """A cart as a film has it, in some pose, and its default camera."""
    model = film_model(plant("cart_pendulum").model, 320, 240)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3
    mujoco.mj_forward(model, data)
    return model, data, default_camera(model)


def direction_to(point: Any) -> Array:
    """Direction of a point from the camera's place and axes: slopes to the right and up."""
    _, data, camera = posed()
    axes = data.cam_xmat[camera].reshape(3, 3)
    right, up, back = (point - data.cam_xpos[camera]) @ axes
    return np.array([right, up]) / -back


def z_axis(geom: Any) -> Array:
    return np.reshape(geom.mat, (3, 3))[:, 2]


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


FORCE = np.array([3.0, 0.0, -4.0])


def arrow_of(share: float) -> Any:
    """Arrow of a share of the largest force."""
    (arrow,) = marks([*share * FORCE, 0, 0, 0], (5, 0))
    return arrow


@pytest.mark.parametrize("share", [0.25, 1.0])
def test_a_force_is_an_arrow_in_its_direction_at_the_body(share: float) -> None:
    arrow = arrow_of(share)
    assert arrow.type == mujoco.mjtGeom.mjGEOM_ARROW
    np.testing.assert_allclose(z_axis(arrow), FORCE / 5, atol=SINGLE)

    body = posed()[1].body("pole").xipos
    expected = direction_to(body)
    np.testing.assert_allclose(direction_to(np.array(arrow.pos)), expected, atol=1e-4)


def test_an_arrow_is_as_long_as_its_force_is_large() -> None:
    whole = arrow_of(1.0).size[2]
    quarter = arrow_of(0.25).size[2]
    assert quarter / 0.25 == pytest.approx(whole, rel=1e-5)


def chords_of(pieces: Sequence[Any]) -> Array:
    """Unit vectors from each piece of an arc to the next one, without the arrow's."""
    points = np.array([piece.pos for piece in pieces], float)
    chords = np.diff(points[:-1], axis=0)
    return chords / np.linalg.norm(chords, axis=1)[:, None]


def sines_of_turns(chords: Array, axis: Any) -> Array:
    """Sines of the angles by which an arc turns about an axis."""
    return np.cross(chords[:-1], chords[1:]) @ axis


each_axis = pytest.mark.parametrize("axis", [(0, -1, 0), (0, 0, 1), (0.6, 0.8, 0)])


@each_axis
@pytest.mark.parametrize("share", [1.0, 0.5])
def test_a_torque_is_an_arc_about_its_axis_right_handed(axis: Any, share: float) -> None:
    pieces = marks([0, 0, 0, *2 * share * np.array(axis)], (0.0, 2.0))
    *capsules, arrow = pieces
    assert {piece.type for piece in capsules} == {mujoco.mjtGeom.mjGEOM_CAPSULE}
    assert arrow.type == mujoco.mjtGeom.mjGEOM_ARROW

    # The chords of a circle turn about its axis, all by the same angle.
    points = np.array([piece.pos for piece in pieces], float)
    heights = np.diff(points[:-1], axis=0) @ axis
    np.testing.assert_allclose(heights, 0.0, rtol=0, atol=10 * SINGLE)
    chords = chords_of(pieces)
    sines = sines_of_turns(chords, axis)
    np.testing.assert_allclose(sines, sines[0], rtol=0.02)
    assert sines[0] > 0
    assert z_axis(arrow) @ chords[-1] > 0.9


def angle_of_arc(axis: Any, share: float) -> float:
    """Angle over which the arc of a share of the largest torque goes."""
    chords = chords_of(marks([0, 0, 0, *2 * share * np.array(axis)], (0.0, 2.0)))
    sines = sines_of_turns(chords, axis)
    return len(chords) * math.asin(sines[0])


@each_axis
def test_an_arc_is_as_long_as_its_torque_is_large(axis: Any) -> None:
    whole = angle_of_arc(axis, 1.0)
    half = angle_of_arc(axis, 0.5)
    assert half == pytest.approx(whole / 2, rel=0.02)
    assert 4.5 < whole < 2 * math.pi


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
    for geom in added:
        assert 0 < geom.rgba[3] < 1
        expected = direction_to(ghost.geom_xpos[geom.objid])
        actual = direction_to(np.array(geom.pos))
        np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-4)


def test_the_ghost_is_the_nominal_optimum() -> None:
    """The plant is linear and the law is the optimum's: it lags half a sample behind."""
    shown = case_film("servo", "nominal")
    assert shown.ghost_label == "nominal optimum"
    assert shown.ghost_symbol == "x*"
    take = shown.takes[0]
    ghost = np.asarray(take.ghost)[:, 0]
    np.testing.assert_allclose(ghost, take.run.state[:, 0], rtol=0, atol=2e-3)
    assert ghost[-1] == pytest.approx(1.0, abs=0.02)


def test_the_ghost_is_a_reference_that_moves() -> None:
    shown = film_of([result("arm", "case1")])
    assert shown.ghost_label == "reference"
    assert shown.ghost_symbol == "yᵣ"
    (take,) = shown.takes
    expected = np.sin(math.pi * take.run.time)[:, None]
    np.testing.assert_allclose(np.asarray(take.ghost), expected, rtol=0, atol=1e-9)


def test_the_ghost_of_two_outputs_has_the_joints_that_give_them() -> None:
    """They put the tip on the circle, with the elbow on its side."""
    (take,) = film_of([result("two_link_arm", "nominal")]).takes
    ghost = np.asarray(take.ghost)
    assert np.all(ghost[:, 1] < 0)

    p = plant("two_link_arm").parameters
    for t, q in zip(take.run.time[::200], ghost[::200], strict=True):
        goal = error_of("two_link_arm").reference(float(t), TWO_LINK_CIRCLE)
        np.testing.assert_allclose(tip(q, p), [goal[0], goal[3]], rtol=0, atol=1e-8)


# Curves


@cache
def whole_and_short() -> tuple[Trajectory, Trajectory]:
    return servo(), servo(end=50)


def second_state(film: Film) -> Any:
    """Curves of a film that shows the second state in place of s."""
    return surfaces(replace(film, beside=1))


def assert_curves(curves: Any, columns: list[Any]) -> None:
    """Each curve has the values of a column, at the instants of the run that goes on."""
    whole, _ = whole_and_short()
    for (time, values, _), column in zip(curves, columns, strict=True):
        np.testing.assert_array_equal(values, column)
        np.testing.assert_array_equal(time, whole.time[: len(column)])


def test_curves_of_outputs_have_the_ghost_after_both_runs() -> None:
    """It is the ghost of the run that goes on."""
    whole, short = whole_and_short()
    title, curves = outputs(film_of_two(whole, short))
    assert title == "rotor angle θ [rad]  (dashed: yᵣ)"
    assert_curves(curves, [whole.state[:, 0], short.state[:, 0], np.full(1001, 1.5)])


@pytest.mark.parametrize(
    ("curves_of", "title", "signal"),
    [
        (surfaces, "sliding variable s [A s]", lambda run: run.sliding),
        (inputs, "current i [A]", lambda run: run.input),
        (
            second_state,
            f"{SERVO.states[1].name} {SERVO.states[1].symbol} [rad/s]",
            lambda run: run.state[:, 1],
        ),
    ],
)
def test_curves_are_the_recorded_signals_with_their_units(
    curves_of: Callable[[Film], Any], title: str, signal: Callable[[Trajectory], Any]
) -> None:
    whole, short = whole_and_short()
    actual_title, curves = curves_of(film_of_two(whole, short))
    assert actual_title == title
    assert_curves(curves, [signal(whole), signal(short)])


@cache
def film_of_tree() -> Film:
    """Two hinges and a slide, of which the hinges have a unit in common."""
    robot = Robot.from_mjcf(TREE).plant
    run = invented(robot.model, robot.system)
    ghost = np.full((1001, 3), [0.5, -0.2, 3.0])
    without_surface = replace(run, sliding=None)
    takes = (
        Take("A", "#D55E00", without_surface, ghost, "A s"),
        Take("B", "#D55E00", run, ghost, "A s"),
    )
    return Film("tree", robot.model, takes, SMALL)


def size(vectors: Any) -> Array:
    return np.sqrt((np.asarray(vectors) ** 2).sum(axis=1))


def test_of_many_outputs_one_curve_shows_the_distance() -> None:
    shown = film_of_tree()
    title, (first, second) = outputs(shown)
    assert title == "distance |q − yᵣ| of 2 joints [rad]"
    take = shown.takes[1]
    errors = take.run.state[:, :2] - np.asarray(take.ghost)[:, :2]
    np.testing.assert_allclose(second[1], size(errors), rtol=1e-14)
    assert len(first[1]) == len(errors)


def test_of_many_inputs_one_curve_shows_the_size_of_those_with_one_unit() -> None:
    shown = film_of_tree()
    title, (first, second) = inputs(shown)
    assert title == "size of the input |u| of 2 joints [N m]"
    u = shown.takes[1].run.input[:, :2]
    np.testing.assert_allclose(second[1], size(u), rtol=1e-14)
    assert len(first[1]) == len(u)


def test_of_many_sliding_variables_one_curve_shows_the_size() -> None:
    shown = film_of_tree()
    title, (first, second) = surfaces(shown)
    assert title == "size of the sliding variable |s| [A s]"
    np.testing.assert_allclose(second[1], size(shown.takes[1].run.sliding), rtol=1e-14)
    # The first law has no s.
    assert len(first[1]) == 0


# Frames


class Blank:
    """A renderer of pictures that are one grey, which keeps the scenes that it was given."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self.model = model
        self.shape = (height, width, 3)
        self.angles: list[float] = []
        self.pushed: list[float] = []

    def update_scene(self, data: mujoco.MjData, camera: int) -> None:
        self.scene = updated_scene(self.model, data, camera)
        self.angles.append(float(data.qpos[0]))
        self.pushed.append(float(np.abs(data.xfrc_applied).max()))

    def render(self) -> np.ndarray:
        return np.full(self.shape, 77, np.uint8)


@cache
def board_of_two() -> Storyboard:
    """Two runs, one at half the speed of the other, with a placed camera."""
    board = storyboard(film_of_two(servo(), servo(speed=0.5)))
    assert board.stage is not None
    return replace(board, stage=board.stage._replace(placement=np.array([0.3, 0.4, 1.2])))


def painter_of(maker: frames.FrameMaker) -> Any:
    """Return what draws the pictures of a film in MuJoCo."""
    assert maker._painter is not None
    return maker._painter


@pytest.fixture
def maker(monkeypatch: pytest.MonkeyPatch) -> frames.FrameMaker:
    monkeypatch.setattr(frames.mujoco, "Renderer", Blank)
    return frames.FrameMaker(board_of_two())


def test_nothing_of_a_frame_overlaps() -> None:
    chart = board_of_two().chart
    covered = np.zeros(chart.empty.shape[:2], int)
    for box in (*chart.areas, *chart.pictures):
        covered[box] += 1
    assert covered.max() == 1


def test_pictures_hide_nothing_of_the_chart() -> None:
    chart = board_of_two().chart
    white = np.all(chart.empty == 255, axis=2)
    for box in chart.pictures:
        assert white[box].all()


@pytest.mark.parametrize(
    "edge",
    [
        pytest.param(np.s_[0], id="top"),
        pytest.param(np.s_[-1], id="bottom"),
        pytest.param(np.s_[:, 0], id="left"),
        pytest.param(np.s_[:, -1], id="right"),
    ],
)
def test_nothing_is_cut_off_at_an_edge_of_a_frame(edge: Any) -> None:
    chart = board_of_two().chart
    white = np.all(chart.empty == 255, axis=2)
    assert white[edge].all()


each_index = pytest.mark.parametrize("index", [0, 5, 9])


@each_index
def test_a_scene_is_drawn_at_its_instant(maker: frames.FrameMaker, index: int) -> None:
    t = index / 10
    maker.frame(index)
    renderer: Any = painter_of(maker).renderer
    # Each scene is updated twice.
    assert renderer.angles == pytest.approx([t, t, t / 2, t / 2])
    assert (max(renderer.pushed) > 0) == (0.4 <= t < 0.6)


@each_index
def test_a_scene_is_drawn_from_the_placed_camera(maker: frames.FrameMaker, index: int) -> None:
    stage = board_of_two().stage
    assert stage is not None
    right, up, _ = stage.model.cam_mat0[stage.camera].reshape(3, 3).T
    axes = np.array([right, up, np.cross(right, up)])
    expected = stage.model.cam_pos[stage.camera] + stage.placement @ axes

    maker.frame(index)
    renderer: Any = painter_of(maker).renderer
    for eye in renderer.scene.camera:
        np.testing.assert_allclose(eye.pos, expected, rtol=0, atol=SINGLE)


@each_index
def test_a_frame_has_the_curves_up_to_its_instant(maker: frames.FrameMaker, index: int) -> None:
    chart = board_of_two().chart
    frame = maker.frame(index)
    for area in chart.areas:
        image = frame[area]
        last = image.shape[1] - 1
        (cursor,) = np.flatnonzero(np.all(image == 120, axis=(0, 2)))
        assert cursor == pytest.approx(index / 10 * last, abs=0.5)
        np.testing.assert_array_equal(image[:, :cursor], chart.drawn[area][:, :cursor])
        after = cursor + 1
        np.testing.assert_array_equal(image[:, after:], chart.empty[area][:, after:])


@each_index
def test_a_frame_has_the_rendered_pictures(maker: frames.FrameMaker, index: int) -> None:
    frame = maker.frame(index)
    for box in board_of_two().chart.pictures:
        assert np.all(frame[box] == 77)


@each_index
def test_outside_its_boxes_a_frame_changes_only_at_the_clock(
    maker: frames.FrameMaker, index: int
) -> None:
    """It is right of the title."""
    chart = board_of_two().chart
    frame = maker.frame(index)
    changed = np.any(frame != chart.empty, axis=2)
    for box in (*chart.pictures, *chart.areas):
        changed[box] = False
    clock = np.flatnonzero(changed.any(axis=0))
    assert clock.min() > chart.empty.shape[1] - 13.5 * chart.font
    first_row = chart.pictures[0][0].start
    assert not changed[first_row:].any()
