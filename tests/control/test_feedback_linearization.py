"""Feedback linearization, eqs. (21)-(25): against derivatives along the flow, and by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy as sp
from hand_written import HAND_WRITTEN

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.feedback_linearization import (
    FeedbackLinearization,
    feedback_linearization,
)
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.references import TIME, Setpoint, Setpoints, reference, setpoints
from grosmc_mj.control.task import FeedbackParameters
from grosmc_mj.errors import PremiseError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ARM, CART_PENDULUM, SERVO, AnalyticPlant, Signal, System, find_system
from grosmc_mj.plants.equations import Equations

# x' as a function of x, u and the wrench, in mpmath's numbers.
Field = Callable[[list[Any], list[Any]], list[Any]]

VARIANTS = [(name, variant) for name in HAND_WRITTEN for variant in find_system(name).variants]
each_plant = pytest.mark.parametrize(("name", "variant"), VARIANTS)


@cache
def plant(name: str, variant: Any = "corrected") -> AnalyticPlant:
    return MujocoPlant.load(name).analytic(variant)


@cache
def chains(name: str) -> FeedbackLinearization:
    return feedback_linearization(find_system(name).equations)


def states(name: str, count: int, seed: int = 0) -> Array:
    """Random states where E is regular: |angle| < 1.4, rates of 3 [rad/s, m/s]."""
    n, random = find_system(name).degrees_of_freedom, np.random.default_rng(seed)
    return np.hstack([random.uniform(-1.4, 1.4, (count, n)), random.normal(0, 3, (count, n))])


# Derivatives of outputs along the flow


def flow(field: Field, x: Array, u: list[float], h: Any) -> list[Any]:
    """One step of RK4 at 60 digits; with h = 1e-12 its error of h^5 is nothing."""
    with mpmath.workdps(60):
        inputs = [mpmath.mpf(each) for each in u]
        start = [mpmath.mpf(each) for each in x]

        def moved(slope: list[Any], share: Any) -> list[Any]:
            return [a + share * b for a, b in zip(start, slope, strict=True)]

        k1 = field(start, inputs)
        k2 = field(moved(k1, h / 2), inputs)
        k3 = field(moved(k2, h / 2), inputs)
        k4 = field(moved(k3, h), inputs)
        total = [a + 2 * b + 2 * c + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
        return moved(total, h / 6)


def derivatives(field: Field, y: Callable[[list[Any]], Any], x: Array, u: list[float]) -> Array:
    """y, y', y'' and y''' along the flow under a held input, (4,), by central differences.

    They are short by h^2 times the next but one derivative, and round at 1e-60 / h^3.
    """
    with mpmath.workdps(60):
        h = mpmath.mpf(10) ** -12
        values = {k: y(flow(field, x, u, k * h)) for k in (-2, -1, 0, 1, 2)}
        first = (values[1] - values[-1]) / (2 * h)
        second = (values[1] - 2 * values[0] + values[-1]) / h**2
        third = (values[2] - 2 * values[1] + 2 * values[-1] - values[-2]) / (2 * h**3)
        return np.array([float(each) for each in (values[0], first, second, third)])


def check_along_the_flow(
    found: FeedbackLinearization,
    parameters: Any,
    field: Field,
    outputs: list[Callable[[list[Any]], Any]],
    points: Array,
) -> None:
    """T(x) is what the outputs' derivatives are whatever u, and y_i^(r_i) is K_i + (E u)_i."""
    m, random = len(outputs), np.random.default_rng(1)
    for x in points:
        T = np.array(found.transformation(x, parameters))
        K = np.array(found.nonlinearity(x, parameters))
        E = np.reshape(found.decoupling_matrix(x, parameters), (m, m))
        for u in (np.zeros(m), random.normal(0, 3, m)):
            highest, entry = K + E @ u, 0
            for i, (y, r) in enumerate(zip(outputs, found.relative_degree, strict=True)):
                expected = derivatives(field, y, x, u.tolist())
                scale = 1e-12 * max(1.0, np.abs(expected).max(), np.abs(E[i] * u).max())
                assert T[entry : entry + r] == pytest.approx(expected[:r], rel=0, abs=scale)
                assert highest[i] == pytest.approx(expected[r], rel=0, abs=scale)
                entry += r


