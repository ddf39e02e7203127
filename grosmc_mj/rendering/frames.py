"""From a film's value to its frames: a storyboard, and the maker that draws it in a worker."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from grosmc_mj.arrays import Array
from grosmc_mj.rendering.camera import Placement, place
from grosmc_mj.rendering.chart import Chart, draw_chart
from grosmc_mj.rendering.film import Film
from grosmc_mj.rendering.layout import Layout
from grosmc_mj.rendering.marks import add_ghost, add_wrenches

# Poses at which the camera's place is decided.
_LOOKS = 60
# Pictures are rendered at twice their size and halved: that smooths shadows too, and in software
# it is quicker than multisampling. A film's pictures are small: the detail is what they can show.
OVERSAMPLING = 2
_QUALITY = {"offsamples": 0, "shadowsize": 2048, "numslices": 48, "numstacks": 16, "numquads": 1}
_CURSOR = (120, 120, 120)
_WHITE, _INK, _WARNING = (255, 255, 255), (17, 17, 17), (176, 0, 32)


class Scene(NamedTuple):
    """What one picture shows at each frame.

    Attributes:
        physics: Full states, (frames, size).
        ghost: Controlled coordinate of the ghost, (frames,), or None.
        wrench: ``xfrc_applied`` of the bodies, (frames, bodies, 6), or None.
        over: Frame from which on the run has ended, for the reason ``ended``.
        ended: Empty if it ran to its end.
    """

    physics: Array
    ghost: Array | None
    wrench: Array | None
    over: int
    ended: str


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
        bodies: Ids of the bodies that wrenches act on.
        output: Index of the controlled coordinate in qpos.
        largest: Largest force [N] and torque [N m] of the film.
        telling: The frame for the poster: a run is furthest from its ghost.
    """

    model: mujoco.MjModel
    camera: int
    placement: Placement
    layout: Layout
    chart: Chart
    times: Array
    speed: float
    scenes: tuple[Scene, ...]
    bodies: tuple[int, ...]
    output: int
    largest: tuple[float, float]
    telling: int


@lru_cache(maxsize=1)
def storyboard(film: Film) -> Storyboard:
    """Prepare a film; nothing is rendered yet. The last one is kept."""
    form = film.format
    layout = Layout(form.width, form.height, len(film.takes))
    system = film.takes[0].run.system
    scenes = tuple(_scene(film, index) for index in range(len(film.takes)))
    model = film_model(film.model, layout.picture(0).width, layout.picture(0).height)
    box = layout.picture(0)
    wrenches = [scene.wrench for scene in scenes if scene.wrench is not None]
    force, torque = (
        max((float(np.linalg.norm(w[..., part], axis=-1).max()) for w in wrenches), default=0.0)
        for part in (slice(0, 3), slice(3, 6))
    )
    joint = model.joint(system.joints[system.output])
    return Storyboard(
        model=model,
        camera=film.camera,
        placement=place(model, film.camera, _poses(model, scenes), box.width / box.height),
        layout=layout,
        chart=draw_chart(film, layout),
        times=film.times,
        speed=form.speed,
        scenes=scenes,
        bodies=tuple(model.body(name).id for name in system.bodies),
        output=int(joint.qposadr[0]),
        largest=(force, torque),
        telling=_telling(film),
    )


def film_model(model: mujoco.MjModel, width: int, height: int) -> mujoco.MjModel:
    """A copy of a model with the detail and the off-screen buffer that its pictures need."""
    own = copy.copy(model)
    for name, value in _QUALITY.items():
        setattr(own.vis.quality, name, value)
    # MuJoCo's cameras are pairs of eyes; a picture of one would show the mean of two.
    own.cam_ipd[:] = 0
    own.vis.global_.offwidth = OVERSAMPLING * width
    own.vis.global_.offheight = OVERSAMPLING * height
    return own


def _scene(film: Film, index: int) -> Scene:
    """The recorded rows of one run that the frames show."""
    take = film.takes[index]
    run, rows = take.run, film.rows(take)
    assert run.physics is not None
    last = float(run.time[-1])
    wrench = None
    if run.wrench is not None:
        held = run.wrench.reshape(len(run.wrench), len(run.system.bodies), 6)
        # A run that ended at its start has no interval in which anything acted.
        held = held if len(held) else np.zeros((1, *held.shape[1:]))
        wrench = held[np.minimum(rows, len(held) - 1)]
    over = len(film.times)
    if take.ended:
        over = min(int(np.searchsorted(film.times, last)), len(film.times) - 1)
    ghost = None if take.ghost is None else np.asarray(take.ghost)[rows]
    return Scene(run.physics[rows], ghost, wrench, over, take.ended)


def _telling(film: Film) -> int:
    """The frame in which a run is furthest from its ghost; without ghosts, the middle one.

    The first sixth does not count: a poster shall show some of the curves.
    """
    furthest = np.zeros(len(film.times))
    for take in film.takes:
        if take.ghost is not None:
            distance = np.abs(take.run.state[:, take.run.system.output] - take.ghost)
            furthest = np.maximum(furthest, distance[film.rows(take)])
    early = len(film.times) // 6
    return early + int(furthest[early:].argmax()) if furthest.any() else len(film.times) // 2


def _poses(model: mujoco.MjModel, scenes: tuple[Scene, ...]) -> Iterator[mujoco.MjData]:
    """Some poses of each run, spread over the film."""
    data = mujoco.MjData(model)
    for scene in scenes:
        count = min(_LOOKS, len(scene.physics))
        for frame in np.linspace(0, len(scene.physics) - 1, count).astype(int):
            _pose(model, data, scene.physics[frame])
            yield data


def _pose(model: mujoco.MjModel, data: mujoco.MjData, physics: Array) -> None:
    """Put a stored state into the data and compute what drawing needs."""
    mujoco.mj_setState(model, data, physics, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_fwdPosition(model, data)


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
        fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
        size = board.layout.font
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
        _pose(board.model, data, scene.physics[index])
        data.xfrc_applied[:] = 0
        if scene.wrench is not None and index < scene.over:
            data.xfrc_applied[list(board.bodies)] = scene.wrench[index]
        # Twice, since MuJoCo centres the floor below the camera of the scene before.
        for _ in range(2):
            renderer.update_scene(data, board.camera)
        board.placement.apply(renderer.scene)
        if scene.ghost is not None:
            self._ghost.qpos[:] = data.qpos
            self._ghost.qpos[board.output] = scene.ghost[index]
            mujoco.mj_kinematics(board.model, self._ghost)
            add_ghost(renderer.scene, board.model, self._ghost, self._ghost_option)
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
