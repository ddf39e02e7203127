"""Feedback linearization, eqs. (21)-(25) and (41)-(46), by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import sympy as sp
from hand_written import HAND_WRITTEN

from grosmc_mj.ground.errors import PremiseError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.control.coordinates.feedback_linearization import (
    FeedbackLinearization,
    feedback_linearization,
)
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.references import Setpoint, Setpoints, setpoints
from grosmc_mj.theory.control.task import FeedbackParameters, NoNumbers
from grosmc_mj.theory.plants import ARM, CART_PENDULUM, AnalyticPlant, Signal, System, find_system
from grosmc_mj.theory.plants.equations import Equations

PENDULUM = MujocoPlant.load("cart_pendulum").analytic().parameters
each_system = pytest.mark.parametrize("name", ["servo", "cart_pendulum", "arm"])


@each_system
def test_three_plants_have_relative_degree_two(name: str) -> None:
    """T = [y, y']; z leaves the cart out, so it is all of the state of the others only."""
    system = find_system(name)
    chains = feedback_linearization(system.symbolic_equations)
    assert chains.relative_degree == (2,)
    assert chains.plain == [system.output, system.output + system.degrees_of_freedom]
    assert chains.A.tolist() == [[0, 1], [0, 0]]
    assert chains.B.tolist() == [[0], [1]]
    assert chains.first_rows == (0,)
    assert chains.last_rows == (1,)
    assert chains.complete is (name != "cart_pendulum")


@each_system
def test_feedback_linearization_is_the_row_of_the_acceleration(name: str) -> None:
    """K = L_f^2 h is the row of f and E that of g in which y'' is."""
    system = find_system(name)
    n = system.degrees_of_freedom
    velocity = system.output + n
    chains = feedback_linearization(system.symbolic_equations)
    p = MujocoPlant.load(name).analytic().parameters
    hand = HAND_WRITTEN[name]

    x = np.array([0.7, -1.3, 2.0, -4.0]) if n == 2 else np.array([-1.3, -4.0])
    rounding = 1e-14 * hand.size(x, p)
    assert chains.transformation(x, p) == (x[system.output], x[velocity])
    assert chains.nonlinearity(x, p) == pytest.approx([hand.drift(x, p)[velocity]], abs=rounding)
    E = hand.input_matrix(x, p)[velocity]
    assert chains.decoupling_matrix(x, p) == pytest.approx([E], rel=1e-14)


# A plant of the third order


def motor(*, load: bool) -> Equations:
    """J w' = Kt i - B w, L i' = u - R i - Kt w, and a load torque on the shaft or a voltage."""
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


MOTOR = SimpleNamespace(J=0.02, B=0.1, Kt=0.7, L=0.05, R=1.3)
# Angle, rate and current, with the acceleration, and the jerk without a voltage, by hand.
ANGLE, RATE, CURRENT = MOTOR_STATE = np.array([0.4, -2.1, 1.7])
ACCELERATION = (MOTOR.Kt * CURRENT - MOTOR.B * RATE) / MOTOR.J
CURRENT_RATE = -(MOTOR.R * CURRENT + MOTOR.Kt * RATE) / MOTOR.L
JERK = (MOTOR.Kt * CURRENT_RATE - MOTOR.B * ACCELERATION) / MOTOR.J


@pytest.fixture(scope="module")
def motor_chains() -> FeedbackLinearization:
    return feedback_linearization(motor(load=True))


def test_motor_with_inductance_is_a_chain_of_three(motor_chains: FeedbackLinearization) -> None:
    assert motor_chains.relative_degree == (3,)
    assert motor_chains.complete
    np.testing.assert_array_equal(motor_chains.A, np.eye(3, k=1))
    np.testing.assert_array_equal(motor_chains.B, [[0], [0], [1]])


def test_matrices_of_the_motor_are_those_by_hand(motor_chains: FeedbackLinearization) -> None:
    z = motor_chains.transformation(MOTOR_STATE, MOTOR)
    assert z == pytest.approx([ANGLE, RATE, ACCELERATION], rel=1e-13)
    assert motor_chains.nonlinearity(MOTOR_STATE, MOTOR) == pytest.approx([JERK], rel=1e-12)
    E = MOTOR.Kt / MOTOR.J / MOTOR.L
    assert motor_chains.decoupling_matrix(MOTOR_STATE, MOTOR) == pytest.approx([E], rel=1e-14)


def test_a_state_of_the_motor_is_found_from_its_outputs(
    motor_chains: FeedbackLinearization,
) -> None:
    placed = motor_chains.place(np.array([ANGLE, RATE, ACCELERATION]), MOTOR, np.zeros(3))
    np.testing.assert_allclose(placed, MOTOR_STATE, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (True, (0, -0.3 / MOTOR.J, 0.3 * MOTOR.B / MOTOR.J**2)),
        (False, (0, 0, 0.3 * MOTOR.Kt / MOTOR.J / MOTOR.L)),
    ],
    ids=["load", "voltage"],
)
def test_disturbances_of_the_motor_reach_z_as_by_hand(
    load: bool, expected: tuple[float, ...]
) -> None:
    """A load is in the row of y'', where no input is: Assumption 5 fails for it."""
    equations = motor(load=load)
    slope = np.reshape(feedback_linearization(equations).slope(MOTOR_STATE, MOTOR), (3, 3))
    disturbance = np.array(equations.disturbance(MOTOR_STATE, np.array([0.3]), MOTOR))
    np.testing.assert_allclose(slope @ disturbance, expected, rtol=1e-13)


