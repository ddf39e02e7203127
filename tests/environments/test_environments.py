"""The cases as environments: the numbers of ``simulate``, the index as reward, clear ends."""

from __future__ import annotations

import math
import subprocess
import sys
import unittest
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from shipped import case_plant, cases, find_case, nominal_controller, of_case

import grosmc_mj
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization
from grosmc_mj.environments import law_policy
from grosmc_mj.errors import (
    ArgumentError,
    DivergenceError,
    GrosmcError,
    ModelError,
    SetupError,
    UndefinedLawError,
)
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.metrics.recorded import compare_with_optimum, measure
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.machine import Stop
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.trajectory import Status, Trajectory

pytestmark = pytest.mark.slow

pytest.importorskip("dm_control")
dm_env = pytest.importorskip("dm_env")
test_utils = pytest.importorskip("dm_env.test_utils")
load = grosmc_mj.environments.load

# Those in a loop are in test_environment_loops.
ALL = [(system, case.name) for system in SYSTEMS for case in cases(system) if case.loop is None]


@cache
def law(system: str, name: str = "grosmc", design: str | None = None) -> Controller:
    return nominal_controller(system, name, "corrected", design=design)


def cut(system: str, name: str, duration: float) -> Case:
    """A case with another duration."""
    return replace(find_case(system, name), duration=duration)


def simulated(
    case: Case, controller: Controller, T: float, engine: Any = "python", h: float = 1e-3
) -> Trajectory:
    plant = case_plant(case, "physics", Settings(timestep=h))
    return grosmc_mj.simulate(
        plant, controller, case.x0, duration=case.duration, control_period=T,
        disturbances=case.disturbances, engine=engine,
    )  # fmt: skip


def stepped(environment: Any, policy: Callable[[Any], Any]) -> tuple[Array, Array, float, Any]:
    """States at the samples, inputs, return and last time step of an episode."""
    names = [signal.name for signal in environment.task.episode.plant.system.states]
    step = environment.reset()
    states, inputs, total = [], [], 0.0
    while True:
        states.append(np.concatenate([step.observation[name] for name in names]))
        if step.last():
            return np.array(states), np.array(inputs), total, step
        inputs.append(policy(step.observation))
        step = environment.step(inputs[-1])
        total += step.reward


def assert_equal_to_simulate(
    case: Case, controller: Controller, T: float, engine: Any, h: float = 1e-3
) -> Trajectory:
    environment = load(case.system, of_case(case), control_period=T, timestep=h)
    states, inputs, _, last = stepped(environment, law_policy(controller))
    run, stride = simulated(case, controller, T, engine, h), round(T / h)
    command = run.command.reshape(len(run.command), -1)
    # The last interval may be cut short by the duration: its end is no sample.
    rows = [*range(0, len(run.time) - 1, stride), len(run.time) - 1]
    assert np.array_equal(states, run.state[rows])
    assert np.array_equal(inputs, command[rows[:-1]])
    assert last.discount == 1.0
    return run


@pytest.mark.parametrize(("system", "name"), ALL)
@pytest.mark.parametrize("T", [1e-3, 7e-3])
def test_a_law_in_an_environment_gets_simulate_s_numbers_to_the_last_bit(
    system: str, name: str, T: float
) -> None:
    case = cut(system, name, 0.06)
    assert_equal_to_simulate(case, law(system, design=case.controllers), T, "python")


@pytest.mark.parametrize(("system", "name"), [("servo", "case1"), ("cart_pendulum", "case2")])
def test_the_same_through_the_onset_of_a_late_disturbance(system: str, name: str) -> None:
    case = cut(system, name, find_case(system, name).onset + 0.1)
    run = assert_equal_to_simulate(case, law(system, "lqr"), 1e-2, "python", 5e-3)
    assert run.wrench is not None
    assert np.any(run.wrench[-1])
    assert not np.any(run.wrench[-21])


@pytest.mark.slow
@pytest.mark.parametrize(("system", "name"), ALL)
def test_the_same_over_the_whole_case_in_the_native_engine(system: str, name: str) -> None:
    case = find_case(system, name)
    assert_equal_to_simulate(case, law(system, design=case.controllers), 2e-3, "native")


