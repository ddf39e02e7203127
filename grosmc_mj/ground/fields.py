"""Field types with bounds and a unit, and dataclasses that check their fields.

A field is declared as ``delay: Annotated[float, Range(0, unit="s")]``. ``checked`` makes a
dataclass of such fields, whose refusals are errors of this package; ``checked_call`` does the same
for the arguments of a function. ``range_of`` returns the unit and the bounds of a field.
"""

from __future__ import annotations

import inspect
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cache, wraps
from typing import Annotated, Any, TypeVar, dataclass_transform, get_args, get_type_hints

import numpy as np
import pydantic
from pydantic_core import PydanticCustomError, core_schema

from grosmc_mj.ground.arguments import real, reals, require_known, whole
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, value_text
from grosmc_mj.ground.refusals import RefusedPlace, line_of, refusal

Class = TypeVar("Class")
Returned = TypeVar("Returned")


class Check:
    """An annotation that pydantic calls with the value of a field."""

    def __call__(self, value: Any) -> Any:
        """Return the value to keep, or raise a ``PydanticCustomError``."""
        raise NotImplementedError

    def require(
        self,
        what: str,
        value: Any,
        error: type[GrosmcError] = ArgumentError,
    ) -> Any:
        """Return the value to keep of something that is no field.

        Args:
            what: Name of the argument.
            value: Its value.
            error: Raised if the value is refused.

        Raises:
            GrosmcError: The given ``error``.
        """
        try:
            return self(value)
        except PydanticCustomError as mistake:
            words = mistake.message()
            if mistake.type == "refused":
                words = f"{what} = {value_text(value)} must be {words}"
            raise error(words) from None

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return core_schema.no_info_plain_validator_function(self)


class OwnerUnit(ABC):
    """Unit of a number that depends on its owner, such as the state that a sensor measures.

    ``str`` writes it for people, in words.
    """

    @abstractmethod
    def in_system(self, system: Any, of: str) -> str:
        """Return the unit.

        Args:
            system: System of the plant.
            of: Name of the owner: a state, an input or a joint.

        Raises:
            ArgumentError: If the system has no such owner.
        """

    def choices(self, system: Any, of: str) -> list[str]:
        """Return all units that it may be; a system may leave open which one."""
        return [self.in_system(system, of)]


# Usual sizes of numbers by unit: smaller and larger ones are allowed, but probably a slip.
_USUAL = {
    "s": (1e-7, 1e6),
    "m": (1e-9, 1e4),
    "rad": (1e-9, 1e4),
    "kg": (1e-9, 1e5),
    "kg m^2": (1e-12, 1e6),
    "N": (1e-6, 1e7),
    "N m": (1e-9, 1e7),
    "V": (1e-3, 1e3),
    "A": (1e-6, 1e4),
    "ohm": (1e-6, 1e6),
}
_USUAL_IN_OTHER_UNITS = (1e-12, 1e12)


@dataclass(frozen=True)
class Range(Check):
    """Bounds and unit of a real number.

    Attributes:
        low: Smallest value.
        high: Largest value; infinity for no upper bound.
        unit: Unit, such as ``s``; empty for a pure number; one that depends on the owner of the
            number is an ``OwnerUnit``.
        above: Whether ``low`` itself is refused.
        below: Whether ``high`` itself is refused.
        infinite: Whether infinity is allowed; it stands for "no limit".
        whole: Whether the number must be whole.
        usual: Smallest and largest usual size; by default those of the unit.
        bare: Whether a case file may have it without its unit, which is the SI unit then.
    """

    low: float = -math.inf
    high: float = math.inf
    unit: str | OwnerUnit = ""
    above: bool = False
    below: bool = False
    infinite: bool = False
    whole: bool = False
    usual: tuple[float, float] | None = None
    bare: bool = False

    def unit_in(self, system: Any, of: str) -> str:
        """Return the unit of a number of a system.

        Args:
            system: System of the plant.
            of: Name of the owner of the number, on which the unit may depend.

        Raises:
            ArgumentError: If the unit depends on an owner that the system does not have.
        """
        if isinstance(self.unit, OwnerUnit):
            return self.unit.in_system(system, of)
        return self.unit

    def unusual(self, number: float) -> str:
        """Return the usual sizes in words if a number is beyond them; else an empty string."""
        low, high = self.usual or _USUAL.get(str(self.unit), _USUAL_IN_OTHER_UNITS)
        if number == 0 or math.isinf(number) or low <= abs(number) <= high:
            return ""
        return f"{low:g} to {high:g}"

    def __call__(self, value: Any) -> float | int:
        """Return the number; refuse one that is out of bounds."""
        number = whole(value) if self.whole else real(value)
        # An integer beyond all floats is not infinity.
        too_large = isinstance(value, int) and math.isinf(real(value))
        if number is None or too_large or not self.holds(number):
            raise refusal(self.wanted)
        return number

    def holds(self, number: float) -> bool:
        """Return True if a number is within the bounds; NaN is not."""
        if abs(number) == math.inf:
            return self.infinite and (number > 0 or self.low == -math.inf)
        if number == self.low and self.above:
            return False
        if number == self.high and self.below:
            return False
        return self.low <= number <= self.high

    @property
    def wanted(self) -> str:
        """Description of the numbers within, which follows "must be"."""
        text = self._bounds_in_words()
        has_number = any(character.isdigit() for character in text)
        if has_number and self.unit and isinstance(self.unit, str):
            text = f"{text} {self.unit}"
        if self.whole:
            text = f"a whole number {text}"
        if self.infinite and self.high < math.inf:
            text = f"{text}, or infinite"
        return text

    def _bounds_in_words(self) -> str:
        if self.low == -math.inf:
            return self._upper_bound_in_words()
        if self.high == math.inf:
            return self._lower_bound_in_words()
        start = "above" if self.above else "from"
        end = "to below" if self.below else "to"
        return f"{start} {self.low:g} {end} {self.high:g}"

    def _upper_bound_in_words(self) -> str:
        if self.high == math.inf:
            return "finite"
        if self.below:
            return f"below {self.high:g}"
        return f"at most {self.high:g}"

    def _lower_bound_in_words(self) -> str:
        if self.low == 0:
            bound = "positive" if self.above else "not negative"
        elif self.above:
            bound = f"above {self.low:g}"
        else:
            bound = f"{self.low:g} or more"

        if self.infinite or self.whole:
            return bound
        return f"finite and {bound}"


