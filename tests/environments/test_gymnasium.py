"""The cases as environments of Gymnasium: its own checks, and the numbers of ``simulate``."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shipped import case_plant, find_case, nominal_controller, of_case

from grosmc_mj.control.controller import Controller
from grosmc_mj.environments import law_policy, register
from grosmc_mj.environments.gymnasium_ids import IDS
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.simulate import simulate

gymnasium = pytest.importorskip("gymnasium")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

from gymnasium.envs.registration import EnvSpec  # noqa: E402

from grosmc_mj.environments.gymnasium_face import CaseEnv  # noqa: E402


@pytest.fixture(autouse=True)
def known() -> None:
    register()


@pytest.mark.parametrize("name", list(IDS))
def test_gymnasium_s_checker_has_nothing_to_say(name: str) -> None:
    environment = gymnasium.make(name, spread=0.01, action_limit=10.0, normalized=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It wants the environment without the wrappers that make puts around it.
        env_checker.check_env(environment.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("target", ["maglev/warm", "ball_beam/sine"])
def test_gymnasium_s_checker_has_nothing_to_say_of_equations(target: str) -> None:
    """Of no mode of rendering either: none is offered."""
    path = str(Experiment.load(target).path)
    numbers = {"spread": 1e-4, "action_limit": 10.0, "normalized": True}
    face = "grosmc_mj.environments.gymnasium_face:CaseEnv"
    spec = EnvSpec("Equations-v0", entry_point=face, kwargs={"system": path, **numbers})
    environment = gymnasium.make(spec).unwrapped
    assert environment.metadata["render_modes"] == []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env_checker.check_env(environment)


def test_equations_have_nothing_to_draw() -> None:
    assert CaseEnv("maglev/warm").render() is None
    with pytest.raises(ArgumentError, match=r"maglev is given by equations"):
        CaseEnv("maglev/warm", render_mode="rgb_array")
    # Of other environments it is offered still.
    assert CaseEnv("servo").metadata["render_modes"] == ["rgb_array"]


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


def test_equations_end_where_no_next_step_is_defined() -> None:
    environment = CaseEnv("maglev/warm")
    seen, info = environment.reset()
    terminated = truncated = False
    while not terminated:
        assert seen["current"][0] > 0
        seen, _, terminated, truncated, info = environment.step(np.array([-4.0]))
    assert not truncated
    assert seen["current"][0] <= 0 < seen["time"][0]
    assert "the index is undefined outside gap and current positive" in info["ended"]
    beam = CaseEnv("ball_beam/sine")
    before, _ = beam.reset()
    after, _, terminated, truncated, info = beam.step(np.array([1e100]))
    assert (terminated, truncated) == (True, False)
    assert "the state grew without bound" in info["ended"]
    # What is seen is the last valid state.
    assert all(np.array_equal(after[name], before[name]) for name in before)


def test_a_normalized_action_is_a_part_of_its_limits() -> None:
    plain = gymnasium.make("grosmc_mj/Servo-v0", action_limit=4.0)
    parts = gymnasium.make("grosmc_mj/Servo-v0", action_limit=4.0, normalized=True)
    assert (plain.action_space.low, plain.action_space.high) == (-4.0, 4.0)
    assert (parts.action_space.low, parts.action_space.high) == (-1.0, 1.0)
    found = []
    for environment, action in ((plain, 3.0), (parts, 0.75), (plain, 9.0), (plain, 4.0)):
        environment.reset()
        seen, reward, *_ = environment.step(np.array([action]))
        found.append((reward, float(seen["rotor speed"][0])))
    assert found[0] == found[1]
    # What is beyond the declared limit is cut, as an actuator does.
    assert found[2] == found[3] != found[0]
    with pytest.raises(ArgumentError, match="normalized actions need limits, current"):
        gymnasium.make("grosmc_mj/Servo-v0", normalized=True)


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan, [1.0, 2.0], "ten"])
def test_a_limit_that_is_none_is_refused(limit: Any) -> None:
    with pytest.raises(
        ArgumentError, match=r"action_limit = .* must be one number or 1, finite and positive"
    ):
        gymnasium.make("grosmc_mj/Servo-v0", action_limit=limit)


@pytest.mark.parametrize(
    "target", ["furuta/heavier", "own_laws/pid", "jaco/sines", "maglev/warm", "ball_beam/sine"]
)
def test_any_case_is_an_environment(target: str) -> None:
    """Robots and equations too; a law in it gets what simulate gives it, to the last bit."""
    experiment = Experiment.load(target).varied(duration=0.03)
    environment, where = CaseEnv(target), experiment.nominal.truest
    law = experiment.law(where, experiment.controllers[0])
    period = experiment.settings.control_period
    policy = law_policy(law, control_period=period) if law.design else None
    assert policy is not None
    observation, _ = environment.reset()
    states, names = [], [state.name for state in experiment.nominal.system.states]
    for _ in range(20):
        states.append([observation[name][0] for name in names])
        observation, reward, *_ = environment.step(policy(observation))
        assert np.isfinite(reward)
    settings = experiment.settings
    run = simulate(
        experiment.plant(where), law, experiment.case.x0, duration=0.03,
        control_period=period, timestep=settings.timestep,
        disturbances=experiment.case.disturbances, engine="python",
    )  # fmt: skip
    stride = round(period / settings.timestep)
    assert np.array_equal(states, run.state[: 20 * stride : stride])


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
    subprocess.run(
        [sys.executable, "-c", DRAWN], check=True, env={**os.environ, "MUJOCO_GL": "egl"}
    )


def test_other_ways_of_rendering_are_refused() -> None:
    assert CaseEnv("servo").render() is None
    with pytest.raises(ArgumentError, match="unknown render_mode 'human': valid: rgb_array"):
        CaseEnv("servo", render_mode="human")


def test_every_system_has_an_id_and_registering_twice_changes_nothing() -> None:
    assert set(IDS.values()) == set(SYSTEMS)
    before = [gymnasium.spec(name) for name in IDS]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert register() == tuple(IDS)
    assert [gymnasium.spec(name) for name in IDS] == before


def test_an_id_can_name_the_module_that_registers_it(monkeypatch: pytest.MonkeyPatch) -> None:
    module = "grosmc_mj.environments.gymnasium_ids"
    monkeypatch.delitem(gymnasium.registry, "grosmc_mj/Arm-v0")
    monkeypatch.delitem(sys.modules, module, raising=False)
    environment = gymnasium.make(f"{module}:grosmc_mj/Arm-v0", task="case2")
    assert environment.unwrapped.episode.case.name == "case2"


@pytest.mark.parametrize("name", list(IDS))
@pytest.mark.parametrize("T", [1e-3, 4e-3])
def test_a_law_gets_simulate_s_numbers_to_the_last_bit(name: str, T: float) -> None:
    system = IDS[name]
    case = replace(find_case(system, "case1"), duration=0.08)
    controller = nominal_controller(system, "grosmc", "corrected")
    environment = gymnasium.make(name, task=of_case(case), control_period=T)
    names = [signal.name for signal in SYSTEMS[system].states]
    policy, over = law_policy(controller), False
    observation, info = environment.reset()
    states, inputs = [[observation[each][0] for each in names]], []
    while not over:
        inputs.append(policy(observation))
        observation, _, terminated, over, info = environment.step(inputs[-1])
        assert not terminated
        states.append([observation[each][0] for each in names])
    run = simulate(
        case_plant(case, "physics", Settings()), controller, case.x0, duration=0.08,
        control_period=T, disturbances=case.disturbances, engine="python",
    )  # fmt: skip
    stride = round(T / 1e-3)
    assert np.array_equal(states, run.state[::stride])
    assert np.array_equal(inputs, run.command.reshape(len(run.command), -1)[::stride])
    assert info["ended"] == ""
    assert info["units"]["time"] == "s"


@pytest.mark.parametrize("target", ["two_link_arm/case2", "maglev/warm"])
def test_both_faces_give_the_same_rewards(target: str) -> None:
    pytest.importorskip("dm_control")
    from grosmc_mj.environments import load

    one, other = CaseEnv(target), load(target)
    one.reset()
    other.reset()
    for action in np.random.default_rng(0).normal(size=(30, len(one.episode.low))):
        observation, reward, *_ = one.step(action)
        step = other.step(action)
        assert reward == step.reward
        assert list(observation) == list(step.observation)
        assert all(np.array_equal(observation[key], step.observation[key]) for key in observation)


def test_dm_control_s_physics_of_equations_is_their_run(
    open_loop: Callable[[Any], Controller],
) -> None:
    """Reset, set and stepped by hand."""
    pytest.importorskip("dm_control")
    from grosmc_mj.environments import load

    environment = load("maglev/warm", control_period=1e-3)
    physics: Any = environment.physics
    assert (physics.timestep(), environment.control_timestep()) == (0.5e-3, 1e-3)
    assert environment.action_spec().maximum.tolist() == [np.inf]
    experiment = Experiment.load("maglev/warm")
    for voltage in (4.0, 4.0, 0.0):
        environment.reset()
        # A reset lets go of what was held.
        if voltage:
            physics.set_control(voltage)
        physics.step(20)
        run = simulate(
            experiment.plant("corrected"), open_loop(voltage), experiment.case.x0, duration=0.01,
            timestep=0.5e-3, engine="python",
        )  # fmt: skip
        assert physics.time() == 10 * 1e-3
        assert np.array_equal(physics.episode.x, run.state[-1])
    with pytest.raises(ArgumentError, match="maglev is given by equations: only a model in MuJoCo"):
        physics.render()


def test_leaving_the_region_terminates_and_the_duration_truncates() -> None:
    environment = gymnasium.make("grosmc_mj/CartPendulum-v0", control_period=0.02)
    environment.reset()
    terminated = truncated = False
    info: dict[str, Any] = {}
    while not terminated:
        *_, terminated, truncated, info = environment.step(np.array([-20.0]))
    assert not truncated
    assert "the index is undefined outside |theta| < pi/2" in info["ended"]
    with pytest.raises(ArgumentError, match=r"the episode is over at t = .*: reset it"):
        environment.unwrapped.step(np.zeros(1))
    short = replace(find_case("servo", "nominal"), duration=0.002)
    environment = gymnasium.make("grosmc_mj/Servo-v0", task=of_case(short))
    environment.reset()
    assert environment.step(np.zeros(1))[2:4] == (False, False)
    assert environment.step(np.zeros(1))[2:4] == (False, True)
    with pytest.raises(ArgumentError, match="the episode is over: reset it"):
        environment.unwrapped.step(np.zeros(1))


def test_the_seed_of_a_reset_decides_the_start() -> None:
    environment = gymnasium.make("grosmc_mj/Arm-v0", spread=[0.2, 0.1])

    def angle(seed: int | None = None) -> float:
        return float(environment.reset(seed=seed)[0]["joint angle"][0])

    first = [angle(7), angle()]
    assert first == [angle(7), angle()]
    assert first[0] != first[1]
    assert all(abs(each - 0.5) <= 0.2 for each in first)


def test_starts_are_drawn_to_both_sides_of_the_case_s_where_the_plant_is_defined() -> None:
    """Forty draws that miss one of four sides have a chance of 4e-12; pi/2 is singular."""
    environment = gymnasium.make("grosmc_mj/Arm-v0", spread=[1.5, 0.1])
    x0 = np.array(find_case("arm", "nominal").x0)
    seen = [environment.reset(seed=seed)[0] for seed in range(40)]
    starts = np.array([[each["joint angle"][0], each["joint rate"][0]] for each in seen])
    assert np.all((starts < x0).any(axis=0) & (starts > x0).any(axis=0))
    assert np.all(np.abs(starts - x0) <= [1.5, 0.1])
    assert starts[:, 0].max() < np.pi / 2


def test_a_reward_is_the_stage_cost_at_the_start_of_its_interval_times_its_length() -> None:
    """Of 5 ms in intervals of 2 ms the last is cut to 1 ms; J is 1/2 of z'Qz + v'Rv."""
    case = replace(find_case("servo", "nominal"), duration=0.005)
    environment = gymnasium.make("grosmc_mj/Servo-v0", task=of_case(case), control_period=2e-3)
    design = nominal_controller("servo", "grosmc", "corrected").designed.lqr
    assert design is not None
    observation, _ = environment.reset()
    for length, end in ((2e-3, 2e-3), (2e-3, 4e-3), (1e-3, 5e-3)):
        z, u = observation["error"], np.array([3.0])
        observation, reward, _, truncated, _ = environment.step(u)
        expected = -length * 0.5 * float(z @ design.Q @ z + u @ design.R @ u)
        assert reward == pytest.approx(expected, rel=1e-12)
        assert observation["time"][0] == pytest.approx(end, rel=1e-12)
    assert truncated


def test_what_an_actuator_does_not_apply_is_not_paid_for(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = MujocoPlant.load("servo")
    spec = plant.spec.copy()
    (motor,) = spec.actuators
    motor.ctrlrange, motor.ctrllimited = (-2.0, 1.0), True
    limited = replace(plant, spec=spec)
    monkeypatch.setattr(Experiment, "plant", lambda *_: limited)
    environment = gymnasium.make("grosmc_mj/Servo-v0").unwrapped

    def reward(action: float) -> float:
        environment.reset()
        return environment.step(np.array([action]))[1]

    assert reward(9.0) == reward(1.0) != reward(0.5)
    assert reward(-9.0) == reward(-2.0) != reward(-1.0)


def test_an_environment_is_made_again_from_its_spec() -> None:
    environment = gymnasium.make("grosmc_mj/Arm-v0", task="case1", control_period=2e-3)
    again = gymnasium.make(pickle.loads(pickle.dumps(environment.spec)))
    assert again.unwrapped.episode.case == environment.unwrapped.episode.case
    assert again.unwrapped.episode.problem.control_period == 2e-3


def test_an_action_that_is_none_is_refused() -> None:
    environment = gymnasium.make("grosmc_mj/Servo-v0").unwrapped
    environment.reset()
    with pytest.raises(ArgumentError, match=r"must be 1 finite number.*: current \[A\]"):
        environment.step(np.array([np.nan]))


def test_without_gymnasium_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(SetupError, match=r"pip install 'grosmc_mj\[gymnasium\]'"):
        register()


@pytest.mark.slow
def test_gymnasium_s_face_works_without_dm_control() -> None:
    program = (
        "import sys; sys.modules['dm_control'] = sys.modules['dm_env'] = None; "
        "import gymnasium, numpy, grosmc_mj; grosmc_mj.environments.register(); "
        "e = gymnasium.make('grosmc_mj/Servo-v0'); e.reset(); print(e.step(numpy.ones(1))[3])"
    )
    command = [sys.executable, "-c", program]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    assert said == "False"
