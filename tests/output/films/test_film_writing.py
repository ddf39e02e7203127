"""Rendered films: their pictures and files, also after an interrupt or the end of a process."""

from __future__ import annotations

import contextlib
import hashlib
import io
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
from commands import assert_one_line, run
from PIL import Image, ImageSequence
from shipped import find_case, run_case

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.file.text import complete_text
from grosmc_mj.experiments.films import film_of, is_current, write_case_film
from grosmc_mj.experiments.settings import Settings
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
def result(system: str, case: str, controller: str = "lqr") -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


def drawn(board: Storyboard, backend: str, workers: int) -> list[np.ndarray]:
    with RenderingPool(backend, workers) as pool:
        return list(pool.frames(board))


def under_lqr(system: str, case: str, form: Format) -> Film:
    return film_of([result(system, case)], form)


def without_ghost(film: Film) -> Film:
    takes = [replace(take, ghost=None) for take in film.takes]
    return replace(film, takes=tuple(takes))


@pytest.fixture(scope="module")
def pair() -> Film:
    lqr = result("cart_pendulum", "nominal", "lqr")
    grosmc = result("cart_pendulum", "nominal", "grosmc")
    return film_of([lqr, grosmc], PAIR)


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


def test_the_film_can_begin_before_all_of_it_is_there(written: WrittenFilm) -> None:
    content = written.film.read_bytes()
    assert 0 < content.find(b"moov") < content.find(b"mdat")


def test_a_film_is_written_as_three_files(written: WrittenFilm) -> None:
    names = {path.name for path in written.film.parent.iterdir()}
    assert names == {"pair.mp4", "pair.png", "pair.gif"}


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


def test_decoded_frames_are_the_drawn_ones(
    written: WrittenFilm, frames_of_pair: list[np.ndarray]
) -> None:
    decoded = np.asarray(mediapy.read_video(written.film)).astype(int)
    for decoded_frame, frame in zip(decoded, frames_of_pair, strict=True):
        # Lossy, and colours at half the resolution; a wrong colour matrix alone costs more.
        assert np.abs(decoded_frame - frame).mean() < 3
        assert frame.std() > 20


def test_decoded_frames_move(written: WrittenFilm) -> None:
    decoded = np.asarray(mediapy.read_video(written.film)).astype(int)
    for before, after in itertools.pairwise(decoded):
        assert np.abs(before - after).mean() > 0.1


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
    hinge = pixel_of(data.body("pole").xpos, board, data)
    tip = pixel_of(data.site("tip").xpos, board, data)
    return hinge, tip


def pixel_of(point: np.ndarray, board: Storyboard, data: mujoco.MjData) -> np.ndarray:
    """Column and row of a point in the first picture."""
    height, width = board.chart.empty[board.chart.pictures[0]].shape[:2]
    stage = stage_of(board)
    field_of_view = math.radians(stage.model.cam_fovy[stage.camera])
    focal_length = height / 2 / math.tan(field_of_view / 2)

    axes = data.cam_xmat[stage.camera].reshape(3, 3)
    right, up, back = (point - data.cam_xpos[stage.camera]) @ axes - stage.placement
    centre = np.array([width / 2, height / 2])
    return centre + focal_length * np.array([right, -up]) / -back


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
    return storyboard(without_ghost(under_lqr("cart_pendulum", "case1", LOOK)))


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


BARE_CART_POLE = """
<mujoco>
  <worldbody>
    <body pos="0 0 1">
      <joint name="rail" type="slide" axis="1 0 0"/>
      <geom type="box" size=".2 .1 .1" mass="1"/>
      <body>
        <joint name="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 .6" size=".03" mass=".1"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="rail"/></actuator>
</mujoco>
"""
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
CASE_OF_MODEL = """
[plant]
model = "robot.xml"
[run]
start = {{ {joint} = "0.2 rad" }}
duration = "0.2 s"
[task]
Q = 10
R = 1
[[controller]]
law = "lqr"
[[controller]]
law = "lqr"
name = "grosmc"
"""


