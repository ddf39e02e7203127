"""A robot from its MJCF alone: its dynamics, its coordinates and its laws."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf import TREE

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError, PremiseError
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.files import load_spec
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.nominal import bias, inertia
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.loop.design_model import design_model
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.design import (
    computed_torque_pd,
    linear_lqr,
    linearized_lqr,
    regulating_grosmc,
    tracking_grosmc,
)
from grosmc_mj.theory.control.kinds.adaptive import Adaptive
from grosmc_mj.theory.control.references import FourierSeries, Setpoints, fourier_series, setpoints
from grosmc_mj.theory.control.task import Task
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.plants import TWO_LINK_ARM

N = 3


@cache
def tree() -> Robot:
    return Robot.from_mjcf(TREE)


@cache
def two_link() -> Robot:
    return Robot.from_mjcf(load_spec("two_link_arm"))


def weights(n: int) -> tuple[Array, Array]:
    return np.kron(np.eye(n), np.diag([100.0, 0.0])), np.eye(n)


@cache
def tree_task() -> Task:
    """Sines of the joints, for errors of either sign."""
    sine = np.array([[0.3], [0.2], [0.05]])
    series = FourierSeries(2.0, np.array([0.1, 0.2, 0.0]), np.zeros((N, 1)), sine)
    task = tree().task(fourier_series(N, 1), series, *weights(N))
    return replace(task, error=replace(task.error, sign=-1))


@cache
def two_link_task() -> Task:
    return two_link().task(setpoints(2, 2), Setpoints(0.3, -0.4), *weights(2))


def states(n: int, count: int = 3) -> Array:
    return np.random.default_rng(7).uniform(-1, 1, (count, 2 * n))


def forward(model: mujoco.MjModel, x: Array, **fields: Any) -> mujoco.MjData:
    """MuJoCo's forward dynamics of a model in a state."""
    n = len(x) // 2
    data = mujoco.MjData(model)
    data.qpos[:] = x[:n]
    data.qvel[:] = x[n:]
    for name, value in fields.items():
        getattr(data, name)[:] = value
    mujoco.mj_forward(model, data)
    return data


# Dynamics.


def energy(q: Array, dq: Array) -> Array:
    """Potential and kinetic energy of the tree; springs have a part in the potential."""
    model = tree().plant.model
    data = forward(model, np.append(q, dq))
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return data.energy.copy()


def slope(function: Any, q: Array) -> Array:
    """Derivatives of a function of q by central differences, a row for each joint."""
    step = 1e-5
    rows = [function(q + e) - function(q - e) for e in step * np.eye(len(q))]
    return np.array(rows) / (2 * step)


@pytest.mark.parametrize("x", states(N))
def test_inertia_is_that_of_the_kinetic_energy(x: Array) -> None:
    """(a + b)'M(a + b) - (a - b)'M(a - b) = 4 a'M b, and the energy is half of it."""
    q = x[:N]
    unit = np.eye(N)
    twice = [[energy(q, a + b)[1] - energy(q, a - b)[1] for b in unit] for a in unit]
    M = inertia(tree().nominal, q)
    np.testing.assert_allclose(M, np.array(twice) / 2, rtol=0, atol=1e-13)


@pytest.mark.parametrize("x", states(N))
def test_bias_is_that_of_lagranges_equations(x: Array) -> None:
    """h = M' q' - d(q' M q'/2)/dq + dV/dq, less springs and damping.

    The differences' rounding is eps/e of the energy, their curvature e^2.
    """
    q = x[:N]
    dq = x[N:]
    damping = np.array([joint.damping[0] for joint in tree().plant.spec.joints])
    inertia_slope = slope(lambda q: inertia(tree().nominal, q), q)
    force = slope(lambda q: energy(q, np.zeros(N))[0], q)
    coriolis = np.einsum("kij,k,j->i", inertia_slope, dq, dq)
    coriolis -= 0.5 * np.einsum("ijk,j,k->i", inertia_slope, dq, dq)
    expected = coriolis + force + damping * dq
    np.testing.assert_allclose(bias(tree().nominal, q, dq), expected, rtol=0, atol=1e-8)