@each_plant
def test_transformation_of_the_three_plants_is_the_output_along_the_flow(
    name: str, variant: Any
) -> None:
    """With x' from the plants written by hand, which know of no sympy."""
    by_hand, p, system = HAND_WRITTEN[name], plant(name, variant).parameters, find_system(name)

    def field(x: list[Any], u: list[Any]) -> list[Any]:
        f, g = by_hand.drift(x, p, mpmath), by_hand.input_matrix(x, p, mpmath)
        return [a + b * u[0] for a, b in zip(f, g, strict=True)]

    outputs = [lambda x: x[system.output]]
    check_along_the_flow(chains(name), p, field, outputs, states(name, 12))


@each_plant
def test_three_plants_have_relative_degree_two_and_the_hand_written_K_and_E(
    name: str, variant: Any
) -> None:
    """T = [y, y'], K = L_f^2 h is the row of f and E that of g in which y'' is."""
    found, system, by_hand = chains(name), find_system(name), HAND_WRITTEN[name]
    p, velocity = plant(name, variant).parameters, system.output + system.degrees_of_freedom
    assert found.relative_degree == (2,)
    assert [str(t) for t in found.T] == [
        str(system.equations.x[row]) for row in (system.output, velocity)
    ]
    assert found.complete is (name != "cart_pendulum")
    for x in states(name, 100):
        assert found.transformation(x, p) == (x[system.output], x[velocity])
        (K,), (E,) = found.nonlinearity(x, p), found.decoupling_matrix(x, p)
        size = by_hand.size(x, p)
        assert pytest.approx(by_hand.drift(x, p)[velocity], rel=0, abs=1e-14 * size) == K
        assert pytest.approx(by_hand.input_matrix(x, p)[velocity], rel=1e-14) == E


@pytest.mark.parametrize("name", HAND_WRITTEN)
def test_wrench_meets_the_row_of_the_input_alone(name: str) -> None:
    """Eq. (24): the mechanical plants are matched, and d(t) is the hand-written acceleration."""
    system, by_hand, random = find_system(name), HAND_WRITTEN[name], np.random.default_rng(2)
    error, p = ErrorCoordinates(system, setpoints(2)), plant(name).parameters
    numbers = FeedbackParameters(p, Setpoint(), np.zeros((1, 2)))
    velocity = system.output + system.degrees_of_freedom
    for x in states(name, 20):
        w = random.normal(0, 1, 6 * len(system.bodies))
        pushed = tuple(error.disturbances(x[None], numbers, plant(name), w[None])[0])
        terms = [by_hand.disturbance(x, row, p)[velocity] for row in np.diag(w)]
        tolerance = 1e-14 * np.abs(terms).sum()
        expected = (0, pytest.approx(by_hand.disturbance(x, w, p)[velocity], abs=tolerance))
        assert pushed == expected


# Brunovsky form and zero dynamics


def controllability(A: Array, B: Array) -> Array:
    return np.hstack([np.linalg.matrix_power(A, k) @ B for k in range(len(A))])


@pytest.mark.parametrize("name", HAND_WRITTEN)
def test_chains_of_the_three_plants_are_double_integrators(name: str) -> None:
    found = chains(name)
    np.testing.assert_array_equal(found.A, [[0, 1], [0, 0]])
    np.testing.assert_array_equal(found.B, [[0], [1]])
    assert np.linalg.matrix_rank(controllability(found.A, found.B)) == 2
    assert (found.first_rows, found.last_rows) == ((0,), (1,))


def test_cart_drifts_freely_while_the_pole_is_upright() -> None:
    """p' = speed, speed' = 0: the chapter's z leaves the cart out, with two poles at zero."""
    inner = chains("cart_pendulum").zero_dynamics()
    assert inner is not None
    position, speed = sp.symbols("position speed")
    assert inner.states == (position, speed)
    assert inner.rates == (speed, 0)
    np.testing.assert_array_equal(inner.poles(plant("cart_pendulum").parameters), [0, 0])


@pytest.mark.parametrize("name", ["servo", "arm"])
def test_plant_whose_output_sees_all_of_it_has_no_zero_dynamics(name: str) -> None:
    assert chains(name).zero_dynamics() is None


@dataclass(frozen=True)
class Pole:
    """A parameter of the plants below."""

    a: float


