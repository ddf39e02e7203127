"""Values of Python expressions while C is written.

A value that is known now is the Python object itself: a number, a table, a function, a module. Any
other value is a ``Number``, an ``Array`` or a ``Record`` in C, or a tuple with some of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from grosmc_mj.export.c_names import c_name
from grosmc_mj.export.c_text import literal
from grosmc_mj.export.syntax import NoCError

# How tightly operators of C bind.
ATOM = 20
UNARY = 14
PRODUCT = 13
SUM = 12
COMPARED = 10
AND = 5
OR = 4
CHOICE = 3


@dataclass(frozen=True)
class Number:
    """An expression in C with one number as its value.

    Attributes:
        code: The expression.
        whole: Whether it is a whole number, or a truth value: one of 0 and 1.
        level: How tightly its outermost operator binds.
        low: Least value of a whole number.
        high: Largest value of a whole number.
        effect: Statement in C for a call that changes something, whether or not its value is used.
    """

    code: str
    whole: bool = False
    level: int = ATOM
    low: float = -math.inf
    high: float = math.inf
    effect: str = ""

    @property
    def is_small(self) -> bool:
        """Whether it is a whole number that fits ``int``, whose negative fits, too."""
        return self.whole and self.low > -(2**31) and self.high < 2**31

    @property
    def is_condition(self) -> bool:
        """Whether it is 0 or 1."""
        return self.whole and self.low >= 0 and self.high <= 1

    def within(self, level: int) -> str:
        """Code of it as an operand, in parentheses if it binds less tightly than a level."""
        return f"({self.code})" if self.level < level else self.code

    def named(self, name: str) -> Number:
        """Variable that has this number as its value."""
        return Number(name, self.whole, low=self.low, high=self.high)


@dataclass(frozen=True)
class Array:
    """An array in C, row by row.

    Attributes:
        code: Code of the array.
        shape: Its shape.
        offset: Entry that it begins with, for a slice.
    """

    code: str
    shape: tuple[int, ...]
    offset: int = 0

    @property
    def pointer(self) -> str:
        """Code of its address."""
        return f"{self.code} + {self.offset}" if self.offset else self.code

    def entry(self, indices: Sequence[Number]) -> Number:
        """Entry at indices that are proven to lie in the array.

        Raises:
            NoCError: If they are not.
        """
        if len(indices) != len(self.shape):
            raise NoCError(f"has {len(self.shape)} axes: give an index for each")
        place = self.offset
        terms: list[str] = []
        stride = math.prod(self.shape)
        for index, size in zip(indices, self.shape, strict=True):
            stride //= size
            low, high = index.low, index.high
            # Python counts a known negative index from the end.
            if low == high and -size <= low < 0:
                low = high = low + size
            if not index.whole or not 0 <= low <= high < size:
                raise NoCError(
                    f"index {index.code} is not known to lie in 0 ... {size - 1}: write a loop "
                    f"over range({size}), or k % {size}"
                )
            if low == high:
                place += int(low) * stride
            elif stride == 1:
                terms.append(index.code)
            else:
                terms.append(f"{index.within(UNARY)} * {stride}")
        if place or not terms:
            terms.append(str(place))
        return Number(f"{self.code}[{' + '.join(terms)}]")


@dataclass(frozen=True, eq=False)
class Record:
    """A structure in C, or numbers that are known, by the names of Python's fields.

    Attributes:
        path: Text that tells records apart.
        members: Values of its members.
    """

    path: str
    members: Mapping[str, Any]


def is_known(*values: Any) -> bool:
    """Whether values are known while C is written."""
    for value in values:
        if isinstance(value, (Number, Array, Record)):
            return False
        if isinstance(value, tuple) and not is_known(*value):
            return False
    return True


def number_in_c(value: Any, real: str) -> Number:
    """Return a value as a number in C.

    Args:
        value: The value.
        real: ``double`` or ``float``.

    Raises:
        NoCError: If it is no number.
    """
    if isinstance(value, Number):
        return value
    if isinstance(value, (bool, int, np.bool_, np.integer)):
        if not -(2**63) < int(value) < 2**63:
            raise NoCError("is a whole number of more than 64 bits: write it as a float")
        return _whole_number(int(value))
    if isinstance(value, (float, np.floating)):
        text = literal(float(value), real)
        return Number(text, level=UNARY if text.startswith("-") else ATOM)
    raise NoCError("must be one number: write a loop over entries")


def _whole_number(value: int) -> Number:
    """A known whole number."""
    level = UNARY if value < 0 else ATOM
    return Number(str(value), whole=True, level=level, low=value, high=value)


def items(value: Any) -> list[Any]:
    """Return the entries of a tuple or of an array with one axis.

    Raises:
        NoCError: If it is something else.
    """
    if isinstance(value, (tuple, list, np.ndarray)):
        return list(value)
    if isinstance(value, Array) and len(value.shape) == 1:
        return [value.entry([_whole_number(k)]) for k in range(value.shape[0])]
    raise NoCError("must be a tuple or an array with one axis: write its entries")


def union(a: Number, b: Number) -> Number:
    """Return a number without code, of the kind and within the bounds of either."""
    if a.whole and b.whole:
        return Number("", whole=True, low=min(a.low, b.low), high=max(a.high, b.high))
    return Number("")


def record_at(path: str, value: Any) -> Record:
    """Return the record in C of a dataclass of numbers, arrays and such dataclasses.

    Args:
        path: Code before the names of its members.
        value: The dataclass.
    """
    members: dict[str, Any] = {}
    for item in fields(value):
        member = getattr(value, item.name)
        place = path + c_name(item.name)
        if is_dataclass(member):
            members[item.name] = record_at(f"{place}.", member)
        elif np.ndim(member):
            members[item.name] = Array(place, np.shape(member))
        else:
            members[item.name] = Number(place)
    return Record(path, members)


def signature(value: Any) -> Any:
    """Return the part of an argument that the C of a function depends on."""
    if isinstance(value, tuple):
        return tuple(signature(item) for item in value)
    if isinstance(value, Number):
        return value.whole, value.low, value.high
    if isinstance(value, Array):
        return value.shape
    if isinstance(value, Record):
        return value.path
    if isinstance(value, (bool, int, float, str, type(None))):
        return type(value), value
    return id(value)
