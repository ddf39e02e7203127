"""Switching gains from a declared family: the reaching condition, and that it is not vacuous."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from mjcf import ONE
from scipy.linalg import solve_continuous_are
from shipped import error_of, nominal, robust, task_of, uncertainty_of, weights_of

import grosmc_mj as gm
from grosmc_mj.experiments.assumptions.balance import Loads, balance
from grosmc_mj.experiments.requirements.optimum import compare_with_optimum
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.theory.control.controller import Controller, gain_keys, named_gains
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.design import (
    linear_grosmc,
    linear_lqr,
    regulating_grosmc,
    state_grosmc,
)
from grosmc_mj.theory.control.memory import SurfaceMemory
from grosmc_mj.theory.control.references import Setpoint, Setpoints, setpoint, setpoints
from grosmc_mj.theory.control.task import Task, state_task
from grosmc_mj.theory.control.uncertainty.family import PlantFamily, SwitchingGains
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty
from grosmc_mj.theory.plants import ARM, SERVO, AnalyticPlant, equilibrium

# gamma1 is a supremum over a grid of directions of z that are at most pi/40 from any other, so
# it is short of the true one by at most 1 - cos(pi/40) of itself.
GRID = 1 - math.cos(math.pi / 40)
HELD = 0.3  # rad, of the arm


def pendulum_errors() -> Array:
    """Error states of the declared region: its middle and edges, and random states."""
    corners = list(itertools.product((-1.0, 0.0, 1.0), repeat=2))
    random = np.random.default_rng(0).uniform(-1, 1, (111, 2))
    return np.array(uncertainty_of("cart_pendulum").region) * np.vstack([corners, random])


def worst_rate_of_s(ctl: Controller) -> float:
    """Largest s' sgn s of the pendulum under a law, over the declared family."""
    declared = uncertainty_of("cart_pendulum")
    random = np.random.default_rng(1)
    low, high = np.array(list(declared.scales.values())).T
    p = ctl.parameters

    worst = -math.inf
    off_surface = np.linalg.pinv(p.G)[:, 0]
    for z, side, sign in itertools.product(pendulum_errors(), (-1.0, 1.0), (-1, 1)):
        lowest = random.uniform(size=len(low)) < 0.5
        scales = np.where(lowest, low, high).tolist()
        plant = nominal("cart_pendulum").changed(
            scales=dict(zip(declared.scales, scales, strict=True))
        )
        x = np.zeros(4)
        x[[1, 3]] = z
        memory = SurfaceMemory(z0=z - side * off_surface, t=1.0, begun=1.0)
        u = ctl.input_at(1.0, x, memory)
        assert np.sign(memory.s).tolist() == [side]

        w = sign * np.array(declared.wrench)
        dz = plant.derivative(x, u, w)[[1, 3]]
        rate = (p.G @ dz - p.S @ z).item()
        worst = max(worst, rate * side)
    return worst


def test_reaching_condition_holds_for_the_pendulum_s_declared_family() -> None:
    """s' s <= -eta |s|, eqs. (14) and (39), with the declared eta."""
    assert (
        worst_rate_of_s(robust("cart_pendulum")) <= -uncertainty_of("cart_pendulum").reaching_rate
    )


def test_reaching_condition_fails_with_half_of_gamma1() -> None:
    """The gains are not much larger than they must be."""
    ctl = robust("cart_pendulum")
    halved = replace(ctl.parameters, gamma1=0.5 * ctl.parameters.gamma1)
    worst = worst_rate_of_s(replace(ctl, parameters=halved))
    assert worst > -0.75 * uncertainty_of("cart_pendulum").reaching_rate


CERTAIN = {
    "servo": Uncertainty({}, (0.0,) * 6, (1.0, 1.0), 0.2),
    "cart_pendulum": Uncertainty({}, (0.0,) * 12, (np.pi / 6, 1.5), 0.2),
}


def gains_of(error: Any, declared: Uncertainty) -> SwitchingGains:
    law = robust(error.system.name)
    plant = AnalyticPlant(error.system, law.parameters.plant)
    of_error = replace(law, design=replace(law.designed, error=error))
    gains, _ = declared.gains(of_error, plant)
    return gains


