"""Numbers of a law from the values of a case file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from grosmc_mj.ground.arguments import reals, require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, name_list, placed, value_text
from grosmc_mj.ground.units import is_number, number_hint, number_in
from grosmc_mj.theory.control.pid_tuning import Tuning
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty

# Numbers of a user's own law that may be written as a text with a unit.
UNITS = {"frequency": "rad/s", "bandwidth": "rad/s", "filter": "s", "tracking_time": "s"}

Declared = TypeVar("Declared", Uncertainty, StateUncertainty)


def law_number(
    name: str,
    value: Any,
    names: Sequence[str] = (),
    *,
    unit: str = "",
    of_states: bool = False,
    base_units: Sequence[str] = (),
) -> Any:
    """Return a number, a matrix, an uncertainty, a tuning, or the name of a body or of outputs.

    Args:
        name: Key of the number.
        value: Value in the file.
        names: Names of the error state's entries, if the law has some.
        unit: Unit in which it may be written as a text; empty for none.
        of_states: Whether the law is designed on the linearization, with an uncertainty of states.
        base_units: Units of inputs, outputs and time, of which that of a gain is made.

    Raises:
        ArgumentError: If the value does not fit.
    """
    if name == "uncertainty":
        if of_states:
            return uncertainty(value, StateUncertainty, names)
        return uncertainty(value, names=names)
    if name == "body":
        if not isinstance(value, str):
            raise ArgumentError(f"body = {value_text(value)} must be a name")
        return value
    if name == "controls":
        if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
            raise ArgumentError(f"controls = {value_text(value)} must be a list of names")
        return value
    if name == "tune":
        return _tuning(value)
    if unit and isinstance(value, str):
        return _with_unit(name, value, unit)

    if name == "G" and isinstance(value, dict):
        value = [in_order(name, value, names, missing=0.0)]
    entries = np.ravel(np.asarray(value, object)).tolist()
    if not all(map(is_number, entries)):
        raise ArgumentError(
            f"{name} = {value_text(value)} must be a number or the rows of a matrix"
            f"{_plain_hint(value, base_units)}"
        )
    if not all(map(math.isfinite, entries)):
        raise ArgumentError(f"{name} = {value_text(value)} must be finite")
    if np.ndim(value) == 0:
        return float(value)
    return np.array(value, float)


def _plain_hint(value: Any, base_units: Sequence[str]) -> str:
    """Return words on a text in the place of a plain number; empty for anything else."""
    hint = number_hint(value)
    if hint or not isinstance(value, str) or not base_units:
        return hint
    return (
        ": gains are plain numbers, in units of the input over those of the output "
        f"(here of {name_list(base_units)})"
    )


def _with_unit(name: str, value: Any, unit: str) -> float:
    """Return a number of a text with a unit, such as "2 s"."""
    with placed(f"{name}: "):
        return number_in(value, unit)


def _tuning(value: Any) -> Tuning:
    """Return what a PID is tuned for, of { settles_within = "2 s" }."""
    if not isinstance(value, dict) or "settles_within" not in value:
        raise ArgumentError(
            f'tune = {value_text(value)} must be a table such as {{ settles_within = "2 s" }}'
        )
    for key in value:
        require_known("key", key, ["settles_within"], where="tune: ")
    with placed("tune: "):
        return Tuning(_with_unit("settles_within", value["settles_within"], "s"))


def uncertainty(
    value: Any,
    kind: type[Declared] = Uncertainty,
    names: Sequence[str] = (),
) -> Declared:
    """Return a declared uncertainty.

    Args:
        value: Value in the file.
        kind: Class for laws on outputs or, for laws on the linearization, on states.
        names: Names of the error state's entries, by which ``region`` may be given.

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
    if isinstance(value.get("region"), dict):
        value = {**value, "region": in_order("uncertainty: region", value["region"], names)}
    with placed("uncertainty: "):
        return kind(**value)


def in_order(
    where: str,
    values: dict[str, Any],
    names: Sequence[str],
    *,
    missing: float | None = None,
) -> list[Any]:
    """Return values that are given by name in the order of the names.

    Args:
        where: Key of the values, for messages.
        values: The values by name.
        names: All names, in order.
        missing: Value of the names that are left out; None if each needs one.

    Raises:
        ArgumentError: If a name is unknown, or lacks its value.
    """
    for name in values:
        require_known("name", name, names, f"{where}: ")
    left_out = [name for name in names if name not in values]
    if left_out and missing is None:
        verb = "is" if len(left_out) == 1 else "are"
        raise ArgumentError(
            f"{where}: {name_list(left_out)} {verb} missing: each of {name_list(names)} needs one"
        )
    return [values.get(name, missing) for name in names]


def weight(name: str, value: Any, names: Sequence[str]) -> Array:
    """Return a weight as a matrix, from a number, numbers by name, a diagonal or rows.

    Args:
        name: Key of the weight; names that Q leaves out weigh nothing, R needs all.
        value: Value in the file.
        names: Names of the n entries that it weighs.

    Returns:
        (n, n).

    Raises:
        ArgumentError: If it does not fit.
    """
    size = len(names)
    if isinstance(value, dict):
        value = in_order(name, value, names, missing=0.0 if name.endswith("Q") else None)
    matrix = reals(value)
    if matrix.ndim == 0:
        matrix = matrix * np.eye(size)
    elif matrix.ndim == 1:
        matrix = np.diag(matrix)
    if matrix.shape != (size, size) or not np.all(np.isfinite(matrix)):
        raise ArgumentError(
            f"{name} = {value} must be a number, {size} numbers or a {size} x {size} matrix, or "
            f"numbers by name: {name_list(names)}"
        )
    return matrix
