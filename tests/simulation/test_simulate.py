"""The one entry: what it refuses, and what becomes of runs that cannot be finished."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
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
from grosmc_mj.simulation.problem import Meters
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

each_engine = pytest.mark.parametrize("engine", ["native", "python"])
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
def folder_for_the_log_of_mujoco(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
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
    other: float = 0.0


@dataclass(frozen=True)
class GainLast:
    other: float
    k: float


def constant(t: float, x: Any, memory: Any, p: Any) -> float:
    return p.k


@dataclass
class Noted:
    steps: float = 0.0
    last: float = -1.0
    effort: float = 0.0


@dataclass(frozen=True)
class Weight:
    r: float = 2.0


def note(t: float, x: Any, u: Any, memory: Any, p: Any, meters: Any, known: Any) -> None:
    meters.steps += 1.0
    meters.last = t
    meters.effort += known.r * u[0] * u[0]


SERVO, ARM, LQR = physics("servo"), physics("arm"), controller("servo", "lqr")
# With the sign of a large gain turned round: poles at +126/s.
AWAY = replace(LQR, parameters=replace(LQR.parameters, K=-10 * LQR.parameters.K))
HOLD, HUGE = (Controller("k", constant, Gain(k)) for k in (1.0, 1e300))
EVERY_2_MS = replace(LQR, design=replace(LQR.designed, control_period=2e-3))
LOAD, TWO = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -1.0, 0.0)), np.zeros((2, 2))
UNLIKE = [Meters(note, Noted(), Weight()), Meters(note, Noted(), Noted())]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"engine": "nativ"}, r"unknown engine 'nativ': did you mean 'native'\? valid: native, py"),
        ({"x0": [0.0, 0.0, 0.0]}, r"must be 2 finite numbers for servo: θ \[rad\], θ̇ \[rad/s\]"),
        ({"x0": [0.0, math.nan]}, r"x0 = \[0\.0, nan\] must be 2 finite .* θ̇ \[rad/s\]"),
        ({"control_period": 1.5e-3}, r"0\.0015 s is no multiple of .* 0\.001 s: take 0\.002 s"),
        ({"control_period": 0.0}, "control_period = 0 must be above 0 to 1e\\+09 s"),
        ({"duration": 0.0}, "duration = 0 must be from 1e-09 to 1e\\+09 s"),
        ({"duration": 1e7}, r"duration 1e\+07 s is 1e\+10 timesteps of 0\.001 s: at most 1e\+08"),
        ({"timestep": 2e-3}, r"timestep 0\.002 s is not the model's 0\.001 s: load the plant"),
        ({"threads": -1}, "threads = -1 must be a whole number from 0 to 1024"),
        ({"plant": "servo"}, "plant = 'servo' must be a plant or a list of them"),
        ({"controller": lambda *_: 0.0}, "make one of a law with custom_controller"),
        ({"record": "no"}, "record = 'no' must be True or False"),
        ({"meters": 3}, "meters = 3 must be Meters or a list of them"),
        *(({"disturbances": bad}, "must be a list of Disturbances")
          for bad in ("load", LOAD, [LOAD, [LOAD]])),
        ({"plant": SERVO.analytic(), "timestep": 0.0}, "timestep = 0 must be from 1e-09 to 1e"),
        # A batch.
        ({"controller": 3 * [LQR], "x0": TWO}, "1 plants, 3 controllers, 1 .* and 2 starts: each"),
        ({"plant": []}, "0 plants"),
        ({"plant": [SERVO, ARM]}, "of one system and of one kind"),
        ({"plant": [SERVO, SERVO.analytic()]}, "of one system and of one kind"),
        ({"plant": [SERVO, MujocoPlant.load("servo", timestep=2e-3)]}, "must have one timestep"),
        ({"plant": ARM}, "lqr is designed for servo, the plant is arm"),
        ({"controller": [LQR, controller("servo", "grosmc")]}, "must have the same law"),
        ({"controller": [HOLD, replace(HOLD, memory=Remembering)]}, "the same kind of memory"),
        ({"controller": [HOLD, replace(HOLD, parameters=GainLast(2.0, 1.0))]}, "kinds of numbers"),
        ({"x0": TWO, "meters": UNLIKE}, "the same kind of meters"),
        ({"controller": EVERY_2_MS}, r"is designed for a control period of 0\.002 s, not 0\.001"),
    ],
)  # fmt: skip
def test_bad_argument_is_refused_with_its_value(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        start_servo(**changes)


def test_a_model_or_spec_that_was_changed_in_place_is_refused() -> None:
    plant = MujocoPlant(SERVO.system, load_spec("servo"))
    mass = plant.model.body("rotor").mass
    for factor in (2.0, 0.5):
        mass *= factor
        if factor > 1:
            with pytest.raises(ModelError, match=r"plant.model was changed .* use plant.edited"):
                start_servo(plant=plant)
    start_servo(plant=plant)
    plant.spec.body("rotor").mass = 3.0
    with pytest.raises(ModelError, match=r"plant.spec was changed in place"):
        start_servo(plant=plant)


@each_engine
@pytest.mark.parametrize("kind", ["passive", "act_bias", "sensor"])
def test_somebody_else_s_callback_is_refused(kind: str, engine: Engine) -> None:
    """It would add forces that neither the law nor the equations know of."""
    install = getattr(mujoco, f"set_mjcb_{kind}")
    install(lambda *_: 0)
    try:
        with pytest.raises(SetupError, match=f"a MuJoCo {kind} callback .*set_mjcb_{kind}"):
            start_servo(engine=engine)
    finally:
        install(None)


@each_engine
@pytest.mark.parametrize("stride", [1, 2])
def test_meters_note_every_timestep_whatever_is_recorded(engine: Engine, stride: int) -> None:
    meters, x0 = [Meters(note, Noted(), Weight(r)) for r in (1, 2)], [[0.1, 0.0], [0.2, 0.3]]
    options: dict[str, Any] = {"x0": x0, "engine": engine, "control_period": stride * 1e-3}
    recorded = start_servo(**options)
    assert recorded.meters is None
    for record in (False, True):
        noted: Any = start_servo(**options, meters=meters, record=record).meters
        np.testing.assert_array_equal(noted["steps"], 10.0)
        np.testing.assert_array_equal(noted["last"], 9 * 1e-3)
        effort = np.sum(recorded.input**2, axis=1) * [1, 2]
        np.testing.assert_allclose(noted["effort"], effort, rtol=1e-12)


@pytest.mark.parametrize(
    # 0.0033/3e-4 is a little more than 11 in binary.
    ("duration", "h", "steps"),
    [(0.3, 1e-3, 300), (0.0101, 1e-3, 11), (1e-5, 1e-3, 1), (0.0033, 3e-4, 11), (0.004, 3e-4, 14)],
)
def test_duration_is_rounded_up_to_whole_timesteps_but_not_for_rounding(
    duration: float, h: float, steps: int
) -> None:
    run = start_servo(duration=duration, plant=SERVO.analytic(), timestep=h)
    np.testing.assert_array_equal(run.time, np.arange(steps + 1) * h)
    assert (run.state.shape, run.command.shape) == ((steps + 1, 2), (steps,))


def test_one_simulation_in_a_list_is_a_batch_of_one() -> None:
    """There is an axis more whenever a sequence was the argument."""
    alone = start_servo(controller=EVERY_2_MS, control_period=1e-3 + 1e-3)
    for changes in ({"x0": [[0.0, 0.0]]}, {"plant": [SERVO]}):
        together = start_servo(controller=EVERY_2_MS, control_period=2e-3, **changes)
        assert len(together) == 1
        np.testing.assert_array_equal(together.state[0], alone.state)
    with pytest.raises(TypeError, match="one run has no length"):
        len(alone)


# Runs that end early


def run_both(kind: str, system: str, law: Controller, starts: Any, **options: Any) -> Trajectory:
    """A batch in the native engine, on which the Python engine agrees."""
    native, python = (
        simulate(
            plant_of(system, kind), law, starts, engine=engine, **{"duration": 0.25, **options}
        )
        for engine in ("native", "python")
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
        *(("cart_pendulum", controller("cart_pendulum", law), SWINGS_THROUGH,
           Status.UNDEFINED_LAW, r"the law is undefined outside \|theta\| < pi/2")
          for law in ("fl-lqr", "grosmc")),
        ("arm", controller("arm", "lqr"), [1.5, 40.0], Status.SINGULAR_PLANT,
         "the plant is singular at q >= pi/2, where the cable"),
        ("servo", AWAY, [0.0, 0.0], Status.DIVERGED,
         r"servo under lqr at t = 0.*try a smaller control period or timestep"),
        ("servo", replace(HOLD, parameters=Gain(math.inf)), [0.0, 0.0], Status.UNDEFINED_INPUT,
         r"t = 0 s: the law returned no finite number at x = \(0, 0\)"),
    ],
)  # fmt: skip
def test_a_single_run_that_ends_early_raises_with_what_was_recorded(
    system: str, law: Controller, x0: Any, status: Status, words: str, kind: str, engine: Engine
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
@pytest.mark.parametrize(
    ("system", "law", "starts", "T", "ends"),
    [
        # Farther out, earlier; the second one starts at rest on the target.
        ("servo", AWAY, [[0.0, 0.0], [1.0, 0.0], [0.99, 0.0]], 1e-3, None),
        # The law notices at its next sample.
        *(("cart_pendulum", controller("cart_pendulum", "fl-lqr"),
           [SWINGS_THROUGH, UPRIGHT, BEYOND], T, (math.ceil(END / T - 1e-9) * T, 0.25, 0.0))
          for T in (1e-3, 5e-3)),
    ],
)  # fmt: skip
def test_a_run_of_a_batch_that_ends_early_is_a_status_and_leaves_the_others_alone(
    system: str, law: Controller, starts: Any, T: float, ends: Any, kind: str
) -> None:
    together = run_both(kind, system, law, starts, control_period=T)
    early = Status.UNDEFINED_LAW if ends else Status.DIVERGED
    assert list(together.status) == [early, Status.COMPLETED, early]
    if ends:
        np.testing.assert_allclose(together.valid_until, ends, atol=1e-12)
    else:
        assert together.valid_until[0] < together.valid_until[2] < together.valid_until[1] == 0.25
    # After the end the rows repeat the last valid ones.
    for state, command, end in zip(
        together.state, together.command, together.valid_until, strict=True
    ):
        last = round(end / 1e-3)
        np.testing.assert_array_equal(state[last:], [state[last]] * (251 - last))
        assert np.all(command[last:] == (command[last - 1] if last else 0.0))
    alone = simulate(plant_of(system, kind), law, starts[1], duration=0.25, control_period=T)
    np.testing.assert_array_equal(together.state[1], alone.state)
    np.testing.assert_array_equal(together.command[1], alone.command)


@each_engine
def test_overflow_within_a_step_is_a_divergence(engine: Engine) -> None:
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
    run = run_both(kind, "cart_pendulum", law, [SWINGS_THROUGH, UPRIGHT], disturbances=[kick])
    assert list(run.status) == [Status.UNDEFINED_LAW, Status.DIVERGED]
    np.testing.assert_allclose(run.valid_until, [END, 0.15], atol=1e-12)
