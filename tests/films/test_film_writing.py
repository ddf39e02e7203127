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
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mediapy
import mujoco
import numpy as np
import pytest
from conftest import hear_interrupts
from PIL import Image
from shipped import find_case, run_case

import grosmc_mj as gm
from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.films import film_of, is_current, write_case_film
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films.film import Film, Format, Take
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.offscreen import find_backend, find_ffmpeg, probe
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.write import Written, draw_frames, write_film

pytestmark = [pytest.mark.render, pytest.mark.slow]

# Far above what these films take; one that hangs is to be told from one that is slow.
PATIENCE = 300.0
# Within this a process that has been told to end has ended [s].
SOON = 10.0
WORKER = "popen_loky"
# One picture of 320 x 240 at 0, 0.25, ... 1.25 s.
LOOK = Format(320, 480, fps=4, stop=1.5)
# Two pictures, to be written as a file: ten frames, two seconds.
PAIR = Format(480, 320, fps=5, stop=2.0)
TINY = Format(320, 240, fps=4, stop=0.5)
FILM = ("cart_pendulum/nominal", "--controllers", "lqr", "--size", "320x240", "--workers", "1")
INTERRUPTED = "grosmc-mj: interrupted; run the same command again to start over\n"


@pytest.fixture(scope="module", autouse=True)
def backend() -> str:
    """What renders here; without it, or without ffmpeg, there is nothing to test."""
    if shutil.which("ffprobe") is None:
        pytest.skip("ffprobe, which looks at the films, is not installed")
    try:
        find_ffmpeg()
        return find_backend(os.environ.get("MUJOCO_GL")).backend
    except SetupError as error:
        pytest.skip(f"no films can be made here: {error}")


@cache
def result(system: str, case: str, controller: str) -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


def lone_film(system: str, case: str, form: Format, *, ghost: bool = True) -> Film:
    """The run under LQR, alone."""
    film = film_of([result(system, case, "lqr")], form)
    takes = film.takes if ghost else tuple(replace(take, ghost=None) for take in film.takes)
    return replace(film, takes=takes)


def pair_film() -> Film:
    return film_of([result("cart_pendulum", "nominal", name) for name in ("lqr", "grosmc")], PAIR)


Shot = tuple[Storyboard, list[np.ndarray]]


def shoot(film: Film, backend: str, workers: int = 1) -> Shot:
    board = storyboard(film)
    return board, list(draw_frames(board, backend, workers))


@pytest.fixture(scope="module")
def edited(backend: str) -> Shot:
    """The pole of four times the mass and the length, without its ghost."""
    return shoot(lone_film("cart_pendulum", "case1", LOOK, ghost=False), backend)


@pytest.fixture(scope="module")
def written(backend: str, tmp_path_factory: pytest.TempPathFactory) -> Written:
    path = tmp_path_factory.mktemp("written") / "new" / "pair.mp4"
    return write_film(pair_film(), path, backend=backend, workers=2, gif=True)


# The files


@cache
def probed(path: Path) -> dict[str, Any]:
    """What ffprobe says of the one stream, its frames counted by decoding them."""
    command = ["ffprobe", "-v", "error", "-count_frames", "-show_streams", "-of", "json", str(path)]
    said = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    (stream,) = said["streams"]
    return stream


def test_the_file_is_what_every_browser_plays_as_long_as_the_data(written: Written) -> None:
    stream = probed(written.film)
    assert int(stream["nb_read_frames"]) == written.frames == 10
    assert float(stream["duration"]) == pytest.approx(2.0, abs=1e-3)
    assert (stream["codec_name"], stream["pix_fmt"]) == ("h264", "yuv420p")
    assert (stream["width"], stream["height"]) == (PAIR.width, PAIR.height)
    colours = {key: stream.get(f"color_{key}") for key in ("space", "primaries", "transfer")}
    assert colours == {"space": "bt709", "primaries": "bt709", "transfer": "bt709"}
    assert stream["color_range"] == "tv"
    # It can begin before all of it is there.
    content = written.film.read_bytes()
    assert 0 < content.find(b"moov") < content.find(b"mdat")
    assert {path.name for path in written.film.parent.iterdir()} == {
        "pair.mp4", "pair.png", "pair.gif"
    }  # fmt: skip


