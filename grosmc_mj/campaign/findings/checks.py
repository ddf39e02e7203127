"""What the statistics of a campaign refuse, in one line each."""

from __future__ import annotations

from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError


def checked_share(name: str, value: float) -> float:
    """A number strictly between 0 and 1.

    Raises:
      ArgumentError: If it is anything else.
    """
    if not isinstance(value, (int, float)) or not 0 < value < 1:
        raise ArgumentError(f"{name} = {value!r}: give a number between 0 and 1, for instance 0.95")
    return float(value)


def checked_margins(name: str, margins: Any) -> Array:
    """Signed margins as floats, (n,); -inf stands for a run that did not complete.

    Raises:
      ArgumentError: If there are none, or one is NaN or +inf.
    """
    found = _row(name, margins)
    wrong = np.flatnonzero(np.isnan(found) | (found == np.inf))
    if len(wrong):
        raise ArgumentError(
            f"{name}: entry {wrong[0]} is {found[wrong[0]]}: "
            "a margin is finite, or -inf for a run that did not complete"
        )
    return found


def checked_values(name: str, values: Any, runs: int) -> Array:
    """Finite values as floats, one a run, (n,).

    Raises:
      ArgumentError: If there are none, another number of them than runs, or one is not finite.
    """
    found = _row(name, values)
    same_length(name, len(found), "the margins", runs)
    wrong = np.flatnonzero(~np.isfinite(found))
    if len(wrong):
        raise ArgumentError(f"{name}: entry {wrong[0]} is {found[wrong[0]]}: give finite numbers")
    return found


def same_length(first_name: str, first: int, second_name: str, second: int) -> None:
    """Require two numbers of entries to agree.

    Raises:
      ArgumentError: If they do not.
    """
    if first != second:
        raise ArgumentError(
            f"{first_name} has {first} entries and {second_name} {second}: give one a run"
        )


def _row(name: str, values: Any) -> Array:
    """A row of floats that is not empty."""
    try:
        found = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise ArgumentError(f"{name} must be a row of numbers") from None
    if found.ndim != 1 or not len(found):
        raise ArgumentError(
            f"{name} has shape {found.shape}: give a row of numbers that is not empty"
        )
    return found
