"""Every plant answers the same questions, so that nobody asks which kind it is."""

from __future__ import annotations

import math

import numpy as np
import pytest

from grosmc_mj.errors import ArgumentError, ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.files import load_spec, model_path
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS, Plant
from grosmc_mj.robots.robot import Robot


def kinds(system: str) -> list[Plant]:
    """A system in MuJoCo and as its corrected equations."""
    physics = MujocoPlant.load(system)
    return [physics, physics.analytic()]


@pytest.mark.parametrize("system", SYSTEMS)
def test_equations_and_mujoco_give_the_same_rates(system: str) -> None:
    physics, equations = kinds(system)
    n, m = len(physics.system.states), len(physics.system.inputs)
    random = np.random.default_rng(7)
    for _ in range(5):
        x, u = random.uniform(-0.4, 0.4, n), random.uniform(-1, 1, m)
        w = random.uniform(-0.3, 0.3, 6 * len(physics.system.bodies))
        found, expected = physics.derivative(x, u, w), equations.derivative(x, u, w)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
        # A rate says nothing of what was asked before.
        physics.derivative(-x, -u)
        np.testing.assert_array_equal(physics.derivative(x, u, w), found)


@pytest.mark.parametrize(
    ("system", "body"), [("arm", "hub"), ("arm", "link"), ("two_link_arm", "payload")]
)
def test_what_turns_is_the_inertia_about_the_joint_s_own_axis(system: str, body: str) -> None:
    spec = load_spec(system)
    edited = spec.body(body)
    edited.explicitinertial, edited.mass = True, max(0.1, edited.mass)
    edited.inertia = [0.02, 0.03, 0.04]
    physics = MujocoPlant(SYSTEMS[system], spec)
    n, m = len(physics.system.states), len(physics.system.inputs)
    x, u = np.linspace(-0.3, 0.4, n), np.linspace(0.5, 1.0, m)
    np.testing.assert_allclose(
        physics.derivative(x, u), physics.analytic().derivative(x, u), rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("system", ["servo", "cart_pendulum"])
def test_equations_and_mujoco_have_the_same_linear_model(system: str) -> None:
    physics, equations = kinds(system)
    for found, expected in zip(physics.linearization(), equations.linearization(), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("plant", kinds("cart_pendulum"))
def test_no_plant_is_linearized_where_it_does_not_rest(plant: Plant) -> None:
    with pytest.raises(ArgumentError, match="is no equilibrium"):
        plant.linearization([0.0, 0.3, 0.0, 0.0])
    with pytest.raises(ArgumentError, match=r"x has shape \(2,\)"):
        plant.linearization([0.0, 0.0])
    with pytest.raises(
        ArgumentError, match=r"u \(2,\) and the wrench \(12,\), must be \(4,\), \(1,\)"
    ):
        plant.derivative(np.zeros(4), [1.0, 2.0])


def test_numbers_are_those_of_the_edited_model() -> None:
    physics = MujocoPlant.load("cart_pendulum").changed([BodyEdit("pole", mass_scale=2.0)])
    equations = MujocoPlant.load("cart_pendulum").analytic()
    assert physics.parameters.m == pytest.approx(2 * equations.parameters.m)
    assert physics.parameters == physics.analytic().parameters
    assert equations.changed(scales={"m": 2.0}).parameters.m == 2 * equations.parameters.m
    assert equations.changed() is equations


def test_what_a_plant_has_not_is_refused() -> None:
    physics, equations = kinds("servo")
    with pytest.raises(ModelError, match="scale a parameter instead"):
        equations.changed([BodyEdit("rotor", mass_scale=2.0)])
    with pytest.raises(ModelError, match="edit a body or a joint instead of J"):
        physics.changed(scales={"J": 2.0})
    with pytest.raises(ModelError, match="unknown parameter of servo 'q'"):
        equations.changed(scales={"q": 2.0})
    with pytest.raises(ModelError, match="no model in MuJoCo"):
        _ = equations.model


def test_limits_steps_and_names() -> None:
    spec = MujocoPlant.load("servo").spec.copy()
    motor = spec.actuators[0]
    motor.ctrlrange, motor.ctrllimited = (-2.0, 1.0), True
    physics = MujocoPlant(SYSTEMS["servo"], spec, (), 2e-3, "implicit")
    equations = physics.analytic("corrected")
    np.testing.assert_array_equal(physics.input_limits, [[-2.0], [1.0]])
    np.testing.assert_array_equal(equations.input_limits, [[-math.inf], [math.inf]])
    assert (physics.kind, physics.step_length, physics.stepped_by) == ("physics", 2e-3, "implicit")
    assert (equations.kind, equations.step_length, equations.stepped_by) == (
        "corrected", None, "RK4",
    )  # fmt: skip
    assert physics.restepped
    assert not MujocoPlant.load("servo").restepped
    assert physics.digest != MujocoPlant.load("servo").digest


def test_a_robot_is_a_plant_without_equations() -> None:
    robot = Robot.from_mjcf(model_path("two_link_arm")).plant
    assert robot.parameters is None
    assert not robot.system.symbolic
    assert robot.system.equations.linearizable(np.zeros(4))
    with pytest.raises(ModelError, match=r"has no equations in symbols \(f\): MuJoCo computes"):
        _ = robot.system.equations.drift
    n = robot.system.degrees_of_freedom
    np.testing.assert_allclose(robot.derivative(np.zeros(2 * n))[:n], 0)
    assert robot.input_limits.shape == (2, n)
