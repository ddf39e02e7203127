"""What a film will show, before anything is rendered: times, places, curves, marks and ghosts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from hand_written import tip
from shipped import TWO_LINK_CIRCLE, TWO_LINK_TIP, find_case, run_case, run_on

from grosmc_mj.arrays import Array
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.films import film_digest, film_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films import frames
from grosmc_mj.films.film import Film, Format, Take
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.scene import (
    FREE_CAMERA,
    add_ghost,
    add_wrenches,
    camera_names,
    default_camera,
    move,
    place,
)
from grosmc_mj.films.storyboard import draw_chart, film_model, inputs, outputs, storyboard, surfaces
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO, SYSTEMS
from grosmc_mj.results import palette
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

pytestmark = pytest.mark.slow

SMALL = Format(480, 320, fps=10)
# The part of a picture that what moves may fill, its width over its height, a field of view.
FILLED, ASPECT, FOV = 0.92, 1.5, 40.0
# Positions in a scene are single precision.
SINGLE = 1e-5
GREEN = palette.red_green_blue(palette.DISTURBANCE)


@cache
def plant(system: str) -> MujocoPlant:
    return MujocoPlant.load(system)


def made_up(system: str = "servo", speed: float = 1.0, end: int = 100) -> Trajectory:
    """A run of a second whose first coordinate moves, pushed from 0.4 s to 0.6 s."""
    model, n = plant(system).model, plant(system).system.degrees_of_freedom
    time = np.arange(1001) / 1000
    wrench = np.zeros((1000, 6 * len(plant(system).system.bodies)))
    wrench[400:600, -2] = 3.0
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    physics = np.zeros((1001, size))
    physics[:, 0], physics[:, 1] = time, speed * time
    cut = slice(10 * end + 1)
    last = slice(10 * end)
    return Trajectory(
        system=plant(system).system, time=time[cut], state=physics[cut, 1 : 1 + 2 * n],
        command=np.ones(10 * end), input=np.linspace(-3, 2, 1000)[last],
        sliding=np.linspace(0.4, -0.6, 1000)[last], weighed=np.ones(10 * end),
        memory=np.zeros(10 * end, [("v", np.float64)]), wrench=wrench[last], physics=physics[cut],
        status=np.array([Status.COMPLETED], object)[0], valid_until=np.array(end / 100),
    )  # fmt: skip


def film(form: Format = SMALL, *runs: Trajectory, **of_takes: Any) -> Film:
    """A film of runs of a servo, each with a ghost at 1.5 rad."""
    takes = []
    for label, colour, run in zip("AB", ("#D55E00", "#0072B2"), runs or [made_up()], strict=False):
        ghost = np.full((len(run.time), 1), 1.5)
        takes.append(Take(label, colour, run, ghost, sliding_unit="A s", **of_takes))
    return Film("A film", plant("servo").model, tuple(takes), form)


@cache
def result(system: str, case: str, controller: str) -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


@cache
def case_film(system: str, case: str, form: Format = SMALL) -> Film:
    return film_of([result(system, case, name) for name in ("lqr", "grosmc")], form)


# What a film refuses


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 641}, "641 x 720 pixels: both must be even"),
        ({"height": 361}, "1280 x 361 pixels: both must be even"),
        ({"width": 318}, "width = 318 must be a whole number from 320 to 3840 pixels"),
        ({"height": 2162}, "height = 2162 must be .* from 240 to 2160 pixels"),
        ({"fps": 241}, "fps = 241 must be a whole number from 1 to 240"),
        ({"speed": 0.0}, "speed = 0 must be from 0.015625 to 64"),
        ({"start": -0.1}, "start = -0.1 must be finite and not negative"),
        ({"stop": math.inf}, "stop = inf "),
    ],
)
def test_a_format_that_cannot_be_cut_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Format(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": Format(start=1.0)}, "from 1 s to 1 s shows nothing: the runs begin at 0 s and"),
        ({"format": Format(start=0.5, stop=0.4)}, "from 0.5 s to 0.4 s shows nothing"),
        ({"format": Format(stop=1.1)}, "to 1.1 s shows nothing: .* end at 1 s"),
        ({"format": Format(camera="folow")}, "camera 'folow': did you mean 'follow'"),
        ({"takes": ()}, "one to four runs, not 0"),
        ({"takes": film().takes * 5}, "not 5"),
        ({"model": plant("arm").model}, "a run of servo is not of this model"),
        ({"model": plant("cart_pendulum").model}, "a run of servo is not of this model"),
    ],
)
def test_a_film_that_would_show_nothing_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        replace(film(), **changes)


def test_only_a_recorded_run_in_mujoco_can_be_filmed() -> None:
    law, start = chapter_controller("lqr", plant("servo").analytic()), [0.0, 0.0]
    analytic = simulate(plant("servo").analytic(), law, start, duration=0.01)
    batch = simulate(plant("servo"), law, [start, start], duration=0.01)
    for run in (analytic, batch):
        with pytest.raises(ArgumentError, match="A: a film needs one recorded run in MuJoCo"):
            Take("A", "#D55E00", run)
    ends = simulate(plant("servo"), law, start, duration=1.0, record=False)
    with pytest.raises(ArgumentError, match="was not recorded"):
        Film("A film", plant("servo").model, (Take("A", "#D55E00", ends),))
    for ghost in (np.zeros((1000, 1)), np.zeros((1001, 2))):
        with pytest.raises(ArgumentError, match=r"A: the ghost has shape .* must be \(1001, 1\)"):
            Take("A", "#D55E00", made_up(), ghost)
    results = [result("servo", "nominal", "lqr"), result("servo", "case2", "lqr")]
    with pytest.raises(ArgumentError, match="runs of one case on physics"):
        film_of(results)


# Which instants its frames show


@pytest.mark.parametrize("speed", [1.0, 2.0, 0.3])
@pytest.mark.parametrize("window", [(0.0, None), (0.0, 0.35), (0.123, 0.3)])
def test_a_frame_shows_the_recorded_instant_nearest_to_its_own(
    speed: float, window: tuple[float, float | None]
) -> None:
    start, stop = window
    shown = film(Format(fps=24, speed=speed, start=start, stop=stop))
    length = (1.0 if stop is None else stop) - start
    assert len(shown.times) == max(1, round(length * 24 / speed))
    assert shown.times[0] == start
    np.testing.assert_allclose(np.diff(shown.times), speed / 24, rtol=0, atol=1e-12)
    assert shown.times[-1] < start + length
    time = shown.takes[0].run.time
    off = np.abs(time[shown.rows(shown.takes[0])] - shown.times)
    # Where two are equally near, either is right.
    nearest = np.abs(time[:, None] - shown.times).min(axis=0)
    np.testing.assert_allclose(off, nearest, rtol=0, atol=1e-12)


def test_a_run_that_ended_early_stays_at_its_last_row_and_is_pushed_no_more() -> None:
    """Ended at 0.5 s in the middle of its push, beside one that goes on."""
    shown = film(SMALL, made_up(), made_up(end=50))
    rows = [list(shown.rows(take)) for take in shown.takes]
    assert rows == [list(range(0, 1000, 100)), [0, 100, 200, 300, 400, *[500] * 5]]
    whole, short = storyboard(shown).scenes
    assert whole.wrench is not None
    assert short.wrench is not None
    assert np.flatnonzero(whole.wrench.any(axis=(1, 2))).tolist() == [4, 5]
    assert np.flatnonzero(short.wrench.any(axis=(1, 2))).tolist() == [4]


def test_a_scene_has_the_rows_of_its_instants() -> None:
    shown = case_film("cart_pendulum", "case2", replace(SMALL, start=8.0, stop=12.0))
    board = storyboard(shown)
    torques = [0.0]
    for take, scene in zip(shown.takes, board.scenes, strict=True):
        rows, run = shown.rows(take), take.run
        assert run.physics is not None
        assert run.wrench is not None
        assert scene.wrench is not None
        assert scene.ghost is not None
        assert take.ghost is not None
        np.testing.assert_array_equal(scene.physics, run.physics[rows])
        np.testing.assert_allclose(scene.physics[:, 0], shown.times, rtol=0, atol=5e-4)
        # Cart and pole, of which the law controls the pole.
        np.testing.assert_array_equal(scene.ghost[:, 0], scene.physics[:, 1])
        np.testing.assert_array_equal(scene.ghost[:, 1:], take.ghost[rows])
        bodies = [shown.model.body(name).id for name in run.system.bodies]
        wrench = scene.wrench[:, bodies].reshape(len(rows), -1)
        np.testing.assert_array_equal(wrench, run.wrench[rows])
        torques.append(float(np.abs(scene.wrench[..., 3:]).max()))
    assert board.largest.tolist() == [0.0, max(torques)]
    assert max(torques) > 0


def test_all_that_a_film_shows_makes_another_digest() -> None:
    board = storyboard(film())
    (scene,) = board.scenes
    changes: dict[str, Any] = {"physics": scene.physics + 1, "ghost": None, "wrench": None}
    assert tuple(changes) == scene._fields
    others = [
        *(replace(board, scenes=(scene._replace(**{k: value}),)) for k, value in changes.items()),
        replace(board, speed=2.0), replace(board, placement=board.placement + 1),
        replace(board, chart=board.chart._replace(drawn=board.chart.empty)),
    ]  # fmt: skip
    assert len({film_digest(each) for each in (board, *others)}) == 1 + len(others)


# From where


@pytest.mark.parametrize(
    ("system", "camera"),
    [("servo", "fixed"), ("cart_pendulum", "follow"), ("arm", "fixed"), ("two_link_arm", "fixed")],
)
def test_the_default_camera_moves_along_where_something_travels(system: str, camera: str) -> None:
    shown = case_film(system, "nominal", replace(SMALL, fps=3))
    assert shown.camera_name == camera
    other = camera_names(shown.model)[-1]
    assert replace(shown, format=replace(SMALL, camera=other)).camera_name == other
    # The pictures of the nominal case are those of the model's author.
    assert not storyboard(shown).placement.any()


def boxes(*centres: Sequence[float], camera: str = "") -> mujoco.MjModel:
    """Moving cubes of 0.2 m, before a camera that looks along y from 4 m away."""
    bodies = "".join(
        f"<body pos='{x} {y} {z}'><joint/><geom type='box' size='.1 .1 .1'/>{camera}</body>"
        for x, y, z in centres
    )
    own = f"<camera name='hall' pos='0 -4 0' xyaxes='1 0 0 0 0 1' fovy='{FOV}'/>"
    xml = f"<mujoco><worldbody>{bodies}{'' if camera else own}</worldbody></mujoco>"
    return mujoco.MjModel.from_xml_string(xml)


def state_of(model: mujoco.MjModel, *qpos: float) -> Array:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos or data.qpos
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def picture(centres: Sequence[Sequence[float]], moved: Sequence[float]) -> Array:
    """Least and greatest column and row, 1 at the edges, of the cubes' corners, (2, 2)."""
    signs = np.reshape(np.meshgrid(*[[-0.1, 0.1]] * 3), (3, 8)).T
    x, y, z = np.concatenate([np.array(centre) + signs for centre in centres]).T
    right, up, back = moved
    high = math.tan(math.radians(FOV) / 2) * (y + 4 + back)
    seen = np.array([(x - right) / (ASPECT * high), (z - up) / high])
    return np.array([seen.min(axis=1), seen.max(axis=1)])


