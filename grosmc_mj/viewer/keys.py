"""What the keys do in a window: one table for the window and for the help.

The window is MuJoCo's own and has meanings for most keys, which go on working beside these; so
[ and ], which change the camera, and the letters, which change what is drawn, stay free.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from grosmc_mj.viewer.playback import Motion, Playback


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
