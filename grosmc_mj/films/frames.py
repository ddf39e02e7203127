"""Drawing the frames of a film, in a worker.

A worker starts in a fraction of the time because nothing here needs the simulation, matplotlib or
numba.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from grosmc_mj.arrays import Array
from grosmc_mj.films.camera import Placement
from grosmc_mj.films.layout import Box, Layout
from grosmc_mj.films.marks import Trace, add_ghost, add_trace, add_wrenches

# Pictures are rendered at twice their size and halved: that smooths shadows too, and in software
# it is quicker than multisampling.
OVERSAMPLING = 2
_CURSOR = (120, 120, 120)
_WHITE, _INK, _WARNING = (255, 255, 255), (17, 17, 17), (176, 0, 32)


class Chart(NamedTuple):
    """Two pictures of a whole frame: curves grow by taking more and more columns of the second.

    Attributes:
        empty: Everything but the curves, (height, width, 3).
        drawn: The same with all curves, (height, width, 3).
        areas: The area within each plot's axes.
        times: First and last instant on the time axes [s].
    """

    empty: np.ndarray
    drawn: np.ndarray
    areas: tuple[Box, ...]
    times: tuple[float, float]

    def column(self, area: Box, t: float) -> int:
        """The column of an instant in a plot's area."""
        return area.left + round(float(np.interp(t, self.times, (0, area.width - 1))))

    def at(self, t: float) -> np.ndarray:
        """A frame with the curves up to an instant [s], and a cursor there."""
        frame = self.empty.copy()
        for area in self.areas:
            rows, cursor = area.pixels[0], self.column(area, t)
            frame[rows, area.left : cursor] = self.drawn[rows, area.left : cursor]
            frame[rows, cursor] = _CURSOR
        return frame


class Scene(NamedTuple):
    """Content of one picture at each frame.

    Attributes:
        physics: Full states, (frames, size).
        ghost: Positions of the ghost, (frames, nq), or None.
        wrench: ``xfrc_applied``, (frames, bodies, 6), or None.
        over: Frame from which on the run has ended, for the reason ``ended``.
        ended: Empty if it ran to its end.
        trace: The path of the traced site, or None.
    """

    physics: Array
    ghost: Array | None
    wrench: Array | None
    over: int
    ended: str
    trace: Trace | None = None


@dataclass(frozen=True, eq=False)
class Storyboard:
    """All that a worker needs to draw any frame of a film; small, whatever the film's length.

    Attributes:
        model: The film's own copy of the model.
        camera: Id of the camera.
        placement: Where it stands.
        layout: Of the frame.
        chart: Its still parts.
        times: Instant of each frame [s].
        speed: Seconds of data in a second of film.
        scenes: One for each picture.
        largest: Largest force [N] and torque [N m] of the film, (2,).
        poster: The frame in which a run is furthest from its ghost.
        fonts: Folder of the fonts.
    """

    model: mujoco.MjModel
    camera: int
    placement: Placement
    layout: Layout
    chart: Chart
    times: Array
    speed: float
    scenes: tuple[Scene, ...]
    largest: Array
    poster: int
    fonts: Path


def pose(model: mujoco.MjModel, data: mujoco.MjData, physics: Array) -> None:
    """Put a stored state into the data and compute what drawing needs."""
    mujoco.mj_setState(model, data, physics, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_fwdPosition(model, data)


class FrameMaker:
    """Draws frames of one film; lives in one process and one thread, and must be closed."""

    def __init__(self, board: Storyboard) -> None:
        """Open the renderer."""
        self._board, model = board, board.model
        buffer = model.vis.global_
        self._renderer = mujoco.Renderer(model, buffer.offheight, buffer.offwidth)
        self._data, self._ghost = mujoco.MjData(model), mujoco.MjData(model)
        self._ghost_option = mujoco.MjvOption()
        self._bold, self._plain = (
            ImageFont.truetype(str(board.fonts / f"{name}.ttf"), round(size * board.layout.font))
            for name, size in (("DejaVuSans-Bold", 1.25), ("DejaVuSans", 0.9))
        )

    def close(self) -> None:
        """Free the renderer; without it the interpreter's end would print a traceback."""
        self._renderer.close()

    def frame(self, index: int) -> np.ndarray:
        """One frame, (height, width, 3)."""
        board = self._board
        frame = board.chart.at(float(board.times[index]))
        for number, scene in enumerate(board.scenes):
            frame[board.layout.picture(number).pixels] = self._picture(scene, index)
        return self._written(frame, index)

    def _picture(self, scene: Scene, index: int) -> np.ndarray:
        """One run at one frame, with its ghost and its wrenches."""
        board, renderer, data = self._board, self._renderer, self._data
        pose(board.model, data, scene.physics[index])
        data.xfrc_applied[:] = 0 if scene.wrench is None else scene.wrench[index]
        # Twice, since MuJoCo centres the floor below the camera of the scene before.
        for _ in range(2):
            renderer.update_scene(data, board.camera)
        board.placement.apply(renderer.scene)
        if scene.ghost is not None:
            self._ghost.qpos[:] = scene.ghost[index]
            mujoco.mj_kinematics(board.model, self._ghost)
            add_ghost(renderer.scene, board.model, self._ghost, self._ghost_option)
        if scene.trace is not None:
            add_trace(renderer.scene, scene.trace, index)
        add_wrenches(renderer.scene, board.model, data, board.largest)
        return np.asarray(Image.fromarray(renderer.render()).reduce(OVERSAMPLING))

    def _written(self, frame: np.ndarray, index: int) -> np.ndarray:
        """The frame with the clock and, in a picture whose run is over, why."""
        board, layout = self._board, self._board.layout
        image, pad = Image.fromarray(frame), 0.8 * layout.font
        draw = ImageDraw.Draw(image)
        speed = f"  ×{board.speed:.3g}" if board.speed != 1 else ""
        clock, text = layout.clock, f"t = {board.times[index]:.2f} s{speed}"
        place = (clock.right - pad, clock.top + clock.height / 2)
        draw.text(place, text, _INK, self._bold, anchor="rm")
        for number, scene in enumerate(board.scenes):
            if index >= scene.over:
                box = layout.picture(number)
                place = (box.left + pad, box.bottom - pad)
                left, top, right, bottom = draw.textbbox(place, scene.ended, self._plain, "ld")
                paper = (left - pad / 2, top - pad / 2, right + pad / 2, bottom + pad / 2)
                draw.rectangle(paper, _WHITE)
                draw.text(place, scene.ended, _WARNING, self._plain, anchor="ld")
        return np.asarray(image)