@pytest.mark.parametrize(
    "centres",
    [((-1.0, 0.0, 0.2), (5.0, 2.0, 0.0)), ((0.5, -1.0, 3.0), (0.0, 0.5, -1.0)),
     ((2.0, 0.0, 2.0), (4.0, 0.0, 5.0))],
)  # fmt: skip
def test_the_camera_centres_what_moves_and_goes_back_no_further_than_it_must(
    centres: Sequence[Sequence[float]],
) -> None:
    """One side of the picture is filled from edge to edge, the other no more than that."""
    model = boxes(*centres)
    moved = place(model, 0, state_of(model)[None], ASPECT)
    least, most = picture(centres, tuple(moved))
    full = int(np.argmax(most - least))
    assert (least[full], most[full]) == pytest.approx((-FILLED, FILLED), abs=SINGLE)
    assert -FILLED <= least[1 - full] < most[1 - full] <= FILLED
    assert moved[2] > 0


def test_the_camera_moves_no_more_than_it_must() -> None:
    # Beside the picture: sideways only. Within it, or MuJoCo's own camera: not at all.
    model = boxes((4.0, 0.0, -2.5))
    assert place(model, 0, state_of(model)[None], ASPECT) == pytest.approx([4.0, -2.5, 0.0])
    assert not place(model, FREE_CAMERA, state_of(model)[None], ASPECT).any()
    edge = FILLED * math.tan(math.radians(FOV) / 2) * 3.9
    for further, still in ((-0.01, True), (0.01, False)):
        model = boxes((-ASPECT * edge + 0.1 - further, 0.0, edge - 0.1 + further))
        assert place(model, 0, state_of(model)[None], ASPECT).any() != still
    # All poses count together: a cart that ends 6 m to the right of where it starts.
    model = plant("cart_pendulum").model
    ends = np.array([state_of(model, x, 0.0) for x in (0.0, 6.0)])
    assert place(model, model.camera("fixed").id, ends, ASPECT)[0] == pytest.approx(3.0, abs=1e-3)