def test_zero_dynamics_have_the_zeros_of_the_transfer_function() -> None:
    """x1' = u, x2' = a x2 + x1: y = x1 + x2 has (s - a + 1) / (s (s - a)), y = x1 has 1/s."""
    x1, x2, a = sp.symbols("x1 x2 a")
    equations = Equations(x=(x1, x2), f=(0, a * x2 + x1), g=(1, 0), h=(x1 + x2,))
    for h, pole in ((x1 + x2, 3.0 - 1), (x1, 3.0)):
        found = feedback_linearization(equations, [h])
        assert found.relative_degree == (1,)
        inner = found.zero_dynamics()
        assert inner is not None
        np.testing.assert_allclose(inner.poles(Pole(3.0)), [pole], rtol=1e-14)


def test_zero_dynamics_hold_what_is_held_by_the_input() -> None:
    """x1' = x2^2 + u, x2' = -x2^3 + u: holding y = x1 takes u = -x2^2, so x2' = -x2^3 - x2^2."""
    x1, x2 = sp.symbols("x1 x2")
    equations = Equations(x=(x1, x2), f=(x2**2, -(x2**3)), g=(1, 1), h=(x1,))
    inner = feedback_linearization(equations).zero_dynamics()
    assert inner is not None
    assert inner.states == (x2,)
    assert sp.expand(inner.rates[0]) == -(x2**3) - x2**2


# Singularities


def test_pole_cannot_be_turned_where_it_lies() -> None:
    """det E is zero where cos(theta) is, and only there: its numerator is that and numbers."""
    found, theta = chains("cart_pendulum"), sp.Symbol("theta")
    numbers = sp.simplify(found.singularity / sp.cos(theta))
    assert not numbers.free_symbols & set(CART_PENDULUM.equations.x)
    assert numbers.subs(sp.Symbol("printed"), 0) != 0
    p = plant("cart_pendulum").parameters
    for angle in np.linspace(-3, 3, 25).tolist():
        (E,) = found.decoupling_matrix([0.0, angle, 0.0, 0.0], p)
        assert np.sign(E) == np.sign(math.cos(angle))
    (where,) = found.singular_states()
    symbol, angles = where.args
    assert symbol == theta
    assert isinstance(angles, sp.Set)
    for angle in (sp.pi / 2, -sp.pi / 2, 3 * sp.pi / 2):
        assert angles.contains(angle) == sp.true
    for angle in (0, sp.pi, sp.pi / 3):
        assert angles.contains(angle) == sp.false


@pytest.mark.parametrize("name", ["servo", "arm"])
def test_input_of_the_other_plants_never_fades(name: str) -> None:
    assert chains(name).singular_states() == []


# A plant of the third order: a DC motor with its inductance


@dataclass(frozen=True)
class Motor:
    """J w' = Kt i - B w, L i' = u - R i - Kt w."""

    J: float = 0.02
    B: float = 0.1
    Kt: float = 0.7
    L: float = 0.05
    R: float = 1.3


def motor(load: bool) -> Equations:
    """With a wrench that is a load torque on the shaft or, else, a voltage."""
    angle, rate, i, w = sp.symbols("angle rate i w")
    J, B, Kt, L, R = sp.symbols("J B Kt L R")
    return Equations(
        x=(angle, rate, i),
        f=(rate, (Kt * i - B * rate) / J, -(R * i + Kt * rate) / L),
        g=(0, 0, 1 / L),
        h=(angle,),
        w=(w,),
        d=(0, -w / J, 0) if load else (0, 0, w / L),
    )


