"""The optimal law: Riccati equation, optimality and trajectories."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.control.lqr import LqrDesign, design_of_gain, lqr
from grosmc_mj.theory.control.surface import surface_matrix

CHAIN_A = np.array([[0.0, 1.0], [0.0, 0.0]])
CHAIN_B = np.array([[0.0], [1.0]])


class Published(NamedTuple):
    """Numbers of a design that were calculated independently of this package.

    Gains and costs are printed to seven decimals; ``digits`` is half a unit of the last digit of
    the poles.
    """

    system: str
    law: str
    z0: tuple[float, ...]
    K: tuple[float, ...]
    poles: tuple[complex, ...]
    cost: float
    digits: float

    @property
    def design(self) -> LqrDesign:
        plant = MujocoPlant.load(self.system).analytic()
        return chapter_controller(self.law, plant).designed.lqr


SERVO = Published(
    "servo",
    "lqr",
    z0=(1.0, 0.0),
    K=(-1.0, -1.0699444),
    poles=(-11.517145, -1.003703),
    cost=0.5415689,
    digits=5e-7,
)
PENDULUM = Published(
    "cart_pendulum",
    "fl-lqr",
    z0=(-np.pi / 18, 0.0),
    K=(10.0, 4.5825757),
    poles=(-2.291 - 2.179j, -2.291 + 2.179j),
    cost=0.6979662,
    digits=5e-4 * np.sqrt(2),
)
ARM = Published(
    "arm",
    "lqr",
    z0=(0.5, 0.0),
    K=(3.1622777, 2.7063916),
    poles=(-1.3531958 - 1.1537499j, -1.3531958 + 1.1537499j),
    cost=0.8197952,
    digits=5e-8 * np.sqrt(2),
)
each_published = pytest.mark.parametrize(
    "published", [SERVO, PENDULUM, ARM], ids=lambda published: published.system
)


@each_published
def test_nominal_designs_are_those_of_the_reference(published: Published) -> None:
    design = published.design
    np.testing.assert_allclose(design.K, [published.K], rtol=0, atol=5.1e-8)

    poles = sorted(design.poles, key=lambda pole: (pole.real, pole.imag))
    np.testing.assert_allclose(poles, published.poles, rtol=0, atol=published.digits)

    cost = design.optimal_cost(published.z0)
    assert cost == pytest.approx(published.cost, rel=0, abs=5.1e-8)


@each_published
def test_no_other_gain_costs_less(published: Published) -> None:
    """J of u = -K x is x0' P_K x0 / 2 with (A-BK)' P_K + P_K (A-BK) = -(Q + K'RK)."""
    design = published.design
    z0 = np.array(published.z0)
    random = np.random.default_rng(0)
    for factors in random.uniform(0.7, 1.3, (20, *design.K.shape)):
        K = design.K * factors
        closed = design.A - design.B @ K
        weight = design.Q + K.T @ design.R @ K
        P = scipy.linalg.solve_continuous_lyapunov(closed.T, -weight)
        assert 0.5 * z0 @ P @ z0 > design.optimal_cost(z0)


@each_published
def test_optimal_trajectory_solves_the_closed_loop_s_equation(published: Published) -> None:
    design = published.design
    closed = design.A - design.B @ design.K
    time = np.linspace(0, 5, 5001)
    x = design.optimal_trajectory(published.z0, time)

    solution = scipy.integrate.solve_ivp(
        lambda _, z: closed @ z,
        (0, 5),
        published.z0,
        t_eval=time[::100],
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_array_equal(x[0], published.z0)
    # 100 times rtol of the solver.
    np.testing.assert_allclose(x[::100], solution.y.T, rtol=0, atol=1e-8)


@each_published
def test_optimal_trajectory_has_the_optimal_cost(published: Published) -> None:
    """Simpson errs by (h pole)^4 = 2e-8 at the fastest pole; the slowest mode leaves exp(-40)."""
    design = published.design
    time = np.linspace(0, 20, 20001)
    x = design.optimal_trajectory(published.z0, time)
    u = -x @ design.K.T

    state_cost = np.einsum("ti,ij,tj->t", x, design.Q, x)
    input_cost = np.einsum("ti,ij,tj->t", u, design.R, u)
    cost = scipy.integrate.simpson(0.5 * (state_cost + input_cost), x=time)
    assert cost == pytest.approx(design.optimal_cost(published.z0), rel=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_solution_satisfies_the_riccati_equation_6(seed: int) -> None:
    """And eq. (5), of random pairs with one to four states and one or two inputs."""
    random = np.random.default_rng(seed)
    n = int(random.integers(1, 5))
    m = int(random.integers(1, 3))
    C = random.normal(size=(n, n))
    D = random.normal(size=(m, m))
    Q = C.T @ C
    R = D.T @ D + np.eye(m)
    A = random.normal(size=(n, n))
    B = random.normal(size=(n, m))
    design = lqr(A, B, Q, R)

    P = design.P
    quadratic = P @ B @ np.linalg.solve(R, B.T @ P)
    residual = -P @ A - A.T @ P + quadratic - Q
    size = max(1.0, np.abs(quadratic).max())
    assert np.abs(residual).max() < 1e-9 * size
    K = np.linalg.solve(R, B.T @ P)
    np.testing.assert_allclose(design.K, K, rtol=0, atol=1e-10)
    assert design.poles.real.max() < 0


@pytest.mark.parametrize(
    ("q1", "q2", "r"),
    [
        (1.0, 0.0, 1.0),
        (1e3, 7.0, 1e-2),
        (1e-3, 1e3, 1e2),
    ],
)
def test_gain_of_the_integrator_chain_is_the_closed_form(q1: float, q2: float, r: float) -> None:
    """Eq. (6) for z'' = v: K1 = sqrt(q1/r), K2 = sqrt(q2/r + 2 K1)."""
    K1 = np.sqrt(q1 / r)
    K2 = np.sqrt(q2 / r + 2 * K1)
    design = lqr(CHAIN_A, CHAIN_B, np.diag([q1, q2]), r)
    # The Riccati solver is backward stable; its condition grows with the spread of the weights.
    np.testing.assert_allclose(design.K, [[K1, K2]], rtol=1e-6)


def test_a_stable_mode_that_the_input_does_not_reach_is_accepted() -> None:
    A = np.diag([-1.0, 0.0])
    design = lqr(A, CHAIN_B, np.eye(2), 1.0)
    np.testing.assert_allclose(sorted(design.poles.real), [-1, -1], atol=1e-12)


@pytest.mark.parametrize("column", [[0.0, 1.0], [0.0, -11.56], [1.0, 2.0]])
def test_default_surface_matrix_is_the_pseudoinverse(column: list[float]) -> None:
    B = np.array(column)[:, None]
    pseudoinverse = np.linalg.solve(B.T @ B, B.T)
    G = surface_matrix(None, B)
    np.testing.assert_allclose(G, pseudoinverse, rtol=0, atol=1e-12)


def test_the_cost_of_a_given_gain_weighs_the_input_by_r() -> None:
    """J of x' = -2 x from 1 with Q = 3, R = 5: (3 + 5 * 4)/(2 * 4), by the integral of its law."""
    design = design_of_gain(
        np.array([[0.0]]), np.array([[1.0]]), [[3.0]], [[5.0]], np.array([[2.0]])
    )
    t = np.linspace(0.0, 20.0, 200_001)
    x = np.exp(-2.0 * t)
    cost = np.trapezoid(0.5 * (3.0 * x**2 + 5.0 * (2.0 * x) ** 2), t)
    assert design.optimal_cost([1.0]) == pytest.approx(cost, rel=1e-6)
