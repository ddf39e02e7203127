"""Equations in sympy: what is generated from them is the hand-written plant, in both engines."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
import sympy as sp
from hand_written import BY_HAND

from grosmc_mj.codegen import generate
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO, find_system
from grosmc_mj.plants.equations import Equations

# Numbers that are no round ones, and none of them as in the model.
EDITS = {
    "servo": (BodyEdit("rotor", 1.7, 1.3),),
    "cart_pendulum": (BodyEdit("pole", 2.3, 1.7), BodyEdit("cart", 0.7)),
    "arm": (BodyEdit("link", 1.9, 1.1),),
    "two_link_arm": (BodyEdit("upper", 1.9, 1.1), BodyEdit("lower", 0.7, 1.3)),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_equations_are_the_hand_written_ones(name: str) -> None:
    """To rounding of the terms that they are sums of, with numbers that are not round.

    The terms of d(x, w) are the shares of each component of the wrench, for d is linear in w.
    """
    hand, random, system = BY_HAND[name], np.random.default_rng(0), find_system(name)
    n = system.degrees_of_freedom
    for plant in (MujocoPlant.load(name, edits=EDITS[name]).analytic(v) for v in system.variants):
        p = plant.parameters
        for _ in range(60):
            x = np.concatenate([random.uniform(-math.pi, math.pi, n), random.normal(0, 5, n)])
            u = random.normal(0, 5, len(system.inputs))
            w = random.normal(0, 5, 6 * len(system.bodies))
            g = np.reshape(hand.input_matrix(x, p), (2 * n, -1))
            expected = hand.drift(x, p) + g @ u + hand.disturbance(x, w, p)
            pushes = np.abs([hand.disturbance(x, row, p)[n:] for row in np.diag(w)]).sum()
            atol = 1e-14 * (hand.size(x, p) + (np.abs(g) @ np.abs(u)).max() + pushes)
            np.testing.assert_allclose(plant.derivative(x, u, w), expected, rtol=0, atol=atol)
    edges = [share * math.pi for share in (-2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2)]
    near = [np.nextafter(edge, side) for edge in edges for side in (-math.inf, math.inf)]
    for angle in [*edges, *near, *np.linspace(-7, 7, 141).tolist()]:
        x = np.repeat([angle, 0.0], n)
        assert system.singular(x) == hand.singular(x), angle
        assert system.linearizable(x) == hand.linearizable(x), angle


# A plant of two inputs

X1, X2, X3, W1, A, B = sp.symbols("x1 x2 x3 w1 a b")
SQUARE: dict[str, Any] = {
    "x": (X1, X2, X3), "f": (X2, A * X1 * X3, -X3), "g": ((0, 0), (2, X1), (B, 3 + X2**2)),
    "h": (X1, X3), "w": (W1,), "d": (0, W1, 0),
}  # fmt: skip


def test_several_inputs_add_up_row_by_row() -> None:
    plant, calm = Equations(**SQUARE), Equations(**{**SQUARE, "w": (), "d": ()})
    p, x = SimpleNamespace(a=1.5, b=-0.5), np.array([0.2, 0.7, -0.4])
    assert (plant.inputs, plant.parameters) == (2, (A, B))
    assert plant.drift(x, p) == (0.7, 1.5 * 0.2 * -0.4, 0.4)
    assert plant.input_matrix(x, p) == (0, 0, 2, 0.2, -0.5, 3 + 0.7 * 0.7)
    assert (plant.disturbance(x, [2.5], p), calm.disturbance(x, [], p)) == ((0, 2.5, 0), (0, 0, 0))
    assert (calm.singular(x), calm.linearizable(x)) == (False, True)
    plain = Equations(**{**SQUARE, "g": (0, 1, B), "h": (X1,)})
    assert (plain.g, plain.inputs) == (((0,), (1,), (B,)), 1)


def use(name: str, **change: Any) -> Any:
    return getattr(Equations(**{**SQUARE, **change}), name)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Equations(**{**SQUARE, "f": (X2, X3)}),
         "f has 2 rows of 1, must have one for each of 3 states"),
        (lambda: Equations(**{**SQUARE, "g": ((0, 0), (1, 2), (3,))}), "equations are no columns"),
        (lambda: Equations(**{**SQUARE, "d": (0, W1)}), "d has 2 rows"),
        (lambda: Equations(**{**SQUARE, "x": (X1, X2, X2)}),
         r"states \[x1, x2, x2\] must be 3 different symbols"),
        # f(x) and g(x) are functions of the state and of the parameters, conditions of the state.
        (lambda: use("drift", f=(X2, W1, X3)), "drift: unknown symbol w1"),
        (lambda: use("linearizable", region=X1 > A), "unknown symbol a"),
        # Functions that Python's math has not.
        (lambda: use("drift", f=(X2, sp.Integral(sp.sin(X1**2), X1), X3)), "drift: "),
        (lambda: replace(SERVO, states=SERVO.states[:1]),
         "servo: 1 states are named, the equations have 2"),
        (lambda: replace(SERVO, bodies=(1,)), "bodies = .* must be a tuple of names"),
        (lambda: generate("speed", [X1 + sp.Symbol("z"), sp.Symbol("q")], "x", {X1: "x[0]"}),
         r"speed: unknown symbol q, z; known: x1"),
    ],
)  # fmt: skip
def test_equations_that_do_not_fit_are_refused(call: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        call()


# What is printed as what


VALUES = {
    X1**2: 0.7 * 0.7,
    X1**-3: 1 / 0.7**3,
    X1**11: 0.7**11,
    1 / sp.sqrt(X1): 1 / math.sqrt(0.7),
    X1 ** sp.Rational(2, 3): 0.7 ** (2 / 3),
    sp.exp(-X1) + sp.log(X1): math.exp(-0.7) + math.log(0.7),
    sp.tanh(X1) + sp.atan2(X1, 2): math.tanh(0.7) + math.atan2(0.7, 2),
    sp.Abs(X1 - 1): 0.3,
    sp.pi / 2 - X1 / 3: math.pi / 2 - 0.7 / 3,
    sp.Piecewise((X1, X1 > 1), (2 * X1, True)): 1.4,
    sp.Integer(2): 2.0,
}


def test_expressions_are_computed_as_by_hand() -> None:
    """As floats, for compiled code has one type for all entries of a tuple."""
    function, x = generate("values", list(VALUES), "x", {X1: "x[0]"}), np.array([0.7])
    assert function(x) == pytest.approx(tuple(VALUES.values()), rel=1e-15)
    assert all(type(entry) is float for entry in function([0.7]))
    assert numba.njit(lambda x: function(x))(x) == function(x)
    # A traceback shows the generated line.
    function = generate("root", [sp.sqrt(X1)], "x", {X1: "x[0]"})
    with pytest.raises(ValueError, match="math domain error") as info:
        function([-1.0])
    assert str(info.traceback[-1].statement).strip() == "return (math.sqrt(x[0]),)"
