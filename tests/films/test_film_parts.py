"""The parts of a film by their geometry, without a simulation and without a renderer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.films import film_digest
from grosmc_mj.films import chart, frames
from grosmc_mj.films.camera import FREE_CAMERA, Placement, place
from grosmc_mj.films.chart import draw_chart
from grosmc_mj.films.film import Film, Format, Take
from grosmc_mj.films.frames import OVERSAMPLING, Storyboard
from grosmc_mj.films.layout import Layout
from grosmc_mj.films.marks import Trace, add_trace
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO
from grosmc_mj.results.palette import DISTURBANCE, red_green_blue
from grosmc_mj.simulation.trajectory import Status, Trajectory

# The part of the picture that what moves may fill, and its width over its height.
FILLED, ASPECT = 0.92, 1.5
FOV = 40.0
# Positions in a scene are single precision.
SINGLE = 1e-5


# The camera


def boxes(*centres: tuple[float, float, float], fixed: bool = True) -> mujoco.MjModel:
    """Moving cubes of 0.2 m, before a camera that looks along y from 4 m away."""
    bodies = "".join(
        f"<body pos='{x} {y} {z}'><joint/><geom type='box' size='.1 .1 .1'/></body>"
        for x, y, z in centres
    )
    camera = f"<camera pos='0 -4 0' xyaxes='1 0 0 0 0 1' fovy='{FOV}'/>" if fixed else ""
    xml = f"<mujoco><worldbody>{camera}{bodies}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    # One eye, as in the model of a film.
    model.cam_ipd[:] = 0
    return model


def posed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def picture(centres: Sequence[tuple[float, float, float]], moved: Sequence[float]) -> Array:
    """Least and greatest column and row, 1 at the edges, of the cubes' corners, (2, 2)."""
    signs = np.reshape(np.meshgrid(*[[-0.1, 0.1]] * 3), (3, 8)).T
    x, y, z = np.concatenate([np.array(centre) + signs for centre in centres]).T
    right, up, back = moved
    high = math.tan(math.radians(FOV) / 2) * (y + 4 + back)
    seen = np.array([(x - right) / (ASPECT * high), (z - up) / high])
    return np.array([seen.min(axis=1), seen.max(axis=1)])


@pytest.mark.parametrize(
    "centres",
    [
        ((-1.0, 0.0, 0.2), (5.0, 2.0, 0.0)),
        ((0.5, -1.0, 3.0), (0.0, 0.5, -1.0)),
        ((2.0, 0.0, 2.0), (4.0, 0.0, 5.0)),
    ],
)
def test_the_camera_centres_what_moves_and_goes_back_no_further_than_it_must(
    centres: tuple[tuple[float, float, float], ...],
) -> None:
    """One side of the picture is filled from edge to edge, the other no more than that."""
    model = boxes(*centres)
    moved = place(model, 0, [posed(model)], ASPECT)
    least, most = picture(centres, moved)
    full = int(np.argmax(most - least))
    assert (least[full], most[full]) == pytest.approx((-FILLED, FILLED), abs=SINGLE)
    assert -FILLED <= least[1 - full] < most[1 - full] <= FILLED
    assert moved.back > 0


def test_what_is_beside_the_picture_moves_the_camera_sideways_only() -> None:
    model = boxes((4.0, 0.0, -2.5))
    moved = place(model, 0, [posed(model)], ASPECT)
    assert tuple(moved) == pytest.approx((4.0, -2.5, 0.0), abs=SINGLE)


def test_what_just_fits_leaves_the_author_s_picture() -> None:
    edge = FILLED * math.tan(math.radians(FOV) / 2) * 3.9
    for side, (x, z) in (("right", (ASPECT * edge, 0.0)), ("up", (0.0, edge))):
        for sign, further, still in ((1, -0.01, True), (-1, -0.01, True), (-1, 0.01, False)):
            centre = (sign * (x and x - 0.1 + further), 0.0, sign * (z and z - 0.1 + further))
            model = boxes(centre)
            moved = place(model, 0, [posed(model)], ASPECT)
            assert (tuple(moved) == (0.0, 0.0, 0.0)) == still, side