@dataclass(frozen=True)
class Reals(Check):
    """An array of finite real numbers.

    Attributes:
        shape: Shape; None stands for any size, () is the shape of a number.
        unit: Unit of the entries.
        infinite: Whether infinite entries are allowed.
    """

    shape: tuple[int | None, ...]
    unit: str = ""
    infinite: bool = False

    def __call__(self, value: Any) -> Array:
        """Return a new array of float64."""
        array = reals(value)
        allowed = ~np.isnan(array) if self.infinite else np.isfinite(array)
        if not self._fits(array) or not np.all(allowed):
            sizes = " x ".join("n" if size is None else str(size) for size in self.shape)
            numbers = "numbers" if self.infinite else "finite numbers"
            raise refusal(f"{sizes} {numbers}")
        return array

    def _fits(self, array: Array) -> bool:
        """Return True if an array has the shape."""
        if array.ndim != len(self.shape):
            return False
        sizes = zip(self.shape, array.shape, strict=True)
        return all(length in (None, size) for length, size in sizes)


@dataclass(frozen=True)
class Known(Check):
    """One of some names; the refusal of another one gives the nearest.

    Attributes:
        kind: Noun for the name, such as ``executor``.
        names: All valid names.
    """

    kind: str
    names: Collection[str]

    def __call__(self, value: Any) -> str:
        """Return the name; refuse one that is not valid."""
        try:
            require_known(self.kind, value, self.names)
        except ArgumentError as error:
            raise PydanticCustomError("unknown", "{line}", {"line": str(error)}) from None
        return value


@dataclass(frozen=True)
class Is(Check):
    """An instance of one of some classes.

    Attributes:
        kinds: The classes, as ``isinstance`` takes them.
        wanted: Description, such as ``a plant, such as MujocoPlant.load(...)``.
    """

    kinds: Any
    wanted: str

    def __call__(self, value: Any) -> Any:
        """Return the value; refuse one of another class."""
        if not isinstance(value, self.kinds):
            raise refusal(self.wanted)
        return value


@dataclass(frozen=True)
class Items(Check):
    """A list or tuple of instances of some classes; it is kept as a tuple.

    Attributes:
        kinds: The classes.
        wanted: Description, such as ``a tuple of Signals``.
    """

    kinds: type | tuple[type, ...]
    wanted: str

    def __call__(self, value: Any) -> tuple[Any, ...]:
        """Return the values as a tuple; refuse them if one has another class."""
        is_list = isinstance(value, (list, tuple))
        if not is_list or not all(isinstance(item, self.kinds) for item in value):
            raise refusal(self.wanted)
        return tuple(value)


@dataclass(frozen=True)
class Numbers(Check):
    """A fixed count of finite numbers, kept as a tuple, which can be compared and hashed.

    Attributes:
        count: Number of numbers.
        unit: Unit of each; empty for pure numbers.
    """

    count: int
    unit: str = ""

    def __call__(self, value: Any) -> tuple[float, ...]:
        """Return the numbers as floats."""
        array = reals(value)
        if array.shape != (self.count,) or not np.all(np.isfinite(array)):
            raise refusal(f"{self.count} finite numbers")
        return tuple(array.tolist())


