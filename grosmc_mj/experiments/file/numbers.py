"""Numbers of a law from the values of a case file."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from grosmc_mj.arguments import reals, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.uncertainty import StateUncertainty, Uncertainty
from grosmc_mj.errors import ArgumentError, GrosmcError, value_text
from grosmc_mj.experiments.file.units import is_number, number_in

Declared = TypeVar("Declared", Uncertainty, StateUncertainty)


def law_number(name: str, value: Any, *, of_states: bool = False) -> Any:
    """Return a number, a matrix, an uncertainty or the name of a body.

    Args:
        name: Key of the number.
        value: Value in the file.
        of_states: Whether the law is designed on the linearization, with an uncertainty of states.

    Raises:
        ArgumentError: If the value does not fit.
    """
    if name == "uncertainty":
        if of_states:
            return uncertainty(value, StateUncertainty)
        return uncertainty(value)
    if name == "body":
        if not isinstance(value, str):
            raise ArgumentError(f"body = {value_text(value)} must be a name")
        return value
    if name in ("frequency", "bandwidth") and isinstance(value, str):
        try:
            return number_in(value, "rad/s")
        except ValueError as error:
            raise ArgumentError(f"{name}: {error}") from None

    entries = np.ravel(np.asarray(value, object)).tolist()
    if not all(map(is_number, entries)):
        raise ArgumentError(
            f"{name} = {value_text(value)} must be a number or the rows of a matrix"
        )
    if not all(map(math.isfinite, entries)):
        raise ArgumentError(f"{name} = {value_text(value)} must be finite")
    if np.ndim(value) == 0:
        return float(value)
    return np.array(value, float)


def uncertainty(value: Any, kind: type[Declared] = Uncertainty) -> Declared:
    """Return a declared uncertainty.

    Args:
        value: Value in the file.
        kind: Class for laws on outputs or, for laws on the linearization, on states.

    Raises:
        ArgumentError: If a key is missing, unknown or has a wrong value.
    """
    keys = [item.name for item in fields(kind)]
    if not isinstance(value, dict):
        raise ArgumentError(
            f"uncertainty = {value_text(value)} must be a table with {', '.join(keys)}"
        )
    for key in value:
        require_known("key", key, keys, where="uncertainty: ")
    try:
        return kind(**value)
    except GrosmcError as error:
        raise ArgumentError(f"uncertainty: {error}") from None


def weight(name: str, value: Any, size: int) -> Array:
    """Return a weight as a matrix, (size, size), from a number, a diagonal or rows.

    Raises:
        ArgumentError: If it does not fit.
    """
    matrix = reals(value)
    if matrix.ndim == 0:
        matrix = matrix * np.eye(size)
    elif matrix.ndim == 1:
        matrix = np.diag(matrix)
    if matrix.shape != (size, size) or not np.all(np.isfinite(matrix)):
        raise ArgumentError(
            f"{name} = {value} must be a number, {size} numbers or a {size} x {size} matrix"
        )
    return matrix
