"""Numbers with units, as people write them, and the tables of a case file that have them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, partial
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    field_validator,
)

from grosmc_mj.ground.errors import ArgumentError, Mistakes, value_text

# An example for messages, by the unit that is wanted.
_EXAMPLES = {"s": "6 s", "rad": "10 deg", "m": "5 cm", "N": "2 N", "N m": "0.5 N m", "kg": "1 kg"}
# Size of a number at most: costs have its square, times a weight and summed over a run.
LARGEST = 1e100
_PERCENT = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)\s*%")
# Beginning of a number with a decimal comma.
_COMMA = re.compile(r"^([+-]?\d+),(\d)")
_PER_SECOND = re.compile(r"/s(?:\^(\d))?$")
_NUMBER = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)


# -- names of units --------------------------------------------------------------------------------

# Units that take prefixes, with factor and base units. A radian is a base unit here, so that no
# angle is taken for a number without a unit, and a volt, whose name people know.
_WITH_PREFIXES = {
    "s": (1.0, "s"),
    "rad": (1.0, "rad"),
    "m": (1.0, "m"),
    "g": (1e-3, "kg"),
    "A": (1.0, "A"),
    "V": (1.0, "V"),
    "K": (1.0, "K"),
    "Hz": (2 * math.pi, "rad/s"),
    "N": (1.0, "kg m/s^2"),
    "Nm": (1.0, "kg m^2/s^2"),
    "J": (1.0, "kg m^2/s^2"),
    "W": (1.0, "kg m^2/s^3"),
    "Pa": (1.0, "kg/m/s^2"),
    "ohm": (1.0, "V/A"),
    "F": (1.0, "A s/V"),
    "H": (1.0, "V s/A"),
    "C": (1.0, "A s"),
    "T": (1.0, "V s/m^2"),
    "Wb": (1.0, "V s"),
}
_PREFIXES = {
    "p": 1e-12,
    "n": 1e-9,
    "u": 1e-6,
    "µ": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "d": 1e-1,
    "da": 1e1,
    "h": 1e2,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
    "T": 1e12,
}
_POUND = 0.45359237
_GRAVITY = 9.80665
_WITHOUT_PREFIXES = {
    "kg": (1.0, "kg"),
    "deg": (math.pi / 180, "rad"),
    "°": (math.pi / 180, "rad"),
    "arcmin": (math.pi / 180 / 60, "rad"),
    "arcsec": (math.pi / 180 / 3600, "rad"),
    "turn": (2 * math.pi, "rad"),
    "rev": (2 * math.pi, "rad"),
    "rpm": (2 * math.pi / 60, "rad/s"),
    "min": (60.0, "s"),
    "h": (3600.0, "s"),
    "day": (86400.0, "s"),
    "inch": (0.0254, "m"),
    "ft": (0.3048, "m"),
    "lb": (_POUND, "kg"),
    "oz": (_POUND / 16, "kg"),
    "lbf": (_POUND * _GRAVITY, "kg m/s^2"),
    "ozf": (_POUND * _GRAVITY / 16, "kg m/s^2"),
    "kgf": (_GRAVITY, "kg m/s^2"),
    "psi": (_POUND * _GRAVITY / 0.0254**2, "kg/m/s^2"),
    "bar": (1e5, "kg/m/s^2"),
    "l": (1e-3, "m^3"),
    "%": (1e-2, "1"),
}
# Other spellings of units and prefixes; names that are words have a plural, too.
_SPELLINGS = {"Ω": "ohm", "Ohm": "ohm", "in": "inch", "hr": "h", "amp": "A", "feet": "ft"}
_WORDS = {
    "second": "s",
    "radian": "rad",
    "meter": "m",
    "metre": "m",
    "gram": "g",
    "ampere": "A",
    "volt": "V",
    "kelvin": "K",
    "hertz": "Hz",
    "newton": "N",
    "joule": "J",
    "watt": "W",
    "pascal": "Pa",
    "ohm": "ohm",
    "farad": "F",
    "henry": "H",
    "coulomb": "C",
    "tesla": "T",
    "weber": "Wb",
    "degree": "deg",
    "turn": "turn",
    "revolution": "rev",
    "minute": "min",
    "hour": "h",
    "inche": "inch",
    "foot": "ft",
    "pound": "lb",
}
_PREFIX_WORDS = {
    "nano": "n",
    "micro": "u",
    "milli": "m",
    "centi": "c",
    "kilo": "k",
    "mega": "M",
    "giga": "G",
}
# Base units here that physics has in other ones: an angle has no dimension.
_DIMENSIONS: dict[str, tuple[tuple[str, int], ...]] = {
    "rad": (),
    "V": (("A", -1), ("kg", 1), ("m", 2), ("s", -3)),
}


def _definition(name: str) -> tuple[float, str] | None:
    """Return factor and base units of a name; None for one that is not known."""
    name = _SPELLINGS.get(name, name)
    if name in _WITHOUT_PREFIXES:
        return _WITHOUT_PREFIXES[name]
    if name in _WITH_PREFIXES:
        return _WITH_PREFIXES[name]

    for prefix, share in _PREFIXES.items():
        symbol = name.removeprefix(prefix)
        symbol = _SPELLINGS.get(symbol, symbol)
        if name.startswith(prefix) and symbol in _WITH_PREFIXES:
            factor, base = _WITH_PREFIXES[symbol]
            return share * factor, base
    return _definition_of_word(name)


def _definition_of_word(name: str) -> tuple[float, str] | None:
    """Return factor and base units of a name such as ``millimetres``; None for none."""
    for word, prefix in {"": "", **_PREFIX_WORDS}.items():
        singular = name.removeprefix(word).removesuffix("s")
        for known in (singular, name.removeprefix(word)):
            if name.startswith(word) and known in _WORDS:
                return _definition(prefix + _WORDS[known])
    return None


# -- units as text ---------------------------------------------------------------------------------

_SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹"
_IN_LINE = str.maketrans(_SUPERSCRIPTS + "⁻", "0123456789-")
_NAME = rf"[^\W\d_{_SUPERSCRIPTS}]+|°[A-Za-z]?|%|1"
_POWER = rf"(?:\^|\*\*)-?\d(?!\d)|⁻?[{_SUPERSCRIPTS}]"
_TOKEN = re.compile(rf"\s*(?:(?P<power>{_POWER})|(?P<name>{_NAME})|(?P<sign>[*·/()]))")
# Characters and powers of a unit at most: nothing that takes long to compute.
_LONGEST = 40
_LARGEST_POWER = 9


class _NoUnitError(Exception):
    """A text that is no product of powers of names."""


class _UnitReader:
    """Reader of products of names with powers, from the left to the right."""

    def __init__(self, text: str) -> None:
        self._tokens: list[tuple[str, str]] = []
        place = 0
        while place < len(text.rstrip()):
            match = _TOKEN.match(text, place)
            if match is None or len(text) > _LONGEST:
                raise _NoUnitError
            self._tokens.append((str(match.lastgroup), match[0].strip()))
            place = match.end()
        # Taken from the end.
        self._tokens.reverse()

    def whole(self) -> Counter[str]:
        """Read all of the text; the power of each name."""
        powers = self._product()
        largest = max(map(abs, powers.values()), default=0)
        if self._tokens or largest > _LARGEST_POWER:
            raise _NoUnitError
        return powers

    def _takes(self, sign: str) -> bool:
        """Whether the next token is this sign, which is taken then."""
        taken = bool(self._tokens) and self._tokens[-1] == ("sign", sign)
        if taken:
            self._tokens.pop()
        return taken

    def _product(self) -> Counter[str]:
        """Read factors up to a closing bracket or the end; the next name after / is divided by."""
        powers = Counter[str]()
        first = True
        while self._tokens and (first or self._tokens[-1] != ("sign", ")")):
            direction = 1
            if not first and self._takes("/"):
                direction = -1
            elif not first:
                _ = self._takes("*") or self._takes("·")
            first = False
            for name, power in self._factor().items():
                powers[name] += direction * power
        return powers

    def _factor(self) -> Counter[str]:
        """Read a name or a bracket, and its power."""
        if not self._tokens:
            raise _NoUnitError
        if self._takes("("):
            powers = self._product()
            if not self._takes(")"):
                raise _NoUnitError
        else:
            kind, name = self._tokens.pop()
            if kind != "name":
                raise _NoUnitError
            powers = Counter({name: 1})
            del powers["1"]

        if self._tokens and self._tokens[-1][0] == "power":
            _, text = self._tokens.pop()
            exponent = int(text.translate(_IN_LINE).lstrip("^*"))
            powers = Counter({name: exponent * power for name, power in powers.items()})
        return powers


# A case file has the same units many times.
@cache
def _named_powers(text: str) -> tuple[tuple[str, int], ...] | None:
    """Return the names in a unit with their powers; None if it is no unit."""
    try:
        return tuple(_UnitReader(text).whole().items())
    except _NoUnitError:
        return None


@dataclass(frozen=True)
class Unit:
    """A unit in base units: a factor and the power of each of them."""

    factor: float = 1.0
    powers: tuple[tuple[str, int], ...] = ()

    @classmethod
    def of(cls, text: str) -> Unit:
        """Read a unit such as ``N m/rad``, ``m/s^2``, ``m/s²`` or ``V/(rad/s)``.

        A text that cannot be read is the name of a unit of its own.
        """
        named = _named_powers(text)
        if named is None:
            return Unit(1.0, ((text, 1),))
        unit = Unit()
        for name, power in named:
            unit = unit.times(_simple(name), power)
        return unit

    def times(self, other: Unit, power: int = 1) -> Unit:
        """Return the product with a power of another unit."""
        powers = Counter(dict(self.powers))
        for name, exponent in other.powers:
            powers[name] += power * exponent
        present = [item for item in powers.items() if item[1]]
        return Unit(self.factor * other.factor**power, tuple(sorted(present)))

    @property
    def dimension(self) -> tuple[tuple[str, int], ...]:
        """Powers of the base units of physics, in which an angle is a number."""
        powers = Counter[str]()
        for name, exponent in self.powers:
            for base, power in _DIMENSIONS.get(name, ((name, 1),)):
                powers[base] += exponent * power
        return tuple(sorted(item for item in powers.items() if item[1]))

    def factor_to(self, other: Unit) -> float | None:
        """Return the factor from this unit to another one; None for another dimension."""
        if self.dimension != other.dimension:
            return None
        return self.factor / other.factor

    def __str__(self) -> str:
        """Write the base units."""
        above = [_power_text(name, power) for name, power in self.powers if power > 0]
        below = [f"/{_power_text(name, -power)}" for name, power in self.powers if power < 0]
        return (" ".join(above) or "1") + "".join(below)


# The units of a formula and of a case file are few, and each stands in it many times.
@cache
def _simple(name: str) -> Unit:
    """Return the unit of one name; one that is not known is a unit of its own."""
    known = _definition(name)
    if known is None or known[1] == name:
        return Unit(1.0, ((name, 1),))
    factor, base = known
    return Unit(factor, Unit.of(base).powers)


def _power_text(name: str, power: int) -> str:
    """Write a power of a base unit."""
    return name if power == 1 else f"{name}^{power}"


def unit_pattern(*units: str) -> str:
    """Return a regular expression for known units and further ones, alone or multiplied."""
    prefixes = "|".join(sorted(_PREFIXES, key=len, reverse=True))
    names = [*_WITHOUT_PREFIXES, *_SPELLINGS]
    for unit in units:
        names += [name for name, _ in _named_powers(unit) or ()]
    fixed = "|".join(map(re.escape, sorted(set(names), key=len, reverse=True)))
    symbols = "|".join(sorted(_WITH_PREFIXES, key=len, reverse=True))
    # A name ends where no further letter follows: "m" is none of the "min" of a function.
    one = rf"(?:{fixed}|(?:{prefixes})?(?:{symbols}))(?![^\W\d_{_SUPERSCRIPTS}])(?:{_POWER})?"
    product = rf"{one}(?:[ */·]{one})*"
    return rf"{product}(?:[*/·]\({product}\))?(?![\w^])"


def rate_unit(unit: str) -> str:
    """Return the unit of a rate of change, such as ``m/s^2`` for ``m/s``."""
    match = _PER_SECOND.search(unit)
    if match is None:
        return f"{unit}/s"
    return f"{unit[: match.start()]}/s^{int(match[1] or 1) + 1}"


# -- numbers with units ----------------------------------------------------------------------------


def is_number(value: Any) -> bool:
    """Whether a value of a file is a number; a truth value is none."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


