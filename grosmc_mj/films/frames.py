"""Drawing the frames of a film, in a worker."""

from __future__ import annotations

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from grosmc_mj.films.board import OVERSAMPLING, Scene, Storyboard, pose
from grosmc_mj.films.marks import add_ghost, add_trace, add_wrenches

_CURSOR = (120, 120, 120)
_WHITE, _INK, _WARNING = (255, 255, 255), (17, 17, 17), (176, 0, 32)


class FrameMaker:
    """Draws frames of one film; lives in one process and one thread, and must be closed."""

    def __init__(self, board: Storyboard) -> None:
        """Open the renderer.

        Args:
            board: The film.
        """
        self._board = board
        buffer = board.model.vis.global_
        self._renderer = mujoco.Renderer(board.model, buffer.offheight, buffer.offwidth)
        self._data, self._ghost = mujoco.MjData(board.model), mujoco.MjData(board.model)
        self._ghost_option = mujoco.MjvOption()
        fonts, size = board.fonts, board.layout.font
        self._bold = ImageFont.truetype(str(fonts / "DejaVuSans-Bold.ttf"), round(1.25 * size))
        self._plain = ImageFont.truetype(str(fonts / "DejaVuSans.ttf"), round(0.9 * size))

    def close(self) -> None:
        """Free the renderer; without it the interpreter's end would print a traceback."""
        self._renderer.close()

    def frame(self, index: int) -> np.ndarray:
        """One frame, (height, width, 3)."""
        board = self._board
        frame = board.chart.empty.copy()
        t = float(board.times[index])
        for area in board.chart.areas:
            column = board.chart.column(area, t) + 1
            part = (slice(area.top, area.bottom), slice(area.left, column))
            frame[part] = board.chart.drawn[part]
            frame[area.top : area.bottom, column - 1] = _CURSOR
        for number, scene in enumerate(board.scenes):
            box = board.layout.picture(number)
            frame[box.top : box.bottom, box.left : box.right] = self.picture(scene, index)
        return self._write(frame, index)

    def picture(self, scene: Scene, index: int) -> np.ndarray:
        """One run at one frame, with its ghost and its wrenches."""
        board, renderer, data = self._board, self._renderer, self._data
        pose(board.model, data, scene.physics[index])
        data.xfrc_applied[:] = 0
        if scene.wrench is not None and index < scene.over:
            data.xfrc_applied[list(board.bodies)] = scene.wrench[index]
        # Twice, since MuJoCo centres the floor below the camera of the scene before.
        for _ in range(2):
            renderer.update_scene(data, board.camera)
        board.placement.apply(renderer.scene)
        if scene.ghost is not None:
            self._ghost.qpos[:] = data.qpos
            self._ghost.qpos[list(board.controlled)] = scene.ghost[index]
            mujoco.mj_kinematics(board.model, self._ghost)
            add_ghost(renderer.scene, board.model, self._ghost, self._ghost_option)
        if scene.trace is not None:
            add_trace(renderer.scene, scene.trace, index)
        add_wrenches(renderer.scene, board.model, data, board.largest)
        return np.asarray(Image.fromarray(renderer.render()).reduce(OVERSAMPLING))

    def _write(self, frame: np.ndarray, index: int) -> np.ndarray:
        """Write the clock and, above a picture whose run is over, why."""
        board, layout = self._board, self._board.layout
        image = Image.fromarray(frame)
        draw = ImageDraw.Draw(image)
        pad = 0.8 * layout.font
        speed = f"  ×{board.speed:.3g}" if board.speed != 1 else ""
        clock = layout.clock
        draw.text(
            (clock.right - pad, clock.top + clock.height / 2),
            f"t = {board.times[index]:.2f} s{speed}",
            _INK,
            self._bold,
            anchor="rm",
        )
        for number, scene in enumerate(board.scenes):
            if index >= scene.over:
                box = layout.label(number)
                where = (box.right - pad, box.top + box.height / 2)
                left = draw.textbbox(where, scene.ended, self._plain, anchor="rm")[0]
                # What stands there already makes room.
                draw.rectangle((left - pad, box.top, box.right - 1, box.bottom - 1), _WHITE)
                draw.text(where, scene.ended, _WARNING, self._plain, anchor="rm")
        return np.asarray(image)
