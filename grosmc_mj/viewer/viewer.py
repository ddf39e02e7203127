"""MuJoCo's own window on a motion, in real time."""

from __future__ import annotations

import contextlib
import queue
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import mujoco
import numpy as np

from grosmc_mj.errors import SetupError
from grosmc_mj.films.camera import aim
from grosmc_mj.films.offscreen import has_display
from grosmc_mj.physics.quiet import warnings_counted_only
from grosmc_mj.viewer.playback import Motion, Playback, press

# Time between two pictures [s].
PICTURE = 1 / 60
# How long a last picture may take, without a graphics card [s].
_LAST_PICTURE = 20.0


class Window(Protocol):
    """What is used of ``mujoco.viewer.Handle``."""

    def is_running(self) -> bool:
        """Whether it is open."""
        ...

    def sync(self) -> None:
        """Draw the data as they are."""
        ...

    def set_texts(self, texts: Any) -> None:
        """Words over the picture."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


@dataclass(frozen=True, eq=False)
class _Opened:
    """MuJoCo's window and the threads that draw it."""

    handle: Any
    threads: tuple[threading.Thread, ...]

    def is_running(self) -> bool:
        """Whether it is open."""
        return self.handle.is_running()

    def sync(self) -> None:
        """Draw the data as they are."""
        self.handle.sync()

    def set_texts(self, texts: Any) -> None:
        """Words over the picture."""
        self.handle.set_texts(texts)

    def close(self) -> None:
        """Close it, and wait for the end of its threads: left behind, they crash at the exit."""
        self.handle.close()
        for thread in self.threads:
            thread.join(_LAST_PICTURE)


OpenWindow = Callable[[mujoco.MjModel, mujoco.MjData, Callable[[int], None]], Window]


def require_display() -> None:
    """Refuse to go on where no window can be opened.

    Raises:
        SetupError: Saying why not.
    """
    if sys.platform == "linux" and not has_display():
        raise SetupError("there is no display (DISPLAY and WAYLAND_DISPLAY are not set)")
    try:
        import glfw
        import mujoco.viewer as theirs
    except (ImportError, RuntimeError) as error:
        raise SetupError(f"MuJoCo's viewer cannot be imported: {error}") from error
    if sys.platform == "darwin":
        if theirs._MJPYTHON is None:
            raise SetupError(
                "on macOS MuJoCo's window needs its own interpreter: run it with "
                "mjpython -m grosmc_mj.cli instead of grosmc-mj"
            )
        return
    # Where this fails, launch_passive would wait for its window without end.
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if not glfw.init():
            # GLFW's own words come as bytes in brackets of Python's.
            why = [re.sub(r"^\(\d+\) b'(.*?)\s*'$", r"\1", str(each.message)) for each in said]
            raise SetupError(f"there is no display ({'; '.join(why) or 'GLFW does not start'})")


def open_window(
    model: mujoco.MjModel, data: mujoco.MjData, on_key: Callable[[int], None]
) -> Window:
    """MuJoCo's window, without its panels (Tab and Shift-Tab show them).

    Raises:
        SetupError: If there is no display.
    """
    require_display()
    import mujoco.viewer as theirs

    before = threading.enumerate()
    handle = theirs.launch_passive(
        model, data, key_callback=on_key, show_left_ui=False, show_right_ui=False
    )
    with handle.lock():
        aim(handle.cam, model, data)
    return _Opened(handle, tuple(each for each in threading.enumerate() if each not in before))


def play(
    motion: Motion,
    *,
    speed: float = 1.0,
    window: OpenWindow = open_window,
    clock: Callable[[], float] = time.perf_counter,
    wait: Callable[[float], None] = time.sleep,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Show a motion until its window is closed or Ctrl-C is pressed.

    The window has data of its own, which are set from the motion for every picture: what its
    panels or its own keys do to them never reaches the physics.

    Args:
        motion: A ``RecordedRun`` or a ``Live``.
        speed: Seconds of the motion in a second of the clock.
        window: Opens it.
        clock: Tells the time [s].
        wait: Lets time pass [s].
        say: Called with a line whenever the motion stands still for a reason.

    Raises:
        ArgumentError: If the speed is not within its bounds.
        SetupError: If there is no display.
    """
    playback, data = Playback(speed), mujoco.MjData(motion.model)
    pressed: queue.SimpleQueue[int] = queue.SimpleQueue()
    _pose(motion, data)
    shown, told = window(motion.model, data, pressed.put), ""
    # A diverging run overflows quietly; its state tells.
    with (
        contextlib.closing(shown),
        np.errstate(all="ignore"),
        warnings_counted_only(),
        contextlib.suppress(KeyboardInterrupt),
    ):
        while shown.is_running():
            now = clock()
            while not pressed.empty():
                press(pressed.get(), playback, motion)
            motion.advance(playback.elapsed(now))
            _pose(motion, data)
            shown.set_texts(_text(playback, motion))
            shown.sync()
            if motion.note and motion.note != told:
                say(motion.note)
            told = motion.note
            wait(max(0.0, PICTURE - (clock() - now)))


def _pose(motion: Motion, data: mujoco.MjData) -> None:
    """Put the window's data where the motion is; a state that is not finite is not drawn."""
    state = motion.state
    if np.all(np.isfinite(state)):
        mujoco.mj_setState(motion.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_forward(motion.model, data)


def _text(playback: Playback, motion: Motion) -> tuple[None, int, str, str]:
    """The words in the window's corner, in two columns."""
    speed = f"{playback.speed:g}x" + (" paused" if playback.paused else "")
    said = {**motion.words, "speed": speed}
    names, values = "\n".join(said), "\n".join(said.values())
    if motion.note:
        names, values = names + "\n\nstopped (backspace: again)", values + f"\n\n{motion.note}"
    return None, int(mujoco.mjtGridPos.mjGRID_TOPLEFT), names, values
