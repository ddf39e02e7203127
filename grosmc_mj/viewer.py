"""The live window, MuJoCo's own: watch a case, push it, or replay a recorded run."""

from __future__ import annotations

import contextlib
import math
import queue
import re
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.films.camera import aim
from grosmc_mj.films.offscreen import has_display
from grosmc_mj.physics.hidden_states import starts
from grosmc_mj.physics.quiet import warnings_counted_only
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance, packed, push
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.trajectory import Status, Trajectory, why_ended

# Seconds of a motion in a second of the clock.
SLOWEST, FASTEST = 1 / 64, 64.0
# Time between two pictures [s].
PICTURE = 1 / 60
# A window that stood still for longer (moved, hidden, a slow machine) is not caught up with [s].
LONGEST = 0.1
# How long one press of a key pushes, and by how much one jumps in a replay [s].
LENGTH, JUMP = 0.2, 1.0
# Bounds of a push's size [N or N m].
WEAKEST, STRONGEST = 1 / 64, 1024.0
# Times that have been added up are not exact: seconds, and parts of a timestep.
_INSTANT, _PART = 1e-9, 1e-6
# A body whose centre of mass moves by less for a joint that moves by 1 is not moved by a force.
_FIXED = 1e-9
# How long a last picture may take, without a graphics card [s].
_LAST_PICTURE = 20.0


class Push:
    """A force along x at a body's centre of mass, or a torque where a force moves nothing.

    The body is the system's uncertain one, else its last. Keys to the right push along +x, or
    turn about -y, which looks the same from the front.

    Attributes:
        body: Name of the body.
        unit: N or N m.
        size: How much.
    """

    def __init__(self, plant: Plant, x0: Array) -> None:
        """Find out at the start whether a force moves the body."""
        model, system = plant.model, plant.system
        self.body = system.uncertain_body or system.bodies[-1]
        data, jacobian = mujoco.MjData(model), np.zeros((3, model.nv))
        data.qpos[:] = starts(model, system, x0[None])[0][0]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_jacBodyCom(model, data, jacobian, None, model.body(self.body).id)
        moved = bool(np.abs(jacobian[0]).max() > _FIXED)
        self._wrench = np.zeros((len(system.bodies), 6))
        place = (system.bodies.index(self.body), 0 if moved else 4)
        self._wrench[place] = 1.0 if moved else -1.0
        self.unit, self.size = "N" if moved else "N m", 1.0
        self._sign, self._until = 0, -math.inf

    def press(self, sign: int, now: float) -> None:
        """Push for a moment from ``now`` [s] on; pressing again goes on pushing."""
        self._sign, self._until = sign, now + LENGTH

    def change_size(self, factor: float) -> None:
        """Stronger or weaker, within the bounds."""
        self.size = min(STRONGEST, max(WEAKEST, factor * self.size))

    def wrench(self, now: float) -> Array:
        """[force, torque] of each of the system's bodies at ``now`` [s], (6 * bodies,)."""
        return self._signed(now) * self._wrench.ravel()

    def words(self, now: float) -> str:
        """What it is, and whether it acts at ``now`` [s]."""
        arrow = ("", " ->", " <-")[int(np.sign(self._signed(now)))]
        return f"{self.size:g} {self.unit} on {self.body}{arrow}"

    def _signed(self, now: float) -> float:
        return self._sign * self.size if now < self._until - _INSTANT else 0.0


