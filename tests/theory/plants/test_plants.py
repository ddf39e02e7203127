"""Facts that all plants share: equations against MuJoCo, numbers, one interface, refusals."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from open_loop import held
from scipy.integrate import solve_ivp

from grosmc_mj import plants
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.files import load_model, load_spec, model_path
from grosmc_mj.mechanics.physics.linearization import linearize
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.studies.sweep.agreement import AGREEMENT_BOUND, acceleration_difference
from grosmc_mj.theory.plants import ARM, CART_PENDULUM, SERVO, SYSTEMS, TWO_LINK_ARM, AnalyticPlant
from grosmc_mj.theory.plants.cart_pendulum import pole_torque

NUMBERS: dict[str, Any] = {
    "servo": plants.ServoParameters(J=5.77e-2, B=8.8e-3, Kt=0.667),
    "cart_pendulum": plants.CartPendulumParameters(M=1.0, m=0.2, L=0.5, g=9.8),
    "arm": plants.ArmParameters(m=0.02, l=0.5, g=9.8, J=0.035, M_c=0.06),
    "two_link_arm": plants.TwoLinkParameters(
        m1=1.5,
        l1=0.5,
        c1=0.25,
        I1=0.03125,
        m2=1.0,
        l2=0.4,
        c2=0.2,
        I2=0.16 / 12,
        mp=0.2,
        Ip=0.0,
        g=9.8,
    ),
}


@cache
def physics(name: str, *edits: BodyEdit) -> MujocoPlant:
    return MujocoPlant.load(name, edits=edits)


def analytic(name: str) -> AnalyticPlant:
    return AnalyticPlant(SYSTEMS[name], NUMBERS[name])


# Numbers

SERVO_NUMBERS = {"J": 18 * 5.77e-2}
PENDULUM_NUMBERS = {"M": 0.5, "m": 0.46, "L": 0.85}
ARM_NUMBERS = {"m": 0.04, "l": 0.625}
UPPER_NUMBERS = {"l1": 0.75, "c1": 0.375, "I1": 2.25 * 0.03125}
LOWER_NUMBERS = {"m2": 2.0, "l2": 0.6, "c2": 0.3, "I2": 4.5 * 0.16 / 12, "mp": 1.0}


@pytest.mark.parametrize(
    ("name", "edits", "changes"),
    [
        ("servo", (), {}),
        ("cart_pendulum", (), {}),
        ("arm", (), {}),
        ("two_link_arm", (), {}),
        ("servo", (BodyEdit("rotor", 2.0, 3.0),), SERVO_NUMBERS),
        ("cart_pendulum", (BodyEdit("pole", 2.3, 1.7), BodyEdit("cart", 0.5)), PENDULUM_NUMBERS),
        ("arm", (BodyEdit("link", 2.0, 1.25),), ARM_NUMBERS),
        ("two_link_arm", (BodyEdit("upper", 1.0, 1.5),), UPPER_NUMBERS),
        ("two_link_arm", (BodyEdit("lower", 2.0, 1.5), BodyEdit("payload", 5.0)), LOWER_NUMBERS),
    ],
)
def test_numbers_are_read_from_the_model(name: str, edits: Any, changes: Any) -> None:
    plant = physics(name, *edits)
    expected = dataclasses.asdict(dataclasses.replace(NUMBERS[name], **changes))
    for variant in SYSTEMS[name].variants:
        actual = dataclasses.asdict(plant.analytic(variant).parameters)
        expected_of_variant = dict(expected)
        if variant == "printed":
            expected_of_variant["printed"] = 1.0
        # The hub of the arm has an inertia of 1e-15, without which it would not compile.
        assert actual == pytest.approx(expected_of_variant, rel=1e-12)
    assert plant.parameters == plant.analytic().parameters


MAY_BE_ZERO = {"B", "M_c", "c1", "I1", "c2", "I2", "mp", "Ip"}
FIELDS = [
    (name, field.name)
    for name in NUMBERS
    for field in dataclasses.fields(NUMBERS[name])
    if field.name != "printed"
]


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(("name", "field"), FIELDS)
def test_a_number_must_be_finite_and_positive_or_zero_where_that_is_possible(
    name: str, field: str, value: float
) -> None:
    if value == 0 and field in MAY_BE_ZERO:
        assert getattr(dataclasses.replace(NUMBERS[name], **{field: value}), field) == 0
        return
    with pytest.raises(ModelError, match=f"{name}: {field} = {value:g}"):
        dataclasses.replace(NUMBERS[name], **{field: value})


# The equations against MuJoCo

# The arm's hub carries the cable, and a cart has no length.
FIXED_LENGTH = ("cart", "hub")
# Bodies whose inertia may be any.
FREE_INERTIA = [("arm", "hub"), ("arm", "link"), ("two_link_arm", "payload")]


def scaled_bodies(plant: MujocoPlant, mass: float, length: float) -> list[BodyEdit]:
    """Scale all bodies that have a mass."""
    edits: list[BodyEdit] = []
    for body in plant.system.bodies:
        if plant.model.body(body).mass > 0:
            length_scale = 1.0 if body in FIXED_LENGTH else length
            edits.append(BodyEdit(body, mass, length_scale))
    return edits


def equations_error(plant: MujocoPlant, samples: int) -> float:
    """Largest difference of accelerations at random states, inputs and wrenches on every body."""
    random = np.random.default_rng(1)
    return acceleration_difference(plant, plant.analytic(), random, samples)


# Rounding: measured 7e-16 (servo), 2e-14 (pendulum) and 5e-14 (arm, whose cable loses digits near
# pi/2) of the largest term.


def test_the_corrected_equations_have_the_accelerations_of_mujoco(plant: MujocoPlant) -> None:
    assert equations_error(plant, 500) < 1e-10


@pytest.mark.parametrize(("mass", "length"), [(0.25, 0.5), (4.0, 0.5), (0.7, 4.0), (4.0, 4.0)])
def test_equations_of_scaled_bodies_have_the_accelerations_of_mujoco(
    plant: MujocoPlant, mass: float, length: float
) -> None:
    edited = plant.changed(*scaled_bodies(plant, mass, length))
    assert equations_error(edited, 25) < 1e-10


@pytest.mark.parametrize(("name", "body"), FREE_INERTIA)
def test_equations_with_a_free_inertia_have_the_accelerations_of_mujoco(
    plant: MujocoPlant, body: str
) -> None:
    edited = plant.changed(BodyEdit(body, inertia=(0.02, 0.03, 0.04)))
    assert equations_error(edited, 25) < 1e-10


@pytest.mark.parametrize("number", ["J", "B", "Kt"])
def test_a_wrong_number_disagrees_beyond_the_bound_of_the_report(number: str) -> None:
    wrong = analytic("servo").changed(scales={number: 1 + 1e-6})
    difference = acceleration_difference(physics("servo"), wrong, np.random.default_rng(3), 20)
    assert difference > AGREEMENT_BOUND


# Starts, inputs and a timestep [s] at which the error of RK4 is above rounding: the servo is so
# slow (J/B = 6.6 s) that its steps must be long.
RUNS: dict[str, Any] = {
    "servo": ((0.2, -1.0), 1.5, 0.1),
    "cart_pendulum": ((0.0, 0.4, 0.0, 0.0), 2.0, 0.005),
    "arm": ((-0.5, 1.0), 0.1, 0.05),
    "two_link_arm": ((-1.3, 0.3, 0.5, 0.5), (1.0, -0.5), 0.005),
}


class FinalErrors(NamedTuple):
    """Errors of the state after 1 s, with the timestep of the run and with half of it."""

    in_mujoco: list[float]
    of_equations: list[float]


@cache
def final_errors(name: str) -> FinalErrors:
    """Errors of both engines against a solution of high accuracy."""
    start, u, timestep = RUNS[name]
    twin = physics(name).analytic()
    bodies = SYSTEMS[name].bodies
    w = np.random.default_rng(5).uniform(-0.3, 0.3, (len(bodies), 6))
    disturbances = [Disturbance(body, row) for body, row in zip(bodies, w.tolist(), strict=True)]

    solution = solve_ivp(
        lambda t, x: twin.derivative(x, u, w),
        (0.0, 1.0),
        start,
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    exact = solution.y[:, -1]

    def final_error(plant: Any, h: float) -> float:
        run = simulate(plant, held(u), start, duration=1.0, timestep=h, disturbances=disturbances)
        return np.abs(run.state[-1] - exact).max()

    errors = FinalErrors([], [])
    for h in (timestep, timestep / 2):
        plant = MujocoPlant.load(name, timestep=h, integrator="RK4")
        errors.in_mujoco.append(final_error(plant, h))
        errors.of_equations.append(final_error(plant.analytic(), h))
    return errors


def test_mujoco_converges_at_order_4(name: str) -> None:
    errors = final_errors(name)
    # Below 5e-11 the error of the reference and rounding would be part of the order.
    assert min(errors.in_mujoco + errors.of_equations) > 5e-11
    coarse, fine = errors.in_mujoco
    assert 3.7 < math.log2(coarse / fine) < 4.3


def test_equations_take_the_steps_of_mujoco(name: str) -> None:
    """Both use the classical fourth-order rule, so they agree far below its error."""
    errors = final_errors(name)
    assert errors.in_mujoco == pytest.approx(errors.of_equations, abs=1e-12)


# Linear models. Central differences with a step of 6e-6 lose its square, 4e-11, times a third
# derivative over six, and as much to rounding: measured 7e-11 of the largest entry with edits.


def largest_error(actual: tuple[Array, Array], expected: tuple[Array, Array]) -> float:
    """The largest difference in A or in B over the largest entry of each."""
    errors = [np.abs(a - b).max() / np.abs(b).max() for a, b in zip(actual, expected, strict=True)]
    return max(errors)


@pytest.mark.parametrize(
    ("name", "edits", "x"),
    [
        ("servo", (BodyEdit("rotor", mass_scale=3.0),), [1.0, 0.0]),
        ("cart_pendulum", (BodyEdit("pole", 4.0, 4.0),), [7.0, math.pi, 0.0, 0.0]),
        ("arm", (BodyEdit("link", 2.0, 1.25),), [1.2, 0.0]),
        ("two_link_arm", (BodyEdit("upper", 1.0, 1.05), BodyEdit("payload", 5.0)), [1, -2, 0, 0]),
    ],
)
def test_the_linear_model_is_the_jacobian_in_symbols(name: str, edits: Any, x: Any) -> None:
    plant = physics(name, *edits)
    twin = plant.analytic()
    # The input that holds the plant: f(x) + g(x) u = 0.
    g = np.reshape(plant.system.symbolic_equations.input_matrix(x, twin.parameters), (len(x), -1))
    u = -np.linalg.lstsq(g, twin.derivative(x))[0]

    assert largest_error(linearize(plant, x, u), twin.jacobian(x, u)) < 1e-9
    assert largest_error(twin.linearization(x, u), twin.jacobian(x, u)) == 0


def test_the_printed_pendulum_has_the_gain_of_the_chapter() -> None:
    """m (4/3 - m/(M+m)) / (4/3 - m^2/(M+m)) = 0.2 * 35/39, from the two a of eq. (40)."""
    plant = physics("cart_pendulum")
    printed = plant.analytic("printed").derivative(np.zeros(4), 1.0)[3]
    corrected = plant.analytic("corrected").derivative(np.zeros(4), 1.0)[3]
    assert printed / corrected == pytest.approx(0.2 * 35 / 39, rel=1e-12)


def test_the_printed_arm_lacks_a_brake_that_falls_with_the_rate() -> None:
    """C = 0.03 cos q for 0.03 cos(q) q' in eq. (57)."""
    q = 0.4
    rate = 2.0
    printed = physics("arm").analytic("printed").derivative([q, rate])[1]
    corrected = physics("arm").analytic("corrected").derivative([q, rate])[1]
    missing = 0.03 * math.cos(q) * rate * (rate - 1) / (0.1 + 0.06 * math.sin(q))
    assert printed - corrected == pytest.approx(missing, rel=1e-9)


