"""Rendered films: their files, and whether the pictures show what the runs recorded."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import mediapy
import mujoco
import numpy as np
import pytest
from PIL import Image
from shipped import find_case, run_case

import grosmc_mj as gm
from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.films import film_of, is_current, write_case_film
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.films.film import Film, Format, Take
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.layout import Box
from grosmc_mj.films.offscreen import find_backend, find_ffmpeg, probe
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.workers import draw_frames
from grosmc_mj.films.write import Written, write_film

pytestmark = pytest.mark.render

# One picture of 320 x 240 at 0, 0.25, ... 1.25 s.
LOOK = Format(width=320, height=480, fps=4, stop=1.5)
ONE_SECOND = 4
# Two pictures, to be written as a file: ten frames, two seconds.
PAIR = Format(width=480, height=320, fps=5, stop=2.0)
SWING = Case(
    "cart_pendulum",
    "swing",
    "The pole swings through, where one law is undefined",
    "this test",
    (0.0, -0.1, 0.0, -20.0),
    0.5,
    disturbances=(gm.Disturbance("cart", (2.0, 0.0, 0.0, 0.0, 0.0, 0.0), gm.Pulse(0.0, 0.02)),),
)


@dataclass(frozen=True)
class Shot:
    """A film and its frames."""

    film: Film
    board: Storyboard
    frames: list[np.ndarray]

    def part(self, box: Box, index: int) -> np.ndarray:
        return self.frames[index][box.top : box.bottom, box.left : box.right].astype(int)

    def picture(self, index: int, number: int = 0) -> np.ndarray:
        return self.part(self.board.layout.picture(number), index)


@pytest.fixture(scope="module")
def backend() -> str:
    """What renders here; without it, or without ffmpeg, there is nothing to test."""
    try:
        find_ffmpeg()
        found = find_backend(os.environ.get("MUJOCO_GL")).backend
    except SetupError as error:
        pytest.skip(f"no films can be made here: {error}")
    return found


@pytest.fixture(autouse=True)
def _needs_what_films_need(backend: str) -> None:
    if shutil.which("ffprobe") is None:
        pytest.skip("ffprobe, which looks at the films, is not installed")


@cache
def result(system: str, case: str, controller: str) -> RunResult:
    return run_case(find_case(system, case), "physics", controller, Settings())


def lone_film(system: str, case: str, form: Format, *, ghost: bool) -> Film:
    """The run under LQR, alone."""
    film = film_of([result(system, case, "lqr")], form)
    return film if ghost else without_ghost(film)


def without_ghost(film: Film) -> Film:
    return replace(film, takes=tuple(replace(take, ghost=None) for take in film.takes))


def pair_film() -> Film:
    return film_of([result("cart_pendulum", "nominal", name) for name in ("lqr", "grosmc")], PAIR)


def shoot(film: Film, backend: str, workers: int = 1) -> Shot:
    board = storyboard(film)
    return Shot(film, board, list(draw_frames(board, backend, workers)))


@pytest.fixture(scope="module")
def nominal(backend: str) -> Shot:
    return shoot(lone_film("cart_pendulum", "nominal", LOOK, ghost=False), backend)


@pytest.fixture(scope="module")
def edited(backend: str) -> Shot:
    """The pole of four times the mass and the length, without its ghost."""
    return shoot(lone_film("cart_pendulum", "case1", LOOK, ghost=False), backend)


@pytest.fixture(scope="module")
def ghosted(backend: str) -> Shot:
    return shoot(lone_film("cart_pendulum", "case1", LOOK, ghost=True), backend)


@cache
def geared_film() -> Film:
    """A cart behind a belt, with a load that swings below it."""
    parts = (
        gm.machine.Transmission("slider", 0.1, stiffness=1e4, backlash=1e-3),
        gm.machine.SwingingLoad("cart", 0.2, 0.3),
    )
    case = replace(find_case("cart_pendulum", "nominal"), edits=parts)
    return film_of([run_case(case, "physics", "lqr", Settings())], LOOK)


@pytest.fixture(scope="module")
def geared(backend: str) -> Shot:
    return shoot(without_ghost(geared_film()), backend)


@pytest.fixture(scope="module")
def loaded(backend: str) -> Shot:
    """The servo about the 3 s of its load torque: 9.0, 9.5, ... 13.5 s."""
    form = replace(LOOK, fps=2, start=9.0, stop=14.0)
    return shoot(lone_film("servo", "case1", form, ghost=False), backend)


@pytest.fixture(scope="module")
def pushed(backend: str) -> Shot:
    """A run of one's own: the cart is pushed to the right for 0.25 s <= t < 0.75 s."""
    plant = gm.MujocoPlant.load("cart_pendulum")
    law = gm.chapter_controller("lqr", plant.analytic())
    push = gm.Disturbance("cart", (8.0, 0.0, 0.0, 0.0, 0.0, 0.0), gm.Pulse(0.25, 0.75))
    run = gm.simulate(plant, law, [0.0, 0.0, 0.0, 0.0], duration=1.0, disturbances=[push])
    form = replace(LOOK, stop=1.0, camera="fixed")
    return shoot(Film("A push", plant.model, (Take("mine", "#56B4E9", run),), form), backend)