# A plant with two coupled inputs

X1, X2, X3 = sp.symbols("x1 x2 x3", real=True)
E1 = sp.Matrix([[2 + sp.sin(X3), X1]])
E2 = sp.Matrix([[1, 3 + X2**2]])
# y1'' = x1 x3 + (2 + sin x3) u1 + x1 u2, y2' = x2 - x3 + u1 + (3 + x2^2) u2.
COUPLED = Equations(
    x=(X1, X2, X3),
    f=(X2, X1 * X3, X2 - X3),
    g=((0, 0), tuple(E1.flat()), tuple(E2.flat())),
    h=(X1, X3),
)


class Coupled(NamedTuple):
    """Outputs of the coupled plant with their feedback linearization by hand."""

    h: Any
    degrees: tuple[int, ...]
    first_rows: tuple[int, ...]
    last_rows: tuple[int, ...]
    T: Any
    K: Any
    E: Any
    A: Any
    B: Any

    @property
    def chains(self) -> FeedbackLinearization:
        return feedback_linearization(COUPLED, self.h)


SWAPPED = Coupled(
    h=(X3, X1),
    degrees=(1, 2),
    first_rows=(0, 1),
    last_rows=(0, 2),
    T=(X3, X1, X2),
    K=(X2 - X3, X1 * X3),
    E=(E2, E1),
    A=[[0, 0, 0], [0, 0, 1], [0, 0, 0]],
    B=[[1, 0], [0, 0], [0, 1]],
)
# Outputs that are no states are differentiated by the chain rule.
CURVED = Coupled(
    h=(sp.sinh(X1), sp.exp(X3)),
    degrees=(2, 1),
    first_rows=(0, 2),
    last_rows=(1, 2),
    T=(sp.sinh(X1), X2 * sp.cosh(X1), sp.exp(X3)),
    K=(
        sp.sinh(X1) * X2**2 + sp.cosh(X1) * X1 * X3,
        sp.exp(X3) * (X2 - X3),
    ),
    E=(sp.cosh(X1) * E1, sp.exp(X3) * E2),
    A=[[0, 1, 0], [0, 0, 0], [0, 0, 0]],
    B=[[0, 0], [1, 0], [0, 1]],
)
each_coupled = pytest.mark.parametrize("hand", [SWAPPED, CURVED], ids=["swapped", "curved"])


@each_coupled
def test_chains_of_coupled_outputs_are_in_their_order(hand: Coupled) -> None:
    """Of unequal relative degrees."""
    chains = hand.chains
    assert chains.relative_degree == hand.degrees
    assert chains.complete
    assert chains.first_rows == hand.first_rows
    assert chains.last_rows == hand.last_rows
    np.testing.assert_array_equal(chains.A, hand.A)
    np.testing.assert_array_equal(chains.B, hand.B)


