"""What a window drives, and how the time of a clock becomes its time: speed, pause, steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import mujoco

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError

SLOWEST, FASTEST = 1 / 64, 64.0
# A window that stood still for longer (moved, hidden, a slow machine) is not caught up with [s].
LONGEST = 0.1
# What a single step shows, at speed 1 [s].
STEP = 1 / 60


class Motion(Protocol):
    """What the window drives: a recorded run or a live one."""

    @property
    def model(self) -> mujoco.MjModel:
        """What is drawn."""
        ...

    @property
    def state(self) -> Array:
        """mjSTATE_FULLPHYSICS where it is now."""
        ...

    @property
    def words(self) -> Mapping[str, str]:
        """What the window says about it, by name."""
        ...

    @property
    def note(self) -> str:
        """One line about why it stands still; empty while it moves."""
        ...

    def advance(self, seconds: float) -> None:
        """Go on by so much of its own time."""
        ...

    def restart(self) -> None:
        """Back to the start."""
        ...

    def sideways(self, sign: int) -> None:
        """What the keys to the left (-1) and to the right (1) do."""
        ...

    def stronger(self, factor: float) -> None:
        """What the keys up and down do."""
        ...


class Playback:
    """The course of time of a motion.

    Attributes:
        speed: Seconds of the motion in a second of the clock.
        paused: Whether it stands still.
    """

    def __init__(self, speed: float = 1.0) -> None:
        """Start running.

        Raises:
            ArgumentError: If the speed is not within the bounds.
        """
        if not (math.isfinite(speed) and SLOWEST <= speed <= FASTEST):
            raise ArgumentError(
                f"speed {speed:g} must be from 1/{1 / SLOWEST:g} to {FASTEST:g} times real time"
            )
        self.speed, self.paused = speed, False
        self._owed, self._last = 0.0, math.nan

    def elapsed(self, now: float) -> float:
        """Time [s] that the motion is to advance by since the last call, at ``now`` [s]."""
        passed = 0.0 if math.isnan(self._last) or self.paused else now - self._last
        self._last = now
        owed, self._owed = self._owed, 0.0
        return owed + min(passed, LONGEST) * self.speed

    def toggle(self) -> None:
        """Pause, or go on."""
        self.paused = not self.paused

    def change_speed(self, factor: float) -> None:
        """Faster or slower, within the bounds."""
        self.speed = min(FASTEST, max(SLOWEST, factor * self.speed))

    def step(self) -> None:
        """Pause, and advance by one picture."""
        self.paused = True
        self._owed += STEP * self.speed
