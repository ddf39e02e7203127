"""The plants as equations: their numbers, their units and their energy."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, ModelError
from grosmc_mj.physics.files import load_model, load_spec
from grosmc_mj.plants import (
    ARM,
    CART_PENDULUM,
    SERVO,
    SYSTEMS,
    AnalyticPlant,
    ArmParameters,
    CartPendulumParameters,
    ServoParameters,
    TwoLinkParameters,
    Variant,
    find_system,
)
from grosmc_mj.plants.cart_pendulum import pole_torque

SERVO_NUMBERS = ServoParameters(J=5.77e-2, B=8.8e-3, Kt=0.667)
PENDULUM_NUMBERS = CartPendulumParameters(M=1.0, m=0.2, L=0.5, g=9.8)
ARM_NUMBERS = ArmParameters(m=0.02, l=0.5, g=9.8, J=0.035, M_c=0.06)
TWO_LINK_NUMBERS = TwoLinkParameters(
    m1=1.5, l1=0.5, c1=0.25, I1=0.03125, m2=1.0, l2=0.4, c2=0.2, I2=0.16 / 12, mp=0.2, Ip=0.0, g=9.8
)
NUMBERS: dict[str, Any] = {
    "servo": SERVO_NUMBERS,
    "cart_pendulum": PENDULUM_NUMBERS,
    "arm": ARM_NUMBERS,
    "two_link_arm": TWO_LINK_NUMBERS,
}


def analytic(name: str, variant: Variant = "corrected") -> AnalyticPlant:
    p = NUMBERS[name]
    if variant == "printed":
        p = dataclasses.replace(p, printed=1.0)
    return AnalyticPlant(SYSTEMS[name], p, variant)


# Numbers


def test_parameters_are_read_from_the_nominal_model(name: str) -> None:
    found = AnalyticPlant.from_model(SYSTEMS[name], load_model(name)).parameters
    # The hub of the arm has an inertia of 1e-15, without which it would not compile.
    expected = dataclasses.asdict(NUMBERS[name])
    assert dataclasses.asdict(found) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", ["cart_pendulum", "arm"])
def test_variants_have_the_same_numbers(name: str) -> None:
    model = load_model(name)
    printed = AnalyticPlant.from_model(SYSTEMS[name], model, "printed").parameters
    corrected = AnalyticPlant.from_model(SYSTEMS[name], model, "corrected").parameters
    assert printed != corrected
    assert dataclasses.replace(printed, printed=0.0) == corrected


def test_servo_is_printed_without_error_so_it_has_one_variant() -> None:
    with pytest.raises(ModelError, match="servo has no variant 'printed': valid: corrected"):
        AnalyticPlant.from_model(SERVO, load_model("servo"), "printed")


@pytest.mark.parametrize(("system", "other"), [(SERVO, "arm"), (ARM, "cart_pendulum")])
def test_another_systems_model_is_refused(system: Any, other: str) -> None:
    with pytest.raises(ModelError, match=f"not a model of {system.name}"):
        AnalyticPlant.from_model(system, load_model(other))


def test_unknown_system_is_refused() -> None:
    with pytest.raises(ModelError, match="valid: servo, cart_pendulum, arm"):
        find_system("crane")


def physical_numbers() -> list[tuple[Any, str]]:
    fields = [(p, field.name) for p in NUMBERS.values() for field in dataclasses.fields(p)]
    return [(p, field) for p, field in fields if field != "printed"]


@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf])
@pytest.mark.parametrize(
    ("numbers", "field"),
    physical_numbers(),
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_wrong_numbers_are_refused(numbers: Any, field: str, wrong: float) -> None:
    with pytest.raises(ModelError, match=rf"{field} = {wrong:g}"):
        dataclasses.replace(numbers, **{field: wrong})


@pytest.mark.parametrize("field", ["M", "m", "L", "g"])
def test_numbers_that_divide_must_not_be_zero(field: str) -> None:
    with pytest.raises(ModelError, match=rf"cart_pendulum: {field} = 0"):
        dataclasses.replace(PENDULUM_NUMBERS, **{field: 0.0})


def test_a_frictionless_servo_and_an_arm_without_cable_are_possible() -> None:
    assert dataclasses.replace(SERVO_NUMBERS, B=0.0).B == 0
    assert dataclasses.replace(ARM_NUMBERS, M_c=0.0).M_c == 0


@pytest.mark.parametrize("change", ["inertia", "offset"])
def test_a_pole_that_is_no_uniform_rod_is_refused(change: str) -> None:
    spec = load_spec("cart_pendulum")
    pole = spec.body("pole")
    if change == "inertia":
        pole.inertia = np.array([0.017, 0.017, 1e-6])  # a rod of 0.2 kg and 1 m has 1/60
    else:
        pole.ipos = np.array([0.01, 0.0, 0.5])
    with pytest.raises(ModelError, match="uniform rod"):
        AnalyticPlant.from_model(CART_PENDULUM, spec.compile())


@pytest.mark.parametrize("site", ["eyelet", "drum"])
def test_an_arm_whose_cable_gives_another_inertia_is_refused(site: str) -> None:
    spec = load_spec("arm")
    spec.site(site).pos = 1.1 * spec.site(site).pos
    with pytest.raises(ModelError, match="same radius"):
        AnalyticPlant.from_model(ARM, spec.compile())


# Shapes


@pytest.mark.parametrize("x", [[0.0], [0.0] * 3, [[0.0, 0.0]], 0.0])
def test_derivative_wants_one_state(x: Any) -> None:
    with pytest.raises(ArgumentError, match=r"must be \(2,\), \(1,\) and \(6,\)"):
        analytic("servo").derivative(x)


@pytest.mark.parametrize("wrench", [[0.0] * 6, [0.0] * 13, 0.0])
def test_derivative_wants_a_wrench_for_each_body(wrench: Any) -> None:
    with pytest.raises(ArgumentError, match=r"must be \(4,\), \(1,\) and \(12,\)"):
        analytic("cart_pendulum").derivative([0.0] * 4, wrench=wrench)


@pytest.mark.parametrize("u", [[1.0, 2.0], [1.0, 2.0, 3.0, 4.0]])
def test_derivative_wants_one_input(u: Any) -> None:
    """An input for each state would be multiplied element by element and pass for a result."""
    with pytest.raises(ArgumentError):
        analytic("cart_pendulum").derivative([0.0] * 4, u)


def test_no_wrench_is_a_wrench_of_zero(name: str) -> None:
    plant = analytic(name)
    x = np.full(len(plant.system.states), 0.3)
    zero = np.zeros(6 * len(plant.system.bodies))
    u = np.full(len(plant.system.inputs), 0.7)
    np.testing.assert_array_equal(plant.derivative(x, u), plant.derivative(x, u, zero))


def test_output_is_the_controlled_coordinate(name: str) -> None:
    system = SYSTEMS[name]
    symbols = tuple(system.states[index].symbol for index in system.controlled)
    assert symbols[0] == system.states[system.output].symbol
    expected = {"servo": ("θ",), "cart_pendulum": ("θ",), "arm": ("q",)}
    if name in expected:
        assert symbols == expected[name]
    assert system.equations.h == tuple(system.equations.x[index] for index in system.controlled)


# Regions


@given(st.floats(-20, 20), st.floats(-5, 5))
def test_pendulum_is_linearizable_where_a_push_turns_it_as_upright(
    angle: float, rate: float
) -> None:
    x = [0.0, angle, 0.0, rate]
    gain = CART_PENDULUM.equations.input_matrix(x, PENDULUM_NUMBERS)[3]
    inside = abs(angle) < math.pi / 2
    assert CART_PENDULUM.linearizable(x) == inside
    assert not inside or gain > 0
    assert not CART_PENDULUM.singular(x)


def test_pendulum_cannot_be_pushed_when_it_lies() -> None:
    """At pi/2 the gain is zero, so the decoupling matrix is singular there, not only beyond."""
    lying = [0.0, math.pi / 2, 0.0, 0.0]
    gain = CART_PENDULUM.equations.input_matrix(lying, PENDULUM_NUMBERS)[3]
    assert gain == pytest.approx(0, abs=1e-15)
    assert not CART_PENDULUM.linearizable(lying)


@pytest.mark.parametrize(
    ("q", "singular"),
    [
        (math.pi / 2, True),
        (math.nextafter(math.pi / 2, 0), False),
        (2.0, True),
        (0.0, False),
        (-math.pi, False),
        (-1.5 * math.pi, True),
        (-1.5 * math.pi + 1e-9, False),
    ],
)
def test_arm_is_regular_for_one_turn_below_the_drum(q: float, singular: bool) -> None:
    assert ARM.singular([q, 1.0]) == singular
    assert ARM.linearizable([q, 1.0]) != singular


def test_servo_is_linearizable_everywhere() -> None:
    for x in ([0.0, 0.0], [1e6, -1e6]):
        assert SERVO.linearizable(x)
        assert not SERVO.singular(x)


# Units: an equation of physics says the same in grams, in millimetres and in milliseconds

# Exponents of kg, m and s.
FORCE, TORQUE, INERTIA = (1, 1, -2), (1, 2, -2), (1, 2, 0)
DIMENSIONS: dict[str, dict[str, tuple[int, int, int]]] = {
    # Kt i is a torque; the ampere stays as it is.
    "servo": {"J": INERTIA, "B": (1, 2, -1), "Kt": TORQUE, "u": (0, 0, 0)},
    "cart_pendulum": {"M": (1, 0, 0), "m": (1, 0, 0), "L": (0, 1, 0), "g": (0, 1, -2), "u": FORCE},
    "arm": {
        "m": (1, 0, 0),
        "l": (0, 1, 0),
        "g": (0, 1, -2),
        "J": INERTIA,
        "M_c": INERTIA,
        "u": TORQUE,
    },
    "two_link_arm": {
        **dict.fromkeys(("m1", "m2", "mp"), (1, 0, 0)),
        **dict.fromkeys(("l1", "c1", "l2", "c2"), (0, 1, 0)),
        **dict.fromkeys(("I1", "I2", "Ip"), INERTIA),
        "g": (0, 1, -2),
        "u": TORQUE,
    },
}
DIMENSIONLESS = (0, 0, 0)
UNITS = {"kg": 0, "m": 1, "s": 2}


def change_of_derivative(name: str, variant: Variant, unit: str, disturbed: bool) -> float:
    """Largest relative difference between x' in SI and x' through a unit 1000 times smaller."""

    def factor(dimension: tuple[int, int, int]) -> float:
        return 1000.0 ** dimension[UNITS[unit]]

    system = SYSTEMS[name]
    positions = [(0, 1, 0) if s.unit == "m" else DIMENSIONLESS for s in system.positions]
    states = positions + [(kg, m, s - 1) for kg, m, s in positions]
    rates = [(kg, m, s - 1) for kg, m, s in states]
    rng = np.random.default_rng(7)
    x = rng.uniform(0.5, 1.5, len(states))
    u = np.linspace(1.3, 2.1, len(system.inputs))
    w = rng.normal(size=6 * len(system.bodies)) * disturbed

    plant = analytic(name, variant)
    scaled = {
        field: getattr(plant.parameters, field) * factor(dimension)
        for field, dimension in DIMENSIONS[name].items()
        if field != "u"
    }
    other = dataclasses.replace(plant, parameters=dataclasses.replace(plant.parameters, **scaled))
    wrench = np.tile([factor(FORCE)] * 3 + [factor(TORQUE)] * 3, len(system.bodies))
    there = other.derivative(
        x * [factor(d) for d in states], u * factor(DIMENSIONS[name]["u"]), w * wrench
    )
    back = there / [factor(d) for d in rates]
    here = plant.derivative(x, u, w)
    return float(np.max(np.abs(back - here) / np.abs(here)))


@pytest.mark.parametrize("unit", UNITS)
def test_corrected_equations_hold_in_any_unit(name: str, unit: str) -> None:
    # A few roundings of 1e-16 each, and cancellation of terms of one size.
    assert change_of_derivative(name, "corrected", unit, disturbed=True) < 1e-13


@pytest.mark.parametrize(
    ("name", "broken"),
    # a m of eq. (40) is a mass where a number must be; C of eq. (57) lacks a rate.
    [("cart_pendulum", "kg"), ("arm", "s")],
)
def test_printed_equations_hold_in_one_unit_only(name: str, broken: str) -> None:
    for unit in UNITS:
        change = change_of_derivative(name, "printed", unit, disturbed=False)
        assert change > 0.1 if unit == broken else change < 1e-13, unit


# Energy


def pendulum_velocities(x: Array, p: CartPendulumParameters) -> tuple[Array, Array, float]:
    """Velocity of the cart and of the pole's centre in the x-z plane, and the pole's rate."""
    _, theta, speed, rate = x
    # The centre is at (p - L sin theta, L cos theta).
    centre = np.array([speed - p.L * math.cos(theta) * rate, -p.L * math.sin(theta) * rate])
    return np.array([speed, 0.0]), centre, rate


def energy(name: str, x: Array) -> float:
    """Kinetic and potential energy [J], written from velocities and heights."""
    if name == "servo":
        return SERVO_NUMBERS.J * x[1] ** 2 / 2
    if name == "cart_pendulum":
        p = PENDULUM_NUMBERS
        cart, centre, rate = pendulum_velocities(x, p)
        rod = p.m * (2 * p.L) ** 2 / 12
        kinetic = p.M * cart @ cart + p.m * centre @ centre + rod * rate**2
        return float(kinetic / 2 + p.m * p.g * p.L * math.cos(x[1]))
    if name == "two_link_arm":
        p = TWO_LINK_NUMBERS
        places, velocities, rates = two_link_velocities(x, p)
        masses, inertias = (p.m1, p.m2, p.mp), (p.I1, p.I2, p.Ip)
        kinetic = sum(m * v @ v for m, v in zip(masses, velocities, strict=True))
        turning = sum(i * rate**2 for i, rate in zip(inertias, rates, strict=True))
        height = sum(m * place[1] for m, place in zip(masses, places, strict=True))
        return float((kinetic + turning) / 2 + p.g * height)
    return (0.1 + 0.06 * math.sin(x[0])) * x[1] ** 2 / 2 + 0.02 * 9.8 * 0.5 * math.sin(x[0])


def two_link_velocities(
    x: Array, p: TwoLinkParameters
) -> tuple[Sequence[Any], Sequence[Any], Array]:
    """Places and velocities of the three centres of mass in the x-z plane, and their rates."""
    angles, rates = np.array([x[0], x[0] + x[1]]), np.array([x[2], x[2] + x[3]])
    along = [np.array([math.cos(a), math.sin(a)]) for a in angles]
    across = [
        rate * np.array([-math.sin(a), math.cos(a)]) for a, rate in zip(angles, rates, strict=True)
    ]
    places = [p.c1 * along[0], p.l1 * along[0] + p.c2 * along[1], p.l1 * along[0] + p.l2 * along[1]]
    velocities = [
        p.c1 * across[0],
        p.l1 * across[0] + p.c2 * across[1],
        p.l1 * across[0] + p.l2 * across[1],
    ]
    return places, velocities, np.array([rates[0], rates[1], rates[1]])


def power(name: str, x: Array, inputs: Array, w: Array) -> float:
    """Power [W] of input, wrenches and friction."""
    n, u = len(x) // 2, float(inputs[0])
    if name == "servo":
        friction = -SERVO_NUMBERS.B * x[1] ** 2
        return SERVO_NUMBERS.Kt * u * x[1] + friction - w[4] * x[1]
    if name == "two_link_arm":
        _, velocities, rates = two_link_velocities(x, TWO_LINK_NUMBERS)
        pushes = w.reshape(3, 6)
        pushed = sum(push[[0, 2]] @ v for push, v in zip(pushes, velocities, strict=True))
        return float(inputs @ x[2:] + pushed - pushes[:, 4] @ rates)
    if name == "cart_pendulum":
        cart, centre, rate = pendulum_velocities(x, PENDULUM_NUMBERS)
        forces = w[[0, 2]] @ cart + w[[6, 8]] @ centre
        return float(u * x[n] + forces - w[10] * rate)
    q, rate = x
    payload = 0.5 * rate * np.array([-math.sin(q), math.cos(q)])
    return float(u * rate + w[[6, 8]] @ payload - (w[4] + w[10]) * rate)


def drift_of_energy(name: str, variant: Variant, x0: tuple[float, ...], duration: float) -> float:
    """Largest change of the energy along an unforced trajectory [J]."""
    plant = analytic(name, variant)
    path = solve_ivp(
        lambda t, x: plant.derivative(x), (0, duration), x0, method="DOP853", rtol=1e-12, atol=1e-12
    )
    energies = np.array([energy(name, x) for x in path.y.T])
    return float(np.max(np.abs(energies - energies[0])))


FREE = {"cart_pendulum": ((0.0, 0.1, 0.3, 0.0), 10.0), "arm": ((0.0, 0.5), 10.0)}


@pytest.mark.parametrize("name", [*FREE, "two_link_arm"])
def test_corrected_plants_conserve_energy(name: str) -> None:
    # Some hundred steps of relative error 1e-12, on energies of 1 J (pendulum) and 0.1 J.
    start = FREE.get(name, ((-1.2, 0.4, 0.5, -0.3), 5.0))
    assert drift_of_energy(name, "corrected", *start) < 1e-10


@pytest.mark.parametrize(("name", "gain"), [("cart_pendulum", 0.1), ("arm", 0.03)])
def test_printed_plants_do_not_conserve_energy(name: str, gain: float) -> None:
    """Without input, friction or disturbance they change by a tenth of the energy at play."""
    assert drift_of_energy(name, "printed", *FREE[name]) > gain


def test_frictionless_servo_keeps_its_speed() -> None:
    plant = AnalyticPlant(SERVO, dataclasses.replace(SERVO_NUMBERS, B=0.0))
    np.testing.assert_array_equal(plant.derivative([0.3, 2.0]), [2.0, 0.0])


vectors = st.lists(st.floats(-5, 5), min_size=24, max_size=24).map(np.array)


@pytest.mark.parametrize("name", list(SYSTEMS))
@given(vector=vectors)
@settings(max_examples=300)
def test_energy_changes_by_the_power_of_input_wrench_and_friction(name: str, vector: Array) -> None:
    """dE/dt along x' equals force times velocity, for every state, input and wrench."""
    plant = analytic(name)
    n, nw = len(plant.system.states), 6 * len(plant.system.bodies)
    x, u, w = vector[:n], vector[4 : 4 + len(plant.system.inputs)], vector[6 : 6 + nw]
    rate = plant.derivative(x, u, w)
    step = 1e-4
    gradient = np.array(
        [
            (
                8 * (energy(name, x + e) - energy(name, x - e))
                - (energy(name, x + 2 * e) - energy(name, x - 2 * e))
            )
            / (12 * step)
            for e in step * np.eye(n)
        ]
    )
    # Fourth-order differences: rounding of E divided by the step, 1e-12 J times a rate of x.
    tolerance = 1e-9 * (1 + np.abs(rate).max())
    assert gradient @ rate == pytest.approx(power(name, x, u, w), rel=1e-9, abs=tolerance)


