"""Numbers with units, as people write them, and the tables of a case file that have them."""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from grosmc_mj.errors import ArgumentError, Mistakes, value_text

if TYPE_CHECKING:
    import pint

# An example for messages, by the unit that is wanted.
_EXAMPLES = {"s": "6 s", "rad": "10 deg", "m": "5 cm", "N": "2 N", "N m": "0.5 N m", "kg": "1 kg"}
# Units with powers of one digit: nothing that takes long to compute.
_UNIT = re.compile(r"(?:[A-Za-zµΩ°%/*·()⁰¹²³ -]|(?:\^|\*\*)-?\d(?!\d|\s*(?:\*\*|\^))){1,40}")
# Factors of common units, which need not wait for pint to load: (written, wanted).
_KNOWN = {
    ("us", "s"): 1e-6,
    ("ms", "s"): 1e-3,
    ("um", "m"): 1e-6,
    ("mm", "m"): 1e-3,
    ("cm", "m"): 1e-2,
    ("cm/s", "m/s"): 1e-2,
    ("g", "kg"): 1e-3,
    ("urad", "rad"): 1e-6,
    ("mrad", "rad"): 1e-3,
    ("deg", "rad"): math.pi / 180,
    ("mrad/s", "rad/s"): 1e-3,
    ("deg/s", "rad/s"): math.pi / 180,
    ("Hz", "rad/s"): 2 * math.pi,
    ("mA", "A"): 1e-3,
    ("mN", "N"): 1e-3,
    ("mN m", "N m"): 1e-3,
    ("kN/m", "N/m"): 1e3,
    ("kN m/rad", "N m/rad"): 1e3,
}
_PERCENT = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*%")
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")


# Reads a file of units.
@cache
def _registry() -> pint.UnitRegistry:
    """Return pint's units, with one hertz as a turn a second.

    Angles have no dimension for pint, which would make 1 Hz one radian a second.
    """
    # Imported where it is needed: it loads slowly, and few files need it.
    import pint

    logging.getLogger("pint.util").setLevel(logging.ERROR)
    registry = pint.UnitRegistry()
    registry.define("hertz = turn / second = Hz")
    return registry


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
                f"{value_text(value)} must be a number without a unit{_share_hint(value)}"
            )
        return _finite(float(value), value)

    example = _EXAMPLES.get(unit, f"1 {unit}")
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
    number = float(match[1])
    written = match[2]
    if not written:
        raise ArgumentError(f'"{text}" has no unit: write "{text} {unit}"')
    if not _UNIT.fullmatch(written):
        raise ArgumentError(
            f'"{text}": {value_text(written)} is no unit; write it as in "{example}"'
        )

    if written == unit:
        return _finite(number, value)
    factor = _KNOWN.get((written, unit))
    if factor is not None:
        return _finite(number * factor, value)
    try:
        return _finite(_converted(number, written, unit), value)
    except _UnitError as error:
        raise ArgumentError(f'"{text}"{error}: write it as in "{example}"') from None


def _share_hint(value: Any) -> str:
    """Return the number to write for a text in per cent; empty for anything else."""
    match = _PERCENT.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        return ""
    return f": write {float(match[1]) / 100:.12g}"


def si_number(value: Any, unit: str) -> float:
    """Return a value as a number in an SI unit, which a number without a unit is in already.

    Args:
        value: A number, or a string of a number and its unit.
        unit: The unit wanted; ``1`` or nothing for a pure number.

    Raises:
        ArgumentError: If the unit is unknown or does not fit.
    """
    if is_number(value):
        return float(value)
    return number_in(value, unit)


class _UnitError(Exception):
    """The end of a message about a unit that pint cannot convert."""


def _converted(number: float, written: str, unit: str) -> float:
    """Convert a number by pint from the written unit to another one."""
    from pint import DimensionalityError

    try:
        quantity = _registry().Quantity(number, _registry().parse_units(written))
        return float(quantity.to(unit).magnitude)
    except DimensionalityError:
        raise _UnitError(f" cannot be converted to {unit}") from None
    # pint has no common class of errors for text that it cannot read.
    except Exception:
        raise _UnitError(f": {value_text(written)} is no unit") from None


def _positive(seconds: float) -> float:
    """Return a time, and refuse one that is not above zero."""
    if not seconds > 0:
        raise ArgumentError(f"{seconds:g} s must be above 0 s")
    return seconds


def _finite(number: float, value: Any) -> float:
    """Return a number, and refuse one that is not finite."""
    if not math.isfinite(number):
        raise ArgumentError(f"{value_text(value)} must be finite")
    return number


Finite = Annotated[float, Field(allow_inf_nan=False)]
Seconds = Annotated[float, BeforeValidator(partial(number_in, unit="s"))]
# No default stands for a time of 0 s that somebody has written.
PositiveSeconds = Annotated[Seconds, AfterValidator(_positive)]
Kilograms = Annotated[float, BeforeValidator(partial(number_in, unit="kg"))]
KilogramMetresSquared = Annotated[float, BeforeValidator(partial(number_in, unit="kg m^2"))]
Metres = Annotated[float, BeforeValidator(partial(number_in, unit="m"))]
Newtons = Annotated[float, BeforeValidator(partial(number_in, unit="N"))]
NewtonMetres = Annotated[float, BeforeValidator(partial(number_in, unit="N m"))]
Radians = Annotated[float, BeforeValidator(partial(number_in, unit="rad"))]
RadiansPerSecond = Annotated[float, BeforeValidator(partial(number_in, unit="rad/s"))]
Three = Field(min_length=3, max_length=3)


class Table(BaseModel):
    """A table of a case file: no other keys, no conversions between types."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


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