@pytest.fixture(scope="module")
def pair(backend: str) -> Shot:
    return shoot(pair_film(), backend)


@pytest.fixture(scope="module")
def written(backend: str, tmp_path_factory: pytest.TempPathFactory) -> Written:
    folder = tmp_path_factory.mktemp("written") / "new"
    return write_film(pair_film(), folder / "pair.mp4", backend=backend, workers=2, gif=True)


@pytest.fixture(scope="module")
def ended(backend: str) -> Shot:
    """A law that becomes undefined at 92 ms, beside one that goes on; a frame every 50 ms."""
    results = [run_case(SWING, "physics", name, Settings()) for name in ("fl-lqr", "lqr")]
    return shoot(film_of(results, Format(480, 270, fps=20, stop=0.25)), backend)


# The files


@cache
def probed(path: Path) -> dict[str, Any]:
    """What ffprobe says of the one stream, its frames counted by decoding them."""
    command = ["ffprobe", "-v", "error", "-count_frames", "-show_streams", "-of", "json", str(path)]
    said = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    (stream,) = said["streams"]
    return stream


def test_the_file_has_as_many_frames_and_seconds_as_the_data_ask_for(written: Written) -> None:
    stream = probed(written.film)
    assert PAIR.stop is not None
    assert int(stream["nb_read_frames"]) == written.frames == round(PAIR.stop * PAIR.fps)
    assert float(stream["duration"]) == pytest.approx(PAIR.stop / PAIR.speed, abs=1e-3)
    assert stream["r_frame_rate"] == f"{PAIR.fps}/1"


def test_the_file_is_what_every_browser_plays(written: Written) -> None:
    stream = probed(written.film)
    assert (stream["codec_name"], stream["pix_fmt"]) == ("h264", "yuv420p")
    assert stream["profile"] in ("Constrained Baseline", "Main", "High")
    assert (stream["width"], stream["height"]) == (PAIR.width, PAIR.height)
    assert stream["width"] % 2 == stream["height"] % 2 == 0


def test_the_file_says_how_its_colours_are_meant(written: Written) -> None:
    stream = probed(written.film)
    colours = {key: stream.get(f"color_{key}") for key in ("space", "primaries", "transfer")}
    assert colours == {"space": "bt709", "primaries": "bt709", "transfer": "bt709"}
    assert stream["color_range"] == "tv"


def atoms(path: Path) -> Iterator[str]:
    """Names of an MP4's outermost boxes, in order."""
    data, at = path.read_bytes(), 0
    while at < len(data):
        size, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        yield name.decode()
        # 1 stands for a size of eight bytes that follows.
        at += size if size != 1 else int.from_bytes(data[at + 8 : at + 16], "big")


def test_a_browser_can_begin_before_it_has_the_whole_file(written: Written) -> None:
    names = list(atoms(written.film))
    assert names[0] == "ftyp"
    assert names.index("moov") < names.index("mdat")


def test_decoded_frames_are_the_drawn_ones(written: Written, pair: Shot) -> None:
    decoded = np.asarray(mediapy.read_video(written.film)).astype(int)
    assert decoded.shape == (len(pair.frames), PAIR.height, PAIR.width, 3)
    for seen, frame in zip(decoded, pair.frames, strict=True):
        # Lossy, and colours at half the resolution; a wrong colour matrix alone costs more.
        assert np.abs(seen - frame).mean() < 3
        assert frame.mean() > 100
        assert frame.std() > 20
    for before, after in itertools.pairwise(decoded):
        assert np.abs(before - after).mean() > 0.1


