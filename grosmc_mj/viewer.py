"""The live window, MuJoCo's own: watch a case, push it, or replay a recorded run."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.films.offscreen import has_display
from grosmc_mj.films.scene import pose
from grosmc_mj.physics.hooks import warnings_counted_only
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse, packed, push
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.trajectory import Status, Trajectory, why_ended

# Seconds of a motion in a second of the clock.
SLOWEST, FASTEST = 1 / 64, 64.0
# Time between two pictures [s]. A window that stood still for longer than the other (moved, hidden,
# a slow machine) is not caught up with.
PICTURE, LONGEST = 1 / 60, 0.1
# How long one press of a key pushes, and by how much one jumps in a replay [s].
LENGTH, JUMP = 0.2, 1.0
# Bounds of a push's size [N or N m].
WEAKEST, STRONGEST = 1 / 64, 1024.0


class Live:
    """A closed loop that runs as its time goes on, without end, under the same law in Python.

    Its timesteps, samples and disturbances are those of ``simulate``. Keys push the system's
    uncertain body, else its last, by a torque about its joint's axis, or a force along a slide.

    Args:
        plant: In MuJoCo.
        controller: The law with its numbers.
        x0: Start, (n,).
        duration: Of a recorded run [s]; a live one goes on.
        disturbances: Wrenches on the plant.
        control_period: Time between two samples of the law [s]; the timestep by default.

    Attributes:
        model: The plant's.
        size: Of a push, in ``unit``.
        unit: N or N m.
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
        self._disturbances, self.model, self.size = tuple(disturbances), plant.model, 1.0
        self.restart()
        self.body = plant.system.uncertain_body or plant.system.bodies[-1]
        joint = self.model.body(self.body).jntadr[0]
        slides = self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
        self.unit, axis = "N" if slides else "N m", self.model.jnt_axis[joint]
        self._push = np.concatenate([axis, np.zeros(3)] if slides else [np.zeros(3), axis])

    def restart(self) -> None:
        """Back to the start, with a new memory of the law and without a push."""
        self._loop, self._due, self.note = ClosedLoop(self._problem), 0.0, ""
        self._pushes: tuple[Disturbance, ...] = ()

    @property
    def time(self) -> float:
        """Of the last timestep [s]."""
        return self._loop.steps * self._problem.timestep

    @property
    def state(self) -> Array:
        """mjSTATE_FULLPHYSICS as it is now."""
        return self._loop.physics()

    @property
    def words(self) -> dict[str, str]:
        """Time, inputs and the size of a push, as texts by their names."""
        inputs = {
            signal.name: f"{value:.3g} {signal.unit}"
            for signal, value in zip(self._problem.system.inputs, self._loop.run.u, strict=True)
        }
        push = f"{self.size:g} {self.unit} on {self.body}"
        return {"time": f"{self.time:.2f} s", **inputs, "push": push}

    def advance(self, seconds: float) -> None:
        """As many timesteps as fit into the time so far; none after the run has ended."""
        problem, wrench = self._problem, np.zeros(6 * len(self._problem.system.bodies))
        self._due, h = self._due + seconds, problem.timestep
        for step in range(self._loop.steps, int(self._due / h + 1e-6)):
            if self.note:
                return
            acting, steps = (*self._disturbances, *self._pushes), range(step, step + 1)
            push(*packed(acting, problem.system.bodies, steps, h), 0, step * h, wrench)
            status = self._loop.advance_under(wrench)
            if status is not Status.COMPLETED:
                law = problem.controllers[0]
                self.note = why_ended(status, problem.system, law, self.time, self._loop.run.x)

    def sideways(self, sign: int) -> None:
        """Push for a moment, to the right or to the left; pressing again goes on pushing."""
        wrench, moment = sign * self.size * self._push, Pulse(self.time, self.time + LENGTH)
        self._pushes = (Disturbance(self.body, tuple(wrench.tolist()), moment),)

    def stronger(self, factor: float) -> None:
        """Change what the keys push with."""
        self.size = min(STRONGEST, max(WEAKEST, factor * self.size))


class RecordedRun:
    """A recorded run, shown as it was.

    Args:
        model: The model that the run was made with.
        run: One run with its physics.
        ended: Why the run ended early, if it did.

    Attributes:
        model: The model.
        time: Where the replay is [s].
    """

    def __init__(self, model: mujoco.MjModel, run: Trajectory, ended: str = "") -> None:
        self.model, self.time, self._run = model, 0.0, run
        self._end, self._ended = float(run.time[-1]), ended or "the end of the run"

    @property
    def state(self) -> Array:
        """mjSTATE_FULLPHYSICS at the last instant that has been reached."""
        reached = np.searchsorted(self._run.time, self.time + 1e-9, side="right")
        return np.asarray(self._run.physics)[int(reached) - 1]

    @property
    def words(self) -> dict[str, str]:
        """The time."""
        return {"recorded": f"{self.time:.2f} of {self._end:g} s"}

    @property
    def note(self) -> str:
        """Why the run ended, once its end is reached."""
        return self._ended if self.time == self._end else ""

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