def luminance(colours: np.ndarray) -> np.ndarray:
    """Relative luminance of colours of sRGB from 0 to 1, (..., 3), as WCAG 2 defines it."""
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    return linear @ np.array([0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize(
    ("model", "joint"),
    [(BARE_CART_POLE, "hinge"), (BARE_ARM, "elbow")],
    ids=["cart-pole", "three-joint arm"],
)
def test_a_model_without_light_and_colours_stands_out_in_its_laws_colours(
    model: str, joint: str, backend: str, tmp_path: Path
) -> None:
    """A light picture, on which each machine has the hue of its law and a contrast above 1.5."""
    (tmp_path / "robot.xml").write_text(model)
    (tmp_path / "robot.toml").write_text(CASE_OF_MODEL.format(joint=joint))
    experiment = Experiment.load(tmp_path / "robot.toml")
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
    (experiment,) = find_experiments("maglev/warm")
    result = experiment.run(experiment.plant_names[-1], "lqr")
    written = write_film(film_of([result], TINY), tmp_path / "a.mp4")
    assert written.film.stat().st_size > 0


def tiny_film() -> Film:
    return under_lqr("servo", "nominal", TINY)


def slower_film() -> Film:
    return under_lqr("servo", "nominal", replace(TINY, speed=0.9))


def film_of_another_law() -> Film:
    return film_of([result("servo", "nominal", "grosmc")], TINY)


@pytest.fixture(scope="module")
def tiny(backend: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film of the servo's nominal case that is written."""
    path = tmp_path_factory.mktemp("current") / "tiny.mp4"
    case = find_case("servo", "nominal")
    write_case_film(case, tiny_film(), path, backend=backend, workers=1)
    return path


def test_a_film_is_current_for_the_same_runs_in_the_same_format(tiny: Path) -> None:
    repeated = run_case(find_case("servo", "nominal"), "physics", "lqr", Settings())
    assert is_current(film_of([repeated], TINY), tiny)


@pytest.mark.parametrize(
    "other", [lambda: without_ghost(tiny_film()), slower_film, film_of_another_law]
)
def test_a_film_is_not_current_for_another_one(other: Callable[[], Film], tiny: Path) -> None:
    assert not is_current(other(), tiny)


@pytest.mark.parametrize("suffix", [".mp4", ".json"])
def test_a_film_with_a_damaged_file_is_not_current(suffix: str, tiny: Path) -> None:
    part = tiny.with_suffix(suffix)
    content = part.read_bytes()
    part.write_bytes(b"less")
    assert not is_current(tiny_film(), tiny)

    part.write_bytes(content)
    assert is_current(tiny_film(), tiny)


@pytest.mark.parametrize("suffix", [".png", ".json"])
def test_a_film_that_lacks_a_file_is_not_current(suffix: str, tiny: Path) -> None:
    part = tiny.with_suffix(suffix)
    content = part.read_bytes()
    part.unlink()
    assert not is_current(tiny_film(), tiny)

    part.write_bytes(content)
    assert is_current(tiny_film(), tiny)


@pytest.fixture(scope="module")
def by_command(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder of a film of a file's case, and the output of the command."""
    folder = tmp_path_factory.mktemp("command")
    size = ("--size", "320x240", "--fps", "4", "--to", "0.5", "--laws", "lqr", "--gif")
    output = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(output):
        Path("small.toml").write_text(complete_text(shipped_files()["servo/case2"]))
        assert run("film", "small.toml", *size) == cli.DONE
    return folder / "renders" / "films", output.getvalue()


def test_the_command_says_how_long_the_film_is(by_command: tuple[Path, str]) -> None:
    _, output = by_command
    assert output.startswith("2 frames, 0.5 s, ")


def test_the_command_writes_a_document_beside_the_three_files(by_command: tuple[Path, str]) -> None:
    folder, _ = by_command
    names = {path.name for path in folder.iterdir()}
    assert names == {"small.mp4", "small.png", "small.gif", "small.json"}


def test_the_document_says_all_that_a_film_was_made_from(by_command: tuple[Path, str]) -> None:
    folder, _ = by_command
    document = json.loads((folder / "small.json").read_text(encoding="utf-8"))
    assert document["frames"] == 2
    assert document["duration"] == {"value": 0.5, "unit": "s"}
    content = (folder / "small.mp4").read_bytes()
    assert document["sha256"] == hashlib.sha256(content).hexdigest()

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
    older = {
        "f.mp4": "an older mp4",
        "f.png": "an older png",
        "f.json": "an older json",
    }
    for name, content in older.items():
        (tmp_path / name).write_text(content)

    case = ("cart_pendulum/nominal", "--laws", "lqr", "--size", "320x240", "--fps", "10")
    assert run("film", *case, "--workers", "1", "--gif", "-o", tmp_path / "f.mp4") == code
    error = capfd.readouterr().err
    assert_one_line(error)
    assert words in error
    assert ".part" not in error
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == older
    assert not children("ffmpeg")
