"""Formulas in t or in states, read by a grammar of their own: no part of one is ever executed.

sympy's parser evaluates what it reads, so text never reaches it: Python's grammar makes a tree,
and what is in the list below is built of it. Sizes are bounded on the way, since sympy computes
exactly: ``9**9**9`` would not end.
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

from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.experiments.file.units import number_in

# Of a formula: characters, parts, and how deep they are nested.
_LONGEST, _MOST_PARTS, _DEEPEST = 1000, 200, 40
# Of a number, of all powers of a part together, and of a number in an exponent with the symbol.
_LARGEST, _LARGEST_POWER, _LARGEST_RATE = 1e100, 64.0, 1e4
# Functions and such exponents inside each other: sympy's work grows with powers of their number.
_MOST_INSIDE = 5

# Numbers with a unit in a formula, and the unit that each is turned into: 2 Hz are 4 pi rad/s.
_UNITS = {
    **dict.fromkeys(("deg", "mrad", "rad"), "rad"),
    **dict.fromkeys(("mm", "cm", "m"), "m"),
    **dict.fromkeys(("ms", "s"), "s"),
    "Hz": "rad/s",
}
_QUANTITY = re.compile(
    r"(?<![\w.])(\d+\.?\d*(?:[eE][+-]?\d+)?)\s+(" + "|".join(_UNITS) + r")\b(?!\s*\()"
)

FUNCTIONS = (
    "sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh", "asin", "acos", "atan",
)  # fmt: skip
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
        exact: As sympy has it.
        power: The largest product of exponents that stand on each other in it.
        inside: How many functions of the symbol stand inside each other in it.
    """

    exact: Any
    power: float = 1.0
    inside: int = 0

    @property
    def value(self) -> float | None:
        """Its value, if it does not depend on the symbol."""
        if not self.exact.is_number:
            return None
        if not self.exact.is_real:
            raise ValueError
        return float(self.exact)


def _converted(match: re.Match[str]) -> str:
    """A number with a unit as the number in rad, m, s or rad/s."""
    return repr(number_in(f"{match[1]} {match[2]}", _UNITS[match[2]]))


def formula(text: str, *symbols: sp.Symbol) -> sp.Expr:
    """The expression that a text describes.

    Args:
        text: Numbers, ``pi``, the symbols, ``+ - * / **``, brackets and the functions of one
            argument in ``FUNCTIONS``. A number may have one of the units ``deg``, ``mrad``,
            ``rad``, ``mm``, ``cm``, ``m``, ``ms``, ``s`` and ``Hz``: ``10 deg * sin(2 Hz * t)``.
        symbols: What may be in it; there may be blanks in their names.

    Raises:
        ArgumentError: If it has something else, is too large, or has no finite real value.
    """
    if len(text) > _LONGEST:
        raise ArgumentError(
            f"{shown(text)} has {len(text)} characters, a formula may have {_LONGEST}"
        )
    plain, names = text.strip(), {symbol.name: symbol for symbol in symbols}
    # The longest first: a name may be a part of another one.
    for name in sorted(names, key=len, reverse=True):
        if " " in name:
            plain = re.sub(rf"\b{re.escape(name)}\b", name.replace(" ", "_"), plain)
    plain = _QUANTITY.sub(_converted, plain)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            tree = ast.parse(plain, mode="eval").body
    # Besides what is no Python: too many brackets, and what only warns, such as 1if.
    except (SyntaxError, ValueError, MemoryError, RecursionError, Warning):
        raise ArgumentError(f"{shown(text)} is no formula in {', '.join(names)}") from None
    try:
        return _Reading(names).part(tree, 0).exact
    except _NoFormulaError as error:
        raise ArgumentError(f"{shown(text)} {error}") from None
    except (ArithmeticError, ValueError):
        raise ArgumentError(f"{shown(text)} has no finite real value") from None


class _NoFormulaError(Exception):
    """What is wrong with a formula, after its text."""


class _Reading:
    """The building of one formula.

    Args:
        symbols: What may be in it, by their names.
    """

    def __init__(self, symbols: Mapping[str, sp.Symbol]) -> None:
        self._symbols = {name.replace(" ", "_"): symbol for name, symbol in symbols.items()}
        self._names, self._parts = ", ".join(symbols), 0

    def part(self, node: ast.AST, depth: int) -> _Part:
        """A part of the tree, with all that it is made of."""
        self._parts += 1
        if self._parts > _MOST_PARTS or depth > _DEEPEST:
            raise _NoFormulaError(
                f"is too large: it may have {_MOST_PARTS} parts, nested {_DEEPEST} deep"
            )
        part = self._made(node, depth + 1)
        if abs(part.value or 0.0) > _LARGEST:
            raise _NoFormulaError(f"has a number beyond {_LARGEST:g}")
        return part

    def _made(self, node: ast.AST, depth: int) -> _Part:
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                if abs(float(value)) > _LARGEST:
                    raise _NoFormulaError(f"has a number beyond {_LARGEST:g}")
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
                first, second = self.part(left, depth), self.part(right, depth)
                power, inside = max(first.power, second.power), max(first.inside, second.inside)
                return _Part(_OPERATORS[type(sign)](first.exact, second.exact), power, inside)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in FUNCTIONS and not isinstance(argument, ast.Starred)
            ):
                return _called(name, self.part(argument, depth))
        raise self._unfit(node)

    def _unfit(self, node: ast.AST) -> _NoFormulaError:
        """What does not belong into a formula."""
        match node:
            case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
                return _NoFormulaError(f"gives {name} other than one argument")
            case ast.Call(func=ast.Name(id=name)) | ast.Name(id=name) | ast.Attribute(attr=name):
                valid = ", ".join((self._names, *_CONSTANTS, *FUNCTIONS))
                return _NoFormulaError(f"has {shown(name, str)}, may have {valid} and numbers")
            case ast.BinOp(op=ast.BitXor()):
                return _NoFormulaError("has ^: a power is written **")
        return _NoFormulaError(f"is no formula in {self._names}")


def _power(base: _Part, exponent: _Part) -> _Part:
    """A power, if no exact number of it grows beyond all bounds."""
    power, inside = max(base.power, exponent.power), max(base.inside, exponent.inside)
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
    """One more function outside of so many."""
    if inside >= _MOST_INSIDE:
        raise _NoFormulaError(f"has more than {_MOST_INSIDE} functions inside each other")
    return inside + 1


def _refuse_large(exponent: _Part) -> None:
    """Refuse numbers in an exponent that sympy might raise something to."""
    for number in exponent.exact.atoms(sp.Rational, sp.Float):
        size = max(abs(number.p), number.q) if number.is_Rational else abs(number)
        if size > _LARGEST_RATE**2 or abs(number) > _LARGEST_RATE:
            raise _NoFormulaError(f"has an exponent with a number beyond {_LARGEST_RATE:g}")


def _called(name: str, argument: _Part) -> _Part:
    """A function of one argument; of a number its value, as exact ones may have no end."""
    if argument.value is not None:
        return _Part(sp.Float(getattr(math, name)(argument.value)))
    inside = _deeper(argument.inside)
    if name == "exp":
        _refuse_large(argument)
        if argument.exact.has(sp.log):
            # It would become a power, whose exponent nobody has looked at.
            raise _NoFormulaError("has a log within exp: write a power")
    power = argument.power / 2 if name == "sqrt" else argument.power
    return _Part(getattr(sp, name)(argument.exact), max(1.0, power), inside)
