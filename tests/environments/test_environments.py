"""The cases as environments: the numbers of ``simulate``, the index as reward, clear ends."""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
import unittest
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from shipped import case_plant, find_case, nominal_controller, of_case

import grosmc_mj
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization
from grosmc_mj.environments import law_policy, register
from grosmc_mj.environments.episode import Episode
from grosmc_mj.environments.gymnasium_ids import IDS
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
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.machine import Stop
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.simulate import simulate

pytestmark = pytest.mark.slow

pytest.importorskip("dm_control")
test_utils = pytest.importorskip("dm_env.test_utils")
gymnasium = pytest.importorskip("gymnasium")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

from grosmc_mj.environments.gymnasium_face import CaseEnv  # noqa: E402

load = grosmc_mj.environments.load


@cache
def law(system: str, name: str = "grosmc") -> Controller:
    return nominal_controller(system, name, "corrected")


def cut(system: str, name: str, duration: float) -> Case:
    """A case with another duration."""
    return replace(find_case(system, name), duration=duration)


def stepped(
    environment: Any, policy: Callable[[Any], Any], most: int = 10**6
) -> tuple[Array, Array, Any]:
    """States at the samples, inputs and last time step of an episode of dm_control."""
    names = [signal.name for signal in environment.task.episode.plant.system.states]
    step, states, inputs = environment.reset(), [], []
    while True:
        states.append(np.concatenate([step.observation[name] for name in names]))
        if step.last() or len(inputs) == most:
            return np.array(states), np.array(inputs), step
        inputs.append(policy(step.observation))
        step = environment.step(inputs[-1])


@pytest.mark.parametrize(
    ("target", "factor"),
    [("servo/case2", 7), ("two_link_arm/case2", 7), ("furuta/heavier", 1), ("own_laws/pid", 1),
     ("maglev/warm", 1)],
)  # fmt: skip
def test_a_law_in_an_environment_gets_simulate_s_numbers_to_the_last_bit(
    target: str, factor: int
) -> None:
    """At its period and longer ones; both faces have the same observations and rewards."""
    experiment = Experiment.load(target)
    T, h = factor * experiment.settings.control_period, experiment.settings.timestep
    where, ends = experiment.nominal.truest, (target, factor) == ("servo/case2", 7)
    controller = experiment.law(where, experiment.controllers[0 if "two" in target else -1])
    one, other = load(target, control_period=T), CaseEnv(target, control_period=T)
    policy = law_policy(controller, control_period=T)
    states, inputs, last = stepped(one, policy, 10**6 if ends else 20)
    run = simulate(
        experiment.plant(where), controller, experiment.case.x0, control_period=T, timestep=h,
        duration=experiment.case.duration if ends else 20 * T,
        disturbances=experiment.case.disturbances, engine="native" if ends else "python",
    )  # fmt: skip
    # The last interval may be cut short by the duration: its end is no sample.
    rows = [*range(0, len(run.time) - 1, round(T / h)), len(run.time) - 1]
    assert np.array_equal(states, run.state[rows])
    assert np.array_equal(inputs, run.command.reshape(len(run.command), -1)[rows[:-1]])
    assert last.discount == 1.0
    other.reset()
    one.reset()
    for action in inputs[:20]:
        observation, reward, *_ = other.step(action)
        step = one.step(action)
        assert reward == step.reward
        assert list(observation) == list(step.observation)
        assert all(np.array_equal(observation[key], step.observation[key]) for key in observation)


def test_a_reward_is_the_stage_cost_at_the_start_of_its_interval_times_its_length() -> None:
    """Of 5 ms in intervals of 2 ms the last is cut to 1 ms; J is 1/2 of z'Qz + v'Rv."""
    case = of_case(cut("servo", "nominal", 0.005))
    face = CaseEnv("servo", case, control_period=2e-3)
    environment = load("servo", case, control_period=2e-3)
    design, step, u = law("servo").designed.lqr, environment.reset(), np.array([3.0])
    face.reset()
    for length, end in ((2e-3, 2e-3), (2e-3, 4e-3), (1e-3, 5e-3)):
        z = step.observation["error"]
        step = environment.step(u)
        expected = -length * 0.5 * float(z @ design.Q @ z + u @ design.R @ u)
        assert step.reward == pytest.approx(expected, rel=1e-12)
        assert step.observation["time"][0] == pytest.approx(end, rel=1e-12)
        # Truncated at the duration of its case.
        assert face.step(u)[2:4] == (False, step.last()) == (False, end == 5e-3)
    with pytest.raises(ArgumentError, match="the episode is over: reset it"):
        face.step(u)


