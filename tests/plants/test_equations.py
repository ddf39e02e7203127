"""Equations in sympy: what is generated from them is the hand-written plant, in both engines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
import sympy as sp
from hand_written import HAND_WRITTEN, arm_coriolis, arm_inertia, pendulum_coefficient

from grosmc_mj.arrays import Array
from grosmc_mj.codegen import generate, generate_condition
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO, SYSTEMS, AnalyticPlant, Signal, System, Variant, find_system
from grosmc_mj.plants.equations import Equations
from grosmc_mj.records import pack, record_dtype

POINTS = 300
ROUNDING = 1e-14
# Every system, and every set of equations that the chapter leads to.
VARIANTS = [(name, variant) for name in HAND_WRITTEN for variant in find_system(name).variants]
each_plant = pytest.mark.parametrize(("name", "variant"), VARIANTS)
# Numbers that are no round ones, and none of them as in the model.
EDITS = {
    "servo": (BodyEdit("rotor", 1.7, 1.3),),
    "cart_pendulum": (BodyEdit("pole", 2.3, 1.7), BodyEdit("cart", 0.7)),
    "arm": (BodyEdit("link", 1.9, 1.1),),
}


@cache
def plant(name: str, variant: Variant, edited: bool = False) -> AnalyticPlant:
    return MujocoPlant.load(name, edits=EDITS[name] if edited else ()).analytic(variant)


def points(system: System) -> Iterator[tuple[Array, Array, Array]]:
    """Random states, inputs and wrenches, angles all around."""
    random, n = np.random.default_rng(0), system.degrees_of_freedom
    for _ in range(POINTS):
        x = np.concatenate([random.uniform(-math.pi, math.pi, n), random.normal(0, 5, n)])
        u = random.normal(0, 5, len(system.inputs))
        yield x, u, random.normal(0, 5, 6 * len(system.bodies))


@pytest.mark.parametrize("edited", [False, True])
@each_plant
def test_generated_functions_are_the_hand_written_ones(
    name: str, variant: Variant, edited: bool
) -> None:
    """To rounding of the terms that each is the sum of; rows that are no sum are equal.

    The terms of d(x, w) are what each component of the wrench does alone, for d is linear in w.
    """
    by_hand, ours = HAND_WRITTEN[name], plant(name, variant, edited)
    p, system, n = ours.parameters, ours.system, ours.system.degrees_of_freedom
    for x, u, w in points(system):
        f, g, d = (
            system.equations.drift(x, p),
            system.equations.input_matrix(x, p),
            system.equations.disturbance(x, w, p),
        )
        expected = by_hand.drift(x, p), by_hand.input_matrix(x, p), by_hand.disturbance(x, w, p)
        for found, wanted in zip((f, g, d), expected, strict=True):
            assert found[:n] == wanted[:n]
        alone = [by_hand.disturbance(x, row, p)[n:] for row in np.diag(w)]
        sizes = [by_hand.size(x, p), np.abs(expected[1]).max(), np.abs(alone).sum()]
        for found, wanted, size in zip((f, g, d), expected, sizes, strict=True):
            np.testing.assert_allclose(found[n:], wanted[n:], rtol=0, atol=ROUNDING * size)
        terms = [np.array(expected[0]), np.multiply(expected[1], u), np.array(expected[2])]
        largest = ROUNDING * max(np.abs(terms).max(), sizes[0], sizes[2])
        np.testing.assert_allclose(ours.derivative(x, u, w), sum(terms), rtol=0, atol=largest)


@each_plant
def test_generated_regions_are_the_hand_written_ones(name: str, variant: Variant) -> None:
    by_hand, system = HAND_WRITTEN[name], plant(name, variant).system
    edges = [sign * share * math.pi for sign in (-1, 1) for share in (0, 0.5, 1, 1.5, 2)]
    near = [np.nextafter(edge, side) for edge in edges for side in (-math.inf, math.inf)]
    n = system.degrees_of_freedom
    for angle in [*edges, *near, *np.linspace(-7, 7, 141).tolist()]:
        x = np.concatenate([np.full(n, angle), np.zeros(n)])
        assert system.singular(x) == by_hand.singular(x), angle
        assert system.linearizable(x) == by_hand.linearizable(x), angle


def test_variants_differ_by_the_printed_coefficients() -> None:
    """a = m/(M+m) for 1/(M+m) in eq. (40), and C = 0.03 cos q for 0.03 cos(q) q' in eq. (57)."""
    x = np.array([0.0, 0.4, 0.3, 2.0])
    for name, state in (("cart_pendulum", x), ("arm", x[[1, 3]])):
        drifts = []
        for variant in ("printed", "corrected"):
            p, system = plant(name, variant).parameters, find_system(name)
            drifts.append(np.array(system.equations.drift(state, p)))
        assert np.abs(drifts[0] - drifts[1]).max() > 0.01
    printed, corrected = (plant("cart_pendulum", v).parameters for v in ("printed", "corrected"))
    ratio = pendulum_coefficient(printed) / pendulum_coefficient(corrected)
    assert ratio == pytest.approx(printed.m, rel=1e-15)
    printed, corrected = (plant("arm", v).parameters for v in ("printed", "corrected"))
    assert arm_coriolis(0.4, 2.0, printed) == pytest.approx(0.03 * math.cos(0.4), rel=1e-12)
    assert arm_coriolis(0.4, 2.0, corrected) == pytest.approx(0.06 * math.cos(0.4), rel=1e-12)
    assert arm_inertia(0.4, printed) == pytest.approx(0.1 + 0.06 * math.sin(0.4), rel=1e-12)


