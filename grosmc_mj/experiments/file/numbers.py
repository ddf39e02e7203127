"""Numbers of a law, as a case file has them."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from grosmc_mj.arguments import reals, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.uncertainty import StateUncertainty, Uncertainty
from grosmc_mj.errors import ArgumentError, GrosmcError, shown
from grosmc_mj.experiments.file.units import number_in

Declared = TypeVar("Declared", Uncertainty, StateUncertainty)


def law_number(name: str, value: Any, *, of_states: bool = False) -> Any:
    """A number, a matrix, an uncertainty or the name of a body.

    Args:
        name: What it is called.
        value: As the file has it.
        of_states: Whether the law is one on the linearization, with an uncertainty of its own kind.

    Raises:
        ArgumentError: If it is none.
    """
    if name == "uncertainty":
        return uncertainty(value, StateUncertainty) if of_states else uncertainty(value)
    if name == "body":
        if not isinstance(value, str):
            raise ArgumentError(f"body = {shown(value)} must be a name")
        return value
    if name in ("frequency", "bandwidth") and isinstance(value, str):
        try:
            return number_in(value, "rad/s")
        except ValueError as error:
            raise ArgumentError(f"{name}: {error}") from None
    entries = np.ravel(np.asarray(value, object)).tolist()
    if any(isinstance(entry, bool) or not isinstance(entry, (int, float)) for entry in entries):
        raise ArgumentError(f"{name} = {shown(value)} must be a number or the rows of a matrix")
    if not all(map(math.isfinite, entries)):
        raise ArgumentError(f"{name} = {shown(value)} must be finite")
    return float(value) if np.ndim(value) == 0 else np.array(value, float)


def uncertainty(value: Any, kind: type[Declared] = Uncertainty) -> Declared:
    """A declared uncertainty.

    Args:
        value: As the file has it.
        kind: Its class: that of laws on outputs or, of laws on the linearization, on states.

    Raises:
        ArgumentError: If a key is missing, unknown or has a wrong value.
    """
    keys = [item.name for item in fields(kind)]
    if not isinstance(value, dict):
        raise ArgumentError(f"uncertainty = {shown(value)} must be a table with {', '.join(keys)}")
    for key in value:
        require_known("key", key, keys, where="uncertainty: ")
    try:
        return kind(**value)
    except GrosmcError as error:
        raise ArgumentError(f"uncertainty: {error}") from None


def weight(name: str, value: Any, size: int) -> Array:
    """A weight as a matrix, (size, size), from a number, a diagonal or rows.

    Raises:
        ArgumentError: If it does not fit.
    """
    entries = reals(value)
    matrix = np.diag(entries) if entries.ndim == 1 else entries
    matrix = matrix * np.eye(size) if matrix.ndim == 0 else matrix
    if matrix.shape != (size, size) or not np.all(np.isfinite(matrix)):
        raise ArgumentError(
            f"{name} = {value} must be a number, {size} numbers or a {size} x {size} matrix"
        )
    return matrix
