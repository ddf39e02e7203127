"""Switching gains from a declared family: the reaching condition, and that it is not vacuous."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from shipped import (
    ARM_WEIGHTS,
    PENDULUM_ERROR,
    PENDULUM_UNCERTAINTY,
    SERVO_ERROR,
    SERVO_UNCERTAINTY,
    task_of,
)

import grosmc_mj as gm
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import (
    linear_grosmc,
    linear_lqr,
    realized,
    regulating_grosmc,
    state_grosmc,
)
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.control.references import Setpoint, Setpoints, setpoint, setpoints
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization, Task, state_task
from grosmc_mj.control.uncertainty import StateUncertainty, SwitchingGains, Uncertainty
from grosmc_mj.errors import GainError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ARM, SERVO, AnalyticPlant, equilibrium

# gamma1 is a supremum over a grid of directions of z that are at most pi/40 from any other, so
# it is short of the true one by at most 1 - cos(pi/40) of itself.
GRID = 1 - math.cos(math.pi / 40)
HELD = 0.3  # rad, of the arm


@dataclass(frozen=True)
class Point:
    """A plant of the family, an error state, a disturbance at its bound and a side of s."""

    plant: AnalyticPlant
    z: Array
    wrench: Array
    side: float


@cache
def nominal(system: str) -> AnalyticPlant:
    return MujocoPlant.load(system).analytic()


@cache
def robust(system: str) -> Controller:
    return chapter_controller("grosmc", nominal(system))


def points(plant: AnalyticPlant, declared: Uncertainty, count: int) -> Iterator[Point]:
    """Every corner of the family and the region, z near 0, and random points between."""
    low, high = np.reshape(list(declared.scales.values()), (-1, 2)).T
    region, rng, wrench = np.array(declared.region), np.random.default_rng(0), declared.wrench
    pairs = [
        (np.array(scale), np.maximum(1e-6, region) * sign)
        for scale in itertools.product(*zip(low, high, strict=True))
        for sign in itertools.product((-1, 0, 1), repeat=2)
    ]
    pairs += [
        (rng.uniform(low, high), rng.uniform(-1, 1, 2) * region * rng.uniform())
        for _ in range(count)
    ]
    for scale, z in pairs:
        true = plant.changed(scales=dict(zip(declared.scales, scale.tolist(), strict=True)))
        for sign, side in itertools.product((-1.0, 1.0), repeat=2):
            yield Point(true, z, sign * np.array(wrench), side)


def shortfall(ctl: Controller, at: Point, rate: float) -> float:
    """How far s' sgn(s) exceeds -rate at a point, with s' from the true plant's equations."""
    p, error = ctl.parameters, ctl.coordinates
    position = error.system.output
    velocity = position + error.system.degrees_of_freedom
    x = np.zeros(len(error.system.states))
    x[position] = error.reference(0.0, p.reference)[0] + error.sign * at.z[0]
    x[velocity] = error.sign * at.z[1]
    memory = SurfaceMemory(z0=at.z - at.side * p.G[0] / (p.G[0] @ p.G[0]), t=1.0)
    u = ctl.input_at(1.0, x, memory)
    assert np.sign(memory.s).tolist() == [at.side]
    dx = at.plant.derivative(x, u, at.wrench)
    dz = error.sign * np.array([dx[position], dx[velocity]])
    return float((p.G @ dz - p.S @ at.z).item() * at.side + rate)


DOUBLED = Uncertainty({"m": (1.0, 2.0)}, (0.0,) * 12, (0.5, 1.0), 0.2)
CERTAIN = {
    "servo": Uncertainty({}, (0.0,) * 6, (1.0, 1.0), 0.2),
    "cart_pendulum": Uncertainty({}, (0.0,) * 12, (np.pi / 6, 1.5), 0.2),
}


@cache
def declared_law(name: str) -> tuple[Controller, Uncertainty]:
    """The chapter's laws, an arm that is held, and laws of the linearization."""
    system, _, kind = name.partition(" ")
    plant = nominal(system)
    if kind == "held":
        task = Task(plant, ErrorCoordinates(ARM, setpoint), Setpoint(HELD), *ARM_WEIGHTS)
        return regulating_grosmc(task, DOUBLED), DOUBLED
    if kind == "linear":
        return linear_grosmc(task_of(system), CERTAIN[system]), CERTAIN[system]
    return robust(system), SERVO_UNCERTAINTY if system == "servo" else PENDULUM_UNCERTAINTY


