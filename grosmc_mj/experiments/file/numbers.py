"""Numbers of a law, as a case file has them."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.uncertainty import StateUncertainty, Uncertainty
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.experiments.file.units import number_in


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
        return (state_uncertainty if of_states else uncertainty)(value)
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
    if any(isinstance(each, bool) or not isinstance(each, (int, float)) for each in entries):
        raise ArgumentError(f"{name} = {shown(value)} must be a number or the rows of a matrix")
    if not all(map(math.isfinite, entries)):
        raise ArgumentError(f"{name} = {shown(value)} must be finite")
    return float(value) if np.ndim(value) == 0 else np.array(value, float)


def uncertainty(value: Any) -> Uncertainty:
    """A declared uncertainty.

    Raises:
        ArgumentError: If a key is missing, unknown or has a wrong value.
    """
    keys = _known_keys(value, Uncertainty)
    if missing := [key for key in keys if key not in value]:
        raise ArgumentError(f"uncertainty: {', '.join(missing)} is missing")
    kinds = {"scales": dict, "wrench": list, "region": list, "reaching_rate": (int, float)}
    for key, kind in kinds.items():
        if not isinstance(value[key], kind):
            what = {dict: "a table", list: "a list of numbers"}.get(kind, "a number")
            raise ArgumentError(f"uncertainty: {key} = {shown(value[key])} must be {what}")
    try:
        return Uncertainty(
            _ranges(value["scales"]),
            tuple(map(float, value["wrench"])),
            tuple(map(float, value["region"])),
            float(value["reaching_rate"]),
        )
    except (TypeError, ValueError, AttributeError) as error:
        raise ArgumentError(f"uncertainty: {error}") from None


def state_uncertainty(value: Any) -> StateUncertainty:
    """A declared uncertainty of a law on the linearization, of which any key may be left out.

    Raises:
        ArgumentError: If a key is unknown or has a wrong value.
    """
    _known_keys(value, StateUncertainty)
    for key, given in value.items():
        kind, what = {"body": (str, "a name"), "scales": (dict, "a table")}.get(
            key, ((int, float), "a number")
        )
        if isinstance(given, bool) or not isinstance(given, kind):
            raise ArgumentError(f"uncertainty: {key} = {shown(given)} must be {what}")
    return StateUncertainty(**{**value, "scales": _ranges(value.get("scales", {}))})


def _known_keys(value: Any, kind: type[Any]) -> list[str]:
    """The keys that an uncertainty may have, after a look at those that it has."""
    keys = [each.name for each in fields(kind)]
    if not isinstance(value, dict):
        raise ArgumentError(f"uncertainty = {shown(value)} must be a table with {', '.join(keys)}")
    for key in value:
        require_known("key", key, keys, where="uncertainty: ")
    return keys


def _ranges(scales: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Ranges of parameters."""
    for name, pair in scales.items():
        if not (isinstance(pair, list) and len(pair) == 2):
            raise ArgumentError(f"uncertainty: {name} = {shown(pair)} must be [least, largest]")
    return {name: (float(low), float(high)) for name, (low, high) in scales.items()}


def weight(name: str, value: Any, size: int) -> Array:
    """A weight as a matrix, (size, size), from a number, a diagonal or rows.

    Raises:
        ArgumentError: If it does not fit.
    """
    try:
        found = np.asarray(value, float)
    except (ValueError, TypeError):
        found = np.zeros((0, 0))
    found = found * np.eye(size) if found.ndim == 0 else found
    found = np.diag(found) if found.ndim == 1 else found
    if found.shape != (size, size):
        raise ArgumentError(
            f"{name} = {value} must be a number, {size} numbers or a {size} x {size} matrix"
        )
    return found
