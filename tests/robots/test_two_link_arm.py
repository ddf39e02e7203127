"""The two-link arm: several inputs, from its outputs to the gains of the closed loop."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hand_written import elbow_up, tip, two_link_inertia
from shipped import (
    TWO_LINK_CIRCLE,
    TWO_LINK_JOINTS,
    TWO_LINK_TIP,
    TWO_LINK_UNCERTAINTY,
    task_of,
)

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import computed_torque_pd
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.errors import GainError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant

SYSTEM, REGULATION = "two_link_arm", "two_link_arm regulation"
SIDES = [np.array(sides) for sides in itertools.product((-1.0, 1.0), repeat=2)]


@cache
def nominal() -> AnalyticPlant:
    return MujocoPlant.load(SYSTEM).analytic()


@cache
def law(name: str, case: str = "regulation") -> Controller:
    return chapter_controller(name, nominal(), case=case)


def tip_jacobian(x: Array) -> Array:
    """dy/dq by extrapolated central differences, (2, 2), which lose h^4/480 = 2e-11."""

    def slope(h: float) -> Array:
        p = nominal().parameters
        columns = [(tip(x[:2] + s, p) - tip(x[:2] - s, p)) / (2 * h) for s in h * np.eye(2)]
        return np.array(columns).T

    return (4 * slope(5e-3) - slope(1e-2)) / 3


def test_decoupling_matrix_of_the_tip_is_jacobian_times_inverse_inertia() -> None:
    random, p = np.random.default_rng(2), nominal().parameters
    for _ in range(5):
        x = np.concatenate([random.uniform(-math.pi, math.pi, 2), random.normal(0, 3, 2)])
        E = np.reshape(TWO_LINK_TIP.linearization.decoupling_matrix(x, p), (2, 2))
        expected = tip_jacobian(x) @ np.linalg.inv(two_link_inertia(x, p))
        np.testing.assert_allclose(E, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_place_is_inverse_kinematics() -> None:
    """The elbow-up state with that tip and that velocity of the tip, all around the circle."""
    random, c = np.random.default_rng(5), TWO_LINK_CIRCLE
    parameters = law("grosmc", "nominal").parameters
    for t in np.linspace(0, 2, 9).tolist():
        z, turn = random.uniform(-1, 1, 4) * [0.1, 0.3, 0.1, 0.3], c.frequency * t
        x = TWO_LINK_TIP.place(t, z, parameters)
        point = [c.centre1 + c.radius * math.cos(turn), c.centre2 + c.radius * math.sin(turn)]
        speed = c.radius * c.frequency * np.array([-math.sin(turn), math.cos(turn)])
        expected = elbow_up(point + z[::2], nominal().parameters)
        np.testing.assert_allclose(x[:2], expected, atol=1e-9)
        np.testing.assert_allclose(tip_jacobian(x) @ x[2:], speed + z[1::2], atol=1e-9)
        np.testing.assert_allclose(TWO_LINK_TIP.error_state(t, x, parameters), z, atol=1e-9)


def test_each_s_falls_at_the_declared_rate_for_all_of_the_declared_family() -> None:
    """s_i' sgn(s_i) <= -eta for both, whatever the sides: what the margin and the gains are for.

    Next to the surfaces, by the true plant's own accelerations: at corners of the declared family
    and at random points within.
    """
    declared, random, p = TWO_LINK_UNCERTAINTY, np.random.default_rng(7), law("grosmc").parameters
    (low, high), region = declared.scales["mp"], np.array(declared.region)
    signs = itertools.product((-1.0, 0.0, 1.0), repeat=4)
    pairs = [(scale, region * sign) for sign in signs for scale in (low, high)]
    pairs += [(random.uniform(low, high), region * random.uniform(-1, 1, 4)) for _ in range(20)]
    for (scale, z), sign, sides in itertools.product(pairs, (-1.0, 1.0), SIDES):
        plant, w = nominal().changed(scales={"mp": scale}), sign * np.array(declared.wrench)
        x, memory = TWO_LINK_JOINTS.place(0.0, z, p), law("grosmc").memory()
        assert isinstance(memory, SurfaceMemory)
        memory.z0[:], memory.t = z - np.linalg.pinv(p.G) @ (1e-6 * sides), 1.0
        u = law("grosmc").input_at(1.0, x, memory)
        assert np.sign(memory.s).tolist() == sides.tolist()
        rates = p.G @ plant.derivative(x, u, w)[[0, 2, 1, 3]] - p.S @ z
        assert np.all(sides * rates <= -declared.reaching_rate)


def test_gain_ratio_of_the_design_is_that_of_the_heaviest_payload() -> None:
    """Over the poses of the declared region, with G = [0 1 0 0; 0 0 0 1/3], by hand."""
    p, G_r, margins = nominal().parameters, np.diag([1.0, 1 / 3]), []
    for turn in np.linspace(-0.6, 0.6, 25):
        q, heavy = np.array([0.0, -math.pi / 2 + turn]), replace(p, mp=0.6)
        R = np.linalg.inv(two_link_inertia(q, heavy)) @ two_link_inertia(q, p)
        R = G_r @ R @ np.linalg.inv(G_r)
        margins.append(np.min(np.diag(R) - np.abs(R - np.diag(np.diag(R))).sum(axis=1)))
    ratio = TWO_LINK_UNCERTAINTY.reaching_rate / law("grosmc").parameters.eta
    # The grid of states is coarser than the one by hand, but both have the region's edges.
    assert ratio == pytest.approx(min(margins), rel=1e-9)
    # Up to 1 kg under G = B+: no gain helps, and none is given.
    heavier, control = replace(TWO_LINK_UNCERTAINTY, scales={"mp": (1.0, 5.0)}), law("lqr")
    with pytest.raises(GainError, match="no switching gain can make up"):
        heavier.gains(control.designed, control.parameters)


def test_pd_has_two_poles_of_that_frequency_and_damping_for_each_output() -> None:
    pd = computed_torque_pd(task_of(REGULATION, nominal()), 4.0, 0.6).designed.lqr
    assert pd is not None
    expected = -2.4 + 3.2j * np.array([-1, -1, 1, 1])
    np.testing.assert_allclose(np.sort_complex(pd.poles), np.sort_complex(expected), rtol=1e-6)
    # Its price by Lyapunov's equation.
    chains = TWO_LINK_JOINTS.linearization
    closed = chains.A - chains.B @ pd.K
    rest = closed.T @ pd.P + pd.P @ closed + pd.Q + pd.K.T @ pd.R @ pd.K
    np.testing.assert_allclose(rest, 0, atol=1e-9 * np.abs(pd.Q).max())
