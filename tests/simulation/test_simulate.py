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

# Starts of runs that end early, each with one that does not: [x0, t_end], ...
SWINGS_THROUGH = ([0.0, -0.1, 0.0, -20.0], 0.092)  # the pole passes -pi/2 under fl-lqr
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


@cache
def pushing_away() -> Controller:
    """The servo's LQR with the sign of a large gain turned round: poles at +126/s."""
    ctl = controller("servo", "lqr")
    return replace(ctl, parameters=replace(ctl.parameters, K=-10 * ctl.parameters.K))


@pytest.fixture(autouse=True)
def folder_for_the_log_of_mujoco(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """MuJoCo writes MUJOCO_LOG.TXT where a diverging run is started."""
    monkeypatch.chdir(tmp_path)


def start_servo(**changes: Any) -> Trajectory:
    """A valid call with some arguments changed."""
    valid: dict[str, Any] = {
        "plant": physics("servo"),
        "controller": controller("servo", "lqr"),
        "x0": [0.0, 0.0],
        "duration": 0.01,
    }
    return simulate(**{**valid, **changes})


# Arguments


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"engine": "nativ"}, r"unknown engine 'nativ': did you mean 'native'\? valid: native, py"),
        ({"x0": [0.0, 0.0, 0.0]}, r"must be 2 finite numbers for servo: θ \[rad\], θ̇ \[rad/s\]"),
        ({"x0": 0.0}, r"x0 = 0 must be 2 finite numbers"),
        ({"x0": []}, r"x0 = \[\] must be 2 finite numbers"),
        ({"x0": [0.0, math.nan]}, r"x0 = \[0\.0, nan\] must be 2 finite .* θ̇ \[rad/s\]"),
        ({"x0": [[0.0, 0.0], [math.inf, 0.0]]}, r"\[inf, 0\.0\]\] must be 2 finite"),
        ({"x0": [[[0.0, 0.0]]]}, "must be 2 finite numbers"),
        ({"control_period": 1.5e-3}, r"0\.0015 s is no multiple of .* 0\.001 s: take 0\.002 s"),
        ({"control_period": 4e-4}, r"take 0\.001 s"),
        ({"control_period": 0.0}, "control_period = 0 must be above 0 to 1e\\+09 s"),
        ({"control_period": -1e-3}, r"control_period = -0\.001 must be above 0"),
        ({"control_period": math.nan}, "control_period = nan must be above 0"),
        ({"control_period": math.inf}, "control_period = inf must be above 0"),
        ({"duration": -1.0}, "duration = -1 must be from 1e-09 to 1e\\+09 s"),
        ({"duration": 0.0}, "duration = 0 must be from"),
        ({"duration": math.inf}, "duration = inf must be from"),
        ({"duration": math.nan}, "duration = nan must be from"),
        ({"timestep": 2e-3}, r"timestep 0\.002 s is not the model's 0\.001 s: load the plant"),
        ({"threads": -1}, "threads = -1 must be a whole number from 0 to 1024"),
        ({"threads": 1.5}, r"threads = 1\.5 must be a whole number"),
        ({"threads": True}, "threads = True must be a whole number"),
        ({"duration": 1e-300}, "duration = 1e-300 must be from 1e-09 to 1e\\+09 s"),
        ({"duration": "1"}, "duration = '1' must be from"),
        ({"control_period": 1e300}, "control_period = 1e\\+300 must be above 0 to 1e\\+09 s"),
        ({"timestep": "1"}, "timestep = '1' must be from 1e-09"),
        ({"engine": None}, "unknown engine None: valid: native, python"),
        ({"plant": "servo"}, "plant = 'servo' must be a plant or a list of them"),
        ({"plant": {1, 2}}, r"plant = \{1, 2\} must be a plant"),
        ({"controller": lambda *_: 0.0}, "make one of a law with custom_controller"),
        ({"x0": ["0", "0"]}, r"x0 = \['0', '0'\] must be 2 finite numbers"),
        ({"record": "no"}, "record = 'no' must be True or False"),
    ],
)
def test_bad_argument_is_refused_with_its_value(changes, message):
    with pytest.raises(ArgumentError, match=message):
        start_servo(**changes)