@dataclass(frozen=True)
class KeyName:
    """A field whose key in a case file has another name.

    Attributes:
        name: Name of the key; empty for a field that no key gives.
    """

    name: str


class _Name(Check):
    """A name that is not empty."""

    def __call__(self, value: Any) -> str:
        if not (isinstance(value, str) and value):
            raise refusal("a name")
        return value


Finite = Annotated[float, Range()]
Positive = Annotated[float, Range(0, above=True)]
NotNegative = Annotated[float, Range(0)]
Seconds = Annotated[float, Range(0, unit="s")]
Vector = Annotated[tuple[float, float, float], Numbers(3)]
Point = Annotated[tuple[float, float, float], Numbers(3, "m")]
Name = Annotated[str, _Name()]
Flag = Annotated[bool, Is((bool, np.bool_), "True or False")]

_CONFIG = pydantic.ConfigDict(arbitrary_types_allowed=True, strict=True, extra="forbid")


@dataclass_transform(frozen_default=True)
def checked(
    error: type[GrosmcError] = ArgumentError,
    *,
    label: str = "",
    eq: bool = True,
) -> Callable[[type[Class]], type[Class]]:
    """Make a class a frozen dataclass that checks its fields.

    Its ``__post_init__`` must raise errors of this package only.

    Args:
        error: Raised if fields are refused; its message names all of them.
        label: Beginning of the message; by default the class's ``kind`` and the value of its
            first field, if the class has a ``kind``.
        eq: Whether instances with equal fields are equal; else an instance equals only itself.
    """

    def decorate(kind: Any) -> type[Class]:
        model: Any = pydantic.dataclasses.dataclass(frozen=True, eq=eq, config=_CONFIG)(kind)
        initialize = model.__init__
        names = list(inspect.signature(model).parameters)

        @wraps(initialize)
        def initialize_checked(self: Any, *args: Any, **kwargs: Any) -> None:
            try:
                initialize(self, *args, **kwargs)
            except pydantic.ValidationError as mistakes:
                start = label or _label_of(kind, names[0], args, kwargs)
                if start:
                    start = f"{start}: "
                raise translated(mistakes, names, error, start) from None

        model.__init__ = initialize_checked
        return model

    return decorate


def _label_of(
    kind: Any,
    first_field: str,
    args: tuple[Any, ...],
    kwargs: dict[str, Any],
) -> str:
    """Return the ``kind`` of a class with the value of its first field; empty without a kind."""
    title = getattr(kind, "kind", None)
    if not isinstance(title, str):
        return ""
    if first_field in kwargs:
        value = kwargs[first_field]
    elif args:
        value = args[0]
    else:
        value = "?"
    return f"{title} of {value_text(value)}"


def checked_call(function: Callable[..., Returned]) -> Callable[..., Returned]:
    """Make a function check its arguments by their types when it is called."""
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
    """Return pydantic's error as one of this package, with all refused fields on one line.

    Args:
        mistakes: pydantic's error.
        names: Names of the arguments, in their order.
        error: Class of the error to return.
        label: Beginning of the message.
    """
    refusals: list[Any] = mistakes.errors(include_url=False)
    for mistake in refusals:
        # An error that a `__post_init__` has raised.
        if mistake["type"] == "value_error":
            return mistake["ctx"]["error"]

    lines = []
    for mistake in refusals:
        place = RefusedPlace(_name(mistake["loc"], names), "argument", names)
        lines.append(line_of(mistake, place))
    return error(label + "; ".join(lines))


def _name(location: Sequence[str | int], names: Sequence[str]) -> str:
    """Name the place of a mistake; a positional argument is called by its name."""
    parts = [str(part) for part in location]
    first = location[0] if location else None
    if isinstance(first, int) and first < len(names):
        parts[0] = names[first]
    return ".".join(parts)


# Asked for each field of each object that is made; it reads type hints.
@cache
def range_of(kind: type, field: str) -> Range | None:
    """Return bounds and unit of a field of a checked dataclass; None if it is not a number.

    Cached: reading type hints is slow, and campaigns ask for each varied field.

    Args:
        kind: The dataclass.
        field: Name of the field.
    """
    for note in notes_on(get_type_hints(kind, include_extras=True).get(field)):
        if isinstance(note, Range):
            return note
    return None


def notes_on(hint: Any) -> list[Any]:
    """Return the annotations of a type; of an optional one, a union, those of its parts."""
    notes: list[Any] = []
    for part in (hint, *get_args(hint)):
        notes += getattr(part, "__metadata__", ())
    return notes
