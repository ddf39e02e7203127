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
from typing import Any, NamedTuple

import numpy as np
import pytest
from conftest import held
from shipped import case_plant, find_case, nominal_controller, of_case

import grosmc_mj
from grosmc_mj.environments import law_policy, register
from grosmc_mj.environments.episode import Episode
from grosmc_mj.environments.gymnasium_ids import IDS
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import (
    ArgumentError,
    DivergenceError,
    GrosmcError,
    ModelError,
    SetupError,
    UndefinedLawError,
)
from grosmc_mj.mechanics.machine import Stop
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.switching import find_switching
from grosmc_mj.theory.control.task import Realization
from grosmc_mj.theory.plants import SYSTEMS

pytestmark = pytest.mark.slow

pytest.importorskip("dm_control")
test_utils = pytest.importorskip("dm_env.test_utils")
gymnasium = pytest.importorskip("gymnasium")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

from grosmc_mj.environments import CaseEnv  # noqa: E402

load = grosmc_mj.environments.load


@cache
def law(system: str, name: str = "grosmc") -> Controller:
    return nominal_controller(system, name, "corrected")


def cut(system: str, name: str, duration: float) -> Experiment:
    """A case with another duration."""
    return replace(find_case(system, name), duration=duration)


class Stepped(NamedTuple):
    """An episode of dm_control: states at the samples, (K + 1, n), inputs, (K, m), last step."""

    states: Array
    inputs: Array
    last: Any


def stepped(environment: Any, policy: Callable[[Any], Any], most: int = 10**6) -> Stepped:
    """Step an environment under a policy to the end, or so many times."""
    names = [signal.name for signal in environment.task.episode.plant.system.states]
    states = []
    inputs = []
    step = environment.reset()
    while True:
        states.append(np.concatenate([step.observation[name] for name in names]))
        if step.last() or len(inputs) == most:
            return Stepped(np.array(states), np.array(inputs), step)
        inputs.append(policy(step.observation))
        step = environment.step(inputs[-1])


def assert_simulated(
    target: str, law_name: str, periods: int, samples: int | None, engine: Any
) -> None:
    """Assert that an environment gives a law the numbers of ``simulate``, and both faces agree.

    Args:
        target: The case.
        law_name: The law.
        periods: The control period, in those of the case.
        samples: Length of the episode in its periods; None for the case's duration.
        engine: Of ``simulate``.
    """
    experiment = Experiment.load(target)
    h = experiment.settings.timestep
    T = periods * experiment.settings.control_period
    duration = samples * T if samples else experiment.duration
    plant_name = experiment.nominal.truest
    controller = experiment.law(plant_name, law_name)

    environment = load(target, control_period=T)
    policy = law_policy(controller, control_period=T)
    episode = stepped(environment, policy, samples or 10**6)
    run = simulate(
        experiment.plant(plant_name),
        controller,
        experiment.x0,
        duration=duration,
        control_period=T,
        timestep=h,
        disturbances=experiment.disturbances,
        engine=engine,
    )
    # The last interval may be cut short by the duration: its end is no sample.
    end = len(run.time) - 1
    rows = [*range(0, end, round(T / h)), end]
    commands = run.command.reshape(end, -1)[rows[:-1]]
    assert np.array_equal(episode.states, run.state[rows])
    assert np.array_equal(episode.inputs, commands)
    assert episode.last.discount == 1.0

    face = CaseEnv(target, control_period=T)
    face.reset()
    environment.reset()
    for action in episode.inputs[:20]:
        observation, reward, *_ = face.step(action)
        step = environment.step(action)
        assert reward == step.reward
        assert list(observation) == list(step.observation)
        for name, value in observation.items():
            assert np.array_equal(value, step.observation[name])


def test_a_law_in_an_environment_gets_simulate_s_numbers_to_the_end() -> None:
    assert_simulated("servo/case2", "grosmc", periods=7, samples=None, engine="native")


@pytest.mark.parametrize(
    ("target", "law_name", "periods"),
    [
        ("two_link_arm/case2", "lqr", 7),
        ("furuta/heavier", "grosmc", 1),
        ("own_laws/pid", "lqr", 1),
        ("maglev/warm", "grosmc", 1),
    ],
)
def test_a_law_in_an_environment_gets_simulate_s_numbers(
    target: str, law_name: str, periods: int
) -> None:
    """To the last bit, at its control period and at longer ones."""
    assert_simulated(target, law_name, periods, samples=20, engine="python")