@pytest.mark.parametrize("timestep", [0.0, -1e-3, math.nan])
def test_timestep_of_an_analytic_plant_must_be_positive(timestep):
    with pytest.raises(ArgumentError, match=r"timestep = .* must be from 1e-09 to 1e"):
        start_servo(plant=physics("servo").analytic(), timestep=timestep)


@pytest.mark.parametrize("timestep", [1e-300, 1e300, "1e-3"])
def test_timestep_beyond_every_bound_is_refused(timestep):
    with pytest.raises(ArgumentError, match=r"timestep = .* must be from 1e-09 to 1e"):
        start_servo(plant=physics("servo").analytic(), timestep=timestep)


@dataclass
class Remembering(Memory):
    last: float = 0.0


def test_memories_of_a_batch_must_be_of_one_kind():
    one = Controller("k", constant, Gain(1.0))
    with pytest.raises(ArgumentError, match="the same kind of memory"):
        start_servo(controller=[one, replace(one, memory=Remembering)])


def test_model_that_was_changed_in_place_is_refused():
    plant = MujocoPlant.load("servo")
    start_servo(plant=plant)
    mass = plant.model.body("rotor").mass
    mass *= 2
    with pytest.raises(ModelError, match=r"plant.model was changed .* use plant.edited"):
        start_servo(plant=plant)
    mass /= 2
    start_servo(plant=plant)
    plant.model.opt.gravity[2] = 0.0
    with pytest.raises(ModelError, match=r"plant.model was changed"):
        start_servo(plant=plant)


def test_spec_that_was_changed_in_place_is_refused():
    plant = MujocoPlant(physics("servo").system, load_spec("servo"))
    start_servo(plant=plant)
    plant.spec.body("rotor").mass = 3.0
    with pytest.raises(ModelError, match=r"plant.spec was changed after the plant was made"):
        start_servo(plant=plant)


CALLBACKS = ["passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor"]


@each_engine
@pytest.mark.parametrize("kind", CALLBACKS)
def test_somebody_else_s_callback_is_refused(kind: str, engine: Engine):
    """It would add forces that neither the law nor the equations know of."""
    install = getattr(mujoco, f"set_mjcb_{kind}")
    install(lambda *_: 0)
    try:
        with pytest.raises(SetupError, match=f"a MuJoCo {kind} callback .*set_mjcb_{kind}"):
            start_servo(engine=engine)
    finally:
        install(None)
    start_servo(engine=engine)


def test_batch_must_have_one_count():
    ctl = controller("servo", "lqr")
    with pytest.raises(ArgumentError, match=r"1 plants, 3 controllers, 1 .* and 2 starts: each"):
        start_servo(controller=[ctl] * 3, x0=np.zeros((2, 2)))
    with pytest.raises(ArgumentError, match="1 controllers, 3 disturbance lists and 2 starts"):
        start_servo(disturbances=[[], [], []], x0=np.zeros((2, 2)))
    with pytest.raises(ArgumentError, match="0 plants"):
        start_servo(plant=[])
    with pytest.raises(ArgumentError, match="0 starts"):
        start_servo(x0=np.zeros((0, 2)))


@pytest.mark.parametrize("other", [physics("arm"), physics("servo").analytic()])
def test_plants_of_a_batch_must_be_alike(other):
    with pytest.raises(ArgumentError, match="of one system and of one kind"):
        start_servo(plant=[physics("servo"), other])


def test_plants_of_a_batch_must_have_one_timestep():
    with pytest.raises(ArgumentError, match="must have one timestep"):
        start_servo(plant=[physics("servo"), MujocoPlant.load("servo", timestep=2e-3)])


def test_controllers_of_a_batch_must_have_one_law():
    with pytest.raises(ArgumentError, match="must have the same law"):
        start_servo(controller=[controller("servo", "lqr"), controller("servo", "grosmc")])