def test_a_camera_on_the_hand_is_not_what_a_film_looks_through() -> None:
    hand = boxes((0.0, 0.0, 0.0), camera="<camera name='hand'/>")
    assert default_camera(hand) == FREE_CAMERA
    assert default_camera(boxes((0.0, 0.0, 0.0))) == 0


def pinhole(
    model: mujoco.MjModel, data: mujoco.MjData, camera: int, point: Any, moved: Any = (0, 0, 0)
) -> Array:
    """Where a point is seen from a camera's own place and axes, as slopes to the right and up."""
    axes = data.cam_xmat[camera].reshape(3, 3)
    right, up, back = (point - data.cam_xpos[camera]) @ axes - moved
    return np.array([right, up]) / -back


def updated_scene(
    model: mujoco.MjModel, data: mujoco.MjData, camera: int
) -> mujoco.MjvScene:  # as mujoco.Renderer does, without OpenGL
    scene, eye = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
    everything = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, everything, scene)
    return scene


def test_a_moved_scene_is_seen_from_the_camera_s_moved_eye() -> None:
    by = np.array([0.3, -0.2, 1.0])
    for system, camera in itertools.product(SYSTEMS, ("fixed", "follow")):
        model = film_model(plant(system).model, 320, 240)
        data, index = mujoco.MjData(model), model.camera(camera).id
        mujoco.mj_forward(model, data)
        scene = updated_scene(model, data, index)
        move(scene, by)
        wanted = data.cam_xpos[index] + data.cam_xmat[index].reshape(3, 3) @ by
        for eye in scene.camera:
            np.testing.assert_allclose(eye.pos, wanted, rtol=0, atol=SINGLE)


