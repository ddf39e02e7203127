"""Rendered films: their pictures, their files, and what an interrupt or a death leaves."""

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
from commands import assert_one_line, run
from PIL import Image, ImageSequence
from shipped import find_case, run_case

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.file.reading import resolved_text
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.films import film_of, is_current, write_case_film
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films.film import Film, Format
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.offscreen import find_backend, find_ffmpeg, probe
from grosmc_mj.films.pool import RenderingPool
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.write import Written, write_film

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


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """No line of progress, however slow the machine is."""
    monkeypatch.setattr(screen, "LINE_EVERY", math.inf)


@cache
def result(system: str, case: str, controller: str = "lqr") -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


def drawn(board: Storyboard, backend: str, workers: int) -> list[np.ndarray]:
    with RenderingPool(backend, workers) as pool:
        return list(pool.frames(board))


def under_lqr(system: str, case: str, form: Format) -> Film:
    return film_of([result(system, case)], form)


def without_ghost(film: Film) -> Film:
    return replace(film, takes=tuple(replace(take, ghost=None) for take in film.takes))


@pytest.fixture(scope="module")
def pair() -> Film:
    return film_of([result("cart_pendulum", "nominal", name) for name in ("lqr", "grosmc")], PAIR)


@pytest.fixture(scope="module")
def written(pair: Film, backend: str, tmp_path_factory: pytest.TempPathFactory) -> Written:
    path = tmp_path_factory.mktemp("written") / "new" / "pair.mp4"
    return write_film(pair, path, backend=backend, workers=2, gif=True)


def test_the_file_is_one_that_every_browser_plays_as_long_as_the_data(written: Written) -> None:
    command = ["ffprobe", "-v", "error", "-count_frames", "-show_streams", "-of", "json"]
    done = subprocess.run([*command, written.film], capture_output=True, text=True, check=True)
    (stream,) = json.loads(done.stdout)["streams"]
    assert int(stream["nb_read_frames"]) == written.frames == 5
    assert float(stream["duration"]) == pytest.approx(1.0, abs=1e-3)
    kind = {"codec_name": "h264", "pix_fmt": "yuv420p", "width": PAIR.width, "height": PAIR.height}
    colours = dict.fromkeys(("color_space", "color_primaries", "color_transfer"), "bt709")
    assert {**kind, **colours, "color_range": "tv"}.items() <= stream.items()
    # It can begin before all of it is there.
    content = written.film.read_bytes()
    assert 0 < content.find(b"moov") < content.find(b"mdat")
    names = {path.name for path in written.film.parent.iterdir()}
    assert names == {"pair.mp4", "pair.png", "pair.gif"}
    assert written.gif is not None
    with Image.open(written.gif) as gif:
        assert (gif.size, gif.info["loop"]) == ((PAIR.width, PAIR.height), 0)
        pictures = [np.array(one.convert("RGB"), int) for one in ImageSequence.Iterator(gif)]
        shown = sum(one.info["duration"] for one in ImageSequence.Iterator(gif)) / 1000
    assert shown == pytest.approx(1.0, abs=0.15)
    assert np.abs(pictures[0] - pictures[-1]).mean() > 1


def test_decoded_frames_are_the_drawn_ones_whoever_draws_and_writes_them(
    written: Written, pair: Film, backend: str, tmp_path: Path
) -> None:
    frames = drawn(storyboard(pair), backend, 1)
    decoded = np.asarray(mediapy.read_video(written.film)).astype(int)
    for decoded_frame, frame in zip(decoded, frames, strict=True):
        # Lossy, and colours at half the resolution; a wrong colour matrix alone costs more.
        assert np.abs(decoded_frame - frame).mean() < 3
        assert frame.std() > 20
    for before, after in itertools.pairwise(decoded):
        assert np.abs(before - after).mean() > 0.1
    with Image.open(written.poster) as poster:
        np.testing.assert_array_equal(np.asarray(poster), frames[2])
    again = write_film(pair, tmp_path / "again.mp4", backend=backend, workers=1)
    assert again.film.read_bytes() == written.film.read_bytes()
    assert again.poster.read_bytes() == written.poster.read_bytes()
    assert again.gif is None


