"""Types that check themselves: numbers and arrays with bounds and a unit, dataclasses of them.

A number stands once, as a field ``delay: Annotated[float, Range(0, unit="s")]``. ``checked`` makes
a dataclass of such fields whose mistakes are errors of this package, ``checked_call`` does the same
for the arguments of a function. Unit and bounds are read back by ``range_of``.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from typing import Annotated, Any, TypeVar, dataclass_transform, get_args, get_type_hints

import numpy as np
import pydantic
from pydantic_core import PydanticCustomError, core_schema

from grosmc_mj.arguments import real, reals, whole
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError, shown, unknown_name

Class = TypeVar("Class")
Returned = TypeVar("Returned")


class Check:
    """An annotation that pydantic calls with the given value; it returns the value to keep."""

    def __call__(self, value: Any) -> Any:
        """The value to keep; a ``PydanticCustomError`` if it is refused."""
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.no_info_plain_validator_function(self)


def refused(wanted: str) -> PydanticCustomError:
    """The error of a value that is not what it must be, in words that follow "must be"."""
    return PydanticCustomError("refused", "{wanted}", {"wanted": wanted})


# Sizes of numbers by their unit: what is smaller or larger is allowed, and probably a slip.
_USUAL = {
    "s": (1e-7, 1e6), "m": (1e-9, 1e4), "rad": (1e-9, 1e4), "kg": (1e-9, 1e5),
    "kg m^2": (1e-12, 1e6), "N": (1e-6, 1e7), "N m": (1e-9, 1e7), "V": (1e-3, 1e3),
    "A": (1e-6, 1e4), "ohm": (1e-6, 1e6),
}  # fmt: skip
_USUAL_OF_ANY = (1e-12, 1e12)


@dataclass(frozen=True)
class Range(Check):
    """Bounds and unit of a real number.

    Attributes:
        low: Smallest value.
        high: Largest value; infinite for none.
        unit: Such as ``s``; empty for a pure number.
        above: Whether ``low`` itself is refused.
        below: Whether ``high`` itself is refused.
        infinite: Whether infinity is a value too, which stands for no limit.
        whole: Whether it must be a whole number.
        usual: Sizes between which it mostly is; by default those of its unit.
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str = ""
    above: bool = False
    below: bool = False
    infinite: bool = False
    whole: bool = False
    usual: tuple[float, float] | None = None

    def unusual(self, number: float) -> str:
        """In words the sizes that a number is beyond; nothing of one that is plausible."""
        low, high = self.usual or _USUAL.get(self.unit, _USUAL_OF_ANY)
        plausible = number == 0 or math.isinf(number) or low <= abs(number) <= high
        return "" if plausible else f"{low:g} to {high:g}"

    def __call__(self, value: Any) -> float | int:
        """The number, if it is within."""
        number = whole(value) if self.whole else real(value)
        # A whole number beyond all floats is no infinity.
        beyond = isinstance(value, int) and math.isinf(real(value))
        if number is None or beyond or not self.holds(number):
            raise refused(self.wanted)
        return number

    def holds(self, number: float) -> bool:
        """Whether a number is within the bounds; NaN is not."""
        if abs(number) == math.inf:
            return self.infinite and (number > 0 or self.low == -math.inf)
        over = number > self.low if self.above else number >= self.low
        under = number < self.high if self.below else number <= self.high
        return over and under

    @property
    def wanted(self) -> str:
        """What the number must be, in words."""
        if self.low == -math.inf:
            end = "below" if self.below else "at most"
            bounds = "finite" if self.high == math.inf else f"{end} {self.high:g}"
        elif self.high == math.inf:
            bounds = f"above {self.low:g}" if self.above else f"{self.low:g} or more"
            if self.low == 0:
                bounds = "positive" if self.above else "not negative"
            if not self.infinite and not self.whole:
                bounds = f"finite and {bounds}"
        else:
            start = "above" if self.above else "from"
            bounds = f"{start} {self.low:g} to {'below ' if self.below else ''}{self.high:g}"
        unit = f" {self.unit}" if self.unit and any(c.isdigit() for c in bounds) else ""
        endless = ", or infinite" if self.infinite and self.high < math.inf else ""
        return f"{'a whole number ' if self.whole else ''}{bounds}{unit}{endless}"


