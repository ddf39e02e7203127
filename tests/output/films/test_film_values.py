"""Films before they are rendered: their times, rows, curves, ghosts and frames."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import matplotlib as mpl
import mujoco
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text
from mjcf import TREE
from open_loop import held

from grosmc_mj.cli import films
from grosmc_mj.cli.program import parse
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.films import film_digest, film_of, is_current
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.output.films import frames
from grosmc_mj.output.films.film import Film, Format, Take
from grosmc_mj.output.films.storyboard import (
    Plot,
    PlotCurve,
    _draw,
    _stage,
    _style,
    inputs,
    outputs,
    storyboard,
    surfaces,
)
from grosmc_mj.output.palette import OPTIMUM
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

SMALL = Format(480, 320, fps=10)
RED, BLUE = "#D55E00", "#0072B2"
# Positions in a scene are single precision.
SINGLE = 1e-5


@cache
def plant(system: str) -> MujocoPlant:
    return MujocoPlant.load(system)


def invented(plant: MujocoPlant, speed: float = 1.0, end: int = 100) -> Trajectory:
    """A run of 1 s whose first coordinate moves; its last body is pushed from 0.4 s to 0.6 s.

    Args:
        plant: Plant in MuJoCo.
        speed: Speed of the first coordinate.
        end: End of the run [10 ms].
    """
    steps = 10 * end
    time = np.arange(steps + 1) / 1000
    full = mujoco.mj_stateSize(plant.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    physics = np.zeros((steps + 1, full))
    physics[:, 0] = time
    physics[:, 1] = speed * time

    wrench = np.zeros((1000, 6 * len(plant.system.bodies)))
    wrench[400:600, -2] = 3.0

    u = np.linspace(-3, 2, 1000)[:steps]
    m = len(plant.system.inputs)
    if m > 1:
        u = u[:, None] * np.arange(1, m + 1)
    return Trajectory(
        system=plant.system,
        time=time,
        state=physics[:, 1 : 1 + 2 * plant.model.nq],
        command=0.5 * u,
        input=u,
        sliding=0.2 * u,
        weighed=u,
        memory=np.zeros(steps, [("v", np.float64)]),
        wrench=wrench[:steps],
        physics=physics,
        status=np.array([Status.COMPLETED], object)[0],
        valid_until=np.array(end / 100),
    )


def servo(speed: float = 1.0, end: int = 100) -> Trajectory:
    return invented(plant("servo"), speed, end)


def film(*runs: Trajectory, system: str = "servo", form: Format = SMALL, **fields: Any) -> Film:
    """A film of runs of a servo, by default of one, with ghosts at 1.5 rad."""
    takes = []
    for run, label, colour in zip(runs or [servo()], "AB", (RED, BLUE), strict=False):
        ghost = np.full((len(run.time), len(run.system.controlled)), 1.5)
        takes.append(Take(label, colour, run, ghost, sliding_unit="A s"))
    return Film("A film", plant(system).model, tuple(takes), form, **fields)


def opened(run: Any, **options: Any) -> Film:
    """A film of a simulated run of 10 ms."""
    return film(simulate(run, held(0.1), [0.0, 0.0], duration=0.01, **options))


@cache
def result(
    system: str, case: str, law: str = "lqr", plant: str = "physics", duration: float = 0.02
) -> RunResult:
    return find_experiment(system, case).changed(duration=duration).run(cast(Any, plant), law)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Format(height=361), "1280 x 361 pixels: both must be even"),
        (lambda: film(form=Format(stop=1.1)), "to 1.1 s shows nothing: .* end at 1 s"),
        (lambda: film(form=Format(start=1.0)), "from 1 s to 1 s shows nothing"),
        (lambda: film(form=Format(camera="folow")), "camera 'folow': did you mean 'follow'"),
        (lambda: replace(film(), takes=()), "one to four runs, not 0"),
        (lambda: replace(film(), takes=film().takes * 5), "one to four runs, not 5"),
        (lambda: film(system="arm"), "a run of servo is not of this model"),
        (lambda: opened(plant("servo").analytic()), "A: a film needs one recorded run in MuJoCo"),
        (lambda: opened(plant("servo"), record=False), "was not recorded"),
        (lambda: Take("A", RED, servo(), np.zeros((1000, 1))), r"must be \(1001, 1\)"),
        (
            lambda: film_of([result("servo", "nominal"), result("servo", "case2")]),
            "runs of one case on one plant",
        ),
    ],
)
def test_a_film_that_cannot_be_made_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        make()


# Times and rows


def test_options_of_the_command_are_the_format_of_the_film() -> None:
    options = "--size 320x240 --fps 25 --speed 0.5 --camera fixed --from 1 --to 2"
    command: Any = parse(["film", "servo", *options.split()])
    assert command._format() == Format(320, 240, 25, 0.5, "fixed", 1.0, 2.0)


@pytest.mark.parametrize(
    ("speed", "start", "stop", "count"),
    [(1, 0.0, None, 24), (0.3, 0.123, 0.3, 14), (2, 0.5, 0.5001, 1)],
)
def test_a_frame_shows_the_recorded_instant_nearest_to_its_own(
    speed: float, start: float, stop: float | None, count: int
) -> None:
    shown = film(form=Format(fps=24, speed=speed, start=start, stop=stop))
    expected = start + np.arange(count) * speed / 24
    np.testing.assert_allclose(shown.times, expected, rtol=0, atol=1e-12)

    (take,) = shown.takes
    errors = take.run.time[shown.rows(take)] - shown.times
    assert np.abs(errors).max() <= 0.5e-3 + 1e-12


def stage_of(shown: Film) -> frames.Stage:
    """Return the stage of a film in MuJoCo; its chart takes longer to draw."""
    assert shown.model is not None
    return _stage(shown, shown.model, (slice(0, 160), slice(0, 240)))


def test_a_scene_has_states_and_pushes_of_its_instants() -> None:
    """Frames every 25 ms from 0.35 s on; of cart and pole the pole is pushed."""
    form = replace(SMALL, fps=20, speed=0.5, start=0.35, stop=0.65)
    run = invented(plant("cart_pendulum"), speed=0.5)
    stage = stage_of(film(run, system="cart_pendulum", form=form))
    (scene,) = stage.scenes
    rows = 350 + 25 * np.arange(12)
    np.testing.assert_array_equal(scene.physics, np.asarray(run.physics)[rows])

    expected = np.zeros((12, stage.model.nbody, 6))
    expected[2:10, stage.model.body("pole").id, 4] = 3.0
    np.testing.assert_array_equal(scene.wrench, expected)


def test_the_largest_force_and_torque_are_those_of_all_scenes() -> None:
    weak, strong = servo(), servo()
    wrench = np.zeros((1000, 6))
    wrench[450:550] = (0, 3, -4, 1, 0, 0)
    stage = stage_of(film(weak, replace(strong, wrench=wrench)))
    assert stage.largest == pytest.approx([5.0, 3.0])


def test_a_run_that_ended_early_stays_there_and_is_pushed_no_more() -> None:
    """It ends at 0.5 s in the middle of its push."""
    shown = film(servo(), servo(end=50))
    whole, short = shown.takes
    assert list(shown.rows(whole)) == list(range(0, 1000, 100))
    assert list(shown.rows(short)) == [0, 100, 200, 300, 400, 500, 500, 500, 500, 500]
    pushed = [np.flatnonzero(np.any(scene.wrench, axis=(1, 2))) for scene in stage_of(shown).scenes]
    assert [list(frames) for frames in pushed] == [[4, 5], [4]]


@pytest.mark.parametrize(
    ("speeds", "frame"),
    [([1.0, 0.5], 9), ([1.0], 0)],
    ids=["two runs part more and more", "one run comes nearer to its ghost"],
)
def test_the_poster_shows_the_moment_of_the_largest_difference(
    speeds: list[float], frame: int
) -> None:
    assert film(*map(servo, speeds)).poster_frame == frame


@pytest.mark.parametrize(("camera", "name"), [(None, "follow"), ("fixed", "fixed")])
def test_a_format_can_name_another_camera(camera: str | None, name: str) -> None:
    run = invented(plant("cart_pendulum"))
    shown = film(run, system="cart_pendulum", form=replace(SMALL, camera=camera))
    assert shown.camera_name == name


def test_of_five_laws_the_last_four_are_filmed_in_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """The runs of a comparison stand before the law of interest."""
    runs: list[Any] = [
        SimpleNamespace(plant=name, case="case", law=law)
        for law in "abcde"
        for name in ("physics", "corrected")
    ]
    filmed: list[str] = []
    monkeypatch.setattr(
        "grosmc_mj.experiments.films.film_of", lambda runs: [run.plant[0] + run.law for run in runs]
    )
    monkeypatch.setattr(
        films, "_write_missing", lambda _, made: filmed.extend(*(film for _, film in made.values()))
    )
    films.film_runs(cast(Any, None), runs, Path("film.mp4"))
    assert filmed == ["pb", "pc", "pd", "pe"]


TINY = Format(320, 240, fps=4)


@pytest.fixture(scope="module")
def digest() -> str:
    return film_digest(storyboard(film(form=TINY)))


@pytest.fixture
def stored(digest: str, tmp_path: Path) -> Path:
    """Files of a film as they lie after it was written, without its pictures."""
    path = tmp_path / "film.mp4"
    path.write_bytes(b"film")
    path.with_suffix(".png").touch()
    document = {"sha256": sha256(b"film").hexdigest(), "drawn_from": digest}
    path.with_suffix(".json").write_text(json.dumps(document))
    return path


def test_a_film_is_current_for_the_same_runs_in_the_same_format(stored: Path) -> None:
    assert is_current(film(form=TINY), stored)


@pytest.mark.parametrize(
    "other",
    [
        film(form=replace(TINY, speed=0.9)),
        film(servo(speed=1.001), form=TINY),
        replace(film(form=TINY), takes=(Take("A", RED, servo()),)),
    ],
    ids=["speed", "run", "no ghost"],
)
def test_a_film_is_not_current_for_another_one(other: Film, stored: Path) -> None:
    assert not is_current(other, stored)


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(b"less"),
        lambda path: path.with_suffix(".json").write_text("{"),
        lambda path: path.with_suffix(".json").unlink(),
        lambda path: path.with_suffix(".png").unlink(),
    ],
)
def test_a_film_with_a_damaged_file_is_not_current(
    damage: Callable[[Path], object], stored: Path
) -> None:
    damage(stored)
    assert not is_current(film(form=TINY), stored)


# Ghosts of runs of cases


def test_the_ghost_is_the_nominal_optimum() -> None:
    """The plant is linear and the law is the optimum's: it lags half a sample behind."""
    shown = film_of([result("servo", "nominal", duration=1.0)])
    assert (shown.ghost_label, shown.ghost_symbol, shown.one_ghost) == (
        "nominal optimum",
        "x*",
        False,
    )
    (take,) = shown.takes
    ghost = np.asarray(take.ghost)[:, 0]
    np.testing.assert_allclose(ghost, take.run.state[:, 0], rtol=0, atol=2e-3)
    assert ghost[-1] > 0.5