@each_coupled
def test_matrices_of_coupled_outputs_are_those_by_hand(hand: Coupled) -> None:
    chains = hand.chains
    assert hand.T == chains.T
    K = sp.Matrix(hand.K)
    E = sp.Matrix.vstack(*hand.E)
    assert sp.simplify(sp.Matrix(chains.K) - K) == sp.zeros(2, 1)
    assert sp.simplify(chains.E - E) == sp.zeros(2)


def test_singularity_is_the_determinant() -> None:
    determinant = (2 + sp.sin(X3)) * (3 + X2**2) - X1
    assert sp.simplify(SWAPPED.chains.singularity / determinant) in (1, -1)


@each_coupled
def test_a_state_is_found_from_coupled_outputs(hand: Coupled) -> None:
    x = np.array([1.2, -0.8, 0.5])
    z = np.array(hand.chains.transformation(x, None))
    placed = hand.chains.place(z, None, np.zeros(3))
    np.testing.assert_allclose(placed, x, rtol=0, atol=1e-9)


# Zero dynamics

GROWTH = sp.Symbol("a")
GROWING = SimpleNamespace(a=3.0)
# y = x1 + x2 has (s - a + 1) / (s (s - a)), y = x1 has 1/s.
LINEAR = Equations(
    x=(X1, X2),
    f=(0, GROWTH * X2 + X1),
    g=(1, 0),
    h=(X1,),
)
# Holding y = x1 takes u = -x2^2, so x2' = -x2^3 - x2^2.
CUBIC = Equations(
    x=(X1, X2),
    f=(X2**2, -(X2**3)),
    g=(1, 1),
    h=(X1,),
)
CART, _, CART_SPEED, _ = CART_PENDULUM.symbolic_equations.x


@pytest.mark.parametrize(
    ("equations", "states", "rates", "poles"),
    [
        # p' = speed, speed' = 0: the chapter's z leaves the cart out, with two poles at zero.
        (CART_PENDULUM.symbolic_equations, (CART, CART_SPEED), (CART_SPEED, 0), [0, 0]),
        (LINEAR, (X2,), (GROWTH * X2,), [3.0]),
        (CUBIC, (X2,), (-(X2**3) - X2**2,), [0]),
    ],
    ids=["cart-pendulum", "linear", "cubic"],
)
def test_zero_dynamics_are_those_by_hand(
    equations: Equations, states: Any, rates: Any, poles: list[float]
) -> None:
    zero_dynamics: Any = feedback_linearization(equations).zero_dynamics()
    assert zero_dynamics.states == states
    difference = sp.Matrix(zero_dynamics.rates) - sp.Matrix(rates)
    assert difference.expand().is_zero_matrix
    actual = zero_dynamics.poles(GROWING)
    np.testing.assert_allclose(actual, poles, rtol=1e-14)


def test_poles_of_the_zero_dynamics_are_the_zeros() -> None:
    zero_dynamics: Any = feedback_linearization(LINEAR, [X1 + X2]).zero_dynamics()
    poles = zero_dynamics.poles(GROWING)
    np.testing.assert_allclose(poles, [2.0], rtol=1e-14)


@pytest.mark.parametrize(
    "equations",
    [ARM.symbolic_equations, motor(load=True), COUPLED],
    ids=["arm", "motor", "coupled"],
)
def test_a_plant_whose_z_is_the_whole_state_has_no_zero_dynamics(equations: Equations) -> None:
    assert feedback_linearization(equations).zero_dynamics() is None


# A state with given outputs

THETA = sp.Symbol("theta")


def numbers(p: Any, reference: Any, size: int = 2) -> FeedbackParameters:
    return FeedbackParameters(p, reference, np.zeros((1, size)))


