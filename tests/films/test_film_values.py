"""What a film will show, before anything is rendered: times, places, curves, arrows and ghosts."""

from __future__ import annotations

import itertools
import math
import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from shipped import TWO_LINK_CIRCLE, TWO_LINK_TIP, find_case, run_case
from two_link_oracle import TwoLinkParameters, tip

from grosmc_mj.errors import ArgumentError, DivergenceError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.films import film_of, films_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films.camera import camera_names, place
from grosmc_mj.films.chart import draw_chart
from grosmc_mj.films.film import Film, Format, Take
from grosmc_mj.films.frames import Chart, Storyboard
from grosmc_mj.films.layout import Box, Layout
from grosmc_mj.films.marks import add_ghost, add_wrenches
from grosmc_mj.films.storyboard import film_model, storyboard
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.results import palette
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

pytestmark = pytest.mark.slow

SWING = Case(
    "cart_pendulum",
    "swing",
    "The pole swings through -pi/2 at 92 ms, where the linearizing law is undefined",
    "this test",
    (0.0, -0.1, 0.0, -20.0),
    0.5,
)
SMALL = Format(width=480, height=320, fps=10)
PICTURE = (320, 240)
SIZES = [(320, 240), (480, 320), (1280, 720), (3840, 2160), (320, 2160), (3840, 240)]
GREEN = palette.red_green_blue(palette.DISTURBANCE)
STARTS = {
    "servo": [0.0, 0.0],
    "cart_pendulum": [0.0, -0.15, 0.0, 0.0],
    "arm": [0.5, math.pi],
    "two_link_arm": find_case("two_link_arm", "nominal").x0,
}
# A torque about each system's joint is the last three of these [N, N m].
FORCE, TORQUE = np.array([3.0, 0.0, -4.0]), np.array([0.0, 2.0, 0.0])
# Positions in a scene are single precision: 1e-7 of some metres.
SINGLE = 2e-6


# Runs to film, each made once


@cache
def plant(system: str) -> MujocoPlant:
    return MujocoPlant.load(system)


@cache
def filmed(system: str) -> mujoco.MjModel:
    """The model as a film's renderer has it."""
    return film_model(plant(system).model, *PICTURE)


@cache
def short_run(system: str, duration: float = 0.5) -> Trajectory:
    """A run under LQR."""
    law = chapter_controller("lqr", plant(system).analytic())
    return simulate(plant(system), law, STARTS[system], duration=duration)


@cache
def result(system: str, case: str, controller: str) -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


def case_film(
    system: str, case: str, form: Format = SMALL, names: Sequence[str] = ("lqr", "grosmc")
) -> Film:
    return film_of([result(system, case, name) for name in names], form)


@cache
def longer_pole() -> tuple[Film, Storyboard]:
    film = case_film("cart_pendulum", "case1", replace(SMALL, fps=5))
    return film, storyboard(film)


def short_film(form: Format = SMALL, system: str = "servo", **changes: Any) -> Film:
    """A film of half a second, with some fields changed."""
    take = Take("LQR", "#D55E00", short_run(system))
    return replace(Film("A film", plant(system).model, (take,), form), **changes)


@cache
def swing(controller: str) -> RunResult:
    return run_case(SWING, "physics", controller, Settings())


def swing_film(form: Format, names: Sequence[str] = ("fl-lqr", "lqr")) -> Film:
    """Under the first of these laws the run ends early."""
    return film_of([swing(name) for name in names], form)


# What a film refuses


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 641}, "641 x 720 pixels: both must be even"),
        ({"height": 361}, "1280 x 361 pixels: both must be even"),
        ({"width": 318}, "width = 318 must be a whole number from 320 to 3840 pixels"),
        ({"height": 238}, "height = 238 must be .* from 240 to 2160 pixels"),
        ({"width": 3842}, "width = 3842 .* to 3840"),
        ({"height": 2162}, "height = 2162 .* to 2160"),
        ({"width": 0}, "width = 0 "),
        ({"height": -240}, "height = -240 "),
        ({"fps": 0}, "fps = 0 must be a whole number from 1 to 240"),
        ({"fps": 241}, "fps = 241 "),
        ({"fps": -30}, "fps = -30 "),
        ({"speed": 0.0}, "speed = 0 must be finite and positive"),
        ({"speed": -1.0}, "speed = -1 "),
        ({"speed": math.nan}, "speed = nan "),
        ({"speed": math.inf}, "speed = inf "),
        ({"start": 2.0, "stop": 2.0}, "from 2 s to 2 s shows nothing"),
        ({"start": 3.0, "stop": 2.0}, "from 3 s to 2 s shows nothing"),
        ({"start": -0.1}, "start = -0.1 must be finite and not negative"),
        ({"start": math.nan}, "start = nan "),
        ({"start": math.inf}, "start = inf "),
        ({"stop": math.nan}, "stop = nan "),
        ({"stop": -1.0}, "stop = -1 "),
        ({"stop": math.inf}, "stop = inf "),
    ],
)
def test_a_format_that_cannot_be_cut_is_refused_with_its_value(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ArgumentError, match=message):
        Format(**changes)


