"""A case in MuJoCo's passive viewer: the closed loop runs while one watches and pulls at it."""

from __future__ import annotations

import contextlib
import copy
import sys
import threading
import time
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.mechanics.physics.hooks import warnings_counted_only
from grosmc_mj.output.films.offscreen import has_display
from grosmc_mj.output.films.scene import pose
from grosmc_mj.simulation.disturbances import AnyDisturbance, Disturbance
from grosmc_mj.simulation.loop import AppliedLoop
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.problem import Problem
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.stability import remedy
from grosmc_mj.simulation.trajectory import Status, why_ended
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant

# Time between two pictures [s].
PICTURE = 1 / 60
# A window that stood still for longer (moved, hidden, a slow machine) is not caught up with [s].
LONGEST = 0.1
# Seconds of the run in a second of the clock.
SLOWEST, FASTEST = 1 / 64, 64.0


def play(
    plant: Plant,
    controller: Controller,
    x0: ArrayLike,
    *,
    duration: float,
    loop: AppliedLoop | None = None,
    disturbances: Sequence[AnyDisturbance] = (),
    control_period: float | None = None,
    speed: float = 1.0,
) -> None:
    """Run a closed loop in a window, without end, until that is closed or Ctrl-C is pressed.

    Timesteps, samples and disturbances are those of ``simulate``. A body that the mouse pulls
    feels the force in the run, too; whatever else the window changes is a copy.

    Args:
        plant: In MuJoCo.
        controller: The law with its numbers.
        x0: Start, (n,).
        duration: Of a recorded run [s], as for ``simulate``; this one goes on.
        loop: The loop around the law; ideal by default.
        disturbances: Of bodies, inputs and measured states.
        control_period: Time between two samples of the law [s]; the timestep by default.
        speed: Seconds of the run in a second of the clock.

    Raises:
        ArgumentError: If something about the run does not fit.
        SetupError: If there is no display.
    """
    if not SLOWEST <= speed <= FASTEST:
        raise ArgumentError(
            f"speed {speed:g} must be from 1/{1 / SLOWEST:g} to {FASTEST:g} times real time"
        )
    # The mouse may pull any body.
    pulls = [Disturbance(body, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)) for body in plant.system.bodies]
    problem, _ = prepare(
        plant,
        controller,
        x0,
        duration=duration,
        loop=loop,
        control_period=control_period,
        disturbances=[*disturbances, *pulls],
    )
    closed_loop = ClosedLoop(problem)

    model = copy.copy(plant.model)
    data = mujoco.MjData(model)
    pose(model, data, closed_loop.physics())

    # A diverging run overflows quietly; its status tells.
    with (
        open_window(model, data) as window,
        np.errstate(all="ignore"),
        warnings_counted_only(),
        contextlib.suppress(KeyboardInterrupt),
    ):
        due = 0.0
        stopped = ""
        now = time.perf_counter()
        while window.is_running():
            before = now
            now = time.perf_counter()
            due += speed * min(now - before, LONGEST)
            if not stopped:
                pull = data.xfrc_applied[closed_loop.run.plant.bodies].ravel()
                steps = int(due / problem.timestep + 1e-6)
                stopped = _advance(closed_loop, problem, steps, pull)

            # A state that is not finite is not drawn.
            state = closed_loop.physics()
            if np.all(np.isfinite(state)):
                pose(model, data, state)
            reached = closed_loop.steps * problem.timestep
            window.set_texts((None, None, "time\nstopped", f"{reached:.2f} s\n{stopped or '-'}"))
            window.sync()
            time.sleep(max(0.0, PICTURE - (time.perf_counter() - now)))


def _advance(
    loop: ClosedLoop,
    problem: Problem,
    steps: int,
    pull: Array,
) -> str:
    """Advance a loop to a number of timesteps, under its disturbances and a pull, (6 * bodies,).

    Returns:
        Why the run cannot go on; empty if it can.
    """
    for _ in range(loop.steps, steps):
        status = loop.advance_under(pull)
        if status is not Status.COMPLETED:
            reached = loop.steps * problem.timestep
            law = problem.controllers[0]
            advice = remedy(problem) if status is Status.DIVERGED else ""
            return why_ended(status, problem.system, law, reached, loop.run.x, advice)
    return ""


@contextlib.contextmanager
def open_window(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[Any]:
    """Open MuJoCo's passive viewer without its panels (Tab and Shift-Tab show them).

    It looks from the front, a little from above; a body that slides along is followed.

    Raises:
        SetupError: If there is no display.
        RuntimeError: On macOS, where it needs mjpython.
    """
    import glfw
    from mujoco.viewer import launch_passive

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # Where this fails, launch_passive would wait for its window without end.
        if sys.platform != "darwin" and not (has_display() and glfw.init()):
            raise SetupError("there is no display to open a window on (DISPLAY, WAYLAND_DISPLAY)")

    before = threading.enumerate()
    window = launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    threads = [thread for thread in threading.enumerate() if thread not in before]
    try:
        with window.lock():
            mujoco.mjv_defaultFreeCamera(model, window.cam)
            window.cam.azimuth = 90
            window.cam.elevation = -8
            slides = model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE]
            if len(slides):
                window.cam.type = mujoco.mjtCamera.mjCAMERA_TRACKING
                window.cam.trackbodyid = slides[0]
        yield window
    finally:
        window.close()
        # Left behind, they crash at the exit. Without a graphics card a picture takes seconds.
        for thread in threads:
            thread.join(20.0)
