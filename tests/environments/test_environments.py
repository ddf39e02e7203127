"""The cases as environments: the numbers of ``simulate``, the index as reward, clear ends."""

from __future__ import annotations

import math
import unittest
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from shipped import case_plant, find_case, nominal_controller, of_case

import grosmc_mj
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization
from grosmc_mj.environments import law_policy
from grosmc_mj.environments.episode import Episode
from grosmc_mj.errors import (
    ArgumentError,
    DivergenceError,
    GrosmcError,
    ModelError,
    UndefinedLawError,
)
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.machine import Stop
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.trajectory import Trajectory

pytestmark = pytest.mark.slow

pytest.importorskip("dm_control")
pytest.importorskip("dm_env")
test_utils = pytest.importorskip("dm_env.test_utils")
load = grosmc_mj.environments.load

ALL = [("servo", "case2"), ("cart_pendulum", "case1"), ("arm", "case1"), ("two_link_arm", "case2")]


@cache
def law(system: str, name: str = "grosmc", design: str | None = None) -> Controller:
    return nominal_controller(system, name, "corrected", design=design)


def cut(system: str, name: str, duration: float) -> Case:
    """A case with another duration."""
    return replace(find_case(system, name), duration=duration)


def simulated(case: Case, controller: Controller, T: float, engine: Any = "python") -> Trajectory:
    plant = case_plant(case, "physics", Settings())
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


@pytest.mark.parametrize(("system", "name"), ALL)
def test_a_law_in_an_environment_gets_simulate_s_numbers_to_the_last_bit(
    system: str, name: str
) -> None:
    """At once, at a longer control period, and over the whole case in the native engine."""
    whole, short = find_case(system, name), cut(system, name, 0.06)
    controller = law(system, design=whole.controllers)
    for case, T, engine in ((short, 1e-3, "python"), (short, 7e-3, "python"),
                            (whole, 2e-3, "native")):  # fmt: skip
        environment = load(case.system, of_case(case), control_period=T)
        states, inputs, _, last = stepped(environment, law_policy(controller))
        run = simulated(case, controller, T, engine)
        command = run.command.reshape(len(run.command), -1)
        # The last interval may be cut short by the duration: its end is no sample.
        rows = [*range(0, len(run.time) - 1, round(T / 1e-3)), len(run.time) - 1]
        assert np.array_equal(states, run.state[rows])
        assert np.array_equal(inputs, command[rows[:-1]])
        assert last.discount == 1.0


def test_a_reward_is_the_stage_cost_at_the_start_of_its_interval_times_its_length() -> None:
    """Of 5 ms in intervals of 2 ms the last is cut to 1 ms; J is 1/2 of z'Qz + v'Rv."""
    environment = load("servo", of_case(cut("servo", "nominal", 0.005)), control_period=2e-3)
    design, step, u = law("servo").designed.lqr, environment.reset(), np.array([3.0])
    for length, end in ((2e-3, 2e-3), (2e-3, 4e-3), (1e-3, 5e-3)):
        z = step.observation["error"]
        step = environment.step(u)
        expected = -length * 0.5 * float(z @ design.Q @ z + u @ design.R @ u)
        assert step.reward == pytest.approx(expected, rel=1e-12)
        assert step.observation["time"][0] == pytest.approx(end, rel=1e-12)
    assert step.last()


def test_observations_have_names_units_and_exact_times() -> None:
    environment = load("cart_pendulum", control_period=1.1e-2)
    step, spec = environment.reset(), environment.observation_spec()
    names = ["cart position", "pole angle", "cart speed", "pole rate", "time", "error", "reference"]
    assert list(step.observation) == list(spec) == names
    assert spec["pole angle"].name == "pole angle [rad]"
    assert spec["error"].name == "error [rad, rad/s]"
    for k in range(1, 41):
        step = environment.step(np.zeros(1))
        # Which the number of timesteps would not always give.
        assert step.observation["time"][0] == k * 1.1e-2
    seen = step.observation
    assert seen["error"].tolist() == [seen["pole angle"][0], seen["pole rate"][0]]
    assert seen["reference"].tolist() == [0.0, 0.0]
    assert environment.physics.time() == 40 * 1.1e-2
    arm = load("arm", control_period=0.1)
    arm.reset()
    seen = arm.step(np.zeros(1)).observation
    # One rounding of sin and one product.
    wanted = [math.sin(math.pi * 0.1), math.pi * math.cos(math.pi * 0.1)]
    assert seen["reference"] == pytest.approx(wanted, rel=1e-15)
    state = [seen["joint angle"][0], seen["joint rate"][0]]
    assert seen["error"] == pytest.approx(np.subtract(state, seen["reference"]), abs=1e-15)


