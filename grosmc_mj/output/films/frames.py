"""Drawing the frames of a film, in a worker.

A worker starts in a fraction of the time because nothing here needs the simulation, matplotlib or
numba.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.films.scene import Surroundings, add_ghost, add_wrenches, move, pose

# Pictures are rendered at twice their size and halved: that smooths shadows too, and in software
# it is quicker than multisampling.
OVERSAMPLING = 2
_CURSOR = (120, 120, 120)
_INK = (17, 17, 17)
# Where the title bar's middle is, as a part of what is above the pictures.
CLOCK = 0.3


# Rows and columns of a rectangle of pixels, to index a frame with.
Box = tuple[slice, slice]


class FilmPlots(NamedTuple):
    """Two pictures of a whole frame: curves grow by taking more and more columns of the second.

    Attributes:
        empty: Everything but the curves, (height, width, 3).
        drawn: The same with all curves, (height, width, 3).
        areas: The area within each plot's axes.
        pictures: Where the runs are shown, from left to right; all have one size.
        times: First and last instant on the time axes [s].
        font: Size of ordinary text, in pixels.
    """

    empty: np.ndarray
    drawn: np.ndarray
    areas: tuple[Box, ...]
    pictures: tuple[Box, ...]
    times: tuple[float, float]
    font: float

    def at(self, t: float) -> np.ndarray:
        """A frame with the curves up to an instant [s], and a cursor there."""
        frame = self.empty.copy()
        for rows, columns in self.areas:
            cursor = round(np.interp(t, self.times, (columns.start, columns.stop - 1)))
            grown = rows, slice(columns.start, cursor)
            frame[grown] = self.drawn[grown]
            frame[rows, cursor] = _CURSOR
        return frame


class Scene(NamedTuple):
    """Content of one picture at each frame.

    Attributes:
        physics: Full states, (frames, size).
        ghost: Positions of the ghost, (frames, nq), or None.
        wrench: ``xfrc_applied``, (frames, bodies, 6), or None.
        colour: Colour of the law, (3,), for what the model gives none.
    """

    physics: Array
    ghost: Array | None
    wrench: Array | None
    colour: Array


class Stage(NamedTuple):
    """Model, camera and poses of the pictures.

    Attributes:
        model: The film's own copy of the model.
        camera: Id of the camera.
        placement: Move of the camera, see ``scene.place``, (3,).
        surroundings: Light, floor, background and colours that the model lacks.
        scenes: One for each picture.
        largest: Largest force [N] and torque [N m] of the film, (2,).
    """

    model: mujoco.MjModel
    camera: int
    placement: Array
    surroundings: Surroundings
    scenes: tuple[Scene, ...]
    largest: Array


@dataclass(frozen=True, eq=False)
class Storyboard:
    """Data for a worker to draw any frame of a film; small, whatever the film's length.

    Attributes:
        stage: Content of the pictures; None for a film of equations, which has none.
        chart: The still parts of the frames.
        times: Instant of each frame [s].
        speed: Seconds of data in a second of film.
        fonts: Folder of the fonts.
    """

    stage: Stage | None
    chart: FilmPlots
    times: Array
    speed: float
    fonts: Path


class FrameMaker:
    """Draws frames of one film; lives in one process and one thread."""

    def __init__(self, board: Storyboard) -> None:
        """Open the renderer."""
        self._board = board
        self._painter = None if board.stage is None else _Painter(board.stage)
        size = round(1.25 * board.chart.font)
        self._font = ImageFont.truetype(board.fonts / "DejaVuSans-Bold.ttf", size)

    def close(self) -> None:
        """Free what the renderer holds."""
        if self._painter is not None:
            self._painter.renderer.close()

    def frame(self, index: int) -> np.ndarray:
        """Draw one frame, (height, width, 3)."""
        board = self._board
        chart = board.chart
        time = float(board.times[index])
        frame = chart.at(time)
        if board.stage is not None and self._painter is not None:
            for scene, box in zip(board.stage.scenes, chart.pictures, strict=True):
                frame[box] = self._painter.picture(scene, index)

        clock = f"t = {time:.2f} s"
        if board.speed != 1:
            clock += f"  ×{board.speed:.3g}"
        place = (frame.shape[1] - 0.8 * chart.font, chart.pictures[0][0].start * CLOCK)
        image = Image.fromarray(frame)
        ImageDraw.Draw(image).text(place, clock, _INK, self._font, anchor="rm")
        return np.asarray(image)


class _Painter:
    """Renders the pictures of a stage."""

    def __init__(self, stage: Stage) -> None:
        buffer = stage.model.vis.global_
        self.renderer = mujoco.Renderer(stage.model, buffer.offheight, buffer.offwidth)
        self._stage = stage
        self._data = mujoco.MjData(stage.model)
        self._ghost = mujoco.MjData(stage.model)

    def picture(self, scene: Scene, index: int) -> np.ndarray:
        """Draw one run at one frame, with its ghost and its wrenches."""
        stage = self._stage
        data = self._data
        pose(stage.model, data, scene.physics[index])
        data.xfrc_applied[:] = 0.0
        if scene.wrench is not None:
            data.xfrc_applied[:] = scene.wrench[index]

        # Twice, since MuJoCo centres the floor below the camera of the scene before.
        for _ in range(2):
            self.renderer.update_scene(data, stage.camera)
        drawn = self.renderer.scene
        move(drawn, stage.placement)
        stage.surroundings.paint(drawn, scene.colour)
        if scene.ghost is not None:
            self._ghost.qpos[:] = scene.ghost[index]
            mujoco.mj_kinematics(stage.model, self._ghost)
            add_ghost(drawn, stage.model, self._ghost)

        add_wrenches(drawn, stage.model, data, stage.largest)
        stage.surroundings.add(drawn)
        return np.asarray(Image.fromarray(self.renderer.render()).reduce(OVERSAMPLING))


# Of a worker: the film that it is drawing.
_path = ""
_maker: FrameMaker | None = None


def draw(path: str, index: int) -> np.ndarray:
    """Draw one frame, (height, width, 3), of the film whose storyboard a file holds."""
    global _path, _maker
    if _maker is None or _path != path:
        # Before the next renderer: deleting the older of two would delete the newer one's buffers.
        if _maker is not None:
            _maker.close()
        _maker = FrameMaker(pickle.loads(Path(path).read_bytes()))
        _path = path
    return _maker.frame(index)