def compiled(function: Callable[..., Any], arity: int) -> Callable[..., Any]:
    """A generated function called from numba's code."""
    if arity == 1:
        return numba.njit(lambda x: function(x))
    if arity == 2:
        return numba.njit(lambda x, p: function(x, p))
    return numba.njit(lambda x, w, p: function(x, w, p))


def record(parameters: Any) -> Any:
    """Parameters as compiled code has them."""
    return pack(parameters).view(record_dtype(parameters))[0]


@each_plant
def test_compiled_code_computes_the_same_to_the_last_bit(name: str, variant: Variant) -> None:
    ours = plant(name, variant, edited=True)
    p, system = ours.parameters, ours.system
    numbers = record(p)
    drift, matrix = compiled(system.equations.drift, 2), compiled(system.equations.input_matrix, 2)
    disturbance = compiled(system.equations.disturbance, 3)
    singular, linearizable = compiled(system.singular, 1), compiled(system.linearizable, 1)
    for x, _, w in points(system):
        assert drift(x, numbers) == system.equations.drift(x, p)
        assert matrix(x, numbers) == system.equations.input_matrix(x, p)
        assert disturbance(x, w, numbers) == system.equations.disturbance(x, w, p)
        assert singular(x) == system.singular(x)
        assert linearizable(x) == system.linearizable(x)


def test_functions_are_generated_once() -> None:
    """The compiled engine compiles what it has not compiled yet, by identity."""
    for system in SYSTEMS.values():
        for name in ("drift", "input_matrix", "disturbance", "singular", "linearizable"):
            assert getattr(system.equations, name) is getattr(system.equations, name)


# A plant of two inputs


@dataclass(frozen=True)
class Numbers:
    """Parameters of the plant below."""

    a: float
    b: float


X1, X2, X3, W1 = sp.symbols("x1 x2 x3 w1")
A, B = sp.symbols("a b")
SQUARE: dict[str, Any] = {
    "x": (X1, X2, X3),
    "f": (X2, A * X1 * X3, -X3),
    "g": ((0, 0), (2, X1), (B, 3 + X2**2)),
    "h": (X1, X3),
    "w": (W1,),
    "d": (0, W1, 0),
}