class InUnit(float):
    """A number that is in the unit of its key already, of a caller in Python and of no file."""


class WholeInUnit(int):
    """A whole number that is in the unit of its key already."""


def in_units(value: Any) -> Any:
    """Return a value whose numbers, in lists and tables too, are in the units of their keys."""
    if isinstance(value, bool):
        return value
    if isinstance(value, (int, np.integer)):
        return WholeInUnit(value)
    if isinstance(value, (float, np.floating)):
        return InUnit(value)
    if isinstance(value, np.ndarray):
        return in_units(value.tolist())
    if isinstance(value, (list, tuple)):
        return [in_units(item) for item in value]
    if isinstance(value, dict):
        return {key: in_units(item) for key, item in value.items()}
    return value


def example_in(unit: str) -> str:
    """Return a number in a unit as a file has it, for messages."""
    return _EXAMPLES.get(unit, f"1 {unit}")


def number_in(value: Any, unit: str) -> float:
    """Return a value such as ``"10 deg"`` as a number in a unit.

    Args:
        value: A string of a number and its unit or, where the unit is 1, a number; or a number of
            ``in_units``.
        unit: The unit wanted, such as ``rad/s``; ``1`` or nothing for a pure number.

    Raises:
        ArgumentError: If the unit is missing, unknown or does not fit.
    """
    if unit in {"", "1", "%"}:
        if not is_number(value):
            raise ArgumentError(
                f"{value_text(value)} must be a number without a unit{number_hint(value)}"
            )
        return _finite(float(value), value)

    example = example_in(unit)
    if isinstance(value, (InUnit, WholeInUnit)):
        return _finite(float(value), value)
    if is_number(value):
        _finite(float(value), value)
        raise ArgumentError(f'{value} has no unit: write "{value} {unit}"')
    if not isinstance(value, str):
        raise ArgumentError(
            f'{value_text(value)} must be a number with a unit, such as "{example}"'
        )

    text = value_text(value, str)
    match = _NUMBER.fullmatch(value.strip())
    if match is None:
        raise ArgumentError(f'"{text}" is no number with a unit, such as "{example}"')
    if _with_point(text) != text:
        raise ArgumentError(f'"{text}" has a decimal comma: write "{_with_point(text)}"')
    number = float(match[1])
    written = match[2]
    if not written:
        raise ArgumentError(f'"{text}" has no unit: write "{text} {unit}"')
    if written == unit:
        return _finite(number, value)
    if _named_powers(written) is None:
        raise ArgumentError(
            f'"{text}": {value_text(written)} is no unit; write it as in "{example}"'
        )

    factor = Unit.of(written).factor_to(Unit.of(unit))
    if factor is None:
        reason = f" cannot be converted to {unit}"
        if _unknown_names(written) - _unknown_names(unit):
            reason = f": {value_text(written)} is no unit"
        raise ArgumentError(f'"{text}"{reason}: write it as in "{example}"')
    return _finite(number * factor, value)


