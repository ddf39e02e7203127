"""Formulas in t or in states, read by a grammar of their own: no part of one is ever executed.

sympy's parser evaluates what it reads, so text never reaches it: Python's grammar makes a tree,
and only the kinds of nodes below become an expression. Sizes are bounded on the way, since sympy
computes exactly: ``9**9**9`` would not end.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import sympy as sp

from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.units import LARGEST, number_in

# Characters of a formula, its parts, and the depth of their nesting.
_LONGEST = 1000
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
_QUANTITY = re.compile(
    r"(?<![\w.])(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?)\s+(" + "|".join(_UNITS) + r")\b(?!\s*\()"
)

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
_OPERATORS: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_SIGNS: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


class _Part(NamedTuple):
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


def _converted(match: re.Match[str]) -> str:
    """Return a number with a unit as the number in rad, m, s or rad/s."""
    number = match[1]
    unit = match[2]
    return repr(number_in(f"{number} {unit}", _UNITS[unit]))


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
    if len(text) > _LONGEST:
        raise ArgumentError(
            f"{value_text(text)} has {len(text)} characters, a formula may have {_LONGEST}"
        )
    names = {symbol.name: symbol for symbol in symbols}
    plain = text.strip()
    # The longest first: a name may be a part of another one.
    for name in sorted(names, key=len, reverse=True):
        if " " in name:
            plain = re.sub(rf"\b{re.escape(name)}\b", name.replace(" ", "_"), plain)
    plain = _QUANTITY.sub(_converted, plain)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            tree = ast.parse(plain, mode="eval").body
    # Besides text that is no Python: too many brackets, and text that only warns, such as 1if.
    except (SyntaxError, ValueError, MemoryError, RecursionError, Warning):
        raise ArgumentError(f"{value_text(text)} is no formula in {', '.join(names)}") from None

    try:
        return _Builder(names, steps=steps).part(tree, 0).exact
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
        steps: Whether it may have ``step``.
    """

    def __init__(self, symbols: Mapping[str, sp.Symbol], *, steps: bool) -> None:
        self._symbols = {name.replace(" ", "_"): symbol for name, symbol in symbols.items()}
        self._names = ", ".join(symbols)
        self._parts = 0
        self._functions = (*FUNCTIONS, STEP) if steps else FUNCTIONS

    def part(self, node: ast.AST, depth: int) -> _Part:
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

    def _built(self, node: ast.AST, depth: int) -> _Part:
        """Return a node as a part without checking its size."""
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                if abs(float(value)) > LARGEST:
                    raise _NoFormulaError(f"has a number beyond {LARGEST:g}")
                return _Part(sp.sympify(value, strict=True))
            case ast.Name(id=name) if name in self._symbols:
                return _Part(self._symbols[name])
            case ast.Name(id=name) if name in _CONSTANTS:
                return _Part(_CONSTANTS[name])
            case ast.UnaryOp(op=sign, operand=operand) if type(sign) in _SIGNS:
                inner = self.part(operand, depth)
                return inner._replace(exact=_SIGNS[type(sign)](inner.exact))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return _power(self.part(left, depth), self.part(right, depth))
            case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATORS:
                first = self.part(left, depth)
                second = self.part(right, depth)
                return _Part(
                    exact=_OPERATORS[type(sign)](first.exact, second.exact),
                    power=max(first.power, second.power),
                    inside=max(first.inside, second.inside),
                )
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in self._functions and not isinstance(argument, ast.Starred)
            ):
                return _called(name, self.part(argument, depth))
        raise self._unfit(node)

    def _unfit(self, node: ast.AST) -> _NoFormulaError:
        """Return the reason why a node is no part of a formula."""
        match node:
            case ast.Call(func=ast.Name(id=name)) if name in self._functions:
                return _NoFormulaError(f"gives {name} other than one argument")
            case ast.Call(func=ast.Name(id=name)) | ast.Name(id=name) | ast.Attribute(attr=name):
                valid = ", ".join((self._names, *_CONSTANTS, *self._functions))
                return _NoFormulaError(f"has {value_text(name, str)}, may have {valid} and numbers")
            case ast.BinOp(op=ast.BitXor()):
                return _NoFormulaError("has ^: a power is written **")
        return _NoFormulaError(f"is no formula in {self._names}")


def _power(base: _Part, exponent: _Part) -> _Part:
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
    return _Part(base.exact**exponent.exact, power, inside)


def _deeper(inside: int) -> int:
    """Return the number of functions inside each other with one more around them."""
    if inside >= _MOST_INSIDE:
        raise _NoFormulaError(f"has more than {_MOST_INSIDE} functions inside each other")
    return inside + 1


def _refuse_large(exponent: _Part) -> None:
    """Refuse large numbers in an exponent: sympy might raise something to them."""
    for number in exponent.exact.atoms(sp.Rational, sp.Float):
        size = abs(number)
        if number.is_Rational:
            size = max(abs(number.p), number.q)
        if size > _LARGEST_RATE**2 or abs(number) > _LARGEST_RATE:
            raise _NoFormulaError(f"has an exponent with a number beyond {_LARGEST_RATE:g}")


def _called(name: str, argument: _Part) -> _Part:
    """Return a function of one argument."""
    if name == STEP:
        return _step(argument)
    if argument.value is not None:
        # A floating-point number: sympy's exact value may take forever.
        return _Part(sp.Float(getattr(math, name)(argument.value)))

    inside = _deeper(argument.inside)
    power = argument.power
    if name == "sqrt":
        power = argument.power / 2
    if name == "exp":
        _refuse_large(argument)
        if argument.exact.has(sp.log):
            # It would become a power, whose exponent nobody has checked.
            raise _NoFormulaError("has a log within exp: write a power")
    return _Part(getattr(sp, name)(argument.exact), max(1.0, power), inside)


def _step(argument: _Part) -> _Part:
    """Return 1 where an argument is at least 0, and 0 elsewhere.

    Not sympy's Heaviside: its value at 0 is a half, and its derivative an impulse. A comparison is
    the same in both engines, and its derivative is 0 wherever there is one.
    """
    value = argument.value
    if value is not None:
        return _Part(sp.Integer(value >= 0))
    switched = sp.Piecewise((sp.Integer(1), argument.exact >= 0), (sp.Integer(0), True))
    return _Part(switched, argument.power, _deeper(argument.inside))