def test_an_episode_begins_in_the_state_of_a_run_of_simulate(name: str) -> None:
    """All that MuJoCo integrates from, warm start and applied wrenches included."""

    def everything(model: mujoco.MjModel, data: mujoco.MjData) -> list[float]:
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.zeros(mujoco.mj_stateSize(model, kind))
        mujoco.mj_getState(model, data, state, kind)
        return state.tolist()

    environment, plant = load(name, "case1"), MujocoPlant.load(name)
    fresh, x0 = mujoco.MjData(plant.model), find_case(name, "case1").x0
    n, m = SYSTEMS[name].degrees_of_freedom, len(SYSTEMS[name].inputs)
    fresh.qpos[:], fresh.qvel[:] = x0[:n], x0[n:]
    spec = environment.action_spec()
    assert spec.shape == (m,)
    assert np.all([spec.minimum == -np.inf, spec.maximum == np.inf])
    assert spec.name.endswith(f"{SYSTEMS[name].inputs[-1].name} [{SYSTEMS[name].input.unit}]")
    for _ in range(2):
        environment.reset()
        episode = environment.physics.episode
        stepper = episode._steppers.of(episode.plant)
        assert everything(stepper.model, stepper.data) == everything(plant.model, fresh)
        for _ in range(20):
            environment.step(np.ones(m))


