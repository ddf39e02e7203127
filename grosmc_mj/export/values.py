"""Values of Python expressions while C is written: known ones, and places in C.

A tuple of such values stands for a tuple, and for the rows of an array of records.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from grosmc_mj.export.c_text import ATOM, c_name


@dataclass(frozen=True)
class Known:
    """A value that is known when C is written: a number, a table, a function, a module.

    Attributes:
        value: The value.
    """

    value: Any


@dataclass(frozen=True)
class Number:
    """An expression in C with one number as its value.

    Attributes:
        code: The expression.
        whole: Whether it is a whole number, or a truth value: one of 0 and 1.
        level: How tightly its outermost operator binds, see ``c_text.BINARY``.
        low: Least value of a whole number.
        high: Largest value of a whole number.
    """

    code: str
    whole: bool = False
    level: int = ATOM
    low: float = -math.inf
    high: float = math.inf

    @property
    def is_condition(self) -> bool:
        """Whether it is 0 or 1."""
        return self.whole and self.low >= 0 and self.high <= 1

    def within(self, level: int) -> str:
        """Code of it as an operand, in parentheses if it binds less tightly than a level."""
        return f"({self.code})" if self.level < level else self.code


def union(a: Number, b: Number) -> Number:
    """Return a number without code, of the kind and within the bounds of either."""
    if a.whole and b.whole:
        return Number("", whole=True, low=min(a.low, b.low), high=max(a.high, b.high))
    return Number("")


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


@dataclass(frozen=True, eq=False)
class Record:
    """A structure in C, or numbers that are known, by the names of Python's fields.

    Attributes:
        path: Text that tells records apart.
        members: Values of its members.
    """

    path: str
    members: Mapping[str, Any]


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
    # A known float is passed as a number: functions are shared.
    if isinstance(value.value, float):
        return signature(Number(""))
    if isinstance(value.value, (bool, int, str, tuple, type(None))):
        return type(value.value), value.value
    return id(value.value)
