"""The cases as environments of dm_control and Gymnasium: what an agent and its tools see."""

from __future__ import annotations

import math
import os
import pickle
import subprocess
import sys
import unittest
import warnings
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest

import grosmc_mj
from grosmc_mj.environments import register
from grosmc_mj.environments.gymnasium_ids import IDS
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.theory.plants import SYSTEMS

pytest.importorskip("dm_control")
test_utils = pytest.importorskip("dm_env.test_utils")
gymnasium = pytest.importorskip("gymnasium")
env_checker = pytest.importorskip("gymnasium.utils.env_checker")

from grosmc_mj.environments import CaseEnv  # noqa: E402

load = grosmc_mj.environments.load


class TestSpecification(test_utils.EnvironmentTestMixin, unittest.TestCase):
    """dm_env's own tests, through the end of an episode."""

    def make_object_under_test(self) -> Any:
        return load(Experiment.load("servo/case1").changed(duration=0.01), spread=0.1, seed=1)

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


def plain(observation: Any) -> dict[str, list[float]]:
    return {name: values.tolist() for name, values in observation.items()}


def test_both_make_the_same_numbers() -> None:
    case = Experiment.load("servo/nominal").changed(duration=0.05, control_period=7e-3)
    environment = load(case)
    face = CaseEnv(case)
    step = environment.reset()
    observation, info = face.reset()
    assert info["units"] == {
        "rotor angle": "rad",
        "rotor speed": "rad/s",
        "time": "s",
        "error": "rad, rad/s",
        "reference": "rad, rad/s",
    }
    while not step.last():
        assert plain(observation) == plain(step.observation)
        step = environment.step(np.array([3.0]))
        observation, reward, terminated, truncated, _ = face.step(np.array([3.0]))
        assert reward == step.reward
        assert (terminated, truncated) == (False, step.last())
    assert step.discount == 1.0
    with pytest.raises(ArgumentError, match="the episode is over: reset it"):
        face.step(np.array([3.0]))


def start_in_gymnasium(seed: int) -> float:
    observation, _ = CaseEnv("servo", spread=0.1).reset(seed=seed)
    return float(observation["rotor angle"][0])


def start_in_dm_control(seed: int) -> float:
    return float(load("servo", spread=0.1, seed=seed).reset().observation["rotor angle"][0])


@pytest.mark.parametrize("start", [start_in_gymnasium, start_in_dm_control])
def test_a_seed_decides_where_an_episode_starts(start: Any) -> None:
    assert start(1) == start(1) != start(2)


def test_dm_control_knows_the_control_period() -> None:
    assert load("servo", control_period=7e-3).control_timestep() == pytest.approx(7e-3)


def test_an_early_end_terminates_an_episode_without_discount() -> None:
    environment = load("arm", control_period=5e-3)
    face = CaseEnv("arm", control_period=5e-3)
    face.reset()
    step = environment.reset()
    terminated = False
    info: Any = {}
    while not terminated:
        step = environment.step(np.array([20.0]))
        _, _, terminated, truncated, info = face.step(np.array([20.0]))
        assert not truncated
    assert (step.last(), step.discount) == (True, 0.0)
    assert info["ended"] == environment.task.ended != ""
    with pytest.raises(ArgumentError, match=r"the episode is over at t = .*: reset it"):
        face.step(np.zeros(1))
    # The next step begins an episode.
    assert environment.step(np.zeros(1)).first()
    assert environment.task.ended == ""


def end_of(face: CaseEnv, action: float) -> tuple[float, bool, bool]:
    """Time of the end of an episode, and whether it is terminated or truncated."""
    face.reset()
    terminated = truncated = False
    time = 0.0
    while not (terminated or truncated):
        observation, _, terminated, truncated, _ = face.step([action])
        time = float(observation["time"][0])
    return time, terminated, truncated


def test_an_early_end_at_the_duration_is_no_truncation() -> None:
    case = Experiment.load("cart_pendulum/nominal")
    time, *_ = end_of(CaseEnv(case), -20.0)
    assert end_of(CaseEnv(case.changed(duration=time)), -20.0) == (time, True, False)


