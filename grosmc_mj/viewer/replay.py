"""A recorded run as something that a window can show."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.simulation.trajectory import Trajectory

# What a key to the side jumps by [s].
JUMP = 1.0
# Times that have been added up are not exact [s].
_INSTANT = 1e-9


class RecordedRun:
    """A recorded run, shown as it was.

    Attributes:
        model: The model that it was made with.
        time: Where the replay is [s].
    """

    def __init__(self, model: mujoco.MjModel, run: Trajectory, ended: str = "") -> None:
        """Begin at the start.

        Args:
            model: The model that the run was made with.
            run: One run with its physics.
            ended: Why the run ended early, if it did.

        Raises:
            ArgumentError: If nothing was recorded that could be shown.
        """
        if run.physics is None or run.physics.ndim != 2:
            raise ArgumentError("only a single run on a plant in MuJoCo can be replayed")
        self.model, self.time = model, 0.0
        self._run, self._states, self._ended = run, run.physics, ended

    @property
    def state(self) -> Array:
        """What was recorded at the last instant that has been reached."""
        reached = np.searchsorted(self._run.time, self.time + _INSTANT, side="right")
        return self._states[int(reached) - 1]

    @property
    def words(self) -> Mapping[str, str]:
        """The time."""
        return {"recorded": f"{self.time:.2f} of {self._end:g} s"}

    @property
    def note(self) -> str:
        """Why the run ended, once its end is reached."""
        return (self._ended or "the end of the run") if self.time == self._end else ""

    @property
    def _end(self) -> float:
        return float(self._run.time[-1])

    def advance(self, seconds: float) -> None:
        """Go on by so much, at most to the end."""
        self.time = min(self._end, max(0.0, self.time + seconds))

    def restart(self) -> None:
        """Back to the start."""
        self.time = 0.0

    def sideways(self, sign: int) -> None:
        """A second back or on."""
        self.advance(sign * JUMP)

    def stronger(self, factor: float) -> None:
        """Nothing: what is recorded cannot be pushed."""
