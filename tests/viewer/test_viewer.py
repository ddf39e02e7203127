"""The window: its time, keys and pushes, driven with a clock and a window of the test's own."""

from __future__ import annotations

import math
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
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.case import Case
from grosmc_mj.films.camera import aim, visible_height
from grosmc_mj.machine import (
    LuGre,
    MachinePart,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
)
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.viewer import (
    FASTEST,
    JUMP,
    KEYS,
    LENGTH,
    LONGEST,
    PICTURE,
    SLOWEST,
    STRONGEST,
    WEAKEST,
    Live,
    Playback,
    Push,
    RecordedRun,
    play,
    press,
    require_display,
)

SPACE, LEFT, RIGHT, UP, DOWN, BACKSPACE = 32, 263, 262, 265, 264, 259


@dataclass(frozen=True, eq=False)
class Run:
    """All that a run needs."""

    plant: MujocoPlant
    controller: Controller
    x0: Sequence[float]
    duration: float
    disturbances: Sequence[Disturbance] = ()
    control_period: float | None = None

    def live(self) -> Live:
        return Live(
            self.plant, self.controller, self.x0, duration=self.duration,
            disturbances=self.disturbances, control_period=self.control_period,
        )  # fmt: skip


def law_of(case: Case) -> Controller:
    return nominal_controller(case.system, "grosmc", "corrected", design=case.controllers)


def experiment(system: str = "cart_pendulum", name: str = "case1", **changes: Any) -> Run:
    case = find_case(system, name)
    plant = MujocoPlant.load(system, edits=case.edits)
    given = {"x0": case.x0, "duration": 1.0, "disturbances": case.disturbances, **changes}
    return Run(plant, law_of(case), **given)


def recorded(what: Run, engine: str = "python", **changes: Any) -> Trajectory:
    return simulate(
        what.plant, what.controller, what.x0, duration=changes.pop("duration", what.duration),
        control_period=what.control_period, engine=engine,  # pyright: ignore[reportArgumentType]
        disturbances=changes.pop("disturbances", what.disturbances),
    )  # fmt: skip


def physics_of(run: Trajectory) -> Array:
    assert run.physics is not None
    return run.physics


# Time


def test_time_is_the_clocks_times_the_speed() -> None:
    playback = Playback(2.0)
    assert [playback.elapsed(now) for now in (7.0, 7.03125, 7.0625)] == [0.0, 0.0625, 0.0625]


def test_a_pause_is_not_made_up_for() -> None:
    playback = Playback()
    playback.elapsed(0.0)
    playback.toggle()
    assert [playback.elapsed(now) for now in (0.05, 5.0)] == [0.0, 0.0]
    playback.toggle()
    assert playback.elapsed(5.0625) == 0.0625


def test_a_window_that_stood_still_is_not_caught_up_with() -> None:
    playback = Playback(0.5)
    playback.elapsed(0.0)
    assert playback.elapsed(100.0) == 0.5 * LONGEST


def test_a_single_step_pauses_and_shows_one_picture_more() -> None:
    playback = Playback(0.25)
    playback.elapsed(0.0)
    playback.step()
    assert playback.paused
    assert [playback.elapsed(now) for now in (1.0, 2.0)] == [0.25 * PICTURE, 0.0]


def test_the_speed_stays_within_its_bounds() -> None:
    playback = Playback(1.0)
    for factor, bound in ((2.0, FASTEST), (0.5, SLOWEST)):
        for _ in range(20):
            playback.change_speed(factor)
        assert playback.speed == bound


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf, 100.0])
def test_speeds_that_cannot_be_are_refused(speed: float) -> None:
    with pytest.raises(ArgumentError, match="must be from 1/64 to 64 times real time"):
        Playback(speed)


# The live loop


@pytest.mark.parametrize(("system", "name"), [("arm", "case1"), ("two_link_arm", "regulation1")])
def test_the_live_loop_is_the_engines_bit_by_bit(system: str, name: str) -> None:
    """However its time is cut into pictures; the arm and the two links are disturbed."""
    what = experiment(system, name)
    run, live, random = recorded(what, duration=0.5), what.live(), np.random.default_rng(0)
    np.testing.assert_array_equal(live.state, physics_of(run)[0])
    while live.time < 0.4:
        live.advance(random.uniform(0, 0.05))
        row = round(live.time / 1e-3)
        np.testing.assert_array_equal(live.state, physics_of(run)[row])
        np.testing.assert_array_equal(live.x, run.state[row])