def pole_ends(board: Storyboard, index: int) -> Iterator[np.ndarray]:
    """Column and row of the hinge and of the tip, by the model's own camera and its placement."""
    data = mujoco.MjData(board.model)
    state = board.scenes[0].physics[index]
    mujoco.mj_setState(board.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_forward(board.model, data)
    height, width = board.chart.empty[board.chart.pictures[0]].shape[:2]
    axes = data.cam_xmat[board.camera].reshape(3, 3)
    focal = height / 2 / math.tan(math.radians(board.model.cam_fovy[board.camera]) / 2)
    for point in (data.body("pole").xpos, data.site("tip").xpos):
        right, up, back = (point - data.cam_xpos[board.camera]) @ axes - board.placement
        yield np.array([width / 2, height / 2]) + focal * np.array([right, -up]) / -back


def drawn_tip(shown: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Outermost point of the pole's vermilion cap; the rail's mark is below the hinge."""
    red, green, blue = np.moveaxis(shown.astype(int), 2, 0)
    rows, columns = np.nonzero((red > 1.5 * green) & (green > 1.2 * blue) & (red > 60))
    pixels = np.column_stack([columns, rows])[rows < hinge[1]] + 0.5
    along = pixels.mean(axis=0) - hinge
    along /= np.linalg.norm(along)
    return hinge + along * (((pixels - hinge) @ along).max() + 0.5)


def test_a_frame_shows_its_recorded_state_whoever_draws_it_and_after_which(backend: str) -> None:
    """A pole of four times the mass and the length."""
    board = storyboard(without_ghost(under_lqr("cart_pendulum", "case1", LOOK)))
    frames = drawn(board, backend, 1)
    tips = []
    for index, frame in enumerate(frames):
        hinge, tip = pole_ends(board, index)
        assert np.linalg.norm(drawn_tip(frame[board.chart.pictures[0]], hinge) - tip) < 2
        tips.append(tip)
    # Else it would be a still.
    assert np.ptp(tips, axis=0).max() > 10
    scenes = tuple(scene._replace(physics=scene.physics[::-1]) for scene in board.scenes)
    backwards = replace(board, times=board.times[::-1], scenes=scenes)
    for one, other in zip(frames, drawn(backwards, backend, 2)[::-1], strict=True):
        np.testing.assert_array_equal(one, other)
    second = {"egl": "osmesa"}.get(backend, "egl")
    if probe(second).works:
        for one, frame in zip(frames, drawn(board, second, 1), strict=True):
            differences = np.abs(one.astype(int) - frame)
            # Another rasterizer may decide otherwise about an edge.
            assert differences.mean() < 1
            assert np.percentile(differences, 99.9) < 16


def test_one_pool_draws_one_film_after_another_as_each_alone(backend: str) -> None:
    films = (under_lqr("servo", "nominal", TINY), under_lqr("cart_pendulum", "case1", LOOK))
    boards = [storyboard(film) for film in films]
    alone = [drawn(board, backend, 1) for board in boards]
    with RenderingPool(backend, 2) as pool:
        # A film that is broken off leaves the pool to the next.
        with contextlib.closing(pool.frames(boards[1])) as frames:
            next(frames)
        for number in (0, 1, 0):
            together = list(pool.frames(boards[number]))
            np.testing.assert_array_equal(together, alone[number])


def test_a_film_is_current_for_the_same_runs_in_the_same_format_alone(
    backend: str, tmp_path: Path
) -> None:
    path, film = tmp_path / "tiny.mp4", under_lqr("servo", "nominal", TINY)
    case = find_case("servo", "nominal")
    write_case_film(case, film, path, settings=Settings(), backend=backend, workers=1)
    assert is_current(film_of([run_case(case, "physics", "lqr", Settings())], TINY), path)
    for other in (
        without_ghost(film),
        under_lqr("servo", "nominal", replace(TINY, speed=0.9)),
        film_of([result("servo", "nominal", "grosmc")], TINY),
    ):
        assert not is_current(other, path)
    for suffix, damage in ((".mp4", b"less"), (".png", None), (".json", b"less"), (".json", None)):
        part = path.with_suffix(suffix)
        content = part.read_bytes()
        part.write_bytes(damage) if damage else part.unlink()
        assert not is_current(film, path)
        part.write_bytes(content)
    assert is_current(film, path)


def test_the_command_writes_film_poster_gif_and_a_document_of_a_file_s_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("small.toml").write_text(resolved_text(shipped_files()["servo/case2"]))
    size = ("--size", "320x240", "--fps", "4", "--to", "0.5", "--laws", "lqr", "--gif")
    assert run("film", "small.toml", *size) == cli.DONE
    folder = Path("renders") / "films"
    assert capsys.readouterr().out.startswith("2 frames, 0.5 s, ")
    names = {f"small.{suffix}" for suffix in ("mp4", "png", "gif", "json")}
    assert {path.name for path in folder.iterdir()} == names
    document = json.loads((folder / "small.json").read_text(encoding="utf-8"))
    assert (document["frames"], document["duration"]) == (2, {"value": 0.5, "unit": "s"})
    assert document["sha256"] == hashlib.sha256((folder / "small.mp4").read_bytes()).hexdigest()
    configuration = document["configuration"]
    assert configuration["controllers"] == ["LQR"]
    shown = {"width": 320, "height": 240, "fps": 4, "speed": 1.0, "start": 0.0, "stop": 0.5}
    assert configuration["film"] == {**shown, "camera": "fixed"}


def children(word: str) -> list[int]:
    """Living children of this process with a word in their command line."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            state, parent = (folder / "stat").read_text().rpartition(")")[2].split()[:2]
            mine = (state != "Z", int(parent)) == (True, os.getpid())
            if mine and word.encode() in (folder / "cmdline").read_bytes():
                found.append(int(folder.name))
    return found


def interrupt() -> None:
    raise KeyboardInterrupt


def kill(word: str) -> None:
    for pid in children(word):
        os.kill(pid, signal.SIGKILL)


class BrokenPool(RenderingPool):
    """One that is interrupted before its first frame."""

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
def test_an_interrupt_or_the_end_of_a_process_leaves_an_older_film_and_no_process(
    event: Callable[[], None], code: int, words: str, tmp_path: Path,
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    @contextlib.contextmanager
    def progress(_total: int, _unit: str = "") -> Iterator[Callable[[str], None]]:
        frames = iter(range(100_000))
        yield lambda _text="": (next(frames) == 2 and event(), None)[1]

    monkeypatch.setattr(screen, "progress", progress)
    older = {f"f.{suffix}": f"an older {suffix}" for suffix in ("mp4", "png", "json")}
    for name, content in older.items():
        (tmp_path / name).write_text(content)
    film = ("film", "cart_pendulum/nominal", "--laws", "lqr", "--size", "320x240", "--fps",
            "10", "--workers", "1", "--gif", "-o")  # fmt: skip
    assert run(*film, tmp_path / "f.mp4") == code
    output = capfd.readouterr()
    assert_one_line(output.err)
    assert words in output.err
    assert ".part" not in output.err
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == older
    assert not children("ffmpeg")
