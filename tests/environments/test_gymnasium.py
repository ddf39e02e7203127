"""The cases as environments of Gymnasium: its own checks, its ends, and equations."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shipped import find_case, of_case

from grosmc_mj.environments import law_policy, register
from grosmc_mj.environments.gymnasium_ids import IDS
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.plants import SYSTEMS
from grosmc_mj.simulation.simulate import simulate

gymnasium = pytest.importorskip("gymnasium")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

from gymnasium.envs.registration import EnvSpec  # noqa: E402

from grosmc_mj.environments.gymnasium_face import CaseEnv  # noqa: E402


@pytest.mark.parametrize("target", [*SYSTEMS, "maglev/warm", "ball_beam/sine", "servo/bench"])
def test_gymnasium_s_checker_has_nothing_to_say(target: str) -> None:
    """It makes an environment again from its spec, too."""
    numbers = {"spread": 1e-4, "action_limit": 10.0, "normalized": True}
    face = "grosmc_mj.environments.gymnasium_face:CaseEnv"
    spec = EnvSpec("Case-v0", entry_point=face, kwargs={"system": target, **numbers})
    environment = gymnasium.make(pickle.loads(pickle.dumps(spec))).unwrapped
    equations = target in ("maglev/warm", "ball_beam/sine")
    assert environment.metadata["render_modes"] == ([] if equations else ["rgb_array"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env_checker.check_env(environment, skip_render_check=not equations)


def test_other_ways_of_rendering_are_refused() -> None:
    assert CaseEnv("maglev/warm").render() is CaseEnv("servo").render() is None
    with pytest.raises(ArgumentError, match=r"maglev is given by equations"):
        CaseEnv("maglev/warm", render_mode="rgb_array")
    with pytest.raises(ArgumentError, match="unknown render_mode 'human': valid: rgb_array"):
        CaseEnv("servo", render_mode="human")


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


@pytest.mark.parametrize(
    ("target", "action", "words"),
    [("maglev/warm", -4.0, "the index is undefined outside gap and current positive"),
     ("ball_beam/sine", 1e100, "the state grew without bound"),
     ("cart_pendulum/nominal", -20.0, "the index is undefined outside |theta| < pi/2")],
)  # fmt: skip
def test_an_episode_terminates_where_no_next_step_is_defined(
    target: str, action: float, words: str
) -> None:
    environment = CaseEnv(target)
    seen, info = environment.reset()
    terminated = truncated = False
    while not terminated:
        seen, _, terminated, truncated, info = environment.step(np.array([action]))
    assert not truncated
    assert words in info["ended"]
    assert info["units"]["time"] == "s"
    # What is seen is the last valid state.
    assert all(np.all(np.isfinite(value)) for value in seen.values())
    with pytest.raises(ArgumentError, match=r"the episode is over at t = .*: reset it"):
        environment.step(np.zeros(1))


def test_an_episode_is_truncated_at_the_duration_of_its_case() -> None:
    short = replace(find_case("servo", "nominal"), duration=0.002)
    environment = CaseEnv("servo", of_case(short))
    environment.reset()
    ends = [environment.step(np.zeros(1))[2:4] for _ in range(2)]
    assert ends == [(False, False), (False, True)]
    with pytest.raises(ArgumentError, match="the episode is over: reset it"):
        environment.step(np.zeros(1))


def test_a_normalized_action_is_a_part_of_its_limits() -> None:
    plain, parts = (CaseEnv("servo", action_limit=4.0, normalized=each) for each in (False, True))
    bounds = [(env.action_space.low, env.action_space.high) for env in (plain, parts)]  # pyright: ignore
    assert bounds == [(-4.0, 4.0), (-1.0, 1.0)]
    results = []
    for environment, action in ((plain, 3.0), (parts, 0.75), (plain, 9.0), (plain, 4.0)):
        environment.reset()
        seen, reward, *_ = environment.step(np.array([action]))
        results.append((reward, float(seen["rotor speed"][0])))
    assert results[0] == results[1]
    # What is beyond the declared limit is cut, as an actuator does.
    assert results[2] == results[3] != results[0]
    with pytest.raises(ArgumentError, match="normalized actions need limits, current"):
        CaseEnv("servo", normalized=True)


@pytest.mark.parametrize(
    "target", ["furuta/heavier", "own_laws/pid", "jaco/sines", "maglev/warm", "ball_beam/sine"]
)
def test_any_case_is_an_environment(target: str) -> None:
    """Robots and equations too; a law in it gets what simulate gives it, to the last bit."""
    experiment = Experiment.load(target).varied(duration=0.03)
    environment, where = CaseEnv(target), experiment.nominal.truest
    law = experiment.law(where, experiment.controllers[0])
    period, h = experiment.settings.control_period, experiment.settings.timestep
    policy, (observation, _) = law_policy(law, control_period=period), environment.reset()
    states, names = [], [state.name for state in experiment.nominal.system.states]
    for _ in range(20):
        states.append([observation[name][0] for name in names])
        observation, *_ = environment.step(policy(observation))
    run = simulate(
        experiment.plant(where), law, experiment.case.x0, duration=0.03, control_period=period,
        timestep=h, disturbances=experiment.case.disturbances, engine="python",
    )  # fmt: skip
    stride = round(period / h)
    assert np.array_equal(states, run.state[: 20 * stride : stride])


@pytest.mark.parametrize("target", ["two_link_arm/case2", "maglev/warm", "servo/case1"])
def test_both_faces_give_the_same_observations_and_rewards(target: str) -> None:
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


def test_every_system_has_an_id_that_can_name_the_module_which_registers_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert register() == tuple(IDS)
    assert set(IDS.values()) == set(SYSTEMS)
    before = [gymnasium.spec(name) for name in IDS]
    assert register() == tuple(IDS)
    assert [gymnasium.spec(name) for name in IDS] == before
    module = "grosmc_mj.environments.gymnasium_ids"
    monkeypatch.delitem(gymnasium.registry, "grosmc_mj/Arm-v0")
    monkeypatch.delitem(sys.modules, module, raising=False)
    environment: Any = gymnasium.make(f"{module}:grosmc_mj/Arm-v0", task="case2")
    assert environment.unwrapped.episode.case.name == "case2"
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(SetupError, match=r"pip install 'grosmc_mj\[gymnasium\]'"):
        register()
