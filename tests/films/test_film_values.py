"""What a film will show, before anything is rendered: times, places, curves, marks and ghosts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from hand_written import tip
from mjcf import TREE
from shipped import TWO_LINK_CIRCLE, TWO_LINK_TIP, find_case, run_case

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films import frames
from grosmc_mj.films.film import Film, Format, Take
from grosmc_mj.films.scene import FREE_CAMERA, add_ghost, add_wrenches, default_camera, place
from grosmc_mj.films.storyboard import film_model, inputs, outputs, storyboard, surfaces
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO, SYSTEMS
from grosmc_mj.plants.system import System
from grosmc_mj.results import palette
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

pytestmark = pytest.mark.slow

SMALL = Format(480, 320, fps=10)
# The part of a picture that moving bodies may fill, its width over its height, a field of view.
FILLED, ASPECT, FOV = 0.92, 1.5, 40.0
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
    """A run of a second whose first coordinate moves, pushed from 0.4 s to 0.6 s."""
    n, m = model.nq, len(system.inputs)
    cut, rows = slice(10 * end), slice(10 * end + 1)
    time, wrench = np.arange(1001) / 1000, np.zeros((1000, 6 * len(system.bodies)))
    wrench[400:600, -2] = 3.0
    physics = np.zeros((1001, mujoco.mj_stateSize(model, FULL)))
    physics[:, 0], physics[:, 1] = time, speed * time
    signals = np.linspace(-3, 2, 1000)[:, None] * np.arange(1, m + 1)
    u, s = (signals[cut, 0], 0.2 * signals[cut, 0]) if m == 1 else (signals[cut], 2 * signals[cut])
    return Trajectory(
        system=system, time=time[rows], state=physics[rows, 1 : 1 + 2 * n], command=u, input=u,
        sliding=s, weighed=u, memory=np.zeros(10 * end, [("v", np.float64)]), wrench=wrench[cut],
        physics=physics[rows], status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(end / 100),
    )  # fmt: skip


def servo(speed: float = 1.0, end: int = 100) -> Trajectory:
    return invented(plant("servo").model, SERVO, speed, end)


def film(form: Format = SMALL, *runs: Trajectory) -> Film:
    """A film of runs of a servo, each with a ghost at 1.5 rad."""
    takes = [
        Take(label, colour, run, np.full((len(run.time), 1), 1.5), sliding_unit="A s")
        for label, colour, run in zip("AB", ("#D55E00", "#0072B2"), runs or [servo()], strict=False)
    ]
    return Film("A film", plant("servo").model, tuple(takes), form)


@cache
def result(system: str, case: str, controller: str = "lqr") -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


@cache
def case_film(system: str, case: str, form: Format = SMALL) -> Film:
    return film_of([result(system, case, name) for name in ("lqr", "grosmc")], form)


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
        (lambda: Take("A", "#D55E00", recorded(plant("servo").analytic())),
         "A: a film needs one recorded run in MuJoCo"),
        (lambda: film(SMALL, recorded(plant("servo"), record=False)), "was not recorded"),
        (lambda: Take("A", "#D55E00", servo(), np.zeros((1000, 1))), r"must be \(1001, 1\)"),
        (lambda: film_of([result("servo", "nominal"), result("servo", "case2")]),
         "runs of one case on physics"),
    ],
)  # fmt: skip
def test_a_film_that_cannot_be_made_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        make()


def test_a_frame_shows_the_recorded_instant_nearest_to_its_own() -> None:
    cuts = ((1, 0.0, None, 24), (0.3, 0.123, 0.3, 14), (2, 0.5, 0.5001, 1))
    for speed, start, stop, count in cuts:
        shown = film(Format(fps=24, speed=speed, start=start, stop=stop))
        np.testing.assert_allclose(
            shown.times, start + np.arange(count) * speed / 24, rtol=0, atol=1e-12
        )
        off = shown.takes[0].run.time[shown.rows(shown.takes[0])] - shown.times
        assert np.abs(off).max() <= 0.5e-3 + 1e-12


def test_a_scene_has_the_rows_of_its_instants() -> None:
    shown = case_film("cart_pendulum", "case2", replace(SMALL, start=8.0, stop=12.0))
    board, torques = storyboard(shown), [0.0]
    bodies = [shown.model.body(name).id for name in shown.takes[0].run.system.bodies]
    for take, (physics, ghost, wrench) in zip(shown.takes, board.scenes, strict=True):
        rows, run = shown.rows(take), take.run
        np.testing.assert_array_equal(physics, np.asarray(run.physics)[rows])
        # Cart and pole, of which the law controls the pole.
        expected = np.column_stack([physics[:, 1], np.asarray(take.ghost)[rows]])
        np.testing.assert_array_equal(ghost, expected)
        own = np.asarray(wrench)[:, bodies].reshape(len(rows), -1)
        np.testing.assert_array_equal(own, np.asarray(run.wrench)[rows])
        torques.append(float(np.abs(np.asarray(wrench)[..., 3:]).max()))
    assert board.largest.tolist() == [0.0, max(torques)]
    assert max(torques) > 0
    # One that ended at 0.5 s in the middle of its push stays there, and is pushed no more.
    shown = film(SMALL, servo(), servo(end=50))
    rows = [list(shown.rows(take)) for take in shown.takes]
    assert rows == [list(range(0, 1000, 100)), [0, 100, 200, 300, 400, *[500] * 5]]
    pushed = [np.flatnonzero(np.any(scene.wrench, axis=(1, 2))).tolist()
              for scene in storyboard(shown).scenes if scene.wrench is not None]  # fmt: skip
    assert pushed == [[4, 5], [4]]


def state_of(model: mujoco.MjModel, *qpos: float) -> Array:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos or data.qpos
    state = np.zeros(mujoco.mj_stateSize(model, FULL))
    mujoco.mj_getState(model, data, state, FULL)
    return state


def boxes(*centres: Any, camera: str = "") -> mujoco.MjModel:
    """Moving cubes of 0.2 m, before a camera that looks along y from 4 m away."""
    body = "<body pos='{} {} {}'><joint/><geom type='box' size='.1 .1 .1'/>{}</body>"
    bodies = "".join(body.format(*centre, camera) for centre in centres)
    own = f"<camera name='hall' pos='0 -4 0' xyaxes='1 0 0 0 0 1' fovy='{FOV}'/>"
    xml = f"<mujoco><worldbody>{bodies}{'' if camera else own}</worldbody></mujoco>"
    return mujoco.MjModel.from_xml_string(xml)


def test_the_camera_centres_moving_bodies_and_moves_no_more_than_it_must() -> None:
    # Two cubes of which the nearer sides span 6.2 m by 0.4 m, 3.9 m away.
    model, half = boxes((-1.0, 0.0, 0.2), (5.0, 0.0, 0.0)), math.tan(math.radians(FOV) / 2)
    back = 3.1 / (ASPECT * FILLED * half) - 3.9
    moved = place(model, 0, state_of(model)[None], ASPECT)
    assert moved == pytest.approx([2.0, 0.1, back], abs=SINGLE)
    # Beside the picture: sideways only. Within it, or MuJoCo's own camera: not at all.
    model = boxes((4.0, 0.0, -2.5))
    assert place(model, 0, state_of(model)[None], ASPECT) == pytest.approx([4.0, -2.5, 0.0])
    assert not place(model, FREE_CAMERA, state_of(model)[None], ASPECT).any()
    edge = FILLED * half * 3.9
    for further, still in ((-0.01, True), (0.01, False)):
        model = boxes((-ASPECT * edge + 0.1 - further, 0.0, edge - 0.1 + further))
        assert place(model, 0, state_of(model)[None], ASPECT).any() != still
    # All poses count together: a cart that ends 6 m to the right of where it starts.
    model = plant("cart_pendulum").model
    ends = np.array([state_of(model, x, 0.0) for x in (0.0, 6.0)])
    assert place(model, model.camera("fixed").id, ends, ASPECT)[0] == pytest.approx(3.0, abs=1e-3)


def test_the_default_camera_moves_along_where_something_travels() -> None:
    for system in SYSTEMS:
        model = plant(system).model
        camera = "follow" if system == "cart_pendulum" else "fixed"
        assert model.camera(default_camera(model)).name == camera
        # The pictures of the nominal start are those of the model's author.
        x0 = find_case(system, "nominal").x0[: model.nq]
        assert not place(model, default_camera(model), state_of(model, *x0)[None], ASPECT).any()
    # A camera on a hand would not show the hand.
    assert default_camera(boxes((0.0, 0.0, 0.0), camera="<camera name='hand'/>")) == FREE_CAMERA
    assert default_camera(boxes((0.0, 0.0, 0.0))) == 0
    shown = case_film("cart_pendulum", "nominal")
    fixed = replace(shown, format=replace(SMALL, camera="fixed"))
    assert (shown.camera_name, fixed.camera_name) == ("follow", "fixed")


def updated_scene(
    model: mujoco.MjModel, data: mujoco.MjData, camera: int
) -> mujoco.MjvScene:  # as mujoco.Renderer does, without OpenGL
    scene, eye = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
    eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
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


def seen_at(point: Any) -> Array:
    """Where a point is seen from the camera's own place and axes: slopes to the right and up."""
    _, data, camera = posed()
    right, up, back = (point - data.cam_xpos[camera]) @ data.cam_xmat[camera].reshape(3, 3)
    return np.array([right, up]) / -back


