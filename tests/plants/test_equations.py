"""Equations in sympy: what is generated from them is the hand-written plant, in both engines."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
import sympy as sp
from hand_written import BY_HAND, arm_coriolis, arm_inertia, pendulum_coefficient

from grosmc_mj.codegen import generate, generate_condition
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO, SYSTEMS, AnalyticPlant, Signal, System, Variant, find_system
from grosmc_mj.plants.equations import Equations
from grosmc_mj.records import pack, record_dtype

VARIANTS = [(name, variant) for name in BY_HAND for variant in find_system(name).variants]
each_plant = pytest.mark.parametrize(("name", "variant"), VARIANTS)
# Numbers that are no round ones, and none of them as in the model.
EDITS = {
    "servo": (BodyEdit("rotor", 1.7, 1.3),),
    "cart_pendulum": (BodyEdit("pole", 2.3, 1.7), BodyEdit("cart", 0.7)),
    "arm": (BodyEdit("link", 1.9, 1.1),),
    "two_link_arm": (BodyEdit("upper", 1.9, 1.1), BodyEdit("lower", 0.7, 1.3)),
}


@cache
def plant(name: str, variant: Variant, edited: bool = False) -> AnalyticPlant:
    return MujocoPlant.load(name, edits=EDITS[name] if edited else ()).analytic(variant)


def compiled(function: Callable[..., Any], arity: int) -> Callable[..., Any]:
    """A generated function called from numba's code."""
    if arity == 1:
        return numba.njit(lambda x: function(x))
    if arity == 2:
        return numba.njit(lambda x, p: function(x, p))
    return numba.njit(lambda x, w, p: function(x, w, p))


@each_plant
def test_generated_functions_are_the_hand_written_ones(name: str, variant: Variant) -> None:
    """To rounding of the terms that they are sums of, and to the last bit in compiled code.

    The terms of d(x, w) are what each component of the wrench does alone, for d is linear in w.
    """
    hand, random = BY_HAND[name], np.random.default_rng(0)
    for ours in (plant(name, variant), plant(name, variant, edited=True)):
        p, equations, n = ours.parameters, ours.system.equations, ours.system.degrees_of_freedom
        record = pack(p).view(record_dtype(p))[0]
        functions: list[tuple[Any, int]] = [
            (equations.drift, 2), (equations.input_matrix, 2), (equations.disturbance, 3),
        ]  # fmt: skip
        in_code = [compiled(*one) for one in functions]
        bodies, m = len(ours.system.bodies), len(ours.system.inputs)
        for _ in range(60):
            x = np.concatenate([random.uniform(-math.pi, math.pi, n), random.normal(0, 5, n)])
            u, w = random.normal(0, 5, m), random.normal(0, 5, 6 * bodies)
            arguments, results = [(x,), (x,), (x, w)], list[Any]()
            for (function, _), fast, points in zip(functions, in_code, arguments, strict=True):
                results.append(function(*points, p))
                assert fast(*points, record) == results[-1]
            by_hand = hand.drift(x, p), hand.input_matrix(x, p), hand.disturbance(x, w, p)
            alone = [hand.disturbance(x, row, p)[n:] for row in np.diag(w)]
            sizes = hand.size(x, p), np.abs(by_hand[1]).max(), np.abs(alone).sum()
            for actual, expected, size in zip(results, by_hand, sizes, strict=True):
                assert actual[: len(actual) // 2] == expected[: len(actual) // 2]
                np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-14 * size)
            g = np.reshape(by_hand[1], (2 * n, -1))
            total = np.array(by_hand[0]) + g @ u + by_hand[2]
            atol = 1e-14 * (sizes[0] + (np.abs(g) @ np.abs(u)).max() + sizes[2])
            np.testing.assert_allclose(ours.derivative(x, u, w), total, rtol=0, atol=atol)