@pytest.mark.parametrize("size", SIZES)
def test_the_bounds_of_a_size_are_themselves_allowed(size: tuple[int, int]) -> None:
    form = Format(*size, fps=240)
    assert (form.width, form.height) == size


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": Format(start=0.5)}, "from 0.5 s shows nothing: the runs end at 0.5 s"),
        ({"format": Format(start=7.0)}, "from 7 s shows nothing: the runs end at 0.5 s"),
        ({"format": Format(stop=0.6)}, "to 0.6 s: the runs end at 0.5 s"),
        ({"format": Format(camera="folow")}, "camera 'folow': did you mean 'follow'"),
        ({"format": Format(camera="")}, "valid: fixed, follow"),
        ({"takes": ()}, "one to four runs, not 0"),
        ({"takes": (Take("LQR", "#D55E00", short_run("servo")),) * 5}, "not 5"),
    ],
)
def test_a_film_that_would_show_nothing_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        short_film(**changes)


def test_stop_may_be_the_end_of_the_run_itself() -> None:
    assert len(short_film(Format(stop=0.5, fps=10)).times) == 5


@pytest.mark.parametrize(("run", "model"), list(itertools.permutations(SYSTEMS, 2)))
def test_states_of_another_model_are_refused(run: str, model: str) -> None:
    with pytest.raises(ArgumentError, match="model"):
        Film("A film", plant(model).model, (Take("LQR", "#D55E00", short_run(run)),))


def test_a_run_without_its_physics_cannot_be_filmed() -> None:
    servo = plant("servo").analytic()
    run = simulate(servo, chapter_controller("lqr", servo), [0.0, 0.0], duration=0.01)
    with pytest.raises(ArgumentError, match="LQR: a film needs one recorded run in MuJoCo"):
        Take("LQR", "#D55E00", run)


def test_a_batch_is_not_one_run() -> None:
    law = chapter_controller("lqr", plant("servo").analytic())
    batch = simulate(plant("servo"), law, np.zeros((2, 2)), duration=0.01)
    with pytest.raises(ArgumentError, match="one recorded run"):
        Take("LQR", "#D55E00", batch)


def test_start_and_end_of_a_run_are_no_recording_of_it() -> None:
    law = chapter_controller("lqr", plant("servo").analytic())
    run = simulate(plant("servo"), law, [0.0, 0.0], duration=1.0, record=False)
    with pytest.raises(ArgumentError, match="was not recorded"):
        Film("A film", plant("servo").model, (Take("LQR", "#D55E00", run),))


@pytest.mark.parametrize("ghost", [np.zeros(500), np.zeros((501, 2)), np.zeros(()), [1.0]])
def test_a_ghost_needs_one_coordinate_an_instant(ghost: Any) -> None:
    with pytest.raises(ArgumentError, match=r"LQR: the ghost has shape \(.*must be \(501, 1\)"):
        Take("LQR", "#D55E00", short_run("servo"), ghost=ghost)


def test_one_coordinate_may_be_given_as_a_row_or_as_a_column() -> None:
    values = np.linspace(0, 1, 501)
    for ghost in (values, values[:, None], values.tolist()):
        take = Take("LQR", "#D55E00", short_run("servo"), ghost=ghost)
        np.testing.assert_array_equal(take.ghosts, values[:, None])


def test_a_film_of_two_cases_or_of_an_analytic_plant_is_refused() -> None:
    nominal, edited = result("servo", "nominal", "lqr"), result("servo", "case2", "lqr")
    analytic = run_case(find_case("servo", "nominal"), "corrected", "lqr", Settings())
    for results in ([nominal, edited], [nominal, analytic], [analytic], []):
        with pytest.raises(ArgumentError, match="runs of one case on physics"):
            film_of(results)


# Which instants its frames show


@pytest.mark.parametrize("speed", [1.0, 2.0, 0.5, 0.3])
@pytest.mark.parametrize("window", [(0.0, None), (0.1, None), (0.0, 0.35), (0.123, 0.3)])
@pytest.mark.parametrize("fps", [10, 24, 60])
def test_times_are_the_data_in_the_films_own_time(
    speed: float, window: tuple[float, float | None], fps: int
) -> None:
    start, stop = window
    film = short_film(Format(fps=fps, speed=speed, start=start, stop=stop))
    length = (0.5 if stop is None else stop) - start
    assert len(film.times) == max(1, round(length * fps / speed))
    assert film.times[0] == start
    np.testing.assert_allclose(np.diff(film.times), speed / fps, rtol=0, atol=1e-12)
    # The film lasts as long as the data, but for half a frame; nothing beyond them is shown.
    assert abs(len(film.times) / fps - length / speed) <= 0.5 / fps + 1e-12
    assert film.times[-1] < start + length


@pytest.mark.parametrize("speed", [2.0, 0.5])
def test_speed_divides_the_number_of_frames(speed: float) -> None:
    plain, other = short_film(Format(fps=20)), short_film(Format(fps=20, speed=speed))
    assert len(other.times) == len(plain.times) / speed


def test_a_film_shorter_than_a_frame_still_has_one() -> None:
    film = short_film(Format(fps=1, start=0.2, stop=0.3))
    np.testing.assert_array_equal(film.times, [0.2])