# Arrows, arcs and ghosts

BODIES = {"servo": "rotor", "cart_pendulum": "pole", "arm": "link", "two_link_arm": "lower"}


@cache
def posed(system: str) -> tuple[mujoco.MjModel, mujoco.MjData, int]:
    """A model as a film has it, in some pose, and its default camera."""
    model = film_model(plant(system).model, 320, 240)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3
    mujoco.mj_forward(model, data)
    return model, data, default_camera(model)


def marks(system: str, force: Any, torque: Any, largest: Sequence[float]) -> list[Any]:
    """Kind, position, orientation and length of the marks of a wrench."""
    model, data, camera = posed(system)
    data.xfrc_applied[:] = 0
    data.xfrc_applied[model.body(BODIES[system]).id] = [*force, *torque]
    scene = updated_scene(model, data, camera)
    first = scene.ngeom
    add_wrenches(scene, model, data, np.array(largest))
    added = scene.geoms[first : scene.ngeom]
    assert all(np.allclose(geom.rgba, [*GREEN, 1.0]) for geom in added)
    return [(geom.type, np.array(geom.pos, float), np.array(geom.mat, float).reshape(3, 3),
             float(geom.size[2])) for geom in added]  # fmt: skip


def seen_of(system: str, point: Any) -> Array:
    model, data, camera = posed(system)
    return pinhole(model, data, camera, point)


def centre_of_mass(system: str) -> Array:
    model, data, _ = posed(system)
    return data.xipos[model.body(BODIES[system]).id]


def test_a_force_is_an_arrow_in_its_direction_as_long_as_it_is_large(name: str) -> None:
    force, none = np.array([3.0, 0.0, -4.0]), np.zeros(3)
    assert marks(name, none, none, (5.0, 2.0)) == []
    assert marks(name, none, none, (0.0, 0.0)) == []
    lengths = []
    for part in (0.25, 0.5, 1.0):
        ((kind, start, axes, length),) = marks(name, part * force, none, (5.0, 0.0))
        assert kind == mujoco.mjtGeom.mjGEOM_ARROW
        # An arrow points along its own z, from where the centre of mass is seen.
        np.testing.assert_allclose(axes[:, 2], force / 5.0, rtol=0, atol=SINGLE)
        seen = seen_of(name, start)
        np.testing.assert_allclose(seen, seen_of(name, centre_of_mass(name)), rtol=0, atol=1e-4)
        lengths.append(length / part)
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-5)