def test_decoded_frames_are_the_drawn_ones_whoever_draws_and_writes_them(
    written: Written, backend: str, tmp_path: Path
) -> None:
    _, frames = shoot(pair_film(), backend)
    decoded = np.asarray(mediapy.read_video(written.film)).astype(int)
    for seen, frame in zip(decoded, frames, strict=True):
        # Lossy, and colours at half the resolution; a wrong colour matrix alone costs more.
        assert np.abs(seen - frame).mean() < 3
        assert frame.std() > 20
    for before, after in itertools.pairwise(decoded):
        assert np.abs(before - after).mean() > 0.1
    with Image.open(written.poster) as poster:
        np.testing.assert_array_equal(np.asarray(poster), frames[5])
    again = write_film(pair_film(), tmp_path / "again.mp4", backend=backend, workers=1)
    assert again.film.read_bytes() == written.film.read_bytes()
    assert again.poster.read_bytes() == written.poster.read_bytes()
    assert again.gif is None


def test_the_gif_moves_for_as_long_as_the_film(written: Written) -> None:
    assert written.gif is not None
    shown, frames = 0.0, []
    with Image.open(written.gif) as gif:
        assert (gif.size, gif.info["loop"]) == ((PAIR.width, PAIR.height), 0)
        for index in range(getattr(gif, "n_frames", 1)):
            gif.seek(index)
            shown += gif.info["duration"] / 1000
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
    assert shown == pytest.approx(2.0, abs=0.15)
    assert np.abs(frames[0] - frames[-1]).mean() > 1


def test_a_frame_depends_neither_on_those_before_it_nor_on_the_backend(
    edited: Shot, backend: str
) -> None:
    """Else it would depend on which worker happens to draw it."""
    board, frames = edited
    scenes = tuple(scene._replace(physics=scene.physics[::-1]) for scene in board.scenes)
    backwards = replace(board, times=board.times[::-1], scenes=scenes)
    for one, other in zip(frames, list(draw_frames(backwards, backend, 2))[::-1], strict=True):
        np.testing.assert_array_equal(one, other)
    second = {"egl": "osmesa"}.get(backend, "egl")
    if probe(second).works:
        for one, frame in zip(frames, draw_frames(board, second, 1), strict=True):
            differences = np.abs(one.astype(int) - frame)
            # Another rasterizer may decide otherwise about an edge.
            assert differences.mean() < 1
            assert np.percentile(differences, 99.9) < 16


# The pictures against the recorded states


