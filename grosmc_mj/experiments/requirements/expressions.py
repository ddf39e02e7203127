"""Arithmetic of signals and numbers with units."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.units import LARGEST, Unit


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
class ConstantValue(Expression):
    """A number in base units."""

    value: float

    @classmethod
    def of(cls, value: float, unit: str = "") -> ConstantValue:
        """Return a number with a unit."""
        if value == 0 and not unit:
            return cls(None, 0.0)
        if not math.isfinite(value):
            raise ArgumentError("has a number that is not finite")
        if abs(value) > LARGEST:
            raise ArgumentError(f"has {value:g}, which is too large: write {LARGEST:g} at most")
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
_SUMS: dict[str, Callable[..., Any]] = {"+": np.add, "-": np.subtract}
_PRODUCTS: dict[str, tuple[Callable[..., Any], int]] = {
    "*": (np.multiply, 1),
    "/": (np.divide, -1),
}


def combined(sign: str, left: Expression, right: Expression) -> Expression:
    """Return a sum, a difference, a product or a quotient.

    Raises:
        ArgumentError: If it is a sum of different units.
    """
    if sign in _SUMS:
        return Applied(common_unit("adds", left, right), _SUMS[sign], (left, right))
    function, power = _PRODUCTS[sign]
    unit = _without_factor(left).times(_without_factor(right), power)
    return Applied(unit, function, (left, right))


def applied(name: str, arguments: Sequence[Expression]) -> Expression:
    """Return a function of arguments.

    Args:
        name: Its name in ``FUNCTIONS``.
        arguments: The arguments.

    Raises:
        ArgumentError: If their number or units do not fit.
    """
    function, count = FUNCTIONS[name]
    if len(arguments) != count:
        raise ArgumentError(f"gives {name} {len(arguments)} arguments in place of {count}")
    if name not in _OF_ANGLE:
        return Applied(common_unit(f"gives {name}", *arguments), function, tuple(arguments))

    unit = _without_factor(arguments[0])
    if str(unit) not in {"rad", "1"}:
        raise ArgumentError(f"gives {name} a number in {unit}, not in rad")
    return Applied(Unit(), function, tuple(arguments))


def _without_factor(expression: Expression) -> Unit:
    """Return the unit of values in base units."""
    if expression.unit is None:
        return Unit()
    return Unit(1.0, expression.unit.powers)


def common_unit(verb: str, *expressions: Expression) -> Unit | None:
    """Return the one unit of expressions in base units; None if all are zero.

    Raises:
        ArgumentError: If they have several, with the verb of what was tried.
    """
    units = [_without_factor(item) for item in expressions if item.unit is not None]
    if len(set(units)) > 1:
        names = ["a number without a unit" if unit == Unit() else str(unit) for unit in units]
        raise ArgumentError(f"{verb} {' and '.join(names)}")
    return units[0] if units else None