@pytest.mark.parametrize(
    ("system", "name"),
    [("servo", "case2"), ("cart_pendulum", "case1"), ("arm", "case1"), ("two_link_arm", "case2"),
     ("two_link_arm", "regulation1")],
)  # fmt: skip
def test_the_return_is_minus_the_index(system: str, name: str) -> None:
    case = cut(system, name, 0.3)
    controller = law(system, design=case.controllers)
    run = simulated(case, controller, 1e-3)
    comparison = compare_with_optimum(run, controller)
    J = measure(run, controller, comparison)["cost_whole"].value
    assert J is not None
    _, _, total, _ = stepped(load(system, of_case(case)), law_policy(controller))
    # The metric takes the trapezoidal rule for the state's part, the reward the left end.
    first, last = (float(z @ controller.designed.lqr.Q @ z) for z in comparison.z[[0, -1]])
    # v is computed back from u, which costs some last places.
    assert -total + 1e-3 / 4 * (last - first) == pytest.approx(J, rel=1e-11)


def test_the_return_of_a_law_on_the_linear_model_has_the_index_s_v() -> None:
    """LQR on the pendulum's linear model designs for u, but is paid for v = alpha + E u."""
    case = cut("cart_pendulum", "nominal", 0.002)
    environment = load("cart_pendulum", of_case(case))
    index_law = law("cart_pendulum")
    x, u = np.array(case.x0), np.array([3.0])
    alpha, E = index_law.coordinates.dynamics(0.0, x, index_law.parameters)
    z, v = np.array([x[1], x[3]]), alpha + E @ u
    environment.reset()
    weights = index_law.designed.lqr
    expected = -1e-3 * 0.5 * float(z @ weights.Q @ z + v @ weights.R @ v)
    # The products are summed in the same order.
    assert environment.step(u).reward == pytest.approx(expected, rel=1e-14)


def test_observations_have_names_units_and_exact_times() -> None:
    environment = load("cart_pendulum", control_period=1.1e-2)
    step, spec = environment.reset(), environment.observation_spec()
    names = ["cart position", "pole angle", "cart speed", "pole rate", "time", "error", "reference"]
    assert list(step.observation) == list(spec) == names
    assert spec["pole angle"].name == "pole angle [rad]"
    assert spec["error"].name == "error [rad, rad/s]"
    timesteps = 0
    for k in range(1, 41):
        step = environment.step(np.zeros(1))
        assert step.observation["time"][0] == k * 1.1e-2
        timesteps += 11 * k * 1e-3 != k * 1.1e-2
    # Which the number of timesteps would not give.
    assert timesteps > 0
    assert step.observation["error"].tolist() == [
        step.observation["pole angle"][0], step.observation["pole rate"][0]
    ]  # fmt: skip
    assert step.observation["reference"].tolist() == [0.0, 0.0]
    assert environment.physics.time() == 40 * 1.1e-2
    assert environment.control_timestep() == pytest.approx(1.1e-2, rel=1e-15)