class Live:
    """A closed loop that runs as its time goes on, without end, under the same law in Python.

    Its timesteps, samples and disturbances are those of ``simulate``.

    Args:
        plant: In MuJoCo.
        controller: The law with its numbers.
        x0: Start, (n,).
        duration: Of a recorded run [s]; a live one goes on.
        disturbances: Wrenches on the plant.
        control_period: Time between two samples of the law [s]; the timestep by default.

    Attributes:
        model: The plant's.
        push: What the keys do to it.
        note: Why it cannot go on; empty while it can.

    Raises:
        ArgumentError: If something about the run does not fit.
    """

    def __init__(
        self,
        plant: Plant,
        controller: Controller,
        x0: ArrayLike,
        *,
        duration: float,
        disturbances: Sequence[Disturbance] = (),
        control_period: float | None = None,
    ) -> None:
        self._problem, _ = prepare(
            plant, controller, x0, duration=duration, control_period=control_period,
            disturbances=disturbances,
        )  # fmt: skip
        self._disturbances, self.model = disturbances, plant.model
        self.push = Push(plant, self._problem.x0[0])
        self.restart()

    def restart(self) -> None:
        """Back to the start, with a new memory of the law."""
        self._loop = ClosedLoop(self._problem)
        self.note, self._owed = "", 0.0
        self.push.press(0, -math.inf)

    @property
    def time(self) -> float:
        """Of the last timestep [s]."""
        return self._loop.steps * self._problem.timestep

    @property
    def x(self) -> Array:
        """The plant's state, (n,)."""
        return self._loop.x

    @property
    def state(self) -> Array:
        """mjSTATE_FULLPHYSICS as it is now."""
        return np.asarray(self._loop.physics())

    @property
    def words(self) -> Mapping[str, str]:
        """Time, input, sliding variable and what the keys push with."""
        lines = {"time": f"{self.time:.2f} s"}
        for signal, value in zip(self._problem.system.inputs, self._loop.u, strict=True):
            lines[signal.name] = f"{value:.3g} {signal.unit}".removesuffix(" 1")
        if (sliding := getattr(self._loop.memory, "s", None)) is not None:
            lines["|s|"] = f"{float(np.linalg.norm(sliding)):.2g}"
        return lines | {"push": self.push.words(self.time)}

    def advance(self, seconds: float) -> None:
        """As many timesteps as fit into what is owed; none after the run has ended."""
        problem, h = self._problem, self._problem.timestep
        self._owed += seconds
        count = int(self._owed / h + _PART)
        self._owed -= count * h
        wrench = np.zeros(6 * len(problem.system.bodies))
        for step in range(self._loop.steps, self._loop.steps + count):
            if self.note:
                return
            pushes = packed(self._disturbances, problem.system.bodies, range(step, step + 1), h)
            push(*pushes, 0, step * h, wrench)
            status = self._loop.advance_under(wrench + self.push.wrench(step * h))
            if status is not Status.COMPLETED:
                law = problem.controllers[0]
                self.note = why_ended(status, problem.system, law, self.time, self._loop.x)

    def sideways(self, sign: int) -> None:
        """Push."""
        self.push.press(sign, self.time)

    def stronger(self, factor: float) -> None:
        """Change what the keys push with."""
        self.push.change_size(factor)


class RecordedRun:
    """A recorded run, shown as it was.

    Args:
        model: The model that the run was made with.
        run: One run with its physics.
        ended: Why the run ended early, if it did.

    Attributes:
        model: The model.
        time: Where the replay is [s].

    Raises:
        ArgumentError: If nothing was recorded that could be shown.
    """

    def __init__(self, model: mujoco.MjModel, run: Trajectory, ended: str = "") -> None:
        if run.physics is None or run.physics.ndim != 2:
            raise ArgumentError("only a single run on a plant in MuJoCo can be replayed")
        self.model, self.time, self._end = model, 0.0, float(run.time[-1])
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


# What the window drives.
Motion = Live | RecordedRun


class Playback:
    """How the time of a clock becomes the time of a motion.

    Attributes:
        speed: Seconds of the motion in a second of the clock.
        paused: Whether it stands still.

    Raises:
        ArgumentError: If the speed is not within the bounds.
    """

    def __init__(self, speed: float = 1.0) -> None:
        if not SLOWEST <= speed <= FASTEST:
            raise ArgumentError(
                f"speed {speed:g} must be from 1/{1 / SLOWEST:g} to {FASTEST:g} times real time"
            )
        self.speed, self.paused = speed, False
        self._owed, self._last = 0.0, math.inf

    def elapsed(self, now: float) -> float:
        """Time [s] that the motion is to advance by since the last call, at ``now`` [s]."""
        passed = 0.0 if self.paused else max(0.0, now - self._last)
        owed, self._owed, self._last = self._owed, 0.0, now
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
        self._owed += PICTURE * self.speed


