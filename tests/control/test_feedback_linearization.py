"""Feedback linearization, eqs. (21)-(25) and (41)-(46), by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hand_written import HAND_WRITTEN

from grosmc_mj.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.references import Setpoint, Setpoints, setpoints
from grosmc_mj.control.task import FeedbackParameters, NoNumbers
from grosmc_mj.errors import PremiseError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ARM, CART_PENDULUM, AnalyticPlant, Signal, System, find_system
from grosmc_mj.plants.equations import Equations

PENDULUM = MujocoPlant.load("cart_pendulum").analytic().parameters


@pytest.mark.parametrize("name", ["servo", "cart_pendulum", "arm"])
def test_three_plants_have_relative_degree_two(name: str) -> None:
    """T = [y, y'], K = L_f^2 h is the row of f and E that of g in which y'' is."""
    system, random = find_system(name), np.random.default_rng(0)
    chains, n = feedback_linearization(system.equations), system.degrees_of_freedom
    velocity = system.output + n
    assert (chains.relative_degree, chains.plain) == ((2,), [system.output, velocity])
    assert (chains.A.tolist(), chains.B.tolist()) == ([[0, 1], [0, 0]], [[0], [1]])
    assert (chains.first_rows, chains.last_rows) == ((0,), (1,))
    assert chains.complete is (name != "cart_pendulum")
    p, hand = MujocoPlant.load(name).analytic().parameters, HAND_WRITTEN[name]
    for _ in range(20):  # E is regular: |angle| < 1.4
        x = np.concatenate([random.uniform(-1.4, 1.4, n), random.normal(0, 3, n)])
        assert chains.transformation(x, p) == (x[system.output], x[velocity])
        (K,), E = chains.nonlinearity(x, p), chains.decoupling_matrix(x, p)
        assert pytest.approx(hand.drift(x, p)[velocity], rel=0, abs=1e-14 * hand.size(x, p)) == K
        assert pytest.approx(hand.input_matrix(x, p)[velocity], rel=1e-14) == E[0]


# A plant of the third order, and one with two coupled inputs


def motor(*, load: bool) -> Equations:
    """J w' = Kt i - B w, L i' = u - R i - Kt w, and a load torque on the shaft or a voltage."""
    angle, rate, i, w, J, B, Kt, L, R = sp.symbols("angle rate i w J B Kt L R")
    return Equations(
        x=(angle, rate, i), f=(rate, (Kt * i - B * rate) / J, -(R * i + Kt * rate) / L),
        g=(0, 0, 1 / L), h=(angle,), w=(w,), d=(0, -w / J, 0) if load else (0, 0, w / L),
    )  # fmt: skip


MOTOR = SimpleNamespace(J=0.02, B=0.1, Kt=0.7, L=0.05, R=1.3)


def test_motor_with_inductance_is_a_chain_of_three() -> None:
    """Its load is in the row of y'', where no input is: Assumption 5 fails for it."""
    chains, p = feedback_linearization(motor(load=True)), MOTOR
    assert (chains.relative_degree, chains.complete) == ((3,), True)
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
        by_load, by_voltage = (0, -0.3 / p.J, 0.3 * p.B / p.J**2), (0, 0, 0.3 * p.Kt / p.J / p.L)
        for load, expected in ((True, by_load), (False, by_voltage)):
            slope = np.reshape(feedback_linearization(motor(load=load)).slope(x, p), (3, 3))
            pushed = slope @ np.array(motor(load=load).disturbance(x, np.array([0.3]), p))
            np.testing.assert_allclose(pushed, expected, rtol=1e-13)


X1, X2, X3 = sp.symbols("x1 x2 x3", real=True)
E1, E2 = sp.Matrix([[2 + sp.sin(X3), X1]]), sp.Matrix([[1, 3 + X2**2]])
# y1'' = x1 x3 + (2 + sin x3) u1 + x1 u2, y2' = x2 - x3 + u1 + (3 + x2^2) u2.
COUPLED = Equations(
    x=(X1, X2, X3),
    f=(X2, X1 * X3, X2 - X3),
    g=((0, 0), tuple(E1.flat()), tuple(E2.flat())),
    h=(X1, X3),
)
CURVED = (sp.sinh(X1), sp.exp(X3))


@pytest.mark.parametrize(
    ("h", "degrees", "T", "K", "E"),
    [
        ((X3, X1), (1, 2), (X3, X1, X2), (X2 - X3, X1 * X3), (E2, E1)),
        # Outputs that are no states are differentiated by the chain rule.
        (CURVED, (2, 1), (sp.sinh(X1), X2 * sp.cosh(X1), sp.exp(X3)),
         (sp.sinh(X1) * X2**2 + sp.cosh(X1) * X1 * X3, sp.exp(X3) * (X2 - X3)),
         (sp.cosh(X1) * E1, sp.exp(X3) * E2)),
    ],
)  # fmt: skip
def test_coupled_plant_has_the_relative_degrees_and_matrices_by_hand(
    h: Any, degrees: Any, T: Any, K: Any, E: Any
) -> None:
    """Unequal relative degrees; the order of the outputs is the order of the chains."""
    chains = feedback_linearization(COUPLED, h)
    assert (chains.relative_degree, chains.T, chains.complete) == (degrees, T, True)
    assert [sp.simplify(a - b) for a, b in zip(chains.K, K, strict=True)] == [0, 0]
    assert sp.simplify(chains.E - sp.Matrix.vstack(*E)) == sp.zeros(2)
    determinant = (2 + sp.sin(X3)) * (3 + X2**2) - X1
    assert h is CURVED or sp.simplify(chains.singularity / determinant) in (1, -1)
    first, last = ((0, 2), (1, 2)) if degrees == (2, 1) else ((0, 1), (0, 2))
    assert (chains.first_rows, chains.last_rows) == (first, last)
    A, B = np.zeros((3, 3)), np.zeros((3, 2))
    A[first[degrees.index(2)], last[degrees.index(2)]] = 1
    B[list(last), [0, 1]] = 1
    np.testing.assert_array_equal(chains.A, A)
    np.testing.assert_array_equal(chains.B, B)
    for x in np.random.default_rng(7).uniform(-1.5, 1.5, (10, 3)):
        z = np.array(chains.transformation(x, None))
        np.testing.assert_allclose(chains.place(z, None, np.zeros(3)), x, rtol=0, atol=1e-9)


def test_zero_dynamics_have_the_zeros_and_hold_what_the_input_holds() -> None:
    a, states, p = sp.Symbol("a"), CART_PENDULUM.equations.x, SimpleNamespace(a=3.0)
    # y = x1 + x2 has (s - a + 1) / (s (s - a)), y = x1 has 1/s.
    linear = Equations(x=(X1, X2), f=(0, a * X2 + X1), g=(1, 0), h=(X1,))
    # Holding y = x1 takes u = -x2^2, so x2' = -x2^3 - x2^2.
    cubic = Equations(x=(X1, X2), f=(X2**2, -(X2**3)), g=(1, 1), h=(X1,))
    # p' = speed, speed' = 0: the chapter's z leaves the cart out, with two poles at zero.
    for equations, h, inside, rates, poles in (
        (CART_PENDULUM.equations, None, states[::2], (states[2], 0), [0, 0]),
        (linear, [X1], (X2,), (a * X2,), [3.0]),
        (cubic, None, (X2,), (-(X2**3) - X2**2,), [0]),
    ):
        inner: Any = feedback_linearization(equations, h).zero_dynamics()
        np.testing.assert_allclose(inner.poles(p), poles, rtol=1e-14)
        assert inner.states == inside
        assert (sp.Matrix(inner.rates) - sp.Matrix(rates)).expand().is_zero_matrix
    inner = feedback_linearization(linear, [X1 + X2]).zero_dynamics()
    np.testing.assert_allclose(inner.poles(p), [2.0], rtol=1e-14)
    for equations in (ARM.equations, motor(load=True), COUPLED):
        assert feedback_linearization(equations).zero_dynamics() is None


# A state with given outputs

ANGLE = sp.Symbol("theta")


def test_guess_is_kept_where_the_outputs_leave_it_free_and_chooses_among_states() -> None:
    """sin(theta) = 1/2 at 30 and at 150 degrees; the cart stays where the guess has it."""
    guess, p = np.array([1.0, 2.0, 3.0, 4.0]), PENDULUM
    plain = feedback_linearization(CART_PENDULUM.equations)
    x = plain.place(np.array([0.1, 0.2]), None, guess)
    assert (x.tolist(), guess.tolist()) == ([1.0, 0.1, 3.0, 0.2], [1, 2, 3, 4])
    height = feedback_linearization(CART_PENDULUM.equations, [sp.sin(ANGLE)])
    for near, angle in ((0.0, math.pi / 6), (3.0, 5 * math.pi / 6)):
        x = height.place(np.array([0.5, 0.3]), p, np.array([7.0, near, -2.0, 0.0]))
        expected = [7.0, angle, -2.0, 0.3 / math.cos(angle)]
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-9)
    # Without a guess what z leaves out is at rest.
    error = ErrorCoordinates(CART_PENDULUM, setpoints(2))
    x = error.place(0.0, [0.1, -0.7], numbers(p, Setpoint(0.3)))
    np.testing.assert_allclose(x, [0, 0.4, 0, -0.7], rtol=1e-15)


