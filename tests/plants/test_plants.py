"""The facts that all plants share: equations against MuJoCo, numbers, one interface, refusals."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from conftest import held
from scipy.integrate import solve_ivp

from grosmc_mj import plants
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.files import load_model, load_spec, model_path
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import ARM, CART_PENDULUM, SERVO, SYSTEMS, TWO_LINK_ARM, AnalyticPlant
from grosmc_mj.plants.cart_pendulum import pole_torque
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.sweep.agreement import AGREEMENT_BOUND, acceleration_difference

NUMBERS: dict[str, Any] = {
    "servo": plants.ServoParameters(J=5.77e-2, B=8.8e-3, Kt=0.667),
    "cart_pendulum": plants.CartPendulumParameters(M=1.0, m=0.2, L=0.5, g=9.8),
    "arm": plants.ArmParameters(m=0.02, l=0.5, g=9.8, J=0.035, M_c=0.06),
    "two_link_arm": plants.TwoLinkParameters(
        m1=1.5, l1=0.5, c1=0.25, I1=0.03125, m2=1.0, l2=0.4, c2=0.2, I2=0.16 / 12, mp=0.2, Ip=0.0,
        g=9.8,
    ),
}  # fmt: skip


@cache
def physics(name: str, *edits: BodyEdit) -> MujocoPlant:
    return MujocoPlant.load(name, edits=edits)


def analytic(name: str) -> AnalyticPlant:
    return AnalyticPlant(SYSTEMS[name], NUMBERS[name])


# Numbers


@pytest.mark.parametrize(
    ("name", "edits", "changes"),
    [
        ("servo", (BodyEdit("rotor", 2.0, 3.0),), {"J": 18 * 5.77e-2}),
        ("cart_pendulum", (BodyEdit("pole", 2.3, 1.7), BodyEdit("cart", 0.5)),
         {"M": 0.5, "m": 0.46, "L": 0.85}),
        ("arm", (BodyEdit("link", 2.0, 1.25),), {"m": 0.04, "l": 0.625}),
        ("two_link_arm", (BodyEdit("upper", 1.0, 1.5),),
         {"l1": 0.75, "c1": 0.375, "I1": 2.25 * 0.03125}),
        ("two_link_arm", (BodyEdit("lower", 2.0, 1.5), BodyEdit("payload", 5.0)),
         {"m2": 2.0, "l2": 0.6, "c2": 0.3, "I2": 4.5 * 0.16 / 12, "mp": 1.0}),
    ],
)  # fmt: skip
def test_numbers_are_read_from_the_model_as_it_is_edited(name: str, edits: Any, changes: Any):
    for plant, own in ((physics(name), {}), (physics(name, *edits), changes)):
        expected = dataclasses.asdict(dataclasses.replace(NUMBERS[name], **own))
        for variant in SYSTEMS[name].variants:
            actual = dataclasses.asdict(plant.analytic(variant).parameters)
            right = {**expected, **({"printed": 1.0} if variant == "printed" else {})}
            # The hub of the arm has an inertia of 1e-15, without which it would not compile.
            assert actual == pytest.approx(right, rel=1e-12)
        assert plant.parameters == plant.analytic().parameters


def test_numbers_that_are_none_of_the_plant_s_are_refused() -> None:
    may_be_zero = {"B", "M_c", "c1", "I1", "c2", "I2", "mp", "Ip", "printed"}
    for name, numbers in NUMBERS.items():
        for field in dataclasses.asdict(numbers).keys() - may_be_zero:
            with pytest.raises(ModelError, match=rf"{name}: {field} = 0"):
                dataclasses.replace(numbers, **{field: 0.0})
        for field in dataclasses.asdict(numbers).keys() - {"printed"}:
            for wrong in (-1.0, math.nan, math.inf):
                with pytest.raises(ModelError, match=rf"{name}: {field} = {wrong:g}"):
                    dataclasses.replace(numbers, **{field: wrong})


# The equations against MuJoCo


def test_the_corrected_equations_have_the_accelerations_of_mujoco(plant: MujocoPlant) -> None:
    """Nominal and edited, at random states, inputs and wrenches on every body.

    Rounding: measured 7e-16 (servo), 2e-14 (pendulum) and 5e-14 (arm, whose cable loses digits
    near pi/2) of the largest term.
    """
    random, name = np.random.default_rng(1), plant.system.name
    own = {"arm": ("hub", "link"), "two_link_arm": ("payload",)}.get(name, ())
    edits = [[], *([BodyEdit(body, inertia=(0.02, 0.03, 0.04))] for body in own)]
    # The arm's hub carries the cable, and a cart has no length.
    fixed, heavy = {"cart", "hub"}, [b for b in plant.system.bodies if plant.model.body(b).mass > 0]
    for mass, length in ((0.25, 0.5), (4.0, 0.5), (0.7, 4.0), (4.0, 4.0)):
        edits.append([BodyEdit(body, mass, 1.0 if body in fixed else length) for body in heavy])
    for changes in edits:
        edited, states = plant.edited(*changes), 25 if changes else 500
        difference = acceleration_difference(edited, edited.analytic(), random, states)
        assert difference < 1e-10, changes


def test_a_wrong_plant_disagrees_beyond_the_report_s_bound() -> None:
    servo, right, random = physics("servo"), analytic("servo"), np.random.default_rng(3)
    for number in ("J", "B", "Kt"):
        wrong = right.changed(scales={number: 1 + 1e-6})
        assert acceleration_difference(servo, wrong, random, 20) > AGREEMENT_BOUND


# Starts, inputs and a timestep [s] at which the error of RK4 is above rounding: the servo is so
# slow (J/B = 6.6 s) that its steps must be long.
RUNS: dict[str, Any] = {
    "servo": ((0.2, -1.0), 1.5, 0.1),
    "cart_pendulum": ((0.0, 0.4, 0.0, 0.0), 2.0, 0.005),
    "arm": ((-0.5, 1.0), 0.1, 0.05),
    "two_link_arm": ((-1.3, 0.3, 0.5, 0.5), (1.0, -0.5), 0.005),
}


def test_equations_and_mujoco_with_rk4_converge_at_order_4_by_the_same_steps(name: str) -> None:
    """Both use the classical fourth-order rule, so they agree far below its error."""
    (start, u, timestep), twin, bodies = RUNS[name], physics(name).analytic(), SYSTEMS[name].bodies
    w = np.random.default_rng(5).uniform(-0.3, 0.3, (len(bodies), 6))
    exact = solve_ivp(
        lambda t, x: twin.derivative(x, u, w), (0.0, 1.0), start, method="DOP853", rtol=1e-12,
        atol=1e-13,
    ).y[:, -1]  # fmt: skip
    pushes, errors = [Disturbance(*push) for push in zip(bodies, w.tolist(), strict=True)], []
    for h in (timestep, timestep / 2):
        plant = MujocoPlant.load(name, timestep=h, integrator="RK4")
        for one in (plant, plant.analytic()):
            run = simulate(one, held(u), start, duration=1.0, timestep=h, disturbances=pushes)
            errors.append(np.abs(run.state[-1] - exact).max())
    # Below 5e-11 the error of the reference and rounding would be part of the order.
    assert min(errors) > 5e-11
    assert 3.7 < math.log2(errors[0] / errors[2]) < 4.3
    assert errors[::2] == pytest.approx(errors[1::2], abs=1e-12)


# Linear models. Central differences with a step of 6e-6 lose its square, 4e-11, times a third
# derivative over six, and as much to rounding: measured 7e-11 of the largest entry with edits.


def largest_error(actual: tuple[Array, Array], expected: tuple[Array, Array]) -> float:
    """The largest difference in A or in B over the largest entry of each."""
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(actual, expected, strict=True))


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
    """Where the input that f(x) + g(x) u = 0 asks for holds the plant."""
    plant = physics(name, *edits)
    twin, drift = plant.analytic(), plant.analytic().derivative(x)
    g = np.reshape(plant.system.equations.input_matrix(x, twin.parameters), (len(x), -1))
    u = -np.linalg.lstsq(g, drift)[0]
    assert largest_error(linearize(plant, x, u), twin.jacobian(x, u)) < 1e-9
    assert largest_error(twin.linearization(x, u), twin.jacobian(x, u)) == 0


def test_printed_plants_and_the_pole_s_torque_are_those_of_the_chapter() -> None:
    plant, rest = physics("cart_pendulum"), np.zeros(4)
    # m (4/3 - m/(M+m)) / (4/3 - m^2/(M+m)) = 0.2 * 35/39, from the two values of a in eq. (40).
    gains = [plant.analytic(v).derivative(rest, 1.0)[3] for v in ("printed", "corrected")]
    assert gains[0] / gains[1] == pytest.approx(0.2 * 35 / 39, rel=1e-12)
    # C = 0.03 cos q for 0.03 cos(q) q' in eq. (57): no brake that falls with the rate.
    q, rate = 0.4, 2.0
    rates = [physics("arm").analytic(v).derivative([q, rate])[1] for v in ("printed", "corrected")]
    missing = 0.03 * math.cos(q) * rate * (rate - 1) / (0.1 + 0.06 * math.sin(q))
    assert rates[0] - rates[1] == pytest.approx(missing, rel=1e-9)
    # The hinge is along -y, and the cart is pushed too, (M + m) p'' = m L theta''.
    wrench = [0.0] * 10 + [-pole_torque(-3.0, NUMBERS["cart_pendulum"]), 0.0]
    rates = plant.derivative(rest, wrench=wrench)
    np.testing.assert_allclose(rates[2:], [0.1 * -3.0 / 1.2, -3.0], rtol=1e-13)


# One interface


def test_limits_steps_names_and_changes() -> None:
    spec = physics("servo").spec.copy()
    spec.actuators[0].ctrlrange, spec.actuators[0].ctrllimited = (-2.0, 1.0), True
    plant = MujocoPlant(SERVO, spec, (), 2e-3, "implicit")
    equations = plant.analytic()
    np.testing.assert_array_equal(plant.input_limits, [[-2.0], [1.0]])
    np.testing.assert_array_equal(equations.input_limits, [[-math.inf], [math.inf]])
    assert (plant.kind, plant.step_length, plant.stepped_by) == ("physics", 2e-3, "implicit")
    known = equations.kind, equations.step_length, equations.stepped_by
    assert known == ("corrected", None, "RK4")
    assert (plant.restepped, physics("servo").restepped) == (True, False)
    assert plant.digest != physics("servo").digest
    heavier = physics("cart_pendulum").changed([BodyEdit("pole", mass_scale=2.0)])
    same = physics("cart_pendulum").analytic().changed(scales={"m": 2.0})
    assert heavier.parameters.m == pytest.approx(same.parameters.m)
    assert equations.changed() is equations


# What is refused


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
    spec, (kind, _, owner) = load_spec(system.name), part.partition(" ")
    setattr(getattr(spec, kind)(owner) if owner else spec.option, field, value)
    with pytest.raises(ModelError, match=words):
        AnalyticPlant.from_model(system, spec.compile())


def pendulum(x: Any, *others: Any) -> Any:
    return analytic("cart_pendulum").derivative(x, *others)


def linear(x: Any, u: Any = 0.0) -> Any:
    return linearize(physics("cart_pendulum"), x, u)


SHAPES = r"must be \(4,\), \(1,\) and \(12,\)"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: pendulum([[0.0] * 4]), SHAPES),
        (lambda: pendulum([0.0] * 4, 0.0, [0.0] * 6), SHAPES),
        # One for each state would be multiplied element by element and pass for a result.
        (lambda: pendulum([0.0] * 4, [1.0] * 4), SHAPES),
        (lambda: linear([0.0, 0.0]), r"cart_pendulum: x has shape \(2,\)"),
        (lambda: linear([0.0, math.nan, 0.0, 0.0]), "must be finite numbers"),
        (lambda: linear(None, math.inf), "u = inf must be finite numbers"),
        (lambda: linear(None, 1.0),
         r"1\.0\] is no equilibrium: x' = \[0\.0, 0\.0, 0\.952\d*, 1\.42"),
        (lambda: linear([0.0, 0.0, 0.2, 0.0]), "is no equilibrium"),
        (lambda: analytic("servo").changed([BodyEdit("rotor", 2.0)]), "scale a parameter instead"),
        (lambda: physics("servo").changed(scales={"J": 2.0}), "edit a body or a joint instead"),
        (lambda: analytic("servo").changed(scales={"q": 2.0}), "unknown parameter of servo 'q'"),
        (lambda: analytic("servo").model, "no model in MuJoCo"),
        (lambda: physics("servo").analytic("printed"), "no variant 'printed': valid: corrected"),
        (lambda: AnalyticPlant.from_model(SERVO, load_model("arm")), "not a model of servo"),
        (lambda: Robot.from_mjcf(model_path("two_link_arm")).plant.system.equations.drift,
         r"has no equations in symbols \(f\): MuJoCo computes"),
        (lambda: plants.find_system("crane"), "valid: servo, cart_pendulum, arm"),
        (lambda: physics("arm", BodyEdit("hub", length_scale=2.0)).analytic(), "same radius"),
    ],
)  # fmt: skip
def test_what_no_plant_is_or_does_is_refused(call: Any, words: str) -> None:
    with pytest.raises((ArgumentError, ModelError), match=words):
        call()