def test_the_poster_is_the_telling_frame_itself(written: Written, pair: Shot) -> None:
    with Image.open(written.poster) as poster:
        assert poster.format == "PNG"
        assert poster.size == (PAIR.width, PAIR.height)
        np.testing.assert_array_equal(np.asarray(poster), pair.frames[pair.board.poster])


def test_the_poster_shows_a_run_at_its_furthest_from_the_ghost(pair: Shot) -> None:
    def distance(index: int) -> float:
        rows = [(take, pair.film.rows(take)[index]) for take in pair.film.takes]
        return max(abs(float(t.run.state[row, 1] - t.ghosts[row, 0])) for t, row in rows)

    distances = [distance(index) for index in range(len(pair.frames))]
    assert distances[pair.board.poster] == max(distances) > 0


def test_the_gif_moves_for_as_long_as_the_film(written: Written) -> None:
    assert written.gif is not None
    assert PAIR.stop is not None
    shown, frames = 0.0, []
    with Image.open(written.gif) as gif:
        assert gif.format == "GIF"
        assert gif.size == (PAIR.width, PAIR.height)
        assert gif.info["loop"] == 0
        for index in range(getattr(gif, "n_frames", 1)):
            gif.seek(index)
            shown += gif.info["duration"] / 1000
            frames.append(np.asarray(gif.convert("RGB")).astype(int))
    assert len(frames) >= written.frames
    assert shown == pytest.approx(PAIR.stop, abs=0.15)
    assert np.abs(frames[0] - frames[-1]).mean() > 1


def test_nothing_but_the_finished_files_is_left(written: Written) -> None:
    left = {path.name for path in written.film.parent.iterdir()}
    assert left == {"pair.mp4", "pair.png", "pair.gif"}


def test_the_same_film_written_again_has_the_same_bytes(
    written: Written, backend: str, tmp_path: Path
) -> None:
    """Prepared anew, and by another number of workers."""
    again = write_film(pair_film(), tmp_path / "again.mp4", backend=backend, workers=1)
    assert again.film.read_bytes() == written.film.read_bytes()
    assert again.poster.read_bytes() == written.poster.read_bytes()
    assert again.gif is None


