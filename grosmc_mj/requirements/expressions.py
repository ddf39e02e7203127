"""Arithmetic of signals and numbers with units, read by Python's grammar and never executed."""

from __future__ import annotations

import ast
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError

# -- units -----------------------------------------------------------------------------------------

# Factor and base units of each unit. A radian is a base unit here, so that no angle is taken for a
# number without a unit; any other unit of a plant of the user's own is one of its own.
_UNITS = {
    "s": (1.0, "s"),
    "ms": (1e-3, "s"),
    "us": (1e-6, "s"),
    "rad": (1.0, "rad"),
    "mrad": (1e-3, "rad"),
    "deg": (math.pi / 180, "rad"),
    "Hz": (2 * math.pi, "rad/s"),
    "m": (1.0, "m"),
    "cm": (1e-2, "m"),
    "mm": (1e-3, "m"),
    "kg": (1.0, "kg"),
    "g": (1e-3, "kg"),
    "N": (1.0, "kg m/s^2"),
    "mN": (1e-3, "kg m/s^2"),
    "kN": (1e3, "kg m/s^2"),
    "A": (1.0, "A"),
    "mA": (1e-3, "A"),
    "V": (1.0, "V"),
    "mV": (1e-3, "V"),
}
_PART_OF_UNIT = re.compile(r"([ */]*)([^\W\d]+|1)(?:\^(\d))?")


@dataclass(frozen=True)
class Unit:
    """A unit in base units: a factor and the power of each of them."""

    factor: float = 1.0
    powers: tuple[tuple[str, int], ...] = ()

    @classmethod
    def of(cls, text: str) -> Unit:
        """Read a unit such as ``N m/rad``."""
        unit = Unit()
        for separator, name, exponent in _PART_OF_UNIT.findall(text):
            power = int(exponent or 1)
            if "/" in separator:
                power = -power
            if name != "1":
                unit = unit.times(_simple(name), power)
        return unit

    def times(self, other: Unit, power: int = 1) -> Unit:
        """Return the product with a power of another unit."""
        powers = Counter(dict(self.powers))
        for name, exponent in other.powers:
            powers[name] += power * exponent
        present = [item for item in powers.items() if item[1]]
        return Unit(self.factor * other.factor**power, tuple(sorted(present)))

    def __str__(self) -> str:
        """Write the base units."""
        above = [_power_text(name, power) for name, power in self.powers if power > 0]
        below = [f"/{_power_text(name, -power)}" for name, power in self.powers if power < 0]
        return (" ".join(above) or "1") + "".join(below)


def _simple(name: str) -> Unit:
    """Return the unit of one name."""
    if name not in _UNITS:
        return Unit(1.0, ((name, 1),))
    factor, base = _UNITS[name]
    if base == name:
        return Unit(1.0, ((name, 1),))
    return Unit(factor, Unit.of(base).powers)


def _power_text(name: str, power: int) -> str:
    """Write a power of a base unit."""
    return name if power == 1 else f"{name}^{power}"


def unit_pattern(*units: str) -> str:
    """Return a regular expression for the units above and further ones, alone or multiplied."""
    names = set(_UNITS)
    for unit in units:
        names.update(name for _, name, _ in _PART_OF_UNIT.findall(unit))
    longest_first = sorted(names - {"1"}, key=len, reverse=True)
    one = rf"(?:{'|'.join(map(re.escape, longest_first))})(?:\^\d)?"
    return rf"{one}(?:[ */]{one})*(?![\w^])"


# -- expressions -----------------------------------------------------------------------------------


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
