"""The two-link arm: several inputs, from its outputs to the gains of the closed loop."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hand_written import elbow_up, tip, two_link_inertia
from shipped import TWO_LINK_CIRCLE, error_of, task_of, uncertainty_of

from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import computed_torque_pd
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.memory import SurfaceMemory
from grosmc_mj.theory.plants import AnalyticPlant

SYSTEM = "two_link_arm"
REGULATION = "two_link_arm regulation"


@cache
def nominal() -> AnalyticPlant:
    return MujocoPlant.load(SYSTEM).analytic()


@cache
def law(name: str, case: str = "regulation") -> Controller:
    return chapter_controller(name, nominal(), case=case)


# Outputs


def tip_jacobian(x: Array) -> Array:
    """dy/dq by extrapolated central differences, (2, 2), which lose h^4/480 = 2e-11."""

    def slope(h: float) -> Array:
        p = nominal().parameters
        columns = [(tip(x[:2] + s, p) - tip(x[:2] - s, p)) / (2 * h) for s in h * np.eye(2)]
        return np.array(columns).T

    return (4 * slope(5e-3) - slope(1e-2)) / 3


@pytest.mark.parametrize("q", np.random.default_rng(2).uniform(-math.pi, math.pi, (3, 2)))
def test_decoupling_matrix_of_the_tip_is_jacobian_times_inverse_inertia(q: Array) -> None:
    p = nominal().parameters
    x = np.array([*q, 2.0, -3.0])
    E = np.reshape(error_of("two_link_arm").linearization.decoupling_matrix(x, p), (2, 2))
    expected = tip_jacobian(x) @ np.linalg.inv(two_link_inertia(x, p))
    np.testing.assert_allclose(E, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("t", [0.0, 0.3, 0.75, 1.1, 1.6])
def test_place_is_inverse_kinematics(t: float) -> None:
    """The elbow-up state with that tip and that velocity of the tip, all around the circle."""
    error = error_of("two_link_arm")
    parameters = law("grosmc", "nominal").parameters
    z = np.array([0.08, -0.2, -0.05, 0.3])
    x = error.place(t, z, parameters)

    circle = TWO_LINK_CIRCLE
    angle = circle.frequency * t
    centre = np.array([circle.centre1, circle.centre2])
    radius = circle.radius * np.array([math.cos(angle), math.sin(angle)])
    speed = circle.frequency * np.array([-radius[1], radius[0]])
    expected = elbow_up(centre + radius + z[::2], nominal().parameters)
    np.testing.assert_allclose(x[:2], expected, atol=1e-9)
    np.testing.assert_allclose(tip_jacobian(x) @ x[2:], speed + z[1::2], atol=1e-9)
    np.testing.assert_allclose(error.error_state(t, x, parameters), z, atol=1e-9)


# Gains


def declared_points() -> list[tuple[float, Array]]:
    """Scales of the payload and errors: corners of the declared family, and points within."""
    low, high = uncertainty_of(REGULATION).scales["mp"]
    region = np.array(uncertainty_of(REGULATION).region)
    points: list[tuple[float, Array]] = []
    for signs in itertools.product((-1.0, 1.0), repeat=4):
        points += [(low, region * signs), (high, region * signs)]

    random = np.random.default_rng(7)
    for _ in range(10):
        points.append((random.uniform(low, high), region * random.uniform(-1, 1, 4)))
    return points


@pytest.mark.parametrize("side2", [-1.0, 1.0])
@pytest.mark.parametrize("side1", [-1.0, 1.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_each_s_falls_at_the_declared_rate_for_all_of_the_declared_family(
    sign: float, side1: float, side2: float
) -> None:
    """s_i' sgn(s_i) <= -eta for both, whatever the sides: the margin and the gains are for that.

    Next to the surfaces, by the true plant's own accelerations.
    """
    grosmc = law("grosmc")
    p = grosmc.parameters
    sides = np.array([side1, side2])
    w = sign * np.array(uncertainty_of(REGULATION).wrench)
    for scale, z in declared_points():
        plant = nominal().changed(scales={"mp": scale})
        x = error_of(REGULATION).place(0.0, z, p)
        memory = grosmc.memory()
        assert isinstance(memory, SurfaceMemory)
        memory.z0[:] = z - np.linalg.pinv(p.G) @ (1e-6 * sides)
        memory.t = 1.0
        memory.begun = 1.0
        u = grosmc.input_at(1.0, x, memory)
        assert np.sign(memory.s).tolist() == sides.tolist()

        z_rate = plant.derivative(x, u, w)[[0, 2, 1, 3]]
        s_rate = p.G @ z_rate - p.S @ z
        assert np.all(sides * s_rate <= -uncertainty_of(REGULATION).reaching_rate)


def least_dominance(payload: float) -> float:
    """Least diagonal dominance over the poses of the region, with G = [0 1 0 0; 0 0 0 1/3]."""
    p = nominal().parameters
    heavy = replace(p, mp=payload)
    G_r = np.diag([1.0, 1 / 3])
    margins: list[float] = []
    for turn in np.linspace(-0.6, 0.6, 25):
        q = np.array([0.0, -math.pi / 2 + turn])
        R = np.linalg.inv(two_link_inertia(q, heavy)) @ two_link_inertia(q, p)
        R = G_r @ R @ np.linalg.inv(G_r)
        diagonal = np.diag(R)
        margins.append(np.min(diagonal - np.abs(R - np.diag(diagonal)).sum(axis=1)))
    return min(margins)


def test_gain_ratio_of_the_design_is_that_of_the_heaviest_payload() -> None:
    """The grid of states is coarser than the one by hand, but both have the region's edges."""
    ratio = uncertainty_of(REGULATION).reaching_rate / law("grosmc").parameters.eta
    assert ratio == pytest.approx(least_dominance(0.6), rel=1e-9)


def test_no_gain_makes_up_for_a_payload_five_times_as_heavy() -> None:
    """Up to 1 kg under G = B+: none is given."""
    heavier = replace(uncertainty_of(REGULATION), scales={"mp": (1.0, 5.0)})
    control = law("lqr")
    with pytest.raises(GainError, match="no switching gain can make up"):
        heavier.gains(control, nominal())


# Computed torque


@pytest.fixture(scope="module")
def pd() -> LqrDesign:
    return computed_torque_pd(task_of(REGULATION, nominal()), 4.0, 0.6).designed.lqr


def test_pd_has_the_given_pair_of_poles_for_each_output(pd: LqrDesign) -> None:
    """The roots of s^2 + 2 (0.6) (4) s + 4^2, once for each output."""
    expected = -2.4 + 3.2j * np.array([-1, -1, 1, 1])
    np.testing.assert_allclose(np.sort_complex(pd.poles), np.sort_complex(expected), rtol=1e-6)


def test_pd_has_its_price_by_lyapunovs_equation(pd: LqrDesign) -> None:
    chains = error_of(REGULATION).linearization
    closed = chains.A - chains.B @ pd.K
    residual = closed.T @ pd.P + pd.P @ closed + pd.Q + pd.K.T @ pd.R @ pd.K
    np.testing.assert_allclose(residual, 0, atol=1e-9 * np.abs(pd.Q).max())