@cache
def episode_of_5_ms() -> list[Any]:
    """The servo's reset and its steps of 2 ms under 3 A."""
    environment = load("servo", of_case(cut("servo", "nominal", 0.005)), control_period=2e-3)
    start = environment.reset()
    steps = [environment.step(np.array([3.0])) for _ in range(3)]
    return [start, *steps]


@pytest.mark.parametrize(("interval", "length"), [(0, 2e-3), (1, 2e-3), (2, 1e-3)])
def test_a_reward_is_the_stage_cost_at_the_start_of_its_interval_times_its_length(
    interval: int, length: float
) -> None:
    """J is 1/2 of z'Qz + v'Rv."""
    design = law("servo").designed.lqr
    u = np.array([3.0])
    z = episode_of_5_ms()[interval].observation["error"]
    expected = -length * 0.5 * float(z @ design.Q @ z + u @ design.R @ u)
    reward = episode_of_5_ms()[interval + 1].reward
    assert reward == pytest.approx(expected, rel=1e-12)


def test_the_last_interval_ends_at_the_duration() -> None:
    """Of 5 ms in intervals of 2 ms the last is cut to 1 ms."""
    steps = episode_of_5_ms()
    times = [step.observation["time"][0] for step in steps[1:]]
    assert times == pytest.approx([2e-3, 4e-3, 5e-3], rel=1e-12)
    assert steps[-1].last()