@each_plant
def test_generated_regions_are_the_hand_written_ones(name: str, variant: Variant) -> None:
    system, n = plant(name, variant).system, plant(name, variant).system.degrees_of_freedom
    edges = [sign * share * math.pi for sign in (-1, 1) for share in (0, 0.5, 1, 1.5, 2)]
    near = [np.nextafter(edge, side) for edge in edges for side in (-math.inf, math.inf)]
    regions = [(system.singular, compiled(system.singular, 1), BY_HAND[name].singular),
               (system.linearizable, compiled(system.linearizable, 1),
                BY_HAND[name].linearizable)]  # fmt: skip
    for angle in [*edges, *near, *np.linspace(-7, 7, 141).tolist()]:
        x = np.concatenate([np.full(n, angle), np.zeros(n)])
        for actual, in_code, expected in regions:
            assert actual(x) == in_code(x) == expected(x), angle
        # The cart's force turns the pole as it does upright.
        gain = system.equations.input_matrix(x, plant(name, variant).parameters)[-1]
        assert not system.linearizable(x) or gain > 0


def test_variants_differ_by_the_printed_coefficients() -> None:
    """a = m/(M+m) for 1/(M+m) in eq. (40), and C = 0.03 cos q for 0.03 cos(q) q' in eq. (57)."""
    printed, corrected = (plant("cart_pendulum", v).parameters for v in ("printed", "corrected"))
    ratio = pendulum_coefficient(printed) / pendulum_coefficient(corrected)
    assert ratio == pytest.approx(printed.m, rel=1e-15)
    printed, corrected = (plant("arm", v).parameters for v in ("printed", "corrected"))
    assert arm_coriolis(0.4, 2.0, printed) == pytest.approx(0.03 * math.cos(0.4), rel=1e-12)
    assert arm_coriolis(0.4, 2.0, corrected) == pytest.approx(0.06 * math.cos(0.4), rel=1e-12)
    assert arm_inertia(0.4, printed) == pytest.approx(0.1 + 0.06 * math.sin(0.4), rel=1e-12)


def test_functions_are_generated_once() -> None:
    """The compiled engine compiles what it has not compiled yet, by identity."""
    for system in SYSTEMS.values():
        for name in ("drift", "input_matrix", "disturbance", "singular", "linearizable"):
            assert getattr(system.equations, name) is getattr(system.equations, name)


# A plant of two inputs


@dataclass(frozen=True)
class Numbers:
    a: float
    b: float


X1, X2, X3, W1 = sp.symbols("x1 x2 x3 w1")
A, B = sp.symbols("a b")
SQUARE: dict[str, Any] = {
    "x": (X1, X2, X3), "f": (X2, A * X1 * X3, -X3), "g": ((0, 0), (2, X1), (B, 3 + X2**2)),
    "h": (X1, X3), "w": (W1,), "d": (0, W1, 0),
}  # fmt: skip


def test_several_inputs_add_up_row_by_row() -> None:
    plant, calm = Equations(**SQUARE), Equations(**{**SQUARE, "w": (), "d": ()})
    p, x = Numbers(1.5, -0.5), np.array([0.2, 0.7, -0.4])
    assert (plant.inputs, plant.parameters) == (2, (A, B))
    assert plant.drift(x, p) == (0.7, 1.5 * 0.2 * -0.4, 0.4)
    g = np.array([[0, 0], [2, 0.2], [-0.5, 3 + 0.7 * 0.7]])
    np.testing.assert_array_equal(np.reshape(plant.input_matrix(x, p), (3, 2)), g)
    assert plant.disturbance(x, [2.5], p) == (0, 2.5, 0)
    assert calm.disturbance(x, np.zeros(0), p) == (0, 0, 0)
    assert (calm.singular(x), calm.linearizable(x)) == (False, True)
    states = tuple(Signal(f"state {i}", f"x{i}", "1") for i in range(3))
    inputs = (Signal("first", "u1", "1"), Signal("second", "u2", "1"))
    system = System(name="square", title="Square", states=states, inputs=inputs, equations=calm)
    ours, drift = AnalyticPlant(system, p), np.array(plant.drift(x, p))
    np.testing.assert_allclose(ours.derivative(x, [0.3, -2.0]), drift + g @ [0.3, -2.0], rtol=1e-15)
    np.testing.assert_array_equal(ours.derivative(x), drift)
    plain, nested = (
        Equations(**{**SQUARE, "g": rows, "h": (X1,)}) for rows in ((0, 1, B), ((0,), (1,), (B,)))
    )
    assert (plain.g, plain.inputs) == (nested.g, 1)


# What is refused