def test_gains_of_the_servo_are_the_closed_forms() -> None:
    """By hand, with J = j Jn and T_d <= 1 N m, for x = [theta_d - theta, -theta'].

    x2' = -B/J x2 - Kt/J i + T_d/J, so alpha = -B/J x2, E = -Kt/J, and r = E*/E = 1/j.
    alpha*/E* = alpha/E = B/Kt x2, for J cancels. Divided by E*, the mismatch is

        (alpha* - alpha)/E* + (1 - 1/r) u_0 = (1 - j) (B/Kt x2 - K x)

    which is at most |1 - j| |K - [0, B/Kt]| |x|, worst at j = 3. The load is T_d/J over Kt/J.
    """
    p: Any = nominal("servo").parameters
    gains = robust("servo").parameters
    K1, K2 = gains.K[0]
    gamma1 = 2 * math.hypot(K1, K2 - p.B / p.Kt)
    assert gains.gamma0 == pytest.approx(1.0 / p.Kt, rel=1e-12)
    assert (1 - GRID) * gamma1 <= gains.gamma1 <= gamma1 * (1 + 1e-12)
    assert gains.eta == pytest.approx(3 * uncertainty_of("servo").reaching_rate, rel=1e-12)


@pytest.mark.parametrize(
    "error", [error_of("servo"), error_of("cart_pendulum")], ids=lambda e: e.system.name
)
def test_gains_without_uncertainty_are_the_reaching_rate(error: Any) -> None:
    """The linear law's A and B are a Jacobian by finite differences."""
    gains = gains_of(error, CERTAIN[error.system.name])
    assert gains == pytest.approx((0.2, 0.0, 0.0, 1.0), rel=0, abs=1e-10)


def test_gains_of_the_pendulum_are_those_of_the_lagrangian() -> None:
    """E = a cos / (L (4/3 - a m cos^2)), a = 1/(M+m); least with 4m, 4L at the region's edge.

    |d/E*| = torque (M+m)/(m L cos), for the inertia of eq. (40) cancels; the declared torque is
    I d with I = m L^2 (4/3 - m/(M+m)), the inertia of the upright pole on its free cart. A force,
    or a torque about another axis, would ask for another gain.
    """
    p: Any = nominal("cart_pendulum").parameters
    gains = robust("cart_pendulum").parameters
    edge = uncertainty_of("cart_pendulum").region[0]

    def E(m: float, L: float, theta: float) -> float:
        c = math.cos(theta)
        reduced = 4 / 3 - m / (p.M + m) * c * c
        return c / (p.M + m) / (L * reduced)

    ratio = E(4 * p.m, 4 * p.L, edge) / E(p.m, p.L, edge)
    assert gains.eta == pytest.approx(
        uncertainty_of("cart_pendulum").reaching_rate / ratio, rel=1e-12
    )
    inertia = p.m * p.L**2 * (4 / 3 - p.m / (p.M + p.m))
    torque = 0.01 * inertia
    expected = torque * (p.M + p.m) / (p.m * p.L * math.cos(edge))
    assert gains.gamma0 == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("lightest", "force"), [(0.5, 0.0), (1.0, 0.7)])
def test_gamma0_covers_a_torque_on_the_lightest_pole_and_a_force_against_it(
    lightest: float, force: float
) -> None:
    """A force on the cart turns the pole back, a torque of its own turns it on: |a| + |b|.

    The force counts as the input's own, the torque most at the edge of the region.
    """
    p: Any = nominal("cart_pendulum").parameters
    wrench = (force, *(0.0,) * 9, 0.3, 0.0)
    declared = Uncertainty({"m": (lightest, 1.0)}, wrench, region=(0.5, 1.0), reaching_rate=0.2)
    m = lightest * p.m
    expected = force + 0.3 * (p.M + m) / (m * p.L * math.cos(0.5))
    gamma0 = gains_of(error_of("cart_pendulum"), declared).gamma0
    assert gamma0 == pytest.approx(expected, rel=1e-12)


