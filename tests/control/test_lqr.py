"""The optimal law: Riccati equation, optimality, trajectories, and what cannot be designed."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import ARM_ERROR, ARM_REFERENCE, ARM_WEIGHTS

from grosmc_mj.control.design import tracking_grosmc
from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.surface import surface_matrix
from grosmc_mj.control.task import Task
from grosmc_mj.errors import ArgumentError, GainError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant

CHAIN_A, CHAIN_B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
I2 = np.eye(2)


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


PUBLISHED = [
    Published(
        "servo",
        "lqr",
        (1.0, 0.0),
        (-1.0, -1.0699444),
        (-11.517145, -1.003703),
        0.5415689,
        5e-7,
    ),
    Published(
        "cart_pendulum",
        "fl-lqr",
        (-np.pi / 18, 0.0),
        (10.0, 4.5825757),
        (-2.291 - 2.179j, -2.291 + 2.179j),
        0.6979662,
        5e-4 * np.sqrt(2),
    ),
    Published(
        "arm",
        "lqr",
        (0.5, 0.0),
        (3.1622777, 2.7063916),
        (-1.3531958 - 1.1537499j, -1.3531958 + 1.1537499j),
        0.8197952,
        5e-8 * np.sqrt(2),
    ),
]
each_system = pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: row.system)


@cache
def design_of(system: str, controller: str) -> LqrDesign:
    return chapter_controller(controller, MujocoPlant.load(system).analytic()).designed.lqr


def riccati_residual(d: LqrDesign) -> float:
    """The largest entry of eq. (6), over the largest of its quadratic term."""
    quadratic = d.P @ d.B @ np.linalg.solve(d.R, d.B.T @ d.P)
    residual = -d.P @ d.A - d.A.T @ d.P + quadratic - d.Q
    return float(np.abs(residual).max() / max(1.0, np.abs(quadratic).max()))


@each_system
def test_solution_satisfies_the_riccati_equation_6(row):
    assert riccati_residual(design_of(row.system, row.controller)) < 1e-9


@pytest.mark.parametrize("seed", range(10))
def test_random_controllable_pairs_satisfy_eqs_5_and_6_and_are_stable(seed):
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(1, 5)), int(rng.integers(1, 3))
    C, D = rng.normal(size=(n, n)), rng.normal(size=(m, m))
    d = lqr(rng.normal(size=(n, n)), rng.normal(size=(n, m)), C.T @ C, D.T @ D + np.eye(m))

    assert riccati_residual(d) < 1e-9
    np.testing.assert_allclose(d.K, np.linalg.solve(d.R, d.B.T @ d.P), rtol=0, atol=1e-10)
    np.testing.assert_allclose(d.P, d.P.T, rtol=0, atol=1e-12 * np.abs(d.P).max())
    assert np.linalg.eigvalsh(d.P).min() > 0
    assert d.poles.real.max() < 0


@each_system
def test_nominal_designs_are_those_of_the_reference(row):
    d = design_of(row.system, row.controller)

    # The table prints gains and costs to seven decimals.
    np.testing.assert_allclose(d.K, [row.K], rtol=0, atol=5.1e-8)
    poles = sorted(d.poles, key=lambda pole: (pole.real, pole.imag))
    np.testing.assert_allclose(poles, row.poles, rtol=0, atol=row.pole_digits)
    assert d.optimal_cost(row.z0) == pytest.approx(row.cost, rel=0, abs=5.1e-8)


@given(q1=st.floats(1e-3, 1e3), q2=st.floats(0, 1e3), r=st.floats(1e-2, 1e2))
@settings(max_examples=50)
def test_gain_of_the_integrator_chain_is_the_closed_form(q1, q2, r):
    """Eq. (6) for z'' = v: K1 = sqrt(q1/r), K2 = sqrt(q2/r + 2 K1)."""
    K1 = np.sqrt(q1 / r)
    K = lqr(CHAIN_A, CHAIN_B, np.diag([q1, q2]), r).K
    # The Riccati solver is backward stable; its condition grows with the spread of the weights.
    np.testing.assert_allclose(K, [[K1, np.sqrt(q2 / r + 2 * K1)]], rtol=1e-6)


@each_system
def test_every_other_gain_costs_more(row):
    """J of u = -K x is x0' P_K x0 / 2 with (A-BK)' P_K + P_K (A-BK) = -(Q + K'RK)."""
    d = design_of(row.system, row.controller)
    rng = np.random.default_rng(0)
    for _ in range(20):
        K = d.K * (1 + rng.uniform(-0.3, 0.3, d.K.shape))
        A_c = d.A - d.B @ K
        assert np.linalg.eigvals(A_c).real.max() < 0
        P_K = scipy.linalg.solve_continuous_lyapunov(A_c.T, -(d.Q + K.T @ d.R @ K))
        assert 0.5 * np.array(row.z0) @ P_K @ np.array(row.z0) > d.optimal_cost(row.z0)


@each_system
def test_optimal_trajectory_solves_the_closed_loop_equation(row):
    d, time = design_of(row.system, row.controller), np.linspace(0, 5, 51)
    x = d.optimal_trajectory(row.z0, time)
    solution = scipy.integrate.solve_ivp(
        lambda _, z: (d.A - d.B @ d.K) @ z, (0, 5), row.z0, t_eval=time, rtol=1e-10, atol=1e-12
    )
    assert x.shape == (51, 2)
    np.testing.assert_array_equal(x[0], row.z0)
    np.testing.assert_allclose(x, solution.y.T, rtol=0, atol=1e-8)  # 100 times the ODE's rtol


@each_system
def test_cost_integrated_along_the_optimal_trajectory_is_the_optimal_cost(row):
    d, time = design_of(row.system, row.controller), np.linspace(0, 20, 20001)
    x = d.optimal_trajectory(row.z0, time)
    u = -x @ d.K.T
    index = 0.5 * (np.einsum("ti,ij,tj->t", x, d.Q, x) + np.einsum("ti,ij,tj->t", u, d.R, u))
    # Simpson errs by (h pole)^4 = 2e-8 at the fastest pole; the slowest mode leaves exp(-40).
    J = scipy.integrate.simpson(index, x=time)
    assert pytest.approx(J, rel=1e-7) == d.optimal_cost(row.z0)


def test_optimal_trajectory_does_not_depend_on_the_grid():
    d = lqr(CHAIN_A, CHAIN_B, I2, 1.0)
    fine = d.optimal_trajectory([1, 0], np.arange(1001) * 0.01)
    coarse = d.optimal_trajectory([1, 0], np.array([0.0, 10.0]))
    # A dozen products of 2 x 2 matrices round to some 1e-15.
    np.testing.assert_allclose(fine[-1], coarse[-1], rtol=1e-13)


def test_optimal_trajectory_refuses_instants_that_are_not_equally_spaced():
    d = lqr(CHAIN_A, CHAIN_B, I2, 1.0)
    for time in ([0.0, 0.1, 0.3], [0.1, 0.2, 0.3]):
        with pytest.raises(ArgumentError, match="equally spaced"):
            d.optimal_trajectory([1, 0], np.array(time))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((CHAIN_A, [0.0, 1.0], I2, 1.0), r"B has shape \(1, 2\), must be \(2, 2\)"),
        (([[0.0, 1.0]], CHAIN_B, I2, 1.0), r"A has shape \(1, 2\)"),
        ((CHAIN_A, CHAIN_B, np.eye(3), 1.0), r"Q has shape \(3, 3\), must be \(2, 2\)"),
        ((CHAIN_A, CHAIN_B, I2, I2), r"R has shape \(2, 2\), must be \(1, 1\)"),
        (
            (CHAIN_A, CHAIN_B, np.diag([1.0, np.nan]), 1.0),
            r"Q = .*nan.* must be a matrix",
        ),
        (
            ([[0.0, np.inf], [0.0, 0.0]], CHAIN_B, I2, 1.0),
            r"A = .*inf.* must be a matrix",
        ),
        ((CHAIN_A, CHAIN_B, "Q", 1.0), r"Q = 'Q' must be a matrix of finite numbers"),
        ((CHAIN_A, CHAIN_B, np.diag([1.0, -2.0]), 1.0), r"Q must be positive semi.*-2\.0"),
        ((CHAIN_A, CHAIN_B, I2, 0.0), r"R must be positive definite, is \[\[0\.0\]\]"),
        ((CHAIN_A, CHAIN_B, I2, -3.0), r"R must be positive definite, is \[\[-3\.0\]\]"),
        ((CHAIN_A, CHAIN_B, [[1.0, 100.0], [0.0, 1.0]], 1.0), "symmetric"),
    ],
)
def test_bad_designs_are_refused_with_the_value(arguments, message):
    with pytest.raises(GainError, match=message):
        lqr(*arguments)


