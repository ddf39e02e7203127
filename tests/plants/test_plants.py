"""The facts that all plants share: equations against MuJoCo, energy, numbers, refusals."""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
import sympy as sp
from conftest import held
from scipy.integrate import solve_ivp

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.files import load_model, load_spec, model_path
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import (
    ARM,
    CART_PENDULUM,
    SERVO,
    SYSTEMS,
    TWO_LINK_ARM,
    AnalyticPlant,
    ArmParameters,
    CartPendulumParameters,
    ServoParameters,
    TwoLinkParameters,
    Variant,
    find_system,
)
from grosmc_mj.plants.cart_pendulum import pole_torque
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.sweep.agreement import (
    AGREEMENT_BOUND,
    Agreement,
    acceleration_difference,
    disagreements,
)

NUMBERS: dict[str, Any] = {
    "servo": ServoParameters(J=5.77e-2, B=8.8e-3, Kt=0.667),
    "cart_pendulum": CartPendulumParameters(M=1.0, m=0.2, L=0.5, g=9.8),
    "arm": ArmParameters(m=0.02, l=0.5, g=9.8, J=0.035, M_c=0.06),
    "two_link_arm": TwoLinkParameters(
        m1=1.5, l1=0.5, c1=0.25, I1=0.03125, m2=1.0, l2=0.4, c2=0.2, I2=0.16 / 12, mp=0.2, Ip=0.0,
        g=9.8,
    ),
}  # fmt: skip
OF_INERTIA = [("arm", "hub"), ("arm", "link"), ("two_link_arm", "payload")]


@cache
def physics(name: str, *edits: BodyEdit) -> MujocoPlant:
    return MujocoPlant.load(name, edits=edits)


def analytic(name: str, variant: Variant = "corrected") -> AnalyticPlant:
    p = NUMBERS[name]
    return AnalyticPlant(
        SYSTEMS[name], dataclasses.replace(p, printed=1.0) if variant == "printed" else p, variant
    )


# Numbers


