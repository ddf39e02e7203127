"""Feedback linearization, eqs. (21)-(25) and (41)-(46), by hand."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hand_written import HAND_WRITTEN

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.feedback_linearization import (
    feedback_linearization,
)
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.references import TIME, Setpoint, Setpoints, reference, setpoints
from grosmc_mj.control.task import FeedbackParameters
from grosmc_mj.errors import PremiseError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ARM, CART_PENDULUM, SERVO, AnalyticPlant, Signal, System, find_system
from grosmc_mj.plants.equations import Equations

VARIANTS = [(name, variant) for name in HAND_WRITTEN for variant in find_system(name).variants]


@cache
def plant(name: str, variant: Any = "corrected") -> AnalyticPlant:
    return MujocoPlant.load(name).analytic(variant)


def states(name: str, count: int) -> Array:
    """Random states where E is regular: |angle| < 1.4, rates of 3 [rad/s, m/s]."""
    n, random = find_system(name).degrees_of_freedom, np.random.default_rng(0)
    return np.hstack([random.uniform(-1.4, 1.4, (count, n)), random.normal(0, 3, (count, n))])


@pytest.mark.parametrize(("name", "variant"), VARIANTS)
def test_three_plants_have_relative_degree_two_and_the_hand_written_K_and_E(
    name: str, variant: Any
) -> None:
    """T = [y, y'], K = L_f^2 h is the row of f and E that of g in which y'' is."""
    system, by_hand, p = find_system(name), HAND_WRITTEN[name], plant(name, variant).parameters
    chains, velocity = feedback_linearization(system.equations), system.output
    velocity += system.degrees_of_freedom
    assert chains.relative_degree == (2,)
    assert chains.plain == [system.output, velocity]
    np.testing.assert_array_equal(chains.A, [[0, 1], [0, 0]])
    np.testing.assert_array_equal(chains.B, [[0], [1]])
    assert (chains.first_rows, chains.last_rows) == ((0,), (1,))
    assert chains.complete is (name != "cart_pendulum")
    for x in states(name, 50):
        assert chains.transformation(x, p) == (x[system.output], x[velocity])
        (K,), (E,) = chains.nonlinearity(x, p), chains.decoupling_matrix(x, p)
        size = by_hand.size(x, p)
        assert pytest.approx(by_hand.drift(x, p)[velocity], rel=0, abs=1e-14 * size) == K
        assert pytest.approx(by_hand.input_matrix(x, p)[velocity], rel=1e-14) == E
        if name == "cart_pendulum":  # E fades where the pole lies, and turns round beyond
            lying = np.array([0.0, 2.1 * x[1], 0.0, 0.0])
            assert np.sign(chains.decoupling_matrix(lying, p)) == np.sign(math.cos(lying[1]))


# Plants of the third order: a DC motor with its inductance, and two coupled inputs


@dataclass(frozen=True)
class Motor:
    """J w' = Kt i - B w, L i' = u - R i - Kt w."""

    J: float = 0.02
    B: float = 0.1
    Kt: float = 0.7
    L: float = 0.05
    R: float = 1.3


def motor(*, load: bool) -> Equations:
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
    chains, p = feedback_linearization(motor(load=True)), Motor()
    assert chains.relative_degree == (3,)
    assert chains.complete
    np.testing.assert_array_equal(chains.A, np.eye(3, k=1))
    np.testing.assert_array_equal(chains.B, [[0], [0], [1]])
    for x in np.random.default_rng(3).normal(0, 2, (12, 3)):
        angle, rate, i = x
        acceleration = (p.Kt * i - p.B * rate) / p.J
        jerk = (p.Kt * -(p.R * i + p.Kt * rate) / p.L - p.B * acceleration) / p.J
        z = np.array([angle, rate, acceleration])
        np.testing.assert_allclose(chains.transformation(x, p), z, rtol=1e-13)
        terms = abs(p.Kt * p.R * i / p.L / p.J) + abs(p.B * acceleration / p.J)
        assert chains.nonlinearity(x, p)[0] == pytest.approx(jerk, rel=0, abs=1e-13 * terms)
        assert chains.decoupling_matrix(x, p)[0] == pytest.approx(p.Kt / p.J / p.L, rel=1e-15)
        np.testing.assert_allclose(chains.place(z, p, np.zeros(3)), x, rtol=0, atol=1e-9)


def test_load_of_the_motor_is_not_matched_and_its_voltage_is() -> None:
    """The load is in the row of y'', where no input is: Assumption 5 fails for it."""
    p, x, w = Motor(), np.array([0.2, 1.5, -0.4]), np.array([0.3])
    by_load = (0, -0.3 / p.J, 0.3 * p.B / p.J**2)
    for load, expected in ((True, by_load), (False, (0, 0, 0.3 * p.Kt / p.J / p.L))):
        equations = motor(load=load)
        slope = np.reshape(feedback_linearization(equations).slope(x, p), (3, 3))
        pushed = slope @ np.array(equations.disturbance(x, w, p))
        np.testing.assert_allclose(pushed, expected, rtol=1e-13)


X1, X2, X3 = sp.symbols("x1 x2 x3", real=True)
COUPLED = Equations(
    x=(X1, X2, X3),
    f=(X2, X1 * X3, X2 - X3),
    g=((0, 0), (2 + sp.sin(X3), X1), (1, 3 + X2**2)),
    h=(X1, X3),
)
E1, E2 = sp.Matrix([[2 + sp.sin(X3), X1]]), sp.Matrix([[1, 3 + X2**2]])
CURVED = (sp.sinh(X1), sp.exp(X3))


@dataclass(frozen=True)
class Nothing:
    """No parameters."""


@pytest.mark.parametrize(
    ("h", "degrees", "T", "K", "E"),
    [
        # y1'' = x1 x3 + (2 + sin x3) u1 + x1 u2, y2' = x2 - x3 + u1 + (3 + x2^2) u2.
        ((X1, X3), (2, 1), (X1, X2, X3), (X1 * X3, X2 - X3), (E1, E2)),
        ((X3, X1), (1, 2), (X3, X1, X2), (X2 - X3, X1 * X3), (E2, E1)),
        # Outputs that are no states are differentiated by the chain rule.
        (
            CURVED,
            (2, 1),
            (sp.sinh(X1), X2 * sp.cosh(X1), sp.exp(X3)),
            (sp.sinh(X1) * X2**2 + sp.cosh(X1) * X1 * X3, sp.exp(X3) * (X2 - X3)),
            (sp.cosh(X1) * E1, sp.exp(X3) * E2),
        ),
    ],
)
def test_coupled_plant_has_the_relative_degrees_and_matrices_by_hand(
    h: Any, degrees: Any, T: Any, K: Any, E: Any
) -> None:
    """Unequal relative degrees; the order of the outputs is the order of the chains."""
    chains = feedback_linearization(COUPLED, h)
    assert (chains.relative_degree, chains.T, chains.complete) == (degrees, T, True)
    assert [sp.simplify(a - b) for a, b in zip(chains.K, K, strict=True)] == [0, 0]
    assert sp.simplify(chains.E - sp.Matrix.vstack(*E)) == sp.zeros(2)
    determinant = (2 + sp.sin(X3)) * (3 + X2**2) - X1
    ratio = sp.simplify(chains.singularity / determinant)
    assert ratio in (1, -1) or h is CURVED
    first, last = ((0, 2), (1, 2)) if degrees == (2, 1) else ((0, 1), (0, 2))
    assert (chains.first_rows, chains.last_rows) == (first, last)
    A, B = np.zeros((3, 3)), np.zeros((3, 2))
    A[first[degrees.index(2)], last[degrees.index(2)]] = 1
    B[list(last), [0, 1]] = 1
    np.testing.assert_array_equal(chains.A, A)
    np.testing.assert_array_equal(chains.B, B)
    for x in np.random.default_rng(7).uniform(-1.5, 1.5, (10, 3)):
        z = np.array(chains.transformation(x, Nothing()))
        placed = chains.place(z, Nothing(), np.zeros(3))
        np.testing.assert_allclose(placed, x, rtol=0, atol=1e-9)


# Zero dynamics

A, PENDULUM_STATES = sp.Symbol("a"), CART_PENDULUM.equations.x
# y = x1 + x2 has (s - a + 1) / (s (s - a)), y = x1 has 1/s.
LINEAR = Equations(x=(X1, X2), f=(0, A * X2 + X1), g=(1, 0), h=(X1,))
# Holding y = x1 takes u = -x2^2, so x2' = -x2^3 - x2^2.
CUBIC = Equations(x=(X1, X2), f=(X2**2, -(X2**3)), g=(1, 1), h=(X1,))


@pytest.mark.parametrize(
    ("equations", "h", "states", "rates", "poles"),
    [
        # p' = speed, speed' = 0: the chapter's z leaves the cart out, with two poles at zero.
        (
            CART_PENDULUM.equations,
            None,
            (PENDULUM_STATES[0], PENDULUM_STATES[2]),
            (PENDULUM_STATES[2], 0),
            [0, 0],
        ),
        (LINEAR, [X1 + X2], None, None, [2.0]),
        (LINEAR, [X1], (X2,), (A * X2,), [3.0]),
        (CUBIC, None, (X2,), (-(X2**3) - X2**2,), [0]),
    ],
)
def test_zero_dynamics_have_the_zeros_and_hold_what_the_input_holds(
    equations: Equations, h: Any, states: Any, rates: Any, poles: Any
) -> None:
    inner = feedback_linearization(equations, h).zero_dynamics()
    assert inner is not None
    if states is not None:
        assert inner.states == states
        assert [sp.expand(a - b) for a, b in zip(inner.rates, rates, strict=True)] == [0] * len(
            rates
        )
    p = SimpleNamespace(a=3.0)
    np.testing.assert_allclose(inner.poles(p), poles, rtol=1e-14)


@pytest.mark.parametrize("equations", [SERVO.equations, ARM.equations, motor(load=True), COUPLED])
def test_outputs_that_see_all_of_the_plant_leave_no_zero_dynamics(equations: Equations) -> None:
    assert feedback_linearization(equations).zero_dynamics() is None


# A state with given outputs


def test_guess_is_kept_where_the_outputs_leave_it_free_and_chooses_among_states() -> None:
    """sin(theta) = 1/2 at 30 and at 150 degrees; the cart stays where the guess has it."""
    guess = np.array([1.0, 2.0, 3.0, 4.0])
    plain = feedback_linearization(CART_PENDULUM.equations)
    x = plain.place(np.array([0.1, 0.2]), None, guess)
    np.testing.assert_array_equal(x, [1.0, 0.1, 3.0, 0.2])
    np.testing.assert_array_equal(guess, [1, 2, 3, 4])
    height = feedback_linearization(CART_PENDULUM.equations, [sp.sin(sp.Symbol("theta"))])
    p, z = plant("cart_pendulum").parameters, np.array([0.5, 0.3])
    for near, angle in ((0.0, math.pi / 6), (3.0, 5 * math.pi / 6)):
        x = height.place(z, p, np.array([7.0, near, -2.0, 0.0]))
        expected = [7.0, angle, -2.0, 0.3 / math.cos(angle)]
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("equations", "h", "p", "z"),
    [
        # No angle has this sine.
        (CART_PENDULUM.equations, sp.sin(sp.Symbol("theta")), plant("cart_pendulum"), [1.5, 0.0]),
        (COUPLED, CURVED, None, [0.1, 0.2, -1e9]),
        (COUPLED, CURVED, None, [0.1, 0.2, -1e-6]),
        # y = sqrt(x1) is no number for x1 < 0, where the root finder steps.
        (Equations(x=(X1,), f=(0,), g=((1,),), h=(X1,)), sp.sqrt(X1), None, [-0.5]),
    ],
)
def test_outputs_that_no_state_has_are_refused(equations: Any, h: Any, p: Any, z: Any) -> None:
    chains = feedback_linearization(equations, h if isinstance(h, tuple) else [h])
    guess = np.full(len(equations.x), 0.1)
    with pytest.raises(PremiseError, match=r"no state near \[0\.1.*\] has z = \["):
        chains.place(np.array(z), p and p.parameters, guess)