def _unknown_names(unit: str) -> set[str]:
    """Return the names in a unit that are no unit of this package's."""
    return {name for name, _ in _named_powers(unit) or () if _definition(name) is None}


def typed_number(text: str, unit: str) -> float:
    """Return a number that was typed with its unit; one of unit 1 is typed without.

    Raises:
        ArgumentError: As ``number_in``.
    """
    if unit in {"", "1"}:
        match = _NUMBER.fullmatch(text.strip())
        if match is not None and not match[2]:
            return number_in(float(match[1]), unit)
    return number_in(text, unit)


def number_hint(value: Any) -> str:
    """Return the number to write for a text of one or in per cent; empty for anything else."""
    if not isinstance(value, str):
        return ""
    text = value.strip()
    share = _PERCENT.fullmatch(text)
    if share is not None:
        return f": write {float(share[1]) / 100:.12g}, a share"
    number = _NUMBER.fullmatch(_with_point(text))
    if number is not None and not number[2]:
        return f": it is a text: write {number[1]} without quotes"
    return ""


def _with_point(text: str) -> str:
    """Return a text whose decimal comma, if it has one, is a point."""
    return _COMMA.sub(r"\1.\2", text)


def si_number(value: Any, unit: str) -> float:
    """Return a value as a number in an SI unit, which a number without a unit is in already.

    Args:
        value: A number, or a string of a number and its unit.
        unit: The unit wanted; ``1`` or nothing for a pure number.

    Raises:
        ArgumentError: If the unit is unknown or does not fit.
    """
    if is_number(value):
        return _finite(float(value), value)
    return number_in(value, unit)