def test_an_episode_is_truncated_at_the_duration_of_its_case() -> None:
    environment = CaseEnv("servo", of_case(cut("servo", "nominal", 0.005)), control_period=2e-3)
    environment.reset()
    action = np.array([3.0])
    ends = [environment.step(action)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    with pytest.raises(ArgumentError, match="the episode is over: reset it"):
        environment.step(action)


def test_the_reward_of_equations_is_that_of_their_index() -> None:
    """It weighs gap, rate and acceleration from 10 mm, and the nominal third derivative."""
    environment = CaseEnv("maglev/warm")
    environment.reset()
    m, g, C, R, L, T, V = 0.05, 9.81, 1e-4, 2.0, 0.02, 0.5e-3, 3.0
    y = 0.013
    i = 0.01 * np.sqrt(m * g / C)
    z = np.array([y - 0.01, 0.0, g - C * i**2 / (m * y**2)])
    v = -2 * C * i * (V - R * i) / (L * m * y**2)
    expected = -T / 2 * (z @ np.diag([1e8, 1e5, 10.0]) @ z + 1e-3 * v**2)
    observation, reward, *_ = environment.step(np.array([V]))
    assert reward == pytest.approx(expected, rel=1e-9)
    # The coil that is there is warm: R/L = 150/s changes the rate by 4% within the step.
    current = observation["current"][0]
    assert current - i == pytest.approx(T * (V - 1.5 * R * i) / L, rel=0.05)


ENTRIES = ["cart position", "pole angle", "cart speed", "pole rate", "time", "error", "reference"]


@cache
def cart() -> Any:
    return load("cart_pendulum", control_period=1.1e-2)


def test_observations_have_the_names_of_their_specification() -> None:
    environment = cart()
    spec = environment.observation_spec()
    assert list(environment.reset().observation) == list(spec) == ENTRIES


def test_specifications_have_units() -> None:
    spec = cart().observation_spec()
    assert spec["pole angle"].name == "pole angle [rad]"
    assert spec["error"].name == "error [rad, rad/s]"
    assert cart().action_spec().name.endswith("force [N]")


def test_observations_have_exact_times() -> None:
    """The number of timesteps times their length would not always give k T."""
    environment = cart()
    environment.reset()
    for k in range(1, 41):
        step = environment.step(np.zeros(1))
        assert step.observation["time"][0] == k * 1.1e-2
    assert environment.physics.time() == 40 * 1.1e-2


def test_the_observed_error_is_measured_from_the_observed_reference() -> None:
    environment = load("arm", control_period=0.1)
    environment.reset()
    observation = environment.step(np.zeros(1)).observation
    reference = observation["reference"]
    # One rounding of sin and one product.
    expected = [math.sin(math.pi * 0.1), math.pi * math.cos(math.pi * 0.1)]
    assert reference == pytest.approx(expected, rel=1e-15)
    state = [observation["joint angle"][0], observation["joint rate"][0]]
    assert observation["error"] == pytest.approx(np.subtract(state, reference), abs=1e-15)


@pytest.mark.parametrize(
    ("target", "options", "bound"),
    [
        ("furuta/heavier", {}, 0.15),
        ("arm", {}, np.inf),
        ("servo", {"action_limit": 4.0}, 4.0),
        ("servo", {"action_limit": 4.0, "normalized": True}, 1.0),
    ],
    ids=["the actuator's own", "none", "declared", "normalized"],
)
def test_actions_have_limits(target: str, options: Any, bound: float) -> None:
    space = CaseEnv(target, **options).action_space
    assert (space.low, space.high) == (-bound, bound)  # pyright: ignore


def reward_and_speed(environment: CaseEnv, action: float) -> tuple[float, float]:
    """Reward and rotor speed of the servo after one action."""
    environment.reset()
    observation, reward, *_ = environment.step(np.array([action]))
    return reward, float(observation["rotor speed"][0])


def test_a_normalized_action_is_a_part_of_its_limits() -> None:
    plain = CaseEnv("servo", action_limit=4.0)
    normalized = CaseEnv("servo", action_limit=4.0, normalized=True)
    assert reward_and_speed(plain, 3.0) == reward_and_speed(normalized, 0.75)


def test_an_action_beyond_the_declared_limit_is_cut() -> None:
    """As an actuator does."""
    environment = CaseEnv("servo", action_limit=4.0)
    at_limit = reward_and_speed(environment, 4.0)
    assert reward_and_speed(environment, 9.0) == at_limit
    assert reward_and_speed(environment, 3.0) != at_limit


@pytest.mark.parametrize("action", [[math.nan], "full", [1.0, 2.0], None])
def test_an_action_is_m_finite_numbers(action: Any) -> None:
    environment = CaseEnv("servo", action_limit=4.0)
    environment.reset()
    with pytest.raises(ArgumentError, match=r"must be 1 finite number.*\(1,\): current \[A\]$"):
        environment.step(action)


@pytest.mark.parametrize("one", [3.0, np.float64(3.0), (3.0,)])
def test_one_number_is_an_action_of_a_single_input_as_of_a_policy_s_law(one: Any) -> None:
    """The rule of ``policy_controller``."""
    environment = CaseEnv("servo", action_limit=4.0)
    environment.reset()
    _, reward, *_ = environment.step(one)
    assert reward == reward_and_speed(environment, 3.0)[0]


@pytest.mark.parametrize("face", [load, CaseEnv])
def test_an_experiment_with_other_numbers_is_a_case(face: Any) -> None:
    heavier = of_case(cut("servo", "nominal", 0.01)).changed({"edit.rotor.mass_scale": 3.0})
    environment = face(heavier)
    episode = environment.episode if face is CaseEnv else environment.task.episode
    assert episode.case.edits == heavier.edits != ()


@pytest.mark.parametrize("face", [load, CaseEnv])
def test_options_have_units_as_in_a_case_file(face: Any) -> None:
    options = {"control_period": "10 ms", "action_limit": "500 mA", "spread": ["1 deg", 0.2]}
    environment = face("servo", **options)
    episode = environment.episode if face is CaseEnv else environment.task.episode
    assert episode.problem.control_period == 0.01
    assert episode.high.tolist() == [0.5]
    assert episode._spread.tolist() == [math.radians(1), 0.2]


def starts(*target: Any, seed: int, spread: Any, count: int = 20) -> Array:
    """First entries of the observations of so many starts, (count, entries)."""
    environment = load(*target, spread=spread, seed=seed)
    rows = []
    for _ in range(count):
        observation = environment.reset().observation
        rows.append([value[0] for value in observation.values()])
    return np.array(rows)


WIDTHS = [0.1, 0.2, 0.0, 0.3]


def test_starts_are_drawn_by_a_seed() -> None:
    drawn = starts("cart_pendulum", seed=3, spread=WIDTHS)
    assert np.array_equal(starts("cart_pendulum", seed=3, spread=WIDTHS), drawn)
    assert not np.array_equal(starts("cart_pendulum", seed=4, spread=WIDTHS), drawn)


def test_starts_are_drawn_within_their_widths() -> None:
    drawn = starts("cart_pendulum", seed=5, spread=WIDTHS)[:, :4]
    off = drawn - find_case("cart_pendulum", "nominal").x0
    assert np.all(np.abs(off) <= WIDTHS)
    # Twenty draws that all stay in the middle half, or to one side, have a chance of 1e-6.
    assert np.all(off.max(axis=0) >= [0.01, 0.02, 0.0, 0.03])
    assert np.all(off.min(axis=0) <= [-0.01, -0.02, 0.0, -0.03])


def test_starts_are_drawn_where_the_plant_is_defined() -> None:
    """A third of the box lies beyond pi/2, where the arm's cable has length zero."""
    angles = starts("arm", seed=0, spread=[2.0, 0.0], count=60)[:, 0]
    assert 1.2 < angles.max() < math.pi / 2


def test_starts_are_drawn_between_the_stops() -> None:
    case = replace(find_case("servo", "nominal"), edits=(Stop("shaft", -0.5, 0.2),))
    angles = starts("servo", of_case(case), seed=0, spread=[1.0, 0.0], count=60)[:, 0]
    assert -0.5 <= angles.min() < -0.4
    assert 0.1 < angles.max() <= 0.2


# A constant action that ends the nominal case early.
FATAL: dict[str, Any] = {"two_link_arm": (1e14, -1e14), "arm": 20.0}
each_early_end = pytest.mark.parametrize("system", FATAL)


class EndedEpisode(NamedTuple):
    """An episode that ended early, the reason for its end, and the step after it."""

    episode: Stepped
    reason: str
    next_step: Any
    next_reason: str


@cache
def ended_episode(system: str) -> EndedEpisode:
    environment = load(system, control_period=5e-3)
    action = np.atleast_1d(FATAL[system])
    episode = stepped(environment, lambda _: action)
    reason = environment.task.ended
    next_step = environment.step(np.zeros(len(action)))
    return EndedEpisode(episode, reason, next_step, environment.task.ended)


@cache
def ended_simulation(system: str) -> Any:
    """Error that ends a run of ``simulate`` under the same action."""
    case = find_case(system, "nominal")
    plant = case_plant(case, "physics", Settings())
    with pytest.raises((DivergenceError, UndefinedLawError)) as ended:
        simulate(
            plant,
            held(FATAL[system]),
            case.x0,
            duration=case.duration,
            control_period=5e-3,
            disturbances=case.disturbances,
            engine="python",
        )
    return ended.value


@each_early_end
def test_an_episode_ends_when_simulate_says_so(system: str) -> None:
    """Up to the rounding of k T against i h."""
    time = ended_episode(system).episode.last.observation["time"][0]
    assert time == pytest.approx(ended_simulation(system).time, rel=1e-15)


@each_early_end
def test_an_episode_ends_where_simulate_says_so(system: str) -> None:
    state = ended_episode(system).episode.states[-1]
    assert np.array_equal(state, ended_simulation(system).trajectory.state[-1])


@pytest.mark.parametrize(
    ("system", "error", "words"),
    [
        ("two_link_arm", DivergenceError, "the state grew without bound"),
        ("arm", UndefinedLawError, "the plant is singular at q >= pi/2, where the cable"),
    ],
)
def test_an_episode_ends_for_the_reason_that_simulate_says(
    system: str, error: type[Exception], words: str
) -> None:
    time = ended_simulation(system).time
    assert isinstance(ended_simulation(system), error)
    assert ended_episode(system).reason.startswith(f"t = {time:g} s: {words}")


@each_early_end
def test_an_early_end_has_no_discount_left(system: str) -> None:
    assert ended_episode(system).episode.last.discount == 0.0


@each_early_end
def test_the_reward_of_an_early_end_is_finite(system: str) -> None:
    assert math.isfinite(ended_episode(system).episode.last.reward)


@each_early_end
def test_the_step_after_an_early_end_begins_an_episode(system: str) -> None:
    assert ended_episode(system).next_step.first()
    assert ended_episode(system).next_reason == ""


def test_an_episode_terminates_where_no_next_step_is_defined() -> None:
    environment = CaseEnv("cart_pendulum/nominal")
    observation, info = environment.reset()
    terminated = False
    truncated = False
    angles = []
    while not terminated:
        angles.append(abs(float(observation["pole angle"][0])))
        observation, _, terminated, truncated, info = environment.step(np.array([-20.0]))
    assert not truncated
    assert "the index is undefined outside |theta| < pi/2" in info["ended"]
    assert info["units"]["time"] == "s"
    # The last valid state is seen.
    assert abs(observation["pole angle"][0]) >= math.pi / 2 > angles[-1]
    with pytest.raises(ArgumentError, match=r"the episode is over at t = .*: reset it"):
        environment.step(np.zeros(1))


class TestSpecification(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """dm_env's own tests, through the end of an episode."""

    def make_object_under_test(self) -> Any:
        return load("servo", of_case(cut("servo", "case1", 0.01)), spread=0.1, seed=1)

    def make_action(self) -> Array:
        # dm_env would take the lower bound, which is infinite.
        return np.array([0.1])


# Equations have no body, and so no picture.
@pytest.mark.parametrize(
    ("target", "render_modes"), [("two_link_arm", ["rgb_array"]), ("maglev/warm", [])]
)
def test_gymnasium_s_checker_has_nothing_to_say(target: str, render_modes: list[str]) -> None:
    """It makes an environment again from its spec, too."""
    spec = gymnasium.envs.registration.EnvSpec(
        "Case-v0",
        entry_point="grosmc_mj.environments.gymnasium_face:CaseEnv",
        kwargs={"system": target, "spread": 1e-4, "action_limit": 10.0, "normalized": True},
    )
    environment = gymnasium.make(pickle.loads(pickle.dumps(spec))).unwrapped
    assert environment.metadata["render_modes"] == render_modes
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env_checker.check_env(environment, skip_render_check=bool(render_modes))


def test_every_system_has_an_id() -> None:
    assert register() == tuple(IDS)
    assert set(IDS.values()) == set(SYSTEMS)


def test_an_id_can_name_the_module_that_registers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    module = "grosmc_mj.environments.gymnasium_ids"
    monkeypatch.delitem(gymnasium.registry, "grosmc_mj/Arm-v0")
    monkeypatch.delitem(sys.modules, module, raising=False)
    environment: Any = gymnasium.make(f"{module}:grosmc_mj/Arm-v0", task="case2")
    assert environment.unwrapped.episode.case.name == "case2"


def test_without_gymnasium_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(SetupError, match=r"pip install 'grosmc_mj\[gymnasium\]'"):
        register()


DRAWN = """
import numpy as np
from grosmc_mj.environments import CaseEnv
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
@pytest.mark.parametrize("backend", [{"MUJOCO_GL": "egl"}, {}])
def test_it_draws_what_it_is_at(backend: dict[str, str]) -> None:
    """In a process of its own: MuJoCo reads once what draws, and without a word nothing would."""
    names = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    subprocess.run([sys.executable, "-c", DRAWN], check=True, env=environment | backend)


CHECKED = """
import warnings
import gymnasium
from gymnasium.utils import env_checker
from grosmc_mj.environments import register
register()
options = {"spread": 1e-4, "action_limit": 10.0, "normalized": True}
environment = gymnasium.make("grosmc_mj/TwoLinkArm-v0", **options)
warnings.simplefilter("error")
env_checker.check_env(environment.unwrapped)
"""


@pytest.mark.render
def test_gymnasium_s_checker_draws_without_a_chosen_backend() -> None:
    """It makes the environment again in each render mode."""
    names = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    subprocess.run([sys.executable, "-c", CHECKED], check=True, env=environment)


def advanced(action: float, steps: int) -> Episode:
    """The pendulum's bench after so many timesteps under an action."""
    episode = Episode("cart_pendulum", "bench")
    episode.hold([action])
    episode.advance(steps)
    return episode


@pytest.mark.parametrize(("steps", "arrived"), [(2, False), (4, True)])
def test_actions_arrive_after_the_delay(steps: int, arrived: bool) -> None:
    moved = not np.array_equal(advanced(5.0, steps).x, advanced(0.0, steps).x)
    assert moved == arrived


def test_sensors_quantize_observations() -> None:
    """Looking twice changes nothing."""
    episode = advanced(5.0, 40)
    first = episode.observation()["pole angle"][0]
    second = episode.observation()["pole angle"][0]
    assert first == second != episode.x[1]
    assert first / 0.314e-3 == pytest.approx(round(first / 0.314e-3), abs=1e-9)


@pytest.mark.parametrize(
    ("target", "error", "words"),
    [
        (("cart_pendulm",), ModelError, "unknown system 'cart_pendulm': did you mean 'cart_p"),
        (("servo", "case3"), ArgumentError, "unknown case of servo 'case3': did you mean"),
        ((of_case(find_case("arm", "case1")), "case2"), ArgumentError, "leave out task"),
        (("servo", of_case(find_case("arm", "case1"))), ArgumentError, "'case1' is one of arm"),
    ],
)
def test_a_wrong_case_is_refused_in_one_line(
    target: tuple[Any, ...], error: type[GrosmcError], words: str
) -> None:
    with pytest.raises(error) as refused:
        load(*target)
    assert words in str(refused.value)


def test_a_start_where_the_plant_is_singular_is_refused() -> None:
    case = replace(find_case("arm", "nominal"), x0=(1.6, 0.0))
    with pytest.raises(ArgumentError) as refused:
        load("arm", of_case(case))
    assert "arm/nominal can't start: the plant is singular at q" in str(refused.value)


@pytest.mark.parametrize(
    ("face", "target", "options", "words"),
    [
        (load, "servo", {"spread": [0.1] * 3}, "must be one number or 2, finite and"),
        (load, "servo", {"control_dt": 0.01}, "unknown option 'control_dt': did you mean 'contr"),
        (CaseEnv, "servo", {"renders": 1}, "spread, action_limit, normalized, render_mode, size"),
        (load, "servo", {"control_period": "10 m"}, 'control_period: "10 m" cannot be converted'),
        (load, "servo", {"action_limit": "4 N"}, 'action_limit: "4 N" cannot be converted to A'),
        (load, "servo", {"spread": "1 deg"}, 'spread: "1 deg" cannot be converted to rad/s'),
        (load, "servo", {"spread": -1}, "not negative: rotor angle [rad], rotor speed"),
        (load, "servo", {"action_limit": 0.0}, "one number or 1, finite and positive"),
        (CaseEnv, "servo", {"normalized": True}, "normalized actions need limits, curr"),
        (CaseEnv, "servo", {"render_mode": "human"}, "'human': valid: rgb_array"),
        (CaseEnv, "maglev/warm", {"render_mode": "rgb_array"}, "maglev is given by equa"),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(
    face: Callable[..., Any], target: str, options: Any, words: str
) -> None:
    with pytest.raises(ArgumentError) as refused:
        face(target, **options)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    "observation",
    [{}, dict.fromkeys(ENTRIES, np.zeros((2, 1))), np.zeros(9)],
    ids=["empty", "batched", "flat"],
)
def test_a_law_needs_its_states_by_name(observation: Any) -> None:
    with pytest.raises(ArgumentError, match="must map time, cart position, pole angle, cart"):
        law_policy(law("cart_pendulum"))(observation)


def test_a_law_is_undefined_where_its_plant_is() -> None:
    observation = load("cart_pendulum").reset().observation
    observation["pole angle"][:] = 2.0
    with pytest.raises(UndefinedLawError, match="t = 0 s: grosmc is undefined at this state"):
        law_policy(law("cart_pendulum"))(observation)


def test_a_law_without_design_needs_its_system(
    open_loop: Callable[[float], Controller],
) -> None:
    with pytest.raises(ArgumentError, match="open loop has no error coordinates"):
        law_policy(open_loop(1.0))
    observation = load("servo").reset().observation
    assert law_policy(open_loop(1.5), "servo")(observation) == [1.5]


def test_a_law_needs_its_control_period() -> None:
    discrete = Realization(find_switching("sign"), 1e-3)
    controller = nominal_controller("servo", "grosmc", "corrected", discrete)
    case = of_case(cut("servo", "nominal", 0.01))
    stepped(load("servo", case), law_policy(controller))
    with pytest.raises(ArgumentError, match=r"for a control period of 0\.001 s, not 0\.002 s"):
        stepped(load("servo", case, control_period=2e-3), law_policy(controller))