@pytest.mark.parametrize("variant", ["printed", "corrected"])
def test_horizontal_momentum_changes_by_the_horizontal_forces(variant: Variant) -> None:
    """The equation that the chapter leaves out; it holds with either coefficient a of eq. (40)."""
    p, rng = PENDULUM_NUMBERS, np.random.default_rng(3)
    for _ in range(100):
        x, u = rng.normal(0, 2, 4), rng.normal()
        _, theta, _, rate = x
        _, _, acceleration, alpha = analytic("cart_pendulum", variant).derivative(x, u)
        pole = acceleration - p.L * (alpha * math.cos(theta) - rate**2 * math.sin(theta))
        assert p.M * acceleration + p.m * pole == pytest.approx(u, abs=1e-12)


def test_printed_input_gain_of_the_pendulum_is_a_fifth_of_the_true_one() -> None:
    """Upright: m (4/3 - m/(M+m)) / (4/3 - m^2/(M+m)) = 0.2 * 35/39, from the two values of a."""
    upright = [0.0, 0.0, 0.0, 0.0]
    printed = analytic("cart_pendulum", "printed").derivative(upright, 1.0)[3]
    corrected = analytic("cart_pendulum").derivative(upright, 1.0)[3]
    assert printed / corrected == pytest.approx(0.2 * 35 / 39, rel=1e-14)


def test_pivot_torque_of_the_upright_pole_is_that_of_the_bare_mass_matrix() -> None:
    """The column of M^-1 with the cart free: d = torque / (I - coupling^2/(M+m))."""
    p = PENDULUM_NUMBERS
    coupling = -p.m * p.L
    matrix = np.array([[p.M + p.m, coupling], [coupling, p.m * (2 * p.L) ** 2 / 3]])
    torque = 1 / np.linalg.inv(matrix)[1, 1]
    assert pole_torque(0.01, p) == pytest.approx(0.01 * torque, rel=1e-14)


def test_reading_a_model_leaves_it_as_it_is(name: str) -> None:
    model = load_model(name)
    before = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    after = before.copy()
    mujoco.mj_saveModel(model, None, before)
    AnalyticPlant.from_model(SYSTEMS[name], model)
    mujoco.mj_saveModel(model, None, after)
    np.testing.assert_array_equal(before, after)
