"""Formulas in t or in states as expressions of sympy.

sympy's parser evaluates what it reads, so text never reaches it: the grammar makes a tree, and only
the kinds of nodes below become an expression. Sizes are bounded on the way, since sympy computes
exactly: ``9**9**9`` would not end.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import sympy as sp

from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.grammar import Grammar, Node
from grosmc_mj.ground.units import LARGEST, number_in

# Parts of a formula, and the depth of their nesting.
_MOST_PARTS = 200
_DEEPEST = 40
# Product of the exponents that stand on each other in a part.
_LARGEST_POWER = 64.0
# A number in an exponent that has a symbol in it.
_LARGEST_RATE = 1e4
# Functions, and exponents with a symbol, inside each other: sympy's work grows with powers of this.
_MOST_INSIDE = 5

# Units that a number in a formula may have, and the unit it is converted to: 2 Hz are 4 pi rad/s.
_UNITS = {
    "deg": "rad",
    "mrad": "rad",
    "rad": "rad",
    "mm": "m",
    "cm": "m",
    "m": "m",
    "ms": "s",
    "s": "s",
    "Hz": "rad/s",
}
# The blank tells a number of a unit from a slip.
_UNIT = rf"\s+(?:{'|'.join(_UNITS)})\b(?!\s*\()"

FUNCTIONS = (
    "sin",
    "cos",
    "tan",
    "exp",
    "log",
    "sqrt",
    "sinh",
    "cosh",
    "tanh",
    "asin",
    "acos",
    "atan",
)
STEP = "step"
"""Function of references in t: 0 before the zero of its argument, 1 from it on."""
_CONSTANTS = {"pi": sp.pi}
_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
_SIGNS: dict[str, Callable[[Any], Any]] = {"+": operator.pos, "-": operator.neg}
_STRENGTHS = {"+": 1, "-": 1, "*": 2, "/": 2, "**": 4}
# -t**2 is -(t**2).
_OF_SIGN = 3


class _BoundedPart(NamedTuple):
    """A part of a formula.

    Attributes:
        exact: The part as an expression of sympy.
        power: The largest product of exponents that stand on each other in it.
        inside: Number of functions of a symbol that stand inside each other in it.
    """

    exact: Any
    power: float = 1.0
    inside: int = 0

    @property
    def value(self) -> float | None:
        """Value of a part without symbols, else None."""
        if not self.exact.is_number:
            return None
        if not self.exact.is_real:
            raise ValueError
        return float(self.exact)


def formula(text: str, *symbols: sp.Symbol, steps: bool = False) -> sp.Expr:
    """Return the expression that a text describes.

    Args:
        text: Numbers, ``pi``, the symbols, ``+ - * / **``, brackets and the functions of one
            argument in ``FUNCTIONS``. A number may have one of the units ``deg``, ``mrad``,
            ``rad``, ``mm``, ``cm``, ``m``, ``ms``, ``s`` and ``Hz``: ``10 deg * sin(2 Hz * t)``.
        symbols: Symbols that may be in it; there may be blanks in their names.
        steps: Whether it may have ``step``, which has no derivative where it jumps.

    Raises:
        ArgumentError: If it has something else, is too large, or has no finite real value.
    """
    names = {symbol.name: symbol for symbol in symbols}
    functions = (*FUNCTIONS, STEP) if steps else FUNCTIONS
    grammar = Grammar(
        names=[*names, *_CONSTANTS],
        functions=functions,
        operators=_STRENGTHS,
        prefixes=dict.fromkeys(_SIGNS, _OF_SIGN),
        # 2**3**4 is 2**(3**4).
        from_right=("**",),
        units=_UNIT,
    )
    try:
        tree = grammar.read(text)
        return _Builder(names).part(tree, 0).exact
    except ArgumentError as error:
        hint = ": a power is written **" if "^" in text else ""
        raise ArgumentError(f"{value_text(text)} {error}{hint}") from None
    except _NoFormulaError as error:
        raise ArgumentError(f"{value_text(text)} {error}") from None
    except (ArithmeticError, ValueError):
        raise ArgumentError(f"{value_text(text)} has no finite real value") from None


class _NoFormulaError(Exception):
    """The reason why a text is no formula, to stand after the text in a message."""


class _Builder:
    """Builder of one formula, which counts its parts.

    Args:
        symbols: Symbols that may be in it, by their names.
    """

    def __init__(self, symbols: Mapping[str, sp.Symbol]) -> None:
        self._values = {**_CONSTANTS, **symbols}
        self._parts = 0

    def part(self, node: Node, depth: int) -> _BoundedPart:
        """Return a node of the tree, with all below it, as a part."""
        self._parts += 1
        if self._parts > _MOST_PARTS or depth > _DEEPEST:
            raise _NoFormulaError(
                f"is too large: it may have {_MOST_PARTS} parts, nested {_DEEPEST} deep"
            )
        part = self._built(node, depth + 1)
        # A division by a step, say.
        if part.exact.has(sp.zoo, sp.nan):
            raise ValueError
        if abs(part.value or 0.0) > LARGEST:
            raise _NoFormulaError(f"has a number beyond {LARGEST:g}")
        return part

    def _built(self, node: Node, depth: int) -> _BoundedPart:
        """Return a node as a part without checking its size."""
        match node:
            case Node(kind="number"):
                return _number(node)
            case Node(kind="name", text=name):
                return _BoundedPart(self._values[name])
            case Node(kind="call", text=name, parts=(argument,)):
                return _called(name, self.part(argument, depth))
            case Node(kind="prefix", text=sign, parts=(part,)):
                inner = self.part(part, depth)
                return inner._replace(exact=_SIGNS[sign](inner.exact))
            case Node(kind="operator", text="**", parts=(left, right)):
                return _power(self.part(left, depth), self.part(right, depth))
            case Node(kind="operator", text=sign, parts=(left, right)):
                first = self.part(left, depth)
                second = self.part(right, depth)
                return _BoundedPart(
                    exact=_OPERATORS[sign](first.exact, second.exact),
                    power=max(first.power, second.power),
                    inside=max(first.inside, second.inside),
                )
        raise _NoFormulaError(f"gives {node.text} other than one argument")


def _number(node: Node) -> _BoundedPart:
    """Return a number in rad, m, s or rad/s; a whole one stays exact."""
    if node.unit:
        value = number_in(f"{node.text} {node.unit}", _UNITS[node.unit])
    elif node.text.isdigit():
        value = int(node.text)
    else:
        value = float(node.text)
    if abs(float(value)) > LARGEST:
        raise _NoFormulaError(f"has a number beyond {LARGEST:g}")
    return _BoundedPart(sp.sympify(value, strict=True))


def _power(base: _BoundedPart, exponent: _BoundedPart) -> _BoundedPart:
    """Return a power, and refuse one in which an exact number could grow beyond all bounds."""
    power = max(base.power, exponent.power)
    inside = max(base.inside, exponent.inside)
    if exponent.value is None:
        inside = _deeper(inside)
        _refuse_large(exponent)
        if base.value is not None and base.value <= 0:
            raise _NoFormulaError(f"has a power of {base.value:g}, which must be positive")
    else:
        power = max(power, base.power * abs(exponent.value))
        if power > _LARGEST_POWER:
            raise _NoFormulaError(f"has exponents of more than {_LARGEST_POWER:g} together")
    return _BoundedPart(base.exact**exponent.exact, power, inside)


def _deeper(inside: int) -> int:
    """Return the number of functions inside each other with one more around them."""
    if inside >= _MOST_INSIDE:
        raise _NoFormulaError(f"has more than {_MOST_INSIDE} functions inside each other")
    return inside + 1


def _refuse_large(exponent: _BoundedPart) -> None:
    """Refuse large numbers in an exponent: sympy might raise something to them."""
    for number in exponent.exact.atoms(sp.Rational, sp.Float):
        size = abs(number)
        if number.is_Rational:
            size = max(abs(number.p), number.q)
        if size > _LARGEST_RATE**2 or abs(number) > _LARGEST_RATE:
            raise _NoFormulaError(f"has an exponent with a number beyond {_LARGEST_RATE:g}")


def _called(name: str, argument: _BoundedPart) -> _BoundedPart:
    """Return a function of one argument."""
    if name == STEP:
        return _step(argument)
    if argument.value is not None:
        # A floating-point number: sympy's exact value may take forever.
        return _BoundedPart(sp.Float(getattr(math, name)(argument.value)))

    inside = _deeper(argument.inside)
    power = argument.power
    if name == "sqrt":
        power = argument.power / 2
    if name == "exp":
        _refuse_large(argument)
        if argument.exact.has(sp.log):
            # It would become a power, whose exponent nobody has checked.
            raise _NoFormulaError("has a log within exp: write a power")
    return _BoundedPart(getattr(sp, name)(argument.exact), max(1.0, power), inside)


def _step(argument: _BoundedPart) -> _BoundedPart:
    """Return 1 where an argument is at least 0, and 0 elsewhere.

    Not sympy's Heaviside: its value at 0 is a half, and its derivative an impulse. A comparison is
    the same in both engines, and its derivative is 0 wherever there is one.
    """
    value = argument.value
    if value is not None:
        return _BoundedPart(sp.Integer(value >= 0))
    switched = sp.Piecewise((sp.Integer(1), argument.exact >= 0), (sp.Integer(0), True))
    return _BoundedPart(switched, argument.power, _deeper(argument.inside))
