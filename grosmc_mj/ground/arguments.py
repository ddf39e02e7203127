"""Reading of arguments as numbers and as known names; the checks of `fields` are made of it."""

from __future__ import annotations

import math
import numbers
from collections.abc import Collection
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, unknown_name


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