def use(name: str, **change: Any) -> Any:
    return getattr(Equations(**{**SQUARE, **change}), name)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        *((lambda change=change: Equations(**{**SQUARE, **change}), words) for change, words in (
            ({"f": (X2, X3)}, "f has 2 rows of 1, must have one for each of 3 states"),
            ({"f": (X2, X3, X1, X2)}, "f has 4 rows"),
            ({"g": ((0, 1), (1, 0))}, "g has 2 rows"),
            ({"d": (0, W1)}, "d has 2 rows"),
            ({"g": ((0, 0), (1, 2), (3,))}, "the equations are no columns"),
            ({"g": ((), (), ())}, "g has 3 rows of 0, must have"),
            ({"x": (X1, X2, X2)}, r"states \[x1, x2, x2\] must be 3 different symbols"),
            ({"x": (X1, X2, 1.0)}, "must be 3 different symbols"),
        )),
        # f(x) and g(x) are functions of the state and of the parameters, conditions of the state.
        (lambda: use("drift", f=(X2, W1, X3)), "drift: unknown symbol w1"),
        (lambda: use("input_matrix", g=((0, 0), (W1, 0), (0, 1))), "input_matrix: .* symbol w1"),
        (lambda: use("singular", breaks_down=X1 > A), "unknown symbol a"),
        (lambda: use("linearizable", region=X1 > A), "unknown symbol a"),
        # Functions that Python's math has not.
        *((lambda f=f: use("drift", f=(X2, f, X3)), "drift: ") for f in (
            sp.besselj(0, X1), sp.Function("friction")(X1), sp.Integral(sp.sin(X1**2), X1))),
        *((lambda change=change: replace(SERVO, **change), words) for change, words in (
            ({"states": SERVO.states[:1]}, "servo: 1 states are named, the equations have 2"),
            ({"inputs": SERVO.inputs * 2}, "servo: 2 inputs are named, the equations have 1"),
            ({"bodies": ()}, "servo: 0 wrench components are named, the equations have 6"),
            ({"states": ("angle",)}, "states = .* must be a tuple of Signals"),
            ({"bodies": (1,)}, "bodies = .* must be a tuple of names"),
        )),
        (lambda: generate("speed", [X1 + sp.Symbol("z"), sp.Symbol("q")], "x", {X1: "x[0]"}),
         r"speed: unknown symbol q, z; known: x1"),
        (lambda: generate_condition("where", X2 > 0, {X1: "x[0]"}), "where: unknown symbol x2"),
    ],
)  # fmt: skip
def test_equations_that_do_not_fit_are_refused(call: Callable[[], Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        call()


# What is printed as what


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        (X1**2, 0.7 * 0.7),
        (X1**-3, 1 / 0.7**3),
        (X1**11, 0.7**11),
        (1 / sp.sqrt(X1), 1 / math.sqrt(0.7)),
        (X1 ** sp.Rational(2, 3), 0.7 ** (2 / 3)),
        (sp.exp(-X1) + sp.log(X1), math.exp(-0.7) + math.log(0.7)),
        (sp.tanh(X1) + sp.atan2(X1, 2), math.tanh(0.7) + math.atan2(0.7, 2)),
        (sp.Abs(X1 - 1), 0.3),
        (sp.pi / 2 - X1 / 3, math.pi / 2 - 0.7 / 3),
        (sp.Piecewise((X1, X1 > 1), (2 * X1, True)), 1.4),
        (sp.Integer(2), 2.0),
    ],
)
def test_expressions_are_computed_as_by_hand(expression: sp.Expr, value: float) -> None:
    """As floats, for compiled code has one type for all entries of a tuple."""
    function = generate("value", [expression, sp.Integer(0), sp.pi], "x", {X1: "x[0]"})
    x = np.array([0.7])
    assert function(x) == pytest.approx((value, 0, math.pi), rel=1e-15)
    assert all(type(entry) is float for entry in function([0.7]))
    assert compiled(function, 1)(x) == function(x)


def test_traceback_shows_the_generated_line() -> None:
    function = generate("root", [sp.sqrt(X1)], "x", {X1: "x[0]"})
    with pytest.raises(ValueError, match="math domain error") as info:
        function([-1.0])
    assert str(info.traceback[-1].statement).strip() == "return (math.sqrt(x[0]),)"