def test_pole_torque_accelerates_the_upright_pole_by_d() -> None:
    """The hinge is along -y, and the cart is pushed too, (M + m) p'' = m L theta''."""
    torque = pole_torque(-3.0, NUMBERS["cart_pendulum"])
    wrench = [0.0] * 10 + [-torque, 0.0]
    rates = physics("cart_pendulum").derivative(np.zeros(4), wrench=wrench)
    np.testing.assert_allclose(rates[2:], [0.1 * -3.0 / 1.2, -3.0], rtol=1e-13)


# One interface


@pytest.fixture(scope="module")
def limited_servo() -> MujocoPlant:
    """A servo with limits of its input and another integrator than its model."""
    spec = physics("servo").spec.copy()
    spec.actuators[0].ctrlrange = (-2.0, 1.0)
    spec.actuators[0].ctrllimited = True
    return MujocoPlant(SERVO, spec, (), 2e-3, "implicit")


def test_input_limits_are_those_of_the_actuators_and_equations_have_none(
    limited_servo: MujocoPlant,
) -> None:
    np.testing.assert_array_equal(limited_servo.input_limits, [[-2.0], [1.0]])
    limits = limited_servo.analytic().input_limits
    np.testing.assert_array_equal(limits, [[-math.inf], [math.inf]])