def test_input_matrix_is_row_by_row() -> None:
    plant, p = Equations(**SQUARE), Numbers(1.5, -0.5)
    x = np.array([0.2, 0.7, -0.4])
    assert plant.inputs == 2
    assert plant.parameters == (A, B)
    assert plant.drift(x, p) == (0.7, 1.5 * 0.2 * -0.4, 0.4)
    expected = np.array([[0, 0], [2, 0.2], [-0.5, 3 + 0.7 * 0.7]])
    np.testing.assert_array_equal(np.reshape(plant.input_matrix(x, p), (3, 2)), expected)
    assert plant.disturbance(x, [2.5], p) == (0, 2.5, 0)


def test_several_inputs_add_up_in_the_derivative() -> None:
    system = System(
        name="square",
        title="Square",
        states=tuple(Signal(f"state {i}", f"x{i}", "1") for i in range(3)),
        inputs=(Signal("first", "u1", "1"), Signal("second", "u2", "1")),
        equations=Equations(**{**SQUARE, "w": (), "d": ()}),
    )
    ours, x = AnalyticPlant(system, Numbers(1.5, -0.5)), np.array([0.2, 0.7, -0.4])
    columns = np.reshape(system.equations.input_matrix(x, ours.parameters), (3, 2))
    expected = np.array(system.equations.drift(x, ours.parameters)) + columns @ [0.3, -2.0]
    np.testing.assert_allclose(ours.derivative(x, [0.3, -2.0]), expected, rtol=1e-15)
    np.testing.assert_array_equal(
        ours.derivative(x), system.equations.drift(x, ours.parameters)
    )  # no input is zero input


def test_one_input_needs_no_rows_of_rows() -> None:
    plain = Equations(**{**SQUARE, "g": (0, 1, B), "h": (X1,)})
    nested = Equations(**{**SQUARE, "g": ((0,), (1,), (B,)), "h": (X1,)})
    assert plain.g == nested.g
    assert plain.inputs == 1


def test_a_plant_without_wrenches_is_not_disturbed() -> None:
    calm = Equations(**{**SQUARE, "w": (), "d": ()})
    assert calm.disturbance(np.zeros(3), np.zeros(0), Numbers(1, 1)) == (0, 0, 0)
    assert not calm.singular(np.zeros(3))
    assert calm.linearizable(np.zeros(3))


# What is refused


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"f": (X2, X3)}, "f has 2 rows of 1, must have one for each of 3 states"),
        ({"f": (X2, X3, X1, X2)}, "f has 4 rows"),
        ({"g": ((0, 1), (1, 0))}, "g has 2 rows"),
        ({"d": (0, W1)}, "d has 2 rows"),
        ({"g": ((0, 0), (1, 2), (3,))}, "the equations are no columns"),
        ({"g": ((0, 0), 1, (2, 3))}, "the equations are no columns"),
        ({"g": ((), (), ())}, "g has 3 rows of 0, must have"),
        ({"x": (X1, X2, X2)}, r"states \[x1, x2, x2\] must be 3 different symbols"),
        ({"x": (X1, X2, X1 + X3)}, r"states \[x1, x2, x1 \+ x3\] must be 3 different symbols"),
        ({"x": (X1, X2, 1.0)}, "must be 3 different symbols"),
    ],
)
def test_equations_that_do_not_fit_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Equations(**{**SQUARE, **change})


def test_symbol_without_a_place_is_named_with_those_that_have_one() -> None:
    with pytest.raises(ModelError, match=r"speed: unknown symbol q, z; known: x1, x2"):
        generate("speed", [X1 + sp.Symbol("z"), sp.Symbol("q")], "x", {X1: "x[0]", X2: "x[1]"})
    with pytest.raises(ModelError, match="where: unknown symbol x2; known: x1"):
        generate_condition("where", X2 > 0, {X1: "x[0]"})


