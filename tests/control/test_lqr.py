"""The optimal law: Riccati equation, optimality and trajectories."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from grosmc_mj.control.lqr import lqr
from grosmc_mj.control.surface import surface_matrix
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant

CHAIN_A, CHAIN_B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
# z0, K, poles, J* and half a unit of the poles' last digit, calculated independently of this
# package; gains and costs are printed to seven decimals.
PUBLISHED: dict[tuple[str, str], Any] = {
    ("servo", "lqr"): ((1.0, 0.0), (-1.0, -1.0699444), (-11.517145, -1.003703), 0.5415689, 5e-7),
    ("cart_pendulum", "fl-lqr"): (
        (-np.pi / 18, 0.0), (10.0, 4.5825757), (-2.291 - 2.179j, -2.291 + 2.179j), 0.6979662,
        5e-4 * np.sqrt(2),
    ),
    ("arm", "lqr"): (
        (0.5, 0.0), (3.1622777, 2.7063916), (-1.3531958 - 1.1537499j, -1.3531958 + 1.1537499j),
        0.8197952, 5e-8 * np.sqrt(2),
    ),
}  # fmt: skip


@pytest.mark.parametrize(("system", "controller"), PUBLISHED)
def test_nominal_designs_are_those_of_the_reference_and_no_other_gain_costs_less(
    system: str, controller: str
) -> None:
    start, K, poles, cost, digits = PUBLISHED[system, controller]
    d, z0 = chapter_controller(controller, MujocoPlant.load(system).analytic()).designed.lqr, start
    np.testing.assert_allclose(d.K, [K], rtol=0, atol=5.1e-8)
    ordered = sorted(d.poles, key=lambda pole: (pole.real, pole.imag))
    np.testing.assert_allclose(ordered, poles, rtol=0, atol=digits)
    assert d.optimal_cost(z0) == pytest.approx(cost, rel=0, abs=5.1e-8)
    # J of u = -K x is x0' P_K x0 / 2 with (A-BK)' P_K + P_K (A-BK) = -(Q + K'RK).
    for factors in np.random.default_rng(0).uniform(0.7, 1.3, (20, *d.K.shape)):
        other, z = d.K * factors, np.array(z0)
        weight = -(d.Q + other.T @ d.R @ other)
        P = scipy.linalg.solve_continuous_lyapunov((d.A - d.B @ other).T, weight)
        assert 0.5 * z @ P @ z > d.optimal_cost(z)
    # Its trajectory solves the closed loop's equation, and has the optimal cost.
    time = np.linspace(0, 20, 20001)
    x = d.optimal_trajectory(z0, time)
    solution = scipy.integrate.solve_ivp(
        lambda _, z: (d.A - d.B @ d.K) @ z, (0, 5), z0, t_eval=time[:5001:100], rtol=1e-10,
        atol=1e-12,
    )  # fmt: skip
    np.testing.assert_array_equal(x[0], z0)
    np.testing.assert_allclose(x[:5001:100], solution.y.T, rtol=0, atol=1e-8)  # 100 times its rtol
    u = -x @ d.K.T
    index = 0.5 * (np.einsum("ti,ij,tj->t", x, d.Q, x) + np.einsum("ti,ij,tj->t", u, d.R, u))
    # Simpson errs by (h pole)^4 = 2e-8 at the fastest pole; the slowest mode leaves exp(-40).
    assert pytest.approx(scipy.integrate.simpson(index, x=time), rel=1e-7) == d.optimal_cost(z0)


def test_solution_satisfies_the_riccati_equation_6() -> None:
    """And eq. (5), of random pairs with one to four states and one or two inputs."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        n, m = int(rng.integers(1, 5)), int(rng.integers(1, 3))
        C, D = rng.normal(size=(n, n)), rng.normal(size=(m, m))
        weights = C.T @ C, D.T @ D + np.eye(m)
        d = lqr(rng.normal(size=(n, n)), rng.normal(size=(n, m)), *weights)
        quadratic = d.P @ d.B @ np.linalg.solve(d.R, d.B.T @ d.P)
        residual = -d.P @ d.A - d.A.T @ d.P + quadratic - d.Q
        assert np.abs(residual).max() < 1e-9 * max(1.0, np.abs(quadratic).max())
        np.testing.assert_allclose(d.K, np.linalg.solve(d.R, d.B.T @ d.P), rtol=0, atol=1e-10)
        assert d.poles.real.max() < 0


def test_gain_of_the_integrator_chain_is_the_closed_form() -> None:
    """Eq. (6) for z'' = v: K1 = sqrt(q1/r), K2 = sqrt(q2/r + 2 K1)."""
    for q1, q2, r in ((1.0, 0.0, 1.0), (1e3, 7.0, 1e-2), (1e-3, 1e3, 1e2)):
        K1 = np.sqrt(q1 / r)
        K = lqr(CHAIN_A, CHAIN_B, np.diag([q1, q2]), r).K
        # The Riccati solver is backward stable; its condition grows with the spread of the weights.
        np.testing.assert_allclose(K, [[K1, np.sqrt(q2 / r + 2 * K1)]], rtol=1e-6)
    # A stable mode that the input does not reach is accepted.
    d = lqr(np.diag([-1.0, 0.0]), [[0.0], [1.0]], np.eye(2), 1.0)
    np.testing.assert_allclose(sorted(d.poles.real), [-1, -1], atol=1e-12)


def test_default_surface_matrix_is_the_pseudoinverse() -> None:
    for B in (CHAIN_B, np.array([[0.0], [-11.56]]), np.array([[1.0], [2.0]])):
        G = surface_matrix(None, B)
        np.testing.assert_allclose(G, np.linalg.solve(B.T @ B, B.T), rtol=0, atol=1e-12)
