"""Arithmetic of signals and numbers with units, read by Python's grammar and never executed."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.units import Unit


@dataclass(frozen=True)
class Expression:
    """A quantity at each instant of a run.

    Attributes:
        unit: Its unit; None of a zero, which fits any unit.
    """

    unit: Unit | None

    @property
    def constant(self) -> float | None:
        """The value, if it is the same in every run."""
        return None

    @property
    def signals(self) -> frozenset[str]:
        """Names of the signals in it."""
        return frozenset()

    def values(self, signals: Mapping[str, Array]) -> Any:
        """Values in base units, (N,) or a number.

        Args:
            signals: Signals by name, (N,) each, in their own units.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Number(Expression):
    """A number in base units."""

    value: float

    @classmethod
    def of(cls, value: float, unit: str = "") -> Number:
        """Return a number with a unit."""
        if value == 0 and not unit:
            return cls(None, 0.0)
        if not math.isfinite(value):
            raise ArgumentError("has a number that is not finite")
        read = Unit.of(unit)
        return cls(read, value * read.factor)

    @property
    def constant(self) -> float:
        """The number."""
        return self.value

    def values(self, signals: Mapping[str, Array]) -> float:
        """Return the number."""
        return self.value


@dataclass(frozen=True)
class SignalValue(Expression):
    """A signal by its name."""

    unit: Unit
    name: str

    @property
    def signals(self) -> frozenset[str]:
        """The name."""
        return frozenset({self.name})

    def values(self, signals: Mapping[str, Array]) -> Array:
        """Return the signal."""
        return self.unit.factor * signals[self.name]


@dataclass(frozen=True)
class Applied(Expression):
    """A function of expressions."""

    function: Callable[..., Any]
    arguments: tuple[Expression, ...]

    @property
    def constant(self) -> float | None:
        """The value of a function of constants."""
        numbers = [argument.constant for argument in self.arguments]
        if None in numbers or self.function is _start:
            return None
        with np.errstate(all="ignore"):
            return float(self.function(*numbers))

    @property
    def signals(self) -> frozenset[str]:
        """The signals of the arguments."""
        return frozenset().union(*(argument.signals for argument in self.arguments))

    def values(self, signals: Mapping[str, Array]) -> Any:
        """Apply the function to the values of the arguments."""
        return self.function(*(argument.values(signals) for argument in self.arguments))


def _start(values: Any) -> Any:
    """Return the first value of a signal."""
    return np.ravel(values)[0]


# Functions with their number of arguments; those of an angle have no unit.
FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "abs": (np.abs, 1),
    "min": (np.minimum, 2),
    "max": (np.maximum, 2),
    "hypot": (np.hypot, 2),
    "start": (_start, 1),
    "sin": (np.sin, 1),
    "cos": (np.cos, 1),
}
_OF_ANGLE = ("sin", "cos")
_SUMS: dict[type[ast.operator], Callable[..., Any]] = {ast.Add: np.add, ast.Sub: np.subtract}
_PRODUCTS: dict[type[ast.operator], tuple[Callable[..., Any], int]] = {
    ast.Mult: (np.multiply, 1),
    ast.Div: (np.divide, -1),
}


def comparisons_in(
    source: str, quantities: Mapping[str, Expression]
) -> Iterator[tuple[ast.cmpop, Expression, Expression]]:
    """Read comparisons such as ``q0 < q1 + 2`` or ``0 < q0 < q1``.

    Args:
        source: Text in Python's grammar.
        quantities: Signals and numbers with a unit, by the names that they have in the text.

    Yields:
        Sign and sides of each comparison.

    Raises:
        ArgumentError: If it is no comparison of arithmetic, or units do not fit.
    """
    try:
        tree = ast.parse(source.strip(), mode="eval").body
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ArgumentError("is no formula") from None
    if not isinstance(tree, ast.Compare):
        raise ArgumentError("has no comparison (<, <=, >, >=) where one must be")

    sides = [_expression(node, quantities) for node in (tree.left, *tree.comparators)]
    for sign, left, right in zip(tree.ops, sides[:-1], sides[1:], strict=True):
        _common_unit("compares", left, right)
        yield sign, left, right


def _expression(node: ast.AST, quantities: Mapping[str, Expression]) -> Expression:
    """Return a node of the tree, with all below it, as an expression."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return Number.of(float(value))
        case ast.Name(id=name) if name in quantities:
            return quantities[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _expression(operand, quantities)
            return Applied(inner.unit, np.negative, (inner,))
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _SUMS:
            sides = (_expression(left, quantities), _expression(right, quantities))
            return Applied(_common_unit("adds", *sides), _SUMS[type(sign)], sides)
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _PRODUCTS:
            function, power = _PRODUCTS[type(sign)]
            first = _expression(left, quantities)
            second = _expression(right, quantities)
            unit = _without_factor(first).times(_without_factor(second), power)
            return Applied(unit, function, (first, second))
        case ast.Call(func=ast.Name(id=name), args=nodes, keywords=[]) if name in FUNCTIONS:
            arguments = tuple(_expression(argument, quantities) for argument in nodes)
            return _called(name, arguments)
    raise ArgumentError(f"is no formula: write comparisons of + - * / and {', '.join(FUNCTIONS)}")


def _called(name: str, arguments: tuple[Expression, ...]) -> Expression:
    """Return a function of arguments."""
    function, count = FUNCTIONS[name]
    if len(arguments) != count:
        raise ArgumentError(f"gives {name} {len(arguments)} arguments in place of {count}")
    if name not in _OF_ANGLE:
        return Applied(_common_unit(f"gives {name}", *arguments), function, arguments)

    unit = _without_factor(arguments[0])
    if str(unit) not in {"rad", "1"}:
        raise ArgumentError(f"gives {name} a number in {unit}, not in rad")
    return Applied(Unit(), function, arguments)


def _without_factor(expression: Expression) -> Unit:
    """Return the unit of values in base units."""
    if expression.unit is None:
        return Unit()
    return Unit(1.0, expression.unit.powers)


def _common_unit(verb: str, *expressions: Expression) -> Unit | None:
    """Return the one unit of expressions in base units; None if all are zero."""
    units = [_without_factor(item) for item in expressions if item.unit is not None]
    if len(set(units)) > 1:
        names = ["a number without a unit" if unit == Unit() else str(unit) for unit in units]
        raise ArgumentError(f"{verb} {' and '.join(names)}")
    return units[0] if units else None
