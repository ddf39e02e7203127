"""``simulate``: its refusals, and the ends of runs that cannot be finished."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pytest

from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.ground.errors import (
    ArgumentError,
    DivergenceError,
    ModelError,
    SetupError,
    UndefinedLawError,
)
from grosmc_mj.mechanics.physics.files import load_spec
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.memory import Memory
from grosmc_mj.theory.plants import AnalyticPlant

ENGINES: Any = ("native", "python")
each_engine = pytest.mark.parametrize("engine", ENGINES)
each_kind = pytest.mark.parametrize("kind", ["corrected", "physics"])

# The pole passes -pi/2 under fl-lqr, and the run ends early.
SWINGS_THROUGH = [0.0, -0.1, 0.0, -20.0]
END = 0.092
UPRIGHT = [0.0, 0.1, 0.0, 0.0]
BEYOND = [0.0, 1.6, 0.0, 0.0]  # outside |theta| < pi/2 from the start


@cache
def physics(system: str) -> MujocoPlant:
    return MujocoPlant.load(system)


def plant_of(system: str, kind: str) -> MujocoPlant | AnalyticPlant:
    plant = physics(system)
    if kind == "physics":
        return plant
    return plant.analytic()


@cache
def controller(system: str, law: str) -> Controller:
    return chapter_controller(law, physics(system).analytic())


@pytest.fixture(autouse=True)
def folder_for_the_log_of_mujoco(monkeypatch, tmp_path) -> None:
    """MuJoCo writes MUJOCO_LOG.TXT where a diverging run is started."""
    monkeypatch.chdir(tmp_path)


def start_servo(**changes: Any) -> Trajectory:
    """A valid call with some arguments changed."""
    valid: dict[str, Any] = {
        "plant": SERVO,
        "controller": LQR,
        "x0": [0.0, 0.0],
        "duration": 0.01,
    }
    return simulate(**(valid | changes))


@dataclass
class Remembering(Memory):
    last: float = 0.0


@dataclass(frozen=True)
class Gain:
    k: float


def constant(t: float, x: Any, memory: Any, p: Any) -> float:
    return p.k


SERVO = physics("servo")
ARM = physics("arm")
LQR = controller("servo", "lqr")
EVERY_2_MS = replace(LQR, design=replace(LQR.designed, control_period=2e-3))
# With the sign of a large gain turned round: poles at +126/s.
AWAY = replace(LQR, parameters=replace(LQR.parameters, K=-10 * LQR.parameters.K))
HOLD = Controller("k", constant, Gain(1.0))
HUGE = Controller("k", constant, Gain(1e300))
ENDLESS = replace(HOLD, parameters=Gain(math.inf))
LOAD = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -1.0, 0.0))
TWO = np.zeros((2, 2))


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
        ({"controller": 3 * [LQR], "x0": TWO}, "1 plant, 3 controllers, 1 .* and 2 starts: each"),
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


def test_a_model_that_was_changed_in_place_is_refused() -> None:
    plant = MujocoPlant(SERVO.system, load_spec("servo"))
    mass = plant.model.body("rotor").mass
    mass *= 2
    with pytest.raises(ModelError, match=r"plant.model was changed .* use plant.changed"):
        start_servo(plant=plant)

    mass /= 2
    start_servo(plant=plant)


def test_a_spec_that_was_changed_in_place_is_refused() -> None:
    plant = MujocoPlant(SERVO.system, load_spec("servo"))
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


@pytest.mark.parametrize(
    ("duration", "timestep", "steps"),
    [
        (0.0101, 1e-3, 11),
        (1e-5, 1e-3, 1),
        # The quotient is a little more than 11 in binary.
        (0.0033, 3e-4, 11),
    ],
)
def test_duration_is_rounded_up_to_full_timesteps(
    duration: float, timestep: float, steps: int
) -> None:
    run = start_servo(duration=duration, plant=SERVO.analytic(), timestep=timestep)
    np.testing.assert_array_equal(run.time, np.arange(steps + 1) * timestep)
    assert (run.state.shape, run.command.shape) == ((steps + 1, 2), (steps,))


@pytest.mark.parametrize("changes", [{"x0": [[0.0, 0.0]]}, {"plant": [SERVO]}])
def test_a_list_of_one_is_a_batch_of_one(changes: dict[str, Any]) -> None:
    single = start_servo()
    batch = start_servo(**changes)
    assert len(batch) == 1
    np.testing.assert_array_equal(batch.state[0], single.state)
    with pytest.raises(TypeError, match="one run has no length"):
        len(single)


# Runs that end early


class EarlyEnd(NamedTuple):
    """A run that ends early: its arguments, and its end."""

    system: str
    law: Controller
    x0: list[float]
    status: Status
    error: type[Exception]
    words: str
    end: float | None


LEAVES_ITS_DOMAIN = EarlyEnd(
    system="cart_pendulum",
    law=controller("cart_pendulum", "grosmc"),
    x0=SWINGS_THROUGH,
    status=Status.UNDEFINED_LAW,
    error=UndefinedLawError,
    words=r"the law is undefined outside \|theta\| < pi/2",
    end=END,
)
STRETCHED = EarlyEnd(
    system="arm",
    law=controller("arm", "lqr"),
    x0=[1.5, 40.0],
    status=Status.SINGULAR_PLANT,
    error=UndefinedLawError,
    words="the plant is singular at q >= pi/2, where the cable",
    # (pi/2 - 1.5)/40 is 1.8 ms.
    end=2e-3,
)
RUNS_AWAY = EarlyEnd(
    system="servo",
    law=AWAY,
    x0=[0.0, 0.0],
    status=Status.DIVERGED,
    error=DivergenceError,
    words=r"servo under lqr at t = 0.*the loop is unstable, or its control period",
    end=None,
)
RETURNS_INFINITY = EarlyEnd(
    system="servo",
    law=ENDLESS,
    x0=[0.0, 0.0],
    status=Status.UNDEFINED_INPUT,
    error=UndefinedLawError,
    words=r"t = 0 s: the law returned no finite number at x = \(0, 0\)",
    end=0.0,
)
each_early_end = pytest.mark.parametrize(
    "case", [LEAVES_ITS_DOMAIN, STRETCHED, RUNS_AWAY, RETURNS_INFINITY]
)


def error_of(case: EarlyEnd, kind: str, engine: Any) -> Any:
    """Error that a single run ends with."""
    plant = plant_of(case.system, kind)
    with pytest.raises(case.error, match=case.words) as raised:
        simulate(plant, case.law, case.x0, duration=0.25, engine=engine)
    return raised.value


def run_both(kind: str, system: str, law: Controller, starts: Any, **options: Any) -> Trajectory:
    """A batch in the native engine, on which the Python engine agrees."""
    plant = plant_of(system, kind)
    options = {"duration": 0.25, **options}
    native = simulate(plant, law, starts, engine="native", **options)
    python = simulate(plant, law, starts, engine="python", **options)
    for name in ("status", "valid_until", "state", "command"):
        np.testing.assert_array_equal(getattr(native, name), getattr(python, name))

    for name in ("time", "state", "command", "input", "sliding", "weighed", "physics"):
        values = getattr(native, name)
        assert values is None or np.all(np.isfinite(values)), name

    if native.physics is not None:
        # MuJoCo's rows are time, positions and velocities, after an early end too.
        np.testing.assert_array_equal(native.physics[..., 1:], native.state)
    return native


@each_engine
@each_kind
@each_early_end
def test_a_single_run_that_ends_early_raises_with_its_record(
    case: EarlyEnd, kind: str, engine: Any
) -> None:
    error = error_of(case, kind, engine)
    run = error.trajectory
    assert run.status is case.status
    assert run.time[-1] == error.time
    assert run.valid_until == error.time
    assert len(run.command) == len(run.time) - 1 == round(error.time / 1e-3)
    assert case.end in (None, error.time)


@each_kind
def test_a_divergence_ends_near_the_bound_of_mujoco(kind: str) -> None:
    """The angle grows as exp(126 t) from 1 rad."""
    run = error_of(RUNS_AWAY, kind, "native").trajectory
    assert 1e6 < np.abs(run.state[-1, 1]) < 1e10


@each_kind
def test_the_state_that_the_law_refused_is_the_first_outside(kind: str) -> None:
    run = error_of(LEAVES_ITS_DOMAIN, kind, "native").trajectory
    outside = np.abs(run.state[:, 1]) >= math.pi / 2
    np.testing.assert_array_equal(outside, run.time == run.time[-1])


@pytest.mark.parametrize("record", [True, False])
@each_kind
@each_early_end
def test_a_batch_ends_where_its_single_runs_end(case: EarlyEnd, kind: str, record: bool) -> None:
    end = error_of(case, kind, "native").time
    batch = run_both(kind, case.system, case.law, [case.x0, case.x0], record=record)
    assert list(batch.status) == [case.status, case.status]
    assert batch.valid_until.tolist() == [end, end]


SLOWLY: dict[str, Any] = {"duration": 0.25, "control_period": 5e-3}


def three_pendulums(kind: str) -> Trajectory:
    """A batch of which the first and the last run end early."""
    law = controller("cart_pendulum", "fl-lqr")
    return run_both(kind, "cart_pendulum", law, [SWINGS_THROUGH, UPRIGHT, BEYOND], **SLOWLY)


@each_kind
def test_a_law_of_a_batch_notices_at_its_next_sample(kind: str) -> None:
    batch = three_pendulums(kind)
    early = Status.UNDEFINED_LAW
    assert list(batch.status) == [early, Status.COMPLETED, early]
    np.testing.assert_allclose(batch.valid_until, (0.095, 0.25, 0.0), atol=1e-12)


@each_kind
def test_rows_after_an_early_end_repeat_the_last_valid_one(kind: str) -> None:
    batch = three_pendulums(kind)
    for state, command, end in zip(batch.state, batch.command, batch.valid_until, strict=True):
        last = round(end / 1e-3)
        np.testing.assert_array_equal(state[last:], [state[last]] * (251 - last))
        held = command[last - 1] if last else 0.0
        assert np.all(command[last:] == held)


@each_kind
def test_an_early_end_leaves_the_other_runs_alone(kind: str) -> None:
    batch = three_pendulums(kind)
    law = controller("cart_pendulum", "fl-lqr")
    single = simulate(plant_of("cart_pendulum", kind), law, UPRIGHT, **SLOWLY)
    np.testing.assert_array_equal(batch.state[1], single.state)
    np.testing.assert_array_equal(batch.command[1], single.command)


@each_engine
def test_overflow_within_a_step_is_a_divergence(engine: Any) -> None:
    """A stage of RK4 far beyond any angle: sin of it is NaN in C, a ValueError in Python."""
    pendulum = plant_of("cart_pendulum", "corrected")
    with pytest.raises(DivergenceError) as ended:
        simulate(pendulum, HUGE, UPRIGHT, duration=0.01, engine=engine)
    assert ended.value.time == 0


@each_kind
def test_run_ends_for_the_first_reason(kind: str) -> None:
    """A law that is undefined at 0.092 s is not blamed on a kick at 0.15 s."""
    kick = Disturbance("pole", (0.0, 0.0, 0.0, 0.0, 1e13, 0.0), Pulse(0.15, 0.2))
    law = controller("cart_pendulum", "fl-lqr")
    starts = [SWINGS_THROUGH, UPRIGHT]
    run = run_both(kind, "cart_pendulum", law, starts, disturbances=[kick])
    assert list(run.status) == [Status.UNDEFINED_LAW, Status.DIVERGED]
    np.testing.assert_allclose(run.valid_until, [END, 0.15], atol=1e-12)
