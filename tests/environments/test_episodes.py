"""A case under somebody's actions: the numbers of ``simulate``, the index as reward, clear ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cases
import numpy as np
import pytest
from mjcf import ONE
from open_loop import held

from grosmc_mj.environments import law_policy
from grosmc_mj.environments.episode import Episode
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import (
    ArgumentError,
    DivergenceError,
    GrosmcError,
    ModelError,
    UndefinedLawError,
)
from grosmc_mj.simulation.simulate import simulate

TORQUE = {"body": "rotor", "torque": ["0 N m", "0.1 N m", "0 N m"], "profile": "sine"}


def servo(**tables: Any) -> Experiment:
    """A rotor at rest at 0.5 rad, for 25 ms in intervals of 10 ms."""
    run = {"start": {"rotor angle": "0.5 rad"}, "duration": "25 ms", "control_period": "10 ms"}
    return cases.case("servo", run=run, **tables)


class Course(NamedTuple):
    """Course of an episode.

    Attributes:
        states: Observed states at the samples, (K + 1, n).
        inputs: Actions, (K, m).
        errors: Observed errors, (K + 1, n).
        times: Observed times [s], (K + 1,).
        rewards: Rewards, (K,).
    """

    states: Array
    inputs: Array
    errors: Array
    times: Array
    rewards: Array


def course_of(episode: Episode, policy: Callable[[Any], Any]) -> Course:
    """Act by a policy to the end of an episode."""
    names = [state.name for state in episode.plant.system.states]
    observations = [episode.observation()]
    inputs = []
    rewards = []
    while not episode.over and not episode.ended:
        inputs.append(policy(observations[-1]))
        episode.hold(inputs[-1])
        rewards.append(episode.reward)
        episode.advance(episode.problem.stride)
        observations.append(episode.observation())
    states = np.array([[seen[name][0] for name in names] for seen in observations])
    times = np.array([seen["time"][0] for seen in observations])
    errors = np.array([seen["error"] for seen in observations])
    return Course(states, np.array(inputs), errors, times, np.array(rewards))


@pytest.mark.parametrize(
    ("experiment", "law"),
    [
        (lambda: servo(law="grosmc", disturbance={**TORQUE, "frequency": "9 Hz"}), "grosmc"),
        (lambda: Experiment.load("two_link_arm/case2").changed(control_period=7e-3), "lqr"),
        (lambda: Experiment.load("furuta/heavier"), "grosmc"),
        (lambda: Experiment.load("maglev/warm"), "grosmc"),
    ],
)
def test_a_law_in_an_episode_gets_simulate_s_numbers(experiment: Any, law: str) -> None:
    """To the last bit; the duration cuts the last interval short, and its end is no sample."""
    case = experiment()
    T = case.settings.control_period
    case = case.changed(duration=case.duration if case.system == "servo" else 10 * T)
    plant = case.plant(case.nominal.truest)
    controller = case.law(case.nominal.truest, law)
    run = simulate(
        plant,
        controller,
        case.x0,
        duration=case.duration,
        control_period=T,
        timestep=case.settings.timestep,
        disturbances=case.disturbances,
        engine="python",
    )
    course = course_of(Episode(case), law_policy(controller, control_period=T))
    end = len(run.time) - 1
    samples = np.arange(0, end, round(T / case.settings.timestep))
    np.testing.assert_array_equal(course.states, run.state[[*samples, end]])
    np.testing.assert_array_equal(course.inputs, run.command.reshape(end, -1)[samples])


# Rewards.


def test_a_reward_is_the_stage_cost_at_the_start_of_its_interval_times_its_length() -> None:
    """J is 1/2 of z'Qz + v'Rv; of 25 ms in intervals of 10 ms the last is cut to 5 ms."""
    case = servo()
    design = case.law("physics", "lqr").designed.lqr
    u = np.array([3.0])
    course = course_of(Episode(case), lambda _: u)
    assert course.times == pytest.approx([0.0, 0.01, 0.02, 0.025], rel=1e-12)
    costs = [0.5 * float(z @ design.Q @ z + u @ design.R @ u) for z in course.errors[:3]]
    expected = -np.array([0.01, 0.01, 0.005]) * costs
    np.testing.assert_allclose(course.rewards, expected, rtol=1e-12)


def test_without_the_robust_law_the_last_law_has_the_index_of_the_reward(tmp_path: Path) -> None:
    """At rest it is that of the input alone, with R = 7 of the second law, not 1 of the first."""
    (tmp_path / "one.xml").write_text(ONE.format("", '<motor name="drive" joint="hinge"/>'))
    light = {"name": "light", "law": "lqr", "R": 1}
    heavy = {"name": "heavy", "law": "lqr", "R": 7}
    rewards = []
    for laws in ([light], [light, heavy]):
        case = cases.case("one.xml", folder=tmp_path, controller=laws, task={"Q": [1, 1]})
        episode = Episode(case)
        episode.hold([3.0])
        rewards.append(episode.reward)
    assert rewards[1] == pytest.approx(7 * rewards[0])
    assert rewards[0] < 0


def test_the_reward_of_equations_is_that_of_their_index() -> None:
    """It weighs gap, rate and acceleration from 10 mm, and the nominal third derivative."""
    episode = Episode("maglev/warm")
    m, g, C, R, L, T, V = 0.05, 9.81, 1e-4, 2.0, 0.02, 0.5e-3, 3.0
    y = 0.013
    i = 0.01 * np.sqrt(m * g / C)
    z = np.array([y - 0.01, 0.0, g - C * i**2 / (m * y**2)])
    v = -2 * C * i * (V - R * i) / (L * m * y**2)
    expected = -T / 2 * (z @ np.diag([1e8, 1e5, 10.0]) @ z + 1e-3 * v**2)
    episode.hold([V])
    assert episode.reward == pytest.approx(expected, rel=1e-9)
    # The coil that is there is warm: R/L = 150/s changes the rate by 4% within the step.
    episode.advance(1)
    current = episode.observation()["current"][0]
    assert current - i == pytest.approx(T * (V - 1.5 * R * i) / L, rel=0.05)


def test_an_action_beyond_its_limit_is_cut_and_costs_what_is_applied() -> None:
    episode = Episode(servo(), action_limit=0.2)
    rewards = []
    speeds = []
    for action in (5.0, 0.2, 0.1):
        episode.restart(np.array([0.5, 0.0]))
        episode.hold([action])
        episode.advance(10)
        rewards.append(episode.reward)
        speeds.append(episode.x[1])
    assert rewards[0] == rewards[1] != rewards[2]
    assert speeds[0] == speeds[1] != speeds[2]


# Observations.


def test_observations_have_exact_times() -> None:
    """The number of timesteps times their length would not always give k T."""
    case = Experiment.load("cart_pendulum/nominal").changed(duration=0.44, control_period=1.1e-2)
    times = course_of(Episode(case), lambda _: 0.0).times
    assert times.tolist() == [k * 1.1e-2 for k in range(41)]


def test_the_observed_error_is_measured_from_the_observed_reference() -> None:
    episode = Episode("arm", control_period=0.1)
    episode.advance(100)
    observation = episode.observation()
    reference = observation["reference"]
    # One rounding of sin and one product.
    expected = [math.sin(math.pi * 0.1), math.pi * math.cos(math.pi * 0.1)]
    assert reference == pytest.approx(expected, rel=1e-15)
    state = [observation["joint angle"][0], observation["joint rate"][0]]
    assert observation["error"] == pytest.approx(np.subtract(state, reference), abs=1e-15)


@pytest.mark.parametrize(("steps", "arrived"), [(2, False), (4, True)])
def test_actions_arrive_after_the_delay_of_the_loop(steps: int, arrived: bool) -> None:
    states = []
    for action in (0.0, 5.0):
        episode = Episode("cart_pendulum", "bench")
        episode.hold([action])
        episode.advance(steps)
        states.append(episode.x)
    assert np.any(states[0] != states[1]) == arrived


def test_sensors_quantize_observations() -> None:
    """Looking twice changes nothing."""
    episode = Episode("cart_pendulum", "bench")
    episode.hold([5.0])
    episode.advance(40)
    first = episode.observation()["pole angle"][0]
    assert first == episode.observation()["pole angle"][0] != episode.x[1]
    assert first / 0.314e-3 == pytest.approx(round(first / 0.314e-3), abs=1e-9)


def test_each_episode_of_a_seed_has_noise_of_its_own() -> None:
    episode = Episode(servo(sensor={"of": "rotor angle", "noise": "10 mrad"}))
    angles: list[list[float]] = []
    for _ in range(2):
        random = np.random.default_rng(0)
        angles.append([])
        for _ in range(3):
            episode.reset(random)
            angles[-1].append(float(episode.observation()["rotor angle"][0]))
    assert len(set(angles[0])) == 3
    assert angles[0] == angles[1]


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        ({}, [0.75, 1.0, 1.25, 1.25]),
        ({"sensor": {"of": "rotor angle", "delay": "10 ms"}}, [0.75, 0.75, 1.0, 1.0]),
    ],
)
def test_an_agent_observes_the_disturbance_of_a_measurement(
    sensor: dict[str, Any], expected: list[float]
) -> None:
    """The rotor rests at 0.5 rad; a late sensor tells the disturbance late, too."""
    steps = {"profile": "table", "values": [1, 2, 3], "hold": "10 ms"}
    disturbance = {"measured": "rotor angle", "amplitude": "0.25 rad", **steps}
    episode = Episode(servo(disturbance=disturbance, **sensor))
    course = course_of(episode, lambda _: 0.0)
    assert course.states[:, 0].tolist() == expected


def test_a_new_episode_begins_without_the_last_action() -> None:
    episode = Episode(servo())
    episode.hold([1.0])
    episode.advance(5)
    assert episode.x[1] != 0
    episode.reset(np.random.default_rng(0))
    episode.advance(5)
    assert episode.x.tolist() == [0.5, 0.0]


# Starts.


def starts(*target: Any, seed: int, spread: Any, count: int = 20) -> Array:
    """So many drawn starts, (count, n)."""
    episode = Episode(*target, spread=spread)
    random = np.random.default_rng(seed)
    return np.array([episode.start(random) for _ in range(count)])


def test_starts_are_drawn_within_their_widths_by_a_seed() -> None:
    widths = [0.1, 0.2, 0.0, 0.3]
    drawn = starts("cart_pendulum", seed=5, spread=widths)
    assert np.array_equal(starts("cart_pendulum", seed=5, spread=widths), drawn)
    off = drawn - Experiment.load("cart_pendulum/nominal").x0
    assert np.all(np.abs(off) <= widths)
    # Twenty draws that all stay in the middle half, or to one side, have a chance of 1e-6.
    assert np.all(off.max(axis=0) >= [0.01, 0.02, 0.0, 0.03])
    assert np.all(off.min(axis=0) <= [-0.01, -0.02, 0.0, -0.03])


def test_starts_are_drawn_where_the_plant_is_defined() -> None:
    """A third of the box lies beyond pi/2, where the arm's cable has length zero."""
    angles = starts("arm", seed=0, spread=[2.0, 0.0], count=60)[:, 0]
    assert 1.2 < angles.max() < math.pi / 2


