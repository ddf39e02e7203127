"""The one entry: its refusals, and the ends of runs that cannot be finished."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import (
    ArgumentError,
    DivergenceError,
    ModelError,
    SetupError,
    UndefinedLawError,
)
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.files import load_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

ENGINES: Any = ("native", "python")
each_engine = pytest.mark.parametrize("engine", ENGINES)
each_kind = pytest.mark.parametrize("kind", ["corrected", "physics"])

# A start of a run that ends early, as the pole passes -pi/2 under fl-lqr, and the end.
SWINGS_THROUGH, END = [0.0, -0.1, 0.0, -20.0], 0.092
UPRIGHT = [0.0, 0.1, 0.0, 0.0]
BEYOND = [0.0, 1.6, 0.0, 0.0]  # outside |theta| < pi/2 from the start


@cache
def physics(system: str) -> MujocoPlant:
    return MujocoPlant.load(system)


def plant_of(system: str, kind: str) -> MujocoPlant | AnalyticPlant:
    return physics(system) if kind == "physics" else physics(system).analytic()


@cache
def controller(system: str, law: str) -> Controller:
    return chapter_controller(law, physics(system).analytic())


@pytest.fixture(autouse=True)
def folder_for_the_log_of_mujoco(monkeypatch, tmp_path) -> None:
    """MuJoCo writes MUJOCO_LOG.TXT where a diverging run is started."""
    monkeypatch.chdir(tmp_path)


def start_servo(**changes: Any) -> Trajectory:
    """A valid call with some arguments changed."""
    valid: dict[str, Any] = {"plant": SERVO, "controller": LQR, "x0": [0.0, 0.0], "duration": 0.01}
    return simulate(**{**valid, **changes})


@dataclass
class Remembering(Memory):
    last: float = 0.0


@dataclass(frozen=True)
class Gain:
    k: float


def constant(t: float, x: Any, memory: Any, p: Any) -> float:
    return p.k


SERVO, ARM, LQR = physics("servo"), physics("arm"), controller("servo", "lqr")
# With the sign of a large gain turned round: poles at +126/s.
AWAY = replace(LQR, parameters=replace(LQR.parameters, K=-10 * LQR.parameters.K))
HOLD, HUGE = (Controller("k", constant, Gain(k)) for k in (1.0, 1e300))
EVERY_2_MS = replace(LQR, design=replace(LQR.designed, control_period=2e-3))
LOAD, TWO = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -1.0, 0.0)), np.zeros((2, 2))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engine": "nativ"}, r"unknown engine 'nativ': did you mean 'native'\? valid: native, py"),
        ({"x0": [0.0, math.nan]}, r"x0 = \[0\.0, nan\] must be 2 finite numbers .* θ̇ \[rad/s\]"),
        ({"control_period": 1.5e-3}, r"0\.0015 s is no multiple of .* 0\.001 s: take 0\.002 s"),
        ({"duration": 1e7}, r"duration 1e\+07 s is 1e\+10 timesteps of 0\.001 s: at most 1e\+08"),
        ({"timestep": 2e-3}, r"timestep 0\.002 s is not the model's 0\.001 s: load the plant"),
        ({"threads": -1}, "threads = -1 must be a whole number from 0 to 1024"),
        ({"controller": lambda *_: 0.0}, "make one of a law with custom_controller"),
        ({"disturbances": [LOAD, [LOAD]]}, "must be a list of Disturbances"),
        # A batch.
        ({"controller": 3 * [LQR], "x0": TWO}, "1 plants, 3 controllers, 1 .* and 2 starts: each"),
        ({"plant": []}, "0 plants"),
        ({"plant": [SERVO, ARM]}, "of one system and of one kind"),
        ({"plant": [SERVO, MujocoPlant.load("servo", timestep=2e-3)]}, "must have one timestep"),
        ({"plant": ARM}, "lqr is designed for servo, the plant is arm"),
        ({"controller": [LQR, controller("servo", "grosmc")]}, "must have the same law"),
        ({"controller": [HOLD, replace(HOLD, memory=Remembering)]}, "the same kind of memory"),
        ({"controller": [HOLD, replace(HOLD, parameters=Remembering())]}, "kinds of numbers"),
        ({"controller": EVERY_2_MS}, r"is designed for a control period of 0\.002 s, not 0\.001"),
    ],
)
def test_bad_argument_is_refused_with_its_value(changes, words) -> None:
    with pytest.raises(ArgumentError, match=words):
        start_servo(**changes)


def test_a_model_or_spec_that_was_changed_in_place_is_refused() -> None:
    plant = MujocoPlant(SERVO.system, load_spec("servo"))
    mass = plant.model.body("rotor").mass
    mass *= 2
    with pytest.raises(ModelError, match=r"plant.model was changed .* use plant.edited"):
        start_servo(plant=plant)
    mass /= 2
    start_servo(plant=plant)
    plant.spec.body("rotor").mass = 3.0
    with pytest.raises(ModelError, match=r"plant.spec was changed in place"):
        start_servo(plant=plant)


@each_engine
@pytest.mark.parametrize("kind", ["passive", "act_bias", "sensor"])
def test_somebody_else_s_callback_is_refused(kind, engine) -> None:
    """It would add forces that neither the law nor the equations know of."""
    install = getattr(mujoco, f"set_mjcb_{kind}")
    install(lambda *_: 0)
    try:
        with pytest.raises(SetupError, match=f"a MuJoCo {kind} callback .*set_mjcb_{kind}"):
            start_servo(engine=engine)
    finally:
        install(None)


def test_duration_is_rounded_up_to_full_timesteps_and_a_list_is_a_batch() -> None:
    """0.0033/3e-4 is a little more than 11 in binary."""
    for duration, h, steps in ((0.0101, 1e-3, 11), (1e-5, 1e-3, 1), (0.0033, 3e-4, 11)):
        alone = start_servo(duration=duration, plant=SERVO.analytic(), timestep=h)
        np.testing.assert_array_equal(alone.time, np.arange(steps + 1) * h)
        assert (alone.state.shape, alone.command.shape) == ((steps + 1, 2), (steps,))
    alone = start_servo()
    for changes in ({"x0": [[0.0, 0.0]]}, {"plant": [SERVO]}):
        together = start_servo(**changes)
        assert len(together) == 1
        np.testing.assert_array_equal(together.state[0], alone.state)
    with pytest.raises(TypeError, match="one run has no length"):
        len(alone)


# Runs that end early


def run_both(kind: str, system: str, law: Controller, starts: Any, **options: Any) -> Trajectory:
    """A batch in the native engine, on which the Python engine agrees."""
    options = {"duration": 0.25, **options}
    native, python = (
        simulate(plant_of(system, kind), law, starts, engine=engine, **options)
        for engine in ENGINES
    )
    for name in ("status", "valid_until", "state", "command"):
        np.testing.assert_array_equal(getattr(native, name), getattr(python, name))
    for name in ("time", "state", "command", "input", "sliding", "weighed", "physics"):
        values = getattr(native, name)
        assert values is None or np.all(np.isfinite(values)), name
    if native.physics is not None:
        # MuJoCo's own rows are time, positions and velocities, after an early end too.
        np.testing.assert_array_equal(native.physics[..., 1:], native.state)
    return native


@each_engine
@each_kind
@pytest.mark.parametrize(
    ("system", "law", "x0", "status", "words"),
    [
        ("cart_pendulum", controller("cart_pendulum", "grosmc"), SWINGS_THROUGH,
           Status.UNDEFINED_LAW, r"the law is undefined outside \|theta\| < pi/2"),
        ("arm", controller("arm", "lqr"), [1.5, 40.0], Status.SINGULAR_PLANT,
         "the plant is singular at q >= pi/2, where the cable"),
        ("servo", AWAY, [0.0, 0.0], Status.DIVERGED,
         r"servo under lqr at t = 0.*try a smaller control period or timestep"),
        ("servo", replace(HOLD, parameters=Gain(math.inf)), [0.0, 0.0], Status.UNDEFINED_INPUT,
         r"t = 0 s: the law returned no finite number at x = \(0, 0\)"),
    ],
)  # fmt: skip
def test_a_single_run_that_ends_early_raises_with_its_record(
    system, law, x0, status, words, kind, engine
) -> None:
    plant, diverged = plant_of(system, kind), status is Status.DIVERGED
    with pytest.raises(DivergenceError if diverged else UndefinedLawError, match=words) as ended:
        simulate(plant, law, x0, duration=0.25, engine=engine)
    run, end = ended.value.trajectory, ended.value.time
    assert run.status is status
    assert run.time[-1] == end == run.valid_until
    assert len(run.command) == len(run.time) - 1 == round(end / 1e-3)
    if diverged:  # exp(126 t) from 1 rad: the last valid speed is near MuJoCo's bound
        assert 1e6 < np.abs(run.state[-1, 1]) < 1e10
    if status is Status.SINGULAR_PLANT:  # (pi/2 - 1.5)/40 is 1.8 ms
        assert end == 2e-3
    if status is Status.UNDEFINED_LAW:  # the state that the law refused is the first outside
        assert np.array_equal(np.abs(run.state[:, 1]) >= math.pi / 2, run.time == run.time[-1])
    if engine == "native":
        for record in (True, False):
            batch = run_both(kind, system, law, [x0, x0], record=record)
            assert list(batch.status) == [status] * 2
            assert batch.valid_until.tolist() == [end] * 2


@each_kind
def test_a_run_of_a_batch_that_ends_early_is_a_status_and_leaves_the_others_alone(kind) -> None:
    """The law notices at its next sample; after the end the rows repeat the last valid ones."""
    law, starts = controller("cart_pendulum", "fl-lqr"), [SWINGS_THROUGH, UPRIGHT, BEYOND]
    together = run_both(kind, "cart_pendulum", law, starts, control_period=5e-3)
    early = Status.UNDEFINED_LAW
    assert list(together.status) == [early, Status.COMPLETED, early]
    np.testing.assert_allclose(together.valid_until, (0.095, 0.25, 0.0), atol=1e-12)
    for i, end in enumerate(together.valid_until):
        state, command, last = together.state[i], together.command[i], round(end / 1e-3)
        np.testing.assert_array_equal(state[last:], [state[last]] * (251 - last))
        assert np.all(command[last:] == (command[last - 1] if last else 0.0))
    plant = plant_of("cart_pendulum", kind)
    alone = simulate(plant, law, UPRIGHT, duration=0.25, control_period=5e-3)
    np.testing.assert_array_equal(together.state[1], alone.state)
    np.testing.assert_array_equal(together.command[1], alone.command)
    # Farther out, a run diverges earlier; the first one starts at rest on the target.
    diverged = run_both(kind, "servo", AWAY, [[1.0, 0.0], [0.0, 0.0], [0.99, 0.0]]).valid_until
    assert diverged[1] < diverged[2] < diverged[0] == 0.25


@each_engine
def test_overflow_within_a_step_is_a_divergence(engine) -> None:
    """A stage of RK4 far beyond any angle: sin of it is NaN in C, a ValueError in Python."""
    pendulum = plant_of("cart_pendulum", "corrected")
    with pytest.raises(DivergenceError) as ended:
        simulate(pendulum, HUGE, UPRIGHT, duration=0.01, engine=engine)
    assert ended.value.time == 0


@each_kind
def test_run_ends_for_the_first_reason(kind) -> None:
    """A law that is undefined at 0.092 s is not blamed on a kick at 0.15 s."""
    kick = Disturbance("pole", (0.0, 0.0, 0.0, 0.0, 1e13, 0.0), Pulse(0.15, 0.2))
    law = controller("cart_pendulum", "fl-lqr")
    run = run_both(kind, "cart_pendulum", law, [SWINGS_THROUGH, UPRIGHT], disturbances=[kick])
    assert list(run.status) == [Status.UNDEFINED_LAW, Status.DIVERGED]
    np.testing.assert_allclose(run.valid_until, [END, 0.15], atol=1e-12)