def test_a_model_is_stepped_by_its_integrator_and_equations_by_runge_kutta(
    limited_servo: MujocoPlant,
) -> None:
    assert limited_servo.kind == "physics"
    assert limited_servo.step_length == 2e-3
    assert limited_servo.stepped_by == "implicit"
    assert limited_servo.restepped
    assert not physics("servo").restepped

    equations = limited_servo.analytic()
    assert equations.kind == "corrected"
    assert equations.step_length is None
    assert equations.stepped_by == "RK4"


def test_a_changed_model_has_another_digest(limited_servo: MujocoPlant) -> None:
    assert limited_servo.digest != physics("servo").digest


def test_an_edit_of_a_model_is_a_factor_on_a_parameter() -> None:
    heavier = physics("cart_pendulum").changed(BodyEdit("pole", mass_scale=2.0))
    equations = physics("cart_pendulum").analytic()
    assert heavier.parameters.m == pytest.approx(equations.changed(scales={"m": 2.0}).parameters.m)
    assert equations.changed() is equations


# Refusals


@pytest.mark.parametrize(
    ("system", "part", "field", "value", "words"),
    [
        (CART_PENDULUM, "body pole", "inertia", [0.017, 0.017, 1e-6], "uniform rod"),
        (CART_PENDULUM, "body pole", "ipos", [0.01, 0.0, 0.5], "uniform rod"),
        (ARM, "site eyelet", "pos", [0.22, 0.0, 0.0], "same radius"),
        (TWO_LINK_ARM, "body payload", "ipos", [0.01, 0, 0], "payload's centre at the tip"),
        (TWO_LINK_ARM, "body upper", "ipos", [0.25, 0, 0.01], "must lie on their x axes"),
        (TWO_LINK_ARM, "joint elbow", "armature", 0.01, "must have no armature"),
        (TWO_LINK_ARM, "joint elbow", "damping", [0.01, 0, 0], r"joint 'elbow' has damping 0\.01"),
        (TWO_LINK_ARM, "actuator elbow_torque", "gear", [2.0, *[0] * 5], "has gear 2"),
        (TWO_LINK_ARM, "option", "gravity", [0.1, 0.0, -9.8], "must point along -z"),
    ],
)
def test_a_model_that_the_equations_do_not_describe_is_refused(
    system: Any, part: str, field: str, value: Any, words: str
) -> None:
    spec = load_spec(system.name)
    kind, _, owner = part.partition(" ")
    element = getattr(spec, kind)(owner) if owner else spec.option
    setattr(element, field, value)
    with pytest.raises(ModelError, match=words):
        AnalyticPlant.from_model(system, spec.compile())