@pytest.mark.parametrize("system", ["arm", "cart_pendulum"])
def test_controller_must_be_of_the_plant_s_system(system):
    ctl, x0 = controller("servo", "lqr"), np.zeros(len(physics(system).system.states))
    with pytest.raises(ArgumentError, match="servo"):
        start_servo(plant=physics(system), controller=ctl, x0=x0)


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


@each_engine
@pytest.mark.parametrize("stride", [1, 2])
def test_meters_note_every_timestep_whatever_is_recorded(engine: Engine, stride: int) -> None:
    x0, meters = (
        np.array([[0.1, 0.0], [0.2, 0.3]]),
        [Meters(note, Noted(), Weight(r)) for r in (1, 2)],
    )
    options: dict[str, Any] = {"x0": x0, "engine": engine, "control_period": stride * 1e-3}
    recorded = start_servo(**options)
    for record in (False, True):
        run = start_servo(**options, meters=meters, record=record)
        noted: Any = run.meters
        np.testing.assert_array_equal(noted["steps"], 10.0)
        np.testing.assert_array_equal(noted["last"], 9 * 1e-3)
        effort = np.sum(recorded.input**2, axis=1) * [1, 2]
        np.testing.assert_allclose(noted["effort"], effort, rtol=1e-12)
    assert recorded.meters is None


def test_meters_of_a_batch_must_be_of_one_kind() -> None:
    meters = [Meters(note, Noted(), Weight()), Meters(note, Noted(), Noted())]
    with pytest.raises(ArgumentError, match="the same kind of meters"):
        start_servo(x0=np.zeros((2, 2)), meters=meters)
    with pytest.raises(ArgumentError, match="meters = 3 must be Meters or a list of them"):
        start_servo(meters=3)


LOAD = Disturbance("rotor", (0.0, 0.0, 0.0, 0.0, -1.0, 0.0))


@pytest.mark.parametrize("bad", [[3], ["load"], [LOAD, None], [[LOAD], [3]], "load"])
def test_disturbance_that_is_none_is_refused(bad):
    with pytest.raises(ArgumentError, match="must be a list of Disturbances"):
        start_servo(disturbances=bad)


def test_single_disturbance_without_a_list_is_refused_by_name():
    with pytest.raises(ArgumentError, match=r"[Dd]isturbance"):
        start_servo(disturbances=LOAD)


@pytest.mark.parametrize("mixed", [[LOAD, [LOAD]], [[LOAD], LOAD]])
def test_disturbances_and_lists_of_them_are_not_mixed(mixed):
    with pytest.raises(ArgumentError, match=r"[Dd]isturbance"):
        start_servo(disturbances=mixed)


@pytest.mark.parametrize(
    # 0.0033/3e-4 is a little more than 11 in binary.
    ("duration", "h", "steps"),
    [(0.3, 1e-3, 300), (0.0101, 1e-3, 11), (1e-5, 1e-3, 1), (0.0033, 3e-4, 11), (0.004, 3e-4, 14)],
)
def test_duration_is_rounded_up_to_whole_timesteps_but_not_for_rounding(duration, h, steps):
    run = start_servo(duration=duration, plant=physics("servo").analytic(), timestep=h)
    np.testing.assert_array_equal(run.time, np.arange(steps + 1) * h)
    assert run.state.shape == (steps + 1, 2)
    assert run.command.shape == (steps,)


def test_one_simulation_in_a_list_is_a_batch_of_one():
    """What comes back has an axis more whenever a sequence was given."""
    for changes in ({"x0": [[0.0, 0.0]]}, {"plant": [physics("servo")]}):
        together = start_servo(**changes)
        assert len(together) == 1
        np.testing.assert_array_equal(together.state[0], start_servo().state)
    with pytest.raises(TypeError, match="one run has no length"):
        len(start_servo())


# Runs that end early


