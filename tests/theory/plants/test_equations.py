"""Equations in sympy: functions generated from them are the hand-written plant, in both engines."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
import sympy as sp
from hand_written import BY_HAND

from grosmc_mj.ground.compilation.codegen import generate
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.plants import SERVO, find_system
from grosmc_mj.theory.plants.equations import Equations

# Numbers that are no round ones, and none of them as in the model.
EDITS = {
    "servo": (BodyEdit("rotor", 1.7, 1.3),),
    "cart_pendulum": (BodyEdit("pole", 2.3, 1.7), BodyEdit("cart", 0.7)),
    "arm": (BodyEdit("link", 1.9, 1.1),),
    "two_link_arm": (BodyEdit("upper", 1.9, 1.1), BodyEdit("lower", 0.7, 1.3)),
}
VARIANTS = [(name, variant) for name in BY_HAND for variant in find_system(name).variants]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("name", "variant"), VARIANTS)
def test_equations_are_the_hand_written_ones(name: str, variant: Any, seed: int) -> None:
    """They agree to rounding of the terms that they are sums of.

    The terms of d(x, w) are the shares of each component of the wrench, for d is linear in w.
    """
    hand = BY_HAND[name]
    plant = MujocoPlant.load(name, edits=EDITS[name]).analytic(variant)
    p = plant.parameters
    n = plant.system.degrees_of_freedom

    random = np.random.default_rng(seed)
    x = np.concatenate([random.uniform(-math.pi, math.pi, n), random.normal(0, 5, n)])
    u = random.normal(0, 5, len(plant.system.inputs))
    w = random.normal(0, 5, 6 * len(plant.system.bodies))
    g = np.reshape(hand.input_matrix(x, p), (2 * n, -1))
    expected = hand.drift(x, p) + g @ u + hand.disturbance(x, w, p)

    disturbance_terms = [hand.disturbance(x, row, p)[n:] for row in np.diag(w)]
    input_terms = np.abs(g) @ np.abs(u)
    size = hand.size(x, p) + input_terms.max() + np.abs(disturbance_terms).sum()
    np.testing.assert_allclose(plant.derivative(x, u, w), expected, rtol=0, atol=1e-14 * size)


EDGES = [quarter * math.pi / 2 for quarter in range(-4, 5)]


@pytest.mark.parametrize("towards", [None, -math.inf, math.inf])
@pytest.mark.parametrize("angle", [*EDGES, -6.0, 2.0])
@pytest.mark.parametrize("name", BY_HAND)
def test_regions_are_the_hand_written_ones(name: str, angle: float, towards: float | None) -> None:
    """They agree at their edges too, and at the floats next to these."""
    if towards is not None:
        angle = float(np.nextafter(angle, towards))
    system = find_system(name)
    x = np.repeat([angle, 0.0], system.degrees_of_freedom)
    assert system.singular(x) == BY_HAND[name].singular(x)
    assert system.linearizable(x) == BY_HAND[name].linearizable(x)


# A plant of two inputs

X1, X2, X3, W1, A, B = sp.symbols("x1 x2 x3 w1 a b")
SQUARE: dict[str, Any] = {
    "x": (X1, X2, X3),
    "f": (X2, A * X1 * X3, -X3),
    "g": ((0, 0), (2, X1), (B, 3 + X2**2)),
    "h": (X1, X3),
    "w": (W1,),
    "d": (0, W1, 0),
}
NUMBERS = SimpleNamespace(a=1.5, b=-0.5)
STATE = np.array([0.2, 0.7, -0.4])


def square(**changes: Any) -> Equations:
    return Equations(**{**SQUARE, **changes})


def test_several_inputs_add_up_row_by_row() -> None:
    equations = square()
    assert equations.inputs == 2
    assert equations.parameters == (A, B)
    assert equations.drift(STATE, NUMBERS) == (0.7, 1.5 * 0.2 * -0.4, 0.4)
    assert equations.input_matrix(STATE, NUMBERS) == (0, 0, 2, 0.2, -0.5, 3 + 0.7 * 0.7)
    assert equations.disturbance(STATE, [2.5], NUMBERS) == (0, 2.5, 0)


def test_equations_have_no_disturbance_and_hold_everywhere_by_default() -> None:
    equations = square(w=(), d=())
    assert equations.disturbance(STATE, [], NUMBERS) == (0, 0, 0)
    assert not equations.singular(STATE)
    assert equations.linearizable(STATE)


def test_a_row_of_one_input_may_be_its_entry() -> None:
    equations = square(g=(0, 1, B), h=(X1,))
    assert equations.g == ((0,), (1,), (B,))
    assert equations.inputs == 1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: square(f=(X2, X3)), "f has 2 rows of 1, must have one for each of 3 states"),
        (lambda: square(g=((0, 0), (1, 2), (3,))), "equations are no columns"),
        (lambda: square(d=(0, W1)), "d has 2 rows"),
        (lambda: square(x=(X1, X2, X2)), r"states \[x1, x2, x2\] must be 3 different symbols"),
        # f(x) and g(x) are functions of the state and of the parameters, conditions of the state.
        (lambda: square(f=(X2, W1, X3)).drift, "drift: unknown symbol w1"),
        (lambda: square(region=X1 > A).linearizable, "unknown symbol a"),
        # A system that does not fit its equations.
        (lambda: replace(SERVO, states=SERVO.states[:1]), "servo: 1 states are named, the eq"),
        (lambda: replace(SERVO, bodies=(1,)), "bodies = .* must be a tuple of names"),
        # Python's math has no such function.
        (lambda: square(f=(X2, sp.Integral(sp.sin(X1**2), X1), X3)).drift, "drift: "),
    ],
)
def test_equations_that_do_not_fit_are_refused(call: Any, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        call()


# Generated code


def test_unknown_symbols_are_refused() -> None:
    expressions = [X1 + sp.Symbol("z"), sp.Symbol("q")]
    with pytest.raises(ModelError, match=r"speed: unknown symbol q, z; known: x1"):
        generate("speed", expressions, "x", {X1: "x[0]"})


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


def test_expressions_are_computed_as_by_hand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All are floats, for compiled code has one type for all entries of a tuple."""
    # A source that is kept on disk would hide what is written now.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    function = generate("values", list(VALUES), "x", {X1: "x[0]"})
    x = np.array([0.7])
    assert function(x) == pytest.approx(tuple(VALUES.values()), rel=1e-15)
    assert all(type(entry) is float for entry in function([0.7]))
    assert numba.njit(lambda x: function(x))(x) == function(x)


def test_a_traceback_shows_the_generated_line() -> None:
    function = generate("root", [sp.sqrt(X1)], "x", {X1: "x[0]"})
    with pytest.raises(ValueError, match="math domain error") as info:
        function([-1.0])
    assert str(info.traceback[-1].statement).strip() == "return (math.sqrt(x[0]),)"