@pytest.mark.parametrize("scales", [(1, 1), (1e6, 1e-8), (1e-8, 1e6)])
def test_a_matrix_is_singular_at_a_state_in_any_units(scales: tuple[float, float]) -> None:
    """E = diag(c1, c2 cos b): regular wherever b is no quarter of a turn."""
    a, b = sp.symbols("a b")
    g = ((scales[0], 0), (0, scales[1] * sp.cos(b)))
    chains = feedback_linearization(Equations(x=(a, b), f=(0, 0), g=g, h=(a, b)))
    chains.require_regular(np.zeros(2), None)
    with pytest.raises(PremiseError, match=r"is singular there \(eq\. \(21\)\)"):
        chains.require_regular(np.array([0.0, math.pi / 2]), None)


# Error coordinates of such outputs

SQUARE = System(
    name="square",
    title="Square",
    states=(Signal("one", "x₁", "m"), Signal("two", "x₂", "m/s"), Signal("three", "x₃", "rad")),
    inputs=(Signal("first", "u₁", "N"), Signal("second", "u₂", "N")),
    equations=COUPLED,
)
THIRD_ORDER = System(
    name="motor",
    title="Motor",
    states=tuple(Signal(name, name, "") for name in ("angle", "rate", "i")),
    inputs=(Signal("voltage", "u", "V"),),
    equations=replace(motor(load=True), w=(), d=()),
)


