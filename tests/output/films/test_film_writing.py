"""Rendered films: their pictures and files, also after an interrupt or the end of a process."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import math
import os
import shutil
import signal
import subprocess
from collections.abc import Callable, Generator, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import mediapy
import mujoco
import numpy as np
import pytest
from cases import case
from commands import assert_one_line, run
from PIL import Image, ImageSequence

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.films import film_of
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.output.films.film import Film, Format
from grosmc_mj.output.films.frames import Stage, Storyboard
from grosmc_mj.output.films.offscreen import find_backend, find_ffmpeg, probe
from grosmc_mj.output.films.pool import RenderingPool
from grosmc_mj.output.films.storyboard import storyboard
from grosmc_mj.output.films.write import WrittenFilm, write_film
from grosmc_mj.output.palette import red_green_blue

pytestmark = [pytest.mark.render, pytest.mark.slow]

# One picture at 0, 0.25, ... 1.0 s.
LOOK = Format(320, 480, fps=4, stop=1.25)
# Two pictures, to be written as a file: five frames, one second.
PAIR = Format(480, 320, fps=5, stop=1.0)
TINY = Format(320, 240, fps=4, stop=0.5)


@pytest.fixture(scope="module", autouse=True)
def backend() -> str:
    """The backend that renders here; without it, or without ffmpeg, there is nothing to test."""
    if shutil.which("ffprobe") is None:
        pytest.skip("ffprobe, which looks at the films, is not installed")
    try:
        find_ffmpeg()
        return find_backend(os.environ.get("MUJOCO_GL")).backend
    except SetupError as error:
        pytest.skip(f"no films can be made here: {error}")


@pytest.fixture(scope="module", autouse=True)
def _quick() -> Iterator[None]:
    """No line of progress, however slow the machine is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(screen, "LINE_EVERY", math.inf)
        yield


@cache
def result(system: str, case: str, law: str = "lqr") -> RunResult:
    return find_experiment(system, case).changed(duration=1.25).run("physics", law)


def drawn(board: Storyboard, backend: str, workers: int) -> list[np.ndarray]:
    with RenderingPool(backend, workers) as pool:
        return list(pool.frames(board))


def under_lqr(system: str, case: str, form: Format) -> Film:
    return film_of([result(system, case)], form)


@pytest.fixture(scope="module")
def pair() -> Film:
    laws = ("lqr", "grosmc")
    return film_of([result("cart_pendulum", "nominal", law) for law in laws], PAIR)


@pytest.fixture(scope="module")
def written(pair: Film, backend: str, tmp_path_factory: pytest.TempPathFactory) -> WrittenFilm:
    path = tmp_path_factory.mktemp("written") / "new" / "pair.mp4"
    return write_film(pair, path, backend=backend, workers=2, gif=True)


def test_the_film_is_one_that_every_browser_plays(written: WrittenFilm) -> None:
    command = ["ffprobe", "-v", "error", "-count_frames", "-show_streams", "-of", "json"]
    done = subprocess.run([*command, written.film], capture_output=True, text=True, check=True)
    (stream,) = json.loads(done.stdout)["streams"]
    assert written.frames == 5
    assert int(stream["nb_read_frames"]) == 5
    assert float(stream["duration"]) == pytest.approx(1.0, abs=1e-3)
    expected = {
        "codec_name": "h264",
        "pix_fmt": "yuv420p",
        "width": PAIR.width,
        "height": PAIR.height,
        "color_space": "bt709",
        "color_primaries": "bt709",
        "color_transfer": "bt709",
        "color_range": "tv",
    }
    assert expected.items() <= stream.items()
    # It can begin before all of it is there.
    content = written.film.read_bytes()
    assert 0 < content.find(b"moov") < content.find(b"mdat")


def test_the_gif_moves_as_long_as_the_film(written: WrittenFilm) -> None:
    assert written.gif is not None
    pictures = []
    milliseconds = 0
    with Image.open(written.gif) as gif:
        assert gif.size == (PAIR.width, PAIR.height)
        # It begins anew without end.
        assert gif.info["loop"] == 0
        for picture in ImageSequence.Iterator(gif):
            pictures.append(np.array(picture.convert("RGB"), int))
            milliseconds += picture.info["duration"]
    assert milliseconds / 1000 == pytest.approx(1.0, abs=0.15)
    assert np.abs(pictures[0] - pictures[-1]).mean() > 1


