"""Checks of a model before it is stepped: are its numbers usable, and has anybody changed them?"""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError, shown

# Arrays that the motion depends on, by the first part of their names, and whose they are.
_OWNERS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "jnt": mujoco.mjtObj.mjOBJ_JOINT,
    "dof": mujoco.mjtObj.mjOBJ_JOINT,
    "qpos": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "eq": mujoco.mjtObj.mjOBJ_EQUALITY,
    "pair": mujoco.mjtObj.mjOBJ_PAIR,
}
_OPTIONS = ("gravity", "wind", "magnetic", "density", "viscosity", "impratio", "tolerance")
_SWITCHES = ("timestep", "integrator", "cone", "jacobian", "solver", "iterations")
_FLAGS = ("disableflags", "enableflags", "disableactuator")
# Shortest and longest timestep of a model [s].
SHORTEST, LONGEST = 1e-9, 1.0


@cache
def _arrays() -> tuple[str, ...]:
    """Names of the arrays of numbers that the motion depends on."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    arrays = (
        name
        for name in dir(model)
        if _owner(name) in _OWNERS
        and not name.endswith("_rgba")
        and isinstance(getattr(model, name), np.ndarray)
        and getattr(model, name).dtype.kind == "f"
    )
    # Numbers that MuJoCo derives at the reference position come after those that it reads.
    return tuple(sorted(arrays, key=lambda name: name.endswith("0")))


def _owner(array: str) -> str:
    """The first part of an array's name: ``body`` of ``body_mass``, ``qpos`` of ``qpos0``."""
    return array.split("_")[0].rstrip("0")


def refuse_unusable(model: mujoco.MjModel, name: str) -> None:
    """Refuse numbers that MuJoCo compiles and nobody can simulate.

    Args:
        model: Compiled.
        name: Of the model, in messages.

    Raises:
        ModelError: If the timestep is not from 1e-9 to 1 s, a number that the motion depends on is
            not finite, with the name of its owner, or a name cannot be printed.
    """
    if not model.names.decode(errors="replace").replace("\0", "").isprintable():
        raise ModelError(f"{shown(name, str)}: a name in it has characters that cannot be printed")
    h = float(model.opt.timestep)
    if not SHORTEST <= h < LONGEST:
        raise ModelError(
            f"{name}: its timestep is {h:g} s, must lie between {SHORTEST:g} and {LONGEST:g} s: "
            "write <option timestep=...>"
        )
    for option in _OPTIONS:
        if not np.all(np.isfinite(getattr(model.opt, option))):
            raise ModelError(f"{name}: its {option} is {getattr(model.opt, option)}, not finite")
    for array in _arrays():
        values = getattr(model, array)
        if not np.all(np.isfinite(values)):
            row = int(np.argwhere(~np.isfinite(values))[0, 0])
            raise ModelError(
                f"{name}: {_named(model, array, row)}: {array.partition('_')[2] or array} = "
                f"{values[row].tolist()} must be finite"
            )


def _named(model: mujoco.MjModel, array: str, row: int) -> str:
    """What a row of an array belongs to, in words: ``actuator 'motor'``."""
    kind, index = _OWNERS[_owner(array)], row
    if array.startswith("dof"):
        index = int(model.dof_jntid[row])
    elif array.startswith("qpos"):
        index = int(np.searchsorted(model.jnt_qposadr, row, side="right")) - 1
    word = kind.name.removeprefix("mjOBJ_").lower()
    return f"{word} {mujoco.mj_id2name(model, kind, index) or index!r}"


def fingerprint(model: mujoco.MjModel) -> str:
    """Hash of all numbers that the motion depends on."""
    options = (getattr(model.opt, name) for name in (*_OPTIONS, *_SWITCHES, *_FLAGS))
    arrays = (getattr(model, name) for name in _arrays())
    return hashlib.sha256(b"".join(map(_bytes, (*arrays, *options)))).hexdigest()


# Fields of an editable model that the motion depends on most, by the kind of its elements.
_WRITTEN = {
    "bodies": "name mass inertia fullinertia ipos iquat pos quat gravcomp",
    "joints": "name axis pos range ref springref stiffness damping armature frictionloss "
    "actfrcrange",
    "geoms": "mass density size pos contype conaffinity",
    "actuators": "name target gear gainprm biasprm ctrlrange forcerange",
}
_WRITTEN_OPTIONS = "timestep integrator gravity disableflags density viscosity"


def spec_fingerprint(spec: mujoco.MjSpec) -> str:
    """Hash of the numbers of an editable model that the motion depends on."""
    values = [getattr(spec.option, name) for name in _WRITTEN_OPTIONS.split()]
    for kind, names in _WRITTEN.items():
        values += [getattr(item, name) for item in getattr(spec, kind) for name in names.split()]
    return hashlib.sha256(b"".join(map(_bytes, values))).hexdigest()


def _bytes(value: Any) -> bytes:
    return value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