def test_the_ghost_is_a_reference_that_moves() -> None:
    shown = film_of([result("arm", "case1", duration=0.5)])
    assert (shown.ghost_label, shown.ghost_symbol, shown.one_ghost) == ("reference", "yᵣ", True)
    (take,) = shown.takes
    expected = np.sin(math.pi * take.run.time)[:, None]
    np.testing.assert_allclose(np.asarray(take.ghost), expected, rtol=0, atol=1e-9)


def tip_in_mujoco(film: Film, ghost: Array) -> Array:
    """Return the tip of the film's own model at joint angles, (x, z) from the shoulder."""
    assert film.model is not None
    data = mujoco.MjData(film.model)
    data.qpos[:] = ghost
    mujoco.mj_kinematics(film.model, data)
    from_shoulder = data.body("payload").xpos - data.body("upper").xpos
    return from_shoulder[[0, 2]]


def test_the_ghost_of_an_edited_plant_is_on_the_reference() -> None:
    """Links 5 % longer than the laws believe need other joint angles; the elbow stays low."""
    shown = film_of([result("two_link_arm", "case2")])
    (take,) = shown.takes
    ghosts = np.asarray(take.ghost)
    tips = [tip_in_mujoco(shown, ghost) for ghost in ghosts]
    angles = math.pi * take.run.time
    circle = np.column_stack([0.45 + 0.15 * np.cos(angles), 0.15 + 0.15 * np.sin(angles)])
    assert np.array(tips) == pytest.approx(circle, abs=1e-9)
    assert np.all(ghosts[:, 1] < 0)