@pytest.mark.parametrize("torque", [(0, 2, 0), (0, -2, 0), (0, 0, 2), (1.2, 1.6, 0)])
def test_a_torque_is_an_arc_about_its_axis_right_handed(name: str, torque: Any) -> None:
    axis = np.array(torque) / 2.0
    pieces = marks(name, np.zeros(3), 2 * axis, (0.0, 2.0))
    assert {kind for kind, *_ in pieces[:-1]} == {mujoco.mjtGeom.mjGEOM_CAPSULE}
    kind, head, axes, _ = pieces[-1]
    assert kind == mujoco.mjtGeom.mjGEOM_ARROW
    points = np.array([position for _, position, _, _ in pieces[:-1]])
    centre = _centre(points)
    np.testing.assert_allclose((points - centre) @ axis, 0.0, rtol=0, atol=10 * SINGLE)
    turned = np.cross(points[:-1] - centre, points[1:] - centre) @ axis
    assert np.all(turned > 0)
    assert np.cross(head - centre, axes[:, 2]) @ axis > 0
    seen = seen_of(name, centre)
    np.testing.assert_allclose(seen, seen_of(name, centre_of_mass(name)), rtol=0, atol=2e-4)
    half = marks(name, np.zeros(3), axis, (0.0, 2.0))
    shorter = np.array([position for _, position, _, _ in half[:-1]])
    assert _sweep(shorter, centre) == pytest.approx(_sweep(points, centre) / 2, rel=0.02)
    assert _sweep(points, centre) < 2 * math.pi


def _centre(points: Array) -> Array:
    """Of the circle through points of one plane: |p - c|^2 = r^2 is linear in c."""
    middle = points.mean(axis=0)
    away = points - middle
    system = np.column_stack([2 * away, np.ones(len(away))])
    return middle + np.linalg.lstsq(system, np.sum(away**2, axis=1), rcond=1e-4)[0][:3]


def _sweep(points: Array, centre: Array) -> float:
    """The angle from the first to the last point."""
    away = (points - centre) / np.linalg.norm(points - centre, axis=1)[:, None]
    steps = np.sum(away[:-1] * away[1:], axis=1)
    return float(np.arccos(np.clip(steps, -1, 1)).sum())


def test_the_ghost_is_the_indicator_alone_translucent_at_its_own_pose(name: str) -> None:
    model, data, camera = posed(name)
    other = mujoco.MjData(model)
    other.qpos[:] = data.qpos + 0.4
    mujoco.mj_forward(model, other)
    scene = updated_scene(model, data, camera)
    first = scene.ngeom
    add_ghost(scene, model, other)
    added = scene.geoms[first : scene.ngeom]
    assert {geom.objid for geom in added} == set(np.flatnonzero(model.geom_group == 2).tolist())
    for geom in added:
        assert 0 < geom.rgba[3] < 1
        expected = pinhole(model, data, camera, other.geom_xpos[geom.objid])
        seen = pinhole(model, data, camera, np.array(geom.pos, float))
        np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("system", ["servo", "cart_pendulum"])
def test_where_the_reference_rests_the_ghost_is_the_nominal_optimum(system: str) -> None:
    shown = case_film(system, "nominal", replace(SMALL, fps=3))
    assert (shown.ghost_label, shown.ghost_symbol) == ("nominal optimum", "x*")
    goal = {"servo": 1.0, "cart_pendulum": 0.0}[system]
    for take in shown.takes:
        assert take.ghost is not None
        y, ghost = take.run.state[:, take.run.system.output], take.ghost[:, 0]
        assert ghost[0] == pytest.approx(y[0], abs=1e-12)
        assert abs(ghost[-1] - goal) < 0.02 * abs(ghost[0] - goal)
        if system == "servo" and take.label == "LQR":
            # The plant is linear and the law is the optimum's: it lags half a sample behind.
            np.testing.assert_allclose(ghost, y, rtol=0, atol=2e-3)