def test_mismatch_that_is_there_at_rest_is_covered_by_a_constant() -> None:
    """An arm held at 0.3 rad with up to twice its payload: m g l cos q is not all cancelled.

    By hand, at z = 0: alpha* - E*/E alpha = -(G* - G)/M*, where G* - G is the torque
    (m* - m) g l cos q. It is divided by the true E* = 1/M*(q) wherever the arm may be: most at
    the highest q of the region.
    """
    p: Any = nominal("arm").parameters

    def inertia(q: float) -> float:
        return p.J + 2 * p.m * p.l**2 + p.M_c * (1 + math.sin(q))

    missing = p.m * p.g * p.l * math.cos(HELD)
    expected = missing * inertia(HELD + 0.5) / inertia(HELD)

    error = ErrorCoordinates(ARM, setpoint)
    task = Task(nominal("arm"), error, Setpoint(HELD), *weights_of("arm"))
    declared = Uncertainty({"m": (1.0, 2.0)}, (0.0,) * 12, region=(0.5, 1.0), reaching_rate=0.2)
    law = regulating_grosmc(task, declared)
    assert law.parameters.gamma0 == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("scale", [2.0, 1 / 0.667], ids=["reverses", "loses"])
def test_family_that_reverses_or_loses_the_input_is_refused(scale: float) -> None:
    """The input of this servo acts backwards beyond half of its torque constant more."""
    J, Kt = sp.symbols("J Kt")
    equations = replace(SERVO.symbolic_equations, g=(0, (1 - Kt) / J))
    reversing = replace(SERVO, equations=equations)
    error = ErrorCoordinates(reversing, error_of("servo").reference, -1)
    declared = replace(CERTAIN["servo"], scales={"Kt": (1.0, scale)})
    message = r"servo: the input gain of a declared plant, Kt x[0-9.]+, is .* at z ="
    with pytest.raises(GainError, match=message):
        gains_of(error, declared)


def test_a_family_of_outputs_is_told_in_words_with_its_least_input_gain() -> None:
    """The inertia of the servo is up to three times as large, so its input gain down to a third."""
    family = replace(uncertainty_of("servo"), region=(1.5, 2.5), reaching_rate=0.25)
    assert linear_grosmc(task_of("servo"), family).designed.declared == (
        "J x1 to x3; wrench up to 1 N or N m; |z1| <= 1.5, |z2| <= 2.5; reaching rate 0.25; "
        "input gain down to 0.333 of the nominal one"
    )


def test_a_family_of_states_is_told_in_words_with_its_slowest_pole() -> None:
    """A mass acts where the input does, so each member slides as the nominal loop."""
    law = state_grosmc(hung_at(0.8), StateUncertainty(scales={"m": (1.0, 1.5)}, force=0.3))
    lqr = law.designed.lqr
    slowest = np.linalg.eigvals(lqr.A - lqr.B @ lqr.K).real.max()
    assert law.designed.declared == (
        "m x1 to x1.5, disturbances of the input up to 0.3 N m; input gain down to 0.667 of the "
        "nominal one; 0.0% of what the family changes is out of the input's reach, "
        f"slowest sliding pole {slowest:.3g} 1/s"
    )


# Several inputs


def test_gains_hold_for_a_term_along_s_as_well_as_for_one_in_each_entry() -> None:
    """By hand, R = [[1.45, 0.45], [0.025, 1]] at k = 1.05: 0.975 by rows, 0.898 along s."""
    k = sp.Symbol("k")
    mixer = gm.affine_plant(
        "mixer",
        states={"a": "m", "b": "m"},
        inputs={"u": "m/s", "v": "m/s"},
        f=[0, 0],
        g=[
            [9 * k - 8, 9 * (k - 1)],
            [(k - 1) / 2, 1],
        ],
        h=sp.symbols("a b"),
        parameters={"k": 1.0},
    )
    error = ErrorCoordinates(mixer.system, setpoints(1, 1))
    task = Task(mixer, error, Setpoints(0.0, 0.0), np.eye(2), np.eye(2))
    wrench = (0.0,) * len(mixer.system.symbolic_equations.w)
    declared = Uncertainty({"k": (1.0, 1.05)}, wrench, region=(1.0, 1.0), reaching_rate=0.2)
    ctl = regulating_grosmc(task, declared)
    along = 1.225 - math.hypot(0.225, 0.2375)
    assert ctl.parameters.eta == pytest.approx(0.2 / along, rel=1e-9)


