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
    ARM_ERROR,
    ARM_REFERENCE,
    ARM_WEIGHTS,
    PENDULUM_DISTURBANCE,
    PENDULUM_ERROR,
    PENDULUM_UNCERTAINTY,
    PENDULUM_UPRIGHT,
    PENDULUM_WEIGHTS,
    SERVO_ERROR,
    SERVO_STEP,
    SERVO_UNCERTAINTY,
    SERVO_WEIGHTS,
)

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import linear_grosmc, regulating_grosmc
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.control.references import Setpoint, Setpoints, setpoint, setpoints
from grosmc_mj.control.task import Task
from grosmc_mj.control.uncertainty import SwitchingGains, Uncertainty
from grosmc_mj.errors import ArgumentError, GainError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ARM, SERVO, AnalyticPlant, System
from grosmc_mj.plants.affine import affine_plant
from grosmc_mj.plants.cart_pendulum import pole_torque

# gamma1 is a supremum over a grid of directions of z that are at most pi/40 from any other, so
# it is short of the true one by at most 1 - cos(pi/40) of itself.
GRID = 1 - math.cos(math.pi / 40)


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


def family(system: str) -> Uncertainty:
    if system == "servo":
        return SERVO_UNCERTAINTY
    return PENDULUM_UNCERTAINTY


def scaled(plant: AnalyticPlant, names: list[str], scales: Array) -> AnalyticPlant:
    p = plant.parameters
    changed = {name: getattr(p, name) * k for name, k in zip(names, scales, strict=True)}
    return replace(plant, parameters=replace(p, **changed))


def points(plant: AnalyticPlant, uncertainty: Uncertainty, count: int) -> Iterator[Point]:
    """Every corner of the family and the region, z near 0, and random points between."""
    names = list(uncertainty.scales)
    low, high = np.reshape([uncertainty.scales[name] for name in names], (-1, 2)).T
    corners = [np.array(c) for c in itertools.product(*zip(low, high, strict=True))]
    region, rng = np.array(uncertainty.region), np.random.default_rng(0)
    signs = [np.array(sign) for sign in itertools.product((-1, 0, 1), repeat=2)]
    pairs = [(scale, np.maximum(1e-6, region) * sign) for scale in corners for sign in signs]
    pairs += [
        (rng.uniform(low, high), rng.uniform(-1, 1, 2) * region * rng.uniform())
        for _ in range(count)
    ]
    wrench = np.array(uncertainty.wrench)
    for scale, z in pairs:
        true = scaled(plant, names, scale)
        for sign, side in itertools.product((-1.0, 1.0), repeat=2):
            yield Point(true, z, sign * wrench, side)


def shortfall(ctl: Controller, at: Point, rate: float) -> float:
    """How far s' sgn(s) exceeds -rate at a point, with s' from the true plant's equations."""
    p, error = ctl.parameters, ctl.coordinates
    position = error.system.output
    velocity = position + error.system.degrees_of_freedom
    x = np.zeros(len(error.system.states))
    x[position] = error.reference(0.0, p.reference)[0] + error.sign * at.z[0]
    x[velocity] = error.sign * at.z[1]
    memory = SurfaceMemory(z0=at.z - at.side * p.G[0] / (p.G[0] @ p.G[0]), t=1.0)
    u = ctl.law(1.0, x, memory, p)
    assert np.sign(memory.s).tolist() == [at.side]
    dx = at.plant.derivative(x, u, at.wrench)
    dz = error.sign * np.array([dx[position], dx[velocity]])
    return float((p.G @ dz - p.S @ at.z).item() * at.side + rate)


def with_gain(ctl: Controller, name: str, factor: float) -> Controller:
    p = ctl.parameters
    return replace(ctl, parameters=replace(p, **{name: factor * getattr(p, name)}))