@pytest.mark.parametrize(
    "name", ["servo", "cart_pendulum", "arm held", "servo linear", "cart_pendulum linear"]
)
def test_reaching_condition_holds_for_the_whole_declared_family(name: str) -> None:
    """s' s <= -eta |s|, eqs. (14) and (39), with the eta that was declared."""
    ctl, declared = declared_law(name)
    p, error = ctl.parameters, ctl.coordinates
    for at in points(nominal(name.split()[0]), declared, 150):
        short = shortfall(ctl, at, declared.reaching_rate)
        # What gamma1 contributes to |s'|, at most, and so what the grid can miss.
        x = error.place(0.0, at.z, p)
        E = error.dynamics(0.0, x, replace(p, plant=at.plant.parameters))[1].item()
        missed = GRID * abs(p.G[0, 1] * E) * p.gamma1 * np.hypot(*at.z)
        assert short <= missed + 1e-9, f"short by {short:g} at {at}"
        if name == "servo linear":
            # Linear and certain, it holds with equality; s' is a difference of terms of order 10.
            assert short == pytest.approx(0, abs=1e-13)


@pytest.mark.parametrize(
    ("name", "gain", "share"),
    # The pendulum's gamma0 is 0.008 N for d = 0.01 rad/s^2: smaller than the slack of its eta.
    [
        ("servo", "gamma1", 0.5),
        ("servo", "gamma0", 0.5),
        ("servo", "eta", 0.5),
        ("cart_pendulum", "gamma1", 0.5),
        ("cart_pendulum", "eta", 0.5),
        ("arm held", "gamma0", 0.0),
    ],
)
def test_no_gain_is_vacuous(name: str, gain: str, share: float) -> None:
    """With less of it some plant of the family breaks the reaching condition by far."""
    ctl, declared = declared_law(name)
    p = replace(ctl.parameters, **{gain: share * getattr(ctl.parameters, gain)})
    family = points(nominal(name.split()[0]), declared, 20)
    worst = max(shortfall(replace(ctl, parameters=p), at, declared.reaching_rate) for at in family)
    assert worst > (0.25 if share else 1.0) * declared.reaching_rate


def test_gains_of_the_servo_are_the_closed_forms() -> None:
    """By hand, with J = j Jn and T_d <= 1 N m, for x = [theta_d - theta, -theta'].

    x2' = -B/J x2 - Kt/J i + T_d/J, so alpha = -B/J x2, E = -Kt/J, and r = E*/E = 1/j.
    alpha*/E* = alpha/E = B/Kt x2, for J cancels. Divided by E*, the mismatch is

        (alpha* - alpha)/E* + (1 - 1/r) u_0 = (1 - j) (B/Kt x2 - K x)

    which is at most |1 - j| |K - [0, B/Kt]| |x|, worst at j = 3. The load is T_d/J over Kt/J.
    """
    p: Any = nominal("servo").parameters
    gains = robust("servo").parameters
    gamma1 = 2 * math.hypot(gains.K[0, 0], gains.K[0, 1] - p.B / p.Kt)
    assert gains.gamma0 == pytest.approx(1.0 / p.Kt, rel=1e-12)
    assert (1 - GRID) * gamma1 <= gains.gamma1 <= gamma1 * (1 + 1e-12)
    assert gains.eta == pytest.approx(3 * SERVO_UNCERTAINTY.reaching_rate, rel=1e-12)


def gains_of(error: Any, declared: Uncertainty) -> SwitchingGains:
    law = robust(error.system.name)
    return declared.gains(replace(law.designed, error=error), law.parameters)[0]