@pytest.mark.parametrize("name", list(SYSTEMS))
def test_an_episode_begins_in_the_state_of_a_run_of_simulate(name: str) -> None:
    """All that MuJoCo integrates from, warm start and applied wrenches included."""

    def everything(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        return state.tolist()

    environment, plant = load(name, "case1"), MujocoPlant.load(name)
    fresh, x0 = mujoco.MjData(plant.model), find_case(name, "case1").x0
    n = SYSTEMS[name].degrees_of_freedom
    fresh.qpos[:], fresh.qvel[:] = x0[:n], x0[n:]
    m = len(SYSTEMS[name].inputs)
    for _ in range(2):
        environment.reset()
        episode = environment.physics.episode
        stepper = episode._steppers.of(episode.plant)
        assert everything(stepper.model, stepper.data) == everything(plant.model, fresh)
        for _ in range(20):
            environment.step(np.ones(m))


def test_the_arm_s_reference_moves_with_time() -> None:
    environment = load("arm", control_period=0.1)
    environment.reset()
    step = environment.step(np.zeros(1))
    # One rounding of sin and one product.
    wanted = [math.sin(math.pi * 0.1), math.pi * math.cos(math.pi * 0.1)]
    assert step.observation["reference"] == pytest.approx(wanted, rel=1e-15)
    state = [step.observation["joint angle"][0], step.observation["joint rate"][0]]
    assert step.observation["error"] == pytest.approx(
        np.subtract(state, step.observation["reference"]), abs=1e-15
    )


@pytest.mark.parametrize("name", list(SYSTEMS))
def test_actions_have_the_actuators_units_and_no_bounds(name: str) -> None:
    spec = load(name).action_spec()
    m = len(SYSTEMS[name].inputs)
    assert spec.shape == (m,)
    assert np.all(spec.minimum == -np.inf)
    assert np.all(spec.maximum == np.inf)
    assert spec.name.endswith(f"{SYSTEMS[name].inputs[-1].name} [{SYSTEMS[name].input.unit}]")


@pytest.fixture
def limited(monkeypatch: pytest.MonkeyPatch) -> MujocoPlant:
    """A pendulum whose force is limited to 2 N, in the place of the shipped one."""
    plant = MujocoPlant.load("cart_pendulum")
    spec = plant.spec.copy()
    spec.actuator("force").ctrlrange = (-2.0, 2.0)
    spec.actuator("force").ctrllimited = True
    weak = replace(plant, spec=spec)
    monkeypatch.setattr(Experiment, "plant", lambda *_: weak)
    return weak


def test_actions_beyond_the_bounds_are_clamped_and_paid_for_as_applied(
    limited: MujocoPlant,
) -> None:
    case = cut("cart_pendulum", "nominal", 0.1)
    environment = load("cart_pendulum", of_case(case))
    spec = environment.action_spec()
    assert (spec.minimum.tolist(), spec.maximum.tolist()) == ([-2.0], [2.0])
    controller = law("cart_pendulum", "lqr")
    states, inputs, _, _ = stepped(environment, law_policy(controller))
    run = grosmc_mj.simulate(limited, controller, case.x0, duration=0.1, engine="python")
    assert np.abs(inputs).max() > 2
    assert np.array_equal(states, run.state)
    assert np.array_equal(inputs[:, 0], run.command)
    rewards = []
    for action in (5.0, 2.0):
        environment.reset()
        rewards.append(environment.step([action]).reward)
    assert rewards[0] == rewards[1]


@pytest.mark.parametrize("action", [[math.nan], [math.inf], 1.0, [1.0, 2.0], ["a"], None])
def test_an_action_that_is_none_is_refused(action: Any) -> None:
    environment = load("cart_pendulum")
    environment.reset()
    with pytest.raises(ArgumentError, match=r"must be 1 finite number.*\(1,\): force \[N\]$"):
        environment.step(action)


def start_of(environment: Any) -> list[float]:
    """The state that an episode begins with."""
    observation = environment.reset().observation
    return [float(value[0]) for value in list(observation.values())[:4]]


def test_the_same_seed_gives_the_same_starts() -> None:
    def starts(seed: int | None) -> list[list[float]]:
        spread = [0.1, 0.2, 0.0, 0.3]
        environment = load("cart_pendulum", spread=spread, seed=seed)
        return [start_of(environment) for _ in range(20)]

    assert starts(3) == starts(3)
    assert starts(3) != starts(4)
    found = np.array(starts(5)) - find_case("cart_pendulum", "nominal").x0
    assert len(np.unique(found[:, 0])) == 20
    assert np.all(np.abs(found) <= [0.1, 0.2, 0.0, 0.3])
    # Twenty draws that all stay in the middle half have a chance of 1e-6.
    assert np.all(np.abs(found).max(axis=0) >= [0.05, 0.1, 0.0, 0.15])


def test_without_spread_every_episode_begins_at_the_case_s_start() -> None:
    environment = load("arm", "case2")
    names = ("joint angle", "joint rate")
    for _ in range(2):
        observation = environment.reset().observation
        assert tuple(observation[name][0] for name in names) == find_case("arm", "case2").x0


def test_starts_where_the_plant_is_undefined_are_not_drawn() -> None:
    environment = load("arm", spread=[2.0, 0.0], seed=0)
    angles = [environment.reset().observation["joint angle"][0] for _ in range(60)]
    # A third of the box lies beyond pi/2, where the arm's cable has length zero.
    assert max(angles) < math.pi / 2
    assert max(angles) > 1.2


def test_starts_beyond_a_stop_are_not_drawn() -> None:
    case = replace(find_case("servo", "nominal"), edits=(Stop("shaft", -0.5, 0.2),))
    environment = load("servo", of_case(case), spread=[1.0, 0.0], seed=0)
    angles = [environment.reset().observation["rotor angle"][0] for _ in range(60)]
    assert -0.5 <= min(angles) < -0.4
    assert 0.1 < max(angles) <= 0.2


def test_a_case_without_a_defined_start_is_refused() -> None:
    case = replace(find_case("arm", "nominal"), x0=(1.6, 0.0))
    with pytest.raises(ArgumentError, match="arm/nominal can't start: the plant is singular at q"):
        load("arm", of_case(case))


def test_divergence_ends_the_episode_with_discount_zero_and_finite_numbers() -> None:
    environment = load("two_link_arm")
    environment.reset()
    step = environment.step(np.array([1.0, -1.0]))
    before = step
    while not step.last():
        before, step = step, environment.step(np.array([1e14, -1e14]))
    assert step.discount == 0.0
    assert "the state grew without bound" in environment.task.ended
    assert math.isfinite(step.reward)
    assert all(np.all(np.isfinite(value)) for value in step.observation.values())
    # The last valid state is the one before the step that failed.
    assert step.observation["time"][0] >= before.observation["time"][0]
    first = environment.step(np.zeros(2))
    assert first.first()
    assert environment.task.ended == ""
    assert not environment.step(np.zeros(2)).last()


def test_divergence_comes_when_simulate_says_so(
    open_loop: Callable[[Any], Controller],
) -> None:
    case, push = find_case("two_link_arm", "nominal"), (1e14, -1e14)
    environment = load("two_link_arm", of_case(case), control_period=5e-3)
    states, _, _, last = stepped(environment, lambda _: push)
    with pytest.raises(DivergenceError) as found:
        simulated(case, open_loop(push), 5e-3)
    assert found.value.trajectory.status is Status.DIVERGED
    assert last.observation["time"][0] == found.value.time
    assert np.array_equal(states[-1], found.value.trajectory.state[-1])


def test_a_singular_plant_ends_the_episode_when_simulate_says_so(
    open_loop: Callable[[float], Controller],
) -> None:
    case = find_case("arm", "nominal")
    environment = load("arm", of_case(case), control_period=5e-3)
    states, _, _, last = stepped(environment, lambda _: np.array([20.0]))
    assert last.discount == 0.0
    with pytest.raises(UndefinedLawError) as found:
        simulated(case, open_loop(20.0), 5e-3)
    end = found.value.time
    assert last.observation["time"][0] == pytest.approx(end, rel=1e-15)  # k T and i h
    assert np.array_equal(states[-1], found.value.trajectory.state[-1])
    assert environment.task.ended == (
        f"t = {end:g} s: the plant is singular at q >= pi/2, where the cable has length zero"
    )


def test_leaving_the_index_s_region_ends_the_episode() -> None:
    environment = load("cart_pendulum", control_period=1e-2)
    states, _, _, last = stepped(environment, lambda _: np.array([-20.0]))
    assert last.discount == 0.0
    assert abs(states[-1][1]) >= math.pi / 2 > abs(states[-2][1])
    assert environment.task.ended.endswith("the index is undefined outside |theta| < pi/2")


def test_two_environments_of_one_case_do_not_disturb_each_other() -> None:
    case = cut("arm", "case1", 0.05)
    alone, *_ = stepped(load("arm", of_case(case)), law_policy(law("arm")))
    one, other = load("arm", of_case(case)), load("arm", of_case(case))
    policies = [law_policy(law("arm")) for _ in range(2)]
    steps = [one.reset(), other.reset()]
    while not steps[0].last():
        steps = [
            environment.step(policy(step.observation))
            for environment, policy, step in zip((one, other), policies, steps, strict=True)
        ]
    for environment in (one, other):
        assert np.array_equal(environment.physics.episode.x, alone[-1])


def test_a_law_starts_its_memory_anew_in_each_episode() -> None:
    environment, policy = load("arm", of_case(cut("arm", "case1", 0.05))), law_policy(law("arm"))
    runs = [stepped(environment, policy)[:2] for _ in range(2)]
    assert np.array_equal(runs[0][0], runs[1][0])
    assert np.array_equal(runs[0][1], runs[1][1])


class TestSpecification(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """dm_env's own tests, through the end of an episode."""

    def make_object_under_test(self) -> Any:
        return load("two_link_arm", of_case(cut("two_link_arm", "case1", 0.01)), spread=0.1, seed=1)

    def make_action(self) -> Array:
        # dm_env would take the lower bound, which is infinite.
        return np.array([0.1, -0.1])


@pytest.mark.parametrize(
    ("arguments", "options", "error", "said"),
    [
        (("cart_pendulm",), {}, ModelError, "unknown system 'cart_pendulm': did you mean 'cart_p"),
        (("servo", "case3"), {}, ArgumentError, "unknown case of servo 'case3': did you mean"),
        (
            ("servo", of_case(find_case("arm", "case1"))),
            {},
            ArgumentError,
            "'case1' is one of arm, not of",
        ),
        (("servo",), {"control_period": 1.5e-3}, ArgumentError, "0.0015 s is no multiple of the"),
        (("servo",), {"timestep": -1.0}, ModelError, "timestep = -1 must be from"),
        (
            ("servo",),
            {"spread": [0.1] * 3},
            ArgumentError,
            "must be one number or 2, finite and not negative",
        ),
        (("servo",), {"spread": -1}, ArgumentError, "not negative: rotor angle [rad], rotor speed [rad/s]"),
        (("servo",), {"spread": "wide"}, ArgumentError, "spread = 'wide' must be one number"),
    ],
)
def test_wrong_use_is_told_in_one_line(
    arguments: Any, options: Any, error: type[GrosmcError], said: str
) -> None:
    with pytest.raises(error) as found:
        load(*arguments, **options)
    assert said in str(found.value)
    assert "\n" not in str(found.value)


def test_a_law_needs_its_states_by_name() -> None:
    policy = law_policy(law("cart_pendulum"))
    observation: dict[str, Any] = load("cart_pendulum").reset().observation
    with pytest.raises(ArgumentError, match="must map time, cart position, pole angle, cart speed"):
        policy({name: value for name, value in observation.items() if name != "pole angle"})
    with pytest.raises(ArgumentError, match="neither flattened nor batched"):
        policy({name: np.zeros((2, 1)) for name in observation})
    with pytest.raises(ArgumentError, match="neither flattened nor batched"):
        policy(np.zeros(9))  # pyright: ignore[reportArgumentType]


def test_a_law_without_coordinates_needs_its_system(
    open_loop: Callable[[float], Controller],
) -> None:
    with pytest.raises(ArgumentError, match="open loop has no error coordinates"):
        law_policy(open_loop(1.0))
    assert law_policy(open_loop(1.5), "servo")(load("servo").reset().observation) == [1.5]


def test_a_law_made_for_a_sampling_time_refuses_another() -> None:
    discrete = Realization(find_switching("sign"), 1e-3)
    controller = nominal_controller("servo", "grosmc", "corrected", discrete)
    case = cut("servo", "nominal", 0.01)
    states, *_ = stepped(load("servo", of_case(case)), law_policy(controller))
    assert np.array_equal(states, simulated(case, controller, 1e-3).state)
    with pytest.raises(ArgumentError, match=r"for a control period of 0\.001 s, not 0\.002 s"):
        stepped(load("servo", of_case(case), control_period=2e-3), law_policy(controller))


def test_a_law_says_where_it_is_undefined() -> None:
    observation = load("cart_pendulum").reset().observation
    observation["pole angle"][:] = 2.0
    with pytest.raises(UndefinedLawError, match="t = 0 s: grosmc is undefined at this state"):
        law_policy(law("cart_pendulum"))(observation)


def test_without_dm_control_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "dm_control.rl.control", None)
    with pytest.raises(SetupError, match=r"pip install dm_control with Python 3\.12 or older"):
        load("servo")


def test_the_names_are_there_without_mujoco_or_a_face() -> None:
    program = (
        "import sys, grosmc_mj; assert 'load' in dir(grosmc_mj.environments); "
        "print([n for n in ('mujoco', 'dm_control', 'gymnasium') if n in sys.modules])"
    )
    command = [sys.executable, "-c", program]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    assert said == "[]"


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="attribute nothing"):
        _ = grosmc_mj.environments.nothing  # pyright: ignore[reportAttributeAccessIssue]