@pytest.mark.parametrize(
    "arguments",
    [
        ([[0.0] * 4],),
        ([0.0] * 4, 0.0, [0.0] * 6),
        # One for each state would be multiplied element by element and pass for a result.
        ([0.0] * 4, [1.0] * 4),
    ],
)
def test_arguments_of_a_wrong_shape_are_refused(arguments: Any) -> None:
    with pytest.raises(ArgumentError, match=r"must be \(4,\), \(1,\) and \(12,\)"):
        analytic("cart_pendulum").derivative(*arguments)


def test_one_number_is_no_input_of_two_but_zero() -> None:
    arm = analytic("two_link_arm")
    np.testing.assert_array_equal(
        arm.derivative([0.1] * 4, 0.0), arm.derivative([0.1] * 4, [0.0, 0.0])
    )
    with pytest.raises(ArgumentError, match=r"must be \(4,\), \(2,\) and \(18,\)"):
        arm.derivative([0.1] * 4, 1.0)


@pytest.mark.parametrize(
    ("x", "u", "words"),
    [
        ([0.0, 0.0], 0.0, r"cart_pendulum: x has shape \(2,\)"),
        ([0.0, math.nan, 0.0, 0.0], 0.0, "must be finite numbers"),
        (None, math.inf, "u = inf must be finite numbers"),
        (None, 1.0, r"1\] is no equilibrium: x' = \[0, 0, 0\.952\d*, 1\.42"),
        ([0.0, 0.0, 0.2, 0.0], 0.0, "is no equilibrium"),
    ],
)
def test_linearization_elsewhere_than_at_an_equilibrium_is_refused(
    x: Any, u: float, words: str
) -> None:
    with pytest.raises(ArgumentError, match=words):
        linearize(physics("cart_pendulum"), x, u)


def robot_drift() -> Any:
    return Robot.from_mjcf(model_path("two_link_arm")).plant.system.symbolic_equations.drift


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: analytic("servo").changed(BodyEdit("rotor", 2.0)), "scale a parameter instead"),
        (lambda: physics("servo").changed(scales={"J": 2.0}), "edit a body or a joint instead"),
        (lambda: analytic("servo").changed(scales={"q": 2.0}), "unknown parameter of servo 'q'"),
        (lambda: analytic("servo").model, "no model in MuJoCo"),
        (lambda: physics("servo").analytic("printed"), "no variant 'printed': valid: corrected"),
        (lambda: AnalyticPlant.from_model(SERVO, load_model("arm")), "not a model of servo"),
        (robot_drift, r"has no equations in symbols: MuJoCo computes"),
        (lambda: plants.find_system("crane"), "valid: servo, cart_pendulum, arm"),
        (lambda: physics("arm", BodyEdit("hub", length_scale=2.0)).analytic(), "same radius"),
    ],
)
def test_a_question_that_a_plant_cannot_answer_is_refused(call: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        call()