@pytest.fixture(scope="module")
def frames_of_pair(pair: Film, backend: str) -> list[np.ndarray]:
    return drawn(storyboard(pair), backend, 1)


def test_decoded_frames_are_the_drawn_ones_and_move(
    written: WrittenFilm, frames_of_pair: list[np.ndarray]
) -> None:
    decoded = np.asarray(mediapy.read_video(written.film)).astype(int)
    # Lossy, and colours at half the resolution; a wrong colour matrix alone costs more.
    assert np.abs(decoded - frames_of_pair).mean(axis=(1, 2, 3)).max() < 3
    assert np.abs(np.diff(decoded, axis=0)).mean(axis=(1, 2, 3)).min() > 0.1


def test_the_poster_is_the_frame_in_the_middle(
    written: WrittenFilm, frames_of_pair: list[np.ndarray]
) -> None:
    with Image.open(written.poster) as poster:
        np.testing.assert_array_equal(np.asarray(poster), frames_of_pair[2])


def test_a_film_does_not_depend_on_its_workers(
    written: WrittenFilm, pair: Film, backend: str, tmp_path: Path
) -> None:
    again = write_film(pair, tmp_path / "again.mp4", backend=backend, workers=1)
    assert again.film.read_bytes() == written.film.read_bytes()
    assert again.poster.read_bytes() == written.poster.read_bytes()
    assert again.gif is None


def stage_of(board: Storyboard) -> Stage:
    """Return the stage of a film in MuJoCo."""
    assert board.stage is not None
    return board.stage


