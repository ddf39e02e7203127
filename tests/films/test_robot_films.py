"""Films of robots: one curve for many joints, the tip's path, and a camera where there is none."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from shipped import find_case, run_case, run_on

from grosmc_mj.arrays import Array
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.films import film_digest, film_of
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films.camera import FREE_CAMERA, camera_names, place
from grosmc_mj.films.chart import draw_chart
from grosmc_mj.films.film import Film, Format
from grosmc_mj.films.layout import Layout
from grosmc_mj.films.marks import Trace, add_trace, trace_site
from grosmc_mj.films.plots import inputs, outputs
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.machine import Transmission
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.palette import red_green_blue
from grosmc_mj.robots.robot import Robot

pytestmark = pytest.mark.slow

LENGTHS = (0.5, 0.4, 0.3)
N = len(LENGTHS)
SMALL = Format(width=480, height=320, fps=10)
# Nothing to compile, which would take ten times as long as these short runs.
PYTHON = Settings(engine="python")


def chain(limit: str = "", camera: str = "", last: str = "hinge") -> str:
    """Three links in the plane, each with a motor; the last joint may be a slide."""
    links = "".join(
        f'<body pos="{before} 0 0"><joint name="j{i}" axis="0 1 0" armature="0.5" '
        f'type="{last if i == N else "hinge"}"/>'
        f'<geom type="capsule" fromto="0 0 0 {length} 0 0" size="0.02" mass="1"/>'
        for i, (before, length) in enumerate(zip((0, *LENGTHS), LENGTHS, strict=False), start=1)
    )
    motors = "".join(f'<motor name="m{i}" joint="j{i}" {limit}/>' for i in range(1, N + 1))
    tip = f'<site name="gripper/tip" pos="{LENGTHS[-1]} 0 0"/>{camera}'
    return (
        f'<mujoco model="chain"><option timestep="0.001"/><worldbody>{links}{tip}'
        f"{'</body>' * N}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


LIMITED = 'ctrllimited="true" ctrlrange="-20 40"'


@cache
def results(mjcf: str) -> tuple[RunResult, ...]:
    robot = Robot.from_mjcf(mjcf)
    sine = 0.2 * np.ones((N, 1))
    series = FourierSeries(2.0, np.array([-0.6, 0.5, 0.4]), np.zeros((N, 1)), sine)
    Q = np.kron(np.eye(N), np.diag([100.0, 0.0]))
    task = robot.task(fourier_series(N, 1), series, Q, np.eye(N))
    case = Case("chain", "sines", "sines", "this test", (-0.5, 0.4, 0.5, 0.0, 0.0, 0.0), 0.5)
    laws = (linearized_lqr(task, "lqr"), tracking_grosmc(task, 5.0, 2.0))
    return tuple(run_on(case, "physics", law, robot.plant, PYTHON) for law in laws)


def film(mjcf: str = chain(LIMITED)) -> Film:
    return film_of(results(mjcf), SMALL)


def planar_tip(q: Array) -> Array:
    """Forward kinematics by hand: positive angles about y turn x downwards."""
    angles = np.cumsum(q, axis=1)
    across, up = (
        (np.array(LENGTHS) * part(angles)).sum(axis=1) for part in (np.cos, lambda a: -np.sin(a))
    )
    return np.stack([across, np.zeros(len(q)), up], axis=1)


# --- one curve for many signals ---


def test_the_distance_of_all_joints_is_the_norm_of_the_tracking_error() -> None:
    size = outputs(film())
    assert size.title == "distance of all joints |q − yᵣ| [rad]"
    for curve, result in zip(size.curves, results(chain(LIMITED)), strict=True):
        # The same numbers, subtracted in another place.
        np.testing.assert_allclose(curve.values, result.comparison.error, rtol=0, atol=1e-12)


def test_joints_of_another_unit_are_not_added_to_angles() -> None:
    mixed = film(chain(last="slide"))
    size, load = outputs(mixed), inputs(mixed)
    assert size.title == "distance of 2 joints |q − yᵣ| [rad]"
    assert load.title == "largest input of 2 joints |τ| [N m]"
    for take, distance, torque in zip(mixed.takes, size.curves, load.curves, strict=True):
        assert take.ghost is not None
        off = take.run.state[:, :2] - take.ghosts[:, :2]
        np.testing.assert_array_equal(distance.values, np.sqrt((off**2).sum(axis=1)))
        np.testing.assert_array_equal(torque.values, np.abs(take.run.input[:, :2]).max(axis=1))


def test_torques_are_shares_of_their_limits_where_all_have_one() -> None:
    size = inputs(film())
    assert size.title == "largest input, of its limit [%]"
    for take, curve in zip(film().takes, size.curves, strict=True):
        tau = take.run.input
        wanted = np.where(tau > 0, tau / 40, -tau / 20).max(axis=1) * 100
        np.testing.assert_allclose(curve.values, wanted, rtol=1e-14)


def test_two_joints_keep_their_own_curves() -> None:
    case = replace(find_case("two_link_arm", "nominal"), duration=0.1)
    two = film_of([run_case(case, "physics", "grosmc", Settings())], SMALL)
    assert outputs(two).title.startswith("q₁ dark, q₂ pale [rad]")
    assert inputs(two).title == "τ₁ dark, τ₂ pale [N m]"
    assert two.trace == -1


def test_all_that_is_written_fits_beside_its_neighbours() -> None:
    """Curves change nothing outside the axes, where titles and numbers are."""
    looped = film(chain(LIMITED))
    runs = [replace(take.run, seen=take.run.state[:-1]) for take in looped.takes]
    takes = [replace(take, run=run) for take, run in zip(looped.takes, runs, strict=True)]
    looped = replace(looped, takes=tuple(takes))
    for shown in (film(chain(LIMITED)), film(chain(last="slide")), looped):
        chart = draw_chart(shown, Layout(480, 320, 2))
        changed = np.any(chart.empty != chart.drawn, axis=2)
        assert changed.any()
        for area in chart.areas:
            changed[area.top : area.bottom, area.left : area.right] = False
        assert not changed.any()


# --- the tip ---


def test_the_trace_is_where_the_recorded_states_put_the_tip() -> None:
    board = storyboard(film())
    for scene, take in zip(board.scenes, film().takes, strict=True):
        assert scene.trace is not None
        assert scene.trace.reference is not None
        rows = film().rows(take)
        been, wanted = planar_tip(take.run.state[rows, :N]), planar_tip(take.ghosts[rows])
        # Metres, from some sums of products of double precision.
        np.testing.assert_allclose(scene.trace.actual, been, rtol=0, atol=1e-14)
        np.testing.assert_allclose(scene.trace.reference, wanted, rtol=0, atol=1e-14)
        assert scene.trace.colour == red_green_blue(take.colour)


def test_the_trace_of_a_robot_with_gears_that_give_way_is_its_links() -> None:
    gears = tuple(Transmission(f"j{i}", 0.05, stiffness=2e3) for i in range(1, N + 1))
    first = results(chain(LIMITED))[1]
    assert isinstance(first.true, MujocoPlant)
    plant = first.true.edited(*gears)
    shown = film_of([run_on(first.case, "physics", first.controller, plant, PYTHON)], SMALL)
    (scene,), (take,) = storyboard(shown).scenes, shown.takes
    assert plant.model.nq == 2 * N
    assert scene.trace is not None
    assert scene.trace.reference is not None
    rows = shown.rows(take)
    been, wanted = planar_tip(take.run.state[rows, :N]), planar_tip(take.ghosts[rows])
    np.testing.assert_allclose(scene.trace.actual, been, rtol=0, atol=1e-14)
    np.testing.assert_allclose(scene.trace.reference, wanted, rtol=0, atol=1e-14)


def drawn(trace: Trace, frame: int) -> list[tuple[int, Array]]:
    """Kind and place of what a trace adds to a scene."""
    model = mujoco.MjModel.from_xml_string(chain())
    scene, data = mujoco.MjvScene(model, 1000), mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    eye = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, eye)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, every, scene)
    before = scene.ngeom
    add_trace(scene, trace, frame)
    return [(geom.type, geom.pos.copy()) for geom in scene.geoms[before : scene.ngeom]]


def test_dots_lie_on_the_wanted_path_and_a_second_round_adds_none() -> None:
    angle = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    circle = np.stack([0.3 * np.cos(angle), np.zeros(300), 0.3 * np.sin(angle)], axis=1)
    once = drawn(Trace(circle, circle, (0.1, 0.2, 0.3)), 0)
    twice = drawn(Trace(circle, np.tile(circle, (2, 1)), (0.1, 0.2, 0.3)), 0)
    assert all(kind == mujoco.mjtGeom.mjGEOM_SPHERE for kind, _ in once)
    places = np.array([place for _, place in once])
    # Scenes are in single precision.
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), 0.3, rtol=1e-6)
    # Half as many looks at each round leave the dots a little further apart.
    assert 0.8 * len(once) <= len(twice) <= len(once)
    assert len(once) > 20


def test_the_line_ends_where_the_tip_is() -> None:
    path = np.linspace([0, 0, 0], [0.9, 0, 0.3], 10)
    for frame in (0, 4, 9):
        segments = drawn(Trace(path, None, (0.1, 0.2, 0.3)), frame)
        middles = (path[1 : frame + 1] + path[:frame]) / 2
        assert len(segments) == frame
        for (kind, centre), middle in zip(segments, middles, strict=True):
            assert kind == mujoco.mjtGeom.mjGEOM_CAPSULE
            np.testing.assert_allclose(centre, middle, atol=1e-6)


def test_a_site_is_found_by_the_last_part_of_its_name() -> None:
    model = mujoco.MjModel.from_xml_string(chain())
    assert model.site(trace_site(model)).name == "gripper/tip"
    bare = mujoco.MjModel.from_xml_string(chain().replace("gripper/tip", "gripper"))
    assert trace_site(bare) == -1


def test_a_film_with_a_trace_is_another_film() -> None:
    assert film_digest(storyboard(film())) != film_digest(storyboard(replace(film(), trace=-1)))


# --- the camera ---


def test_a_model_without_cameras_is_seen_whole_and_no_smaller_than_it_must_be() -> None:
    bare = film()
    assert (bare.camera, bare.camera_name) == (FREE_CAMERA, "free")
    model, data = bare.model, mujoco.MjData(bare.model)
    data.qpos[:] = bare.takes[0].run.state[0, :N]
    mujoco.mj_forward(model, data)
    move = place(model, FREE_CAMERA, [data], 1.5)
    scene, eye = mujoco.MjvScene(model, 100), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, eye)
    every = mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, every, scene)
    move.apply(scene)
    view = scene.camera[0]
    forward, up = np.array(view.forward, float), np.array(view.up, float)
    right = np.cross(forward, up)
    offset = planar_tip(data.qpos[None])[0] - np.array(view.pos, float)
    joints = [data.xpos[i] - np.array(view.pos, float) for i in range(1, model.nbody)]
    slope = float((view.frustum_top - view.frustum_bottom) / 2 / view.frustum_near)
    filled = [
        (
            abs(each @ right) / (1.5 * slope * (each @ forward)),
            abs(each @ up) / (each @ forward * slope),
        )
        for each in (offset, *joints)
    ]
    assert np.max(filled) <= 0.92
    # The links' boxes, 2 cm around them, are what fills the picture.
    assert np.max(filled) > 0.8


@pytest.mark.parametrize("chosen", ["free", "hall"])
def test_a_camera_on_the_hand_is_not_what_a_film_looks_through(chosen: str) -> None:
    mjcf = chain(LIMITED, '<camera name="hand"/>')
    if chosen == "hall":
        mjcf = mjcf.replace("</worldbody>", '<camera name="hall" pos="0 -3 0"/></worldbody>')
    shown = film(mjcf)
    assert "hand" in camera_names(shown.model)
    assert shown.camera_name == chosen
    assert film_of(results(mjcf), replace(SMALL, camera="hand")).camera_name == "hand"