def numbers(p: Any, reference: Any, size: int = 2) -> FeedbackParameters:
    return FeedbackParameters(p, reference, np.zeros((1, size)))


@pytest.mark.parametrize("sign", [1, -1])
def test_error_coordinates_of_two_outputs_are_measured_from_both_references(sign: Any) -> None:
    error = ErrorCoordinates(SQUARE, setpoints(2, 1), sign)
    p, states = (
        numbers(Nothing(), Setpoints(0.2, -0.4)),
        np.random.default_rng(8).normal(size=(5, 3)),
    )
    assert (error.size, error.inputs, error.units) == (3, 2, ("m", "m/s", "rad"))
    for x, z in zip(states, error.along(np.linspace(0, 1, 5), states, p), strict=True):
        expected = sign * np.array([x[0] - 0.2, x[1], x[2] + 0.4])
        np.testing.assert_array_equal(z, expected)
        np.testing.assert_array_equal(error.error_state(0.0, x, p), expected)
        np.testing.assert_allclose(error.place(0.0, expected, p), x, rtol=0, atol=1e-15)
        alpha, E = error.dynamics(0.0, x, p)
        np.testing.assert_allclose(alpha, sign * np.array([x[0] * x[2], x[1] - x[2]]), rtol=1e-15)
        by_hand = [[2 + math.sin(x[2]), x[0]], [1, 3 + x[1] * x[1]]]
        np.testing.assert_allclose(E, sign * np.array(by_hand), rtol=1e-15)
        # The feedback makes z_i^(r_i) = v_i of it, and gives v back.
        v, u, back = np.array([0.7, -1.3]), np.zeros(2), np.zeros(2)
        memory = SimpleNamespace(undefined=0.0)
        error.feedback(0.0, x, v, memory, p, u)
        np.testing.assert_allclose(alpha + E @ u, v, rtol=0, atol=1e-12)
        error.virtual_input(0.0, x, u, memory, p, back)
        np.testing.assert_allclose(back, v, rtol=0, atol=1e-12)


