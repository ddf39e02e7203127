"""Removal of joints and actuators from an MJCF, with all that refers to them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import mujoco

from grosmc_mj.ground.errors import ModelError, name_list

_OBJECT = mujoco.mjtObj
_TRANSMISSION = mujoco.mjtTrn
_EQUALITY = mujoco.mjtEq
# Kind of the element that an actuator's target names; other kinds are never removed.
_TARGETS = {
    _TRANSMISSION.mjTRN_JOINT: _OBJECT.mjOBJ_JOINT,
    _TRANSMISSION.mjTRN_JOINTINPARENT: _OBJECT.mjOBJ_JOINT,
    _TRANSMISSION.mjTRN_SO3: _OBJECT.mjOBJ_JOINT,
    _TRANSMISSION.mjTRN_TENDON: _OBJECT.mjOBJ_TENDON,
}
# A kind and a name: a joint and a tendon may share a name.
Element = tuple[Any, str]


def remove(
    spec: mujoco.MjSpec,
    moved: Sequence[str],
    used: Sequence[str],
    *,
    named: bool,
) -> list[str]:
    """Lock joints and leave out actuators, with tendons, sensors and all else that needs them.

    A tendon of locked joints has one length; a constraint between bodies that no joint moves
    against each other has nothing to hold.

    Args:
        spec: The model, which is changed.
        moved: Names of the joints that move.
        used: Names of the actuators that are used.
        named: Whether these were asked for by name, so that none may be lost.

    Returns:
        Sentences on what was removed.

    Raises:
        ModelError: If an actuator or a moved joint needs what is removed.
    """
    locked = [joint for joint in spec.joints if joint.name not in moved]
    gone: set[Element] = {(_OBJECT.mjOBJ_JOINT, joint.name) for joint in locked}
    tendons = _tendons(spec, moved)
    gone |= {(_OBJECT.mjOBJ_TENDON, tendon.name) for tendon in tendons}

    unused = []
    for actuator in spec.actuators:
        target = (_TARGETS.get(actuator.trntype), actuator.target)
        if actuator.name in used and target in gone and named:
            raise ModelError(_lost(actuator, tendons))
        if actuator.name not in used or target in gone:
            unused.append(actuator)
    gone |= {(_OBJECT.mjOBJ_ACTUATOR, actuator.name) for actuator in unused}

    notes = []
    if locked:
        notes.append(f"locked where the model has them: joints {_names(locked)}")
    if tendons:
        notes.append(f"left out: tendons {_names(tendons)}")
    if unused:
        notes.append(f"left out: actuators {_names(unused)}")

    referring = [*_sensors(spec, gone), *_tuples(spec, gone), *_equalities(spec, gone)]
    # An element is deleted after all that refers to it.
    for part in (*referring, *unused, *tendons, *locked, *spec.keys):
        spec.delete(part)
    notes += _remove_idle_constraints(spec)
    return notes


def _names(parts: Iterable[Any]) -> str:
    """Names of elements; some tendons have none."""
    return ", ".join(part.name or "without a name" for part in parts)


def _lost(actuator: mujoco.MjsActuator, tendons: Sequence[mujoco.MjsTendon]) -> str:
    """Message about an actuator that was asked for and drives what is removed."""
    if actuator.trntype != _TRANSMISSION.mjTRN_TENDON:
        return (
            f"actuator {actuator.name!r} drives the joint {actuator.target!r}, which joints=... "
            "leaves out"
        )
    (tendon,) = [tendon for tendon in tendons if tendon.name == actuator.target]
    joints = name_list([wrap.target.name for wrap in tendon.path])
    return (
        f"actuator {actuator.name!r} pulls the tendon {actuator.target!r} of {joints}, which "
        "joints=... leaves out"
    )


def _tendons(spec: mujoco.MjSpec, moved: Sequence[str]) -> list[mujoco.MjsTendon]:
    """List the tendons that have a locked joint.

    Raises:
        ModelError: If one of them acts on a joint that moves.
    """
    removed = []
    for tendon in spec.tendons:
        wraps = [wrap for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT]
        joints = [wrap.target.name for wrap in wraps]
        locked = [joint for joint in joints if joint not in moved]
        if not locked:
            continue
        if len(locked) < len(joints):
            raise ModelError(
                f"tendon {tendon.name!r} joins {name_list(joints)}, of which joints=... leaves out "
                f"{name_list(locked)}: move all of them, or remove the tendon"
            )
        removed.append(tendon)
    return removed


def _sensors(spec: mujoco.MjSpec, gone: set[Element]) -> list[mujoco.MjsSensor]:
    """List the sensors that refer to what is removed."""
    removed = []
    for sensor in spec.sensors:
        references = {(sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname)}
        if references & gone:
            removed.append(sensor)
    return removed


def _tuples(spec: mujoco.MjSpec, gone: set[Element]) -> list[mujoco.MjsTuple]:
    """List the tuples that refer to what is removed."""
    removed = []
    for group in spec.tuples:
        kinds = [_OBJECT(kind) for kind in group.objtype]
        if gone & set(zip(kinds, group.objname, strict=True)):
            removed.append(group)
    return removed


def _equalities(spec: mujoco.MjSpec, gone: set[Element]) -> list[mujoco.MjsEquality]:
    """List the constraints of tendons that are removed."""
    removed = []
    for equality in spec.equalities:
        tendons = {(_OBJECT.mjOBJ_TENDON, name) for name in (equality.name1, equality.name2)}
        if equality.type == _EQUALITY.mjEQ_TENDON and tendons & gone:
            removed.append(equality)
    return removed


def _remove_idle_constraints(spec: mujoco.MjSpec) -> list[str]:
    """Remove loops that are closed between bodies which do not move against each other."""
    notes = []
    for equality in spec.equalities:
        if equality.type not in (_EQUALITY.mjEQ_CONNECT, _EQUALITY.mjEQ_WELD):
            continue
        ends = [_body(spec, equality.objtype, name) for name in (equality.name1, equality.name2)]
        if _carrier(ends[0]) != _carrier(ends[1]):
            continue
        if equality.active:
            kind = _EQUALITY(equality.type).name.removeprefix("mjEQ_").lower()
            names = " and ".join(repr(name or "world") for name in (equality.name1, equality.name2))
            notes.append(
                f"left out: the constraint ({kind}) of {names}, between which no joint moves"
            )
        spec.delete(equality)
    return notes


def _body(spec: mujoco.MjSpec, kind: Any, name: str) -> mujoco.MjsBody:
    """Body of an end of a constraint, which names a body or a site."""
    if not name:
        return spec.worldbody
    if kind == _OBJECT.mjOBJ_SITE:
        return spec.site(name).parent
    return spec.body(name)


def _carrier(body: mujoco.MjsBody) -> str:
    """Name of the body that moves with this one and has a joint, or of the world."""
    while body.parent is not None and not body.joints:
        body = body.parent
    return body.name