def test_the_poses_count_together() -> None:
    """A body that leaves to the left and to the right needs both ends in view."""
    model = boxes((0.0, 0.0, 0.0))
    poses = []
    for x in (-3.0, 5.0):
        model.body_pos[1, 0] = x
        poses.append(posed(model))
    moved = place(model, 0, poses, ASPECT)
    least, most = picture([(-3.0, 0.0, 0.0), (5.0, 0.0, 0.0)], moved)
    assert moved.right == pytest.approx(1.0, abs=SINGLE)
    assert (least[0], most[0]) == pytest.approx((-FILLED, FILLED), abs=SINGLE)


def test_the_free_camera_goes_nearer_too() -> None:
    model = boxes((0.0, 0.0, 0.0), fixed=False)
    model.stat.extent = 50.0
    assert place(model, FREE_CAMERA, [posed(model)], ASPECT).back < -10.0


# Where everything is in a frame


@pytest.mark.parametrize("pictures", [1, 2, 3, 4])
def test_pictures_and_plots_leave_nothing_of_the_frame_unused(pictures: int) -> None:
    layout = Layout(1280, 720, pictures)
    assert layout.picture(0).left == layout.plot(0).left == 0
    # Equal widths leave a rest of less than a pixel each.
    assert 0 <= 1280 - layout.picture(pictures - 1).right < pictures
    assert 0 <= 1280 - layout.plot(2).right < 3
    assert layout.plot(0).bottom == 720
    assert layout.plot(0).top == layout.picture(0).bottom
    assert layout.label(0).top == layout.title.bottom
    assert layout.clock.right == 1280


# The plots


@cache
def plant() -> MujocoPlant:
    return MujocoPlant.load("servo")