def machine(*parts: MachinePart) -> Run:
    """A pendulum that moves already, with parts of a machine."""
    plant = MujocoPlant.load("cart_pendulum", edits=parts)
    law = nominal_controller("cart_pendulum", "lqr", "corrected")
    return Run(plant, law, [0.3, -0.1, 0.2, 0.0], duration=0.3)


MACHINES = (
    (Transmission("slider", 0.1, stiffness=1e4, backlash=1e-3), Stop("slider", -0.5, 0.5)),
    (SwingingLoad("cart", 0.1, 0.3), SlidingLoad("pole", 0.1, 50.0), LuGre("slider", 0.5)),
)


@pytest.mark.parametrize("parts", MACHINES)
def test_a_machine_is_live_and_replayed_with_what_no_law_sees(
    parts: tuple[MachinePart, ...],
) -> None:
    what = machine(*parts)
    live, states = what.live(), physics_of(recorded(what))
    replay = RecordedRun(what.plant.model, recorded(what))
    for row in (0, 50, 250):
        for motion in (live, replay):
            motion.advance(row * 1e-3 - motion.time)
            np.testing.assert_array_equal(motion.state, states[row])
    assert len(live.state) > 1 + 4


def test_a_push_moves_a_machine_as_its_rigid_twin() -> None:
    """Whatever hangs on it, and wherever its motors are."""
    for parts in MACHINES:
        what = machine(*parts)
        push, rigid = (Push(each, np.array(what.x0)) for each in (what.plant, what.plant.rigid))
        assert (push.body, push.unit) == (rigid.body, rigid.unit) == ("pole", "N")
    servo = MujocoPlant.load("servo", edits=(Transmission("shaft", 0.01, stiffness=100.0),))
    assert Push(servo, np.array([0.5, 0.0])).unit == "N m"


def test_a_slower_law_is_held_between_its_samples() -> None:
    what = experiment(control_period=5e-3)
    live = what.live()
    live.advance(0.2)
    np.testing.assert_array_equal(live.state, physics_of(recorded(what, duration=0.2))[-1])


def test_parts_of_a_timestep_are_owed_and_not_lost() -> None:
    live = experiment().live()
    for _ in range(1000):
        live.advance(1e-4)
    assert live.time == pytest.approx(0.1, abs=1e-12)


def test_a_restart_is_the_same_run_again() -> None:
    live, states = experiment().live(), []
    for _ in range(2):
        live.sideways(1)
        live.restart()
        live.advance(0.1)
        states.append(live.state)
    np.testing.assert_array_equal(*states)


def test_what_does_not_fit_is_refused_as_by_simulate() -> None:
    with pytest.raises(ArgumentError, match="must be 4 finite numbers for cart_pendulum"):
        experiment(x0=(0.0, 0.1)).live()


def test_an_undefined_law_is_told_and_stops_until_a_restart() -> None:
    """From 80 degrees the pole falls below the horizontal under pushes to the right."""
    live = experiment("cart_pendulum", "nominal", x0=(0.0, -1.4, 0.0, 0.0)).live()
    live.stronger(64.0)
    while not live.note and live.time < 5.0:
        live.sideways(1)
        live.advance(0.05)
    stopped = live.time
    assert live.note.startswith(
        f"cart_pendulum under grosmc at t = {stopped:g} s: the law is undef"
    )
    live.advance(1.0)
    assert live.time == stopped
    live.restart()
    live.advance(0.01)
    assert (live.note, live.time) == ("", 0.01)


def test_a_diverging_run_is_told_and_its_last_good_state_is_drawn() -> None:
    """The servo under a push of 1e300 N m, if there were one."""
    live = experiment("servo", "nominal").live()
    live.push.size = 1e300
    live.sideways(1)
    pictures = Fake(lambda _: None, count=4)
    said: list[str] = []
    play(live, window=pictures.open, clock=pictures.clock, wait=pictures.wait, say=said.append)
    assert len(said) == 1
    assert "the state grew without bound" in said[0]
    assert np.all(np.isfinite(pictures.data.qpos))


# Pushes


@pytest.mark.parametrize(
    ("system", "wrench"),
    [("cart_pendulum", (2.0, 0, 0, 0, 0, 0)), ("servo", (0, 0, 0, 0, -2.0, 0))],
)
def test_a_push_is_a_disturbance_of_its_length(system: str, wrench: tuple[float, ...]) -> None:
    what = experiment(system, "nominal", duration=0.6)
    live, body = what.live(), what.plant.system.uncertain_body
    live.advance(0.1)
    live.stronger(2.0)
    live.sideways(1)
    live.advance(0.4)
    pulse = Disturbance(body, wrench, Pulse(0.1, 0.1 + LENGTH))  # pyright: ignore
    expected = recorded(what, disturbances=(pulse,))
    np.testing.assert_array_equal(live.x, expected.state[500])
    assert np.abs(live.x - recorded(what).state[500]).max() > 1e-3


