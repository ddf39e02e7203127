"""The clock of a film, and the ghost of an edited plant."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import mujoco
import numpy as np
import pytest

from grosmc_mj.cli import films
from grosmc_mj.cli.commands.film import FilmCommand
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.films import film_of
from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.films import frames
from grosmc_mj.output.films.film import Film
from grosmc_mj.output.films.storyboard import storyboard
from grosmc_mj.simulation.disturbances import Disturbance, Pulse

START = 0.004
STOP = 0.016
FPS = 125


def film_of_servo(speed: float = 0.25) -> Film:
    """A film of a run of 20 ms, from 4 ms to 16 ms."""
    experiment = find_experiment("servo", "nominal").changed(duration=0.02)
    command = FilmCommand("servo", size="320x240", fps=FPS, speed=speed, start=START, stop=STOP)
    return film_of([experiment.run("physics", "lqr")], command._format())


def test_a_film_begins_and_ends_where_the_command_says() -> None:
    step = 0.25 / FPS
    assert film_of_servo().times == pytest.approx(START + step * np.arange(6), rel=1e-12)


def test_a_frame_has_the_state_at_its_clock() -> None:
    """Not at the time of the film, which begins at 0 and runs more slowly."""
    film = film_of_servo()
    (take,) = film.takes
    clock = take.run.time[film.rows(take)]
    assert clock == pytest.approx(film.times, abs=1e-9)


def test_a_frame_has_the_push_at_its_clock() -> None:
    """Of frames at 4, 6 ... 14 ms those at 10 and 12 ms are in a push from 9 ms to 13 ms."""
    push = Disturbance("rotor", (0, 0, 0, 0, 1, 0), Pulse(0.009, 0.013))
    experiment = find_experiment("servo", "nominal").changed(duration=0.02, disturbances=(push,))
    film = replace(film_of([experiment.run("physics", "lqr")]), format=film_of_servo().format)
    (scene,) = scenes_of(film)
    assert scene.wrench is not None
    assert np.flatnonzero(scene.wrench.any(axis=(1, 2))).tolist() == [3, 4]


def scenes_of(film: Film) -> tuple[frames.Scene, ...]:
    """Return the scenes of a film in MuJoCo."""
    stage = storyboard(film).stage
    assert stage is not None
    return stage.scenes


class BlindRenderer:
    """Renderer without graphics."""

    scene = None

    def __init__(self, *_: Any) -> None:
        """Open nothing."""

    def update_scene(self, *_: Any) -> None:
        """Show nothing."""

    def render(self) -> Any:
        return np.zeros((8, 8, 3), np.uint8)


def test_a_picture_has_the_wrench_of_its_own_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two runs side by side only the first is pushed."""
    stage = storyboard(film_of_servo()).stage
    assert stage is not None
    (scene,) = stage.scenes
    wrench = np.full((len(scene.physics), stage.model.nbody, 6), 0.75)
    runs = [scene._replace(wrench=wrench, ghost=None), scene._replace(wrench=None, ghost=None)]
    drawn: list[float] = []
    nothing = SimpleNamespace(paint=lambda *_: None, add=lambda *_: None)
    monkeypatch.setattr(frames.mujoco, "Renderer", BlindRenderer)
    monkeypatch.setattr(frames, "move", lambda *_: None)
    monkeypatch.setattr(
        frames,
        "add_wrenches",
        lambda _scene, _model, data, _: drawn.append(data.xfrc_applied.max()),
    )
    painter = frames._Painter(stage._replace(surroundings=cast(Any, nothing)))
    for run in (runs[0], runs[1], runs[0]):
        painter.picture(run, 0)
    assert drawn == [0.75, 0.0, 0.75]


def test_of_five_laws_the_last_four_are_filmed_in_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """The runs of a comparison stand before the law of interest."""
    results: list[Any] = [
        SimpleNamespace(plant=plant, case="case", law=law)
        for law in "abcde"
        for plant in ("physics", "corrected")
    ]
    filmed: list[str] = []
    monkeypatch.setattr(
        "grosmc_mj.experiments.films.film_of", lambda runs: [run.plant[0] + run.law for run in runs]
    )
    monkeypatch.setattr(
        films, "_write_missing", lambda _, made: filmed.extend(*(film for _, film in made.values()))
    )
    films.film_runs(cast(Any, None), results, Path("film.mp4"))
    assert filmed == ["pb", "pc", "pd", "pe"]


class Pen:
    """Keeps the words that are drawn into a frame."""

    def __init__(self) -> None:
        self.words: list[str] = []

    def text(self, place: Any, words: str, *_: Any, **__: Any) -> None:
        self.words.append(words)


@pytest.mark.parametrize(
    ("speed", "words"),
    [(1.0, "t = 2.50 s"), (0.25, "t = 2.50 s  ×0.25")],
)
def test_the_clock_has_the_time_of_the_run_and_the_speed(
    speed: float, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pen = Pen()
    monkeypatch.setattr(frames.ImageDraw, "Draw", lambda _: pen)
    # Without its picture a frame needs no graphics.
    board = replace(storyboard(film_of_servo(speed)), stage=None, times=np.array([2.5]))
    frames.FrameMaker(board).frame(0)
    assert pen.words == [words]


def tip_in_mujoco(film: Film, ghost: Array) -> Array:
    """Return the tip of the film's own model at joint angles, (x, z) from the shoulder."""
    assert film.model is not None
    data = mujoco.MjData(film.model)
    data.qpos[:] = ghost
    mujoco.mj_kinematics(film.model, data)
    from_shoulder = data.body("payload").xpos - data.body("upper").xpos
    return from_shoulder[[0, 2]]


def test_the_ghost_of_an_edited_plant_is_on_the_reference() -> None:
    """Links that are 5 % longer than the laws believe need other joint angles."""
    experiment = find_experiment("two_link_arm", "case2").changed(duration=0.01)
    film = film_of([experiment.run("physics", "lqr")])
    (take,) = film.takes

    tips = [tip_in_mujoco(film, ghost) for ghost in np.asarray(take.ghost)]
    angles = math.pi * take.run.time
    circle = np.column_stack([0.45 + 0.15 * np.cos(angles), 0.15 + 0.15 * np.sin(angles)])
    assert np.array(tips) == pytest.approx(circle, abs=1e-9)


def test_the_ghost_has_the_joints_that_nothing_controls_where_the_run_has_them() -> None:
    """The cart moves; the law controls the pole alone."""
    experiment = find_experiment("cart_pendulum", "nominal").changed(duration=0.02)
    film = replace(film_of([experiment.run("physics", "fl-lqr")]), format=film_of_servo().format)
    (take,) = film.takes
    (scene,) = scenes_of(film)
    rows = film.rows(take)
    expected = np.column_stack([take.run.state[rows, 0], np.asarray(take.ghost)[rows]])
    np.testing.assert_array_equal(scene.ghost, expected)