def test_the_reward_of_equations_is_that_of_their_index() -> None:
    """It weighs gap, rate and acceleration from 10 mm, and the nominal third derivative."""
    environment = CaseEnv("maglev/warm")
    environment.reset()
    m, g, C, R, L, T, V = 0.05, 9.81, 1e-4, 2.0, 0.02, 0.5e-3, 3.0
    y, i = 0.013, 0.01 * np.sqrt(m * g / C)
    z = np.array([y - 0.01, 0.0, g - C * i**2 / (m * y**2)])
    v = -2 * C * i * (V - R * i) / (L * m * y**2)
    expected = -T / 2 * (z @ np.diag([1e8, 1e5, 10.0]) @ z + 1e-3 * v**2)
    seen, reward, *_ = environment.step(np.array([V]))
    assert reward == pytest.approx(expected, rel=1e-9)
    # The coil that is there is warm: R/L = 150/s changes the rate by 4% within the step.
    assert seen["current"][0] - i == pytest.approx(T * (V - 1.5 * R * i) / L, rel=0.05)


def test_observations_have_names_units_and_exact_times() -> None:
    environment = load("cart_pendulum", control_period=1.1e-2)
    step, spec = environment.reset(), environment.observation_spec()
    names = ["cart position", "pole angle", "cart speed", "pole rate", "time", "error", "reference"]
    assert list(step.observation) == list(spec) == names
    assert spec["pole angle"].name == "pole angle [rad]"
    assert spec["error"].name == "error [rad, rad/s]"
    assert environment.action_spec().name.endswith("force [N]")
    for k in range(1, 41):
        step = environment.step(np.zeros(1))
        # Which the number of timesteps would not always give.
        assert step.observation["time"][0] == k * 1.1e-2
    assert environment.physics.time() == 40 * 1.1e-2
    arm = load("arm", control_period=0.1)
    arm.reset()
    seen = arm.step(np.zeros(1)).observation
    # One rounding of sin and one product.
    expected = [math.sin(math.pi * 0.1), math.pi * math.cos(math.pi * 0.1)]
    assert seen["reference"] == pytest.approx(expected, rel=1e-15)
    state = [seen["joint angle"][0], seen["joint rate"][0]]
    assert seen["error"] == pytest.approx(np.subtract(state, seen["reference"]), abs=1e-15)


def test_a_normalized_action_is_a_part_of_its_limits() -> None:
    plain, parts = (CaseEnv("servo", action_limit=4.0, normalized=one) for one in (False, True))
    # The actuators' own limits; those of one without limits; declared ones.
    for environment, bound in ((CaseEnv("furuta/heavier"), 0.15), (CaseEnv("arm"), np.inf),
                               (plain, 4.0), (parts, 1.0)):  # fmt: skip
        space = environment.action_space
        assert (space.low, space.high) == (-bound, bound)  # pyright: ignore
    results = []
    for environment, action in ((plain, 3.0), (parts, 0.75), (plain, 9.0), (plain, 4.0)):
        environment.reset()
        seen, reward, *_ = environment.step(np.array([action]))
        results.append((reward, float(seen["rotor speed"][0])))
    assert results[0] == results[1]
    wrong: tuple[Any, ...] = ([math.nan], 1.0, [1.0, 2.0], None)
    for action in wrong:
        with pytest.raises(ArgumentError, match=r"must be 1 finite number.*\(1,\): current \[A\]$"):
            plain.step(action)
    # An action beyond the declared limit is cut, as an actuator does.
    assert results[2] == results[3] != results[0]


