"""The window: its time, keys and pushes, driven with a clock and a window of the test's own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
import pytest
from commands import Patch, Screen, assert_one_line, run
from conftest import held
from shipped import find_case, nominal_controller

from grosmc_mj import cli, viewer
from grosmc_mj.cli.commands.film import FilmCommand
from grosmc_mj.cli.program import parse
from grosmc_mj.machine import LuGre, Stop, SwingingLoad, Transmission
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.viewer import JUMP, LENGTH, PICTURE, Live, RecordedRun, play

SPACE, PLUS, MINUS, BACKSPACE, RIGHT, LEFT, DOWN, UP = 32, 61, 45, 259, 262, 263, 264, 265
# A plant under a law from a start: arguments of Live and of simulate.
Run = dict[str, Any]


def of(plant: MujocoPlant, law: Any, x0: Any, **more: Any) -> Run:
    return {"plant": plant, "controller": law, "x0": x0, **more}


def experiment(system: str, name: str = "nominal", **changes: Any) -> Run:
    case = find_case(system, name)
    law = nominal_controller(system, "grosmc", "corrected", design=case.controllers)
    plant = MujocoPlant.load(system, edits=case.edits)
    return of(plant, law, **({"x0": case.x0, "disturbances": case.disturbances} | changes))


def live_of(run: Run) -> Live:
    return Live(**run, duration=1.0)


def recorded(run: Run, duration: float = 0.5) -> Any:
    return simulate(**run, duration=duration, engine="python")


class Fake:
    """A window that stays open for some pictures, with a clock that only waiting moves."""

    def __init__(self, count: int, at: Callable[[Fake], object]) -> None:
        self.now, self.pictures, self.count, self.at = 0.0, 0, count, at
        self.closed, self.texts = False, list[Any]()
        self.is_running = lambda: self.pictures < self.count

    @contextmanager
    def open(self, model: mujoco.MjModel, data: mujoco.MjData, key: Any) -> Iterator[Fake]:
        self.model, self.data, self.key = model, data, key
        yield self
        self.closed = True

    def sync(self) -> None:
        self.pictures += 1
        self.at(self)

    def set_texts(self, texts: Any) -> None:
        self.texts.append(dict(zip(texts[2].split("\n"), texts[3].split("\n"), strict=True)))

    def wait(self, seconds: float) -> None:
        self.now += seconds


def shown(motion: Any, *codes: int, at: Any = None, count: int = 3, speed: float = 1.0) -> Fake:
    """The window after some pictures; keys are pressed when the first has been drawn."""

    def press(fake: Fake) -> None:
        for code in codes if fake.pictures == 1 else ():
            fake.key(code)

    fake = Fake(count, at or press)
    play(motion, window=fake.open, clock=lambda: fake.now, wait=fake.wait, speed=speed)
    assert fake.closed
    return fake


BUILT = (
    Transmission("shoulder", 0.1, stiffness=1e4, backlash=1e-3), Stop("shoulder", -0.5, 0.5),
    SwingingLoad("lower", 0.1, 0.3), LuGre("elbow", 0.5),
)  # fmt: skip


@pytest.mark.parametrize(
    "make",
    [
        # A disturbance under a slower law, and a machine of two inputs.
        lambda: experiment("cart_pendulum", "case1", control_period=5e-3),
        lambda: of(
            MujocoPlant.load("two_link_arm", edits=BUILT), held((1.0, -0.5)), [0.1, 0.2, 0.0, 0.0]
        ),
    ],
)
def test_live_and_replay_are_the_recorded_run_bit_by_bit(make: Callable[[], Run]) -> None:
    """However the time is cut into pictures, and once more after a restart."""
    case, random = make(), np.random.default_rng(0)
    run, live = recorded(case, 0.2), live_of(case)
    replay = RecordedRun(case["plant"].model, run)
    for _ in range(2):
        while live.time < 0.15:
            np.testing.assert_array_equal(live.state, run.physics[round(live.time / 1e-3)])
            replay.advance(live.time - replay.time)
            np.testing.assert_array_equal(replay.state, live.state)
            live.advance(random.uniform(0, 0.05))
        live.sideways(1)
        live.advance(0.01)
        live.restart()
        replay.restart()
    # Parts of a timestep are owed; ten times 0.01 are a little less than 0.1.
    for part in (2e-4, 0.01):
        for _ in range(round(0.1 / part)):
            live.advance(part)
        assert live.time == pytest.approx(0.1, abs=1e-12)
        live.restart()


@pytest.mark.parametrize(("system", "force"), [("cart_pendulum", 2.0), ("servo", -2.0)])
def test_a_push_is_a_disturbance_beside_the_case_s_own(system: str, force: float) -> None:
    body = MujocoPlant.load(system).system.uncertain_body or ""
    load = Disturbance(body, (0, 0, 0, 0, 0.5, 0), Pulse(0.05, 0.35))
    case = experiment(system, disturbances=(load,))
    axis = case["plant"].model.joint(case["plant"].system.joints[-1]).axis
    live = live_of(case)
    live.advance(0.1)
    live.stronger(2.0)
    live.sideways(int(np.sign(force * axis[1])))
    live.advance(0.4)
    push = Disturbance(body, (0, 0, 0, 0, force, 0), Pulse(0.1, 0.1 + LENGTH))
    end = recorded({**case, "disturbances": (load, push)}).physics[-1]
    np.testing.assert_array_equal(live.state, end)
    assert np.abs(end - recorded(case).physics[-1]).max() > 1e-3


def test_an_undefined_law_and_a_diverging_run_are_named_and_stop_until_a_restart() -> None:
    """From 80 degrees the pole falls below the horizontal under pushes to the right."""
    live = live_of(experiment("cart_pendulum", x0=(0.0, -1.4, 0.0, 0.0)))
    live.stronger(64.0)
    for _ in range(100):
        live.sideways(-1)
        live.advance(0.05)
    assert f"at t = {live.time:g} s: the law is undef" in live.note
    assert live.time < 4.9
    live.restart()
    live.advance(0.01)
    assert (live.note, live.time) == ("", 0.01)
    # The last good state is drawn of the servo under a push of 1e300 N m, if there were one.
    live = live_of(experiment("servo"))
    live.size = 1e300
    live.sideways(1)
    fake = shown(live, count=4)
    assert "the state grew without bound" in fake.texts[-1]["stopped"]
    assert np.all(np.isfinite(fake.data.qpos))


def test_a_replay_goes_back_and_on_and_says_why_its_run_ended() -> None:
    case = experiment("servo")
    run = recorded(case, 1.5)
    for *ended, note in (("the end of the run",), ("the law is undefined",) * 2):
        replay = RecordedRun(case["plant"].model, run, *ended)
        replay.sideways(1)
        assert (replay.time, replay.note) == (JUMP, "")
        replay.advance(9.0)
        np.testing.assert_array_equal(replay.state, run.physics[-1])
        assert replay.note == note
        shown(replay, SPACE, UP, LEFT, LEFT, RIGHT)
        assert replay.time == JUMP
        replay.restart()
        assert (replay.note, replay.time) == ("", 0.0)


def test_the_motion_keeps_step_with_the_clock_and_is_drawn() -> None:
    live, other, paused, late = (live_of(experiment("servo")) for _ in range(4))
    fake = shown(live, count=30, speed=4.0)
    # 29 pictures after the first; the last timestep may not be over.
    assert 29 * PICTURE * 4.0 - live.time == pytest.approx(5e-4, abs=5.1e-4)
    drawn = np.concatenate([[live.time], fake.data.qpos, fake.data.qvel])
    np.testing.assert_allclose(drawn, live.state[:3], rtol=1e-12)
    assert list(fake.texts[-1]) == ["time", "current", "push", "speed", "stopped"]
    assert (fake.texts[-1]["speed"], fake.texts[-1]["stopped"]) == ("4x", "-")
    # A window that changes its own data changes no physics, and Ctrl-C closes it.
    shown(other, count=30, speed=4.0, at=lambda fake: mujoco.mj_resetData(fake.model, fake.data))
    np.testing.assert_array_equal(live.state, other.state)

    def interrupt(_: Fake) -> None:
        raise KeyboardInterrupt

    assert shown(other, at=interrupt).pictures == 1
    # Neither a pause nor a window that stood still is caught up with.
    fake = shown(paused, count=20, at=lambda fake: fake.pictures == 10 and fake.key(SPACE))
    assert paused.time == pytest.approx(9 * PICTURE, abs=1.1e-3)
    assert fake.texts[-1]["speed"] == "1x paused"
    shown(late, count=2, at=lambda fake: fake.wait(100.0))
    assert late.time == pytest.approx(viewer.LONGEST, abs=1.1e-3)


def test_keys_do_what_they_say_and_sizes_stay_within_their_bounds() -> None:
    live = live_of(experiment("servo"))
    fake = shown(live, UP, UP, DOWN, PLUS, PLUS, 333, 999)
    assert (fake.texts[-1]["push"], fake.texts[-1]["speed"]) == ("2 N m on rotor", "2x")
    assert shown(live, BACKSPACE, SPACE).texts[-1]["time"] == "0.00 s"
    for code, speed, size in (
        (PLUS, viewer.FASTEST, 1.0), (MINUS, viewer.SLOWEST, 1.0),
        (UP, 1.0, viewer.STRONGEST), (DOWN, 1.0, viewer.WEAKEST),
    ):  # fmt: skip
        live = live_of(experiment("servo"))
        fake = shown(live, SPACE, *[code] * 30)
        assert (fake.texts[-1]["speed"], live.size) == (f"{speed:g}x paused", size)


def test_the_codes_of_keys_are_glfw_s() -> None:
    glfw = pytest.importorskip("glfw", exc_type=ImportError)
    names = ("SPACE", "EQUAL", "MINUS", "BACKSPACE", "RIGHT", "LEFT", "DOWN", "UP")
    codes = [getattr(glfw, f"KEY_{name}") for name in names]
    assert codes == [SPACE, PLUS, MINUS, BACKSPACE, RIGHT, LEFT, DOWN, UP]


def test_without_a_display_the_command_offers_the_film(capsys: Screen, monkeypatch: Patch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert run("view", "arm/case2", "--controller", "lqr") == cli.WRONG
    line = capsys.readouterr().err
    assert_one_line(line)
    reason, film = line.strip().split("; for a film of it run: ")
    assert reason.startswith("grosmc-mj: there is no display")
    command = parse(film.split()[1:])
    assert isinstance(command, FilmCommand)
    assert (command.target, command.controllers) == ("arm/case2", ("lqr",))
    # A case is live, or recorded first.
    motions: list[Any] = []
    monkeypatch.setattr(viewer, "play", lambda motion, **_: motions.append(motion))
    for more in ([], ["--replay"]):
        assert run("view", "servo/nominal", *more) == cli.DONE
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
    assert float(served.stdout.split()[-1]) > 0.3