def test_outputs_that_no_state_has_are_refused() -> None:
    """No angle has the sine 1.5; sqrt(x1) is no number for x1 < 0, where the root finder steps."""
    root = Equations(x=(X1,), f=(0,), g=((1,),), h=(sp.sqrt(X1),))
    for equations, h, z in (
        (CART_PENDULUM.equations, [sp.sin(ANGLE)], [1.5, 0.0]),
        (root, None, [-0.5]),
    ):
        chains, p = feedback_linearization(equations, h), PENDULUM
        with pytest.raises(PremiseError, match=r"no state near \[0\.1.*\] has z = \["):
            chains.place(np.array(z), p, np.full(len(equations.x), 0.1))


def test_a_matrix_is_singular_at_a_state_in_any_units() -> None:
    a, b = sp.symbols("a b")
    equations = Equations(x=(a, b), f=(0, 0), g=((1e6, 0), (0, 1e-8 * sp.cos(b))), h=(a, b))
    chains = feedback_linearization(equations)
    chains.require_regular(np.zeros(2), None)
    with pytest.raises(PremiseError, match=r"is singular there \(eq\. \(21\)\)"):
        chains.require_regular(np.array([0.0, math.pi / 2]), None)


# Error coordinates of such outputs


def signals(*units: str) -> tuple[Signal, ...]:
    return tuple(Signal(f"signal {i}", f"s{i}", unit) for i, unit in enumerate(units))