def test_a_push_adds_to_the_cases_own_disturbance() -> None:
    load = Disturbance("rotor", (0, 0, 0, 0, 1.0, 0), Pulse(0.1, 0.35))
    what = experiment("servo", "nominal", duration=0.4, disturbances=(load,))
    push = Push(what.plant, np.zeros(2))
    assert (push.body, push.unit) == ("rotor", "N m")
    live = what.live()
    live.advance(0.2)
    live.sideways(-1)
    live.advance(0.2)
    push = Disturbance("rotor", (0, 0, 0, 0, 1.0, 0), Pulse(0.2, 0.4))
    expected = recorded(what, disturbances=(load, push))
    np.testing.assert_array_equal(live.x, expected.state[-1])


def test_a_push_has_bounds_and_words() -> None:
    push = Push(MujocoPlant.load("cart_pendulum"), np.zeros(4))
    assert push.words(0.0) == "1 N on pole"
    push.press(-1, 1.0)
    assert push.words(1.1) == "1 N on pole <-"
    assert not push.wrench(1.0 + LENGTH).any()
    for factor, bound in ((2.0, STRONGEST), (0.5, WEAKEST)):
        for _ in range(30):
            push.change_size(factor)
        assert push.size == bound


# Replays


def test_a_replay_shows_the_recorded_rows() -> None:
    what = experiment(duration=0.5)
    run = recorded(what)
    replay = RecordedRun(what.plant.model, run)
    for row in (0, 7, 130, 499):
        np.testing.assert_array_equal(replay.state, physics_of(run)[row])
        replay.advance({0: 0.007, 7: 0.123, 130: 0.3694, 499: 0.0}[row])
    assert replay.note == ""
    replay.sideways(1)
    assert replay.note == "the end of the run"
    np.testing.assert_array_equal(replay.state, physics_of(run)[-1])
    replay.sideways(-1)
    replay.stronger(2.0)
    assert replay.time == max(0.0, 0.5 - JUMP)


def test_a_replay_tells_why_its_run_ended() -> None:
    what = experiment(duration=0.05)
    replay = RecordedRun(what.plant.model, recorded(what), "the law is undefined")
    replay.advance(1.0)
    assert replay.note == "the law is undefined"
    replay.restart()
    assert (replay.note, replay.time) == ("", 0.0)


def test_what_was_not_recorded_cannot_be_replayed() -> None:
    what = experiment(duration=0.05)
    run = simulate(what.plant.analytic(), what.controller, what.x0, duration=0.05, engine="python")
    with pytest.raises(ArgumentError, match="only a single run on a plant in MuJoCo"):
        RecordedRun(what.plant.model, run)


# Keys


def test_the_keys_are_glfws() -> None:
    glfw = pytest.importorskip("glfw", exc_type=ImportError)
    names = {
        "space": "SPACE KP_", ".": "PERIOD", "+": "EQUAL KP_ADD", "-": "MINUS KP_SUBTRACT",
        "backspace": "BACKSPACE", "left": "LEFT", "right": "RIGHT", "up": "UP", "down": "DOWN",
    }  # fmt: skip
    for key in KEYS:
        known = [f"KEY_{name}" for name in names[key.names].split() if name != "KP_"]
        assert {getattr(glfw, name) for name in known} <= set(key.codes)


def test_no_code_means_two_things() -> None:
    codes = [code for key in KEYS for code in key.codes]
    assert len(codes) == len(set(codes))


@pytest.mark.parametrize("key", KEYS, ids=lambda key: key.names)
def test_every_key_stands_in_the_help(key: Any) -> None:
    told = (ViewCommand.__doc__ or "").split("Keys:")[1].split("Attributes:")[0].lower()
    told = " ".join(told.split())
    assert f"{key.names} " in told


def test_keys_do_what_they_say() -> None:
    playback, live = Playback(), experiment("servo", "nominal").live()
    for code in (UP, UP, DOWN, RIGHT, 61, 61, 45, SPACE, 999):
        press(code, playback, live)
    assert (live.push.size, playback.speed, playback.paused) == (2.0, 2.0, True)
    assert live.push.words(live.time).endswith("->")
    press(46, playback, live)
    live.advance(playback.elapsed(0.0))
    assert live.time == pytest.approx(2 * PICTURE, abs=1e-3)
    press(BACKSPACE, playback, live)
    assert live.time == 0.0