def test_gains_of_the_pendulum_are_those_of_the_lagrangian() -> None:
    """E = a cos / (L (4/3 - a m cos^2)), a = 1/(M+m); least with 4m, 4L at the region's edge.

    |d/E*| = torque (M+m)/(m L cos), for the inertia of eq. (40) cancels; the declared torque is
    I d with I = m L^2 (4/3 - m/(M+m)), the inertia of the upright pole on its free cart. A force,
    or a torque about another axis, would ask for another gain.
    """
    p: Any = nominal("cart_pendulum").parameters
    gains, edge = robust("cart_pendulum").parameters, PENDULUM_UNCERTAINTY.region[0]

    def E(m: float, L: float, theta: float) -> float:
        c = math.cos(theta)
        return c / (p.M + m) / (L * (4 / 3 - m / (p.M + m) * c * c))

    ratio = E(4 * p.m, 4 * p.L, edge) / E(p.m, p.L, edge)
    assert gains.eta == pytest.approx(PENDULUM_UNCERTAINTY.reaching_rate / ratio, rel=1e-12)
    # Calculated independently: about 0.22 upright.
    assert E(4 * p.m, 4 * p.L, 0) / E(p.m, p.L, 0) == pytest.approx(0.22, abs=0.005)
    torque = 0.01 * p.m * p.L**2 * (4 / 3 - p.m / (p.M + p.m))
    expected = torque * (p.M + p.m) / (p.m * p.L * math.cos(edge))
    assert gains.gamma0 == pytest.approx(expected, rel=1e-9)
    # Most is asked for by the lightest pole at the edge of the region.
    declared = Uncertainty({"m": (0.5, 1.0)}, (0.0,) * 10 + (0.3, 0.0), (0.5, 1.0), 0.2)
    expected = 0.3 * (p.M + p.m / 2) / (p.m / 2 * p.L * math.cos(0.5))
    assert gains_of(PENDULUM_ERROR, declared).gamma0 == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("error", [SERVO_ERROR, PENDULUM_ERROR])
def test_certain_undisturbed_plant_needs_eta_only(error: Any) -> None:
    # The linear law's A and B are a Jacobian by finite differences.
    gains = gains_of(error, CERTAIN[error.system.name])
    assert gains == pytest.approx((0.2, 0.0, 0.0, 1.0), rel=0, abs=1e-10)


@pytest.mark.parametrize("scale", [2.0, 1 / 0.667])
def test_family_that_reverses_or_loses_the_input_is_refused(scale: float) -> None:
    """No gain helps where E*/E <= 0: the message says which ratio, where.

    The input of this servo acts backwards beyond half of its torque constant more.
    """
    J, Kt = sp.symbols("J Kt")
    reversing = replace(SERVO, equations=replace(SERVO.equations, g=(0, (1 - Kt) / J)))
    error = ErrorCoordinates(reversing, SERVO_ERROR.reference, -1)
    message = r"servo: the input gain of a declared plant, Kt x[0-9.]+, is .* at z ="
    with pytest.raises(GainError, match=message):
        gains_of(error, Uncertainty({"Kt": (1.0, scale)}, (0.0,) * 6, (1.0, 1.0), 0.2))


def test_mismatch_that_is_there_at_rest_is_covered_by_a_constant() -> None:
    """An arm held at 0.3 rad with up to twice its payload: m g l cos q is not all cancelled.

    By hand, at z = 0: alpha* - E*/E alpha = -(G* - G)/M*, where G* - G is the torque
    (m* - m) g l cos q. It is divided by the true E* = 1/M*(q) wherever the arm may be: most at
    the highest q of the region.
    """
    p: Any = nominal("arm").parameters
    M = [p.J + 2 * p.m * p.l**2 + p.M_c * (1 + math.sin(q)) for q in (HELD, HELD + 0.5)]
    expected = p.m * p.g * p.l * math.cos(HELD) * M[1] / M[0]
    assert declared_law("arm held")[0].parameters.gamma0 == pytest.approx(expected, rel=1e-9)


# Several inputs


@pytest.mark.parametrize("m", [1, 2, 3])
def test_gain_margin_is_what_the_worst_signs_leave(m: int) -> None:
    """min over rows and over all sides of (R sgn s)_i sgn s_i, by trying all of them."""
    R = np.random.default_rng(4).normal(size=(50, m, m)) + 2 * np.eye(m)
    sides = np.array(list(itertools.product((-1.0, 1.0), repeat=m)))
    worst = np.min(sides * np.einsum("tij,sj->tsi", R, sides), axis=(1, 2))
    np.testing.assert_allclose(gain_margin(R), worst, rtol=1e-12, atol=1e-12)