class Key(NamedTuple):
    """One key, or several that do the same: their name, GLFW's codes, and what they do."""

    names: str
    codes: tuple[int, ...]
    act: Callable[[Playback, Motion], None]


# The window has meanings of its own for most keys, which go on working beside these; so [ and ],
# which change the camera, and the letters, which change what is drawn, stay free.
KEYS = (
    Key("space", (32,), lambda playback, _: playback.toggle()),
    Key(".", (46,), lambda playback, _: playback.step()),
    # With and without the shift key of keyboards that have + above =, and on the number pad.
    Key("+", (61, 43, 334), lambda playback, _: playback.change_speed(2.0)),
    Key("-", (45, 333), lambda playback, _: playback.change_speed(0.5)),
    Key("backspace", (259,), lambda _, motion: motion.restart()),
    Key("left", (263,), lambda _, motion: motion.sideways(-1)),
    Key("right", (262,), lambda _, motion: motion.sideways(1)),
    Key("up", (265,), lambda _, motion: motion.stronger(2.0)),
    Key("down", (264,), lambda _, motion: motion.stronger(0.5)),
)


def press(code: int, playback: Playback, motion: Motion) -> None:
    """Do what a key means; others mean nothing here."""
    for key in KEYS:
        if code in key.codes:
            key.act(playback, motion)


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
    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        if not glfw.init():
            # GLFW's own words come as bytes in brackets of Python's.
            lines = [re.sub(r"^\(\d+\) b'(.*?)\s*'$", r"\1", str(m.message)) for m in messages]
            raise SetupError(f"there is no display ({'; '.join(lines) or 'GLFW does not start'})")


@contextlib.contextmanager
def open_window(
    model: mujoco.MjModel, data: mujoco.MjData, on_key: Callable[[int], None]
) -> Iterator[Any]:
    """MuJoCo's window, without its panels (Tab and Shift-Tab show them); closed at the end.

    Raises:
        SetupError: If there is no display.
    """
    require_display()
    import mujoco.viewer as theirs

    before = threading.enumerate()
    handle = theirs.launch_passive(
        model, data, key_callback=on_key, show_left_ui=False, show_right_ui=False
    )
    threads = [thread for thread in threading.enumerate() if thread not in before]
    try:
        with handle.lock():
            aim(handle.cam, model, data)
        yield handle
    finally:
        handle.close()
        # Left behind, they crash at the exit.
        for thread in threads:
            thread.join(_LAST_PICTURE)


def play(
    motion: Motion,
    *,
    speed: float = 1.0,
    window: Callable[..., contextlib.AbstractContextManager[Any]] = open_window,
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
        window: Opens it, with what of ``mujoco.viewer.Handle`` is used here.
        clock: Tells the time [s].
        wait: Lets time pass [s].
        say: Called with a line whenever the motion stands still for a reason.

    Raises:
        ArgumentError: If the speed is not within its bounds.
        SetupError: If there is no display.
    """
    playback, data, note = Playback(speed), mujoco.MjData(motion.model), ""
    pressed: queue.SimpleQueue[int] = queue.SimpleQueue()
    _pose(motion, data)
    # A diverging run overflows quietly; its state tells.
    with (
        window(motion.model, data, pressed.put) as shown,
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
            if motion.note and motion.note != note:
                say(motion.note)
            note = motion.note
            wait(max(0.0, PICTURE - (clock() - now)))


def _pose(motion: Motion, data: mujoco.MjData) -> None:
    """Put the window's data where the motion is; a state that is not finite is not drawn."""
    if np.all(np.isfinite(motion.state)):
        mujoco.mj_setState(motion.model, data, motion.state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_forward(motion.model, data)


def _text(playback: Playback, motion: Motion) -> tuple[None, int, str, str]:
    """The words in the window's corner, in two columns."""
    lines = {**motion.words, "speed": f"{playback.speed:g}x" + " paused" * playback.paused}
    names, values = "\n".join(lines), "\n".join(lines.values())
    if motion.note:
        names, values = names + "\n\nstopped (backspace: again)", values + f"\n\n{motion.note}"
    return None, int(mujoco.mjtGridPos.mjGRID_TOPLEFT), names, values
