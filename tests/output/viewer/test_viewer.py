"""MuJoCo's window: its time, pulls of the mouse and its state, with a fake clock and window."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from commands import Patch, Screen, run
from open_loop import held

from grosmc_mj import cli
from grosmc_mj.cli.commands.film import FilmCommand
from grosmc_mj.cli.program import parse
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.machine import LuGre, Stop, Transmission
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output import viewer
from grosmc_mj.output.viewer import LONGEST, PICTURE, play
from grosmc_mj.simulation.disturbances import (
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    Table,
)
from grosmc_mj.simulation.simulate import simulate

# A plant under a law from a start: arguments of play and of simulate.
Run = dict[str, Any]

BUILT = (
    Transmission("shoulder", 0.1, stiffness=1e4, backlash=1e-3),
    Stop("shoulder", -0.5, 0.5),
    LuGre("elbow", 0.5),
)


PUSH = Disturbance("pole", (0, 0, 0, 0, 0.5, 0), Pulse(0.05, 0.35))


def pendulum(**changes: Any) -> Run:
    """The pendulum under LQR and a push, or with other arguments."""
    case = find_experiment("cart_pendulum", "case1")
    run = {
        "plant": MujocoPlant.load("cart_pendulum", edits=case.edits),
        "controller": case.law("physics", "lqr"),
        "x0": case.x0,
        "disturbances": (PUSH,),
    }
    return run | changes


def machine(*disturbances: Disturbance) -> Run:
    """A machine of two inputs with a flexible joint, a stop and friction."""
    return {
        "plant": MujocoPlant.load("two_link_arm", edits=BUILT),
        "controller": held((1.0, -0.5)),
        "x0": [0.1, 0.2, 0.0, 0.0],
        "disturbances": disturbances,
    }


def sampled() -> Run:
    """Samples every 5 ms under a function of time at the input, and a disturbed measurement."""
    disturbances = (
        InputDisturbance("force", 2.0, math.sin),
        OutputDisturbance("pole angle", 0.01, Table((1.0, -1.0), 7e-3, periodic=True)),
    )
    return pendulum(control_period=5e-3, disturbances=disturbances)


class FakeWindow:
    """A window that stays open for some pictures, and a clock that only waiting moves."""

    def __init__(self, count: int, at: Callable[[FakeWindow], object]) -> None:
        self.count = count
        self.at = at
        self.now = 0.0
        self.states: list[np.ndarray] = []
        self.texts: list[dict[str, str]] = []
        self.closed = False

    @contextmanager
    def open(self, model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[FakeWindow]:
        self.model = model
        self.data = data
        yield self
        self.closed = True

    def is_running(self) -> bool:
        return len(self.states) < self.count

    def set_texts(self, texts: Any) -> None:
        _, _, names, values = texts
        lines = zip(names.split("\n"), values.split("\n"), strict=True)
        self.texts.append(dict(lines))

    def sync(self) -> None:
        state = np.concatenate([[self.data.time], self.data.qpos, self.data.qvel])
        self.states.append(state)
        self.at(self)

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def watch(monkeypatch: Patch) -> Callable[..., FakeWindow]:
    """Play a run in a fake window; ``at`` is called with it after each picture."""

    def watch(
        run: Run, count: int, at: Callable[[FakeWindow], object] = lambda _: None, **more: Any
    ) -> FakeWindow:
        window = FakeWindow(count, at)
        clock = SimpleNamespace(perf_counter=lambda: window.now, sleep=window.sleep)
        monkeypatch.setattr(viewer, "open_window", window.open)
        monkeypatch.setattr(viewer, "time", clock)
        play(**run, duration=1.0, **more)
        assert window.closed
        return window

    return watch


def recorded(run: Run, window: FakeWindow) -> np.ndarray:
    """The recorded run's rows at the instants of the pictures."""
    times = np.array(window.states)[:, 0]
    rows = np.rint(times / 1e-3).astype(int)
    trajectory = simulate(**run, duration=(rows[-1] + 1) * 1e-3, engine="python")
    columns = window.states[0].size
    return np.asarray(trajectory.physics)[rows, :columns]


@pytest.mark.parametrize("make", [pendulum, machine, sampled])
def test_pictures_are_the_recorded_run_bit_by_bit(
    make: Callable[[], Run], watch: Callable[..., FakeWindow]
) -> None:
    """However the time is cut into pictures, and whatever the window changes in its copies."""
    random = np.random.default_rng(0)

    def wait(window: FakeWindow) -> None:
        window.sleep(random.uniform(0.0, 0.05))
        mujoco.mj_resetData(window.model, window.data)
        window.model.opt.gravity[:] = 0.0
        window.model.body_mass[:] *= 2.0

    window = watch(make(), 12, wait)
    np.testing.assert_array_equal(window.states, recorded(make(), window))