def made_up(sliding: Array | None = None, force: float = 1.0) -> Trajectory:
    """A servo that turns by 1 rad/s for a second, pushed from 0.4 s to 0.6 s."""
    time = np.arange(101) / 100
    wrench = np.zeros((100, 6))
    wrench[40:60, 4] = force
    size = mujoco.mj_stateSize(plant().model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    physics = np.zeros((101, size))
    physics[:, 0] = physics[:, 1] = time
    return Trajectory(
        system=SERVO, time=time, state=np.column_stack([time, np.ones(101)]),
        command=np.ones(100), input=np.linspace(-3, 2, 100), sliding=sliding,
        weighed=np.ones(100), memory=np.zeros(100, [("v", np.float64)]), wrench=wrench,
        physics=physics, status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(1.0),
    )  # fmt: skip


def film(form: Format, *runs: Trajectory, ended: str = "") -> Film:
    takes = [
        Take(name, colour, run, np.full(101, 1.5), "rad/s", ended)
        for name, colour, run in zip(("One", "Two"), ("#D55E00", "#0072B2"), runs, strict=False)
    ]
    return Film("A film", plant().model, tuple(takes), form)


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that charts are drawn on."""
    made: list[Figure] = []

    def figure(**options: Any) -> Figure:
        made.append(Figure(**options))
        return made[-1]

    monkeypatch.setattr(chart, "Figure", figure)
    return made


SMALL = Format(480, 320, fps=10, start=0.2, stop=0.5)


def test_curves_are_those_of_the_instants_that_the_film_shows(figures: list[Figure]) -> None:
    s = np.linspace(0.4, -0.6, 100)
    draw_chart(film(SMALL, made_up(s)), Layout(480, 320, 1))
    angle, sliding, applied = figures[0].axes
    shown = np.arange(20, 51) / 100
    for axes in figures[0].axes:
        assert axes.get_xlim() == (0.2, 0.5)
        for line in axes.lines:
            np.testing.assert_allclose(np.asarray(line.get_xdata(), float), shown, atol=1e-12)
            low, high = axes.get_ylim()
            y = np.asarray(line.get_ydata(), float)
            assert low < min(y.min(), 0.0)
            assert max(y.max(), 0.0) < high
    run, optimum = (np.ravel(line.get_ydata()) for line in angle.lines)
    np.testing.assert_allclose(run, shown, atol=1e-12)
    np.testing.assert_array_equal(optimum, 1.5)
    np.testing.assert_array_equal(np.ravel(sliding.lines[0].get_ydata()), s[20:51])
    np.testing.assert_array_equal(
        np.ravel(applied.lines[0].get_ydata()), np.linspace(-3, 2, 100)[20:51]
    )
    assert sliding.get_title(loc="left") == "sliding variable s [rad/s]"
    for axes in figures[0].axes:
        (shade,) = axes.patches
        extent = shade.get_path().get_extents(shade.get_patch_transform())
        # Pushed from 0.4 s to 0.6 s, of which the film shows less.
        assert (extent.x0, extent.x1) == pytest.approx((0.4, 0.5))
        assert shade.get_facecolor()[:3] == pytest.approx(red_green_blue(DISTURBANCE))


def test_a_small_sliding_variable_is_in_thousandths_of_its_unit(figures: list[Figure]) -> None:
    """The largest of all laws decides, whatever its sign."""
    small, large = np.full(100, 0.02), np.full(100, -0.3)
    for runs, factor, unit in (((small, 0 * small), 1e3, "mrad/s"), ((small, large), 1.0, "rad/s")):
        draw_chart(film(SMALL, *map(made_up, runs)), Layout(320, 240, 2))
        axes = figures[-1].axes[1]
        assert axes.get_title(loc="left") == f"sliding variable s [{unit}]"
        for line, s in zip(axes.lines, runs, strict=True):
            np.testing.assert_array_equal(np.ravel(line.get_ydata()), factor * s[20:51])


def test_all_that_a_picture_shows_makes_another_film() -> None:
    board = storyboard(film(SMALL, made_up()))
    (scene,) = board.scenes
    rows = np.ones((len(scene.physics), 3))
    changes = {"physics": scene.physics + 1, "ghost": None, "wrench": None, "over": 1,
               "ended": "diverged", "trace": Trace(rows, None, (0.8, 0.4, 0.0))}  # fmt: skip
    assert tuple(changes) == scene._fields
    others = [
        replace(board, scenes=(scene._replace(**{name: value}),)) for name, value in changes.items()
    ]
    assert len({film_digest(each) for each in (board, *others)}) == 1 + len(changes)


# The path of a tip


def test_a_long_trail_leaves_its_older_part_out() -> None:
    path = np.linspace([0, 0, 0], [1, 0, 0], 1001)
    model = boxes((0.0, 0.0, 0.0))
    for frame, first in ((1000, 601), (400, 1), (399, 0)):
        scene, eye = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
        eye.type, eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        none = mujoco.mjtCatBit.mjCAT_STATIC.value
        data = posed(model)
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, eye, none, scene)
        before = scene.ngeom
        add_trace(scene, Trace(path, None, (0.1, 0.2, 0.3)), frame)
        middles = np.array([geom.pos for geom in scene.geoms[before : scene.ngeom]])
        expected = (path[first + 1 : frame + 1] + path[first:frame]) / 2
        np.testing.assert_allclose(middles, expected, atol=SINGLE)


# The frames


class Blank:
    """A renderer of pictures that are one grey, which keeps the scenes that it was given."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self.model, self.shape = model, (height, width, 3)
        self.scene, self.eye = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
        self.angles: list[float] = []
        self.pushed: list[float] = []

    def update_scene(self, data: mujoco.MjData, camera: int) -> None:
        """As mujoco.Renderer does, without OpenGL."""
        self.eye.type, self.eye.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, camera
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(
            self.model, data, mujoco.MjvOption(), None, self.eye, every, self.scene
        )
        self.angles.append(float(data.qpos[0]))
        self.pushed.append(float(np.abs(data.xfrc_applied).max()))

    def render(self) -> np.ndarray:
        """A grey picture."""
        return np.full(self.shape, 77, np.uint8)


def drawn(board: Storyboard, index: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Array, Blank]:
    """A frame, and the renderer that it was drawn with."""
    monkeypatch.setattr(frames.mujoco, "Renderer", Blank)
    maker = frames.FrameMaker(board)
    return maker.frame(index), maker._renderer


def test_a_frame_has_the_curves_up_to_its_instant_and_the_pictures_in_their_places(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    slower = replace(made_up(), physics=0.5 * np.asarray(made_up().physics))
    board = storyboard(film(Format(480, 320, fps=10), made_up(), slower))
    board = replace(board, placement=Placement(0.3, 0.4, 1.2))
    for index in (0, 5, 9):
        frame, renderer = drawn(board, index, monkeypatch)
        t = index / 10
        # Each scene is updated twice.
        assert renderer.angles == pytest.approx([t, t, t / 2, t / 2])
        assert (max(renderer.pushed) > 0) == (0.4 <= t < 0.6)
        box = board.layout.picture(0)
        assert renderer.shape == (OVERSAMPLING * box.height, OVERSAMPLING * box.width, 3)
        moved = renderer.scene.camera[0].pos - board.model.cam_pos[board.camera]
        assert np.linalg.norm(moved) == pytest.approx(1.3, abs=SINGLE)
        for number in range(2):
            box = board.layout.picture(number)
            assert np.all(frame[box.top : box.bottom, box.left : box.right] == 77)
        for area in board.chart.areas:
            cursor = board.chart.column(area, t)
            rows = slice(area.top, area.bottom)
            before, after = slice(area.left, cursor), slice(cursor + 1, area.right)
            assert np.all(frame[rows, cursor] == 120)
            np.testing.assert_array_equal(frame[rows, before], board.chart.drawn[rows, before])
            np.testing.assert_array_equal(frame[rows, after], board.chart.empty[rows, after])
        # Nothing else changes but the clock.
        changed = np.any(frame != board.chart.empty, axis=2)
        pictures = [board.layout.picture(number) for number in range(2)]
        for box in (*pictures, *board.chart.areas, board.layout.clock):
            changed[box.top : box.bottom, box.left : box.right] = False
        assert not changed.any()


def test_a_run_that_is_over_says_so_and_is_pushed_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ended at 0.5 s in the middle of its push, beside one that goes on."""
    whole = made_up()
    cut = {name: getattr(whole, name)[:50] for name in ("command", "input", "weighed", "wrench")}
    cut |= {name: getattr(whole, name)[:51] for name in ("time", "state", "physics")}
    short = replace(whole, **cut)
    takes = (Take("One", "#D55E00", whole), Take("Two", "#0072B2", short, ended="over"))
    board = storyboard(replace(film(Format(480, 320, fps=10), whole), takes=takes))
    assert [scene.over for scene in board.scenes] == [10, 5]
    for index, pushed in ((4, [True, True]), (5, [True, False])):
        frame, renderer = drawn(board, index, monkeypatch)
        assert [size > 0 for size in renderer.pushed[::2]] == pushed
        written = [np.any(frame[board.layout.picture(i).pixels] != 77) for i in range(2)]
        assert written == [False, not all(pushed)]


def test_the_film_s_camera_is_placed_by_all_of_its_frames() -> None:
    """A cart that ends 6 m to the right of where it starts."""
    cart = MujocoPlant.load("cart_pendulum")
    size = mujoco.mj_stateSize(cart.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    physics = np.zeros((101, size))
    physics[:, 1] = 6 * np.arange(101) / 100
    run = replace(
        made_up(), system=cart.system, state=physics[:, 1:5], physics=physics, wrench=None
    )
    form = Format(480, 320, fps=50, camera="fixed")
    board = storyboard(Film("Away", cart.model, (Take("One", "#D55E00", run),), form))
    # The last of fifty frames is at 0.98 s.
    assert board.placement.right == pytest.approx(3 * 0.98, abs=1e-3)
    ends = []
    for row in (0, 98):
        ends.append(mujoco.MjData(board.model))
        ends[-1].qpos[:] = physics[row, 1:3]
        mujoco.mj_forward(board.model, ends[-1])
    box = board.layout.picture(0)
    wanted = place(board.model, board.camera, ends, box.width / box.height)
    assert tuple(board.placement) == pytest.approx(tuple(wanted), abs=SINGLE)
    assert wanted.back > 0