def marks(wrench: Sequence[float], largest: Sequence[float]) -> list[Any]:
    """The geoms of a wrench on the pole."""
    model, data, camera = posed()
    data.body("pole").xfrc_applied[:] = wrench
    scene = updated_scene(model, data, camera)
    first = scene.ngeom
    add_wrenches(scene, model, data, np.array(largest))
    added = scene.geoms[first : scene.ngeom]
    assert all(np.allclose(geom.rgba, [*GREEN, 1.0]) for geom in added)
    return list(added)


def test_a_force_is_an_arrow_in_its_direction_as_long_as_it_is_large() -> None:
    force, lengths = np.array([3.0, 0.0, -4.0]), []
    for largest in ((5.0, 2.0), (0.0, 0.0)):
        assert marks([0.0] * 6, largest) == []
    for part in (0.25, 1.0):
        (arrow,) = marks([*part * force, 0, 0, 0], (5, 0))
        assert arrow.type == mujoco.mjtGeom.mjGEOM_ARROW
        # Along its own z.
        np.testing.assert_allclose(np.reshape(arrow.mat, (3, 3))[:, 2], force / 5, atol=SINGLE)
        body = posed()[1].body("pole").xipos
        np.testing.assert_allclose(seen_at(np.array(arrow.pos)), seen_at(body), atol=1e-4)
        lengths.append(arrow.size[2] / part)
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-5)