@pytest.mark.parametrize(
    ("name", "edits", "changes"),
    [
        *((name, (), {}) for name in NUMBERS),
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
def test_numbers_are_read_from_the_model_as_it_is_edited(
    name: str, edits: tuple[BodyEdit, ...], changes: dict[str, float]
) -> None:
    expected = dataclasses.asdict(dataclasses.replace(NUMBERS[name], **changes))
    for variant in SYSTEMS[name].variants:
        actual = dataclasses.asdict(physics(name, *edits).analytic(variant).parameters)
        right = {**expected, **({"printed": 1.0} if variant == "printed" else {})}
        # The hub of the arm has an inertia of 1e-15, without which it would not compile.
        assert actual == pytest.approx(right, rel=1e-12)
    assert physics(name, *edits).parameters == physics(name, *edits).analytic().parameters


# The equations against MuJoCo


def random_edits(plant: MujocoPlant, random: np.random.Generator) -> list[BodyEdit]:
    """Mass 0.25 to 4 and length 0.5 to 4 times the nominal of every body that equations allow."""
    model, edits = plant.model, list[BodyEdit]()
    for body in plant.system.bodies:
        # The arm's hub carries the cable, and a cart has no length.
        length = 1.0 if body in ("cart", "hub") else 2 ** random.uniform(-1, 2)
        if model.body(body).mass[0] > 0:
            edits.append(BodyEdit(body, 4 ** random.uniform(-1, 1), length))
    return edits


def test_the_corrected_equations_have_the_accelerations_of_mujoco(plant: MujocoPlant) -> None:
    """Nominal and edited, at random states, inputs and wrenches on every body.

    Rounding: measured 7e-16 (servo), 2e-14 (pendulum) and 5e-14 (arm, whose cable loses digits
    near pi/2) of the largest term.
    """
    random = np.random.default_rng(1)
    moments = [
        BodyEdit(b, inertia=(0.02, 0.03, 0.04)) for n, b in OF_INERTIA if n == plant.system.name
    ]
    edited = [plant.edited(*random_edits(plant, random)) for _ in range(20)]
    for one in [plant, *edited, *(plant.edited(edit) for edit in moments)]:
        states = 500 if one is plant else 25
        assert acceleration_difference(one, one.analytic(), random, states) < 1e-10, one.edits


def test_the_rates_in_mujoco_are_those_of_the_model_as_drawn(plant: MujocoPlant) -> None:
    """Whatever was computed before."""
    random, system, n = np.random.default_rng(2), plant.system, plant.system.degrees_of_freedom
    for _ in range(5):
        x, u = random.uniform(-1, 1, 2 * n), random.normal(0, 5, len(system.inputs))
        w, data = random.normal(0, 5, (len(system.bodies), 6)), mujoco.MjData(plant.model)
        data.qpos[:], data.qvel[:], data.ctrl[:], data.xfrc_applied[1:] = x[:n], x[n:], u, w
        mujoco.mj_forward(plant.model, data)
        np.testing.assert_array_equal(plant.derivative(x, u, w), [*x[n:], *data.qacc])
        for one in (plant, plant.analytic()):
            np.testing.assert_array_equal(one.derivative(x, u), one.derivative(x, u, 0 * w))


def test_the_report_s_comparison_is_the_worst_state_s_and_sees_every_term() -> None:
    right = physics("servo").analytic()

    def worst(plant: AnalyticPlant, states: int, calls: int = 1) -> list[float]:
        random = np.random.default_rng(3)
        return [
            acceleration_difference(physics("servo"), plant, random, states) for _ in range(calls)
        ]

    for term in ("f", "g", "d"):
        rows = sp.Matrix(getattr(right.system.equations, term)) * (1 + sp.Rational(1, 10**6))
        changed = {term: rows.tolist() if term == "g" else rows.flat()}
        equations = dataclasses.replace(right.system.equations, **changed)
        system = dataclasses.replace(right.system, equations=equations)
        wrong = dataclasses.replace(right, system=system)
        assert worst(right, 20)[0] < AGREEMENT_BOUND < worst(wrong, 20)[0]
        assert worst(wrong, 20) == [max(worst(wrong, 1, calls=20))]
    rows = [
        Agreement("arm", variant, "nominal", size * AGREEMENT_BOUND, 1)
        for variant, size in (("printed", 9.0), ("corrected", 1.0), ("corrected", 2.0))
    ]
    (line,) = disagreements(rows)
    assert "differ by 2.0e-10 of the largest term, must be 1e-10 at most" in line


# Starts, inputs and timesteps [s] at which the error of RK4 is above rounding: the servo is so
# slow (J/B = 6.6 s) that its steps must be long.
RUNS: dict[str, tuple[Any, Any, tuple[float, ...]]] = {
    "servo": ((0.2, -1.0), 1.5, (0.2, 0.1, 0.05, 0.025)),
    "cart_pendulum": ((0.0, 0.4, 0.0, 0.0), 2.0, (0.02, 0.01, 0.005, 0.0025)),
    "arm": ((-0.5, 1.0), 0.1, (0.1, 0.05, 0.025, 0.0125)),
    "two_link_arm": ((-1.3, 0.3, 0.5, 0.5), (1.0, -0.5), (0.02, 0.01, 0.005, 0.0025)),
}


def test_equations_and_mujoco_with_rk4_converge_at_order_4_by_the_same_steps(name: str) -> None:
    """Both use the classical fourth-order rule, so they agree far below its error."""
    start, u, timesteps = RUNS[name]
    twin, bodies = physics(name).analytic(), SYSTEMS[name].bodies
    w = np.array([(0.1, 0.2, 0.3, 0.4, -0.05, 0.6), (-0.4, 0.3, 0.2, 0.1, 0.06, -0.2),
                  (0.3, -0.1, -0.2, 0.5, 0.04, 0.1)])[: len(bodies)]  # fmt: skip
    exact = solve_ivp(
        lambda t, x: twin.derivative(x, u, w), (0.0, 1.0), start, method="DOP853", rtol=1e-12,
        atol=1e-13,
    ).y[:, -1]  # fmt: skip
    pushes, errors = [Disturbance(*push) for push in zip(bodies, w.tolist(), strict=True)], []
    for h in timesteps:
        plant = MujocoPlant.load(name, timestep=h, integrator="RK4")
        for one in (plant, plant.analytic()):
            run = simulate(one, held(u), start, duration=1.0, timestep=h, disturbances=pushes)
            errors.append(np.abs(run.state[-1] - exact).max())
    in_mujoco, by_equations = np.reshape(errors, (-1, 2)).T
    # Below 5e-11 the error of the reference and rounding would be part of the slope.
    assert in_mujoco.min() > 5e-11
    assert 3.7 < np.polyfit(np.log(timesteps), np.log(in_mujoco), 1)[0] < 4.3
    assert in_mujoco == pytest.approx(by_equations, abs=1e-12)


# Linear models. Central differences with a step of 6e-6 lose its square, 4e-11, times a third
# derivative over six, and as much to rounding: measured 7e-11 of the largest entry with edits.


def largest_error(actual: tuple[Array, Array], expected: tuple[Array, Array]) -> float:
    """The largest difference in A or in B over the largest entry of each."""
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(actual, expected, strict=True))


@pytest.mark.parametrize(
    ("name", "edits", "x"),
    [
        ("servo", (BodyEdit("rotor", mass_scale=3.0),), [1.0, 0.0]),
        ("cart_pendulum", (), [-3.0, math.pi, 0.0, 0.0]),
        ("cart_pendulum", (BodyEdit("pole", 4.0, 4.0),), [7.0, 0.0, 0.0, 0.0]),
        ("arm", (), [0.5, 0.0]),
        ("arm", (BodyEdit("link", 2.0, 1.25),), [1.2, 0.0]),
        ("two_link_arm", (), [-2.0, 2.5, 0.0, 0.0]),
        ("two_link_arm", (BodyEdit("upper", 1.0, 1.05), BodyEdit("payload", 5.0)), [1, -2, 0, 0]),
    ],
)
def test_the_linear_model_is_the_jacobian_in_symbols(
    name: str, edits: tuple[BodyEdit, ...], x: list[float]
) -> None:
    """Where the input that f(x) + g(x) u = 0 asks for holds the plant."""
    plant = physics(name, *edits)
    twin, drift = plant.analytic(), plant.analytic().derivative(x)
    g = np.reshape(plant.system.equations.input_matrix(x, twin.parameters), (len(x), -1))
    u = -np.linalg.lstsq(g, drift)[0]
    assert largest_error(linearize(plant, x, u), twin.jacobian(x, u)) < 1e-9
    assert largest_error(twin.linearization(x, u), twin.jacobian(x, u)) == 0


def test_the_upright_pendulum_is_eq_40_linearized_whatever_the_integrator() -> None:
    A, B = linearize(physics("cart_pendulum"))
    p = NUMBERS["cart_pendulum"]
    length, a = p.L * (4 / 3 - p.m / (p.M + p.m)), 1 / (p.M + p.m)
    expected = np.zeros((4, 4)), np.zeros((4, 1))
    expected[0][0, 2] = expected[0][1, 3] = 1.0
    expected[0][3, 1], expected[1][3, 0] = p.g / length, a / length
    # The cart is carried by the pole: (M + m) p'' = u + m L theta''.
    expected[0][2] = a * p.m * p.L * expected[0][3]
    expected[1][2] = a + a * p.m * p.L * expected[1][3]
    assert largest_error((A, B), expected) < 1e-9
    # The servo has damping, in which three of the integrators are implicit.
    for integrator in ("Euler", "RK4", "implicit", "implicitfast"):
        plant = MujocoPlant.load("servo", timestep=0.02, integrator=integrator)
        for one, other in zip(linearize(plant), linearize(physics("servo")), strict=True):
            np.testing.assert_array_equal(one, other)


# Energy and power, written from the velocities and heights of the bodies


def moving(name: str, x: Array) -> list[tuple[float, float, complex, complex, float]]:
    """Mass, inertia, place and velocity in the x-z plane and rate of each body of the system."""
    p, (a, b), (da, db) = NUMBERS[name], (x[0], x[-1 - len(x) // 2]), (x[len(x) // 2], x[-1])
    if name == "servo":
        return [(0.0, p.J, 0j, 0j, da)]
    if name == "cart_pendulum":
        up, rod = 1j * cmath.exp(1j * b), p.m * (2 * p.L) ** 2 / 12
        return [(p.M, 0.0, 0j, da, 0.0), (p.m, rod, p.L * up, da + 1j * db * p.L * up, db)]
    along = cmath.exp(1j * a)
    if name == "arm":
        hub = 0.035 + 0.06 * (1 + math.sin(a))
        return [(0.0, hub, 0j, 0j, da), (p.m, 0.0, p.l * along, 1j * da * p.l * along, da)]
    lower, rate = cmath.exp(1j * (a + b)), da + db
    elbow, moves = p.l1 * along, 1j * da * p.l1 * along
    return [
        (p.m1, p.I1, p.c1 * along, 1j * da * p.c1 * along, da),
        (p.m2, p.I2, elbow + p.c2 * lower, moves + 1j * rate * p.c2 * lower, rate),
        (p.mp, p.Ip, elbow + p.l2 * lower, moves + 1j * rate * p.l2 * lower, rate),
    ]


def energy(name: str, x: Array) -> float:
    """Kinetic and potential [J]."""
    return sum(
        (m * abs(v) ** 2 + inertia * rate**2) / 2 + 9.8 * m * place.imag
        for m, inertia, place, v, rate in moving(name, x)
    )


def change(name: str, plant: AnalyticPlant, x: Array, *acts: Any) -> float:
    """dE/dt along the equations, by fourth-order differences."""
    sides = [sum(k * energy(name, x + s * e) for s, k in ((1e-4, 8), (-1e-4, -8), (2e-4, -1),
             (-2e-4, 1))) for e in np.eye(len(x))]  # fmt: skip
    return float(np.array(sides) / 12e-4 @ plant.derivative(x, *acts))


def test_energy_changes_by_the_power_of_input_wrench_and_friction(name: str) -> None:
    """Force times velocity, for every state, input and wrench; none without them."""
    plant, random = analytic(name), np.random.default_rng(4)
    n, bodies, m = len(plant.system.states), plant.system.bodies, len(plant.system.inputs)
    for size in [0.0] * 10 + [5.0] * 40:
        x, u = random.uniform(-5, 5, n), random.uniform(-size, size, m)
        w = random.uniform(-size, size, (len(bodies), 6))
        velocities = [(v, rate) for *_, v, rate in moving(name, x)]
        power = sum(
            f[0] * v.real + f[2] * v.imag - f[4] * rate
            for f, (v, rate) in zip(w, velocities, strict=True)
        ) + float(u @ x[n // 2 :][:m]) * (0.667 if name == "servo" else 1.0)
        power -= 8.8e-3 * x[1] ** 2 if name == "servo" else 0.0
        # Rounding of E divided by the step, 1e-12 J times a rate of x.
        tolerance = 1e-9 * (1 + np.abs(plant.derivative(x, u, w)).max())
        assert change(name, plant, x, u, w) == pytest.approx(power, rel=1e-9, abs=tolerance)


def test_printed_plants_do_not_conserve_energy() -> None:
    """The arm's C lacks a rate: E' = 0.03 cos(q) q'^2 (q' - 1), nothing at rest and at 1 rad/s."""
    for q, rate in ((0.5, 0.0), (0.5, 1.0), (0.3, 3.0), (-1.2, -2.0)):
        expected = 0.03 * math.cos(q) * rate**2 * (rate - 1)
        actual = change("arm", analytic("arm", "printed"), np.array([q, rate]))
        assert actual == pytest.approx(expected, abs=1e-9)
    swinging = np.array([0.0, 0.5, 0.3, 3.0])
    assert change("cart_pendulum", analytic("cart_pendulum", "printed"), swinging) < -0.03


def test_printed_input_gain_of_the_pendulum_is_a_fifth_of_the_true_one() -> None:
    """Upright: m (4/3 - m/(M+m)) / (4/3 - m^2/(M+m)) = 0.2 * 35/39, from the two values of a."""
    printed = analytic("cart_pendulum", "printed").derivative(np.zeros(4), 1.0)[3]
    true = physics("cart_pendulum").derivative(np.zeros(4), 1.0)[3]
    assert printed / true == pytest.approx(0.2 * 35 / 39, rel=1e-12)


@pytest.mark.parametrize("d", [0.01, -3.0])
def test_pole_torque_gives_the_upright_pole_exactly_d(d: float) -> None:
    torque = pole_torque(d, NUMBERS["cart_pendulum"])
    # The hinge is along -y.
    rates = physics("cart_pendulum").derivative(np.zeros(4), wrench=[0.0] * 10 + [-torque, 0.0])
    # It also pushes the cart: (M + m) p'' = m L theta''.
    np.testing.assert_allclose(rates[2:], [0.1 * d / 1.2, d], rtol=1e-13)


# One interface


def test_limits_steps_names_and_changes() -> None:
    spec = physics("servo").spec.copy()
    motor = spec.actuators[0]
    motor.ctrlrange, motor.ctrllimited = (-2.0, 1.0), True
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


def test_a_robot_is_a_plant_without_equations() -> None:
    robot = Robot.from_mjcf(model_path("two_link_arm")).plant
    assert (robot.parameters, robot.system.symbolic) == (None, False)
    assert robot.system.equations.linearizable(np.zeros(4))
    np.testing.assert_array_equal(
        robot.derivative([0.1] * 4), physics("two_link_arm").derivative([0.1] * 4)
    )
    with pytest.raises(ModelError, match=r"has no equations in symbols \(f\): MuJoCo computes"):
        _ = robot.system.equations.drift


# What is refused


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_that_are_none_of_the_plant_s_are_refused(name: str) -> None:
    may_be_zero = {"B", "M_c", "c1", "I1", "c2", "I2", "mp", "Ip"}
    numbers = NUMBERS[name]
    for field in (one.name for one in dataclasses.fields(numbers) if one.name != "printed"):
        for wrong in (-1.0, math.nan, math.inf, 0.0):
            if wrong == 0 and field in may_be_zero:
                assert getattr(dataclasses.replace(numbers, **{field: wrong}), field) == 0
                continue
            with pytest.raises(ModelError, match=rf"{name}: {field} = {wrong:g}"):
                dataclasses.replace(numbers, **{field: wrong})


@pytest.mark.parametrize(
    ("system", "part", "field", "value", "words"),
    [
        (CART_PENDULUM, "body pole", "inertia", [0.017, 0.017, 1e-6], "uniform rod"),
        (CART_PENDULUM, "body pole", "ipos", [0.01, 0.0, 0.5], "uniform rod"),
        (ARM, "site eyelet", "pos", [0.22, 0.0, 0.0], "same radius"),
        (ARM, "site drum", "pos", [0.0, 0.0, 1.0], "same radius"),
        (TWO_LINK_ARM, "body payload", "ipos", [0, 0, 0.01], "payload's centre at the tip"),
        (TWO_LINK_ARM, "body payload", "ipos", [0.01, 0, 0], "payload's centre at the tip"),
        (TWO_LINK_ARM, "body payload", "pos", [0.4, 0, 0.05], "must lie on their x axes"),
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


def servo(x: Any = (0.0, 0.0), *others: Any) -> Any:
    return analytic("servo").derivative(x, *others)


def pendulum(*arguments: Any) -> Any:
    for plant in (analytic("cart_pendulum"), physics("cart_pendulum")):
        with pytest.raises(ArgumentError) as refused:
            plant.derivative(*arguments)
    raise refused.value


def of_pendulum(x: Any, u: Any = 0.0) -> Any:
    """As a linear model of the equations, then of MuJoCo's plant."""
    with pytest.raises(ArgumentError):
        analytic("cart_pendulum").linearization(x, u)
    return linearize(physics("cart_pendulum"), x, u)


SHAPES = r"must be \(4,\), \(1,\) and \(12,\)"
REFUSED: list[tuple[Callable[[], Any], str]] = [
    *((lambda x=x: servo(x), r"must be \(2,\), \(1,\) and \(6,\)")
      for x in ([0.0], [0.0] * 3, [[0.0, 0.0]], 0.0)),
    *((lambda w=w: pendulum([0.0] * 4, 0.0, w), SHAPES) for w in ([0.0] * 6, [0.0] * 13, 0.0)),
    # One for each state would be multiplied element by element and pass for a result.
    *((lambda u=u: pendulum([0.0] * 4, u), SHAPES) for u in ([1.0, 2.0], [1.0] * 4)),
    (lambda: of_pendulum([0.0, 0.0]), r"cart_pendulum: x has shape \(2,\)"),
    (lambda: of_pendulum([0.0, math.nan, 0.0, 0.0]), "must be finite numbers"),
    (lambda: of_pendulum(None, math.inf), "u = inf must be finite numbers"),
    (lambda: of_pendulum(None, 1.0),
     r"1\.0\] is no equilibrium: x' = \[0\.0, 0\.0, 0\.952\d*, 1\.42"),
    (lambda: of_pendulum([0.0, 0.0, 0.2, 0.0]), "is no equilibrium"),
    (lambda: analytic("servo").changed([BodyEdit("rotor", 2.0)]), "scale a parameter instead"),
    (lambda: physics("servo").changed(scales={"J": 2.0}), "edit a body or a joint instead of J"),
    (lambda: analytic("servo").changed(scales={"q": 2.0}), "unknown parameter of servo 'q'"),
    (lambda: analytic("servo").model, "no model in MuJoCo"),
    (lambda: physics("servo").analytic("printed"), "no variant 'printed': valid: corrected"),
    (lambda: AnalyticPlant.from_model(SERVO, load_model("arm")), "not a model of servo"),
    (lambda: AnalyticPlant.from_model(ARM, load_model("cart_pendulum")), "not a model of arm"),
    (lambda: find_system("crane"), "valid: servo, cart_pendulum, arm"),
    (lambda: physics("arm", BodyEdit("hub", length_scale=2.0)).analytic(), "same radius"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_what_no_plant_is_or_does_is_refused(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((ArgumentError, ModelError), match=words):
        call()