def test_actions_beyond_the_bounds_are_clamped_and_paid_for_as_applied(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A pendulum whose force is limited to 2 N, in the place of the shipped one."""
    plant = MujocoPlant.load("cart_pendulum")
    spec = plant.spec.copy()
    spec.actuator("force").ctrlrange, spec.actuator("force").ctrllimited = (-2.0, 2.0), True
    limited = replace(plant, spec=spec)
    monkeypatch.setattr(Experiment, "plant", lambda *_: limited)
    case, controller = cut("cart_pendulum", "nominal", 0.1), law("cart_pendulum", "lqr")
    environment = load("cart_pendulum", of_case(case))
    bounds = environment.action_spec()
    assert (bounds.minimum.tolist(), bounds.maximum.tolist()) == ([-2.0], [2.0])
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


# Starts


def test_starts_are_drawn_within_their_widths_by_a_seed() -> None:
    def starts(seed: int | None, spread: Any) -> list[list[float]]:
        environment = load("cart_pendulum", spread=spread, seed=seed)
        resets = [environment.reset().observation for _ in range(20)]
        return [[float(value[0]) for value in list(seen.values())[:4]] for seen in resets]

    widths, x0 = [0.1, 0.2, 0.0, 0.3], find_case("cart_pendulum", "nominal").x0
    assert starts(3, widths) == starts(3, widths) != starts(4, widths)
    off = np.array(starts(5, widths)) - x0
    assert np.all(np.abs(off) <= widths)
    # Twenty draws that all stay in the middle half, or to one side, have a chance of 1e-6.
    assert np.all(off.max(axis=0) >= [0.01, 0.02, 0.0, 0.03])
    assert np.all(off.min(axis=0) <= [-0.01, -0.02, 0.0, -0.03])
    assert starts(5, 0.0) == [list(x0)] * 20


def test_starts_where_the_plant_is_undefined_or_beyond_a_stop_are_not_drawn() -> None:
    environment = load("arm", spread=[2.0, 0.0], seed=0)
    angles = [environment.reset().observation["joint angle"][0] for _ in range(60)]
    # A third of the box lies beyond pi/2, where the arm's cable has length zero.
    assert 1.2 < max(angles) < math.pi / 2
    case = replace(find_case("servo", "nominal"), edits=(Stop("shaft", -0.5, 0.2),))
    environment = load("servo", of_case(case), spread=[1.0, 0.0], seed=0)
    angles = [environment.reset().observation["rotor angle"][0] for _ in range(60)]
    assert -0.5 <= min(angles) < -0.4
    assert 0.1 < max(angles) <= 0.2
    case = replace(find_case("arm", "nominal"), x0=(1.6, 0.0))
    with pytest.raises(ArgumentError, match="arm/nominal can't start: the plant is singular at q"):
        load("arm", of_case(case))


# Ends


def test_an_episode_ends_when_and_where_simulate_says_so(
    open_loop: Callable[[Any], Controller],
) -> None:
    """By divergence, at a singular plant, and outside of the index's region."""
    for system, action, error, words in (
        ("two_link_arm", (1e14, -1e14), DivergenceError, "the state grew without bound"),
        ("arm", 20.0, UndefinedLawError, "the plant is singular at q >= pi/2, where the cable"),
    ):
        environment = load(system, control_period=5e-3)
        states, _, _, last = stepped(environment, lambda _, a=action: np.atleast_1d(a))
        with pytest.raises(error) as found:
            simulated(find_case(system, "nominal"), open_loop(action), 5e-3)
        assert last.discount == 0.0
        # k T and i h.
        assert last.observation["time"][0] == pytest.approx(found.value.time, rel=1e-15)
        assert np.array_equal(states[-1], found.value.trajectory.state[-1])
        assert environment.task.ended.startswith(f"t = {found.value.time:g} s: {words}")
        assert math.isfinite(last.reward)
        assert environment.step(np.zeros(np.size(action))).first()
        assert environment.task.ended == ""
    environment = load("cart_pendulum", control_period=1e-2)
    states, _, _, last = stepped(environment, lambda _: np.array([-20.0]))
    assert last.discount == 0.0
    assert abs(states[-1][1]) >= math.pi / 2 > abs(states[-2][1])
    assert environment.task.ended.endswith("the index is undefined outside |theta| < pi/2")


class TestSpecification(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """dm_env's own tests, through the end of an episode."""

    def make_object_under_test(self) -> Any:
        return load("two_link_arm", of_case(cut("two_link_arm", "case1", 0.01)), spread=0.1, seed=1)

    def make_action(self) -> Array:
        # dm_env would take the lower bound, which is infinite.
        return np.array([0.1, -0.1])


def test_dm_control_s_physics_can_be_reset_set_and_stepped_by_hand(
    open_loop: Callable[[Any], Controller],
) -> None:
    environment, experiment = (
        load("maglev/warm", control_period=1e-3),
        Experiment.load("maglev/warm"),
    )
    physics: Any = environment.physics
    assert (physics.timestep(), environment.control_timestep()) == (0.5e-3, 1e-3)
    for voltage in (4.0, 4.0, 0.0):
        environment.reset()
        # A reset lets go of what was held.
        if voltage:
            physics.set_control(voltage)
        physics.step(20)
        run = grosmc_mj.simulate(
            experiment.plant("corrected"), open_loop(voltage), experiment.case.x0, duration=0.01,
            timestep=0.5e-3, engine="python",
        )  # fmt: skip
        assert physics.time() == 10 * 1e-3
        assert np.array_equal(physics.episode.x, run.state[-1])
    with pytest.raises(ArgumentError, match="maglev is given by equations: only a model in MuJoCo"):
        physics.render()


# In a loop


def bench() -> tuple[Experiment, Episode]:
    """The pendulum's bench without chance in it, for a quarter of a second."""
    experiment = Experiment.load("cart_pendulum/bench")
    assert experiment.case.loop is not None
    loop = experiment.case.loop.changed("computing", "", missed=0.0)
    experiment = experiment.varied(loop=loop, duration=0.25)
    return experiment, Episode("cart_pendulum", experiment)


def seen_by(agent: Episode) -> Array:
    """The state that the agent sees, (n,)."""
    seen = agent.observation()
    return np.concatenate([seen[state.name] for state in agent.plant.system.states])


def test_a_law_as_an_agent_does_what_it_does_in_its_loop() -> None:
    experiment, agent = bench()
    law_in_loop = experiment.law("physics", "implicit")
    run, bare = experiment.run("physics", "implicit").trajectory, replace(law_in_loop, loop=None)
    memory, _kept_alive = bare.begin()
    stride, states = agent.problem.stride, [agent.x]
    assert stride == 2
    while not agent.over:
        # Looking twice changes nothing.
        assert np.array_equal(seen_by(agent), seen_by(agent))
        agent.hold(bare.input_at(agent.time, seen_by(agent), memory))
        agent.advance(stride)
        states.append(agent.x)
    np.testing.assert_allclose(np.array(states), run.state[::stride], rtol=0, atol=1e-9)


def test_sensors_quantize_what_is_seen_and_actions_arrive_after_the_delay() -> None:
    (_, agent), (_, idle), resolution = bench(), bench(), 0.314e-3
    for one, action in ((agent, 5.0), (idle, 0.0)):
        one.hold([action])
        one.advance(2)
    np.testing.assert_array_equal(agent.x, idle.x)
    agent.advance(2)
    idle.advance(2)
    assert agent.x[2] > idle.x[2]
    agent.advance(36)
    steps = seen_by(agent)[1] / resolution
    assert abs(steps - round(steps)) < 1e-9
    assert seen_by(agent)[1] != agent.x[1]


# Wrong use


@pytest.mark.parametrize(
    ("arguments", "options", "error", "said"),
    [
        (("cart_pendulm",), {}, ModelError, "unknown system 'cart_pendulm': did you mean 'cart_p"),
        (("servo", "case3"), {}, ArgumentError, "unknown case of servo 'case3': did you mean"),
        (("servo", of_case(find_case("arm", "case1"))), {}, ArgumentError, "'case1' is one of arm"),
        (("servo",), {"control_period": 1.5e-3}, ArgumentError, "0.0015 s is no multiple of the"),
        (("servo",), {"timestep": -1.0}, ModelError, "timestep = -1 must be from"),
        (("servo",), {"spread": [0.1] * 3}, ArgumentError, "must be one number or 2, finite and"),
        (("servo",), {"spread": -1}, ArgumentError, "not negative: rotor angle [rad], rotor speed"),
        (("servo",), {"spread": "wide"}, ArgumentError, "spread = 'wide' must be one number"),
        *((("servo",), {"action_limit": limit}, ArgumentError, "one number or 1, finite and posi")
          for limit in (0.0, -1.0, math.nan, [1.0, 2.0], "ten")),
    ],
)  # fmt: skip
def test_wrong_use_is_told_in_one_line(
    arguments: Any, options: Any, error: type[GrosmcError], said: str
) -> None:
    with pytest.raises(error) as found:
        load(*arguments, **options)
    assert said in str(found.value)
    assert "\n" not in str(found.value)


def test_a_law_needs_its_states_by_name_its_system_and_its_sampling_time(
    open_loop: Callable[[float], Controller],
) -> None:
    policy = law_policy(law("cart_pendulum"))
    observation: dict[str, Any] = load("cart_pendulum").reset().observation
    for wrong in (
        {name: value for name, value in observation.items() if name != "pole angle"},
        {name: np.zeros((2, 1)) for name in observation},
        np.zeros(9),
    ):
        with pytest.raises(ArgumentError, match="must map time, cart position, pole angle, cart"):
            policy(wrong)  # pyright: ignore[reportArgumentType]
    observation["pole angle"][:] = 2.0
    with pytest.raises(UndefinedLawError, match="t = 0 s: grosmc is undefined at this state"):
        policy(observation)
    with pytest.raises(ArgumentError, match="open loop has no error coordinates"):
        law_policy(open_loop(1.0))
    assert law_policy(open_loop(1.5), "servo")(load("servo").reset().observation) == [1.5]
    discrete = Realization(find_switching("sign"), 1e-3)
    controller = nominal_controller("servo", "grosmc", "corrected", discrete)
    case = cut("servo", "nominal", 0.01)
    states, *_ = stepped(load("servo", of_case(case)), law_policy(controller))
    assert np.array_equal(states, simulated(case, controller, 1e-3).state)
    with pytest.raises(ArgumentError, match=r"for a control period of 0\.001 s, not 0\.002 s"):
        stepped(load("servo", of_case(case), control_period=2e-3), law_policy(controller))