def test_states_that_the_outputs_leave_free_are_those_of_the_guess() -> None:
    guess = np.array([1.0, 2.0, 3.0, 4.0])
    chains = feedback_linearization(CART_PENDULUM.symbolic_equations)
    x = chains.place(np.array([0.1, 0.2]), None, guess)
    assert x.tolist() == [1.0, 0.1, 3.0, 0.2]
    assert guess.tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("near", "angle"),
    [
        (0.0, math.pi / 6),
        (3.0, 5 * math.pi / 6),
    ],
)
def test_guess_chooses_among_states_with_the_same_outputs(near: float, angle: float) -> None:
    """sin(theta) = 1/2 at 30 and at 150 degrees; the cart stays where the guess has it."""
    height = feedback_linearization(CART_PENDULUM.symbolic_equations, [sp.sin(THETA)])
    guess = np.array([7.0, near, -2.0, 0.0])
    x = height.place(np.array([0.5, 0.3]), PENDULUM, guess)
    expected = [7.0, angle, -2.0, 0.3 / math.cos(angle)]
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-9)


def test_states_that_z_leaves_out_are_at_rest_without_a_guess() -> None:
    error = ErrorCoordinates(CART_PENDULUM, setpoints(2))
    x = error.place(0.0, [0.1, -0.7], numbers(PENDULUM, Setpoint(0.3)))
    np.testing.assert_allclose(x, [0, 0.4, 0, -0.7], rtol=1e-15)


# sqrt(x1) is no number for x1 < 0, where the root finder steps.
ROOT = Equations(
    x=(X1,),
    f=(0,),
    g=((1,),),
    h=(sp.sqrt(X1),),
)


@pytest.mark.parametrize(
    ("equations", "h", "z"),
    [
        # No angle has the sine 1.5.
        (CART_PENDULUM.symbolic_equations, [sp.sin(THETA)], [1.5, 0.0]),
        (ROOT, None, [-0.5]),
    ],
    ids=["sine", "root"],
)
def test_outputs_that_no_state_has_are_refused(
    equations: Equations, h: Any, z: list[float]
) -> None:
    chains = feedback_linearization(equations, h)
    guess = np.full(len(equations.x), 0.1)
    with pytest.raises(PremiseError, match=r"no state near \[0\.1.*\] has z = \["):
        chains.place(np.array(z), PENDULUM, guess)


def test_a_matrix_is_singular_at_a_state_in_any_units() -> None:
    a, b = sp.symbols("a b")
    equations = Equations(
        x=(a, b),
        f=(0, 0),
        g=((1e6, 0), (0, 1e-8 * sp.cos(b))),
        h=(a, b),
    )
    chains = feedback_linearization(equations)
    chains.require_regular(np.zeros(2), None)
    with pytest.raises(PremiseError, match=r"is singular there \(eq\. \(21\)\)"):
        chains.require_regular(np.array([0.0, math.pi / 2]), None)


# Error coordinates of such outputs


def signals(*units: str) -> tuple[Signal, ...]:
    return tuple(Signal(f"signal {i}", f"s{i}", unit) for i, unit in enumerate(units))


SQUARE = System(
    name="square",
    title="A system",
    states=signals("m", "m/s", "rad"),
    inputs=signals("N", "N"),
    equations=COUPLED,
)
SQUARE_NUMBERS = numbers(NoNumbers(), Setpoints(0.2, -0.4))
SQUARE_STATE = np.array([0.7, -1.4, 0.3])
each_sign = pytest.mark.parametrize("sign", [1, -1])


def square_error(sign: Any) -> ErrorCoordinates:
    return ErrorCoordinates(SQUARE, setpoints(2, 1), sign)


def test_error_coordinates_of_two_outputs_have_the_units_of_their_derivatives() -> None:
    error = square_error(1)
    assert (error.size, error.inputs) == (3, 2)
    assert error.units == ("m", "m/s", "rad")


@each_sign
def test_error_coordinates_of_two_outputs_are_measured_from_both_references(sign: int) -> None:
    error = square_error(sign)
    x = SQUARE_STATE
    z = sign * np.array([x[0] - 0.2, x[1], x[2] + 0.4])
    np.testing.assert_array_equal(error.error_state(0.0, x, SQUARE_NUMBERS), z)
    np.testing.assert_array_equal(error.along([0.0, 0.3], [x, x], SQUARE_NUMBERS), [z, z])
    np.testing.assert_allclose(error.place(0.0, z, SQUARE_NUMBERS), x, rtol=0, atol=1e-15)