@pytest.mark.parametrize("axis", [(0, -1, 0), (0, 0, 1), (0.6, 0.8, 0)])
def test_a_torque_is_an_arc_about_its_axis_right_handed(axis: Any) -> None:
    turns = []
    for part in (1.0, 0.5):
        *capsules, arrow = marks([0, 0, 0, *2 * part * np.array(axis)], (0.0, 2.0))
        assert {piece.type for piece in capsules} == {mujoco.mjtGeom.mjGEOM_CAPSULE}
        assert arrow.type == mujoco.mjtGeom.mjGEOM_ARROW
        # The chords of a circle turn about its axis, all by the same angle.
        points = np.array([piece.pos for piece in (*capsules, arrow)], float)
        chords = np.diff(points[:-1], axis=0)
        np.testing.assert_allclose(chords @ axis, 0.0, rtol=0, atol=10 * SINGLE)
        chords /= np.linalg.norm(chords, axis=1)[:, None]
        sines = np.cross(chords[:-1], chords[1:]) @ axis
        np.testing.assert_allclose(sines, sines[0], rtol=0.02)
        assert sines[0] > 0
        assert np.reshape(arrow.mat, (3, 3))[:, 2] @ chords[-1] > 0.9
        turns.append(len(chords) * math.asin(sines[0]))
    assert turns[1] == pytest.approx(turns[0] / 2, rel=0.02)
    assert 4.5 < turns[0] < 2 * math.pi