def test_starts_are_drawn_within_their_widths_by_a_seed_where_the_plant_is_defined() -> None:
    def starts(target: Any, seed: int, spread: Any, count: int = 20) -> Array:
        environment = load(*target, spread=spread, seed=seed)
        resets = [list(environment.reset().observation.values()) for _ in range(count)]
        return np.array([[value[0] for value in seen] for seen in resets])

    cart, widths = ("cart_pendulum",), [0.1, 0.2, 0.0, 0.3]
    drawn = starts(cart, 3, widths)
    assert np.array_equal(starts(cart, 3, widths), drawn)
    assert not np.array_equal(starts(cart, 4, widths), drawn)
    off = starts(cart, 5, widths)[:, :4] - find_case(*cart, "nominal").x0
    assert np.all(np.abs(off) <= widths)
    # Twenty draws that all stay in the middle half, or to one side, have a chance of 1e-6.
    assert np.all(off.max(axis=0) >= [0.01, 0.02, 0.0, 0.03])
    assert np.all(off.min(axis=0) <= [-0.01, -0.02, 0.0, -0.03])
    # A third of the box lies beyond pi/2, where the arm's cable has length zero.
    assert 1.2 < starts(("arm",), 0, [2.0, 0.0], 60)[:, 0].max() < math.pi / 2
    case = of_case(replace(find_case("servo", "nominal"), edits=(Stop("shaft", -0.5, 0.2),)))
    angles = starts(("servo", case), 0, [1.0, 0.0], 60)[:, 0]
    assert -0.5 <= angles.min() < -0.4
    assert 0.1 < angles.max() <= 0.2


@pytest.mark.parametrize(
    ("system", "action", "error", "words"),
    [
        ("two_link_arm", (1e14, -1e14), DivergenceError, "the state grew without bound"),
        ("arm", 20.0, UndefinedLawError, "the plant is singular at q >= pi/2, where the cable"),
    ],
)
def test_an_episode_ends_when_and_where_simulate_says_so(
    system: str, action: Any, error: Any, words: str, open_loop: Callable[[Any], Controller]
) -> None:
    environment, case = load(system, control_period=5e-3), find_case(system, "nominal")
    states, _, last = stepped(environment, lambda _: np.atleast_1d(action))
    plant = case_plant(case, "physics", Settings())
    with pytest.raises(error) as ended:
        simulate(
            plant, open_loop(action), case.x0, duration=case.duration, control_period=5e-3,
            disturbances=case.disturbances, engine="python",
        )  # fmt: skip
    assert last.discount == 0.0
    # k T and i h.
    assert last.observation["time"][0] == pytest.approx(ended.value.time, rel=1e-15)
    assert np.array_equal(states[-1], ended.value.trajectory.state[-1])
    assert environment.task.ended.startswith(f"t = {ended.value.time:g} s: {words}")
    assert math.isfinite(last.reward)
    assert environment.step(np.zeros(np.size(action))).first()
    assert environment.task.ended == ""


def test_an_episode_terminates_where_no_next_step_is_defined() -> None:
    environment = CaseEnv("cart_pendulum/nominal")
    seen, info = environment.reset()
    terminated, truncated, angles = False, False, []
    while not terminated:
        angles.append(abs(float(seen["pole angle"][0])))
        seen, _, terminated, truncated, info = environment.step(np.array([-20.0]))
    assert not truncated
    assert "the index is undefined outside |theta| < pi/2" in info["ended"]
    assert info["units"]["time"] == "s"
    # The last valid state is seen.
    assert abs(seen["pole angle"][0]) >= math.pi / 2 > angles[-1]
    with pytest.raises(ArgumentError, match=r"the episode is over at t = .*: reset it"):
        environment.step(np.zeros(1))