def test_the_ghost_has_the_joints_that_nothing_controls_where_the_run_has_them() -> None:
    """The cart moves; the law controls the pole alone."""
    form = Format(320, 240, fps=125, speed=0.25, start=0.004, stop=0.016)
    shown = film_of([result("cart_pendulum", "nominal", "fl-lqr")], form)
    (take,) = shown.takes
    (scene,) = stage_of(shown).scenes
    rows = 4 + 2 * np.arange(6)
    expected = np.column_stack([take.run.state[rows, 0], np.asarray(take.ghost)[rows]])
    np.testing.assert_array_equal(scene.ghost, expected)


@pytest.mark.parametrize(
    ("system", "case", "law", "state"),
    [("cart_pendulum", "nominal", "lqr", 0), ("servo", "nominal", "lqr", 1)],
)
def test_without_a_law_with_a_surface_a_state_that_is_not_controlled_stands_in_its_place(
    system: str, case: str, law: str, state: int
) -> None:
    """The position of the cart, and the speed of the servo."""
    assert film_of([result(system, case, law)]).beside == state


def test_a_law_with_a_surface_shows_it() -> None:
    """Beside a law without one."""
    runs = [result("servo", "nominal", law) for law in ("lqr", "grosmc")]
    shown = film_of(runs)
    assert shown.beside is None
    assert [take.sliding_unit for take in shown.takes] == ["", "A s"]