@pytest.mark.parametrize("system", ["servo", "cart_pendulum"])
def test_reaching_condition_holds_for_the_whole_declared_family(system):
    """s' s <= -eta |s|, eqs. (14) and (39), with the eta that was declared."""
    ctl, uncertainty = robust(system), family(system)
    p, error = ctl.parameters, ctl.coordinates
    for at in points(nominal(system), uncertainty, 200):
        short = shortfall(ctl, at, uncertainty.reaching_rate)
        # What gamma1 contributes to |s'|, at most, and so what the grid can miss.
        E = error.dynamics(0.0, np.zeros(4), replace(p, plant=at.plant.parameters))[1]
        missed = GRID * abs(p.G[0, 1] * E.item()) * p.gamma1 * np.hypot(*at.z)
        assert short <= missed + 1e-9, f"short by {short:g} at {at}"


@pytest.mark.parametrize(
    ("system", "gain"),
    # The pendulum's gamma0 is 0.008 N for d = 0.01 rad/s^2: smaller than the slack of its eta.
    [
        ("servo", "gamma1"),
        ("servo", "gamma0"),
        ("servo", "eta"),
        ("cart_pendulum", "gamma1"),
        ("cart_pendulum", "eta"),
    ],
)
def test_no_gain_is_vacuous(system, gain):
    """With half of it some plant of the family breaks the reaching condition by far."""
    ctl, uncertainty = with_gain(robust(system), gain, 0.5), family(system)
    worst = max(
        shortfall(ctl, at, uncertainty.reaching_rate)
        for at in points(nominal(system), uncertainty, 20)
    )
    assert worst > 0.25 * uncertainty.reaching_rate, f"largest shortfall {worst:g}"


def test_gains_of_the_servo_are_the_closed_forms():
    """By hand, with J = j Jn and T_d <= 1 N m, for x = [theta_d - theta, -theta'].

    x2' = -B/J x2 - Kt/J i + T_d/J, so alpha = -B/J x2, E = -Kt/J, and r = E*/E = 1/j.
    alpha*/E* = alpha/E = B/Kt x2, for J cancels. Divided by E*, the mismatch is

        (alpha* - alpha)/E* + (1 - 1/r) u_0 = (1 - j) (B/Kt x2 - K x)

    which is at most |1 - j| |K - [0, B/Kt]| |x|, worst at j = 3. The load is T_d/J over Kt/J.
    """
    p: Any = nominal("servo").parameters
    gains = robust("servo").parameters
    K = gains.K
    gamma1 = 2 * math.hypot(K[0, 0], K[0, 1] - p.B / p.Kt)

    assert gains.gamma0 == pytest.approx(1.0 / p.Kt, rel=1e-12)
    assert (1 - GRID) * gamma1 <= gains.gamma1 <= gamma1 * (1 + 1e-12)
    assert gains.eta == pytest.approx(3 * SERVO_UNCERTAINTY.reaching_rate, rel=1e-12)


def test_input_gain_of_the_pendulum_falls_as_the_lagrangian_says():
    """E = a cos / (L (4/3 - a m cos^2)), a = 1/(M+m); least with 4m, 4L at the region's edge."""
    p: Any = nominal("cart_pendulum").parameters
    uncertainty = family("cart_pendulum")

    def E(m: float, L: float, theta: float) -> float:
        c = math.cos(theta)
        return c / (p.M + m) / (L * (4 / 3 - m / (p.M + m) * c * c))

    edge = uncertainty.region[0]
    ratio = E(4 * p.m, 4 * p.L, edge) / E(p.m, p.L, edge)
    gains = robust("cart_pendulum").parameters
    assert gains.eta == pytest.approx(uncertainty.reaching_rate / ratio, rel=1e-12)
    # Calculated independently: about 0.22 upright.
    assert E(4 * p.m, 4 * p.L, 0) / E(p.m, p.L, 0) == pytest.approx(0.22, abs=0.005)