# The window


class Fake:
    """A window that stays open for some pictures, with a clock that only waiting moves."""

    def __init__(self, at: Callable[[Fake], None], count: int = 60) -> None:
        self.now, self.pictures, self.count, self.at = 0.0, 0, count, at
        self.closed, self.texts = False, []

    @contextmanager
    def open(
        self, model: mujoco.MjModel, data: mujoco.MjData, key: Callable[[int], None]
    ) -> Iterator[Fake]:
        self.model, self.data, self.key = model, data, key
        yield self
        self.closed = True

    def is_running(self) -> bool:
        return self.pictures < self.count

    def sync(self) -> None:
        self.pictures += 1
        self.at(self)

    def set_texts(self, texts: Any) -> None:
        self.texts.append(texts)

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: float) -> None:
        self.now += seconds


def shown(motion: Any, at: Callable[[Fake], None] = lambda _: None, **options: Any) -> Fake:
    fake = Fake(at, options.pop("count", 60))
    play(motion, window=fake.open, clock=fake.clock, wait=fake.wait, **options)
    assert fake.closed
    return fake


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_the_motion_keeps_step_with_the_clock(speed: float) -> None:
    live = experiment("servo", "nominal").live()
    shown(live, speed=speed)
    # 59 pictures after the first; the last timestep may not be over.
    assert 59 * PICTURE * speed - live.time == pytest.approx(5e-4, abs=5.1e-4)


def test_the_window_draws_the_state() -> None:
    live = experiment().live()
    fake = shown(live)
    np.testing.assert_array_equal(np.concatenate([fake.data.qpos, fake.data.qvel]), live.x)
    _, _, names, values = fake.texts[-1]
    assert names.split("\n") == ["time", "force", "|s|", "push", "speed"]
    assert values.split("\n")[-1] == "1x"


def test_what_the_window_does_to_its_data_never_reaches_the_physics() -> None:
    what, runs = experiment(), []
    for at in (lambda _: None, lambda fake: mujoco.mj_resetData(fake.model, fake.data)):
        live = what.live()
        shown(live, at)
        runs.append(live.state)
    np.testing.assert_array_equal(*runs)


def test_the_window_follows_the_cart() -> None:
    model, free = MujocoPlant.load("cart_pendulum").model, mujoco.MjvCamera()
    data, scene, option = mujoco.MjData(model), mujoco.MjvScene(model, 1000), mujoco.MjvOption()
    mujoco.mj_forward(model, data)
    aim(free, model, data)
    data.qpos[0] = 3.0
    mujoco.mj_forward(model, data)
    for _ in range(200):
        mujoco.mjv_updateScene(
            model, data, option, None, free, mujoco.mjtCatBit.mjCAT_STATIC.value, scene
        )
    assert free.lookat[0] == pytest.approx(3.0, abs=1e-3)


def test_the_window_looks_at_what_is_seen_of_a_machine() -> None:
    """Its motors are at the origin of the world, without anything to see."""
    found = []
    for parts in ((), (Transmission("joint", 0.01, stiffness=100.0),)):
        model, free = MujocoPlant.load("arm", edits=parts).model, mujoco.MjvCamera()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        aim(free, model, data)
        found.append([*free.lookat, free.distance, free.azimuth, free.elevation])
    np.testing.assert_allclose(*found, rtol=1e-12)


@pytest.mark.parametrize("system", ["servo", "arm", "two_link_arm"])
def test_the_window_begins_with_the_picture_of_the_models_camera(system: str) -> None:
    """The same line of sight, and at the body's depth the same height of the picture."""
    model, free = MujocoPlant.load(system).model, mujoco.MjvCamera()
    data, scene, option = mujoco.MjData(model), mujoco.MjvScene(model, 1000), mujoco.MjvOption()
    mujoco.mj_forward(model, data)
    aim(free, model, data)
    fixed = mujoco.MjvCamera()
    fixed.type, fixed.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, model.camera("fixed").id
    seen = []
    for camera in (fixed, free):
        every = mujoco.mjtCatBit.mjCAT_STATIC.value
        mujoco.mjv_updateScene(model, data, option, None, camera, every, scene)
        view = scene.camera[0]
        height = visible_height(view, free.lookat)
        seen.append(np.concatenate([np.array(view.forward), [height]]))
    np.testing.assert_allclose(*seen, rtol=0, atol=1e-5)