def test_the_ghost_is_the_indicator_alone_translucent_at_its_own_pose() -> None:
    model, data, camera = posed()
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
        expected = seen_at(other.geom_xpos[geom.objid])
        np.testing.assert_allclose(seen_at(np.array(geom.pos)), expected, rtol=0, atol=1e-4)


def test_the_ghost_is_the_nominal_optimum_or_a_reference_that_moves() -> None:
    shown = case_film("servo", "nominal")
    assert (shown.ghost_label, shown.ghost_symbol) == ("nominal optimum", "x*")
    # The plant is linear and the law is the optimum's: it lags half a sample behind.
    ghost = np.asarray(shown.takes[0].ghost)[:, 0]
    np.testing.assert_allclose(ghost, shown.takes[0].run.state[:, 0], rtol=0, atol=2e-3)
    assert ghost[-1] == pytest.approx(1.0, abs=0.02)
    arm = film_of([result("arm", "case1")])
    assert (arm.ghost_label, arm.ghost_symbol) == ("reference", "yᵣ")
    expected = np.sin(math.pi * arm.takes[0].run.time)[:, None]
    np.testing.assert_allclose(np.asarray(arm.takes[0].ghost), expected, rtol=0, atol=1e-9)
    # Of two outputs the joints are those that put the tip on the circle, the elbow on its side.
    (take,) = film_of([result("two_link_arm", "nominal")]).takes
    ghost, p = np.asarray(take.ghost), plant("two_link_arm").parameters
    assert np.all(ghost[:, 1] < 0)
    for t, q in zip(take.run.time[::200], ghost[::200], strict=True):
        goal = TWO_LINK_TIP.reference(float(t), TWO_LINK_CIRCLE)
        np.testing.assert_allclose(tip(q, p), [goal[0], goal[3]], rtol=0, atol=1e-8)


def test_curves_are_the_recorded_signals_with_their_units() -> None:
    shown = film(SMALL, servo(), servo(end=50))
    whole, short = (take.run for take in shown.takes)
    for curves_of, title, columns in (
        # The ghost of the run that goes on, after both runs.
        (outputs, "rotor angle θ [rad]  (dashed: yᵣ)",
         [whole.state[:, 0], short.state[:, 0], np.full(1001, 1.5)]),
        (surfaces, "sliding variable s [A s]", [whole.sliding, short.sliding]),
        (inputs, "current i [A]", [whole.input, short.input]),
        (lambda film: surfaces(replace(film, beside=1)),
         f"{SERVO.states[1].name} {SERVO.states[1].symbol} [rad/s]",
         [whole.state[:, 1], short.state[:, 1]]),
    ):  # fmt: skip
        words, curves = curves_of(shown)
        assert words == title
        for (time, values, _), column in zip(curves, map(np.asarray, columns), strict=True):
            np.testing.assert_array_equal(values, column)
            np.testing.assert_array_equal(time, whole.time[: len(column)])