def test_a_take_says_when_its_run_ended_and_why() -> None:
    run = result("servo", "nominal")
    ended = replace(
        run.trajectory,
        status=np.array([Status.DIVERGED], object)[0],
        valid_until=np.array(0.0123),
    )
    (take,) = film_of([replace(run, trajectory=ended)]).takes
    assert take.ended == "diverged at 0.01 s"
    assert film_of([run]).takes[0].ended == ""


# Curves


def test_curves_of_outputs_have_the_ghost_after_both_runs() -> None:
    """It is the ghost of the run that goes on."""
    whole, short = servo(), servo(end=50)
    title, curves = outputs(film(whole, short))
    assert title == "rotor angle θ [rad]  (dashed: yᵣ)"
    values = [whole.state[:, 0], short.state[:, 0], np.full(1001, 1.5)]
    assert [curve.values.tolist() for curve in curves] == [column.tolist() for column in values]
    assert [curve.time[-1] for curve in curves] == [1.0, 0.5, 1.0]


@pytest.mark.parametrize(("one_ghost", "colours"), [(True, [OPTIMUM] * 2), (False, [RED, BLUE])])
def test_an_optimum_has_the_colour_of_its_law(one_ghost: bool, colours: list[str]) -> None:
    curves = outputs(film(servo(), servo(), one_ghost=one_ghost)).curves
    assert [curve.style["color"] for curve in curves if "ls" in curve.style] == colours


