"""A film as a value: recorded runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from typing import Annotated

import mujoco
import numpy as np
import pydantic

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Range, Reals, Seconds, checked
from grosmc_mj.output.films.scene import FREE_CAMERA, camera_names, default_camera
from grosmc_mj.simulation.loop.timing import steps_to
from grosmc_mj.simulation.trajectory import Trajectory

MOST_TAKES = 4


@checked()
class Take:
    """One recorded run: one colour of the curves and, in MuJoCo, one picture of the film.

    Attributes:
        label: Name of the controller.
        colour: #RRGGBB.
        run: Recorded run; in MuJoCo with its full physics states.
        ghost: Desired controlled coordinates at each instant of the run, in their own units,
            (N + 1, controlled); None to draw no ghost.
        sliding_unit: Unit of s.
        ended: Reason why the run ended early; empty if it did not.
    """

    label: str
    colour: str
    run: pydantic.InstanceOf[Trajectory]
    ghost: Annotated[Array, Reals((None, None))] | None = None
    sliding_unit: str = ""
    ended: str = ""

    def __post_init__(self) -> None:
        if self.run.state.ndim != 2:
            raise ArgumentError(f"{self.label}: a film needs one recorded run")
        shape = (len(self.run.time), len(self.run.system.controlled))
        if self.ghost is not None and self.ghost.shape != shape:
            raise ArgumentError(
                f"{self.label}: the ghost has shape {self.ghost.shape}, must be {shape}: one "
                "row an instant, one column for each controlled coordinate"
            )


@checked()
class Format:
    """Size, speed, camera and times of a film.

    Attributes:
        width: Width of a frame, in pixels; even.
        height: Height of a frame, in pixels; even.
        fps: Frames per second of the film.
        speed: Seconds of data in one second of film.
        camera: Name of a camera of the model; None for ``follow`` where it moves along with a body,
            else ``fixed``, else any that stands still, else one from above that the film places.
        start: First instant of the film [s].
        stop: Last instant of the film [s]; None for the end of the longest run.
    """

    width: Annotated[int, Range(320, 3840, unit="pixels", whole=True)] = 1280
    height: Annotated[int, Range(240, 2160, unit="pixels", whole=True)] = 720
    fps: Annotated[int, Range(1, 240, whole=True)] = 30
    speed: Annotated[float, Range(1 / 64, 64)] = 1.0
    camera: str | None = None
    start: Seconds = 0.0
    stop: Seconds | None = None

    def __post_init__(self) -> None:
        if self.width % 2 or self.height % 2:
            raise ArgumentError(f"a film of {self.width} x {self.height} pixels: both must be even")

    def check(self, cameras: Sequence[str], end: float) -> None:
        """Refuse a camera that a model lacks, and times that a run lacks.

        Args:
            cameras: Names of the model's cameras.
            end: End of the runs [s].

        Raises:
            ArgumentError: If the camera is unknown, or nothing would be shown.
        """
        if self.camera is not None:
            require_known("camera", self.camera, cameras)
        stop = end if self.stop is None else self.stop
        if not self.start < stop <= end + 1e-9:
            raise ArgumentError(
                f"a film from {self.start:g} s to {stop:g} s shows nothing: the runs begin at 0 s "
                f"and end at {end:g} s"
            )


@checked()
class Film:
    """Runs of one plant side by side, at the same times and the same scale.

    Attributes:
        title: Text of the title bar.
        model: Compiled model of the runs, with its edits; None for equations, whose film shows
            curves alone.
        takes: One to four runs.
        format: Size, speed, camera and times.
        ghost_label: Name of the ghost.
        ghost_symbol: Symbol of the ghost.
        one_ghost: Whether all runs have the same ghost, such as a reference.
        beside: Index of a state that is shown in place of s; None to show s.
    """

    title: str
    model: mujoco.MjModel | None
    takes: tuple[Take, ...]
    format: Format = field(default_factory=Format)
    ghost_label: str = "reference"
    ghost_symbol: str = "yᵣ"
    one_ghost: bool = True
    beside: int | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.takes) <= MOST_TAKES:
            raise ArgumentError(f"a film shows one to four runs, not {len(self.takes)}")
        if self.model is not None:
            self._require_runs_of(self.model)
        self.format.check(self._cameras, self.end)

    def _require_runs_of(self, model: mujoco.MjModel) -> None:
        """Refuse runs that are not of the model, or not recorded."""
        size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        names = tuple(model.joint(i).name for i in range(model.njnt))
        for take in self.takes:
            run = take.run
            if run.physics is None or run.physics.ndim != 2:
                raise ArgumentError(
                    f"{take.label}: a film needs one recorded run in MuJoCo, with its full states"
                )
            joints = run.system.joints
            # Joints of a machine's parts come after the system's own.
            if np.asarray(run.physics).shape[1] != size or names[: len(joints)] != joints:
                raise ArgumentError(
                    f"{take.label}: a run of {run.system.name} is not of this model, which has "
                    f"the joints {', '.join(names)} and states of {size} numbers"
                )
            if len(run.time) == 2 and run.time[1] > 1.5 * model.opt.timestep:
                raise ArgumentError(
                    f"{take.label}: the run was not recorded: give simulate(..., record=True)"
                )

    @property
    def _cameras(self) -> tuple[str, ...]:
        """Names of the model's cameras."""
        return () if self.model is None else camera_names(self.model)

    @property
    def end(self) -> float:
        """End of the longest run [s]."""
        return max(float(take.run.time[-1]) for take in self.takes)

    @property
    def stop(self) -> float:
        """Last instant of the film [s]."""
        if self.format.stop is None:
            return self.end
        return self.format.stop

    @property
    def camera(self) -> int:
        """Id of the camera: the chosen one, else the model's default, see ``default_camera``."""
        if self.model is None:
            return FREE_CAMERA
        if self.format.camera is None:
            return default_camera(self.model)
        return self.model.camera(self.format.camera).id

    @property
    def camera_name(self) -> str:
        """Name of the camera; ``free`` for MuJoCo's own."""
        return (*self._cameras, "free")[self.camera]

    @property
    def times(self) -> Array:
        """Instant of each frame [s]: start + k speed / fps, up to the last instant."""
        form = self.format
        count = round((self.stop - form.start) * form.fps / form.speed)
        return form.start + np.arange(max(1, count)) * form.speed / form.fps

    def rows(self, take: Take) -> np.ndarray:
        """Row of the recorded instant nearest to each frame, (frames,).

        A run that ended early stays at its last row.
        """
        nearest = steps_to(self.times, float(take.run.time[1]))
        return np.clip(nearest, 0, len(take.run.time) - 1)

    @property
    def poster_frame(self) -> int:
        """Index of the frame at which the runs differ most; a single run, from its ghost."""
        controlled = list(self.takes[0].run.system.controlled)
        paths = [take.run.state[self.rows(take)][:, controlled] for take in self.takes]
        first = self.takes[0]
        if len(paths) == 1 and first.ghost is not None:
            paths.append(first.ghost[self.rows(first)])

        spread = np.ptp(paths, axis=0) / (np.ptp(paths, axis=(0, 1)) + np.finfo(float).tiny)
        return int(np.nan_to_num(spread).max(axis=1).argmax())
