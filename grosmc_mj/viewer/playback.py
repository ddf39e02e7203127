"""What a window drives, how the time of a clock becomes its time, and what the keys do to both."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from grosmc_mj.errors import ArgumentError
from grosmc_mj.viewer.live import Live
from grosmc_mj.viewer.replay import RecordedRun

SLOWEST, FASTEST = 1 / 64, 64.0
# A window that stood still for longer (moved, hidden, a slow machine) is not caught up with [s].
LONGEST = 0.1
# What a single step shows, at speed 1 [s].
STEP = 1 / 60


# What the window drives.
Motion = Live | RecordedRun


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


class Key(NamedTuple):
    """One key, or several that do the same.

    Attributes:
        names: For people.
        meaning: For people.
        codes: GLFW's.
        act: What it does to playback and motion.
    """

    names: str
    meaning: str
    codes: tuple[int, ...]
    act: Callable[[Playback, Motion], None]


# The window is MuJoCo's own and has meanings for most keys, which go on working beside these; so
# [ and ], which change the camera, and the letters, which change what is drawn, stay free.
KEYS = (
    Key("space", "pause, go on", (32,), lambda play, _: play.toggle()),
    Key(".", "one picture on, paused", (46,), lambda play, _: play.step()),
    # With and without the shift key of keyboards that have + above =, and on the number pad.
    Key("+", "twice as fast", (61, 43, 334), lambda play, _: play.change_speed(2.0)),
    Key("-", "half as fast", (45, 333), lambda play, _: play.change_speed(0.5)),
    Key("backspace", "from the start", (259,), lambda _, motion: motion.restart()),
    Key("left", "push to the left; in a replay 1 s back", (263,), lambda _, m: m.sideways(-1)),
    Key("right", "push to the right; in a replay 1 s on", (262,), lambda _, m: m.sideways(1)),
    Key("up", "push twice as hard", (265,), lambda _, motion: motion.stronger(2.0)),
    Key("down", "push half as hard", (264,), lambda _, motion: motion.stronger(0.5)),
)
_BY_CODE = {code: key for key in KEYS for code in key.codes}


def press(code: int, playback: Playback, motion: Motion) -> None:
    """Do what a key means; others mean nothing here."""
    if code in _BY_CODE:
        _BY_CODE[code].act(playback, motion)
