"""What a film shows, as a value: recorded runs side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from grosmc_mj.arguments import real, reals, require, require_each
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, shown, unknown_name
from grosmc_mj.simulation.trajectory import Trajectory

SMALLEST, LARGEST = (320, 240), (3840, 2160)
FASTEST = 240
MOST_TAKES = 4
# As MuJoCo counts.
FREE_CAMERA = -1
# An hour of film at 30 frames per second is as long as one wants to wait for.
MOST_FRAMES = 100_000


@dataclass(frozen=True, eq=False)
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
    run: Trajectory
    ghost: Array | None = None
    sliding_unit: str = ""
    ended: str = ""

    def __post_init__(self) -> None:
        for what in ("label", "colour", "sliding_unit", "ended"):
            require(f"{what} of a take", getattr(self, what), str, "a text")
        require(f"{self.label}: run", self.run, Trajectory, "what simulate returns")
        if self.run.physics is None or self.run.physics.ndim != 2:
            raise ArgumentError(
                f"{self.label}: a film needs one recorded run in MuJoCo, with its full states"
            )
        wanted = (len(self.run.time), len(self.run.system.controlled))
        ghost = reals(self.ghost)
        fits = ghost.shape == wanted or (wanted[1] == 1 and ghost.shape == wanted[:1])
        if self.ghost is not None and not fits:
            raise ArgumentError(
                f"{self.label}: the ghost has shape {ghost.shape}, must be {wanted}: one "
                "row an instant, one column for each controlled coordinate"
            )

    @property
    def ghosts(self) -> Array:
        """The ghost's coordinates, (N + 1, controlled)."""
        rows = np.atleast_1d(reals(self.ghost))
        return rows.reshape(len(rows), -1)


@dataclass(frozen=True)
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

    width: int = 1280
    height: int = 720
    fps: int = 30
    speed: float = 1.0
    camera: str | None = None
    start: float = 0.0
    stop: float | None = None

    def __post_init__(self) -> None:
        for name, value, least, most in zip(
            ("width", "height"), (self.width, self.height), SMALLEST, LARGEST, strict=True
        ):
            if real(value) % 2 or not least <= real(value) <= most:
                raise ArgumentError(
                    f"{name} {shown(value)} of the film must be even and from {least} to {most} "
                    "pixels"
                )
        if not 1 <= real(self.fps) <= FASTEST:
            raise ArgumentError(f"{shown(self.fps)} frames per second: must be from 1 to {FASTEST}")
        if not 0 < real(self.speed) < math.inf:
            raise ArgumentError(f"speed {shown(self.speed)} must be finite and positive")
        stop = math.inf if self.stop is None else self.stop
        require("camera", self.camera, (str, type(None)), "the name of a camera or None")
        if not 0 <= real(self.start) < real(stop):
            raise ArgumentError(
                f"a film from {shown(self.start)} s to {shown(stop)} s shows nothing: it must "
                "begin at 0 s or later and end after that"
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


@dataclass(frozen=True, eq=False)
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
        require("title", self.title, str, "a text")
        require("model", self.model, mujoco.MjModel, "the compiled model, such as plant.model")
        require("format", self.format, Format, "a Format")
        require_each("takes", self.takes, Take, "one to four Takes in a tuple")
        if not 1 <= len(self.takes) <= MOST_TAKES:
            raise ArgumentError(f"a film shows one to four runs, not {len(self.takes)}")
        for take in self.takes:
            self._check(take)
        self.format.check(self.cameras, self.end)

    def _check(self, take: Take) -> None:
        """Refuse a run of another model, or one without its instants.

        Raises:
            ArgumentError: Saying which.
        """
        size = mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        run = take.run
        joints = tuple(self.model.joint(i).name for i in range(self.model.njnt))
        # Those of a machine's parts come after the system's own.
        joints = joints[: len(run.system.joints)]
        assert run.physics is not None
        if run.physics.shape[1] != size or joints != run.system.joints:
            raise ArgumentError(
                f"{take.label}: a run of {run.system.name} with states of {run.physics.shape[1]} "
                f"numbers is not of this model, which has the joints {', '.join(joints)} and "
                f"states of {size}"
            )
        longest = 1.5 * self.model.opt.timestep
        if len(run.time) == 2 and run.time[1] - run.time[0] > longest:
            raise ArgumentError(
                f"{take.label}: the run was not recorded: give simulate(..., record=True)"
            )

    @cached_property
    def longest(self) -> Take:
        """The take that ends last."""
        return max(self.takes, key=lambda take: float(take.run.time[-1]))

    @cached_property
    def cameras(self) -> tuple[str, ...]:
        """The cameras of the model."""
        return camera_names(self.model)

    @cached_property
    def camera(self) -> int:
        """Id of the camera: the chosen one or, if it moves along, ``follow``, else ``fixed``.

        Without these, the first that stands still, since one on a hand would not show the hand;
        -1, MuJoCo's free camera, if there is none.
        """
        if self.format.camera is not None:
            return self.model.camera(self.format.camera).id
        if "follow" in self.cameras:
            follow = self.model.camera("follow")
            if follow.mode[0] == mujoco.mjtCamLight.mjCAMLIGHT_TRACK:
                return follow.id
        if "fixed" in self.cameras:
            return self.model.camera("fixed").id
        still = self.model.body_weldid[self.model.cam_bodyid] == 0
        return int(np.argmax(still)) if np.any(still) else FREE_CAMERA

    @cached_property
    def camera_name(self) -> str:
        """Name of the camera; ``free`` for MuJoCo's own."""
        return "free" if self.camera == FREE_CAMERA else self.cameras[self.camera]

    @cached_property
    def end(self) -> float:
        """When the longest run ends [s]."""
        return float(self.longest.run.time[-1])

    @cached_property
    def times(self) -> Array:
        """The instant that each frame shows [s]: start + k speed / fps, as long as the data."""
        count = max(1, round(self.format.frames(self.end)))
        return self.format.start + np.arange(count) * (self.format.speed / self.format.fps)

    def rows(self, take: Take) -> np.ndarray:
        """The recorded instant nearest to each frame: its row, (frames,).

        A run that ended early stays at its last row.
        """
        time = take.run.time
        step = float(time[1] - time[0]) if len(time) > 1 else 1.0
        return np.clip(np.rint(self.times / step).astype(int), 0, len(time) - 1)


def camera_names(model: mujoco.MjModel) -> tuple[str, ...]:
    """The cameras of a model."""
    return tuple(model.camera(i).name for i in range(model.ncam))