def test_specifications_have_names_and_units() -> None:
    environment = load("cart_pendulum")
    spec = environment.observation_spec()
    names = ["cart position", "pole angle", "cart speed", "pole rate", "time", "error", "reference"]
    assert list(environment.reset().observation) == list(spec) == names
    assert spec["pole angle"].name == "pole angle [rad]"
    assert spec["error"].name == "error [rad, rad/s]"
    assert environment.action_spec().name.endswith("force [N]")


# A slide with an actuator whose limits are not symmetric.
SLIDE = """<mujoco model="slide"><worldbody><body><joint name="slide" type="slide" axis="1 0 0"/>
<geom size="0.1" mass="2"/></body></worldbody>
<actuator><motor name="force" joint="slide" ctrlrange="-10 30"/></actuator></mujoco>"""


def slide(folder: Path) -> Experiment:
    """A case of the slide at rest."""
    (folder / "slide.xml").write_text(SLIDE)
    return cases.case("slide.xml", folder=folder, task={"reference": ["0"], "Q": [1, 1], "R": 1})


def test_a_specification_of_actions_has_both_limits_of_the_actuator(tmp_path: Path) -> None:
    spec = load(slide(tmp_path)).action_spec()
    assert (spec.minimum.tolist(), spec.maximum.tolist()) == ([-10.0], [30.0])


@pytest.mark.parametrize(
    ("options", "low", "high"),
    [
        ({}, -10.0, 30.0),
        ({"action_limit": 20.0}, -10.0, 20.0),
        ({"action_limit": 20.0, "normalized": True}, -1.0, 1.0),
    ],
)
def test_actions_have_the_limits_of_the_actuator_or_narrower_ones(
    options: Any, low: float, high: float, tmp_path: Path
) -> None:
    face = CaseEnv(slide(tmp_path), **options)
    space: Any = face.action_space
    assert (space.low.tolist(), space.high.tolist()) == ([low], [high])
    # For 2 ms three quarters of the way from the least to the largest force, on 2 kg.
    face.reset()
    face.step(space.low + 0.75 * (space.high - space.low))
    force = face.episode.low + 0.75 * (face.episode.high - face.episode.low)
    assert face.episode.x[1] == pytest.approx(force[0] / 2.0 * 2e-3, rel=1e-9)


@pytest.mark.parametrize(("action", "force"), [(-50.0, -10.0), (50.0, 30.0)])
def test_an_action_beyond_the_actuator_s_range_is_cut_to_its_nearer_end(
    action: float, force: float, tmp_path: Path
) -> None:
    episode = CaseEnv(slide(tmp_path)).episode
    episode.hold([action])
    episode.advance(2)
    assert episode.x[1] == pytest.approx(force / 2.0 * 4e-3, rel=1e-9)


def test_without_an_actuator_s_limit_actions_have_none() -> None:
    space: Any = CaseEnv("arm").action_space
    assert (space.low.tolist(), space.high.tolist()) == ([-math.inf], [math.inf])


@pytest.mark.parametrize(
    ("target", "options", "words"),
    [
        ("servo", {"renders": 1}, "spread, action_limit, normalized, render_mode, size"),
        ("servo", {"normalized": True}, "normalized actions need limits, current [A] has none"),
        ("servo", {"render_mode": "human"}, "'human': valid: rgb_array"),
        ("maglev/warm", {"render_mode": "rgb_array"}, "maglev is given by equa"),
    ],
)
def test_a_wrong_option_is_refused_in_one_line(target: str, options: Any, words: str) -> None:
    with pytest.raises(ArgumentError) as refused:
        CaseEnv(target, **options)
    assert words in str(refused.value)


# Names that Gymnasium knows.


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


# Pictures, each in a process of its own: MuJoCo reads once what draws.

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
@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "backend"), [(DRAWN, {"MUJOCO_GL": "egl"}), (DRAWN, {}), (CHECKED, {})]
)
def test_it_draws_what_it_is_at_whatever_backend_is_chosen(
    program: str, backend: dict[str, str]
) -> None:
    """Gymnasium's checker makes the environment again in each render mode."""
    names = ("MUJOCO_GL", "DISPLAY", "WAYLAND_DISPLAY")
    environment = {name: value for name, value in os.environ.items() if name not in names}
    subprocess.run([sys.executable, "-c", program], check=True, env=environment | backend)