def numbers(p: Any, reference: Any, size: int = 2) -> FeedbackParameters:
    return FeedbackParameters(p, reference, np.zeros((1, size)))


SQUARE = System(
    name="square", title="A system", states=signals("m", "m/s", "rad"), inputs=signals("N", "N"),
    equations=COUPLED,
)  # fmt: skip
THIRD_ORDER = System(
    name="motor", title="A system", states=signals("", "", ""), inputs=signals("V"),
    equations=replace(motor(load=True), w=(), d=()),
)  # fmt: skip


@pytest.mark.parametrize("sign", [1, -1])
def test_error_coordinates_of_two_outputs_are_measured_from_both_references(sign: Any) -> None:
    error, random = ErrorCoordinates(SQUARE, setpoints(2, 1), sign), np.random.default_rng(8)
    p, states = numbers(NoNumbers(), Setpoints(0.2, -0.4)), random.normal(size=(5, 3))
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
    # About x = (0.2, 0, 0): x1 x3 has the slopes (0, 0, 0.2), x2 - x3 (0, 1, -1).
    about = numbers(NoNumbers(), Setpoints(0.2, 0.0))
    A, B = error.linear_model(AnalyticPlant(SQUARE, NoNumbers()), about)
    np.testing.assert_allclose(A, [[0, 1, 0], [0, 0, 0.2], [0, 1, -1]], rtol=0, atol=1e-8)
    np.testing.assert_allclose(B, sign * np.array([[0, 0], [2, 0.2], [1, 3]]), rtol=0, atol=1e-8)


def test_uncertain_kinematics_are_not_matched() -> None:
    """T of the motor knows J: on a motor of another inertia y'' is not what z3 says."""
    error, x = ErrorCoordinates(THIRD_ORDER, setpoints(3)), np.array([0.2, 1.5, -0.4])
    p, force = numbers(MOTOR, Setpoint(0.0), 3), 0.7 * -0.4 - 0.1 * 1.5
    for J in (0.02, 0.04):
        true = AnalyticPlant(THIRD_ORDER, SimpleNamespace(**{**vars(MOTOR), "J": J}))
        (drift,), (gain,) = error.error_dynamics([0.0], x[None], p, true)
        np.testing.assert_allclose(drift[:2], [1.5, force / J], rtol=1e-13)
        np.testing.assert_allclose(gain, [[0], [0], [0.7 / 0.02 / 0.05]], rtol=1e-13)
        unmatched = error.unmatched(error.error_state(0.0, x, p), drift)
        np.testing.assert_allclose(unmatched, [0, force / J - force / 0.02], atol=1e-12)
    # Units of outputs that are no states are those of their derivatives.
    outputs = (sp.sinh(sp.Symbol("angle")),)
    curved = ErrorCoordinates(THIRD_ORDER, setpoints(3), outputs=outputs, unit="m")
    assert curved.units == ("m", "m/s", "m/s²")