@pytest.mark.parametrize(
    ("curves_of", "title", "signal"),
    [
        (surfaces, "sliding variable s [A s]", lambda run: run.sliding),
        (inputs, "current i [A]", lambda run: run.input),
        (
            lambda shown: surfaces(replace(shown, beside=1)),
            "rotor speed θ̇ [rad/s]",
            lambda run: run.state[:, 1],
        ),
    ],
    ids=["surfaces", "inputs", "a state in place of s"],
)
def test_curves_are_the_recorded_signals_with_their_units(
    curves_of: Callable[[Film], Plot], title: str, signal: Callable[[Trajectory], Array]
) -> None:
    runs = servo(), servo(end=50)
    plot = curves_of(film(*runs))
    assert plot.title == title
    for curve, run in zip(plot.curves, runs, strict=True):
        np.testing.assert_array_equal(curve.values, signal(run))
        np.testing.assert_array_equal(curve.time, run.time[: len(curve.values)])


def test_two_signals_of_a_run_are_dark_and_pale() -> None:
    run = invented(plant("two_link_arm"))
    title, (dark, pale) = inputs(film(run, system="two_link_arm"))
    assert title == "τ₁ dark, τ₂ pale [N m]"
    np.testing.assert_array_equal(pale.values, run.input[:, 1])
    dark_parts, pale_parts = np.array(dark.style["color"]), np.array(pale.style["color"])
    assert to_hex(dark.style["color"]) == RED.lower()
    assert 1 - pale_parts == pytest.approx((1 - dark_parts) / 2)


@pytest.mark.parametrize(
    ("curves_of", "title", "signals"),
    [
        (
            outputs,
            "distance |q − yᵣ| of 2 joints [rad]",
            lambda run: run.state[:, :2] - 1.5,
        ),
        (inputs, "size of the input |u| of 2 joints [N m]", lambda run: run.input[:, :2]),
        (surfaces, "size of the sliding variable |s| [A s]", lambda run: run.sliding),
    ],
    ids=["outputs", "inputs", "surfaces"],
)
def test_of_many_signals_one_curve_shows_the_norm_of_those_with_one_unit(
    curves_of: Callable[[Film], Plot], title: str, signals: Callable[[Trajectory], Array]
) -> None:
    """A tree of two hinges and a slide; the first law has no s."""
    tree = tree_plant()
    run = invented(tree)
    (first, second) = film_of_tree(replace(run, sliding=None), run).takes
    shown = Film("tree", tree.model, (first, second), SMALL)
    actual_title, curves = curves_of(shown)
    assert actual_title == title
    norms = np.sqrt((signals(run) ** 2).sum(axis=1))
    np.testing.assert_allclose(curves[1].values, norms, rtol=1e-14)
    assert len(curves[0].values) == (0 if curves_of is surfaces else len(norms))


@cache
def tree_plant() -> Any:
    return Robot.from_mjcf(TREE).plant


def film_of_tree(*runs: Trajectory) -> Film:
    takes = [Take("A", RED, run, np.full((1001, 3), 1.5), "A s") for run in runs]
    return Film("tree", tree_plant().model, tuple(takes), SMALL)


def test_a_plot_has_the_values_of_its_curves_between_the_instants_of_the_film() -> None:
    run = servo()
    shown = film(run, form=replace(SMALL, start=0.25, stop=0.75))
    (line,) = _draw(Figure().subplots(), inputs(shown), shown)
    np.testing.assert_array_equal(line.get_xdata(), run.time[250:751])
    np.testing.assert_array_equal(line.get_ydata(), run.input[250:751])