@each_sign
def test_error_dynamics_of_two_outputs_are_those_by_hand(sign: int) -> None:
    x = SQUARE_STATE
    alpha, E = square_error(sign).dynamics(0.0, x, SQUARE_NUMBERS)
    np.testing.assert_allclose(alpha, [sign * x[0] * x[2], sign * (x[1] - x[2])], rtol=1e-15)
    expected = np.array([[2 + math.sin(x[2]), x[0]], [1, 3 + x[1] ** 2]])
    np.testing.assert_allclose(E, sign * expected, rtol=1e-15)


@each_sign
def test_feedback_makes_v_of_two_inputs(sign: int) -> None:
    """z_i^(r_i) = v_i, and the virtual input gives v back."""
    error = square_error(sign)
    v = np.array([0.7, -1.3])
    memory = SimpleNamespace(undefined=0.0)
    u, back = np.zeros((2, 2))
    error.feedback(0.0, SQUARE_STATE, v, memory, SQUARE_NUMBERS, u)
    alpha, E = error.dynamics(0.0, SQUARE_STATE, SQUARE_NUMBERS)
    np.testing.assert_allclose(alpha + E @ u, v, rtol=0, atol=1e-12)

    error.virtual_input(0.0, SQUARE_STATE, u, memory, SQUARE_NUMBERS, back)
    np.testing.assert_allclose(back, v, rtol=0, atol=1e-12)


@each_sign
def test_linear_model_of_two_outputs_is_the_jacobian_by_hand(sign: int) -> None:
    """About x = (0.2, 0, 0): x1 x3 has the slopes (0, 0, 0.2), x2 - x3 (0, 1, -1)."""
    p = numbers(NoNumbers(), Setpoints(0.2, 0.0))
    plant = AnalyticPlant(SQUARE, NoNumbers())
    A, B = square_error(sign).linear_model(plant, p)
    expected_A = [[0, 1, 0], [0, 0, 0.2], [0, 1, -1]]
    np.testing.assert_allclose(A, expected_A, rtol=0, atol=1e-8)
    expected_B = sign * np.array([[0, 0], [2, 0.2], [1, 3]])
    np.testing.assert_allclose(B, expected_B, rtol=0, atol=1e-8)


THIRD_ORDER = System(
    name="motor",
    title="A system",
    states=signals("", "", ""),
    inputs=signals("V"),
    equations=replace(motor(load=True), w=(), d=()),
)


@pytest.mark.parametrize("J", [0.02, 0.04])
def test_uncertain_kinematics_are_not_matched(J: float) -> None:
    """T of the motor knows J: on a motor of another inertia y'' is not what z3 says."""
    error = ErrorCoordinates(THIRD_ORDER, setpoints(3))
    p = numbers(MOTOR, Setpoint(0.0), size=3)
    true = AnalyticPlant(THIRD_ORDER, SimpleNamespace(**(vars(MOTOR) | {"J": J})))
    x = np.array([0.2, 1.5, -0.4])
    torque = 0.7 * -0.4 - 0.1 * 1.5

    (drift,), (gain,) = error.error_dynamics([0.0], x[None], p, true)
    np.testing.assert_allclose(drift[:2], [1.5, torque / J], rtol=1e-13)
    voltage_gain = 0.7 / 0.02 / 0.05
    np.testing.assert_allclose(gain, [[0], [0], [voltage_gain]], rtol=1e-13)

    unmatched = error.unmatched(error.error_state(0.0, x, p), drift)
    np.testing.assert_allclose(unmatched, [0, torque / J - torque / 0.02], atol=1e-12)


def test_units_of_outputs_that_are_no_states_are_those_of_their_derivatives() -> None:
    outputs = (sp.sinh(sp.Symbol("angle")),)
    curved = ErrorCoordinates(THIRD_ORDER, setpoints(3), outputs=outputs, unit="m")
    assert curved.units == ("m", "m/s", "m/s^2")