def test_two_workers_draw_what_one_draws(nominal: Shot, backend: str) -> None:
    frames = list(draw_frames(nominal.board, backend, 2))
    assert len(frames) == len(nominal.frames)
    for one, other in zip(nominal.frames, frames, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_frame_does_not_depend_on_those_drawn_before_it(edited: Shot, backend: str) -> None:
    """Else it would depend on which worker happens to draw it."""
    board = edited.board
    scenes = tuple(scene._replace(physics=scene.physics[::-1]) for scene in board.scenes)
    backwards = replace(board, times=board.times[::-1], scenes=scenes)
    frames = list(draw_frames(backwards, backend, 1))[::-1]
    for one, other in zip(edited.frames, frames, strict=True):
        np.testing.assert_array_equal(one, other)


def test_egl_and_osmesa_draw_the_same(nominal: Shot, backend: str) -> None:
    other = {"egl": "osmesa"}.get(backend, "egl")
    if not (found := probe(other)).works:
        pytest.skip(f"{other} does not work here: {found.reason}")
    for one, frame in zip(nominal.frames, draw_frames(nominal.board, other, 1), strict=True):
        differences = np.abs(one.astype(int) - frame)
        assert differences.mean() < 1
        # Another rasterizer may decide otherwise about an edge.
        assert np.percentile(differences, 99.9) < 16


# Where the parts of a frame are, and what changes


def outside(shot: Shot, boxes: Sequence[Box], index: int) -> np.ndarray:
    """Which pixels of a frame are not the chart's, beyond these boxes."""
    changed = np.any(shot.frames[index] != shot.board.chart.empty, axis=2)
    for box in boxes:
        changed[box.top : box.bottom, box.left : box.right] = False
    return changed


def moving_parts(shot: Shot) -> list[Box]:
    layout = shot.board.layout
    pictures = [layout.picture(i) for i in range(layout.pictures)]
    return [*pictures, *shot.board.chart.areas, layout.clock]


def test_the_clock_goes(pair: Shot) -> None:
    faces = [pair.part(pair.board.layout.clock, index) for index in range(len(pair.frames))]
    assert all(face.min() < 100 for face in faces)
    for one, other in itertools.combinations(faces, 2):
        assert np.any(one != other)


def test_a_clock_with_a_speed_stays_beside_the_title(backend: str) -> None:
    form = Format(320, 240, fps=2, speed=0.5, start=10.5, stop=11.0)
    shot = shoot(lone_film("servo", "case1", form, ghost=False), backend)
    assert len(shot.frames) == 2
    for index in range(2):
        assert not outside(shot, moving_parts(shot), index).any()


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


@dataclass(frozen=True)
class Pinhole:
    """The model's own camera, moved as the storyboard says."""

    eye: np.ndarray
    axes: np.ndarray
    focal: float
    middle: np.ndarray

    def project(self, point: np.ndarray) -> np.ndarray:
        """Column and row of a point of the world."""
        right, up, back = (point - self.eye) @ self.axes
        return self.middle + self.focal * np.array([right, -up]) / -back


def camera_of(board: Storyboard, data: mujoco.MjData) -> Pinhole:
    box, axes = board.layout.picture(0), data.cam_xmat[board.camera].reshape(3, 3)
    half = math.tan(math.radians(board.model.cam_fovy[board.camera]) / 2)
    return Pinhole(
        data.cam_xpos[board.camera] + axes @ np.array(board.placement),
        axes,
        box.height / 2 / half,
        np.array([box.width / 2, box.height / 2]),
    )


def ends_of_the_pole(
    board: Storyboard, index: int, *, ghost: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Where hinge and tip must be in the picture."""
    data = pose(board, index, ghost=ghost)
    camera = camera_of(board, data)
    tip = data.site_xpos[board.model.site("tip").id]
    return camera.project(data.xpos[board.model.body("pole").id]), camera.project(tip)


def vermilion(picture: np.ndarray) -> np.ndarray:
    red, green, blue = np.moveaxis(picture, 2, 0)
    return (red > 1.5 * green) & (green > 1.2 * blue) & (red > 60)


def drawn_tip(picture: np.ndarray, hinge: np.ndarray) -> np.ndarray:
    """Outermost point of the pole's cap; the rail's vermilion mark is below the hinge."""
    rows, columns = np.nonzero(vermilion(picture))
    pixels = np.column_stack([columns, rows])[rows < hinge[1]] + 0.5
    assert len(pixels) > 4
    along = pixels.mean(axis=0) - hinge
    along /= np.linalg.norm(along)
    return hinge + along * (((pixels - hinge) @ along).max() + 0.5)


@pytest.mark.parametrize("which", ["nominal", "edited", "geared"])
def test_the_drawn_tip_is_where_the_recorded_state_puts_it(
    which: str, request: pytest.FixtureRequest
) -> None:
    shot: Shot = request.getfixturevalue(which)
    tips = []
    for index in range(len(shot.frames)):
        hinge, tip = ends_of_the_pole(shot.board, index)
        drawn = drawn_tip(shot.picture(index), hinge)
        assert np.linalg.norm(drawn - tip) < 2, f"t = {shot.film.times[index]} s"
        tips.append(tip)
    # Else it would be a still.
    assert np.ptp(tips, axis=0).max() > 10


# Ghosts


def patch(picture: np.ndarray, middle: np.ndarray, radius: int = 1) -> np.ndarray:
    """Mean colour around a point."""
    column, row = middle.astype(int)
    rows = slice(row - radius, row + radius + 1)
    return picture[rows, column - radius : column + radius + 1].mean(axis=(0, 1))


def test_the_ghost_of_a_machine_differs_in_the_controlled_coordinate_alone(backend: str) -> None:
    board = shoot(geared_film(), backend).board
    own, ghost = (pose(board, ONE_SECOND, ghost=each) for each in (False, True))
    moved = np.flatnonzero(own.qpos != ghost.qpos)
    assert moved.tolist() == [1]
    assert len(own.qpos) == 4


def test_the_ghost_stands_where_the_optimum_is(ghosted: Shot, edited: Shot) -> None:
    hinge, tip = ends_of_the_pole(ghosted.board, ONE_SECOND, ghost=True)
    _, own = ends_of_the_pole(ghosted.board, ONE_SECOND)
    # The LQR of the nominal pole is far behind: the two can be told apart.
    assert np.linalg.norm(tip - own) > 6
    inside = tip + 0.04 * (hinge - tip)
    with_it = patch(ghosted.picture(ONE_SECOND), inside)
    without = patch(edited.picture(ONE_SECOND), inside)
    assert np.all(with_it < without - 25)
    # Grey, and the background shines through.
    assert np.ptp(with_it) < 20
    assert with_it.mean() > 60


# Disturbances


def green(picture: np.ndarray) -> np.ndarray:
    """Pixels of the disturbance's colour, lit or shaded; nothing in the models is green."""
    red, level, blue = np.moveaxis(picture, 2, 0)
    return (level > 1.5 * red + 10) & (level > 1.15 * blue)


def test_the_arc_is_there_while_the_load_acts_and_only_then(loaded: Shot) -> None:
    counts = {
        t: int(green(loaded.picture(index)).sum())
        for index, t in enumerate(loaded.film.times.tolist())
    }
    assert list(counts) == [9.0, 9.5, 10.0, 10.5, 11.0, 11.5, 12.0, 12.5, 13.0, 13.5]
    for t, count in counts.items():
        assert count > 200 if 10 <= t < 13 else count == 0, f"t = {t} s"


def test_the_arrow_points_where_the_force_does(pushed: Shot) -> None:
    masks = [green(pushed.picture(index)) for index in range(len(pushed.frames))]
    np.testing.assert_array_equal(pushed.film.times, [0.0, 0.25, 0.5, 0.75])
    assert [bool(mask.any()) for mask in masks] == [False, True, True, False]
    for index in (1, 2):
        data = pose(pushed.board, index)
        centre = camera_of(pushed.board, data).project(
            data.xipos[pushed.board.model.body("cart").id]
        )
        rows, columns = np.nonzero(masks[index])
        # From the centre of mass to the right, level.
        assert columns.min() + 0.5 == pytest.approx(centre[0], abs=2)
        assert rows.mean() + 0.5 == pytest.approx(centre[1], abs=2)
        # The largest force is 0.30 of the picture's height long, as marks.py says of it.
        height = pushed.board.layout.picture(0).height
        assert np.ptp(columns) + 1 == pytest.approx(0.3 * height, abs=4)


# Runs that end early


def ink_of_the_warning(shot: Shot, index: int, number: int) -> np.ndarray:
    """Which pixels of the lowest part of a picture are as red as the warning."""
    strip = shot.picture(index, number)[-shot.board.layout.label(number).height :]
    return np.all(np.abs(strip - (176, 0, 32)) < 20, axis=2)


def test_what_is_said_of_the_end_stands_on_white_within_its_picture(ended: Shot) -> None:
    assert ended.film.takes[0].ended == "law undefined at 0.09 s"
    rows, columns = np.nonzero(ink_of_the_warning(ended, 4, 0))
    height = ended.board.layout.label(0).height
    strip = ended.picture(4, 0)[-height:]
    written = strip[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    # No ink but red (176, 0, 32): what the scene shows there would be darker.
    assert written[..., 0].min() > 170
    assert not ink_of_the_warning(ended, 4, 1).any()
    assert not outside(ended, moving_parts(ended), 4).any()


def test_a_run_that_diverged_can_be_filmed(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    plant = gm.MujocoPlant.load("servo")
    law = gm.chapter_controller("lqr", plant.analytic())
    away = replace(law, parameters=replace(law.parameters, K=-10 * law.parameters.K))
    with pytest.raises(gm.errors.DivergenceError) as caught:
        gm.simulate(plant, away, [0.0, 0.0], duration=1.0)
    run = caught.value.trajectory
    takes = (
        Take("away", "#E69F00", run, ended="diverged"),
        Take("LQR", "#D55E00", gm.simulate(plant, law, [0.0, 0.0], duration=1.0)),
    )
    assert 0 < run.time[-1] < 0.75
    shot = shoot(Film("Two signs", plant.model, takes, Format(320, 240, fps=4)), backend)
    assert len(shot.frames) == 4
    for index, t in enumerate(shot.film.times):
        assert shot.picture(index).mean() > 60
        assert ink_of_the_warning(shot, index, 0).any() == (t >= run.time[-1])
    np.testing.assert_array_equal(shot.picture(3), shot.picture(2) if run.time[-1] <= 0.5 else 0)


# From the command line, and what lies beside a film


def test_film_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # However slow the machine is.
    monkeypatch.setattr(screen, "LINE_EVERY", float("inf"))
    path = tmp_path / "f.mp4"
    arguments = "film cart_pendulum/nominal --size 320x240 --fps 4 --from 0 --to 1 --gif"
    with pytest.raises(SystemExit) as stop:
        cli.main([*arguments.split(), "-o", str(path)])
    assert stop.value.code == cli.DONE
    said = capsys.readouterr()
    assert f"{path}" in said.out
    assert "4 frames, 1.0 s" in said.out
    assert said.err == ""
    assert {each.name for each in tmp_path.iterdir()} == {"f.mp4", "f.png", "f.gif", "f.json"}
    stream = probed(path)
    assert (stream["width"], stream["height"], stream["nb_read_frames"]) == (320, 240, "4")
    beside = json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))
    assert beside["schema_version"] == 1
    assert beside["versions"]["mujoco"] == mujoco.__version__
    assert beside["versions"]["grosmc_mj"] == gm.__version__
    assert beside["frames"] == 4
    assert beside["duration"] == {"value": 1.0, "unit": "s"}
    assert beside["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    configuration = beside["configuration"]
    assert configuration["timestep"] == 1e-3
    assert configuration["case"]["case"] == "nominal"
    assert configuration["controllers"] == ["LQR", "GROSMC"]
    film = {"width": 320, "height": 240, "fps": 4, "speed": 1.0, "start": 0.0, "stop": 1.0}
    assert configuration["film"] == {**film, "camera": "follow"}


TINY = Format(320, 240, fps=4, stop=0.5)


@pytest.fixture(scope="module")
def beside(backend: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film of two frames with its JSON."""
    path = tmp_path_factory.mktemp("beside") / "tiny.mp4"
    film = lone_film("servo", "nominal", TINY, ghost=True)
    write_case_film(
        find_case("servo", "nominal"), film, path, settings=Settings(), backend=backend, workers=1
    )
    return path


@pytest.fixture
def kept(beside: Path, tmp_path: Path) -> Path:
    """Copies of it, to be spoilt."""
    return Path(shutil.copytree(beside.parent, tmp_path / "kept")) / beside.name


def test_a_film_of_the_same_runs_is_current(kept: Path) -> None:
    assert is_current(lone_film("servo", "nominal", TINY, ghost=True), kept)
    again = run_case(find_case("servo", "nominal"), "physics", "lqr", Settings())
    assert is_current(film_of([again], TINY), kept)


@pytest.mark.parametrize("suffix", [".mp4", ".png", ".json"])
def test_a_film_with_a_file_missing_is_not_current(kept: Path, suffix: str) -> None:
    kept.with_suffix(suffix).unlink()
    assert not is_current(lone_film("servo", "nominal", TINY, ghost=True), kept)


@pytest.mark.parametrize("suffix", [".mp4", ".json"])
def test_a_film_cut_off_is_not_current(kept: Path, suffix: str) -> None:
    path = kept.with_suffix(suffix)
    path.write_bytes(path.read_bytes()[:-100])
    assert not is_current(lone_film("servo", "nominal", TINY, ghost=True), kept)


@pytest.mark.parametrize(
    "other",
    [
        lambda: lone_film("servo", "case2", TINY, ghost=True),
        lambda: lone_film("servo", "nominal", TINY, ghost=False),
        lambda: lone_film("servo", "nominal", replace(TINY, fps=5), ghost=True),
        lambda: lone_film("servo", "nominal", replace(TINY, speed=0.9), ghost=True),
        lambda: lone_film("servo", "nominal", replace(TINY, camera="follow"), ghost=True),
        lambda: lone_film("servo", "nominal", replace(TINY, height=242), ghost=True),
        lambda: film_of([result("servo", "nominal", "grosmc")], TINY),
    ],
)
def test_a_film_of_other_runs_or_in_another_format_is_not_current(kept: Path, other: Any) -> None:
    assert not is_current(other(), kept)