@pytest.mark.parametrize(("size", "low", "high"), [(30.0, -0.5, 1.5), (0.1, -0.155, 1.055)])
def test_a_run_that_ended_early_does_not_flatten_the_others(
    size: float, low: float, high: float
) -> None:
    """Half of their range is room for it above and below; it may need less."""
    time = np.linspace(0, 1, 101)
    early = PlotCurve(time[:20], np.linspace(-size, size, 20), {}, ended=True)
    axes = Figure().subplots()
    _draw(axes, Plot("q", [PlotCurve(time, time, {}), early]), film())
    assert axes.get_ylim() == pytest.approx((low, high))


def test_a_power_of_ten_stands_below_a_long_title() -> None:
    """The title is longer than the axes are wide."""
    title = "size of the sliding variable |s| [rad/s]"
    time = np.linspace(0, 1, 9)
    with mpl.rc_context(_style(9)):
        figure = Figure(figsize=(2.6, 1.8), layout="constrained")
        canvas = FigureCanvasAgg(figure)
        axes = figure.subplots()
        _draw(axes, Plot(title, [PlotCurve(time, 4e-4 * time, {})]), film())
        canvas.draw()

    (drawn_title,) = (text for text in axes.findobj(Text) if text.get_text() == title)
    power = axes.yaxis.get_offset_text()
    assert power.get_text()
    assert power.get_window_extent().x0 < drawn_title.get_window_extent().x1
    assert not power.get_window_extent().overlaps(drawn_title.get_window_extent())


# Frames


class Blank:
    """A renderer of pictures that are one grey, which keeps what it was given."""

    def __init__(self, model: mujoco.MjModel, height: int, width: int) -> None:
        self.model = model
        self.shape = (height, width, 3)
        self.angles: list[float] = []
        self.pushed: list[float] = []
        self.ghosts: list[bool] = []

    def update_scene(self, data: mujoco.MjData, camera: int) -> None:
        self.scene = mujoco.MjvScene(self.model, 1000)
        eye = mujoco.MjvCamera()
        eye.type = mujoco.mjtCamera.mjCAMERA_FIXED
        eye.fixedcamid = camera
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(self.model, data, option, None, eye, everything, self.scene)
        self.angles.append(float(data.qpos[0]))
        self.pushed.append(float(np.abs(data.xfrc_applied).max()))

    def render(self) -> np.ndarray:
        drawn = self.scene.geoms[: self.scene.ngeom]
        self.ghosts.append(any(0 < geom.rgba[3] < 0.5 for geom in drawn))
        return np.full(self.shape, 77, np.uint8)


@pytest.fixture(scope="module")
def board() -> frames.Storyboard:
    """Two runs with a placed camera; the second has half the speed, no push and no ghost."""
    second = replace(servo(speed=0.5), wrench=None)
    pushed, slow = film(servo(), second).takes
    shown = replace(film(), takes=(pushed, replace(slow, ghost=None)))
    prepared = storyboard(shown)
    assert prepared.stage is not None
    return replace(prepared, stage=prepared.stage._replace(placement=np.array([0.3, 0.4, 1.2])))


@pytest.fixture
def maker(board: frames.Storyboard, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(frames.mujoco, "Renderer", Blank)
    return frames.FrameMaker(board)


def test_nothing_of_a_frame_overlaps(board: frames.Storyboard) -> None:
    chart = board.chart
    white = np.all(chart.empty == 255, axis=2)
    covered = np.zeros(white.shape, int)
    for box in (*chart.areas, *chart.pictures):
        covered[box] += 1
    assert covered.max() == 1
    assert all(white[box].all() for box in chart.pictures)


@pytest.mark.parametrize(
    "edge", [np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]], ids=["top", "bottom", "left", "right"]
)
def test_nothing_is_cut_off_at_an_edge_of_a_frame(edge: Any, board: frames.Storyboard) -> None:
    assert np.all(board.chart.empty[edge] == 255)


def test_a_plot_is_shaded_while_a_disturbance_acts(board: frames.Storyboard) -> None:
    rows, columns = board.chart.areas[1]
    line = board.chart.empty[rows.start + 4, columns].astype(int)
    green = line[:, 1] - line[:, 0] > 10
    shaded = np.flatnonzero(green) / (len(green) - 1)
    assert (shaded.min(), shaded.max()) == pytest.approx((0.4, 0.6), abs=0.02)