def test_gain_margin_along_s_is_the_least_share_that_points_back() -> None:
    """min over s of s' R s / |s|^2, over a fine circle of s; R need not be symmetric."""
    angle = np.linspace(0, np.pi, 10_001)
    s, R = np.array([np.cos(angle), np.sin(angle)]), np.random.default_rng(5).normal(size=(9, 2, 2))
    worst = np.einsum("it,kij,jt->kt", s, R, s).min(axis=1)
    np.testing.assert_allclose(gain_margin(R, together=True), worst, atol=1e-6)


def test_gains_hold_for_a_term_along_s_as_well_as_for_one_in_each_entry() -> None:
    """By hand, R = [[1.45, 0.45], [0.025, 1]] at k = 1.05: 0.975 by rows, 0.898 along s."""
    k = sp.Symbol("k")
    mixer = gm.affine_plant(
        "mixer", states={"a": "m", "b": "m"}, inputs={"u": "m/s", "v": "m/s"}, f=[0, 0],
        g=[[9 * k - 8, 9 * (k - 1)], [(k - 1) / 2, 1]], h=sp.symbols("a b"), parameters={"k": 1.0},
    )  # fmt: skip
    error = ErrorCoordinates(mixer.system, setpoints(1, 1))
    task = Task(mixer, error, Setpoints(0.0, 0.0), np.eye(2), np.eye(2))
    wrench = (0.0,) * len(mixer.system.equations.w)
    ctl = regulating_grosmc(task, Uncertainty({"k": (1.0, 1.05)}, wrench, (1.0, 1.0), 0.2))
    along = 1.225 - math.hypot(0.225, 0.2375)
    assert ctl.parameters.eta == pytest.approx(0.2 / along, rel=1e-9)


# Section 2's laws on the linearization of any plant


@cache
def hanging() -> AnalyticPlant:
    """A damped pendulum with a torque: at rest anywhere, under a torque."""
    a, w, m, c = sp.symbols("angle rate m c")
    return gm.affine_plant(
        "hanging", states={"angle": "rad", "rate": "rad/s"}, inputs={"torque": "N m"},
        f=[w, (-9.81 * m * sp.sin(a) - c * w) / m], g=[0, 1 / m], h=[a],
        parameters={"m": 2.0, "c": 0.5},
    )  # fmt: skip


@cache
def two_carts() -> AnalyticPlant:
    """Two inputs that reach both carts."""
    p1, p2, v1, v2, k = sp.symbols("p1 p2 v1 v2 k")
    return gm.affine_plant(
        "carts", states={"p1": "m", "p2": "m", "v1": "m/s", "v2": "m/s"},
        inputs={"u1": "N", "u2": "N"}, f=[v1, v2, k * (p2 - p1), k * (p1 - p2)],
        g=[[0, 0], [0, 0], [1, 0.2], [0.1, 1]], h=[p1, p2], parameters={"k": 3.0},
    )  # fmt: skip


def hung_at(angle: float) -> Task:
    plant = hanging()
    return state_task(plant, np.diag([10.0, 1.0]), 1.0, equilibrium(plant, {0: angle}))


@pytest.mark.parametrize("make", [linear_lqr, state_grosmc])
def test_it_stays_where_it_rests_and_its_optimum_starts_where_the_run_does(make: Any) -> None:
    """The input that holds it is in the law, and costs nothing."""
    task = hung_at(0.8)
    law, rest = make(task), task.reference
    run = gm.simulate(task.plant, law, rest.x, duration=0.5)
    np.testing.assert_allclose(run.state - rest.x, 0, atol=1e-12)
    np.testing.assert_allclose(run.input, rest.u[0], rtol=1e-12)
    assert np.abs(run.memory["v"]).max() < 1e-12
    assert rest.u[0] == pytest.approx(9.81 * 2 * np.sin(0.8))
    run = gm.simulate(task.plant, law, rest.x + np.array([0.05, 0.1]), duration=0.02)
    compared = compare_with_optimum(run, law)
    np.testing.assert_allclose(compared.optimum[0], run.state[0, [0]], rtol=1e-12)
    np.testing.assert_allclose(compared.reference[0], rest.x[[0]], rtol=1e-12)


def test_the_engines_agree_bit_for_bit_on_all_states() -> None:
    law = state_grosmc(state_task(two_carts(), np.eye(4), 1.0))
    native, python = (
        gm.simulate(two_carts(), law, [0.2] * 4, duration=0.1, engine=engine)
        for engine in ("native", "python")
    )
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.memory["v"], python.memory["v"])