def assert_finite(run: Trajectory) -> None:
    for name in ("time", "state", "command", "input", "sliding", "weighed", "physics"):
        values = getattr(run, name)
        assert values is None or np.all(np.isfinite(values)), name


def run_both(kind: str, system: str, law: Controller, starts: Any, **options: Any) -> Trajectory:
    """A batch in the native engine, after the Python engine has been found to agree on it."""
    options = {"duration": 0.25, **options}
    runs = [
        simulate(plant_of(system, kind), law, starts, engine=engine, **options)
        for engine in ("native", "python")
    ]
    np.testing.assert_array_equal(runs[0].status, runs[1].status)
    np.testing.assert_array_equal(runs[0].valid_until, runs[1].valid_until)
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    np.testing.assert_array_equal(runs[0].command, runs[1].command)
    assert_finite(runs[0])
    if runs[0].physics is not None:
        # MuJoCo's own rows are time, positions and velocities, after an early end too.
        np.testing.assert_array_equal(runs[0].physics[..., 1:], runs[0].state)
    return runs[0]


@each_engine
@each_kind
def test_diverging_run_raises_with_its_time_and_what_was_recorded(kind, engine):
    with pytest.raises(DivergenceError, match=r"servo under lqr at t = 0.*smaller control") as info:
        start_servo(
            plant=plant_of("servo", kind), controller=pushing_away(), duration=3.0, engine=engine
        )
    run = info.value.trajectory
    assert not isinstance(info.value, UndefinedLawError)
    assert run.status is Status.DIVERGED
    assert 0.1 < info.value.time == run.valid_until < 0.3
    assert_finite(run)
    # exp(126 t) from 1 rad: the last valid speed is within MuJoCo's bound, and near it.
    assert 1e6 < np.abs(run.state[-1, 1]) < 1e10


@each_kind
def test_diverging_run_of_a_batch_is_a_status_and_leaves_the_others_alone(kind):
    starts = [[0.0, 0.0], [1.0, 0.0], [0.99, 0.0]]  # the second one starts at rest on the target
    together = run_both(kind, "servo", pushing_away(), starts)
    assert list(together.status) == [Status.DIVERGED, Status.COMPLETED, Status.DIVERGED]
    # Farther out, earlier.
    assert together.valid_until[0] < together.valid_until[2] < together.valid_until[1] == 0.25
    alone = start_servo(
        plant=plant_of("servo", kind), controller=pushing_away(), x0=starts[1], duration=0.25
    )
    np.testing.assert_array_equal(together.state[1], alone.state)
    np.testing.assert_array_equal(together.command[1], alone.command)


@each_engine
@each_kind
@pytest.mark.parametrize("law", ["fl-lqr", "grosmc"])
def test_run_into_a_singular_decoupling_matrix_raises(kind, engine, law):
    """Feedback linearization of the pendulum ends at |theta| = pi/2."""
    x0, _ = SWINGS_THROUGH
    with pytest.raises(UndefinedLawError, match=r"undefined outside \|theta\| < pi/2") as info:
        simulate(
            plant_of("cart_pendulum", kind),
            controller("cart_pendulum", law),
            x0,
            duration=1.0,
            engine=engine,
        )
    run = info.value.trajectory
    assert run.status is Status.UNDEFINED_LAW
    assert run.valid_until == info.value.time
    assert_finite(run)
    # The state that the law refused is the last one that was reached, and the first outside.
    at = round(info.value.time / 1e-3)
    assert abs(run.state[at, 1]) >= math.pi / 2
    assert np.all(np.abs(run.state[:at, 1]) < math.pi / 2)


