"""Dataclasses of numbers as C structures: what compiled code sees of parameters and memory."""

from __future__ import annotations

from dataclasses import field, fields, is_dataclass, make_dataclass
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, shown


def record_dtype(value: Any) -> np.dtype[np.void]:
    """Structured dtype of a dataclass of numbers, arrays and further such dataclasses.

    Every field is a float64, so that the structure is also a flat run of numbers.

    Raises:
        ArgumentError: If a field is of another kind.
    """
    if not is_dataclass(value) or isinstance(value, type):
        raise ArgumentError(
            f"a law's numbers are {shown(value)}, must be a dataclass of numbers and arrays"
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
    # A structure without members is none that compiled code could have.
    return np.dtype(members or [("nothing", np.float64)])


def pack(value: Any) -> Array:
    """The numbers of such a dataclass in the order of its fields, flat."""
    return np.array(_flat(value), float)


@cache
def _names(kind: Any) -> list[str]:
    return [item.name for item in fields(kind)]


def _flat(value: Any) -> list[float]:
    numbers: list[float] = []
    for name in _names(type(value)):
        member = getattr(value, name)
        if isinstance(member, (int, float, np.floating)):
            numbers.append(float(member))
        else:
            numbers += member.ravel().tolist() if isinstance(member, np.ndarray) else _flat(member)
    return numbers or [0.0]


def extended(value: Any, **extra: Any) -> Any:
    """A dataclass with further fields at its end: whoever knows the others finds them there."""
    if not extra:
        return value
    kind = _extended(type(value), tuple(extra))
    longer = kind.__new__(kind)
    # Past __init__ and __post_init__: the value has been checked already.
    for name, item in {**vars(value), **extra}.items():
        object.__setattr__(longer, name, item)
    return longer


@cache
def _extended(kind: Any, names: tuple[str, ...]) -> Any:
    """A dataclass with further fields."""
    return make_dataclass(
        f"Extended{kind.__name__}",
        [(name, Any, field(default=None)) for name in names],
        bases=(kind,),
        frozen=kind.__dataclass_params__.frozen,
    )