def test_where_the_reference_moves_the_ghost_is_the_reference() -> None:
    """Of two outputs the ghost's joints are those that put the tip on the circle."""
    arm = case_film("arm", "case1")
    assert (arm.ghost_label, arm.ghost_symbol) == ("reference", "yᵣ")
    expected = np.sin(math.pi * arm.takes[0].run.time)
    ghost = np.asarray(arm.takes[0].ghost)
    np.testing.assert_allclose(ghost, expected[:, None], rtol=0, atol=1e-9)
    two = case_film("two_link_arm", "nominal", replace(SMALL, fps=3))
    p = plant("two_link_arm").parameters
    for take in two.takes:
        assert take.ghost is not None
        # The elbow stays on the side that the run is on.
        assert np.all(take.ghost[:, 1] < 0)
        for t, q in zip(take.run.time[::200], take.ghost[::200], strict=True):
            wanted = TWO_LINK_TIP.reference(float(t), TWO_LINK_CIRCLE)
            np.testing.assert_allclose(tip(q, p), [wanted[0], wanted[3]], rtol=0, atol=1e-8)


# The curves


def test_curves_are_the_recorded_signals_with_their_units() -> None:
    shown = film(SMALL, made_up(), made_up(end=50))
    title, curves = outputs(shown)
    assert title == "rotor angle θ [rad]  (dashed: yᵣ)"
    # The ghost of the run that goes on, after both runs.
    assert [len(time) for time, *_ in curves] == [1001, 501, 1001]
    np.testing.assert_array_equal(curves[0][1], shown.takes[0].run.state[:, 0])
    np.testing.assert_array_equal(curves[2][1], 1.5)
    title, curves = surfaces(shown)
    assert title == "sliding variable s [A s]"
    assert [len(values) for _, values, _ in curves] == [1000, 500]
    np.testing.assert_array_equal(curves[0][1], shown.takes[0].run.sliding)
    title, curves = inputs(shown)
    assert title == "current i [A]"
    np.testing.assert_array_equal(curves[1][1], shown.takes[1].run.input)
    beside, curves = surfaces(replace(shown, beside=1))
    assert beside == f"{SERVO.states[1].name} {SERVO.states[1].symbol} [rad/s]"
    np.testing.assert_array_equal(curves[0][1], shown.takes[0].run.state[:, 1])


LENGTHS = (0.5, 0.4, 0.3)