def pole_ends(board: Storyboard, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Column and row of the hinge and of the tip, by the model's own camera and its placement."""
    stage = stage_of(board)
    data = mujoco.MjData(stage.model)
    state = stage.scenes[0].physics[index]
    mujoco.mj_setState(stage.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_forward(stage.model, data)

    height, width = board.chart.empty[board.chart.pictures[0]].shape[:2]
    field_of_view = math.radians(stage.model.cam_fovy[stage.camera])
    focal_length = height / 2 / math.tan(field_of_view / 2)
    axes = data.cam_xmat[stage.camera].reshape(3, 3)
    points = np.array([data.body("pole").xpos, data.site("tip").xpos])
    right, up, back = ((points - data.cam_xpos[stage.camera]) @ axes - stage.placement).T
    columns = width / 2 - focal_length * right / back
    rows = height / 2 + focal_length * up / back
    hinge, tip = np.column_stack([columns, rows])
    return hinge, tip


def drawn_tip(picture: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Outermost point of the pole's vermilion cap; the rail's mark is below the hinge."""
    red, green, blue = np.moveaxis(picture.astype(int), 2, 0)
    vermilion = (red > 1.5 * green) & (green > 1.2 * blue) & (red > 60)
    rows, columns = np.nonzero(vermilion)
    above = rows < hinge[1]
    pixels = np.column_stack([columns, rows])[above] + 0.5

    direction = pixels.mean(axis=0) - hinge
    direction /= np.linalg.norm(direction)
    length = ((pixels - hinge) @ direction).max() + 0.5
    return hinge + direction * length


@pytest.fixture(scope="module")
def heavy_pole() -> Storyboard:
    """A pole of four times the mass and the length."""
    film = under_lqr("cart_pendulum", "case1", LOOK)
    return storyboard(replace(film, takes=(replace(film.takes[0], ghost=None),)))


@pytest.fixture(scope="module")
def frames_of_heavy_pole(heavy_pole: Storyboard, backend: str) -> list[np.ndarray]:
    return drawn(heavy_pole, backend, 1)


def test_a_frame_shows_its_recorded_state(
    heavy_pole: Storyboard, frames_of_heavy_pole: list[np.ndarray]
) -> None:
    tips = []
    for index, frame in enumerate(frames_of_heavy_pole):
        hinge, tip = pole_ends(heavy_pole, index)
        picture = frame[heavy_pole.chart.pictures[0]]
        assert np.linalg.norm(drawn_tip(picture, hinge) - tip) < 2
        tips.append(tip)
    # Else it would be a still.
    assert np.ptp(tips, axis=0).max() > 10


BARE_ARM = """
<mujoco>
  <worldbody>
    <body pos="0 0 .3">
      <joint name="turn" axis="0 0 1" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 0 0 .3" size=".04" mass="1"/>
      <body pos="0 0 .3">
        <joint name="shoulder" axis="0 1 0" damping=".1"/>
        <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03" mass=".7"/>
        <body pos=".3 0 0">
          <joint name="elbow" axis="0 1 0" damping=".1"/>
          <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".4"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="a" joint="turn"/><motor name="b" joint="shoulder"/><motor name="c" joint="elbow"/>
  </actuator>
</mujoco>
"""


def luminance(colours: np.ndarray) -> np.ndarray:
    """Relative luminance of colours of sRGB from 0 to 1, (..., 3), as WCAG 2 defines it."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


def test_a_model_without_light_and_colours_stands_out_in_its_laws_colours(
    backend: str, tmp_path: Path
) -> None:
    """A light picture, on which each machine has the hue of its law and a contrast above 1.5."""
    (tmp_path / "robot.xml").write_text(BARE_ARM)
    experiment = case(
        "robot.xml",
        folder=tmp_path,
        run={"start": {"elbow": "0.2 rad"}, "duration": "0.2 s"},
        task={"Q": 10, "R": 1},
        controller=[{"law": "lqr"}, {"law": "lqr", "name": "grosmc"}],
    )
    runs = [experiment.run("physics", law) for law in ("lqr", "grosmc")]
    film = film_of(runs, Format(640, 320, fps=5, stop=0.2))
    board = storyboard(film)
    (frame, *_) = drawn(board, backend, 1)

    for take, box in zip(film.takes, board.chart.pictures, strict=True):
        picture = frame[box] / 255
        assert 0.7 < picture.mean() < 0.95
        coloured = np.ptp(picture, axis=2) > 0.25
        assert 0.01 < coloured.mean() < 0.5

        machine = picture[coloured].mean(axis=0)
        assert np.corrcoef(machine, red_green_blue(take.colour))[0, 1] > 0.95
        darker, lighter = sorted(
            [luminance(machine), luminance(picture[~coloured]).mean()],
        )
        assert (lighter + 0.05) / (darker + 0.05) > 1.5


def test_a_frame_depends_neither_on_its_worker_nor_on_the_one_before(
    heavy_pole: Storyboard, frames_of_heavy_pole: list[np.ndarray], backend: str
) -> None:
    stage = stage_of(heavy_pole)
    scenes = [scene._replace(physics=scene.physics[::-1]) for scene in stage.scenes]
    backwards = replace(
        heavy_pole, times=heavy_pole.times[::-1], stage=stage._replace(scenes=tuple(scenes))
    )
    frames = drawn(backwards, backend, 2)
    np.testing.assert_array_equal(frames[::-1], frames_of_heavy_pole)


def test_a_second_backend_draws_nearly_the_same(
    heavy_pole: Storyboard, frames_of_heavy_pole: list[np.ndarray], backend: str
) -> None:
    second = "osmesa" if backend == "egl" else "egl"
    if not probe(second).works:
        pytest.skip(f"{second} does not work here")
    frames = drawn(heavy_pole, second, 1)
    for frame, expected in zip(frames, frames_of_heavy_pole, strict=True):
        differences = np.abs(frame.astype(int) - expected)
        # Another rasterizer may decide otherwise about an edge.
        assert differences.mean() < 1
        assert np.percentile(differences, 99.9) < 16


def test_one_pool_draws_one_film_after_another_as_each_alone(backend: str) -> None:
    boards = [
        storyboard(under_lqr("servo", "nominal", TINY)),
        storyboard(under_lqr("cart_pendulum", "case1", LOOK)),
    ]
    alone = [drawn(board, backend, 1) for board in boards]
    with RenderingPool(backend, 2) as pool:
        # A film that is broken off leaves the pool to the next.
        with contextlib.closing(pool.frames(boards[1])) as frames:
            next(frames)
        for number in (0, 1, 0):
            together = list(pool.frames(boards[number]))
            np.testing.assert_array_equal(together, alone[number])


def test_a_film_of_equations_needs_no_graphics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "no such backend")
    result = find_experiment("servo", "nominal").changed(duration=0.5).run("corrected", "lqr")
    written = write_film(film_of([result], TINY), tmp_path / "a.mp4")
    assert written.film.stat().st_size > 0


def test_the_command_says_all_that_a_film_was_made_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    options = "--laws lqr --size 320x240 --fps 4 --to 0.5 --duration 0.6 --gif"
    assert run("film", "servo/case2", *options.split()) == cli.DONE
    assert capsys.readouterr().out.startswith("2 frames, 0.5 s, ")
    folder = tmp_path / "renders" / "films"
    suffixes = {path.suffix for path in folder.glob("servo_case2.*")}
    assert suffixes == {".mp4", ".png", ".gif", ".json"}

    document = json.loads((folder / "servo_case2.json").read_text(encoding="utf-8"))
    content = (folder / "servo_case2.mp4").read_bytes()
    assert document["sha256"] == hashlib.sha256(content).hexdigest()
    assert (document["frames"], document["duration"]) == (2, {"value": 0.5, "unit": "s"})
    configuration = document["configuration"]
    assert configuration["controllers"] == ["lqr"]
    assert configuration["film"] == {
        "width": 320,
        "height": 240,
        "fps": 4,
        "speed": 1.0,
        "start": 0.0,
        "stop": 0.5,
        "camera": "fixed",
    }


def is_living_child(folder: Path) -> bool:
    """True if a folder of /proc is of a living child of this process."""
    after_name = (folder / "stat").read_text().rpartition(")")[2]
    state, parent = after_name.split()[:2]
    return state != "Z" and int(parent) == os.getpid()


def children(word: str) -> list[int]:
    """Living children of this process with a word in their command line."""
    pids = []
    for folder in Path("/proc").glob("[0-9]*"):
        # A process may end meanwhile.
        with contextlib.suppress(OSError):
            command = (folder / "cmdline").read_bytes()
            if is_living_child(folder) and word.encode() in command:
                pids.append(int(folder.name))
    return pids


def interrupt() -> None:
    raise KeyboardInterrupt


def kill(word: str) -> None:
    for pid in children(word):
        os.kill(pid, signal.SIGKILL)


class BrokenPool(RenderingPool):
    """A pool that is interrupted before its first frame."""

    def frames(self, board: Storyboard) -> Generator[np.ndarray]:
        raise KeyboardInterrupt
        yield board.chart.empty


def test_an_interrupt_before_the_first_frame_is_not_taken_for_an_error_of_ffmpeg(
    backend: str, tmp_path: Path
) -> None:
    film = under_lqr("servo", "nominal", TINY)
    with BrokenPool(backend, 1) as pool, pytest.raises(KeyboardInterrupt):
        write_film(film, tmp_path / "f.mp4", pool=pool, gif=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("event", "code", "words"),
    [
        (interrupt, cli.INTERRUPTED, "interrupted; run the same command again to start over"),
        (lambda: kill("popen_loky"), cli.WRONG, "a rendering process ended unexpectedly"),
        (lambda: kill("ffmpeg"), cli.WRONG, "f.mp4: ffmpeg stopped"),
    ],
    ids=["interrupt", "worker", "ffmpeg"],
)
def test_a_film_that_is_broken_off_leaves_no_trace(
    event: Callable[[], None],
    code: int,
    words: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @contextlib.contextmanager
    def progress(_total: int, _unit: str = "") -> Iterator[Callable[[str], None]]:
        frames = itertools.count()

        def advance(_text: str = "") -> None:
            if next(frames) == 2:
                event()

        yield advance

    monkeypatch.setattr(screen, "progress", progress)
    older = {"f.mp4": "an older mp4", "f.png": "an older png", "f.json": "an older json"}
    for name, content in older.items():
        (tmp_path / name).write_text(content)

    options = "--laws lqr --duration 1 --size 320x240 --fps 10 --workers 1 --gif"
    film = ("film", "cart_pendulum/nominal", *options.split())
    assert run(*film, "-o", tmp_path / "f.mp4") == code
    error = capfd.readouterr().err
    assert_one_line(error)
    assert words in error
    assert ".part" not in error
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == older
    assert not children("ffmpeg")