# Section 2's laws on the linearization of any plant


def hung_at(angle: float) -> Task:
    """A damped pendulum with a torque, which holds it anywhere."""
    a, w, m, c, g = sp.symbols("angle rate m c g")
    plant = gm.affine_plant(
        "hanging",
        states={"angle": "rad", "rate": "rad/s"},
        inputs={"torque": "N m"},
        f=[w, (-g * m * sp.sin(a) - c * w) / m],
        g=[0, 1 / m],
        h=[a],
        parameters={"m": 2.0, "c": 0.5, "g": 9.81},
    )
    point = equilibrium(plant, {0: angle})
    return state_task(plant, np.diag([10.0, 1.0]), 1.0, point)


def linear(plant: Any, **scales: float) -> tuple[Array, Array]:
    return plant.changed(scales=scales).linearization()


each_law = pytest.mark.parametrize("make", [linear_lqr, state_grosmc])


@each_law
def test_a_held_plant_stays_where_it_rests(make: Any) -> None:
    """The input that holds it is in the law, and costs nothing."""
    task = hung_at(0.8)
    rest = task.reference
    run = gm.simulate(task.plant, make(task), rest.x, duration=0.1, engine="python")
    np.testing.assert_allclose(run.state - rest.x, 0, atol=1e-12)
    np.testing.assert_allclose(run.input, 9.81 * 2 * np.sin(0.8), rtol=1e-9)
    assert np.abs(run.memory["v"]).max() < 1e-12


def test_the_motion_about_an_operating_point_is_the_plant_s_own_at_any_input() -> None:
    """z' = drift + gain (u - u_e), whose drift is that of the input that holds it."""
    task = hung_at(0.8)
    rest = task.reference
    p = linear_lqr(task).parameters
    x = rest.x + np.array([0.1, -0.2])
    u = rest.u + 3.0
    error: Any = task.error
    (drift,), (gain,) = error.error_dynamics([0.0], x[None], p, task.plant, u=u[None])
    np.testing.assert_allclose(drift + gain @ [3.0], task.plant.derivative(x, u), rtol=1e-9)


def test_the_optimum_of_a_held_plant_starts_where_the_run_does() -> None:
    task = hung_at(0.8)
    law = state_grosmc(task)
    start = task.reference.x + np.array([0.05, 0.1])
    run = gm.simulate(task.plant, law, start, duration=0.02, engine="python")
    compared = compare_with_optimum(run, law)
    np.testing.assert_allclose(compared.optimum[0], start[[0]], rtol=1e-12)
    np.testing.assert_allclose(compared.reference[0], [0.8], rtol=1e-12)


def test_gains_on_all_states_are_those_of_the_worst_member() -> None:
    """By hand: B = [0, 1/m], so G = [0, m], r = 1/1.5 and |G dA| = |c - c'| of the rate."""
    task = hung_at(0.0)
    declared = StateUncertainty(scales={"m": (1.0, 1.5)}, force=0.3, reaching_rate=0.2)
    p = state_grosmc(task, declared).parameters
    np.testing.assert_allclose(p.G, [[0.0, 2.0]], atol=1e-12)
    assert (p.eta, p.gamma0) == pytest.approx((0.2 * 1.5, 0.3))

    A, B = linear(task.plant, m=1.0)
    A_t, B_t = linear(task.plant, m=1.5)
    difference = A_t - B_t @ p.K - A + B @ p.K
    expected = np.linalg.norm(p.G @ difference) * 1.5
    assert p.gamma1 == pytest.approx(expected)