@pytest.mark.parametrize(("fps", "speed", "start"), [(7, 1.0, 0.0), (30, 0.37, 0.1), (24, 3.0, 0)])
def test_each_frame_shows_the_recorded_instant_nearest_to_it(
    fps: int, speed: float, start: float
) -> None:
    film = short_film(Format(fps=fps, speed=speed, start=start))
    time = film.takes[0].run.time
    nearest = np.abs(time[:, None] - film.times).argmin(axis=0)
    # Where two are equally near, either is right.
    np.testing.assert_allclose(
        np.abs(time[film.rows(film.takes[0])] - film.times),
        np.abs(time[nearest] - film.times),
        rtol=0,
        atol=1e-12,
    )


def test_a_run_that_ended_early_stays_at_its_last_row() -> None:
    film = swing_film(Format(fps=100))
    short, long = film.takes
    assert film.end == long.run.time[-1] == 0.5
    rows = film.rows(short)
    over = film.times >= short.run.time[-1]
    assert over.any()
    assert set(rows[over]) == {len(short.run.time) - 1}
    assert np.all(np.diff(rows) >= 0)
    assert np.all(np.diff(film.rows(long)) == 10)


def test_a_run_that_ended_at_its_start_stays_there_beside_one_that_goes_on() -> None:
    law = chapter_controller("fl-lqr", plant("cart_pendulum").analytic())
    push = Disturbance("cart", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    for disturbances in ((), (push,)):
        with pytest.raises(DivergenceError) as caught:
            simulate(
                plant("cart_pendulum"),
                law,
                [0.0, 1.7, 0.0, 0.0],
                duration=0.5,
                disturbances=disturbances,
            )
        ended = Take("FL + LQR", "#CC79A7", caught.value.trajectory, ended="law undefined")
        whole = Take("LQR", "#D55E00", short_run("cart_pendulum"))
        scene = storyboard(short_film(SMALL, "cart_pendulum", takes=(ended, whole))).scenes[0]
        assert scene.over == 0
        assert np.all(scene.physics == scene.physics[0])


def test_the_last_frame_says_that_the_only_run_ended_early() -> None:
    """Without another run the film itself ends where the run did."""
    board = storyboard(swing_film(Format(fps=100), ("fl-lqr",)))
    assert board.scenes[0].over <= len(board.times) - 1


# From where


@pytest.mark.parametrize(
    ("system", "camera"),
    [("servo", "fixed"), ("cart_pendulum", "follow"), ("arm", "fixed"), ("two_link_arm", "fixed")],
)
def test_the_default_camera_moves_along_where_something_travels(system: str, camera: str) -> None:
    film = short_film(SMALL, system)
    assert film.camera_name == camera
    moves = film.model.cam_mode[film.camera] == mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    assert moves == (camera == "follow")


def test_a_chosen_camera_is_taken(name: str) -> None:
    for camera in camera_names(short_film(SMALL, name).model):
        film = short_film(replace(SMALL, camera=camera), name)
        assert film.model.camera(film.camera).name == camera


def pose(model: mujoco.MjModel, physics: Any) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, physics, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_forward(model, data)
    return data


def updated_scene(model: mujoco.MjModel, data: mujoco.MjData, camera: int) -> mujoco.MjvScene:
    """What mujoco.Renderer.update_scene does, without OpenGL."""
    scene, eye = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, everything, scene)
    return scene