@contextlib.contextmanager
def open_window(
    model: mujoco.MjModel, data: mujoco.MjData, on_key: Callable[[int], None]
) -> Iterator[Any]:
    """MuJoCo's window, without its panels (Tab and Shift-Tab show them); closed at the end.

    It looks from the front, a little from above; a body that slides along is followed.

    Raises:
        SetupError: If there is no display.
        RuntimeError: On macOS, where it needs mjpython.
    """
    import glfw
    import mujoco.viewer as theirs

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # Where this fails, launch_passive would wait for its window without end.
        if sys.platform != "darwin" and not (has_display() and glfw.init()):
            raise SetupError("there is no display to open a window on (DISPLAY, WAYLAND_DISPLAY)")
    before = threading.enumerate()
    handle = theirs.launch_passive(
        model, data, key_callback=on_key, show_left_ui=False, show_right_ui=False
    )
    threads = [thread for thread in threading.enumerate() if thread not in before]
    try:
        with handle.lock():
            look_from_the_front(handle.cam, model)
        yield handle
    finally:
        handle.close()
        # Left behind, they crash at the exit. Without a graphics card a picture takes seconds.
        for thread in threads:
            thread.join(20.0)


def look_from_the_front(camera: mujoco.MjvCamera, model: mujoco.MjModel) -> None:
    """Turn a free camera to the front, a little from above, and let it follow what slides."""
    mujoco.mjv_defaultFreeCamera(model, camera)
    camera.azimuth, camera.elevation = 90, -8
    slides = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE]
    if len(slides):
        camera.type, camera.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, slides[0]


def play(
    motion: Live | RecordedRun,
    *,
    speed: float = 1.0,
    window: Callable[..., contextlib.AbstractContextManager[Any]] = open_window,
    clock: Callable[[], float] = time.perf_counter,
    wait: Callable[[float], None] = time.sleep,
) -> None:
    """Show a motion until its window is closed or Ctrl-C is pressed.

    The window has data of its own, which are set from the motion for every picture: what its
    panels or its own keys do to them never reaches the physics. It has meanings of its own for most
    keys too, which go on working; so [ and ], which change the camera, and the letters, which
    change what is drawn, stay free.

    Args:
        motion: A ``RecordedRun`` or a ``Live``.
        speed: Seconds of the motion in a second of the clock.
        window: Opens it, with what of ``mujoco.viewer.Handle`` is used here.
        clock: Tells the time [s].
        wait: Lets time pass [s].

    Raises:
        ArgumentError: If the speed is not within its bounds.
        SetupError: If there is no display.
    """
    if not SLOWEST <= speed <= FASTEST:
        raise ArgumentError(
            f"speed {speed:g} must be from 1/{1 / SLOWEST:g} to {FASTEST:g} times real time"
        )
    data, keys, paused, now = mujoco.MjData(motion.model), list[int](), False, clock()
    pose(motion.model, data, motion.state)
    # A diverging run overflows quietly; its state tells.
    with (
        window(motion.model, data, keys.append) as shown,
        np.errstate(all="ignore"),
        warnings_counted_only(),
        contextlib.suppress(KeyboardInterrupt),
    ):
        while shown.is_running():
            while keys:
                match keys.pop(0):
                    case 32:  # space
                        paused = not paused
                    case 61 | 43 | 334:  # + with and without the shift key, and on the number pad
                        speed = min(FASTEST, 2 * speed)
                    case 45 | 333:  # -
                        speed = max(SLOWEST, speed / 2)
                    case 259:  # backspace
                        motion.restart()
                    case 262 | 263 as code:  # right, left
                        motion.sideways(1 if code == 262 else -1)
                    case 264 | 265 as code:  # down, up
                        motion.stronger(2.0 if code == 265 else 0.5)
            last, now = now, clock()
            motion.advance(0.0 if paused else min(now - last, LONGEST) * speed)
            # A state that is not finite is not drawn.
            if np.all(np.isfinite(motion.state)):
                pose(motion.model, data, motion.state)
            pace = {"speed": f"{speed:g}x{' paused' * paused}", "stopped": motion.note or "-"}
            words = motion.words | pace
            shown.set_texts(
                (
                    None,
                    int(mujoco.mjtGridPos.mjGRID_TOPLEFT),
                    "\n".join(words),
                    "\n".join(words.values()),
                )
            )
            shown.sync()
            wait(max(0.0, PICTURE - (clock() - now)))