@each_kind
@pytest.mark.parametrize("T", [1e-3, 5e-3])
def test_undefined_law_in_a_batch_is_a_status(kind, T):
    x0, end = SWINGS_THROUGH
    law, starts = controller("cart_pendulum", "fl-lqr"), [x0, UPRIGHT, BEYOND]
    together = run_both(kind, "cart_pendulum", law, starts, control_period=T)
    assert list(together.status) == [
        Status.UNDEFINED_LAW,
        Status.COMPLETED,
        Status.UNDEFINED_LAW,
    ]
    # The law notices at its next sample.
    np.testing.assert_allclose(
        together.valid_until, [math.ceil(end / T - 1e-9) * T, 0.25, 0], atol=1e-12
    )
    # After the end the rows repeat the last valid ones.
    last = round(together.valid_until[0] / 1e-3)
    np.testing.assert_array_equal(
        together.state[0, last:], [together.state[0, last]] * (251 - last)
    )
    np.testing.assert_array_equal(together.command[0, last:], together.command[0, last - 1])
    np.testing.assert_array_equal(together.state[2], [BEYOND] * 251)
    alone = simulate(plant_of("cart_pendulum", kind), law, UPRIGHT, duration=0.25, control_period=T)
    np.testing.assert_array_equal(together.state[1], alone.state)


@pytest.mark.parametrize("kind", ["printed", "corrected", "physics"])
def test_arm_that_reaches_its_singular_angle_is_stopped(kind):
    """At q = pi/2 the cable has length zero."""
    plant = physics("arm") if kind == "physics" else physics("arm").analytic(kind)
    law, starts = controller("arm", "lqr"), [[1.5, 40.0], [0.5, math.pi], [1.6, 0.0]]
    runs = [
        simulate(plant, law, starts, duration=0.1, engine=engine) for engine in ("native", "python")
    ]
    for run in runs:
        assert list(run.status) == [
            Status.SINGULAR_PLANT,
            Status.COMPLETED,
            Status.SINGULAR_PLANT,
        ]
        # (pi/2 - 1.5)/40 is 1.8 ms.
        np.testing.assert_allclose(run.valid_until, [2e-3, 0.1, 0.0], rtol=0, atol=1e-12)
        assert_finite(run)
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    with pytest.raises(UndefinedLawError, match="singular at q >= pi/2, where the cable") as info:
        simulate(plant, law, starts[0], duration=0.1)
    assert info.value.trajectory.status is Status.SINGULAR_PLANT
    assert info.value.time == 2e-3


EARLY_ENDS = [
    pytest.param("cart_pendulum", "fl-lqr", SWINGS_THROUGH[0], id="undefined"),
    pytest.param("arm", "lqr", [1.5, 40.0], id="singular"),
    pytest.param("servo", "pushing away", [0.0, 0.0], id="diverged"),
]


def law_of(system: str, law: str) -> Controller:
    return pushing_away() if law == "pushing away" else controller(system, law)


@each_kind
@pytest.mark.parametrize(("system", "law", "x0"), EARLY_ENDS)
def test_run_that_ended_early_is_cut_where_it_stopped_being_valid(system, law, x0, kind):
    with pytest.raises(DivergenceError) as info:
        simulate(plant_of(system, kind), law_of(system, law), x0, duration=0.25)
    run = info.value.trajectory
    assert run.time[-1] == info.value.time
    assert len(run.command) == len(run.time) - 1 == round(info.value.time / 1e-3)


@each_kind
@pytest.mark.parametrize("disturbed", [False, True], ids=["free", "pushed"])
@pytest.mark.parametrize(("system", "law", "x0"), EARLY_ENDS)
def test_early_end_does_not_depend_on_recording(system, law, x0, kind, disturbed):
    body = physics(system).system.bodies[-1]
    push = [Disturbance(body, (0.0, 0.0, 0.0, 0.0, 0.01, 0.0))] if disturbed else []
    starts = [x0, x0]
    recorded, short = (
        run_both(kind, system, law_of(system, law), starts, record=record, disturbances=push)
        for record in (True, False)
    )
    np.testing.assert_array_equal(short.status, recorded.status)
    np.testing.assert_array_equal(short.valid_until, recorded.valid_until)


