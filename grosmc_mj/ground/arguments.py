"""Checks of arguments: numbers, arrays of numbers, classes and names."""

from __future__ import annotations

import math
import numbers
from collections.abc import Collection
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, unknown_name, value_text


def real(value: Any) -> float:
    """Return a real number as a float; NaN for a text, a truth value, an array and so on."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf":
        value = value.item()
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return float("nan")

    number: Any = value
    try:
        return float(number)
    except OverflowError:
        # An integer beyond every float.
        return math.inf if number > 0 else -math.inf


def whole(value: Any) -> int | None:
    """Return a whole number; None for a text, a truth value, 1.0, an array and so on."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iu":
        value = value.item()
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        return None
    return int(value)


def reals(value: Any) -> Array:
    """Return a new array of real numbers; NaN, an array without axes, if ``value`` is not one.

    Texts, complex numbers, dates, truth values, rows of different lengths and masked arrays are
    not arrays of numbers, although NumPy would convert some of them.
    """
    not_numbers = np.full((), np.nan)
    if isinstance(value, np.ma.MaskedArray):
        return not_numbers
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return not_numbers
    if array.dtype.kind not in "iuf":
        return not_numbers
    return array.astype(float)


def require(
    what: str,
    value: Any,
    kinds: type | tuple[type, ...],
    wanted: str,
    error: type[GrosmcError] = ArgumentError,
) -> None:
    """Refuse a value of another class.

    Args:
        what: Name of the argument.
        value: Its value.
        kinds: Classes that it may have.
        wanted: Words for them, which follow "must be".
        error: Raised if it has another class.

    Raises:
        GrosmcError: The given ``error``.
    """
    if not isinstance(value, kinds):
        raise error(f"{what} = {value_text(value)} must be {wanted}")


def require_each(
    what: str,
    values: Any,
    kinds: type | tuple[type, ...],
    wanted: str,
    error: type[GrosmcError] = ArgumentError,
) -> None:
    """Refuse a value that is not a list or tuple of these classes.

    Args:
        what: Name of the argument.
        values: Its value.
        kinds: Classes that every entry may have.
        wanted: Words for the list, which follow "must be".
        error: Raised if it is something else.

    Raises:
        GrosmcError: The given ``error``.
    """
    is_list = isinstance(values, (list, tuple))
    if not is_list or not all(isinstance(value, kinds) for value in values):
        raise error(f"{what} = {value_text(values)} must be {wanted}")


def require_known(
    kind: str,
    name: Any,
    valid: Collection[str],
    where: str = "",
    error: type[Exception] = ArgumentError,
) -> None:
    """Refuse a name that is not one of the valid names; the message gives the nearest.

    Args:
        kind: Noun for the named thing, such as ``executor``.
        name: The name.
        valid: All valid names.
        where: Beginning of the message.
        error: Raised if the name is not valid.

    Raises:
        Exception: The given ``error``.
    """
    if not isinstance(name, str) or name not in valid:
        raise error(where + unknown_name(kind, name, valid))