def test_keys_pressed_in_the_window_arrive() -> None:
    def at(fake: Fake) -> None:
        if fake.pictures == 30:
            fake.key(SPACE)

    live = experiment("servo", "nominal").live()
    fake = shown(live, at)
    assert live.time == pytest.approx(29 * PICTURE, abs=1.1e-3)
    assert fake.texts[-1][3].endswith("1x paused")


def test_ctrl_c_closes_the_window_in_good_order() -> None:
    def at(fake: Fake) -> None:
        raise KeyboardInterrupt

    assert shown(experiment("servo", "nominal").live(), at).pictures == 1


def test_a_motion_that_stops_is_told_once_and_in_the_window() -> None:
    what, said = experiment(duration=0.1), []
    fake = shown(RecordedRun(what.plant.model, recorded(what)), say=said.append)
    assert said == ["the end of the run"]
    assert "the end of the run" in fake.texts[-1][3]


# Without a display


@pytest.fixture
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


@pytest.mark.usefixtures("no_display")
def test_without_a_display_it_says_so_and_offers_the_film(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main(["view", "arm/case2", "--controller", "lqr", "--surface", "discrete"])
    assert stop.value.code == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    told, film = line.strip().split("; for a film of it run: ")
    assert told.startswith("grosmc-mj: there is no display")
    command = parse(film.split()[1:])
    assert isinstance(command, FilmCommand)
    assert (command.target, command.controllers) == ("arm/case2", ("lqr",))
    assert command.surface == "discrete"


def test_a_display_that_cannot_be_opened_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process of its own: GLFW keeps what it has found out."""
    monkeypatch.setenv("DISPLAY", ":987")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    program = "from grosmc_mj.viewer import require_display; require_display()"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert "SetupError" in done.stderr
    assert done.returncode == 1


def test_on_macos_it_asks_for_mujocos_interpreter(monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = pytest.importorskip("mujoco.viewer", exc_type=ImportError)
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(theirs, "_MJPYTHON", None)
    with pytest.raises(SetupError, match=r"mjpython -m grosmc_mj\.cli"):
        require_display()


@pytest.mark.parametrize(
    "arguments", [["nothing"], ["arm", "--speed", "0"], ["arm/case9"],
                  ["arm", "--controller", "nothing"], ["arm", "--switching", "nothing"]],
)  # fmt: skip
def test_wrong_use_is_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        cli.main(["view", *arguments])
    assert stop.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_replay_is_recorded_first(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[Any] = []
    monkeypatch.setattr(viewer, "require_display", lambda: None)
    monkeypatch.setattr(viewer, "play", lambda motion, **_: found.append(motion))
    for more in ([], ["--replay"]):
        with pytest.raises(SystemExit) as stop:
            cli.main(["view", "servo/nominal", *more])
        assert stop.value.code == 0
    assert [type(each) for each in found] == [Live, RecordedRun]


# With a display of the test's own


@pytest.fixture
def display() -> Iterator[str]:
    """A virtual display."""
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed: apt-get install xvfb")
    name = f":{900 + os.getpid() % 90}"
    with subprocess.Popen(
        ["Xvfb", name, "-screen", "0", "320x240x24"], stderr=subprocess.DEVNULL
    ) as server:
        time.sleep(2)
        if server.poll() is not None:
            pytest.skip(f"Xvfb does not start on {name}")
        yield name
        server.terminate()


PROGRAM = """
import contextlib
import os
from grosmc_mj.films.offscreen import without_graphics
with without_graphics():
    import mujoco
from grosmc_mj.viewer import Live, open_window, play
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.cases.cart_pendulum.cart import holding_lqr
plant = MujocoPlant.load("cart_pendulum")
live = Live(plant, holding_lqr(plant.analytic()), (0, 0.1, 0, 0), duration=1.0)
class Some:
    def __init__(self, window): self.window, self.left = window, 30
    def is_running(self): return self.left > 0 and self.window.is_running()
    def sync(self): self.left -= 1; self.window.sync()
    def set_texts(self, texts): self.window.set_texts(texts)
@contextlib.contextmanager
def some(*arguments):
    with open_window(*arguments) as window:
        yield Some(window)
play(live, window=some)
print(live.time)
"""


@pytest.mark.slow
@pytest.mark.render
def test_mujocos_window_opens_after_an_import_without_graphics(display: str) -> None:
    environment = {**os.environ, "DISPLAY": display}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True,
        check=False, timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) > 0.3