@pytest.mark.parametrize(
    "kind",
    [
        "corrected",
        "physics",
    ],
)
def test_run_ends_for_the_first_reason(kind):
    """A law that is undefined at 0.092 s is not blamed on a kick at 0.15 s."""
    x0, end = SWINGS_THROUGH
    kick = Disturbance("pole", (0.0, 0.0, 0.0, 0.0, 1e13, 0.0), Pulse(0.15, 0.2))
    law = controller("cart_pendulum", "fl-lqr")
    run = run_both(kind, "cart_pendulum", law, [x0, UPRIGHT], disturbances=[kick])
    assert list(run.status) == [Status.UNDEFINED_LAW, Status.DIVERGED]
    np.testing.assert_allclose(run.valid_until, [end, 0.15], atol=1e-12)


@each_engine
def test_controller_is_refused_at_another_control_period_than_its_own(engine: Engine) -> None:
    """A discrete-time surface belongs to one sampling time; without one any will do."""
    ctl = controller("servo", "lqr")
    ctl = replace(ctl, design=replace(ctl.designed, control_period=2e-3))
    for wrong in (1e-3, 4e-3):
        message = rf"lqr is designed for a control period of 0\.002 s, not {wrong:g} s"
        with pytest.raises(ArgumentError, match=message):
            start_servo(controller=ctl, control_period=wrong, timestep=1e-3, engine=engine)
    run = start_servo(controller=ctl, control_period=2e-3, timestep=1e-3, engine=engine)
    assert run.status == Status.COMPLETED
    # 0.002 from 1e-3 twice is the same period to rounding.
    start_servo(controller=ctl, control_period=1e-3 + 1e-3, timestep=1e-3, engine=engine)


@each_engine
def test_law_without_an_answer_is_a_divergence(engine: Engine):
    """A law that returns no number ends the run at that sample, and says so."""
    law = Controller("inf", constant, Gain(math.inf))
    for kind in ("corrected", "physics"):
        with pytest.raises(DivergenceError) as info:
            start_servo(plant=plant_of("servo", kind), controller=law, engine=engine)
        assert info.value.time == 0
        assert "returned no finite number at x = (0, 0)" in str(info.value)
        assert info.value.trajectory.status is Status.UNDEFINED_INPUT
        assert_finite(info.value.trajectory)


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


@pytest.mark.parametrize(
    "engine",
    [
        "native",
        "python",
    ],
)
def test_overflow_within_a_step_is_a_divergence(engine):
    """A stage of RK4 far beyond any angle: sin of it is NaN in C, a ValueError in Python."""
    plant, ctl = physics("cart_pendulum").analytic(), Controller("overflow", constant, Gain(1e300))
    with pytest.raises(DivergenceError) as info:
        simulate(plant, ctl, UPRIGHT, duration=0.01, engine=engine)
    assert info.value.time == 0


def test_numbers_of_a_batch_have_one_layout():
    """The same names in another order are other offsets in compiled code."""
    ctls = [Controller("k", constant, p) for p in (Gain(1.0, 2.0), GainLast(2.0, 1.0))]
    try:
        run = start_servo(controller=ctls)
    except ArgumentError:
        return  # refusing is as good
    assert np.all(run.command == 1.0)


def test_a_run_that_ends_at_its_start_repeats_it() -> None:
    """Rows of a batch: the start, no input, and MuJoCo's own state as it was."""
    plant = MujocoPlant.load("cart_pendulum")
    law = chapter_controller("fl-lqr", plant.analytic())
    starts = np.array([[0.0, 0.1, 0.0, 0.0], [0.2, 2.0, 0.3, 0.0]])
    runs = simulate(plant, law, starts, duration=0.01)
    assert [each.name for each in runs.status] == ["COMPLETED", "UNDEFINED_LAW"]
    np.testing.assert_array_equal(runs.state[1], np.tile(starts[1], (11, 1)))
    assert not runs.input[1].any()
    assert runs.physics is not None
    np.testing.assert_array_equal(runs.physics[1], np.tile(runs.physics[1, 0], (11, 1)))
    np.testing.assert_array_equal(runs.physics[1, 0, 1:], starts[1])
