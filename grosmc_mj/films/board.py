"""All that the frames of a film are drawn from: what a worker is given, and what it imports.

A worker starts in a fraction of the time because nothing here needs the simulation, matplotlib or
numba.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.films.camera import Placement
from grosmc_mj.films.layout import Box, Layout

# Pictures are rendered at twice their size and halved: that smooths shadows too, and in software
# it is quicker than multisampling.
OVERSAMPLING = 2


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
        first, last = self.times
        part = min(max((t - first) / (last - first), 0.0), 1.0)
        return area.left + round(part * (area.width - 1))


class Trace(NamedTuple):
    """The path of a site.

    Attributes:
        been: Where it is at each frame, (frames, 3).
        wanted: Where the ghost has it at each frame, (frames, 3), or None.
        colour: Of the path that it has been, #RRGGBB.
    """

    been: Array
    wanted: Array | None
    colour: str


class Scene(NamedTuple):
    """What one picture shows at each frame.

    Attributes:
        physics: Full states, (frames, size).
        ghost: Controlled coordinates of the ghost, (frames, controlled), or None.
        wrench: ``xfrc_applied`` of the bodies, (frames, bodies, 6), or None.
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
        bodies: Ids of the bodies that wrenches act on.
        controlled: Indices of the controlled coordinates in qpos.
        largest: Largest force [N] and torque [N m] of the film.
        telling: The frame for the poster: a run is furthest from its ghost.
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
    bodies: tuple[int, ...]
    controlled: tuple[int, ...]
    largest: tuple[float, float]
    telling: int
    fonts: Path


def pose(model: mujoco.MjModel, data: mujoco.MjData, physics: Array) -> None:
    """Put a stored state into the data and compute what drawing needs."""
    mujoco.mj_setState(model, data, physics, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    mujoco.mj_fwdPosition(model, data)
