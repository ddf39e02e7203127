"""The optimal law: Riccati equation, optimality and trajectories."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.surface import surface_matrix
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant

CHAIN_A, CHAIN_B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])


class Published(NamedTuple):
    """Numbers calculated independently of this package."""

    system: str
    controller: str
    z0: tuple[float, float]
    K: tuple[float, float]
    poles: tuple[complex, complex]
    cost: float
    # Half a unit of the last digit that is printed.
    pole_digits: float


# fmt: off
PUBLISHED = [
    Published("servo", "lqr", (1.0, 0.0), (-1.0, -1.0699444), (-11.517145, -1.003703),
              0.5415689, 5e-7),
    Published("cart_pendulum", "fl-lqr", (-np.pi / 18, 0.0), (10.0, 4.5825757),
              (-2.291 - 2.179j, -2.291 + 2.179j), 0.6979662, 5e-4 * np.sqrt(2)),
    Published("arm", "lqr", (0.5, 0.0), (3.1622777, 2.7063916),
              (-1.3531958 - 1.1537499j, -1.3531958 + 1.1537499j), 0.8197952, 5e-8 * np.sqrt(2)),
]
# fmt: on
each_system = pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: row.system)


@cache
def design_of(system: str, controller: str) -> LqrDesign:
    return chapter_controller(controller, MujocoPlant.load(system).analytic()).designed.lqr


def random_design(seed: int) -> LqrDesign:
    """Of a random controllable pair with one to four states and one or two inputs."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    C, D = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    return lqr(rng.normal(size=(n, n)), rng.normal(size=(n, m)), C.T @ C, D.T @ D + np.eye(m))


@pytest.mark.parametrize("seed", [*range(10), None])
def test_solution_satisfies_the_riccati_equation_6(seed: int | None) -> None:
    """And eq. (5), with P symmetric and positive definite and a stable loop."""
    chapter = [design_of(row.system, row.controller) for row in PUBLISHED]
    for d in chapter if seed is None else [random_design(seed)]:
        quadratic = d.P @ d.B @ np.linalg.solve(d.R, d.B.T @ d.P)
        residual = -d.P @ d.A - d.A.T @ d.P + quadratic - d.Q
        assert np.abs(residual).max() < 1e-9 * max(1.0, np.abs(quadratic).max())
        np.testing.assert_allclose(d.K, np.linalg.solve(d.R, d.B.T @ d.P), rtol=0, atol=1e-10)
        np.testing.assert_allclose(d.P, d.P.T, rtol=0, atol=1e-12 * np.abs(d.P).max())
        assert np.linalg.eigvalsh(d.P).min() > 0
        assert d.poles.real.max() < 0


@each_system
def test_nominal_designs_are_those_of_the_reference(row: Published) -> None:
    d = design_of(row.system, row.controller)
    # The table prints gains and costs to seven decimals.
    np.testing.assert_allclose(d.K, [row.K], rtol=0, atol=5.1e-8)
    poles = sorted(d.poles, key=lambda pole: (pole.real, pole.imag))
    np.testing.assert_allclose(poles, row.poles, rtol=0, atol=row.pole_digits)
    assert d.optimal_cost(row.z0) == pytest.approx(row.cost, rel=0, abs=5.1e-8)


@given(q1=st.floats(1e-3, 1e3), q2=st.floats(0, 1e3), r=st.floats(1e-2, 1e2))
@settings(max_examples=50)
def test_gain_of_the_integrator_chain_is_the_closed_form(q1: float, q2: float, r: float) -> None:
    """Eq. (6) for z'' = v: K1 = sqrt(q1/r), K2 = sqrt(q2/r + 2 K1)."""
    K1 = np.sqrt(q1 / r)
    K = lqr(CHAIN_A, CHAIN_B, np.diag([q1, q2]), r).K
    # The Riccati solver is backward stable; its condition grows with the spread of the weights.
    np.testing.assert_allclose(K, [[K1, np.sqrt(q2 / r + 2 * K1)]], rtol=1e-6)


@each_system
def test_every_other_gain_costs_more(row: Published) -> None:
    """J of u = -K x is x0' P_K x0 / 2 with (A-BK)' P_K + P_K (A-BK) = -(Q + K'RK)."""
    d, z0, rng = design_of(row.system, row.controller), np.array(row.z0), np.random.default_rng(0)
    for _ in range(20):
        K = d.K * (1 + rng.uniform(-0.3, 0.3, d.K.shape))
        A_c = d.A - d.B @ K
        assert np.linalg.eigvals(A_c).real.max() < 0
        P_K = scipy.linalg.solve_continuous_lyapunov(A_c.T, -(d.Q + K.T @ d.R @ K))
        assert 0.5 * z0 @ P_K @ z0 > d.optimal_cost(z0)


@each_system
def test_optimal_trajectory_solves_the_closed_loop_equation(row: Published) -> None:
    d, time = design_of(row.system, row.controller), np.linspace(0, 5, 51)
    x = d.optimal_trajectory(row.z0, time)
    solution = scipy.integrate.solve_ivp(
        lambda _, z: (d.A - d.B @ d.K) @ z, (0, 5), row.z0, t_eval=time, rtol=1e-10, atol=1e-12
    )
    assert x.shape == (51, 2)
    np.testing.assert_array_equal(x[0], row.z0)
    np.testing.assert_allclose(x, solution.y.T, rtol=0, atol=1e-8)  # 100 times the ODE's rtol


@each_system
def test_cost_integrated_along_the_optimal_trajectory_is_the_optimal_cost(row: Published) -> None:
    d, time = design_of(row.system, row.controller), np.linspace(0, 20, 20001)
    x = d.optimal_trajectory(row.z0, time)
    u = -x @ d.K.T
    index = 0.5 * (np.einsum("ti,ij,tj->t", x, d.Q, x) + np.einsum("ti,ij,tj->t", u, d.R, u))
    # Simpson errs by (h pole)^4 = 2e-8 at the fastest pole; the slowest mode leaves exp(-40).
    J = scipy.integrate.simpson(index, x=time)
    assert pytest.approx(J, rel=1e-7) == d.optimal_cost(row.z0)


def test_stable_uncontrollable_mode_is_accepted() -> None:
    d = lqr(np.diag([-1.0, 0.0]), [[0.0], [1.0]], np.eye(2), 1.0)
    np.testing.assert_allclose(sorted(d.poles.real), [-1, -1], atol=1e-12)


@pytest.mark.parametrize("B", [CHAIN_B, np.array([[0.0], [-11.56]]), np.eye(2)])
def test_default_surface_matrix_is_the_pseudoinverse_so_that_GB_is_the_identity(B: np.ndarray):
    G = surface_matrix(None, B)
    np.testing.assert_allclose(G, np.linalg.solve(B.T @ B, B.T), rtol=0, atol=1e-12)
    np.testing.assert_allclose(G @ B, np.eye(B.shape[1]), rtol=0, atol=1e-12)