def _positive(seconds: float) -> float:
    """Return a time, and refuse one that is not above zero."""
    if not seconds > 0:
        raise ArgumentError(f"{seconds:g} s must be above 0 s")
    return seconds


def _finite(number: float, value: Any) -> float:
    """Return a number, and refuse one that is not finite, or whose products would not be."""
    if not math.isfinite(number):
        raise ArgumentError(f"{value_text(value)} must be finite")
    if abs(number) > LARGEST:
        raise ArgumentError(f"{value_text(value)} is too large: write {LARGEST:g} at most")
    return number


Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, BeforeValidator(partial(number_in, unit="s"))]
# No default stands for a time of 0 s that somebody has written.
PositiveSeconds = Annotated[Seconds, AfterValidator(_positive)]
Metres = Annotated[float, BeforeValidator(partial(number_in, unit="m"))]
Three = Field(min_length=3, max_length=3)


class Table(BaseModel):
    """A table of a case file: no other keys, no conversions between types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @field_validator("*", mode="before")
    @classmethod
    def _refuse_too_large(cls, value: Any) -> Any:
        """Refuse numbers whose products would not be finite."""
        for item in value if isinstance(value, list) else [value]:
            if is_number(item) and LARGEST < abs(item) < math.inf:
                raise ArgumentError(f"{value_text(item)} is too large: write {LARGEST:g} at most")
        return value


def numbers_of(
    table: Table,
    names: Iterable[str],
    unit_of: Callable[[str], str],
) -> dict[str, float]:
    """Return the numbers that a table gives.

    Args:
        table: Table with a value, or None, for each name.
        names: Names of the numbers.
        unit_of: Function that returns the unit of a number by its name.

    Raises:
        ArgumentError: For all numbers that do not fit.
    """
    numbers = {}
    mistakes = Mistakes()
    for name in names:
        value = getattr(table, name)
        if value is None:
            continue
        with mistakes.gathered():
            unit = unit_of(name)
            with mistakes.gathered(f"{name}: "):
                numbers[name] = number_in(value, unit)
    mistakes.refuse()
    return numbers
