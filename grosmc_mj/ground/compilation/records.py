"""Records in memory: dataclasses of numbers, which compiled code reads as parameters and memory.

A record has its arrays in itself, where a structure (``structures.py``) refers to them.
"""

from __future__ import annotations

from dataclasses import field, fields, is_dataclass, make_dataclass
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, value_text


def record_dtype(value: Any) -> np.dtype[np.void]:
    """Return the structured dtype of a dataclass of numbers, arrays and such dataclasses.

    Every field is a float64, so the structure is also a flat array of numbers.

    Raises:
        ArgumentError: If a field has another type.
    """
    if not is_dataclass(value) or isinstance(value, type):
        raise ArgumentError(
            f"a law's numbers are {value_text(value)}, must be a dataclass of numbers and arrays"
        )

    members = []
    for item in fields(value):
        member = getattr(value, item.name)
        if is_dataclass(member):
            members.append((item.name, record_dtype(member)))
        elif isinstance(member, (int, float, np.floating)):
            members.append((item.name, np.float64))
        elif isinstance(member, np.ndarray):
            members.append((item.name, np.float64, member.shape))
        else:
            raise ArgumentError(
                f"{type(value).__name__}.{item.name} is a {type(member).__name__}; laws take "
                "numbers, arrays and dataclasses of them"
            )

    # Compiled code cannot have a structure without members.
    if not members:
        members.append(("nothing", np.float64))
    return np.dtype(members)


def pack(value: Any) -> Array:
    """Return the numbers of a dataclass in the order of its fields, flat, as in its dtype."""
    return np.array(_flat(value), float)


def _flat(value: Any) -> list[float]:
    numbers: list[float] = []
    for name in _names(type(value)):
        member = getattr(value, name)
        if isinstance(member, (int, float, np.floating)):
            numbers.append(float(member))
        elif isinstance(member, np.ndarray):
            numbers += member.ravel().tolist()
        else:
            numbers += _flat(member)

    # The member of a structure that has no other; see `record_dtype`.
    if not numbers:
        numbers.append(0.0)
    return numbers


@cache
def _names(kind: Any) -> list[str]:
    """Return the names of a dataclass's fields; cached, since every run packs several."""
    return [item.name for item in fields(kind)]


def with_fields(value: Any, **extra: Any) -> Any:
    """Copy of a dataclass with further fields at its end; the fields before keep their places."""
    if not extra:
        return value

    kind = _extended_class(type(value), tuple(extra))
    longer = kind.__new__(kind)
    # Without __init__ and __post_init__: the value has been checked already.
    for name, item in {**vars(value), **extra}.items():
        object.__setattr__(longer, name, item)
    return longer


@cache
def _extended_class(kind: Any, names: tuple[str, ...]) -> Any:
    """Return the dataclass with further fields; cached, so equal extensions share one class."""
    return make_dataclass(
        f"Extended{kind.__name__}",
        [(name, Any, field(default=None)) for name in names],
        bases=(kind,),
        frozen=kind.__dataclass_params__.frozen,
    )
