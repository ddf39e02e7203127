"""An environment of a case in its loop is what a law in that loop meets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grosmc_mj.environments.episode import Episode
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Computing

gymnasium = pytest.importorskip("gymnasium")


def bench() -> Experiment:
    """The pendulum's bench without chance in it, for a quarter of a second."""
    experiment = Experiment.load("cart_pendulum/bench")
    loop = experiment.case.loop
    assert loop is not None
    delayed = loop.changed("computing", "", missed=0.0)
    assert delayed.computing == Computing(delay=1e-3)
    return experiment.varied(loop=delayed, duration=0.25)


def episode() -> Episode:
    return Episode("cart_pendulum", bench())


def seen_by(agent: Episode) -> np.ndarray:
    """The state that the agent sees, (n,)."""
    seen = agent.observation()
    return np.concatenate([seen[state.name] for state in agent.plant.system.states])


@pytest.mark.slow
def test_a_law_as_an_agent_does_what_it_does_in_its_loop() -> None:
    experiment = bench()
    law = experiment.law("physics", "implicit")
    run = experiment.run("physics", "implicit").trajectory
    agent, bare = episode(), replace(law, loop=None)
    memory, _kept_alive = bare.begin()
    stride, states = agent.problem.stride, [agent.x.copy()]
    assert stride == 2
    while not agent.over:
        agent.hold(bare.input_at(agent.time, seen_by(agent), memory))
        agent.advance(stride)
        states.append(agent.x.copy())
    np.testing.assert_allclose(np.array(states), run.state[::stride], rtol=0, atol=1e-9)


def test_observations_are_what_sensors_and_estimators_tell() -> None:
    agent, told = episode(), 0.0
    resolution = 0.314e-3
    for _ in range(20):
        agent.hold([1.0])
        agent.advance(agent.problem.stride)
        told = seen_by(agent)[1]
        assert abs(told / resolution - round(told / resolution)) < 1e-9
    assert told != agent.x[1]


def test_an_action_arrives_after_the_delay() -> None:
    agent = episode()
    agent.hold([5.0])
    agent.advance(2)
    idle = episode()
    idle.hold([0.0])
    idle.advance(2)
    np.testing.assert_array_equal(agent.x, idle.x)
    agent.advance(2)
    idle.advance(2)
    assert agent.x[2] > idle.x[2]


def test_looking_twice_changes_nothing() -> None:
    agent = episode()
    agent.hold([1.0])
    agent.advance(3)
    first, second = agent.observation(), agent.observation()
    assert all(np.array_equal(first[name], second[name]) for name in first)


def test_gymnasium_takes_a_case_in_its_loop() -> None:
    from grosmc_mj.environments.gymnasium_face import CaseEnv

    made = CaseEnv("servo/bench")
    observation, _ = made.reset(seed=0)
    assert observation in made.observation_space
    for _ in range(5):
        observation, reward, terminated, truncated, _ = made.step(np.array([1.0]))
        assert np.isfinite(reward)
        assert not terminated
        assert not truncated
