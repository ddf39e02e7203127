"""Checks of a model before it is stepped: finite numbers, and nobody has changed them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.ground.errors import ModelError, value_text

# Arrays that the motion depends on, by the first part of their names.
_MOVING = ("body", "jnt", "dof", "qpos", "geom", "site", "actuator", "tendon", "eq", "pair")
_OPTIONS = ("gravity", "wind", "magnetic", "density", "viscosity", "impratio", "tolerance")
_SWITCHES = (
    "timestep",
    "integrator",
    "cone",
    "jacobian",
    "solver",
    "iterations",
    "disableflags",
    "enableflags",
    "disableactuator",
)
# Fields of an editable model that the motion depends on most, by the kind of its elements.
_WRITTEN = {
    "bodies": "name mass inertia fullinertia ipos iquat pos quat gravcomp",
    "joints": "name axis pos range ref springref stiffness damping armature frictionloss "
    "actfrcrange",
    "geoms": "mass density size pos contype conaffinity",
    "actuators": "name target gear gainprm biasprm ctrlrange forcerange",
}
_WRITTEN_OPTIONS = "timestep integrator gravity disableflags density viscosity"
# Shortest and longest timestep of a model [s].
SHORTEST, LONGEST = 1e-9, 1.0


@cache
def _arrays() -> tuple[str, ...]:
    """Names of the arrays of numbers that the motion depends on; colours have float32."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    moving = [name for name in dir(model) if name.split("_")[0].rstrip("0") in _MOVING]
    arrays = [name for name in moving if _has_numbers(getattr(model, name))]
    # Numbers that MuJoCo derives at the reference position come after those that it reads.
    return tuple(sorted(arrays, key=lambda name: name.endswith("0")))


def _has_numbers(attribute: Any) -> bool:
    """True of an array of numbers."""
    return isinstance(attribute, np.ndarray) and attribute.dtype == np.float64


def refuse_unusable(model: mujoco.MjModel, name: str) -> None:
    """Refuse numbers that MuJoCo compiles and nobody can simulate.

    Args:
        model: Compiled.
        name: Name of the model in messages.

    Raises:
        ModelError: If the timestep is not from 1e-9 to 1 s, a number that the motion depends on is
            not finite, or a name cannot be printed.
    """
    names = model.names.decode(errors="replace").replace("\0", "")
    if not names.isprintable():
        raise ModelError(
            f"{value_text(name, str)}: a name in it has characters that cannot be printed"
        )

    h = float(model.opt.timestep)
    if not SHORTEST <= h < LONGEST:
        raise ModelError(
            f"{name}: its timestep is {h:g} s, must lie between {SHORTEST:g} and {LONGEST:g} s: "
            "write <option timestep=...>"
        )

    for field in _OPTIONS:
        _require_finite(name, field, getattr(model.opt, field))
    for field in _arrays():
        _require_finite(name, field, getattr(model, field))


def _require_finite(name: str, field: str, numbers: Any) -> None:
    """Refuse a field of a model with a number that is not finite.

    Raises:
        ModelError: With the first such number.
    """
    numbers = np.atleast_1d(numbers)
    finite = np.isfinite(numbers)
    if not finite.all():
        index = np.argwhere(~finite)[0].tolist()
        number = numbers[tuple(index)]
        raise ModelError(f"{name}: {field}{index} = {number:g} must be finite")


def fingerprint(model: mujoco.MjModel) -> str:
    """Hash of all numbers that the motion depends on."""
    fields = [getattr(model, name) for name in _arrays()]
    options = [getattr(model.opt, name) for name in (*_OPTIONS, *_SWITCHES)]
    return _hash(fields + options)


def spec_fingerprint(spec: mujoco.MjSpec) -> str:
    """Hash of the numbers of an editable model that the motion depends on."""
    values = [getattr(spec.option, name) for name in _WRITTEN_OPTIONS.split()]
    for kind, text in _WRITTEN.items():
        names = text.split()
        for element in getattr(spec, kind):
            values += [getattr(element, name) for name in names]
    return _hash(values)


def _hash(values: Iterable[Any]) -> str:
    digest = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            digest.update(value.tobytes())
        else:
            digest.update(repr(value).encode())
    return digest.hexdigest()