@pytest.mark.parametrize(("lightest", "heaviest"), [(1.0, 4.0), (0.5, 1.0)])
def test_push_on_the_pendulum_asks_for_the_force_that_balances_it(lightest, heaviest):
    """By hand: |d/E*| = torque (M+m)/(m L cos), for the inertia of eq. (40) cancels.

    Most is asked for by the lightest pole at the edge of the region.
    """
    p: Any = nominal("cart_pendulum").parameters
    wrench, region = (0.0,) * 10 + (0.3, 0.0), (0.5, 1.0)
    uncertainty = Uncertainty({"m": (lightest, heaviest)}, wrench, region, 0.2)
    m = lightest * p.m
    expected = 0.3 * (p.M + m) / (m * p.L * math.cos(region[0]))
    gains = gains_of(PENDULUM_ERROR, uncertainty, linearizing=True)
    assert gains.gamma0 == pytest.approx(expected, rel=1e-12)


def test_pole_torque_is_a_hundredth_of_a_radian_per_second_squared():
    """The wrench of the family accelerates the upright nominal pole by the printed amplitude."""
    plant = nominal("cart_pendulum")
    torque = pole_torque(PENDULUM_DISTURBANCE, plant.parameters)
    assert max(family("cart_pendulum").wrench) == torque
    wrench = np.array([0.0] * 10 + [-torque, 0.0])
    assert plant.derivative(np.zeros(4), 0.0, wrench)[3] == pytest.approx(0.01, rel=1e-12)


def test_the_declared_pole_torque_is_all_of_the_pendulum_s_constant_gain():
    """A force or a torque about another axis would ask for another one, or for none.

    By hand, as above, with torque = I d and I = m L^2 (4/3 - m/(M+m)), the inertia of the
    upright pole on its free cart.
    """
    p: Any = nominal("cart_pendulum").parameters
    uncertainty = family("cart_pendulum")
    torque = 0.01 * p.m * p.L**2 * (4 / 3 - p.m / (p.M + p.m))
    expected = torque * (p.M + p.m) / (p.m * p.L * math.cos(uncertainty.region[0]))
    assert robust("cart_pendulum").parameters.gamma0 == pytest.approx(expected, rel=1e-9)


def gains_of(
    error: ErrorCoordinates, uncertainty: Uncertainty, *, linearizing: bool
) -> SwitchingGains:
    law = robust(error.system.name)
    design = replace(law.designed, error=error)
    assert design.linearizing is linearizing
    return uncertainty.gains(design, law.parameters)[0]


@pytest.mark.parametrize(
    ("error", "linearizing", "bodies"), [(SERVO_ERROR, False, 1), (PENDULUM_ERROR, True, 2)]
)
def test_certain_undisturbed_plant_needs_eta_only(error, linearizing, bodies):
    certain = Uncertainty({}, (0.0,) * 6 * bodies, (0.5, 1.0), 0.2)
    gains = gains_of(error, certain, linearizing=linearizing)
    # The linear law's A and B are a Jacobian by finite differences.
    assert gains == pytest.approx((0.2, 0.0, 0.0, 1.0), rel=0, abs=1e-10)


@pytest.mark.slow
def test_larger_family_needs_larger_gains():
    def gains(mass: float, torque: float) -> SwitchingGains:
        scales, wrench = {"m": (1.0, mass), "L": (1.0, mass)}, (0.0,) * 10 + (torque, 0.0)
        return gains_of(
            PENDULUM_ERROR, Uncertainty(scales, wrench, (0.5, 1.0), 0.2), linearizing=True
        )

    small, heavy, pushed = gains(2, 0.1), gains(3, 0.1), gains(2, 0.2)
    assert heavy.gain_ratio < small.gain_ratio
    assert heavy.gamma1 > small.gamma1
    assert heavy.eta > small.eta
    assert pushed.gamma0 == pytest.approx(2 * small.gamma0, rel=1e-12)
    assert pushed.gamma1 == small.gamma1


def reversing_servo() -> System:
    """A servo whose input acts backwards beyond half of its torque constant more."""
    J, Kt = sp.symbols("J Kt")
    equations = replace(SERVO.equations, g=(0, (1 - Kt) / J))
    return replace(SERVO, equations=equations)