def test_motor_with_inductance_is_a_chain_of_three() -> None:
    found, p = feedback_linearization(motor(load=True)), Motor()
    assert found.relative_degree == (3,)
    assert found.complete
    assert found.zero_dynamics() is None
    np.testing.assert_array_equal(found.A, np.eye(3, k=1))
    np.testing.assert_array_equal(found.B, [[0], [0], [1]])
    assert np.linalg.matrix_rank(controllability(found.A, found.B)) == 3
    points = np.random.default_rng(3).normal(0, 2, (12, 3))
    for angle, rate, i in points:
        acceleration = (p.Kt * i - p.B * rate) / p.J
        jerk = (p.Kt * -(p.R * i + p.Kt * rate) / p.L - p.B * acceleration) / p.J
        x = np.array([angle, rate, i])
        assert found.transformation(x, p) == pytest.approx((angle, rate, acceleration), rel=1e-13)
        terms = abs(p.Kt * p.R * i / p.L / p.J) + abs(p.B * acceleration / p.J)
        assert found.nonlinearity(x, p)[0] == pytest.approx(jerk, rel=0, abs=1e-13 * terms)
        assert found.decoupling_matrix(x, p)[0] == pytest.approx(p.Kt / p.J / p.L, rel=1e-15)

    def field(x: list[Any], u: list[Any]) -> list[Any]:
        return [
            x[1],
            (p.Kt * x[2] - p.B * x[1]) / p.J,
            (u[0] - p.R * x[2] - p.Kt * x[1]) / p.L,
        ]

    check_along_the_flow(found, p, field, [lambda x: x[0]], points)


def test_load_of_the_motor_is_not_matched_and_its_voltage_is() -> None:
    """The load is in the row of y'', where no input is: Assumption 5 fails for it."""
    p, x, w = Motor(), np.array([0.2, 1.5, -0.4]), np.array([0.3])
    by_load = (0, -0.3 / p.J, 0.3 * p.B / p.J**2)
    for load, expected in ((True, by_load), (False, (0, 0, 0.3 * p.Kt / p.J / p.L))):
        equations = motor(load)
        slope = np.reshape(feedback_linearization(equations).slope(x, p), (3, 3))
        pushed = slope @ np.array(equations.disturbance(x, w, p))
        np.testing.assert_allclose(pushed, expected, rtol=1e-13)


def test_state_of_the_motor_is_found_from_its_derivatives() -> None:
    """T(T^-1(z)) = z, in symbols and by root finding."""
    found, p = feedback_linearization(motor(load=True)), Motor()
    z = sp.symbols("z1:4")
    (inverse,) = found.inverse(z)
    back = [sp.simplify(t.subs(inverse)) for t in found.T]
    assert back == list(z)
    # By hand: i = (J z3 + B z2)/Kt.
    J, B, Kt, i = sp.symbols("J B Kt i")
    assert sp.simplify(inverse[i] - (J * z[2] + B * z[1]) / Kt) == 0
    for target in np.random.default_rng(4).normal(0, 5, (10, 3)):
        x = found.place(target, p, np.zeros(3))
        np.testing.assert_allclose(found.transformation(x, p), target, rtol=0, atol=1e-8)
        assert x[2] == pytest.approx((p.J * target[2] + p.B * target[1]) / p.Kt, abs=1e-10)


# Two inputs, unequal relative degrees


X1, X2, X3 = sp.symbols("x1 x2 x3", real=True)
COUPLED = Equations(
    x=(X1, X2, X3),
    f=(X2, X1 * X3, X2 - X3),
    g=((0, 0), (2 + sp.sin(X3), X1), (1, 3 + X2**2)),
    h=(X1, X3),
)


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


def coupled(x: list[Any], u: list[Any]) -> list[Any]:
    return [
        x[1],
        x[0] * x[2] + (2 + mpmath.sin(x[2])) * u[0] + x[0] * u[1],
        x[1] - x[2] + u[0] + (3 + x[1] ** 2) * u[1],
    ]


