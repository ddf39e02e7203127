"""Arguments told apart: what is a number, an array of numbers, or something else."""

from __future__ import annotations

import numbers
from collections.abc import Collection
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError, shown, unknown_name


def real(value: Any) -> float:
    """A real number as a float; NaN for whatever is none: a text, a truth value, an array."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf":
        value = value.item()
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return float("nan")
    number: Any = value
    try:
        return float(number)
    except OverflowError:  # an integer beyond every float
        return float("inf") if number > 0 else float("-inf")


def whole(value: Any) -> int | None:
    """A whole number; None for whatever is none: a text, a truth value, 1.0, an array."""
    if isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iu":
        value = value.item()
    return (
        int(value) if isinstance(value, numbers.Integral) and not isinstance(value, bool) else None
    )


def reals(value: Any) -> Array:
    """An array of real numbers, a new one; a single NaN without axes for whatever is none.

    Texts, complex numbers, dates, truth values, rows of different lengths and masked arrays are
    none: NumPy would take some of them for numbers that nobody has meant.
    """
    nothing = np.full((), np.nan)
    if isinstance(value, np.ma.MaskedArray):
        return nothing
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return nothing
    return array.astype(float) if array.dtype.kind in "iuf" else nothing


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
        value: What was given.
        kinds: Classes that it may have.
        wanted: What it must be, in words.
        error: Raised if it is something else.

    Raises:
        GrosmcError: Of that class.
    """
    if not isinstance(value, kinds):
        raise error(f"{what} = {shown(value)} must be {wanted}")


def require_each(
    what: str,
    values: Any,
    kinds: type | tuple[type, ...],
    wanted: str,
    error: type[GrosmcError] = ArgumentError,
) -> None:
    """Refuse what is no list or tuple of these classes.

    Args:
        what: Name of the argument.
        values: What was given.
        kinds: Classes that every entry may have.
        wanted: What it must be, in words.
        error: Raised if it is something else.

    Raises:
        GrosmcError: Of that class.
    """
    if not isinstance(values, (list, tuple)) or not all(isinstance(v, kinds) for v in values):
        raise error(f"{what} = {shown(values)} must be {wanted}")


def require_known(
    kind: str,
    name: Any,
    valid: Collection[str],
    where: str = "",
    error: type[Exception] = ArgumentError,
) -> None:
    """Refuse a name that is none of the valid ones, with the nearest of them.

    Args:
        kind: What it is the name of.
        name: What was given.
        valid: All names that there are.
        where: Begins the message.
        error: Raised if there is none of that name.

    Raises:
        Exception: Of that class.
    """
    if not isinstance(name, str) or name not in valid:
        raise error(where + unknown_name(kind, name, valid))