def pose(board: Storyboard, index: int, *, ghost: bool = False) -> mujoco.MjData:
    """The recorded pose of a frame, or its ghost's."""
    scene, data = board.scenes[0], mujoco.MjData(board.model)
    mujoco.mj_setState(board.model, data, scene.physics[index], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    if ghost:
        assert scene.ghost is not None
        data.qpos[:] = scene.ghost[index]
    mujoco.mj_forward(board.model, data)
    return data


def project(board: Storyboard, data: mujoco.MjData, point: np.ndarray) -> np.ndarray:
    """Column and row of a point of the world, by the model's own camera and its placement."""
    height, width = board.chart.empty[board.chart.pictures[0]].shape[:2]
    axes = data.cam_xmat[board.camera].reshape(3, 3)
    right, up, back = (point - data.cam_xpos[board.camera]) @ axes - board.placement
    focal = height / 2 / math.tan(math.radians(board.model.cam_fovy[board.camera]) / 2)
    return np.array([width / 2, height / 2]) + focal * np.array([right, -up]) / -back


def ends_of_the_pole(board: Storyboard, index: int, *, ghost: bool = False) -> list[np.ndarray]:
    """Where hinge and tip must be in the picture."""
    data = pose(board, index, ghost=ghost)
    pole, tip = board.model.body("pole").id, board.model.site("tip").id
    return [project(board, data, point) for point in (data.xpos[pole], data.site_xpos[tip])]


def picture(shot: Shot, index: int) -> np.ndarray:
    board, frames = shot
    return frames[index][board.chart.pictures[0]].astype(int)


def drawn_tip(shown: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Outermost point of the pole's vermilion cap; the rail's mark is below the hinge."""
    red, green, blue = np.moveaxis(shown, 2, 0)
    rows, columns = np.nonzero((red > 1.5 * green) & (green > 1.2 * blue) & (red > 60))
    pixels = np.column_stack([columns, rows])[rows < hinge[1]] + 0.5
    along = pixels.mean(axis=0) - hinge
    along /= np.linalg.norm(along)
    return hinge + along * (((pixels - hinge) @ along).max() + 0.5)


def test_the_drawn_tip_is_where_the_recorded_state_puts_it(edited: Shot, backend: str) -> None:
    """Of an edited pole, and of a cart behind a belt with a load that swings below it."""
    parts = (
        gm.machine.Transmission("slider", 0.1, stiffness=1e4, backlash=1e-3),
        gm.machine.SwingingLoad("cart", 0.2, 0.3),
    )
    case = replace(find_case("cart_pendulum", "nominal"), edits=parts)
    geared = film_of([run_case(case, "physics", "lqr", Settings())], LOOK)
    bare = replace(geared, takes=(replace(geared.takes[0], ghost=None),))
    for shot in (edited, shoot(bare, backend)):
        tips = []
        for index in range(len(shot[1])):
            hinge, tip = ends_of_the_pole(shot[0], index)
            assert np.linalg.norm(drawn_tip(picture(shot, index), hinge) - tip) < 2
            tips.append(tip)
        # Else it would be a still.
        assert np.ptp(tips, axis=0).max() > 10
    own, ghost = (pose(storyboard(geared), 4, ghost=each).qpos for each in (False, True))
    assert np.flatnonzero(own != ghost).tolist() == [1]


def test_the_ghost_stands_where_the_optimum_is(edited: Shot, backend: str) -> None:
    ghosted = shoot(lone_film("cart_pendulum", "case1", LOOK), backend)
    (hinge, tip), (_, own) = (ends_of_the_pole(ghosted[0], 4, ghost=each) for each in (True, False))
    # The LQR of the nominal pole is far behind: the two can be told apart.
    assert np.linalg.norm(tip - own) > 6
    column, row = (tip + 0.04 * (hinge - tip)).astype(int)
    patch = slice(row - 1, row + 2), slice(column - 1, column + 2)
    with_it, without = (picture(shot, 4)[patch].mean(axis=(0, 1)) for shot in (ghosted, edited))
    assert np.all(with_it < without - 25)
    # Grey, and the background shines through.
    assert np.ptp(with_it) < 20
    assert with_it.mean() > 60


def green(shown: np.ndarray) -> np.ndarray:
    """Pixels of the disturbance's colour, lit or shaded; nothing in the models is green."""
    red, level, blue = np.moveaxis(shown, 2, 0)
    return (level > 1.5 * red + 10) & (level > 1.15 * blue)


def test_marks_are_there_while_a_wrench_acts_and_point_where_it_does(backend: str) -> None:
    form = replace(LOOK, fps=2, start=9.0, stop=14.0)
    loaded = shoot(lone_film("servo", "case1", form, ghost=False), backend)
    for index, t in enumerate(loaded[0].times):
        count = green(picture(loaded, index)).sum()
        assert count > 200 if 10 <= t < 13 else count == 0, f"t = {t} s"
    plant = gm.MujocoPlant.load("cart_pendulum")
    law = gm.chapter_controller("lqr", plant.analytic())
    push = gm.Disturbance("cart", (8.0, 0.0, 0.0, 0.0, 0.0, 0.0), gm.Pulse(0.25, 0.75))
    run = gm.simulate(plant, law, [0.0, 0.0, 0.0, 0.0], duration=1.0, disturbances=[push])
    form = replace(LOOK, stop=1.0, camera="fixed")
    pushed = shoot(Film("A push", plant.model, (Take("A", "#56B4E9", run),), form), backend)
    masks = [green(picture(pushed, index)) for index in range(4)]
    assert [bool(mask.any()) for mask in masks] == [False, True, True, False]
    for index in (1, 2):
        data = pose(pushed[0], index)
        centre = project(pushed[0], data, data.xipos[plant.model.body("cart").id])
        rows, columns = np.nonzero(masks[index])
        # From the centre of mass to the right, level, 0.30 of the picture's height long.
        assert columns.min() + 0.5 == pytest.approx(centre[0], abs=2)
        assert rows.mean() + 0.5 == pytest.approx(centre[1], abs=2)
        assert np.ptp(columns) + 1 == pytest.approx(0.3 * masks[index].shape[0], abs=4)


# What lies beside a film


@pytest.fixture(scope="module")
def beside(backend: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film of two frames with its JSON."""
    path = tmp_path_factory.mktemp("beside") / "tiny.mp4"
    case, film = find_case("servo", "nominal"), lone_film("servo", "nominal", TINY)
    write_case_film(case, film, path, settings=Settings(), backend=backend, workers=1)
    return path


def test_a_film_is_current_for_the_same_runs_in_the_same_format_alone(beside: Path) -> None:
    again = run_case(find_case("servo", "nominal"), "physics", "lqr", Settings())
    assert is_current(film_of([again], TINY), beside)
    for other in (
        lone_film("servo", "case2", TINY),
        lone_film("servo", "nominal", TINY, ghost=False),
        *(lone_film("servo", "nominal", replace(TINY, **{key: value}))
          for key, value in {"fps": 5, "speed": 0.9, "camera": "follow", "height": 242}.items()),
        film_of([result("servo", "nominal", "grosmc")], TINY),
    ):  # fmt: skip
        assert not is_current(other, beside)


@pytest.mark.parametrize("suffix", [".mp4", ".png", ".json"])
def test_a_film_with_a_file_missing_or_cut_off_is_not_current(
    beside: Path, suffix: str, tmp_path: Path
) -> None:
    kept = Path(shutil.copytree(beside.parent, tmp_path / "kept")) / beside.name
    film, part = lone_film("servo", "nominal", TINY), kept.with_suffix(suffix)
    assert is_current(film, kept)
    if suffix != ".png":
        part.write_bytes(part.read_bytes()[:-100])
        assert not is_current(film, kept)
    part.unlink()
    assert not is_current(film, kept)


def film(path: Path, *arguments: str) -> Any:
    """Exit code of the command line, in this process."""
    with pytest.raises(SystemExit) as stop:
        cli.main(("film", *arguments, "-o", str(path)))
    return stop.value.code


def test_the_command_writes_film_poster_gif_and_what_they_were_made_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # However slow the machine is.
    monkeypatch.setattr(screen, "LINE_EVERY", float("inf"))
    path = tmp_path / "f.mp4"
    assert film(path, *FILM, "--fps", "4", "--to", "1", "--gif") == cli.DONE
    said = capsys.readouterr()
    assert f"{path}" in said.out
    assert "4 frames, 1.0 s" in said.out
    assert said.err == ""
    assert {each.name for each in tmp_path.iterdir()} == {"f.mp4", "f.png", "f.gif", "f.json"}
    beside = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))
    assert (beside["frames"], beside["duration"]) == (4, {"value": 1.0, "unit": "s"})
    assert beside["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    configuration = beside["configuration"]
    assert (configuration["case"]["case"], configuration["controllers"]) == ("nominal", ["LQR"])
    shown = {"width": 320, "height": 240, "fps": 4, "speed": 1.0, "start": 0.0, "stop": 1.0}
    assert configuration["film"] == {**shown, "camera": "follow"}


# Interrupts, deaths and full disks


def put_an_older_film(folder: Path) -> dict[str, bytes]:
    """What is there before."""
    folder.mkdir(exist_ok=True)
    for suffix in ("mp4", "png", "json"):
        (folder / f"f.{suffix}").write_bytes(f"an older {suffix}".encode())
    return contents(folder)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def commands(parent: int | None = None, session: int | None = None) -> dict[int, str]:
    """Command lines of the living children of a process, or members of its session."""
    found = {}
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            pid = int(folder.name)
            state, *numbers = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            if state != "Z" and (int(numbers[0]) == parent or int(numbers[2]) == session):
                found[pid] = (folder / "cmdline").read_bytes().replace(b"\0", b" ").decode()
    return found


def children(word: str) -> list[int]:
    return [pid for pid, command in commands(parent=os.getpid()).items() if word in command]


def wait_for(what: Callable[[], Any], patience: float = PATIENCE) -> Any:
    """Poll until there is something."""
    end = time.monotonic() + patience
    while not (found := what()):
        if time.monotonic() > end:
            pytest.fail(f"nothing of the kind within {patience} s")
        time.sleep(0.02)
    return found


@pytest.mark.parametrize("whom", ["group", "parent", "killed"])
def test_an_interrupt_leaves_an_older_film_and_no_process(tmp_path: Path, whom: str) -> None:
    """A terminal sends it to the whole group; a process that is killed cannot clean up itself."""
    path, older = tmp_path / "f.mp4", put_an_older_film(tmp_path)
    long = (*FILM, "--fps", "60", "--speed", "0.2", "-o", str(path))
    with subprocess.Popen(
        [sys.executable, "-m", "grosmc_mj.cli", "film", *long], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=hear_interrupts,
    ) as run:  # fmt: skip
        # Frames are being encoded.
        wait_for(lambda: any(part.stat().st_size for part in tmp_path.glob(".f.*.part.mp4")))
        if whom == "group":
            os.killpg(run.pid, signal.SIGINT)
        else:
            os.kill(run.pid, signal.SIGINT if whom == "parent" else signal.SIGKILL)
        out, error = run.communicate(timeout=PATIENCE)
        wait_for(lambda: not commands(session=run.pid), SOON)
    if whom == "killed":
        assert path.read_bytes() == older["f.mp4"]
    else:
        lines = [line for line in error.splitlines(keepends=True) if " frames in " not in line]
        assert (run.returncode, out, "".join(lines)) == (cli.INTERRUPTED, "", INTERRUPTED)
        assert contents(tmp_path) == older


@pytest.fixture
def at_frame(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[], object]], None]:
    """Let something happen when a frame of the command line's film is done."""

    def arrange(index: int, event: Callable[[], object]) -> None:
        @contextlib.contextmanager
        def progress(_total: int, _unit: str = "") -> Iterator[Callable[[str], None]]:
            frames = iter(range(100_000))
            yield lambda _text="": (next(frames) == index and event(), None)[1]

        monkeypatch.setattr(screen, "progress", progress)

    return arrange


@pytest.mark.parametrize(
    ("program", "says"),
    [(WORKER, "a rendering process ended unexpectedly"), ("ffmpeg", "f.mp4: ffmpeg stopped")],
)
def test_a_death_ends_the_film_in_one_line(
    program: str,
    says: str,
    tmp_path: Path,
    at_frame: Callable[[int, Callable[[], object]], None],
    capfd: pytest.CaptureFixture[str],
) -> None:
    older = put_an_older_film(tmp_path)
    at_frame(2, lambda: [os.kill(pid, signal.SIGKILL) for pid in children(program)])
    assert film(tmp_path / "f.mp4", *FILM, "--fps", "10") == cli.WRONG
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err.startswith("grosmc-mj: ")
    assert says in said.err
    assert said.err.count("\n") == 1
    assert ".part" not in said.err
    assert contents(tmp_path) == older
    assert not children("ffmpeg")


@pytest.mark.parametrize("suffix", ["mp4", "png", "gif", "json"])
def test_a_full_disk_is_one_line_and_nothing_is_left(
    suffix: str,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened = os.open

    def open_full(path: Any, flags: int, *more: Any, **further: Any) -> int:
        if flags & os.O_EXCL and Path(path).suffix == f".{suffix}":
            Path(path).symlink_to("/dev/full")
            path, flags = "/dev/full", os.O_WRONLY
        return opened(path, flags, *more, **further)

    monkeypatch.setattr("grosmc_mj.files.os.open", open_full)
    short = (*FILM, "--fps", "10", "--to", "0.3", "--gif")
    assert film(tmp_path / "f.mp4", *short) == cli.WRONG
    line = capfd.readouterr().err
    assert line.count("\n") == 1
    assert "No space left on device" in line
    assert "free the disk or choose another place" in line
    assert not list(tmp_path.glob(".*"))
    assert (tmp_path / "f.mp4").exists() == (suffix == "json")