@pytest.mark.parametrize("scale", [2.0, 1 / 0.667])
def test_family_that_reverses_or_loses_the_input_is_refused(scale):
    """No gain helps where E*/E <= 0: the message says which ratio, where."""
    error = ErrorCoordinates(reversing_servo(), SERVO_ERROR.reference, -1)
    uncertainty = Uncertainty({"Kt": (1.0, scale)}, (0.0,) * 6, (1.0, 1.0), 0.2)
    message = r"servo: the input gain of a declared plant, Kt x[0-9.]+, is .* at z ="
    with pytest.raises(GainError, match=message):
        gains_of(error, uncertainty, linearizing=False)


def test_mismatch_that_is_there_at_rest_is_covered_by_a_constant() -> None:
    """An arm held at 0.3 rad with up to twice its payload: m g l cos q is not all cancelled.

    By hand, at z = 0: alpha* - E*/E alpha = -(G* - G)/M*, where G* - G is the torque
    (m* - m) g l cos q. It is divided by the true E* = 1/M*(q) wherever the arm may be: most at
    the highest q of the region.
    """
    plant, held = nominal("arm"), 0.3
    p: Any = plant.parameters
    doubled = Uncertainty({"m": (1.0, 2.0)}, (0.0,) * 12, (0.5, 1.0), 0.2)
    task = Task(plant, ErrorCoordinates(ARM, setpoint), Setpoint(held), *ARM_WEIGHTS)
    ctl = regulating_grosmc(task, doubled)
    torque = p.m * p.g * p.l * math.cos(held)
    M = [p.J + 2 * p.m * p.l**2 + p.M_c * (1 + math.sin(q)) for q in (held, held + 0.5)]
    assert ctl.parameters.gamma0 == pytest.approx(torque * M[1] / M[0], rel=1e-9)
    for at in points(plant, doubled, 200):
        missed = GRID * abs(ctl.parameters.G[0, 1]) / p.J * ctl.parameters.gamma1
        short = shortfall(ctl, at, doubled.reaching_rate)
        assert short <= missed * np.hypot(*at.z) + 1e-9, f"short by {short:g} at {at}"
    without = with_gain(ctl, "gamma0", 0.0)
    worst = max(shortfall(without, at, doubled.reaching_rate) for at in points(plant, doubled, 20))
    assert worst > doubled.reaching_rate


def test_gains_for_a_reference_that_moves_are_refused() -> None:
    """y_r'' is a push of its own, which no bound in |z| covers."""
    plant = nominal("arm")
    certain = Uncertainty({}, (0.0,) * 12, (0.5, 1.0), 0.2)
    task = Task(plant, ARM_ERROR, ARM_REFERENCE, *ARM_WEIGHTS)
    with pytest.raises(GainError, match=r"arm: the reference moves.*give k and epsilon instead"):
        regulating_grosmc(task, certain)


@pytest.mark.parametrize("region", [(1.0,), (1.0, 1.0, 1.0)])
def test_region_of_another_size_than_the_error_state_is_refused(region: tuple[float, ...]) -> None:
    message = f"the uncertainty has {len(region)} bounds of the operating region, must have 2"
    with pytest.raises(GainError, match=message):
        gains_of(SERVO_ERROR, replace(SERVO_UNCERTAINTY, region=region), linearizing=False)


def test_gain_margin_over_one_input_is_the_ratio_of_the_gains() -> None:
    R = np.array([[0.6]]) @ np.linalg.inv(np.array([[-3.0]]))
    assert gain_margin(R) == pytest.approx(-0.2, rel=1e-15)


def test_gain_margin_over_several_inputs_is_what_the_worst_signs_leave() -> None:
    """min over rows and over all sides of (R sgn s)_i sgn s_i, by trying all of them."""
    random = np.random.default_rng(4)
    for m in (2, 3):
        for _ in range(50):
            steered, believed = random.normal(size=(2, m, m)) + 2 * np.eye(m)
            R = steered @ np.linalg.inv(believed)
            sides = [np.array(side) for side in itertools.product((-1.0, 1.0), repeat=m)]
            worst = min(float((side * (R @ side)).min()) for side in sides)
            assert gain_margin(R) == pytest.approx(worst, rel=1e-12, abs=1e-12)


