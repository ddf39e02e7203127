"""MuJoCo's clock: native runs suspend it, restore it however they end, and move the same."""

from __future__ import annotations

import ctypes
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf import CROWDED
from open_loop import held

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.hooks import clock_suspended
from grosmc_mj.mechanics.physics.mjdata import mujoco_library
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

PLANT = MujocoPlant.load("servo")


def clock() -> int | None:
    """Address of MuJoCo's clock; None if it is suspended."""
    library = ctypes.CDLL(str(mujoco_library()))
    return ctypes.c_void_p.in_dll(library, "mjcb_time").value


class CountingClock:
    """A clock of the user's own [ms]."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self) -> float:
        self.calls += 1
        return float(self.calls)


@pytest.fixture
def own_clock() -> Iterator[CountingClock]:
    """The user's clock, installed for one test."""
    shipped = clock()
    counting = CountingClock()
    mujoco.set_mjcb_time(counting)
    yield counting
    mujoco.set_mjcb_time(None)
    pointer = ctypes.c_void_p.in_dll(ctypes.CDLL(str(mujoco_library())), "mjcb_time")
    pointer.value = shipped


def step_once() -> mujoco.MjData:
    """An mjData after one step of MuJoCo outside of this package."""
    data = mujoco.MjData(PLANT.model)
    mujoco.mj_step(PLANT.model, data)
    return data


def interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def interrupted_run(threads: int) -> None:
    """A run of minutes that Ctrl-C ends."""
    previous = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    try:
        starts = np.ones((threads, 2))
        simulate(PLANT, held(0.0), starts, duration=9e4, record=False, threads=threads)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


def failing_run(threads: int) -> None:
    """Runs that end with an error of MuJoCo."""
    plant = Robot.from_mjcf(CROWDED).plant
    simulate(plant, held(1.0), np.zeros((threads, 2)), duration=0.5, threads=threads)


def test_the_python_package_of_mujoco_times_every_step() -> None:
    assert clock() is not None
    # Its timers are views, which do not keep an mjData alive.
    data = step_once()
    assert data.timer[int(mujoco.mjtTimer.mjTIMER_STEP)].duration > 0.0


def test_a_native_run_never_calls_the_clock(own_clock: CountingClock) -> None:
    simulate(PLANT, held(0.5), [0.0, 0.0], duration=0.1)
    # The first run has compiled the model, for which MuJoCo asks the clock.
    own_clock.calls = 0
    simulate(PLANT, held(0.5), [0.0, 0.0], duration=0.1)
    assert own_clock.calls == 0


def test_the_user_s_clock_is_called_again_after_a_run(own_clock: CountingClock) -> None:
    simulate(PLANT, held(0.5), [0.0, 0.0], duration=0.1)
    step_once()
    assert own_clock.calls > 0


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("run", "error"), [(failing_run, ModelError), (interrupted_run, KeyboardInterrupt)]
)
def test_the_clock_is_restored_after_a_run_that_fails(
    run: Callable[[int], None], error: type[BaseException], threads: int
) -> None:
    before = clock()
    with pytest.raises(error):
        run(threads)
    assert clock() == before
    assert before is not None


def test_states_do_not_depend_on_the_clock() -> None:
    model = MujocoPlant.load("two_link_arm").model
    timed = mujoco.MjData(model)
    untimed = mujoco.MjData(model)
    timed.qvel[:] = 1.0
    untimed.qvel[:] = 1.0
    for _ in range(50):
        mujoco.mj_step(model, timed)
        with clock_suspended():
            mujoco.mj_step(model, untimed)
        np.testing.assert_array_equal(timed.qpos, untimed.qpos)
        np.testing.assert_array_equal(timed.qvel, untimed.qvel)
    timers = [timer.duration for timer in untimed.timer]
    assert timers == [0.0] * len(timers)


def test_the_outer_of_two_nested_blocks_restores_the_clock() -> None:
    before = clock()
    with clock_suspended():
        with clock_suspended():
            assert clock() is None
        assert clock() is None
    assert clock() == before


def test_the_last_of_two_overlapping_threads_restores_the_clock() -> None:
    before = clock()
    inside = threading.Event()
    ended = threading.Event()

    def suspend() -> None:
        with clock_suspended():
            inside.set()
            ended.wait()

    thread = threading.Thread(target=suspend)
    with clock_suspended():
        thread.start()
        inside.wait()
    assert clock() is None
    ended.set()
    thread.join()
    assert clock() == before


def test_a_clock_that_is_installed_meanwhile_stays() -> None:
    shipped = clock()
    counting = CountingClock()
    with clock_suspended():
        mujoco.set_mjcb_time(counting)
    installed = clock()
    mujoco.set_mjcb_time(None)
    ctypes.c_void_p.in_dll(ctypes.CDLL(str(mujoco_library())), "mjcb_time").value = shipped
    assert installed not in (None, shipped)


@pytest.mark.slow
def test_another_thread_may_step_a_model_while_the_clock_changes() -> None:
    """A pointer that MuJoCo loaded twice for one call would end the process within a second."""
    program = """
import threading, mujoco
from grosmc_mj.mechanics.physics.hooks import clock_suspended
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><body><joint/><geom size='1'/></body></worldbody></mujoco>"
)
data = mujoco.MjData(model)
stepping = threading.Thread(target=lambda: mujoco.mj_step(model, data, nstep=1_000_000))
stepping.start()
blocks = 0
while stepping.is_alive():
    with clock_suspended():
        blocks += 1
print(blocks)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 100