@pytest.mark.parametrize(
    ("declared", "count"),
    [
        (CERTAIN["cart_pendulum"], 1),
        (uncertainty_of("cart_pendulum"), 5 * 5),
        (StateUncertainty(), 1),
        (StateUncertainty(mass=2.0), 3),
        (StateUncertainty(length=2.0, scales={"M": (0.5, 1.0), "g": (1.0, 1.1)}), 3 * 3 * 3),
    ],
)
def test_members_of_a_family_are_a_grid_with_both_ends_of_each_range(
    declared: PlantFamily, count: int
) -> None:
    plant = nominal("cart_pendulum")
    members = dict(declared.members(plant))
    assert len(members) == count

    for name, (low, high) in declared.scales.items():
        values = [getattr(member.parameters, name) for member in members.values()]
        value = getattr(plant.parameters, name)
        assert (min(values), max(values)) == (low * value, high * value)


def test_states_are_held_on_the_ends_and_the_geometric_mean_of_a_range() -> None:
    declared = StateUncertainty(scales={"M": (0.25, 1.0)})
    members = dict(declared.members(nominal("cart_pendulum"))).values()
    assert [member.parameters.M for member in members] == pytest.approx([0.25, 0.5, 1.0])


@pytest.mark.parametrize("angle", [0.8, -0.8])
@pytest.mark.parametrize(
    ("scales", "gamma0", "gamma1"),
    [
        # m g/2 sin is missing at rest, and m g/2 cos for each rad beside it.
        ({"g": (1.0, 1.5)}, np.sin(0.8) / 2, np.cos(0.8) / 2),
        # x'' = -g sin + u_e/m' = -g sin (1 - m/m'), seen through G = m and r = m/m'.
        ({"m": (1.0, 1.5)}, np.sin(0.8) * (1 - 1 / 1.5) * 1.5, None),
    ],
)
def test_what_the_nominal_input_does_not_hold_needs_a_constant(
    scales: Any, gamma0: float, gamma1: float | None, angle: float
) -> None:
    """Besides a disturbance of the input, in the worst direction."""
    declared = StateUncertainty(scales=scales, force=0.3)
    p = state_grosmc(hung_at(angle), declared).parameters
    assert p.gamma0 == pytest.approx(2.0 * 9.81 * gamma0 + 0.3)
    assert gamma1 is None or p.gamma1 == pytest.approx(2.0 * 9.81 * gamma1)


@each_law
def test_a_law_of_a_held_plant_is_designed_for_the_linearization_there(make: Any) -> None:
    """By hand: gravity turns the pendulum back by g cos, not by the g of the lower position."""
    design = make(hung_at(0.8)).designed.lqr
    A = np.array([[0.0, 1.0], [-9.81 * np.cos(0.8), -0.25]])
    B = np.array([[0.0], [0.5]])
    np.testing.assert_allclose(design.A, A, rtol=1e-6)
    np.testing.assert_allclose(design.B, B, rtol=1e-12)

    P = solve_continuous_are(A, B, np.diag([10.0, 1.0]), np.eye(1))
    np.testing.assert_allclose(design.K, B.T @ P, rtol=1e-6)


@pytest.mark.parametrize("limit", [math.inf, 0.4])
def test_the_reaching_condition_of_a_held_plant_is_about_the_point_where_it_rests(
    limit: float,
) -> None:
    """s' = G (x' - A z - B u_c) with z = x - x_e and u = u_e + u_c, which a limit cuts."""
    task = hung_at(0.8)
    law = state_grosmc(task, limit=limit)
    optimum = law.designed.lqr
    true = task.plant.changed(scales={"g": 1.5})
    z = np.array([-0.5, 1.0])
    at = balance(law, true, 0.0, task.reference.x + z, Loads.none(true.system, 1))
    assert at.u_c == pytest.approx(np.clip(-law.parameters.K @ z, -limit, limit), rel=1e-9)
    dx = true.derivative(task.reference.x + z, task.reference.u + at.u_c)
    nominal_rate = optimum.A @ z + optimum.B @ at.u_c
    assert at.pushes == pytest.approx(law.parameters.G @ (dx - nominal_rate), rel=1e-9)


@pytest.mark.parametrize(
    "declared",
    [StateUncertainty(body="cart", push=0.7), StateUncertainty(body="cart", push=0.3, force=0.4)],
)
def test_a_force_on_the_cart_counts_as_the_input_s_own(declared: StateUncertainty) -> None:
    task = state_task(nominal("cart_pendulum"), np.eye(4), 1.0)
    assert state_grosmc(task, declared).parameters.gamma0 == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("G", "unit"),
    [
        (None, "N m s"),
        ([[0.0, 3.0]], "1"),
    ],
)
def test_s_has_a_unit_where_G_B_is_one(G: Any, unit: str) -> None:
    """That of the input times time; of another G it has none of its own."""
    assert state_grosmc(hung_at(0.0), G=G).designed.sliding_unit == unit