def test_matched_uncertainty_leaves_the_nominal_optimum() -> None:
    """Damping is matched: what is left is what sampling leaves, |s| <= T |w|; LQR is far off."""
    task, away = hung_at(0.0), []
    declared = StateUncertainty(scales={"c": (1.0, 6.0)}, force=0.1, reaching_rate=0.5)
    robust_law = realized(
        state_grosmc(task, declared), Realization(find_switching("implicit"), 1e-3)
    )
    for law in (linear_lqr(task), robust_law):
        run = gm.simulate(task.plant.changed(scales={"c": 6.0}), law, [0.05, 0.0], duration=2.0)
        optimum = law.designed.lqr.optimal_trajectory(run.state[0], run.time)
        pushed = np.abs(2.5 * run.state[:, 1]).max()
        away.append(np.abs(run.state - optimum)[:, 0].max())
    assert away[1] < 1e-3 * pushed
    assert away[0] > 20 * away[1]


def test_the_gains_are_those_of_the_worst_member() -> None:
    """By hand: B = [0, 1/m], so G = [0, m], r = 1/1.5 and |G dA| = |c - c'| of the rate."""
    task = hung_at(0.0)
    declared = StateUncertainty(scales={"m": (1.0, 1.5)}, force=0.3, reaching_rate=0.2)
    p = state_grosmc(task, declared).parameters
    np.testing.assert_allclose(p.G, [[0.0, 2.0]], atol=1e-12)
    assert (p.eta, p.gamma0) == pytest.approx((0.2 * 1.5, 0.3))
    (A, B), (A_t, B_t) = (
        task.plant.changed(scales={"m": scale}).linearization() for scale in (1.0, 1.5)
    )
    expected = np.linalg.norm(p.G @ (A_t - B_t @ p.K - A + B @ p.K)) * 1.5
    assert p.gamma1 == pytest.approx(expected)


def test_a_member_that_does_not_rest_there_costs_a_constant() -> None:
    """The nominal torque does not hold a heavier one: m' g sin is missing, over its own m'."""
    p = state_grosmc(hung_at(0.8), StateUncertainty(scales={"m": (1.0, 1.5)})).parameters
    # x'' = -g sin + u_e/m' = -g sin (1 - m/m'), seen through G = m and r = m/m'.
    assert p.gamma0 == pytest.approx(2.0 * 9.81 * np.sin(0.8) * (1 - 1 / 1.5) * 1.5)


def test_a_push_where_the_input_acts_is_a_disturbance_of_the_input() -> None:
    """A force on the cart, in N, and the input's own 0.7 N."""
    task = state_task(nominal("cart_pendulum"), np.eye(4), 1.0)
    for declared in (StateUncertainty(body="cart", push=0.7), StateUncertainty(force=0.7)):
        assert state_grosmc(task, declared).parameters.gamma0 == pytest.approx(0.7)


def test_two_inputs_take_the_least_of_the_symmetric_part() -> None:
    task = state_task(two_carts(), np.eye(4), 1.0)
    p = state_grosmc(task, StateUncertainty(scales={"k": (0.5, 2.0)})).parameters
    A, *others = (two_carts().changed(scales={"k": s}).linearization()[0] for s in (1.0, 0.5, 2.0))
    worst = max(np.linalg.norm(p.G @ (A_t - A)) for A_t in others)
    assert p.gamma1 == pytest.approx(worst / np.sqrt(2))


@pytest.mark.parametrize(
    ("unit", "G", "expected"), [("N", None, "N s"), ("1", None, "s"), ("N", [[0.0, 3.0]], "1")]
)
def test_s_has_the_unit_of_the_input_times_time(unit: str, G: Any, expected: str) -> None:
    """Where G B is 1; of another G it has no unit of its own."""
    a, w = sp.symbols("a w")
    plant = gm.affine_plant(
        "free", states={"a": "m", "w": "m/s"}, inputs={"u": unit}, f=[w, -a], g=[0, 1], h=[a],
        parameters={},
    )  # fmt: skip
    law = state_grosmc(state_task(plant, np.eye(2), 1.0), G=G)
    assert law.designed.sliding_unit == expected