@dataclass(frozen=True)
class Reals(Check):
    """An array of finite real numbers.

    Attributes:
        shape: Its shape; None in place of a size that is free, () for a number.
        unit: Of its entries.
        infinite: Whether infinite entries are values.
    """

    shape: tuple[int | None, ...]
    unit: str = ""
    infinite: bool = False

    def __call__(self, value: Any) -> Array:
        """The array as float64, a new one."""
        array = reals(value)
        fits = array.ndim == len(self.shape) and all(
            free in (None, size) for free, size in zip(self.shape, array.shape, strict=True)
        )
        bad = np.any(np.isnan(array)) if self.infinite else not np.all(np.isfinite(array))
        if not fits or bad:
            sizes = " x ".join("n" if size is None else str(size) for size in self.shape)
            raise refused(f"{sizes} {'' if self.infinite else 'finite '}numbers")
        return array


@dataclass(frozen=True)
class Known(Check):
    """One of some names; another one is refused with the nearest of them.

    Attributes:
        kind: The noun for it, such as ``executor``.
        names: All that are valid.
    """

    kind: str
    names: Collection[str]

    def __call__(self, value: Any) -> str:
        """The name, if it is one of them."""
        if not isinstance(value, str) or value not in self.names:
            line = unknown_name(self.kind, value, self.names)
            raise PydanticCustomError("unknown", "{line}", {"line": line})
        return value


@dataclass(frozen=True)
class Is(Check):
    """A value of one of some classes.

    Attributes:
        kinds: The classes, as ``isinstance`` takes them.
        wanted: In words, such as ``a plant, such as MujocoPlant.load(...)``.
    """

    kinds: Any
    wanted: str

    def __call__(self, value: Any) -> Any:
        """The value, if it is one."""
        if not isinstance(value, self.kinds):
            raise refused(self.wanted)
        return value


@dataclass(frozen=True)
class Items(Check):
    """A list or tuple of values of some classes; it is kept as a tuple.

    Attributes:
        kinds: The classes.
        wanted: In words, such as ``a tuple of Signals``.
    """

    kinds: type | tuple[type, ...]
    wanted: str

    def __call__(self, value: Any) -> tuple[Any, ...]:
        """The values, if all are such."""
        items = value if isinstance(value, (list, tuple)) else [None]
        if not all(isinstance(item, self.kinds) for item in items):
            raise refused(self.wanted)
        return tuple(value)


@dataclass(frozen=True)
class Numbers(Check):
    """Some finite numbers, kept as a tuple, which can be compared and hashed.

    Attributes:
        count: How many.
    """

    count: int

    def __call__(self, value: Any) -> tuple[float, ...]:
        """The numbers."""
        array = reals(value)
        if array.shape != (self.count,) or not np.all(np.isfinite(array)):
            raise refused(f"{self.count} finite numbers")
        return tuple(array.tolist())


class _Name(Check):
    """A name that is not empty."""

    def __call__(self, value: Any) -> str:
        if not (isinstance(value, str) and value):
            raise refused("a name")
        return value


Finite = Annotated[float, Range()]
Positive = Annotated[float, Range(0, above=True)]
NotNegative = Annotated[float, Range(0)]
Seconds = Annotated[float, Range(0, unit="s")]
Vector = Annotated[tuple[float, float, float], Numbers(3)]
Name = Annotated[str, _Name()]
Flag = Annotated[bool, Is((bool, np.bool_), "True or False")]

_CONFIG = pydantic.ConfigDict(arbitrary_types_allowed=True, strict=True, extra="forbid")


