"""The Jaco arm of dm_control: its nominal dynamics, its references and an unknown payload."""

from __future__ import annotations

import sys
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from grosmc_mj.experiments.cases.jaco import jaco as arms
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.optimum import compare_with_optimum
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.nominal import bias, inertia
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

pytestmark = pytest.mark.slow

pytest.importorskip("dm_control")


@cache
def arm() -> Robot:
    return arms.jaco()


@cache
def sines() -> Experiment:
    return Experiment.load("jaco/sines").changed(switching="sign", surface="printed")


def plant(mass: float) -> MujocoPlant:
    (payload,) = sines().edits
    return arm().plant.changed(replace(payload, mass=mass))


def test_the_nominal_dynamics_are_the_whole_models() -> None:
    """Its hand and its base are fused with what they are fixed to, its meshes left out."""
    nominal = arm().nominal
    model = mujoco.MjModel.__copy__(arm().plant.model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    for x in random.uniform(-2, 2, (5, 18)):
        q, rate, acceleration = np.split(x, 3)
        data.qpos[:] = q
        data.qvel[:] = rate
        data.qacc[:] = acceleration
        mujoco.mj_inverse(model, data)
        torque = inertia(nominal, q) @ acceleration + bias(nominal, q, rate)
        np.testing.assert_allclose(torque, data.qfrc_inverse, rtol=0, atol=1e-12)


@cache
def eight() -> tuple[Array, Array]:
    """Angles along the figure of eight, (1000,), and the joint angles there, (1000, 6)."""
    reference, series = arms.figure_of_eight(arm())
    angles = np.linspace(0, 2 * np.pi, 1000)
    q = [reference(angle / series.frequency, series)[::3] for angle in angles]
    return angles, np.array(q)


def test_the_figure_of_eight_is_followed_by_the_tip_of_its_joint_angles() -> None:
    angles, q = eight()
    tip = arms.tip_path(arm(), q)
    off = tip - arms.eight_of_tip(arm(), angles)
    assert np.linalg.norm(off, axis=1).max() < 5e-6
    np.testing.assert_allclose(np.ptp(tip, axis=0), [0, 0.24, 0.12], atol=1e-3)


def test_the_figure_of_eight_is_within_the_joint_limits() -> None:
    _, q = eight()
    model = arm().plant.model
    limited = model.jnt_limited.astype(bool)
    low, high = model.jnt_range[limited].T
    assert np.all(low < q[:, limited])
    assert np.all(q[:, limited] < high)


def test_a_figure_of_eight_out_of_reach_is_refused() -> None:
    with pytest.raises(ArgumentError, match="cannot bring its tip"):
        arms.figure_of_eight(arm(), scale=8.0)


# Under the sign law |s| stays within h (epsilon + W), W at most 1.75: 4 mrad/s, which the surface
# makes into less than 1 mrad.
@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("grosmc", -np.inf, 1e-3), ("lqr", 0.2, np.inf), ("pd", 0.08, np.inf)],
)
def test_only_grosmc_stays_near_its_optimum_with_an_unknown_kilogram(
    name: str, least: float, most: float
) -> None:
    law = sines().law("physics", name)
    start = sines().x0
    run = simulate(plant(1.0), law, start, duration=8.0)
    # Largest distance from the law's own nominal optimum, all joints together [rad].
    assert least < compare_with_optimum(run, law).deviation.max() < most
    _, high = arm().plant.input_limits
    assert np.all(np.abs(run.input) <= high)


def test_without_dm_control_it_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "dm_control.entities.manipulators", None)
    with pytest.raises(SetupError, match="pip install dm_control"):
        arms.jaco()


@cache
def machine() -> MujocoPlant:
    plant = Experiment.load("jaco/machine").plant("physics")
    assert isinstance(plant, MujocoPlant)
    return plant


def test_its_machine_leaves_a_tenth_of_armature_to_each_joint() -> None:
    joints, _ = np.split(machine().model.dof_armature, 2)
    np.testing.assert_allclose(joints, 0.1)


def test_its_machine_gives_each_motor_the_armature_that_its_joint_lost() -> None:
    joints, motors = np.split(machine().model.dof_armature, 2)
    np.testing.assert_allclose(joints + motors, arm().plant.model.dof_armature)


def test_its_machine_has_a_twist_in_each_joint() -> None:
    twists = [state.name for state in machine().hidden_states]
    assert twists == [f"{joint} twist" for joint in arms.JOINTS]
