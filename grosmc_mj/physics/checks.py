"""Checks of a model before it is stepped: are its numbers usable, and has anybody changed them?"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from functools import cache
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError, shown

# Arrays that the motion depends on, by the first part of their names.
_MOVING = ("body", "jnt", "dof", "qpos", "geom", "site", "actuator", "tendon", "eq", "pair")
_OPTIONS = ("gravity", "wind", "magnetic", "density", "viscosity", "impratio", "tolerance")
_SWITCHES = (
    "timestep", "integrator", "cone", "jacobian", "solver", "iterations",
    "disableflags", "enableflags", "disableactuator",
)  # fmt: skip
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
    moving = (name for name in dir(model) if name.split("_")[0].rstrip("0") in _MOVING)
    arrays = (name for name in moving if getattr(getattr(model, name), "dtype", 0) == np.float64)
    # Numbers that MuJoCo derives at the reference position come after those that it reads.
    return tuple(sorted(arrays, key=lambda name: name.endswith("0")))


def refuse_unusable(model: mujoco.MjModel, name: str) -> None:
    """Refuse numbers that MuJoCo compiles and nobody can simulate.

    Args:
        model: Compiled.
        name: Of the model, in messages.

    Raises:
        ModelError: If the timestep is not from 1e-9 to 1 s, a number that the motion depends on is
            not finite, or a name cannot be printed.
    """
    if not model.names.decode(errors="replace").replace("\0", "").isprintable():
        raise ModelError(f"{shown(name, str)}: a name in it has characters that cannot be printed")
    h = float(model.opt.timestep)
    if not SHORTEST <= h < LONGEST:
        raise ModelError(
            f"{name}: its timestep is {h:g} s, must lie between {SHORTEST:g} and {LONGEST:g} s: "
            "write <option timestep=...>"
        )
    for owner, fields in ((model.opt, _OPTIONS), (model, _arrays())):
        for field in fields:
            values = np.atleast_1d(getattr(owner, field))
            for index in np.argwhere(~np.isfinite(values)).tolist():
                number = values[tuple(index)]
                raise ModelError(f"{name}: {field}{index} = {number:g} must be finite")


def fingerprint(model: mujoco.MjModel) -> str:
    """Hash of all numbers that the motion depends on."""
    return _hash(
        [getattr(model, name) for name in _arrays()]
        + [getattr(model.opt, name) for name in (*_OPTIONS, *_SWITCHES)]
    )


def spec_fingerprint(spec: mujoco.MjSpec) -> str:
    """Hash of the numbers of an editable model that the motion depends on."""
    values = [getattr(spec.option, name) for name in _WRITTEN_OPTIONS.split()]
    for kind, names in _WRITTEN.items():
        values += [getattr(item, name) for item in getattr(spec, kind) for name in names.split()]
    return _hash(values)


def _hash(values: Iterable[Any]) -> str:
    arrays = (v.tobytes() if isinstance(v, np.ndarray) else repr(v).encode() for v in values)
    return hashlib.sha256(b"".join(arrays)).hexdigest()