def test_starts_are_drawn_between_the_stops() -> None:
    case = cases.case("servo", stop={"joint": "shaft", "low": "-0.5 rad", "high": "0.2 rad"})
    angles = starts(case, seed=0, spread=[1.0, 0.0], count=60)[:, 0]
    assert -0.5 <= angles.min() < -0.4
    assert 0.1 < angles.max() <= 0.2


# Early ends.


@pytest.mark.parametrize(
    ("target", "action", "error", "words"),
    [
        ("two_link_arm/nominal", (1e14, -1e14), DivergenceError, "the state grew without bound"),
        ("arm/nominal", 20.0, UndefinedLawError, "the plant is singular at q >= pi/2, where the c"),
    ],
)
def test_an_episode_ends_when_and_where_and_why_simulate_says_so(
    target: str, action: Any, error: type[Exception], words: str
) -> None:
    case = Experiment.load(target).changed(control_period=5e-3)
    with pytest.raises(error) as ended:
        simulate(
            case.plant("physics"),
            held(action),
            case.x0,
            duration=case.duration,
            control_period=5e-3,
            disturbances=case.disturbances,
            engine="python",
        )
    simulated: Any = ended.value
    episode = Episode(case)
    course = course_of(episode, lambda _: action)
    # Up to the rounding of k T against i h.
    assert course.times[-1] == pytest.approx(simulated.time, rel=1e-15)
    assert np.array_equal(course.states[-1], simulated.trajectory.state[-1])
    assert episode.ended.startswith(f"t = {simulated.time:g} s: {words}")
    assert math.isfinite(course.rewards[-1])