@dataclass_transform(frozen_default=True)
def checked(
    error: type[GrosmcError] = ArgumentError, *, label: str = "", eq: bool = True
) -> Callable[[type[Class]], type[Class]]:
    """Make a class a frozen dataclass whose fields check what they are given.

    What goes wrong in its ``__post_init__`` must be an error of this package.

    Args:
        error: Raised for fields that are refused; all of them are told at once.
        label: Begins the line; by default the class's ``kind`` and its first field, if it has one.
        eq: Whether instances of equal fields are equal; else each is itself alone.
    """

    def decorate(kind: Any) -> type[Class]:
        kept: Any = pydantic.dataclasses.dataclass(frozen=True, eq=eq, config=_CONFIG)(kind)
        initialize = kept.__init__
        names = list(inspect.signature(kept).parameters)

        @wraps(initialize)
        def initialize_checked(self: Any, *args: Any, **kwargs: Any) -> None:
            try:
                initialize(self, *args, **kwargs)
            except pydantic.ValidationError as mistakes:
                start, title = label, getattr(kind, "kind", None)
                if not label and isinstance(title, str):
                    owner = kwargs.get(names[0], args[0] if args else "?")
                    start = f"{title} of {shown(owner)}"
                raise translated(mistakes, names, error, start and f"{start}: ") from None

        kept.__init__ = initialize_checked
        return kept

    return decorate


def checked_call(function: Callable[..., Returned]) -> Callable[..., Returned]:
    """The function, which checks its arguments by their types when it is called."""
    validated = pydantic.validate_call(config=_CONFIG)(function)
    names = list(inspect.signature(function).parameters)

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Returned:
        try:
            return validated(*args, **kwargs)
        except pydantic.ValidationError as mistakes:
            raise translated(mistakes, names, ArgumentError) from None

    return call


def translated(
    mistakes: pydantic.ValidationError,
    names: Sequence[str],
    error: type[GrosmcError],
    label: str = "",
) -> Exception:
    """pydantic's error as one of this package: every field that was refused, on one line.

    Args:
        mistakes: What pydantic raised.
        names: Of the arguments, in their order.
        error: Its class.
        label: Begins the line.
    """
    refusals: list[Any] = mistakes.errors(include_url=False)
    for item in refusals:
        if item["type"] == "value_error":
            return item["ctx"]["error"]
    return error(label + "; ".join(_line(item, names) for item in refusals))


def _line(mistake: Any, names: Sequence[str]) -> str:
    """What is wrong with one field: its name, its value and what it must be."""
    parts = [
        names[p] if i == 0 and isinstance(p, int) and p < len(names) else str(p)
        for i, p in enumerate(mistake["loc"])
    ]
    place, value = ".".join(parts), shown(mistake["input"])
    match mistake["type"]:
        case "refused":
            return f"{place} = {value} must be {mistake['msg']}"
        case "literal_error":
            valid = re.findall("'([^']*)'", mistake["ctx"]["expected"])
            return unknown_name(place, mistake["input"], valid)
        case "missing" | "missing_argument":
            return f"{place} is missing"
        case "unknown":
            return mistake["msg"]
        case "is_instance_of":
            return f"{place} = {value} must be a {mistake['ctx']['class']}"
        case "unexpected_keyword_argument" | "unexpected_positional_argument":
            return f"there is no argument {place}; valid: {', '.join(names)}"
    separator = " " if mistake["msg"].startswith("Input should be ") else ": "
    return f"{place} = {value}{separator}{mistake['msg'].replace('Input should be', 'must be')}"


@cache
def range_of(kind: type, field: str) -> Range | None:
    """Bounds and unit of a field of a checked dataclass; None for one that is no number.

    Args:
        kind: The dataclass.
        field: Name of the field.
    """
    hint = get_type_hints(kind, include_extras=True)[field]
    # A number that may be left out is one of a union.
    kinds = (hint, *get_args(hint))
    notes = (note for kind in kinds for note in getattr(kind, "__metadata__", ()))
    return next((note for note in notes if isinstance(note, Range)), None)