def test_a_compensated_weight_is_no_part_of_the_bias() -> None:
    spec = mujoco.MjSpec.from_string(TREE)
    spec.body("tool").gravcomp = 0.7
    robot = Robot.from_mjcf(spec)
    x = states(N)[0]
    data = forward(robot.plant.model, x)
    expected = data.qfrc_bias - data.qfrc_passive
    np.testing.assert_allclose(bias(robot.nominal, x[:N], x[N:]), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("gravcomp", [0, 1])
def test_constraints_are_no_part_of_the_nominal_dynamics(gravcomp: int) -> None:
    """Neither a limit nor a contact acts, beyond the limit and within the floor.

    A model with gravity compensation keeps the floor as it keeps all geoms.
    """
    robot = Robot.from_mjcf(f"""<mujoco><worldbody><geom type="plane" size="9 9 1"/>
      <body gravcomp="{gravcomp}"><joint name="j" range="-1 1" limited="true"/>
      <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
      <actuator><motor joint="j"/></actuator></mujoco>""")
    x = np.array([1.5, 0.0])
    assert forward(robot.plant.model, x).nefc > 0
    assert forward(robot.nominal, x).nefc == 0


def test_no_law_knows_of_a_fluid() -> None:
    spec = mujoco.MjSpec.from_string(TREE)
    spec.option.density = 1000
    spec.option.viscosity = 0.1
    robot = Robot.from_mjcf(spec)
    q, dq = np.split(states(N)[0], 2)
    np.testing.assert_array_equal(bias(robot.nominal, q, dq), bias(tree().nominal, q, dq))
    assert "a disturbance to it: the fluid (density, viscosity), contacts" in robot.notes[-1]


# Laws.


@pytest.mark.parametrize("x", states(N))
def test_computed_torque_gives_the_acceleration_that_it_is_computed_for(x: Array) -> None:
    """On the nominal plant, by mj_forward of all bodies: no fused one is missing."""
    law = linearized_lqr(tree_task())
    error = law.coordinates
    p = law.parameters
    u = np.atleast_1d(law.input_at(0.3, x, law.memory()))

    z = np.array(error.error_state(0.3, x, p))
    expected = p.K @ z + np.array(error.reference(0.3, p.reference))[2::3]
    qacc = forward(tree().plant.model, x, qfrc_applied=u).qacc
    # The torques are up to 30 N m, on inertias down to 0.2 kg m^2.
    np.testing.assert_allclose(qacc, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("x", states(N))
def test_the_design_model_moves_by_mujocos_accelerations(x: Array) -> None:
    h = 1e-3
    u = np.array([0.4, -0.3, 0.2])
    law = computed_torque_pd(tree_task(), 9.0, 6.0)
    model = design_model(law, "this test")
    moved = x.copy()
    model.advance(0.3, moved, u, h, law.memory(), law.parameters, model.own)

    qacc = forward(tree().plant.model, x, ctrl=u).qacc
    q = x[:N] + h * x[N:] + 0.5 * h**2 * qacc
    dq = x[N:] + h * qacc
    np.testing.assert_allclose(moved, [*q, *dq], rtol=1e-9)


class Pair:
    """Coordinates of the two-link arm by MuJoCo and in symbols, each with its parameters."""

    def __init__(self) -> None:
        law = tracking_grosmc(two_link_task(), 10.0, 30.0)
        robot: Any = law.coordinates
        self.robot = replace(robot, sign=-1)
        self.p: Any = law.parameters
        self.symbolic = ErrorCoordinates(TWO_LINK_ARM, setpoints(2, 2), sign=-1)
        nominal = MujocoPlant.load("two_link_arm").analytic()
        self.symbolic_p: Any = replace(self.p, plant=nominal.parameters)


@pytest.fixture(scope="module")
def pair() -> Pair:
    return Pair()


def require_close(actual: Any, expected: Any) -> None:
    for ours, theirs in zip(actual, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12)


def test_coordinates_are_ordered_as_the_symbolic_ones(pair: Pair) -> None:
    assert pair.robot.size == 4
    assert pair.robot.units == pair.symbolic.units
    assert pair.robot.output_rows == pair.symbolic.output_rows


@pytest.mark.parametrize("x", states(2))
def test_the_error_is_that_of_the_symbolic_coordinates_and_place_its_inverse(
    pair: Pair, x: Array
) -> None:
    z = np.array(pair.robot.error_state(1.0, x, pair.p))
    require_close(z, pair.symbolic.error_state(1.0, x, pair.symbolic_p))
    require_close(pair.robot.along([1.0], x[None], pair.p)[0], z)
    require_close(pair.robot.place(1.0, z, pair.p), x)


@pytest.mark.parametrize("x", states(2))
def test_the_dynamics_are_those_of_the_symbolic_coordinates(pair: Pair, x: Array) -> None:
    expected = pair.symbolic.dynamics(1.0, x, pair.symbolic_p)
    require_close(pair.robot.dynamics(1.0, x, pair.p), expected)


@pytest.mark.parametrize("u", [None, np.random.default_rng(2).normal(0, 5, (1, 2))])
def test_the_motion_of_another_plant_is_that_of_the_symbolic_coordinates(
    pair: Pair, u: Array | None
) -> None:
    x = states(2)[0]
    heavier = BodyEdit("payload", mass_scale=3.0)
    w = np.random.default_rng(1).uniform(-5, 5, (1, 18))
    true_plant = two_link().plant.changed(heavier)
    twin = MujocoPlant.load("two_link_arm").changed(heavier).analytic()
    motion = pair.robot.error_dynamics([1.0], x[None], pair.p, true_plant, w, u)
    expected = pair.symbolic.error_dynamics([1.0], x[None], pair.symbolic_p, twin, w)
    require_close(motion, expected)

    z = np.array(pair.robot.error_state(1.0, x, pair.p))
    np.testing.assert_allclose(pair.robot.unmatched(z, motion[0][0]), 0, atol=1e-15)


# Designs that a robot does not have.

UNCERTAINTY = Uncertainty({}, (1.0,) * 18, (1.0,) * 4, 1.0)


def task_of_all_joints_with_two_torques() -> Task:
    robot = Robot.from_mjcf(TREE, actuators=["turn_servo", "lift_servo"])
    return robot.task(setpoints(3, 2), Setpoints(0.0, 0.0), np.eye(6), 1.0)


@pytest.mark.parametrize(
    ("design", "words"),
    [
        (task_of_all_joints_with_two_torques, "has 2 torques for 3 joints.*take a state_task"),
        (lambda: linear_lqr(two_link_task()), "no equations in symbols"),
        (lambda: regulating_grosmc(two_link_task(), UNCERTAINTY), "no equations in symbols"),
        (lambda: two_link().plant.analytic(), "no equations in symbols"),
        (
            lambda: Adaptive(1.0, 1.0).design(two_link_task()),
            "two_link_arm has no torques Y theta in symbols.*: take lqi, fl-pid or adrc",
        ),
    ],
)
def test_a_design_that_the_robot_has_no_means_for_is_refused(design: Any, words: str) -> None:
    with pytest.raises((ModelError, ArgumentError, PremiseError), match=words):
        design()