@cache
def robot_film(last: str) -> Film:
    """Three links in the plane, each with a motor; the last joint may be a slide."""
    kinds = ("hinge", "hinge", last)
    links = "".join(
        f'<body pos="{before} 0 0"><joint name="j{i}" axis="0 1 0" armature="0.5" type="{kind}"/>'
        f'<geom type="capsule" fromto="0 0 0 {length} 0 0" size="0.02" mass="1"/>'
        for i, (before, length, kind) in enumerate(zip((0, *LENGTHS), LENGTHS, kinds, strict=False))
    )
    motors = "".join(f'<motor name="m{i}" joint="j{i}"/>' for i in range(3))
    robot = Robot.from_mjcf(
        f'<mujoco model="chain"><option timestep="0.001"/><worldbody>{links}{"</body>" * 3}'
        f"</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    sine = 0.2 * np.ones((3, 1))
    series = FourierSeries(2.0, np.array([-0.6, 0.5, 0.4]), np.zeros((3, 1)), sine)
    Q = np.kron(np.eye(3), np.diag([100.0, 0.0]))
    task = robot.task(fourier_series(3, 1), series, Q, np.eye(3))
    case = Case("chain", "sines", "sines", "this test", (-0.5, 0.4, 0.5, 0.0, 0.0, 0.0), 0.3)
    laws = (linearized_lqr(task, "lqr"), tracking_grosmc(task, 5.0, 2.0))
    python = Settings(engine="python")
    return film_of([run_on(case, "physics", law, robot.plant, python) for law in laws], SMALL)


def test_of_many_joints_one_curve_shows_the_size_of_those_with_one_unit() -> None:
    for last, count, words in (("hinge", 3, ""), ("slide", 2, " of 2 joints")):
        robot = robot_film(last)
        titles = [panel(robot)[0] for panel in (outputs, inputs)]
        assert titles == [f"distance |q − yᵣ|{words} [rad]", f"size of the input |u|{words} [N m]"]
        for take, (_, values, _) in zip(robot.takes, outputs(robot)[1], strict=True):
            assert take.ghost is not None
            off = (take.run.state[:, :3] - take.ghost)[:, :count]
            np.testing.assert_allclose(values, np.sqrt((off**2).sum(axis=1)), rtol=1e-14)
        title, (nothing, curve) = surfaces(robot)
        assert title.startswith("size of the sliding variable |s| [")
        assert len(nothing[1]) == 0
        s = np.asarray(robot.takes[1].run.sliding)
        np.testing.assert_allclose(curve[1], np.sqrt((s**2).sum(axis=1)), rtol=1e-14)
        for take, (_, values, _) in zip(robot.takes, inputs(robot)[1], strict=True):
            size = np.sqrt((take.run.input[:, :count] ** 2).sum(axis=1))
            np.testing.assert_allclose(values, size, rtol=1e-14)


# The still parts


@pytest.mark.parametrize("size", [(320, 240), (1280, 720), (320, 2160)])
@pytest.mark.parametrize("count", [1, 2])
def test_curves_change_nothing_outside_the_axes_and_nothing_overlaps(
    size: tuple[int, int], count: int
) -> None:
    runs = [made_up(), made_up(end=50)][:count]
    chart = draw_chart(film(Format(*size, start=0.2), *runs))
    assert chart.empty.shape == (size[1], size[0], 3)
    assert len({chart.empty[box].shape for box in chart.pictures}) == 1
    taken = np.zeros(size[::-1], int)
    for box in (*chart.areas, *chart.pictures):
        taken[box] += 1
        assert np.all(chart.empty[box].shape)
    assert taken.max() == 1
    # Pictures hide nothing, and nothing is cut off at the edges.
    for box in chart.pictures:
        assert chart.empty[box].min() == 255
    for edge in (chart.empty[0], chart.empty[-1], chart.empty[:, 0], chart.empty[:, -1]):
        assert edge.min() == 255
    changed = np.any(chart.empty != chart.drawn, axis=2)
    for area in chart.areas:
        assert changed[area].any()
        changed[area] = False
    assert not changed.any()


# The frames


class Blank:
    """A renderer of pictures that are one grey, which keeps the scenes that it was given."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self.model, self.shape = model, (height, width, 3)
        self.angles, self.pushed = list[float](), list[float]()

    def update_scene(self, data: mujoco.MjData, camera: int) -> None:
        """As mujoco.Renderer does, without OpenGL."""
        self.scene = updated_scene(self.model, data, camera)
        self.angles.append(float(data.qpos[0]))
        self.pushed.append(float(np.abs(data.xfrc_applied).max()))

    def render(self) -> np.ndarray:
        """A grey picture."""
        return np.full(self.shape, 77, np.uint8)


def drawn(board: Storyboard, index: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Array, Blank]:
    monkeypatch.setattr(frames.mujoco, "Renderer", Blank)
    maker = frames.FrameMaker(board)
    return maker.frame(index), maker._renderer


def test_a_frame_has_the_curves_up_to_its_instant_and_the_pictures_in_their_places(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    board = storyboard(film(SMALL, made_up(), made_up(speed=0.5)))
    board = replace(board, placement=np.array([0.3, 0.4, 1.2]))
    for index in (0, 5, 9):
        frame, renderer = drawn(board, index, monkeypatch)
        t = index / 10
        # Each scene is updated twice.
        assert renderer.angles == pytest.approx([t, t, t / 2, t / 2])
        assert (max(renderer.pushed) > 0) == (0.4 <= t < 0.6)
        moved = renderer.scene.camera[0].pos - board.model.cam_pos[board.camera]
        assert np.linalg.norm(moved) == pytest.approx(1.3, abs=SINGLE)
        changed = np.any(frame != board.chart.empty, axis=2)
        for box in board.chart.pictures:
            assert np.all(frame[box] == 77)
            changed[box] = False
        for rows, columns in board.chart.areas:
            (cursor,) = np.flatnonzero(np.all(frame[rows, columns] == 120, axis=(0, 2)))
            width = columns.stop - columns.start
            assert cursor == pytest.approx(t * (width - 1), abs=0.5)
            before = rows, slice(columns.start, columns.start + cursor)
            after = rows, slice(columns.start + cursor + 1, columns.stop)
            np.testing.assert_array_equal(frame[before], board.chart.drawn[before])
            np.testing.assert_array_equal(frame[after], board.chart.empty[after])
            changed[rows, columns] = False
        # Nothing else changes but the clock, right of the title.
        clock = np.flatnonzero(changed.any(axis=0))
        assert clock.min() > board.chart.empty.shape[1] - 13.5 * board.chart.font
        changed[: board.chart.pictures[0][0].start, clock.min() :] = False
        assert not changed.any()


# Names and colours