def test_a_pull_of_the_mouse_is_a_disturbance_beside_the_case_s_own(
    watch: Callable[..., FakeWindow],
) -> None:
    """Of the lower link, beside the world, which is fixed, and a motor's body, which is hidden."""
    pull = (1.0, 0.0, -0.5, 0.0, 2.0, 0.0)
    push = Disturbance("upper", (0, 0, 0, 0, 0.5, 0), Pulse(0.05, 0.35))

    def mouse(window: FakeWindow) -> None:
        pulling = 10 <= len(window.states) < 20
        window.data.body("lower").xfrc_applied[:] = np.array(pull) * pulling
        window.data.body("world").xfrc_applied[:] = 1.0

    window = watch(machine(push), 30, mouse)
    pulse = Pulse(window.states[9][0], window.states[19][0])
    both = machine(push, Disturbance("lower", pull, pulse))
    np.testing.assert_array_equal(window.states, recorded(both, window))


def test_the_run_keeps_step_with_the_clock(watch: Callable[..., FakeWindow]) -> None:
    window = watch(pendulum(), 30, speed=4.0)
    time = window.states[-1][0]
    # 29 pictures after the first; the last timestep may not be over.
    behind = 29 * PICTURE * 4.0 - time
    assert behind == pytest.approx(5e-4, abs=5.1e-4)
    assert window.texts[-1] == {"time": f"{time:.2f} s", "stopped": "-"}


def test_a_window_that_stood_still_is_not_caught_up_with(watch: Callable[..., FakeWindow]) -> None:
    window = watch(pendulum(), 2, lambda window: window.sleep(100.0), speed=2.0)
    assert window.states[-1][0] == pytest.approx(2.0 * LONGEST, abs=1.1e-3)


def test_an_undefined_law_is_named_and_the_last_state_stays(
    watch: Callable[..., FakeWindow],
) -> None:
    """From 80 degrees the pole falls below the horizontal under a steady force."""
    force = Disturbance("pole", (-64.0, 0, 0, 0, 0, 0), Pulse(0.0, 9.0))
    law = find_experiment("cart_pendulum", "case1").law("physics", "fl-lqr")
    falling = pendulum(controller=law, x0=(0.0, -1.4, 0.0, 0.0), disturbances=(force,))
    window = watch(falling, 60, speed=8.0)
    assert "the law is undefined" in window.texts[-1]["stopped"]
    assert window.states[-1][0] < 4.9
    assert window.texts[-1]["time"] == f"{window.states[-1][0]:.2f} s"
    assert np.all(np.isfinite(window.states))
    np.testing.assert_array_equal(window.states[-1], window.states[-2])


@pytest.mark.parametrize("speed", [1 / 65, 65.0])
def test_a_speed_beyond_64_times_is_refused(speed: float) -> None:
    with pytest.raises(ArgumentError, match="must be from 1/64 to 64 times real time"):
        play(**pendulum(), duration=1.0, speed=speed)


def test_ctrl_c_closes_the_window(watch: Callable[..., FakeWindow]) -> None:
    def interrupt(_: FakeWindow) -> None:
        raise KeyboardInterrupt

    assert len(watch(pendulum(), 30, interrupt).states) == 1


def test_without_a_display_the_command_offers_the_film(capsys: Screen, monkeypatch: Patch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert run("view", "arm/case2", "--laws", "lqr") == cli.WRONG
    reason, remedy = capsys.readouterr().err.strip().split("; for a film of it run: ")
    assert reason.startswith("grosmc-mj: there is no display")
    _, *arguments = remedy.split()
    assert parse(arguments) == FilmCommand("arm/case2", laws=("lqr",))


PROGRAM = """
import time

from grosmc_mj.output.films.offscreen import without_graphics

with without_graphics():
    import mujoco

from grosmc_mj.output import viewer
from grosmc_mj.theory.control.kinds.cart import holding_lqr
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

plant = MujocoPlant.load("cart_pendulum")
begun = time.monotonic()


def sleep(seconds):
    time.sleep(seconds)
    if time.monotonic() > begun + 5:
        raise KeyboardInterrupt


class Clock:
    perf_counter = time.perf_counter
    sleep = staticmethod(sleep)


viewer.time = Clock
viewer.play(plant, holding_lqr(plant.analytic()), (0, 0.1, 0, 0), duration=1.0)
print("closed")
"""


@pytest.mark.slow
@pytest.mark.render
def test_mujocos_window_opens_after_an_import_without_graphics() -> None:
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed: apt-get install xvfb")
    display = f":{900 + os.getpid() % 90}"
    environment = {**os.environ, "DISPLAY": display}
    server = ["Xvfb", display, "-screen", "0", "320x240x24"]
    with subprocess.Popen(server, stderr=subprocess.DEVNULL) as process:
        time.sleep(2)
        program = [sys.executable, "-c", PROGRAM]
        served = subprocess.run(program, env=environment, capture_output=True, check=False)
        process.terminate()
    assert served.returncode == 0, served.stderr
    assert served.stdout.split() == [b"closed"]
