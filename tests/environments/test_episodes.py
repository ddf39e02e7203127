"""Episodes without a face: their rewards and their noise, in a fraction of a second."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.environments.episode import Episode
from grosmc_mj.ground.arrays import Array

NOISY = """
[plant]
system = "servo"
[run]
start = { "rotor angle" = "0.5 rad" }
duration = "25 ms"
control_period = "10 ms"
[[sensor]]
of = "rotor angle"
noise = "10 mrad"
[[controller]]
law = "lqr"
"""


@pytest.fixture
def episode(tmp_path: Path) -> Episode:
    path = tmp_path / "noisy.toml"
    path.write_text(NOISY, encoding="utf-8")
    return Episode(str(path))


def first_angles(episode: Episode) -> list[float]:
    """First observed angle of each of three episodes."""
    random = np.random.default_rng(0)
    angles = []
    for _ in range(3):
        episode.reset(random)
        angles.append(float(episode.observation()["rotor angle"][0]))
    return angles


def test_each_episode_has_noise_of_its_own(episode: Episode) -> None:
    assert len(set(first_angles(episode))) == 3


def test_episodes_of_one_seed_have_the_same_noise(episode: Episode) -> None:
    assert first_angles(episode) == first_angles(episode)


MEASURED = """
[[disturbance]]
measured = "rotor angle"
amplitude = "0.25 rad"
profile = "table"
values = [1, 2, 3]
hold = "10 ms"
"""


@pytest.mark.parametrize("sensor", ["", 'delay = "10 ms"'])
def test_an_agent_observes_the_disturbance_of_a_measurement(tmp_path: Path, sensor: str) -> None:
    """The rotor rests at 0.5 rad; a late sensor tells the disturbance late, too."""
    text = NOISY.replace('noise = "10 mrad"', sensor) + MEASURED
    if not sensor:
        text = text.replace('[[sensor]]\nof = "rotor angle"\n', "")
    path = tmp_path / "measured.toml"
    path.write_text(text, encoding="utf-8")
    episode = Episode(str(path))
    angles = []
    for _ in range(3):
        angles.append(float(episode.observation()["rotor angle"][0]))
        episode.advance(10)
    angles.append(float(episode.observation()["rotor angle"][0]))
    assert episode.over
    expected = [0.75, 0.75, 1.0, 1.0] if sensor else [0.75, 1.0, 1.25, 1.25]
    assert angles == expected


def test_a_new_episode_begins_without_the_last_action(episode: Episode) -> None:
    """A rotor at rest stays there until the first action."""
    episode.hold([1.0])
    episode.advance(5)
    assert episode.x[1] != 0
    episode.reset(np.random.default_rng(0))
    episode.advance(5)
    assert episode.x.tolist() == [0.5, 0.0]


def rewards(episode: Episode, action: float) -> list[float]:
    """Rewards of an action that is held to the end, over the stage costs that they are of."""
    episode.reset(np.random.default_rng(0))
    shares: list[float] = []
    while not episode.over:
        u: Array = np.array([action])
        cost = episode.index.stage_cost(episode.time, episode.x, u)
        episode.hold(u)
        shares.append(-episode.reward / cost)
        episode.advance(episode.problem.stride)
    return shares


def test_the_last_interval_is_rewarded_up_to_the_end_alone(episode: Episode) -> None:
    """25 ms are two intervals of 10 ms and one of 5 ms."""
    assert rewards(episode, 0.3) == pytest.approx([0.01, 0.01, 0.005])


def test_an_action_beyond_its_limit_costs_what_is_applied(tmp_path: Path) -> None:
    path = tmp_path / "noisy.toml"
    path.write_text(NOISY, encoding="utf-8")
    limited = Episode(str(path), action_limit=0.2)
    limited.reset(np.random.default_rng(0))
    limited.hold(np.array([5.0]))
    cut = limited.reward
    limited.reset(np.random.default_rng(0))
    limited.hold(np.array([0.2]))
    assert cut == limited.reward