def pinhole(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    camera: int,
    points: Any,
    size: tuple[int, int],
    moved: Sequence[float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Column and row of points by the model's own camera: its place, axes and field of view."""
    axes = data.cam_xmat[camera].reshape(3, 3)
    eye = data.cam_xpos[camera] + axes @ np.array(moved)
    right, up, back = (np.atleast_2d(points) - eye) @ axes @ np.eye(3)[:, :, None]
    focal = size[1] / 2 / math.tan(math.radians(model.cam_fovy[camera]) / 2)
    columns = size[0] / 2 + focal * right / -back
    return np.column_stack([columns, size[1] / 2 - focal * up / -back])


def test_a_film_looks_through_the_camera_itself_not_one_of_its_stereo_eyes(name: str) -> None:
    model = filmed(name)
    for camera, angle in itertools.product(range(model.ncam), (-0.5, 0.3)):
        data = mujoco.MjData(model)
        data.qpos[-1] = angle
        mujoco.mj_forward(model, data)
        for eye in updated_scene(model, data, camera).camera:
            np.testing.assert_allclose(eye.pos, data.cam_xpos[camera], rtol=0, atol=1e-6)


def corners(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Corners of the boxes around every drawn geom that moves."""
    moving = np.flatnonzero(model.body_weldid[model.geom_bodyid])
    centre, half = model.geom_aabb[moving, None, :3], model.geom_aabb[moving, None, 3:]
    local = centre + half * list(itertools.product((-1, 1), repeat=3))
    rotation = data.geom_xmat[moving].reshape(-1, 1, 3, 3)
    turned = np.squeeze(rotation @ local[..., None], -1)
    return np.reshape(data.geom_xpos[moving, None] + turned, (-1, 3))


def furthest_out(board: Storyboard, moved: Sequence[float]) -> float:
    """How far from the picture's middle anything gets, 1 at the edge, over all frames."""
    box, most = board.layout.picture(0), 0.0
    size = np.array([box.width, box.height])
    for scene in board.scenes:
        for physics in scene.physics:
            data = pose(board.model, physics)
            points = corners(board.model, data)
            seen = pinhole(board.model, data, board.camera, points, (box.width, box.height), moved)
            most = max(most, float(np.abs(2 * seen / size - 1).max()))
    return most


def test_the_nominal_pictures_are_those_of_the_models_author(name: str) -> None:
    board = storyboard(case_film(name, "nominal", replace(SMALL, fps=3)))
    assert tuple(board.placement) == (0.0, 0.0, 0.0)
    assert furthest_out(board, board.placement) < 1


def test_the_camera_goes_back_for_a_pole_of_four_times_the_length_and_no_further() -> None:
    _, board = longer_pole()
    assert board.placement.back > 0
    assert furthest_out(board, (0.0, 0.0, 0.0)) > 1
    # All in view, and the picture is not emptier than it must be.
    assert 0.85 < furthest_out(board, board.placement) < 1


def test_the_move_goes_back_along_the_cameras_own_line_of_sight() -> None:
    _, board = longer_pole()
    data = pose(board.model, board.scenes[0].physics[0])
    scene = updated_scene(board.model, data, board.camera)
    before = [np.array(camera.pos, float) for camera in scene.camera]
    board.placement.apply(scene)
    axes = data.cam_xmat[board.camera].reshape(3, 3)
    for camera, pos in zip(scene.camera, before, strict=True):
        moved = (np.array(camera.pos, float) - pos) @ axes
        np.testing.assert_allclose(moved, board.placement, rtol=0, atol=10 * SINGLE)


def test_a_model_that_stands_still_asks_for_no_move() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><camera pos='0 -3 0' xyaxes='1 0 0 0 0 1'/>"
        "<geom size='9'/></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert tuple(place(model, 0, [data], 1.5)) == (0.0, 0.0, 0.0)


# Where everything is in a frame


def apart(one: Box, other: Box) -> bool:
    return (
        one.right <= other.left
        or other.right <= one.left
        or one.bottom <= other.top
        or other.bottom <= one.top
    )


@pytest.mark.parametrize("pictures", [1, 2, 3, 4])
@pytest.mark.parametrize("size", SIZES)
def test_pictures_are_equal_and_nothing_overlaps_or_leaves_the_frame(
    size: tuple[int, int], pictures: int
) -> None:
    layout = Layout(*size, pictures)
    shown = [layout.picture(i) for i in range(pictures)]
    boxes = [layout.title, *shown, *map(layout.label, range(pictures)), *map(layout.plot, range(3))]
    assert len({(box.width, box.height) for box in shown}) == 1
    assert all(apart(*pair) for pair in itertools.combinations(boxes, 2))
    for box in (*boxes, layout.clock):
        assert box.width > 0
        assert box.height > 0
        assert 0 <= box.left < box.right <= size[0]
        assert 0 <= box.top < box.bottom <= size[1]
    assert layout.clock.right == layout.title.right
    assert layout.clock.bottom <= layout.title.bottom
    for i, box in enumerate(shown):
        assert layout.label(i).bottom == box.top
        assert (layout.label(i).left, layout.label(i).width) == (box.left, box.width)


# The curves

FILMS = {
    "two laws": lambda: case_film("cart_pendulum", "nominal"),
    "edited": lambda: case_film("cart_pendulum", "case1", replace(SMALL, width=1280, height=720)),
    "disturbed": lambda: case_film("servo", "case1", replace(SMALL, start=8.0, stop=14.0)),
    "cut out of the middle": lambda: case_film("arm", "case1", replace(SMALL, start=1.0, stop=2)),
    "ended early": lambda: swing_film(replace(SMALL, width=1280, height=720)),
    "smallest": lambda: case_film("cart_pendulum", "nominal", Format(320, 240)),
}


@cache
def drawn(which: str) -> tuple[Film, Layout, Chart]:
    film = FILMS[which]()
    layout = Layout(film.format.width, film.format.height, len(film.takes))
    return film, layout, draw_chart(film, layout)


@pytest.mark.parametrize("which", FILMS)
def test_columns_go_from_the_first_to_the_last_of_the_axes(which: str) -> None:
    film, _, chart = drawn(which)
    first, last = chart.times
    assert first == film.format.start
    assert last == (film.end if film.format.stop is None else film.format.stop)
    for area in chart.areas:
        columns = [chart.column(area, t) for t in np.linspace(first, last, 500)]
        assert columns[0] == area.left
        assert columns[-1] == area.right - 1
        assert np.all(np.diff(columns) >= 0)
        assert chart.column(area, first - 1) == area.left
        assert chart.column(area, last + 1) == area.right - 1


@pytest.mark.parametrize("which", FILMS)
def test_curves_change_nothing_outside_the_axes(which: str) -> None:
    film, layout, chart = drawn(which)
    changed = np.any(chart.empty != chart.drawn, axis=2)
    assert changed.shape == (layout.height, layout.width)
    for i, area in enumerate(chart.areas):
        plot = layout.plot(i)
        assert plot.left <= area.left < area.right <= plot.right
        assert plot.top <= area.top < area.bottom <= plot.bottom
        part = changed[area.top : area.bottom, area.left : area.right]
        has_curves = i != 1 or any(take.run.sliding is not None for take in film.takes)
        assert part.any() == has_curves
        part[...] = False
    assert not changed.any()


def columns_of(chart: Chart, colour: str) -> np.ndarray:
    """Columns of the first plot where a curve of this colour is."""
    area = chart.areas[0]
    part = (slice(area.top, area.bottom), slice(area.left, area.right))
    away = np.abs(chart.drawn[part] - 255 * np.array(palette.red_green_blue(colour))).max(axis=2)
    changed = np.any(chart.drawn[part] != chart.empty[part], axis=2)
    return np.flatnonzero((changed & (away < 20)).any(axis=0)) + area.left


def test_curves_are_drawn_at_the_columns_of_their_times() -> None:
    """What ends at t fills the columns up to that of t, within the width of its line."""
    film, _, chart = drawn("ended early")
    for take in film.takes:
        end = chart.column(chart.areas[0], float(take.run.time[-1]))
        assert columns_of(chart, take.colour).max() == pytest.approx(end, abs=3)


def test_the_optimum_is_drawn_as_long_as_a_run_goes_on() -> None:
    _, _, chart = drawn("ended early")
    # A dash may just have ended.
    end = chart.areas[0].right - 1
    assert columns_of(chart, palette.OPTIMUM).max() == pytest.approx(end, abs=15)


@pytest.mark.parametrize("which", FILMS)
def test_titles_and_numbers_are_neither_behind_the_pictures_nor_cut_off(which: str) -> None:
    film, layout, chart = drawn(which)
    for i in range(len(film.takes)):
        box = layout.picture(i)
        assert chart.empty[box.top : box.bottom, box.left : box.right].min() == 255
    for edge in (chart.empty[0], chart.empty[-1], chart.empty[:, 0], chart.empty[:, -1]):
        assert edge.min() == 255


def test_what_stands_above_a_picture_stays_above_it() -> None:
    """The words above the second of three pictures must not run into those of its neighbours."""
    form = Format(640, 360)
    case = replace(find_case("cart_pendulum", "case2"), duration=0.1)
    laws = ("lqr", "fl-lqr", "grosmc")
    film = film_of([run_case(case, "physics", law, Settings()) for law in laws], form)
    layout = Layout(form.width, form.height, 3)
    # No name is longer than this one's.
    before, longest, after = film.takes
    bare = replace(longest, label="", ghost=None, run=replace(longest.run, wrench=None))
    without = replace(film, takes=(before, bare, after))
    frames = [draw_chart(each, layout).empty for each in (film, without)]
    # The plots may change with the take: only the row of labels is of interest.
    strip = layout.label(1)
    changed = np.any(frames[0] != frames[1], axis=2)[strip.top : strip.bottom]
    ink = np.flatnonzero(changed.any(axis=0))
    assert strip.left <= ink.min()
    assert ink.max() < strip.right


# What a worker is sent


def test_a_storyboard_grows_with_the_frames_and_not_with_the_data() -> None:
    def size(duration: float) -> int:
        take = Take("LQR", "#D55E00", short_run("cart_pendulum", duration))
        form = replace(SMALL, speed=duration)
        film = Film("A film", plant("cart_pendulum").model, (take,), form)
        assert len(film.times) == 10
        return len(pickle.dumps(storyboard(film)))

    assert size(6.0) == pytest.approx(size(1.0), rel=0.01)


def test_each_frame_has_the_rows_of_its_own_instant() -> None:
    film = case_film("cart_pendulum", "case2", replace(SMALL, start=8.0, stop=12.0))
    board = storyboard(film)
    for take, scene in zip(film.takes, board.scenes, strict=True):
        rows = film.rows(take)
        assert take.run.physics is not None
        assert take.run.wrench is not None
        assert scene.wrench is not None
        assert scene.ghost is not None
        # mjSTATE_FULLPHYSICS begins with the time.
        np.testing.assert_allclose(scene.physics[:, 0], film.times, rtol=0, atol=5e-4)
        np.testing.assert_array_equal(scene.physics, take.run.physics[rows])
        # Cart and pole, of which the law controls the pole.
        np.testing.assert_array_equal(scene.ghost[:, 0], scene.physics[:, 1])
        np.testing.assert_array_equal(scene.ghost[:, 1:], np.asarray(take.ghost)[rows])
        bodies = [film.model.body(name).id for name in take.run.system.bodies]
        wrench = scene.wrench[:, bodies].reshape(len(rows), -1)
        np.testing.assert_array_equal(wrench, take.run.wrench[rows])
    assert board.largest[0] == 0.0
    torques = np.abs([scene.wrench for scene in board.scenes if scene.wrench is not None])
    assert board.largest[1] == torques.max() > 0


def test_the_model_that_is_filmed_is_left_as_it_was() -> None:
    film, board = longer_pole()
    untouched = MujocoPlant.load("cart_pendulum", edits=find_case("cart_pendulum", "case1").edits)
    as_compiled, as_filmed = (np.zeros(mujoco.mj_sizeModel(film.model), np.uint8) for _ in range(2))
    mujoco.mj_saveModel(untouched.model, None, as_compiled)
    mujoco.mj_saveModel(film.model, None, as_filmed)
    np.testing.assert_array_equal(as_compiled, as_filmed)
    assert board.model is not film.model


# Arrows and arcs

BODIES = {"servo": "rotor", "cart_pendulum": "pole", "arm": "link", "two_link_arm": "lower"}


def copied(geoms: Any) -> list[dict[str, Any]]:
    """All that is drawn, by value."""
    numbers = ("type", "objtype", "objid", "category", "matid", "segid", "transparent")
    arrays = ("pos", "mat", "size", "rgba")
    return [
        {field: np.array(getattr(geom, field), float) for field in (*numbers, *arrays)}
        | {field: float(getattr(geom, field)) for field in ("specular", "shininess", "emission")}
        for geom in geoms
    ]


def assert_unchanged(before: list[dict[str, Any]], scene: mujoco.MjvScene) -> None:
    for old, new in zip(before, copied(scene.geoms[: len(before)]), strict=True):
        for field, value in old.items():
            np.testing.assert_array_equal(value, new[field], field)


def marked(
    system: str, force: Any, torque: Any, largest: tuple[float, float]
) -> tuple[mujoco.MjModel, mujoco.MjData, list[dict[str, Any]], np.ndarray]:
    """The geoms that a wrench on one body adds, and that body's projected centre of mass."""
    model = filmed(system)
    data = pose(model, short_run(system).physics[200])  # pyright: ignore[reportOptionalSubscript]
    body, camera = model.body(BODIES[system]).id, short_film(SMALL, system).camera
    data.xfrc_applied[body] = [*force, *torque]
    scene = updated_scene(model, data, camera)
    before = copied(scene.geoms[: scene.ngeom])
    add_wrenches(scene, model, data, largest)
    assert_unchanged(before, scene)
    added = copied(scene.geoms[len(before) : scene.ngeom])
    for geom in added:
        np.testing.assert_allclose(geom["rgba"], [*GREEN, 1.0], rtol=0, atol=SINGLE)
    seen = pinhole(model, data, camera, data.xipos[body], PICTURE)[0]
    return model, data, added, seen


def seen_at(system: str, data: mujoco.MjData, point: Any) -> np.ndarray:
    camera = short_film(SMALL, system).camera
    return pinhole(filmed(system), data, camera, point, PICTURE)[0]


def test_no_wrench_adds_nothing(name: str) -> None:
    for largest in ((0.0, 0.0), (5.0, 2.0)):
        assert marked(name, np.zeros(3), np.zeros(3), largest)[2] == []


def test_a_force_is_an_arrow_in_its_direction(name: str) -> None:
    _, _, (arrow,), _ = marked(name, FORCE, np.zeros(3), (5.0, 0.0))
    assert arrow["type"] == int(mujoco.mjtGeom.mjGEOM_ARROW)
    # An arrow points along its own z.
    np.testing.assert_allclose(arrow["mat"][:, 2], FORCE / 5.0, rtol=0, atol=SINGLE)


def test_an_arrow_is_as_long_as_its_force_is_large(name: str) -> None:
    lengths = [
        marked(name, part * FORCE, np.zeros(3), (5.0, 0.0))[2][0]["size"][2]
        for part in (0.25, 0.5, 1.0)
    ]
    np.testing.assert_allclose(np.array(lengths) / lengths[-1], [0.25, 0.5, 1.0], rtol=1e-5)


def test_an_arrow_begins_where_the_centre_of_mass_is_seen(name: str) -> None:
    """Nearer to the camera, so that nothing hides it, and yet at the same place of the picture."""
    _, data, (arrow,), expected = marked(name, FORCE, np.zeros(3), (5.0, 0.0))
    np.testing.assert_allclose(seen_at(name, data, arrow["pos"]), expected, rtol=0, atol=0.05)


def circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and radius of the circle through points of one plane."""
    middle = points.mean(axis=0)
    away = points - middle
    # |p - c|^2 = r^2 is linear in c and r^2 - |c|^2; of the plane's normal nothing is known.
    system = np.column_stack([2 * away, np.ones(len(away))])
    solution = np.linalg.lstsq(system, np.sum(away**2, axis=1), rcond=1e-4)[0]
    centre = solution[:3]
    return middle + centre, math.sqrt(solution[3] + centre @ centre)


def arc_of(
    system: str, torque: np.ndarray, largest: float = 2.0
) -> tuple[mujoco.MjData, np.ndarray, dict[str, Any], np.ndarray]:
    """Middles of the arc's pieces, in order, its head, and the projected centre of mass."""
    _, data, added, seen = marked(system, np.zeros(3), torque, (0.0, largest))
    pieces, (head,) = added[:-1], added[-1:]
    assert head["type"] == int(mujoco.mjtGeom.mjGEOM_ARROW)
    assert {int(piece["type"]) for piece in pieces} == {int(mujoco.mjtGeom.mjGEOM_CAPSULE)}
    return data, np.array([piece["pos"] for piece in pieces]), head, seen


@pytest.mark.parametrize("torque", [TORQUE, -TORQUE, np.array([0.0, 0.0, 2.0]), [1.2, 1.6, 0.0]])
def test_a_torque_is_an_arc_about_its_axis_right_handed(name: str, torque: Any) -> None:
    torque = np.array(torque)
    data, points, head, expected = arc_of(name, torque)
    centre, radius = circle(points)
    np.testing.assert_allclose((points - centre) @ torque, 0.0, rtol=0, atol=10 * SINGLE)
    np.testing.assert_allclose(np.linalg.norm(points - centre, axis=1), radius, rtol=1e-4)
    turned = np.cross(points[:-1] - centre, points[1:] - centre) @ torque
    assert np.all(turned > 0)
    # The head goes on where the arc ends.
    assert np.cross(head["pos"] - centre, head["mat"][:, 2]) @ torque > 0
    assert np.linalg.norm(head["pos"] - centre) == pytest.approx(radius, rel=0.02)
    np.testing.assert_allclose(seen_at(name, data, centre), expected, rtol=0, atol=0.05)


def test_an_arc_is_as_long_as_its_torque_is_large(name: str) -> None:
    def sweep(part: float) -> float:
        _, points, _, _ = arc_of(name, part * TORQUE)
        centre, _ = circle(points)
        away = (points - centre) / np.linalg.norm(points - centre, axis=1)[:, None]
        steps = np.sum(away[:-1] * away[1:], axis=1)
        return float(np.arccos(np.clip(steps, -1, 1)).sum())

    whole = sweep(1.0)
    assert whole < 2 * math.pi
    # The arc cosine of single-precision numbers near 1 loses half their digits.
    assert sweep(0.5) == pytest.approx(whole / 2, rel=0.02)


def test_force_and_torque_of_one_body_are_both_drawn(name: str) -> None:
    _, _, both, _ = marked(name, FORCE, TORQUE, (5.0, 2.0))
    _, _, force, _ = marked(name, FORCE, np.zeros(3), (5.0, 2.0))
    _, _, torque, _ = marked(name, np.zeros(3), TORQUE, (5.0, 2.0))
    assert len(both) == len(force) + len(torque)


def test_a_full_scene_gets_no_arrow_and_no_error() -> None:
    model = plant("servo").model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    data.xfrc_applied[1] = [*FORCE, *TORQUE]
    count = updated_scene(model, data, 0).ngeom
    scene, eye = mujoco.MjvScene(model, count + 5), mujoco.MjvCamera()
    mujoco.mjv_updateScene(
        model, data, mujoco.MjvOption(), None, eye, mujoco.mjtCatBit.mjCAT_ALL.value, scene
    )
    add_wrenches(scene, model, data, (5.0, 2.0))
    assert scene.ngeom == scene.maxgeom


# The ghost


def test_the_ghost_is_the_indicator_alone_translucent_and_at_its_own_pose(name: str) -> None:
    film, model = short_film(SMALL, name), filmed(name)
    data = pose(model, film.takes[0].run.physics[200])  # pyright: ignore[reportOptionalSubscript]
    other = mujoco.MjData(model)
    other.qpos[:] = data.qpos
    other.qpos[-1] += 0.4
    mujoco.mj_forward(model, other)
    scene = updated_scene(model, data, film.camera)
    before = copied(scene.geoms[: scene.ngeom])
    add_ghost(scene, model, other, mujoco.MjvOption())
    assert_unchanged(before, scene)
    added = copied(scene.geoms[len(before) : scene.ngeom])
    indicators = set(np.flatnonzero(model.geom_group == 2).tolist())
    assert len(indicators) == len(added) > 0
    assert {int(geom["objid"]) for geom in added} == indicators
    for geom in added:
        index = int(geom["objid"])
        assert geom["objtype"] == int(mujoco.mjtObj.mjOBJ_GEOM)
        assert 0 < geom["rgba"][3] < 1
        np.testing.assert_allclose(
            geom["rgba"][:3], palette.red_green_blue(palette.OPTIMUM), rtol=0, atol=SINGLE
        )
        np.testing.assert_allclose(
            geom["mat"], other.geom_xmat[index].reshape(3, 3), rtol=0, atol=SINGLE
        )
        expected = seen_at(name, other, other.geom_xpos[index])
        np.testing.assert_allclose(seen_at(name, other, geom["pos"]), expected, rtol=0, atol=0.05)


def test_without_an_indicator_all_that_moves_is_the_ghost() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><camera pos='0 -3 0' xyaxes='1 0 0 0 0 1'/><geom size='0.1'/>"
        "<body><joint type='hinge'/><geom size='0.1' pos='1 0 0'/><geom size='0.1' group='3'/>"
        "<geom size='0.1' pos='2 0 0'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = updated_scene(model, data, 0)
    first = scene.ngeom
    add_ghost(scene, model, data, mujoco.MjvOption())
    assert [geom.objid for geom in scene.geoms[first : scene.ngeom]] == [1, 3]


@pytest.mark.parametrize("system", ["servo", "cart_pendulum"])
def test_where_the_reference_rests_the_ghost_is_the_nominal_optimum(system: str) -> None:
    film = case_film(system, "nominal")
    assert (film.ghost_label, film.ghost_symbol) == ("nominal optimum", "x*")
    for take in film.takes:
        assert take.ghost is not None
        y = take.run.state[:, take.run.system.output]
        goal = {"servo": 1.0, "cart_pendulum": 0.0}[system]
        ghost = take.ghosts[:, 0]
        assert ghost[0] == pytest.approx(y[0], abs=1e-12)
        assert abs(ghost[-1] - goal) < 0.02 * abs(ghost[0] - goal)


def test_the_ghost_of_the_nominal_servo_is_what_lqr_makes_of_it() -> None:
    """The plant is linear and the law is the one that the optimum was designed with."""
    take = case_film("servo", "nominal").takes[0]
    assert take.ghost is not None
    # A law sampled every millisecond lags half of one behind: 1e-3 of the step's rate.
    np.testing.assert_allclose(take.ghosts, take.run.state[:, :1], rtol=0, atol=2e-3)


@pytest.mark.slow
def test_ghost_of_two_outputs_has_the_reference_in_both_joints() -> None:
    """The circle is the tip's: the ghost's joints are those that put it there."""
    film = case_film("two_link_arm", "nominal")
    assert (film.ghost_label, film.ghost_symbol) == ("reference", "yᵣ")
    p = TwoLinkParameters.from_model(plant("two_link_arm").model)
    for take in film.takes:
        assert take.ghosts.shape == (len(take.run.time), 2)
        # The elbow stays on the side that the run is on.
        assert np.all(take.ghosts[:, 1] < 0)
        for t, q in zip(take.run.time[::100], take.ghosts[::100], strict=True):
            expected = TWO_LINK_TIP.reference(float(t), TWO_LINK_CIRCLE)
            np.testing.assert_allclose(tip(q, p), [expected[0], expected[3]], rtol=0, atol=1e-8)
        board = storyboard(replace(film, takes=(take,)))
        ghost = board.scenes[0].ghost
        assert ghost is not None
        np.testing.assert_array_equal(ghost, take.ghosts[film.rows(take)])


def test_where_the_reference_moves_the_ghost_is_the_reference() -> None:
    film = case_film("arm", "case1")
    assert (film.ghost_label, film.ghost_symbol) == ("reference", "yᵣ")
    for take in film.takes:
        expected = np.sin(math.pi * take.run.time)
        np.testing.assert_allclose(take.ghosts, expected[:, None], rtol=0, atol=1e-9)


# Colours and names


@pytest.mark.parametrize("case", ["nominal", "case1"])
def test_takes_have_the_palettes_colours_and_names(case: str) -> None:
    names = ("lqr", "fl-lqr", "grosmc")
    film = case_film("cart_pendulum", case, SMALL, names)
    assert [take.colour for take in film.takes] == [palette.COLOURS[name] for name in names]
    assert [take.label for take in film.takes] == [palette.LABELS[name] for name in names]
    assert not any(take.ended for take in film.takes)
    reversed_film = case_film("cart_pendulum", case, SMALL, ("grosmc", "lqr"))
    assert [take.colour for take in reversed_film.takes] == ["#0072B2", "#D55E00"]


def test_four_controllers_of_ones_own_have_four_colours() -> None:
    run = result("servo", "nominal", "lqr")
    film = film_of([run] * 4, SMALL, ("mine", "yours", "hers", "theirs"))
    assert len({take.colour for take in film.takes}) == 4


def test_no_colour_means_two_things() -> None:
    colours = [*palette.COLOURS.values(), *palette.OTHERS, palette.DISTURBANCE]
    assert len({colour.lower() for colour in colours}) == len(colours)
    assert set(palette.COLOURS) == set(palette.LABELS)


@pytest.mark.parametrize(("colour", "expected"), [("#000000", (0, 0, 0)), ("#FF0033", (1, 0, 0.2))])
def test_colours_as_numbers(colour: str, expected: tuple[float, float, float]) -> None:
    assert palette.red_green_blue(colour) == expected


def test_a_validation_gives_one_film_a_case_of_physics_alone() -> None:
    selected = [find_case("servo", "nominal"), find_case("servo", "case2")]
    results = [
        run_case(selected[0], "corrected", "lqr", Settings()),
        *(result("servo", case.name, law) for case in selected for law in ("grosmc", "lqr")),
    ]
    films = films_of(results, SMALL)
    assert [case for case, _ in films] == selected
    for case, film in films:
        assert [take.label for take in film.takes] == ["LQR", "GROSMC"]
        assert case.title in film.title
        assert film.format == SMALL
    # Without one of the two laws there is nothing to show side by side.
    assert films_of([each for each in results if each.controller.name == "lqr"]) == []


def test_the_title_says_which_case_of_which_system_it_is() -> None:
    film = case_film("cart_pendulum", "case1")
    assert film.title == "Cart-pendulum, case1: Four times the mass and the length of the pole"