class TestSpecification(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """dm_env's own tests, through the end of an episode."""

    def make_object_under_test(self) -> Any:
        return load("servo", of_case(cut("servo", "case1", 0.01)), spread=0.1, seed=1)

    def make_action(self) -> Array:
        # dm_env would take the lower bound, which is infinite.
        return np.array([0.1])


@pytest.mark.parametrize("target", ["two_link_arm", "maglev/warm"])
def test_gymnasium_s_checker_has_nothing_to_say(target: str) -> None:
    """It makes an environment again from its spec, too."""
    numbers = {"spread": 1e-4, "action_limit": 10.0, "normalized": True}
    face = "grosmc_mj.environments.gymnasium_face:CaseEnv"
    spec = gymnasium.envs.registration.EnvSpec(
        "Case-v0", entry_point=face, kwargs={"system": target, **numbers}
    )
    environment = gymnasium.make(pickle.loads(pickle.dumps(spec))).unwrapped
    equations = target == "maglev/warm"
    assert environment.metadata["render_modes"] == ([] if equations else ["rgb_array"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env_checker.check_env(environment, skip_render_check=not equations)


def test_every_system_has_an_id_that_can_name_the_module_which_registers_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert register() == tuple(IDS)
    assert set(IDS.values()) == set(SYSTEMS)
    module = "grosmc_mj.environments.gymnasium_ids"
    monkeypatch.delitem(gymnasium.registry, "grosmc_mj/Arm-v0")
    monkeypatch.delitem(sys.modules, module, raising=False)
    environment: Any = gymnasium.make(f"{module}:grosmc_mj/Arm-v0", task="case2")
    assert environment.unwrapped.episode.case.name == "case2"
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(SetupError, match=r"pip install 'grosmc_mj\[gymnasium\]'"):
        register()


DRAWN = """
import numpy as np
from grosmc_mj.environments.gymnasium_face import CaseEnv
environment = CaseEnv("furuta/heavier", render_mode="rgb_array", size=(200, 150))
environment.reset()
first = environment.render()
assert first.shape == (150, 200, 3)
for _ in range(150):
    environment.step(np.array([0.15]))
assert np.abs(environment.render().astype(int) - first).max() > 30
environment.close()
"""


@pytest.mark.render
def test_it_draws_what_it_is_at() -> None:
    """In a process of its own: MuJoCo reads once what draws."""
    own = {**os.environ, "MUJOCO_GL": "egl"}
    subprocess.run([sys.executable, "-c", DRAWN], check=True, env=own)


def test_sensors_quantize_observations_and_actions_arrive_after_the_delay() -> None:
    """On the pendulum's bench."""
    agent, idle = Episode("cart_pendulum", "bench"), Episode("cart_pendulum", "bench")
    agent.hold([5.0])
    idle.hold([0.0])
    for steps, moved in ((2, False), (2, True)):
        agent.advance(steps)
        idle.advance(steps)
        assert np.array_equal(agent.x, idle.x) != moved
    agent.advance(36)
    # Looking twice changes nothing.
    first, second = (agent.observation()["pole angle"][0] for _ in range(2))
    assert first == second != agent.x[1]
    assert first / 0.314e-3 == pytest.approx(round(first / 0.314e-3), abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "options", "error", "words"),
    [
        (("cart_pendulm",), {}, ModelError, "unknown system 'cart_pendulm': did you mean 'cart_p"),
        (("servo", "case3"), {}, ArgumentError, "unknown case of servo 'case3': did you mean"),
        (("servo", of_case(find_case("arm", "case1"))), {}, ArgumentError, "'case1' is one of arm"),
        (("arm", of_case(replace(find_case("arm", "nominal"), x0=(1.6, 0.0)))), {}, ArgumentError,
         "arm/nominal can't start: the plant is singular at q"),
        (("servo",), {"spread": [0.1] * 3}, ArgumentError, "must be one number or 2, finite and"),
        (("servo",), {"spread": -1}, ArgumentError, "not negative: rotor angle [rad], rotor speed"),
        (("servo",), {"action_limit": 0.0}, ArgumentError, "one number or 1, finite and positive"),
        (("servo",), {"normalized": True}, ArgumentError, "normalized actions need limits, curr"),
        (("servo",), {"render_mode": "human"}, ArgumentError, "'human': valid: rgb_array"),
        (("maglev/warm",), {"render_mode": "rgb_array"}, ArgumentError, "maglev is given by equa"),
    ],
)  # fmt: skip
def test_wrong_use_is_refused_in_one_line(
    arguments: Any, options: Any, error: type[GrosmcError], words: str
) -> None:
    face = CaseEnv if {"normalized", "render_mode"} & options.keys() else load
    with pytest.raises(error) as refused:
        face(*arguments, **options)
    assert words in str(refused.value)


def test_a_law_needs_its_states_by_name_its_system_and_its_sampling_time(
    open_loop: Callable[[float], Controller],
) -> None:
    policy = law_policy(law("cart_pendulum"))
    observation: dict[str, Any] = load("cart_pendulum").reset().observation
    for wrong in ({}, {name: np.zeros((2, 1)) for name in observation}, np.zeros(9)):
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
    case = of_case(cut("servo", "nominal", 0.01))
    stepped(load("servo", case), law_policy(controller))
    with pytest.raises(ArgumentError, match=r"for a control period of 0\.001 s, not 0\.002 s"):
        stepped(load("servo", case, control_period=2e-3), law_policy(controller))
