"""The window: its time, keys and pushes, driven with a clock and a window of the test's own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import pytest
from shipped import find_case, nominal_controller

from grosmc_mj import cli, viewer
from grosmc_mj.arrays import Array
from grosmc_mj.cli.commands.film import FilmCommand
from grosmc_mj.cli.commands.view import ViewCommand
from grosmc_mj.cli.program import parse
from grosmc_mj.control.controller import Controller
from grosmc_mj.machine import LuGre, MachinePart, SlidingLoad, Stop, SwingingLoad, Transmission
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.viewer import (
    FASTEST,
    JUMP,
    LENGTH,
    LONGEST,
    PICTURE,
    SLOWEST,
    STRONGEST,
    WEAKEST,
    Live,
    RecordedRun,
    play,
)

SPACE, PLUS, MINUS, BACKSPACE, RIGHT, LEFT, DOWN, UP = 32, 61, 45, 259, 262, 263, 264, 265


@dataclass(frozen=True, eq=False)
class Run:
    """All that a run needs."""

    plant: MujocoPlant
    controller: Controller
    x0: Sequence[float]
    disturbances: Sequence[Disturbance] = ()
    control_period: float | None = None

    def live(self) -> Live:
        return Live(
            self.plant, self.controller, self.x0, duration=1.0, disturbances=self.disturbances,
            control_period=self.control_period,
        )  # fmt: skip

    def recorded(self, duration: float = 0.5, *more: Disturbance) -> Trajectory:
        return simulate(
            self.plant, self.controller, self.x0, duration=duration, engine="python",
            control_period=self.control_period, disturbances=(*self.disturbances, *more),
        )  # fmt: skip


def experiment(system: str = "cart_pendulum", name: str = "case1", **changes: Any) -> Run:
    case = find_case(system, name)
    law = nominal_controller(system, "grosmc", "corrected", design=case.controllers)
    given = {"x0": case.x0, "disturbances": case.disturbances, **changes}
    return Run(MujocoPlant.load(system, edits=case.edits), law, **given)


def physics_of(run: Trajectory) -> Array:
    assert run.physics is not None
    return run.physics


class Fake:
    """A window that stays open for some pictures, with a clock that only waiting moves."""

    def __init__(self, count: int, at: Callable[[Fake], None]) -> None:
        self.now, self.pictures, self.count, self.at = 0.0, 0, count, at
        self.closed, self.texts = False, list[Any]()

    @contextmanager
    def open(self, model: mujoco.MjModel, data: mujoco.MjData, key: Any) -> Iterator[Fake]:
        self.model, self.data, self.key = model, data, key
        yield self
        self.closed = True

    def is_running(self) -> bool:
        return self.pictures < self.count

    def sync(self) -> None:
        self.pictures += 1
        self.at(self)

    def set_texts(self, texts: Any) -> None:
        self.texts.append(dict(zip(texts[2].split("\n"), texts[3].split("\n"), strict=True)))

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


def shown(
    motion: Any, *, count: int = 60, at: Callable[[Fake], None] = lambda _: None, speed: float = 1.0
) -> Fake:
    fake = Fake(count, at)
    play(motion, window=fake.open, clock=fake.clock, wait=fake.wait, speed=speed)
    assert fake.closed
    return fake


def pressing(*codes: int, picture: int = 1) -> Callable[[Fake], None]:
    """Press keys when a picture has been drawn."""

    def at(fake: Fake) -> None:
        for code in codes if fake.pictures == picture else ():
            fake.key(code)

    return at


# The live loop


def machine(*parts: MachinePart) -> Run:
    """A pendulum that moves already, with parts of a machine."""
    law = nominal_controller("cart_pendulum", "lqr", "corrected")
    return Run(MujocoPlant.load("cart_pendulum", edits=parts), law, [0.3, -0.1, 0.2, 0.0])


RUNS = {
    "disturbed": lambda: experiment("arm", "case1"),
    "two inputs": lambda: experiment("two_link_arm", "regulation1"),
    "a slower law": lambda: experiment(control_period=5e-3),
    "a belt": lambda: machine(
        Transmission("slider", 0.1, stiffness=1e4, backlash=1e-3), Stop("slider", -0.5, 0.5)
    ),
    "loads": lambda: machine(
        SwingingLoad("cart", 0.1, 0.3), SlidingLoad("pole", 0.1, 50.0), LuGre("slider", 0.5)
    ),
}


@pytest.mark.parametrize("which", RUNS)
def test_live_and_replay_are_the_recorded_run_bit_by_bit(which: str) -> None:
    """However the time is cut into pictures."""
    what = RUNS[which]()
    states, random = physics_of(what.recorded()), np.random.default_rng(0)
    live, replay = what.live(), RecordedRun(what.plant.model, what.recorded())
    while live.time < 0.4:
        np.testing.assert_array_equal(live.state, states[round(live.time / 1e-3)])
        replay.advance(live.time - replay.time)
        np.testing.assert_array_equal(replay.state, live.state)
        live.advance(random.uniform(0, 0.05))


def test_parts_of_a_timestep_are_owed_and_a_restart_is_the_same_run_again() -> None:
    live, states = experiment().live(), []
    # Ten times 0.01 are a little less than 0.1.
    for part in (1e-4, 0.01):
        live.sideways(1)
        live.advance(0.01)
        live.restart()
        for _ in range(round(0.1 / part)):
            live.advance(part)
        assert live.time == pytest.approx(0.1, abs=1e-12)
        states.append(live.state)
    np.testing.assert_array_equal(*states)


@pytest.mark.parametrize(
    ("system", "wrench"),
    [("cart_pendulum", (0, 0, 0, 0, 2.0, 0)), ("servo", (0, 0, 0, 0, -2.0, 0))],
)
def test_a_push_is_a_disturbance_of_its_length_beside_the_case_s_own(
    system: str, wrench: Any
) -> None:
    body = MujocoPlant.load(system).system.uncertain_body or ""
    load = Disturbance(body, (0, 0, 0, 0, 0.5, 0), Pulse(0.05, 0.35))
    what = experiment(system, "nominal", disturbances=(load,))
    axis = what.plant.model.joint(what.plant.system.joints[-1]).axis
    live = what.live()
    live.advance(0.1)
    live.stronger(2.0)
    live.sideways(int(np.sign(wrench[4] * axis[1])))
    live.advance(0.4)
    push = Disturbance(body, wrench, Pulse(0.1, 0.1 + LENGTH))
    end = physics_of(what.recorded(0.5, push))[-1]
    np.testing.assert_array_equal(live.state, end)
    assert np.abs(end - physics_of(what.recorded())[-1]).max() > 1e-3


def test_an_undefined_law_is_told_and_stops_until_a_restart() -> None:
    """From 80 degrees the pole falls below the horizontal under pushes to the right."""
    live = experiment("cart_pendulum", "nominal", x0=(0.0, -1.4, 0.0, 0.0)).live()
    live.stronger(64.0)
    while not live.note and live.time < 5.0:
        live.sideways(-1)
        live.advance(0.05)
    stopped = live.time
    assert f"at t = {stopped:g} s: the law is undef" in live.note
    live.advance(1.0)
    assert live.time == stopped
    live.restart()
    live.advance(0.01)
    assert (live.note, live.time) == ("", 0.01)


def test_a_diverging_run_is_told_and_its_last_good_state_is_drawn() -> None:
    """The servo under a push of 1e300 N m, if there were one."""
    live = experiment("servo", "nominal").live()
    live.size = 1e300
    live.sideways(1)
    fake = shown(live, count=4)
    assert "the state grew without bound" in fake.texts[-1]["stopped"]
    assert np.all(np.isfinite(fake.data.qpos))


def test_a_replay_goes_back_and_on_and_tells_why_its_run_ended() -> None:
    what = experiment()
    run = what.recorded(1.5)
    for ended, note in (("", "the end of the run"), ("the law is undefined",) * 2):
        replay = RecordedRun(what.plant.model, run, ended)
        replay.sideways(1)
        assert (replay.time, replay.note) == (JUMP, "")
        replay.advance(9.0)
        np.testing.assert_array_equal(replay.state, physics_of(run)[-1])
        assert replay.note == note
        replay.stronger(2.0)
        replay.sideways(-1)
        assert replay.time == 0.5
        replay.restart()
        assert (replay.note, replay.time) == ("", 0.0)


# The window


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_the_motion_keeps_step_with_the_clock_and_is_drawn(speed: float) -> None:
    live = experiment("servo", "nominal").live()
    fake = shown(live, speed=speed)
    # 59 pictures after the first; the last timestep may not be over.
    assert 59 * PICTURE * speed - live.time == pytest.approx(5e-4, abs=5.1e-4)
    drawn = np.concatenate([[live.time], fake.data.qpos, fake.data.qvel])
    np.testing.assert_allclose(drawn, live.state[:3], rtol=1e-12)
    assert list(fake.texts[-1]) == ["time", "current", "push", "speed", "stopped"]
    assert (fake.texts[-1]["speed"], fake.texts[-1]["stopped"]) == (f"{speed:g}x", "-")


def test_neither_a_pause_nor_a_window_that_stood_still_is_caught_up_with() -> None:
    live = experiment("servo", "nominal").live()
    fake = shown(live, at=pressing(SPACE, picture=30))
    assert live.time == pytest.approx(29 * PICTURE, abs=1.1e-3)
    assert fake.texts[-1]["speed"] == "1x paused"
    again = experiment("servo", "nominal").live()
    shown(again, count=2, at=lambda fake: fake.wait(100.0))
    assert again.time == pytest.approx(LONGEST, abs=1.1e-3)


def test_keys_do_what_they_say_and_sizes_stay_within_their_bounds() -> None:
    live = experiment("servo", "nominal").live()
    fake = shown(live, at=pressing(UP, UP, DOWN, PLUS, PLUS, 333, 999), count=3)
    assert fake.texts[-1]["push"] == "2 N m on rotor"
    assert fake.texts[-1]["speed"] == "2x"
    assert shown(live, at=pressing(BACKSPACE, SPACE), count=3).texts[-1]["time"] == "0.00 s"
    for code, speed, size in ((PLUS, FASTEST, 1.0), (MINUS, SLOWEST, 1.0), (UP, 1.0, STRONGEST),
                              (DOWN, 1.0, WEAKEST)):  # fmt: skip
        live = experiment("servo", "nominal").live()
        fake = shown(live, at=pressing(SPACE, *[code] * 30), count=3)
        assert fake.texts[-1]["speed"] == f"{speed:g}x paused"
        assert live.size == size
    replay = RecordedRun(experiment().plant.model, experiment().recorded(2.5))
    shown(replay, at=pressing(SPACE, RIGHT, RIGHT, LEFT), count=3)
    assert replay.time == JUMP


def test_the_codes_of_keys_are_glfw_s_and_stand_in_the_help() -> None:
    glfw = pytest.importorskip("glfw", exc_type=ImportError)
    codes = (glfw.KEY_SPACE, glfw.KEY_EQUAL, glfw.KEY_MINUS, glfw.KEY_BACKSPACE, glfw.KEY_RIGHT,
             glfw.KEY_LEFT, glfw.KEY_DOWN, glfw.KEY_UP)  # fmt: skip
    assert codes == (SPACE, PLUS, MINUS, BACKSPACE, RIGHT, LEFT, DOWN, UP)
    told = (ViewCommand.__doc__ or "").split("Keys:")[1].split("Attributes:")[0].lower()
    for key in ("space", "+", "-", "backspace", "left", "right", "up", "down"):
        assert f" {key} " in " ".join(told.split()).join("  ")


def test_neither_the_window_s_data_nor_ctrl_c_reach_the_physics() -> None:
    states = []
    for at in (lambda _: None, lambda fake: mujoco.mj_resetData(fake.model, fake.data)):
        live = experiment().live()
        shown(live, at=at)
        states.append(live.state)
    np.testing.assert_array_equal(*states)

    def interrupt(_fake: Fake) -> None:
        raise KeyboardInterrupt

    assert shown(experiment("servo", "nominal").live(), at=interrupt).pictures == 1


# The command


def test_without_a_display_it_says_so_and_offers_the_film(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SystemExit) as stop:
        cli.main(["view", "arm/case2", "--controller", "lqr"])
    assert stop.value.code == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    told, film = line.strip().split("; for a film of it run: ")
    assert told.startswith("grosmc-mj: there is no display")
    command = parse(film.split()[1:])
    assert isinstance(command, FilmCommand)
    assert (command.target, command.controllers) == ("arm/case2", ("lqr",))


def test_a_case_is_live_or_recorded_first(monkeypatch: pytest.MonkeyPatch) -> None:
    motions: list[Any] = []
    monkeypatch.setattr(viewer, "play", lambda motion, **_: motions.append(motion))
    for more in ([], ["--replay"]):
        with pytest.raises(SystemExit) as stop:
            cli.main(["view", "servo/nominal", *more])
        assert stop.value.code == 0
    assert [type(motion) for motion in motions] == [Live, RecordedRun]


PROGRAM = """
import time
from grosmc_mj.films.offscreen import without_graphics
with without_graphics():
    import mujoco