@pytest.mark.parametrize("function", ["drift", "input_matrix"])
def test_only_the_disturbance_may_have_a_wrench(function: str) -> None:
    """f(x) and g(x) are functions of the state and of the parameters."""
    change = {"f": (X2, W1, X3)} if function == "drift" else {"g": ((0, 0), (W1, 0), (0, 1))}
    equations = Equations(**{**SQUARE, **change})
    with pytest.raises(ModelError, match=f"{function}: unknown symbol w1"):
        getattr(equations, function)


@pytest.mark.parametrize("condition", ["breaks_down", "region"])
def test_conditions_are_on_the_states_alone(condition: str) -> None:
    equations = Equations(**{**SQUARE, condition: X1 > A})
    with pytest.raises(ModelError, match="unknown symbol a"):
        getattr(equations, "singular" if condition == "breaks_down" else "linearizable")


@pytest.mark.parametrize(
    "unsupported", [sp.besselj(0, X1), sp.Function("friction")(X1), sp.Integral(sp.sin(X1**2), X1)]
)
def test_function_that_python_s_math_has_not_is_refused(unsupported: sp.Expr) -> None:
    equations = Equations(**{**SQUARE, "f": (X2, unsupported, X3)})
    with pytest.raises(ModelError, match="drift: "):
        _ = equations.drift


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"states": SERVO.states[:1]}, "servo: 1 states are named, the equations have 2"),
        ({"inputs": SERVO.inputs * 2}, "servo: 2 inputs are named, the equations have 1"),
        ({"bodies": ()}, "servo: 0 wrench components are named, the equations have 6"),
    ],
)
def test_system_that_names_other_signals_than_its_equations_is_refused(
    change: dict[str, Any], message: str
) -> None:
    with pytest.raises(ModelError, match=message):
        replace(SERVO, **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"states": ("angle",)}, "states = .* must be a tuple of Signals"),
        ({"bodies": (1,)}, "bodies = .* must be a tuple of names"),
    ],
)
def test_what_is_no_signal_or_no_name_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        replace(SERVO, **change)


# What is printed as what


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        (X1**2, 0.7 * 0.7),
        (X1**8, 0.7**8),
        (X1**-3, 1 / 0.7**3),
        (X1**11, 0.7**11),
        (sp.sqrt(X1), math.sqrt(0.7)),
        (1 / sp.sqrt(X1), 1 / math.sqrt(0.7)),
        (X1 ** sp.Rational(2, 3), 0.7 ** (2 / 3)),
        (sp.exp(-X1), math.exp(-0.7)),
        (sp.log(X1), math.log(0.7)),
        (sp.tanh(X1), math.tanh(0.7)),
        (sp.atan2(X1, 2), math.atan2(0.7, 2)),
        (sp.Abs(X1 - 1), 0.3),
        (sp.Rational(1, 3) * X1, 0.7 / 3),
        (sp.pi / 2 - X1, math.pi / 2 - 0.7),
        (sp.Piecewise((X1, X1 > 1), (2 * X1, True)), 1.4),
        (sp.Integer(2), 2.0),
    ],
)
def test_expressions_are_computed_as_by_hand(expression: sp.Expr, value: float) -> None:
    function = generate("value", [expression], "x", {X1: "x[0]"})
    x = np.array([0.7])
    assert function(x) == pytest.approx((value,), rel=1e-15)
    assert compiled(function, 1)(x) == function(x)


def test_generated_values_are_floats() -> None:
    """Compiled code has one type for all entries of a tuple."""
    values = generate("mixed", [sp.Integer(0), X1, sp.Rational(1, 2), sp.pi], "x", {X1: "x[0]"})
    assert all(type(value) is float for value in values([0.5]))


def test_traceback_shows_the_generated_line() -> None:
    function = generate("root", [sp.sqrt(X1)], "x", {X1: "x[0]"})
    with pytest.raises(ValueError, match="math domain error") as info:
        function([-1.0])
    assert str(info.traceback[-1].statement).strip() == "return (math.sqrt(x[0]),)"