def test_of_many_joints_one_curve_shows_the_size_of_those_with_one_unit() -> None:
    """Two hinges and a slide, of which the hinges have a unit in common."""
    robot = Robot.from_mjcf(TREE).plant
    run, ghost = invented(robot.model, robot.system), np.full((1001, 3), [0.5, -0.2, 3.0])
    # The first law has no s.
    runs = {"A": replace(run, sliding=None), "B": run}
    takes = [Take(label, "#D55E00", one, ghost, "A s") for label, one in runs.items()]
    shown = Film("tree", robot.model, tuple(takes), SMALL)
    off, s = run.state[:, :2] - ghost[:, :2], np.asarray(run.sliding)
    for curves_of, title, values in (
        (outputs, "distance |q − yᵣ| of 2 joints [rad]", off),
        (inputs, "size of the input |u| of 2 joints [N m]", run.input[:, :2]),
        (surfaces, "size of the sliding variable |s| [A s]", s),
    ):
        title_shown, (first, second) = curves_of(shown)
        assert title_shown == title
        np.testing.assert_allclose(second[1], np.sqrt((values**2).sum(axis=1)), rtol=1e-14)
        assert len(first[1]) == (0 if curves_of is surfaces else len(values))


class Blank:
    """A renderer of pictures that are one grey, which keeps the scenes that it was given."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self.model, self.shape, self.angles, self.pushed = model, (height, width, 3), [], []

    def update_scene(self, data: mujoco.MjData, camera: int) -> None:
        self.scene = updated_scene(self.model, data, camera)
        self.angles.append(float(data.qpos[0]))
        self.pushed.append(float(np.abs(data.xfrc_applied).max()))

    def render(self) -> np.ndarray:
        return np.full(self.shape, 77, np.uint8)


def test_a_frame_has_the_curves_up_to_its_instant_and_the_pictures_in_their_places(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(frames.mujoco, "Renderer", Blank)
    board = storyboard(film(SMALL, servo(), servo(speed=0.5)))
    chart = board.chart
    taken, white = np.zeros(chart.empty.shape[:2], int), np.all(chart.empty == 255, axis=2)
    for box in (*chart.areas, *chart.pictures):
        taken[box] += 1
    # Nothing overlaps, pictures hide nothing, and nothing is cut off at the edges.
    assert taken.max() == 1
    edges = (white[0], white[-1], white[:, 0], white[:, -1])
    assert all(part.all() for part in (*edges, *(white[box] for box in chart.pictures)))
    board = replace(board, placement=np.array([0.3, 0.4, 1.2]))
    right, up = board.model.cam_mat0[board.camera].reshape(3, 3).T[:2]
    axes = np.array([right, up, np.cross(right, up)])
    expected = board.model.cam_pos[board.camera] + board.placement @ axes
    for index in (0, 5, 9):
        maker, t = frames.FrameMaker(board), index / 10
        frame, renderer = maker.frame(index), maker._renderer
        # Each scene is updated twice.
        assert renderer.angles == pytest.approx([t, t, t / 2, t / 2])
        assert (max(renderer.pushed) > 0) == (0.4 <= t < 0.6)
        for eye in renderer.scene.camera:
            np.testing.assert_allclose(eye.pos, expected, rtol=0, atol=SINGLE)
        changed = np.any(frame != chart.empty, axis=2)
        for box in chart.pictures:
            assert np.all(frame[box] == 77)
            changed[box] = False
        for rows, columns in chart.areas:
            (cursor,) = np.flatnonzero(np.all(frame[rows, columns] == 120, axis=(0, 2)))
            assert cursor == pytest.approx(t * (columns.stop - columns.start - 1), abs=0.5)
            at = columns.start + cursor
            for part, like in (
                (slice(columns.start, at), chart.drawn),
                (slice(at + 1, columns.stop), chart.empty),
            ):
                np.testing.assert_array_equal(frame[rows, part], like[rows, part])
            changed[rows, columns] = False
        # Nothing else changes but the clock, right of the title.
        clock = np.flatnonzero(changed.any(axis=0))
        assert clock.min() > chart.empty.shape[1] - 13.5 * chart.font
        assert not changed[chart.pictures[0][0].start :].any()