def test_an_episode_ends_where_its_index_is_undefined() -> None:
    episode = Episode("cart_pendulum/nominal")
    angles = np.abs(course_of(episode, lambda _: -20.0).states[:, 1])
    assert "the index is undefined outside |theta| < pi/2" in episode.ended
    # The last valid state is seen.
    assert angles[-1] >= math.pi / 2 > angles[-2]


# Refusals.

ARM = Experiment.load("arm/case1")
BEYOND = Experiment.load("arm/nominal").changed(x0=(1.6, 0.0))


@pytest.mark.parametrize(
    ("target", "options", "error", "words"),
    [
        (("cart_pendulm",), {}, ModelError, "unknown system 'cart_pendulm': did you mean 'cart_p"),
        (("servo", "case3"), {}, ArgumentError, "unknown case of servo 'case3': did you mean"),
        ((ARM, "case2"), {}, ArgumentError, "leave out task"),
        (("servo", ARM), {}, ArgumentError, "'case1' is one of arm"),
        ((BEYOND,), {}, ArgumentError, "arm/nominal can't start: the plant is singular at q"),
        (("servo",), {"spread": [0.1] * 3}, ArgumentError, "must be one number or 2, finite and"),
        (("servo",), {"spread": -1}, ArgumentError, "not negative: rotor angle [rad], rotor speed"),
        (("servo",), {"spread": "1 deg"}, ArgumentError, '"1 deg" cannot be converted to rad/s'),
        (("servo",), {"control_dt": 1}, ArgumentError, "unknown option 'control_dt': did you mean"),
        (("servo",), {"control_period": "10 m"}, ArgumentError, '"10 m" cannot be converted'),
        (("servo",), {"action_limit": "4 N"}, ArgumentError, '"4 N" cannot be converted to A'),
        (("servo",), {"action_limit": 0.0}, ArgumentError, "one number or 1, finite and positive"),
    ],
)
def test_a_wrong_case_or_option_is_refused_in_one_line(
    target: Any, options: Any, error: type[GrosmcError], words: str
) -> None:
    with pytest.raises(error) as refused:
        Episode(*target, **options)
    assert words in str(refused.value)


def test_options_have_units_as_in_a_case_file() -> None:
    options = {"control_period": "10 ms", "action_limit": "500 mA", "spread": ["1 deg", 0.2]}
    episode = Episode("servo", **options)
    assert episode.problem.control_period == 0.01
    assert episode.high.tolist() == [0.5]
    assert episode._spread.tolist() == [math.radians(1), 0.2]


@pytest.mark.parametrize("action", [[math.nan], "full", [1.0, 2.0], None])
def test_an_action_is_m_finite_numbers(action: Any) -> None:
    with pytest.raises(ArgumentError, match=r"must be 1 finite number.*\(1,\): current \[A\]$"):
        Episode("servo").hold(action)


@pytest.mark.parametrize("one", [3.0, np.float64(3.0), (3.0,)])
def test_one_number_is_an_action_of_a_single_input(one: Any) -> None:
    episode = Episode("servo")
    episode.hold([3.0])
    expected = episode.reward
    episode.hold(one)
    assert episode.reward == expected != 0.0