@pytest.mark.parametrize("index", [0, 5, 9])
def test_each_picture_has_the_state_the_push_and_the_ghost_of_its_own_run(
    index: int, maker: Any
) -> None:
    """Also after the pushed one; each scene is updated twice."""
    t = index / 10
    maker.frame(index)
    renderer = maker._painter.renderer
    assert renderer.angles == pytest.approx([t, t, t / 2, t / 2])
    push = 3.0 if 0.4 <= t < 0.6 else 0.0
    assert renderer.pushed == [push, push, 0.0, 0.0]
    assert renderer.ghosts == [True, False]


def test_a_scene_is_drawn_from_the_placed_camera(board: frames.Storyboard, maker: Any) -> None:
    stage = board.stage
    assert stage is not None
    right, up, _ = stage.model.cam_mat0[stage.camera].reshape(3, 3).T
    axes = np.array([right, up, np.cross(right, up)])
    expected = stage.model.cam_pos[stage.camera] + stage.placement @ axes
    maker.frame(5)
    for eye in maker._painter.renderer.scene.camera:
        np.testing.assert_allclose(eye.pos, expected, rtol=0, atol=SINGLE)


@pytest.mark.parametrize("index", [0, 5, 9])
def test_a_frame_has_the_curves_up_to_its_instant(
    index: int, board: frames.Storyboard, maker: Any
) -> None:
    chart = board.chart
    image = maker.frame(index)[chart.areas[0]]
    (cursor,) = np.flatnonzero(np.all(image == 120, axis=(0, 2)))
    assert cursor == pytest.approx(index / 10 * (image.shape[1] - 1), abs=0.5)

    before, after = np.s_[:, :cursor], np.s_[:, cursor + 1 :]
    np.testing.assert_array_equal(image[before], chart.drawn[chart.areas[0]][before])
    np.testing.assert_array_equal(image[after], chart.empty[chart.areas[0]][after])


def test_outside_pictures_and_plots_a_frame_changes_only_at_the_clock(
    board: frames.Storyboard, maker: Any
) -> None:
    """It is right of the title."""
    chart = board.chart
    frame = maker.frame(5)
    changed = np.any(frame != chart.empty, axis=2)
    for box in (*chart.pictures, *chart.areas):
        changed[box] = False
    assert np.flatnonzero(changed.any(axis=0)).min() > chart.empty.shape[1] - 13.5 * chart.font
    assert not changed[chart.pictures[0][0].start :].any()
    assert all(np.all(frame[box] == 77) for box in chart.pictures)


class Pen:
    """Keeps the words that are drawn into a frame."""

    def __init__(self) -> None:
        self.words: list[str] = []

    def text(self, place: Any, words: str, *_: Any, **__: Any) -> None:
        self.words.append(words)


@pytest.mark.parametrize(("speed", "words"), [(1.0, "t = 2.50 s"), (0.25, "t = 2.50 s  ×0.25")])
def test_the_clock_has_the_time_of_the_run_and_the_speed(
    speed: float, words: str, board: frames.Storyboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    pen = Pen()
    monkeypatch.setattr(frames.ImageDraw, "Draw", lambda _: pen)
    late = replace(board, stage=None, speed=speed, times=np.array([2.5]))
    frames.FrameMaker(late).frame(0)
    assert pen.words == [words]


def test_a_film_of_equations_shows_their_curves_alone() -> None:
    shown = film_of([result("servo", "nominal", plant="corrected")])
    assert shown.model is None

    board = storyboard(replace(film(), model=None))
    area = board.chart.areas[0]
    assert area[0].stop - area[0].start > SMALL.height / 2
    maker = frames.FrameMaker(board)
    assert np.any(maker.frame(5)[area] != maker.frame(0)[area])