from grosmc_mj.viewer import Live, play
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.cases.cart_pendulum.cart import holding_lqr
plant = MujocoPlant.load("cart_pendulum")
live = Live(plant, holding_lqr(plant.analytic()), (0, 0.1, 0, 0), duration=1.0)
def wait(seconds):
    time.sleep(seconds)
    if live.time > 0.3:
        raise KeyboardInterrupt
play(live, wait=wait)
print(live.time)
"""


@pytest.mark.slow
@pytest.mark.render
def test_mujocos_window_opens_after_an_import_without_graphics() -> None:
    """On a virtual display, and not on one that nobody serves."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed: apt-get install xvfb")
    name, run = f":{900 + os.getpid() % 90}", [sys.executable, "-c", PROGRAM]
    server = ["Xvfb", name, "-screen", "0", "320x240x24"]
    with subprocess.Popen(server, stderr=subprocess.DEVNULL) as display:
        time.sleep(2)
        done = [
            subprocess.run(
                run, env={**os.environ, "DISPLAY": where}, capture_output=True, text=True,
                check=False, timeout=200,
            )
            for where in (name, ":987")
        ]  # fmt: skip
        display.terminate()
    assert done[0].returncode == 0, done[0].stderr
    assert float(done[0].stdout.split()[-1]) > 0.3
    assert "SetupError: there is no display" in done[1].stderr