def test_jacobian_of_two_outputs_is_that_of_the_plant() -> None:
    """About x = (0.2, 0, 0): x1 x3 has the slopes (0, 0, 0.2), x2 - x3 (0, 1, -1)."""
    error, p = ErrorCoordinates(SQUARE, setpoints(2, 1)), numbers(Nothing(), Setpoints(0.2, 0.0))
    A, B = error.linear_model(AnalyticPlant(SQUARE, Nothing()), p)
    np.testing.assert_allclose(A, [[0, 1, 0], [0, 0, 0.2], [0, 1, -1]], rtol=0, atol=1e-8)
    np.testing.assert_allclose(B, [[0, 0], [2, 0.2], [1, 3]], rtol=0, atol=1e-8)


def test_units_of_outputs_that_are_no_states_are_those_of_their_derivatives() -> None:
    outputs = (sp.sinh(sp.Symbol("angle")),)
    curved = ErrorCoordinates(THIRD_ORDER, setpoints(3), outputs=outputs, unit="m")
    assert curved.units == ("m", "m/s", "m/s²")


@pytest.mark.parametrize(
    ("system", "sign", "name"), [(SERVO, -1, "J"), (CART_PENDULUM, 1, "m"), (ARM, 1, "m")]
)
def test_error_moves_as_the_true_plant_makes_it(system: System, sign: Any, name: str) -> None:
    """z' on a plant with half of a parameter again as large, which the law doesn't know, eq. (24).

    The reference is y_r = 2 + 3 t + 4 t^2, so y_r' = 3 + 8 t and y_r'' = 8.
    """
    error = ErrorCoordinates(system, reference([2 + 3 * TIME + 4 * TIME**2]), sign)
    by_hand, velocity = HAND_WRITTEN[system.name], system.output + system.degrees_of_freedom
    nominal, t, random = plant(system.name), 0.7, np.random.default_rng(10)
    p, true = numbers(nominal.parameters, Nothing()), nominal.changed(scales={name: 1.5})
    for x in states(system.name, 10):
        w = random.normal(0, 1, 6 * len(system.bodies))
        for wrench in (w, None):
            rows = None if wrench is None else wrench[None]
            (drift,), (gain,) = error.error_dynamics([t], x[None], p, true, rows)
            rate = by_hand.drift(x, true.parameters)[velocity]
            if wrench is not None:
                rate += by_hand.disturbance(x, w, true.parameters)[velocity]
            expected = sign * np.array([x[velocity] - 3 - 8 * t, rate - 8])
            np.testing.assert_allclose(drift, expected, rtol=0, atol=1e-11)
            by_input = [[0], [sign * by_hand.input_matrix(x, true.parameters)[velocity]]]
            np.testing.assert_allclose(gain, by_input, rtol=1e-14)
            # In mechanics the rows without an input are kinematics, which nothing touches.
            unmatched = error.unmatched(error.error_state(t, x, p), drift)
            np.testing.assert_allclose(unmatched, [0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("J", [0.02, 0.04])
def test_uncertain_kinematics_are_not_matched(J: float) -> None:
    """T of the motor knows J: on a motor of another inertia y'' is not what z3 says."""
    error, x = ErrorCoordinates(THIRD_ORDER, setpoints(3)), np.array([0.2, 1.5, -0.4])
    p, true = numbers(Motor(), Setpoint(0.0), 3), AnalyticPlant(THIRD_ORDER, Motor(J=J))
    (drift,), (gain,) = error.error_dynamics([0.0], x[None], p, true)
    force = 0.7 * -0.4 - 0.1 * 1.5
    np.testing.assert_allclose(drift[:2], [1.5, force / J], rtol=1e-13)
    np.testing.assert_allclose(gain, [[0], [0], [0.7 / 0.02 / 0.05]], rtol=1e-13)
    unmatched = error.unmatched(error.error_state(0.0, x, p), drift)
    np.testing.assert_allclose(unmatched, [0, force / J - force / 0.02], atol=1e-12)


def test_place_is_the_inverse_of_the_error_state() -> None:
    """On a plant of which z leaves a part out, that part is at rest."""
    error = ErrorCoordinates(CART_PENDULUM, setpoints(2))
    p = numbers(plant("cart_pendulum").parameters, Setpoint(0.3))
    x = error.place(0.0, [0.1, -0.7], p)
    np.testing.assert_allclose(x, [0, 0.4, 0, -0.7], rtol=1e-15)
    np.testing.assert_allclose(error.error_state(0.0, x, p), [0.1, -0.7], rtol=1e-15)