def test_a_limit_of_the_nominal_input_is_the_room_that_is_left_where_the_plant_rests() -> None:
    """0.9 of it, to the nearer end of -5 N m to 8 N m."""
    drive = '<motor name="drive" joint="hinge" ctrlrange="-5 8"/>'
    plant = Robot.from_mjcf(ONE.format("", drive)).plant
    point = equilibrium(plant, {0: 0.4})
    (held,) = point.u.tolist()
    assert held < -0.5
    law = state_grosmc(state_task(plant, np.eye(2), 1.0, point))
    assert law.parameters.limit == pytest.approx(0.9 * (held + 5))


def two_carts() -> AnalyticPlant:
    """Two carts with a spring between them, and two inputs that reach both."""
    p1, p2, v1, v2, k = sp.symbols("p1 p2 v1 v2 k")
    return gm.affine_plant(
        "carts",
        states={"p1": "m", "p2": "m", "v1": "m/s", "v2": "m/s"},
        inputs={"u1": "N", "u2": "N"},
        f=[v1, v2, k * (p2 - p1), k * (p1 - p2)],
        g=[
            [0, 0],
            [0, 0],
            [1, 0.2],
            [0.1, 1],
        ],
        h=[p1, p2],
        parameters={"k": 3.0},
    )


def test_forces_on_two_inputs_may_have_the_worst_signs_for_each_surface() -> None:
    """Of both signs of both forces, each s_i is pushed the most by some."""
    carts = two_carts()
    law = state_grosmc(state_task(carts, np.eye(4), np.eye(2)), G=[[0, 0, 2, -3], [0, 0, 1, 4.0]])
    declared = StateUncertainty(force=0.7)
    by_model = declared.law_at_states(law)
    _, disturbed = declared.reaching(law, by_model, carts)
    B = np.array([[1, 0.2], [0.1, 1]])
    signs = np.array(list(itertools.product((-0.7, 0.7), repeat=2)))
    largest = np.abs(signs @ (np.array([[2, -3], [1, 4.0]]) @ B).T).max(axis=0)
    assert disturbed == pytest.approx(np.tile(largest, (5, 1)))


def test_gains_of_two_inputs_take_the_least_of_the_symmetric_part() -> None:
    carts = two_carts()
    declared = StateUncertainty(scales={"k": (0.5, 2.0)})
    p = state_grosmc(state_task(carts, np.eye(4), 1.0), declared).parameters

    A, _ = linear(carts, k=1.0)
    differences = [linear(carts, k=scale)[0] - A for scale in (0.5, 2.0)]
    worst = max(np.linalg.norm(p.G @ difference) for difference in differences)
    assert p.gamma1 == pytest.approx(worst / np.sqrt(2))


def test_both_engines_run_a_law_of_two_inputs_alike() -> None:
    carts = two_carts()
    law = state_grosmc(state_task(carts, np.eye(4), 1.0))
    start = [0.2] * 4
    native = gm.simulate(carts, law, start, duration=0.1, engine="native")
    python = gm.simulate(carts, law, start, duration=0.1, engine="python")
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.memory["v"], python.memory["v"])


@pytest.mark.parametrize(("rows", "columns"), [(1, 30), (2, 24), (7, 14), (10, 20), (12, 24)])
def test_each_entry_of_a_gain_has_a_name_of_its_own(rows: int, columns: int) -> None:
    keys = gain_keys("K", rows, columns)
    assert len(set(keys.values())) == rows * columns


def test_a_gain_is_told_row_by_row() -> None:
    K = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    gains = {"K11": 1, "K12": 2, "K13": 3, "K21": 4, "K22": 5, "K23": 6}
    assert named_gains(K=K) == gains
    assert named_gains(K=K[:1]) == {"K1": 1, "K2": 2, "K3": 3}