def test_coupled_plant_has_the_relative_degrees_and_the_matrix_by_hand() -> None:
    """y1'' = x1 x3 + (2 + sin x3) u1 + x1 u2, y2' = x2 - x3 + u1 + (3 + x2^2) u2."""
    found = feedback_linearization(COUPLED)
    assert found.relative_degree == (2, 1)
    assert found.T == (X1, X2, X3)
    assert (found.first_rows, found.last_rows) == ((0, 2), (1, 2))
    assert sp.simplify(found.E - sp.Matrix([[2 + sp.sin(X3), X1], [1, 3 + X2**2]])) == sp.zeros(2)
    assert [sp.simplify(k) for k in found.K] == [X1 * X3, X2 - X3]
    determinant = (2 + sp.sin(X3)) * (3 + X2**2) - X1
    assert sp.simplify(found.singularity - determinant) == 0
    np.testing.assert_array_equal(found.A, [[0, 1, 0], [0, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(found.B, [[0, 0], [1, 0], [0, 1]])
    assert np.linalg.matrix_rank(controllability(found.A, found.B)) == 3
    assert found.complete
    points = np.random.default_rng(5).normal(0, 1, (10, 3))
    check_along_the_flow(found, Nothing(), coupled, [lambda x: x[0], lambda x: x[2]], points)


def test_order_of_the_outputs_is_the_order_of_the_chains() -> None:
    """The same plant with its outputs exchanged: {1, 2}, and E with its rows exchanged."""
    found = feedback_linearization(COUPLED, [X3, X1])
    assert found.relative_degree == (1, 2)
    assert found.T == (X3, X1, X2)
    assert sp.simplify(found.E - sp.Matrix([[1, 3 + X2**2], [2 + sp.sin(X3), X1]])) == sp.zeros(2)
    np.testing.assert_array_equal(found.A, [[0, 0, 0], [0, 0, 1], [0, 0, 0]])
    np.testing.assert_array_equal(found.B, [[1, 0], [0, 0], [0, 1]])


CURVED = (sp.sinh(X1), sp.exp(X3))


def test_outputs_that_are_no_states_are_differentiated_by_the_chain_rule() -> None:
    """y1 = sinh x1, y2 = e^x3."""
    found = feedback_linearization(COUPLED, CURVED)
    assert found.relative_degree == (2, 1)
    assert list(found.T) == [sp.sinh(X1), X2 * sp.cosh(X1), sp.exp(X3)]
    by_hand = sp.Matrix(
        [
            [sp.cosh(X1) * (2 + sp.sin(X3)), sp.cosh(X1) * X1],
            [sp.exp(X3), sp.exp(X3) * (3 + X2**2)],
        ]
    )
    assert sp.simplify(found.E - by_hand) == sp.zeros(2)
    expected = [sp.sinh(X1) * X2**2 + sp.cosh(X1) * X1 * X3, sp.exp(X3) * (X2 - X3)]
    assert [sp.simplify(k - e) for k, e in zip(found.K, expected, strict=True)] == [0, 0]
    points = np.random.default_rng(6).normal(0, 1, (10, 3))
    outputs = [lambda x: mpmath.sinh(x[0]), lambda x: mpmath.exp(x[2])]
    check_along_the_flow(found, Nothing(), coupled, outputs, points)


def test_inverse_transformation_gives_the_state_back() -> None:
    """x1 = asinh z1, x2 = z2 / sqrt(1 + z1^2), x3 = log z3 for z3 > 0."""
    found = feedback_linearization(COUPLED, [X1, sp.exp(X3)])
    z1, z2 = sp.symbols("z1 z2", real=True)
    z3 = sp.Symbol("z3", positive=True)
    (inverse,) = found.inverse((z1, z2, z3))
    assert inverse == {X1: z1, X2: z2, X3: sp.log(z3)}
    assert [sp.simplify(t.subs(inverse)) for t in found.T] == [z1, z2, z3]
    curved = feedback_linearization(COUPLED, CURVED)
    for branch in curved.inverse((z1, z2, z3)):
        back = [t.subs(branch) for t in curved.T]
        numbers = {z1: sp.Float(0.3, 40), z2: sp.Float(-0.7, 40), z3: sp.Float(1.9, 40)}
        for value, wanted in zip(back, (0.3, -0.7, 1.9), strict=True):
            assert complex(value.subs(numbers).evalf(30)) == pytest.approx(wanted, abs=1e-14)


def test_transformation_that_leaves_states_out_has_no_inverse() -> None:
    with pytest.raises(PremiseError, match=r"2 of 4 states.*zero dynamics"):
        chains("cart_pendulum").inverse(sp.symbols("z1 z2"))


# A state with given outputs


def test_outputs_that_are_states_are_placed_exactly_and_the_rest_is_the_guess() -> None:
    guess = np.array([1.0, 2.0, 3.0, 4.0])
    x = chains("cart_pendulum").place(np.array([0.1, 0.2]), None, guess)
    np.testing.assert_array_equal(x, [1.0, 0.1, 3.0, 0.2])
    np.testing.assert_array_equal(guess, [1, 2, 3, 4])


def test_outputs_that_are_no_states_are_placed_by_root_finding() -> None:
    found = feedback_linearization(COUPLED, CURVED)
    for x in np.random.default_rng(7).uniform(-1.5, 1.5, (20, 3)):
        z = np.array(found.transformation(x, Nothing()))
        placed = found.place(z, Nothing(), np.zeros(3))
        np.testing.assert_allclose(placed, x, rtol=0, atol=1e-9)


def test_guess_chooses_among_states_with_the_same_outputs() -> None:
    """sin(theta) = 1/2 at 30 and at 150 degrees; the cart stays where the guess has it."""
    theta = sp.Symbol("theta")
    found = feedback_linearization(CART_PENDULUM.equations, [sp.sin(theta)])
    p, z = plant("cart_pendulum").parameters, np.array([0.5, 0.3])
    for guess, angle in ((0.0, math.pi / 6), (3.0, 5 * math.pi / 6)):
        x = found.place(z, p, np.array([7.0, guess, -2.0, 0.0]))
        expected = [7.0, angle, -2.0, 0.3 / math.cos(angle)]
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("height", [1.5, -3.0])
def test_outputs_that_no_state_has_are_refused(height: float) -> None:
    """No angle has this sine."""
    found = feedback_linearization(CART_PENDULUM.equations, [sp.sin(sp.Symbol("theta"))])
    p = plant("cart_pendulum").parameters
    with pytest.raises(PremiseError, match=r"no state near \[0\.0, 0\.1, 0\.0, 0\.0\] has z = \["):
        found.place(np.array([height, 0.0]), p, np.array([0, 0.1, 0, 0]))


@pytest.mark.parametrize("z3", [-1.0, -1e-6, -1e9])
def test_outputs_out_of_the_range_of_an_exponential_are_refused(z3: float) -> None:
    found = feedback_linearization(COUPLED, CURVED)
    with pytest.raises(PremiseError, match="no state near"):
        found.place(np.array([0.1, 0.2, z3]), Nothing(), np.zeros(3))


def test_outputs_beyond_a_function_s_domain_are_refused() -> None:
    """y = sqrt(x1) is no number for x1 < 0, where the root finder steps."""
    x1 = sp.Symbol("x1")
    root = feedback_linearization(Equations(x=(x1,), f=(0,), g=((1,),), h=(sp.sqrt(x1),)))
    assert root.place(np.array([3.0]), Nothing(), np.array([1.0])) == pytest.approx([9.0])
    with pytest.raises(PremiseError, match="no state near"):
        root.place(np.array([-0.5]), Nothing(), np.array([1.0]))


# What is refused


def test_matrix_that_is_singular_everywhere_is_refused() -> None:
    """Both outputs are moved by u1 + u2 only: no input tells them apart."""
    a, b, c = sp.symbols("a b c")
    equations = Equations(x=(a, b, c), f=(b, 0, 0), g=((1, 1), (2, 2), (0, 1)), h=(a, b))
    with pytest.raises(PremiseError, match=r"singular everywhere.*\(1, 1\).*eq\. \(21\)"):
        feedback_linearization(equations)
    # With c for an output it is regular.
    assert feedback_linearization(equations, [a, c]).relative_degree == (1, 1)


@pytest.mark.parametrize("scales", [(1, 1), (1e6, 1e-8), (1e-8, 1e6)])
def test_a_matrix_is_singular_at_a_state_in_any_units(scales: tuple[float, float]) -> None:
    """E = diag(c1, c2 cos b): regular wherever b is no quarter of a turn."""
    a, b = sp.symbols("a b")
    g = ((scales[0], 0), (0, scales[1] * sp.cos(b)))
    found = feedback_linearization(Equations(x=(a, b), f=(0, 0), g=g, h=(a, b)))
    found.require_regular(np.zeros(2), None)
    with pytest.raises(PremiseError, match=r"is singular there \(eq\. \(21\)\)"):
        found.require_regular(np.array([0.0, math.pi / 2]), None)


def test_matrix_that_is_singular_by_an_identity_is_refused() -> None:
    """E = [[sin^2, cos^2 - 1], [-1, 1]]: its determinant is zero for a reason sympy has to see."""
    a, b = sp.symbols("a b")
    g = ((sp.sin(a) ** 2, sp.cos(a) ** 2 - 1), (-1, 1))
    with pytest.raises(PremiseError, match=r"eq\. \(21\)"):
        feedback_linearization(Equations(x=(a, b), f=(0, 0), g=g, h=(a, b)))


def test_output_that_no_input_reaches_is_refused() -> None:
    a, b, c = sp.symbols("a b c")
    equations = Equations(x=(a, b, c), f=(b, -a, a), g=(0, 0, 1), h=(a,))
    with pytest.raises(PremiseError, match=r"output 1, a, has no relative degree.*Assumption 7"):
        feedback_linearization(equations)
    assert feedback_linearization(equations, [c]).relative_degree == (1,)


@pytest.mark.parametrize("h", [(X1,), (X1, X2, X3), ()])
def test_number_of_outputs_must_be_that_of_the_inputs(h: tuple[sp.Symbol, ...]) -> None:
    with pytest.raises(PremiseError, match=rf"{len(h)} outputs for 2 inputs.*eq\. \(21\)"):
        feedback_linearization(COUPLED, h)


# Error coordinates of such outputs


def motor_system() -> System:
    """The motor without a wrench."""
    return System(
        name="motor",
        title="Motor",
        states=tuple(Signal(name, name, "") for name in ("angle", "rate", "i")),
        inputs=(Signal("voltage", "u", "V"),),
        equations=replace(motor(load=True), w=(), d=()),
    )


SQUARE = System(
    name="square",
    title="Square",
    states=(Signal("one", "x₁", "m"), Signal("two", "x₂", "m/s"), Signal("three", "x₃", "rad")),
    inputs=(Signal("first", "u₁", "N"), Signal("second", "u₂", "N")),
    equations=COUPLED,
)


@dataclass(frozen=True, eq=False)
class Numbers(FeedbackParameters):
    """What the functions of error coordinates read."""


def square_numbers() -> Numbers:
    return Numbers(Nothing(), Setpoints(0.2, -0.4), np.zeros((2, 3)))


@pytest.mark.parametrize("sign", [1, -1])
def test_error_coordinates_of_two_outputs_are_measured_from_both_references(sign: Any) -> None:
    error, p = ErrorCoordinates(SQUARE, setpoints(2, 1), sign), square_numbers()
    assert (error.size, error.inputs, error.units) == (3, 2, ("m", "m/s", "rad"))
    for x in np.random.default_rng(8).normal(0, 1, (10, 3)):
        expected = sign * np.array([x[0] - 0.2, x[1], x[2] + 0.4])
        np.testing.assert_array_equal(error.error_state(0.0, x, p), expected)
        np.testing.assert_allclose(error.place(0.0, expected, p), x, rtol=0, atol=1e-15)
        alpha, E = error.dynamics(0.0, x, p)
        assert (alpha.shape, E.shape) == ((2,), (2, 2))
        np.testing.assert_allclose(alpha, sign * np.array([x[0] * x[2], x[1] - x[2]]), rtol=1e-15)
        by_hand = [[2 + math.sin(x[2]), x[0]], [1, 3 + x[1] * x[1]]]
        np.testing.assert_allclose(E, sign * np.array(by_hand), rtol=1e-15)
    time, x = np.linspace(0, 1, 5), np.random.default_rng(9).normal(0, 1, (5, 3))
    z = error.along(time, x, p)
    for row, t, at in zip(z, time.tolist(), x, strict=True):
        np.testing.assert_array_equal(row, error.error_state(t, at, p))


def test_jacobian_of_two_outputs_is_that_of_the_plant() -> None:
    """About x = (0.2, 0, 0): x1 x3 has the slopes (0, 0, 0.2), x2 - x3 (0, 1, -1)."""
    numbers = Numbers(Nothing(), Setpoints(0.2, 0.0), np.zeros((2, 3)))
    plant = AnalyticPlant(SQUARE, Nothing())
    A, B = ErrorCoordinates(SQUARE, setpoints(2, 1)).linear_model(plant, numbers)
    np.testing.assert_allclose(A, [[0, 1, 0], [0, 0, 0.2], [0, 1, -1]], rtol=0, atol=1e-8)
    np.testing.assert_allclose(B, [[0, 0], [2, 0.2], [1, 3]], rtol=0, atol=1e-8)


def test_units_of_outputs_that_are_no_states_are_those_of_their_derivatives() -> None:
    error = ErrorCoordinates(SQUARE, setpoints(2, 1), outputs=CURVED, unit="m")
    assert error.units == ("m", "m/s", "m")
    outputs = (sp.sinh(sp.Symbol("angle")),)
    curved = ErrorCoordinates(motor_system(), setpoints(3), outputs=outputs, unit="m")
    assert curved.units == ("m", "m/s", "m/s²")


@pytest.mark.parametrize(("system", "sign"), [(SERVO, -1), (CART_PENDULUM, 1), (ARM, 1)])
def test_error_moves_as_the_true_plant_makes_it(system: System, sign: Any) -> None:
    """z' on a plant with half of its parameters again as large, for a law that knows nothing of it.

    The reference is y_r = 2 + 3 t + 4 t^2, so y_r' = 3 + 8 t and y_r'' = 8.
    """
    y_r = 2 + 3 * TIME + 4 * TIME**2
    error, by_hand = ErrorCoordinates(system, reference([y_r]), sign), HAND_WRITTEN[system.name]
    velocity, random = system.output + system.degrees_of_freedom, np.random.default_rng(10)
    believed = plant(system.name).parameters
    p = FeedbackParameters(believed, Nothing(), np.zeros((1, 2)))
    name = {"servo": "J", "cart_pendulum": "m", "arm": "m"}[system.name]
    true = replace(believed, **{name: 1.5 * getattr(believed, name)})
    for x in states(system.name, 10):
        w, t = random.normal(0, 1, 6 * len(system.bodies)), 0.7
        for wrench in (w, None):
            w_of = None if wrench is None else wrench[None]
            true_plant = AnalyticPlant(system, true)
            motion = error.error_dynamics([t], x[None], p, true_plant, w_of)
            drift, gain = motion[0][0], motion[1][0]
            assert (drift.shape, gain.shape) == ((2,), (2, 1))
            pushed = 0.0 if wrench is None else by_hand.disturbance(x, w, true)[velocity]
            fallen = by_hand.drift(x, true)[velocity]
            expected = sign * np.array([x[velocity] - 3 - 8 * t, fallen + pushed - 8])
            np.testing.assert_allclose(drift, expected, rtol=0, atol=1e-11)
            by_input = [[0], [sign * by_hand.input_matrix(x, true)[velocity]]]
            np.testing.assert_allclose(gain, by_input, rtol=1e-14)
            # In mechanics the rows without an input are kinematics, which nothing touches.
            unmatched = error.unmatched(np.array(error.error_state(t, x, p)), drift)
            np.testing.assert_allclose(unmatched, [0], rtol=0, atol=1e-12)


def test_uncertain_kinematics_are_not_matched() -> None:
    """T of the motor knows J: on a motor of another inertia y'' is not what z3 says."""
    third, angle = motor_system(), np.array([0.2, 1.5, -0.4])
    error = ErrorCoordinates(third, setpoints(3))
    p = FeedbackParameters(Motor(), Setpoint(0.0), np.zeros((1, 3)))
    motion = error.error_dynamics([0.0], angle[None], p, AnalyticPlant(third, Motor(J=0.04)))
    drift, gain = motion[0][0], motion[1][0]
    force = 0.7 * -0.4 - 0.1 * 1.5
    np.testing.assert_allclose(drift[:2], [1.5, force / 0.04], rtol=1e-13)
    np.testing.assert_allclose(gain, [[0], [0], [0.7 / 0.02 / 0.05]], rtol=1e-13)
    expected = [0, force / 0.04 - force / 0.02]
    z = np.array(error.error_state(0.0, angle, p))
    np.testing.assert_allclose(error.unmatched(z, drift), expected, atol=1e-12)
    certain, _ = error.error_dynamics([0.0], angle[None], p, AnalyticPlant(third, Motor()))
    np.testing.assert_allclose(error.unmatched(z, certain[0]), [0, 0], atol=1e-12)


def test_place_is_the_inverse_of_the_error_state() -> None:
    """On a plant of which z leaves a part out, that part is at rest."""
    error = ErrorCoordinates(CART_PENDULUM, setpoints(2))
    p = FeedbackParameters(plant("cart_pendulum").parameters, Setpoint(0.3), np.zeros((1, 2)))
    x = error.place(0.0, [0.1, -0.7], p)
    np.testing.assert_allclose(x, [0, 0.4, 0, -0.7], rtol=1e-15)
    np.testing.assert_allclose(error.error_state(0.0, x, p), [0.1, -0.7], rtol=1e-15)
