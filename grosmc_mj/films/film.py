"""What a film shows, as a value: recorded runs side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field
from functools import cached_property
from typing import Annotated, Any

import mujoco
import numpy as np
import pydantic

from grosmc_mj.arguments import reals
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.fields import Positive, Range, Seconds, checked
from grosmc_mj.films.camera import FREE_CAMERA, camera_names, default_camera
from grosmc_mj.simulation.trajectory import Trajectory

MOST_TAKES = 4
# An hour of film at 30 frames per second is as long as one wants to wait for.
MOST_FRAMES = 100_000


def _rows(values: Any) -> Array | None:
    """Coordinates with a row an instant, a single one as a column."""
    rows = None if values is None else reals(values)
    return rows[:, None] if rows is not None and rows.ndim == 1 else rows


@checked()
class Take:
    """One recorded run in MuJoCo: one picture of the film and one colour of its curves.

    Attributes:
        label: Name of the controller.
        colour: #RRGGBB.
        run: With its full physics states.
        ghost: Where the controlled coordinates should have been at each instant of the run, in
            their own units, (N + 1, controlled) or, for a single one, (N + 1,); None to draw no
            ghost.
        sliding_unit: Unit of s.
        ended: Why the run ended early; empty if it did not.
    """

    label: str
    colour: str
    run: pydantic.InstanceOf[Trajectory]
    ghost: Annotated[Array | None, pydantic.PlainValidator(_rows)] = None
    sliding_unit: str = ""
    ended: str = ""

    def __post_init__(self) -> None:
        if self.run.physics is None or self.run.physics.ndim != 2:
            raise ArgumentError(
                f"{self.label}: a film needs one recorded run in MuJoCo, with its full states"
            )
        shape = (len(self.run.time), len(self.run.system.controlled))
        if self.ghost is not None and self.ghost.shape != shape:
            raise ArgumentError(
                f"{self.label}: the ghost has shape {self.ghost.shape}, must be {shape}: one "
                "row an instant, one column for each controlled coordinate"
            )

    @property
    def ghosts(self) -> Array:
        """The ghost's coordinates, (N + 1, controlled), of a take that has one."""
        assert self.ghost is not None
        return self.ghost


@checked()
class Format:
    """How a film is cut.

    Attributes:
        width: Of a frame, in pixels; even.
        height: Of a frame, in pixels; even.
        fps: Frames per second of the film.
        speed: Seconds of data in one second of film.
        camera: A camera of the model; None for ``follow`` where it moves along with a body, else
            ``fixed``, else any that stands still, else one from above that the film places.
        start: First instant shown [s].
        stop: End of what is shown [s]; None for the end of the longest run.
    """

    width: Annotated[int, Range(320, 3840, unit="pixels", whole=True)] = 1280
    height: Annotated[int, Range(240, 2160, unit="pixels", whole=True)] = 720
    fps: Annotated[int, Range(1, 240, whole=True)] = 30
    speed: Positive = 1.0
    camera: str | None = None
    start: Seconds = 0.0
    stop: Seconds | None = None

    def __post_init__(self) -> None:
        if self.width % 2 or self.height % 2:
            raise ArgumentError(f"a film of {self.width} x {self.height} pixels: both must be even")
        if self.stop is not None and self.stop <= self.start:
            raise ArgumentError(
                f"a film from {self.start:g} s to {self.stop:g} s shows nothing: it must end after "
                "it begins"
            )

    def frames(self, end: float) -> float:
        """How many frames show a run that ends then [s]."""
        stop = end if self.stop is None else self.stop
        return (stop - self.start) * self.fps / self.speed

    def check(self, cameras: Sequence[str], end: float) -> None:
        """Refuse what a model or a run does not have.

        Args:
            cameras: Those of the model.
            end: When the runs end [s].

        Raises:
            ArgumentError: If the camera is unknown, nothing would be shown, or too much.
        """
        if self.camera not in (None, *cameras):
            raise ArgumentError(unknown_name("camera", self.camera, cameras))
        if self.start >= end:
            raise ArgumentError(
                f"a film from {self.start:g} s shows nothing: the runs end at {end:g} s"
            )
        if self.stop is not None and self.stop > end + 1e-9:
            raise ArgumentError(f"a film to {self.stop:g} s: the runs end at {end:g} s")
        if self.frames(end) > MOST_FRAMES:
            raise ArgumentError(
                f"a film of {self.frames(end):.0f} frames: at most {MOST_FRAMES} are made; take a "
                "higher speed or fewer frames per second"
            )


@checked()
class Film:
    """Runs of one model side by side, at the same times and the same scale.

    Attributes:
        title: In the title bar.
        model: The compiled model that was run, with its edits.
        takes: One to four runs.
        format: How it is cut.
        ghost_label: What the ghost is, in words.
        ghost_symbol: And its symbol.
        beside: Index of a state that is shown in place of s; None to show s.
        trace: Id of a site whose path is drawn, and dotted where it should be; -1 for none.
    """

    title: str
    model: mujoco.MjModel
    takes: tuple[Take, ...]
    format: Format = field(default_factory=Format)
    ghost_label: str = "reference"
    ghost_symbol: str = "yᵣ"
    beside: int | None = None
    trace: int = -1

    def __post_init__(self) -> None:
        if not 1 <= len(self.takes) <= MOST_TAKES:
            raise ArgumentError(f"a film shows one to four runs, not {len(self.takes)}")
        size = mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        all_joints = tuple(self.model.joint(i).name for i in range(self.model.njnt))
        for take in self.takes:
            run, states = take.run, np.asarray(take.run.physics).shape[1]
            # Joints of a machine's parts come after the system's own.
            joints = all_joints[: len(run.system.joints)]
            if states != size or joints != run.system.joints:
                raise ArgumentError(
                    f"{take.label}: a run of {run.system.name} with states of {states} numbers is "
                    f"not of this model, which has the joints {', '.join(joints)} and states of "
                    f"{size}"
                )
            if len(run.time) == 2 and run.time[1] > 1.5 * self.model.opt.timestep:
                raise ArgumentError(
                    f"{take.label}: the run was not recorded: give simulate(..., record=True)"
                )
        self.format.check(camera_names(self.model), self.end)

    @cached_property
    def longest(self) -> Take:
        """The take that ends last."""
        return max(self.takes, key=lambda take: float(take.run.time[-1]))

    @property
    def end(self) -> float:
        """When the longest run ends [s]."""
        return float(self.longest.run.time[-1])

    @property
    def stop(self) -> float:
        """When the film ends [s]."""
        return self.end if self.format.stop is None else self.format.stop

    @property
    def camera(self) -> int:
        """Id of the camera: the chosen one, else the model's default, see ``default_camera``."""
        chosen = self.format.camera
        return default_camera(self.model) if chosen is None else self.model.camera(chosen).id

    @property
    def camera_name(self) -> str:
        """Name of the camera; ``free`` for MuJoCo's own."""
        return "free" if self.camera == FREE_CAMERA else self.model.camera(self.camera).name

    @property
    def times(self) -> Array:
        """The instant that each frame shows [s]: start + k speed / fps, as long as the data."""
        count = max(1, round(self.format.frames(self.end)))
        return self.format.start + np.arange(count) * (self.format.speed / self.format.fps)

    def rows(self, take: Take) -> np.ndarray:
        """The recorded instant nearest to each frame: its row, (frames,).

        A run that ended early stays at its last row.
        """
        time = take.run.time
        step = float(time[1] - time[0]) if len(time) > 1 else math.inf
        return np.clip(np.rint(self.times / step).astype(int), 0, len(time) - 1)