def test_gain_margin_along_s_is_the_least_share_that_points_back() -> None:
    """min over s of s' R s / |s|^2, over a fine circle of s; R need not be symmetric."""
    angle = np.linspace(0, np.pi, 10_001)
    s = np.array([np.cos(angle), np.sin(angle)])
    random = np.random.default_rng(5)
    for R in random.normal(size=(50, 2, 2)):
        worst = float(np.einsum("it,ij,jt->t", s, R, s).min())
        assert gain_margin(R, together=True) == pytest.approx(worst, abs=1e-6)


def test_gains_hold_for_a_term_along_s_as_well_as_for_one_in_each_entry() -> None:
    """By hand, R = [[1.45, 0.45], [0.025, 1]] at k = 1.05: 0.975 by rows, 0.898 along s."""
    k = sp.Symbol("k")
    mixer = affine_plant(
        "mixer", states={"a": "m", "b": "m"}, inputs={"u": "m/s", "v": "m/s"}, f=[0, 0],
        g=[[9 * k - 8, 9 * (k - 1)], [(k - 1) / 2, 1]], h=sp.symbols("a b"), parameters={"k": 1.0},
    )  # fmt: skip
    error = ErrorCoordinates(mixer.system, setpoints(1, 1))
    task = Task(mixer, error, Setpoints(0.0, 0.0), np.eye(2), np.eye(2))
    wrench = (0.0,) * len(mixer.system.equations.w)
    ctl = regulating_grosmc(task, Uncertainty({"k": (1.0, 1.05)}, wrench, (1.0, 1.0), 0.2))
    along = 1.225 - math.hypot(0.225, 0.2375)
    assert ctl.parameters.eta == pytest.approx(0.2 / along, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scales": {"J": (0.0, 2.0)}}, r"ranges .* above 0, unlike J = \(0.0, 2.0\)"),
        ({"scales": {"J": (2.0, 1.0)}}, r"unlike J = \(2.0, 1.0\)"),
        ({"scales": {"J": (1.0, math.inf)}}, r"unlike J = \(1.0, inf\)"),
        ({"reaching_rate": 0.0}, "reaching_rate = 0 must be finite and positive"),
        ({"reaching_rate": math.nan}, "reaching_rate = nan must be"),
        ({"region": (1.0, 0.0)}, r"region = \(1\.0, 0\.0\) must be finite and positive"),
    ],
)
def test_declaration_that_means_nothing_is_refused(change, message):
    with pytest.raises(ArgumentError, match=message):
        replace(SERVO_UNCERTAINTY, **change)


def test_linear_law_on_a_nonlinear_plant_holds_that_plant_at_least():
    """linear_grosmc takes any plant and promises gains for the family, here one plant."""
    plant = nominal("cart_pendulum")
    certain = Uncertainty({}, (0.0,) * 12, (np.pi / 6, 1.5), 0.2)
    ctl = linear_grosmc(
        Task(plant, PENDULUM_ERROR, PENDULUM_UPRIGHT, *PENDULUM_WEIGHTS),
        certain,
    )
    for at in points(plant, certain, 50):
        assert shortfall(ctl, at, certain.reaching_rate) <= 1e-9


def test_linear_law_on_the_linear_servo_needs_no_more_than_eta():
    """The same as above where the plant is linear: the condition holds with equality."""
    plant = nominal("servo")
    certain = Uncertainty({}, (0.0,) * 6, (1.0, 1.0), 0.2)
    ctl = linear_grosmc(Task(plant, SERVO_ERROR, SERVO_STEP, *SERVO_WEIGHTS), certain)
    for at in points(plant, certain, 50):
        # s' is a difference of terms of order 10.
        assert shortfall(ctl, at, certain.reaching_rate) == pytest.approx(0, abs=1e-13)