@pytest.mark.parametrize("A", [np.diag([1.0, -1.0]), np.diag([0.0, -1.0])])
def test_pair_that_cannot_be_stabilized_is_refused(A):
    with pytest.raises(GainError, match="stabilizing"):
        lqr(A, [[0.0], [1.0]], I2, 1.0)


def test_message_about_an_uncontrollable_pair_says_which():
    with pytest.raises(GainError, match=r"\[\[0(\.0)?\], \[1(\.0)?\]\]"):
        lqr(np.diag([1.0, -1.0]), [[0.0], [1.0]], I2, 1.0)


def test_stable_uncontrollable_mode_is_accepted():
    d = lqr(np.diag([-1.0, 0.0]), [[0.0], [1.0]], I2, 1.0)
    np.testing.assert_allclose(sorted(d.poles.real), [-1, -1], atol=1e-12)


@pytest.mark.parametrize("Q", [np.zeros((2, 2)), np.diag([0.0, 1.0])])
def test_weights_that_do_not_see_an_integrator_are_refused(Q):
    """(A, Q) must be detectable, or the solution of eq. (6) does not stabilize."""
    with pytest.raises(GainError):
        lqr(CHAIN_A, CHAIN_B, Q, 1.0)


@pytest.mark.parametrize("B", [CHAIN_B, np.array([[0.0], [-11.56]]), np.eye(2)])
def test_default_surface_matrix_is_the_pseudoinverse_so_that_GB_is_the_identity(B):
    G = surface_matrix(None, B)
    np.testing.assert_allclose(G, np.linalg.solve(B.T @ B, B.T), rtol=0, atol=1e-12)
    np.testing.assert_allclose(G @ B, np.eye(B.shape[1]), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("G", "message"),
    [
        ([[1.0, 0.0]], r"G B = \[\[0\.0\]\] is singular"),
        ([1.0, 0.0], r"G B = \[\[0\.0\]\] is singular"),
        ([[1.0, 2.0, 3.0]], r"G = .* must be 1 x 2 finite numbers"),
    ],
)
def test_surface_that_the_input_cannot_steer_is_refused(G, message):
    with pytest.raises(GainError, match=message):
        surface_matrix(G, CHAIN_B)
    plant = MujocoPlant.load("arm").analytic()
    with pytest.raises(GainError, match=message):
        tracking_grosmc(Task(plant, ARM_ERROR, ARM_REFERENCE, *ARM_WEIGHTS), 18.0, 6.0, G)


@pytest.mark.parametrize(("k", "epsilon"), [(0.0, 6.0), (18.0, -6.0), (np.nan, 6.0)])
def test_tracking_gains_must_be_positive(k, epsilon):
    plant = MujocoPlant.load("arm").analytic()
    wrong = f"epsilon = {epsilon:g}" if epsilon < 0 else f"k = {k:g}"
    with pytest.raises(ArgumentError, match=f"{wrong} must be finite and positive"):
        tracking_grosmc(Task(plant, ARM_ERROR, ARM_REFERENCE, *ARM_WEIGHTS), k, epsilon)
