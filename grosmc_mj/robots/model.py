"""Reading a robot's MJCF: from where, which joints and actuators, and what is refused."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arguments import require_each, require_known
from grosmc_mj.errors import ModelError, one_line
from grosmc_mj.physics.files import compile_spec, joint_names
from grosmc_mj.robots.actuators import TorqueInput, torque_input

_JOINT, _DISABLE = mujoco.mjtJoint, mujoco.mjtDisableBit
Names = Iterable[str] | None


def read_spec(model: Any) -> mujoco.MjSpec:
    """An editable copy of a model.

    Args:
        model: A path, XML text, an MjSpec, or an MJCF element of dm_control.

    Raises:
        ModelError: If it is something else, or MuJoCo cannot read it.
    """
    try:
        if isinstance(model, mujoco.MjSpec):
            return model.copy()
        if hasattr(model, "to_xml_string") and hasattr(model, "get_assets"):
            return mujoco.MjSpec.from_string(model.to_xml_string(), assets=model.get_assets())
        if isinstance(model, str) and model.lstrip().startswith("<"):
            return mujoco.MjSpec.from_string(model)
        if isinstance(model, (str, Path)) and Path(model).is_file():
            return mujoco.MjSpec.from_file(str(model))
    except ValueError as error:
        raise ModelError(f"the MJCF cannot be read: {one_line(str(error))}") from error
    if isinstance(model, (str, Path)):
        raise ModelError(f"there is no MJCF file {str(model)!r}")
    if isinstance(model, mujoco.MjModel):
        raise ModelError(
            "a compiled MjModel cannot be edited, and a true plant is an edited one: give its "
            "MJCF file, XML text or MjSpec"
        )
    raise ModelError(
        f"a {type(model).__name__} is no model: give a path, XML text, an MjSpec or an MJCF "
        "element of dm_control"
    )


def robot_specs(
    model: Any, joints: Names = None, actuators: Names = None
) -> tuple[mujoco.MjSpec, mujoco.MjSpec | None, list[str]]:
    """A robot's model with ideal torque inputs, the same as it is built, and notes.

    As built, actuators with lags, delays or DC motors are those of the model, with torque at the
    joint as their input, and joints are coupled as in the model; None where there is none of this.

    Args:
        model: As for ``read_spec``.
        joints: The joints to move; all others are locked where the model has them. All by
            default.
        actuators: The actuators to use; all others are left out. All by default.

    Returns:
        Both models and what was changed in the one that was given, in sentences.

    Raises:
        ModelError: If it is no such robot, with the reason and what to do.
    """
    spec, notes = read_spec(model), list[str]()
    _name_all_parts(spec)
    _select(spec, joints, actuators, notes)
    couplings = _couplings(spec, notes)
    compiled = compile_spec(spec)
    inputs = [torque_input(spec, compiled, actuator.name) for actuator in spec.actuators]
    drives = {
        joint: [torque for torque in inputs if torque.joint == joint]
        for joint in joint_names(compiled)
    }
    for problem in _problems(compiled, drives, couplings):
        raise ModelError(problem)
    notes += [torque.note for torque in inputs if torque.note]
    if idle := [joint for joint, driving in drives.items() if not driving]:
        notes.append(
            f"no actuator drives {', '.join(idle)}: laws are designed from MuJoCo's linearization "
            "about an operating point (a joint left out of joints=... is locked)"
        )
    for actuator in spec.actuators:
        spec.delete(actuator)
    built = spec.copy() if couplings or any(torque.built for torque in inputs) else None
    for equality in spec.equalities:
        spec.delete(equality)
    # In the order of the joints.
    for (torque,) in filter(None, drives.values()):
        torque.add_to(spec)
        if built is not None:
            torque.add_to(built, as_built=True)
    return spec, built, [*notes, *_not_compensated(compiled)]


def _name_all_parts(spec: mujoco.MjSpec) -> None:
    """Name bodies, joints and actuators that have no name."""
    kinds = {"body": spec.bodies[1:], "joint": spec.joints, "actuator": spec.actuators}
    for kind, parts in kinds.items():
        taken = {part.name for part in parts}
        for index, part in enumerate(parts, start=1):
            name = f"{kind}{index}"
            part.name = part.name or (f"{name}_" if name in taken else name)


def _select(spec: mujoco.MjSpec, joints: Names, actuators: Names, notes: list[str]) -> None:
    """Remove the joints and actuators that are not named, and all that refers to them."""
    moved = _names("joint", joints, [joint.name for joint in spec.joints])
    used = _names("actuator", actuators, [actuator.name for actuator in spec.actuators])
    locked = [joint for joint in spec.joints if joint.name not in moved]
    left_out = [
        actuator
        for actuator in spec.actuators
        if actuator.name not in used or actuator.target in {joint.name for joint in locked}
    ]
    for actuator in left_out:
        if actuators is not None and actuator.name in used:
            raise ModelError(
                f"actuator {actuator.name!r} drives the joint {actuator.target!r}, which joints="
                "... leaves out"
            )
    if locked:
        names = ", ".join(joint.name for joint in locked)
        notes.append(f"locked where the model has them: joints {names}")
    if left_out:
        names = ", ".join(actuator.name for actuator in left_out)
        notes.append(f"left out: actuators {names}")
    removed = {part.name for part in (*locked, *left_out)}
    lost = [sensor for sensor in spec.sensors if {sensor.objname, sensor.refname} & removed]
    for part in (*locked, *left_out, *lost, *spec.keys):
        spec.delete(part)


def _names(kind: str, names: Names, valid: Sequence[str]) -> list[str]:
    """Names of parts that exist, each once; all of them for None."""
    chosen: Any = valid if names is None else [names] if isinstance(names, str) else names
    require_each(f"{kind}s", chosen, str, f"names of {kind}s", ModelError)
    for name in chosen:
        require_known(kind, name, valid, error=ModelError)
        if list(chosen).count(name) > 1:
            raise ModelError(f"{kind} {name!r} is named twice")
    return list(chosen)


def _couplings(spec: mujoco.MjSpec, notes: list[str]) -> list[list[str]]:
    """The joints of each coupling; those that are off, or of joints that are locked, go.

    Raises:
        ModelError: If a constraint is none between joints.
    """
    joints, couplings = {joint.name for joint in spec.joints}, []
    for equality in spec.equalities:
        coupled = [name for name in (equality.name1, equality.name2) if name]
        if equality.active and equality.type != mujoco.mjtEq.mjEQ_JOINT:
            kind = mujoco.mjtEq(equality.type).name.removeprefix("mjEQ_").lower()
            raise ModelError(
                f"the model has equality constraints ({kind}): they close loops, and its torques "
                "are no function of q, q' and q'' alone; remove them, or couple joints"
            )
        if equality.active and joints.issuperset(coupled):
            couplings.append(coupled)
            names = " and ".join(map(repr, coupled))
            kind = "couples the joints" if len(coupled) > 1 else "holds the joint"
            notes.append(
                f"the plant {kind} {names} (equality), which no law knows: laws move each on its "
                "own"
            )
            continue
        if equality.active:
            left = ", ".join(sorted({*coupled} - joints))
            notes.append(f"left out: the coupling (equality) with {left}")
        spec.delete(equality)
    return couplings


def _problems(
    model: mujoco.MjModel, drives: Mapping[str, list[TorqueInput]], couplings: list[list[str]]
) -> Iterator[str]:
    """What makes it no tree of hinges and slides that torques drive and inverse dynamics tells of.

    Args:
        model: Compiled.
        drives: The torque inputs of every joint.
        couplings: Joints of which each is coupled to the other.
    """
    if not drives:
        yield "the model has no joint that a law could move"
    for index, (name, driving) in enumerate(drives.items()):
        kind = _JOINT(int(model.jnt_type[index]))
        if kind in (_JOINT.mjJNT_FREE, _JOINT.mjJNT_BALL):
            yield (
                f"joint {name!r} is a {kind.name.removeprefix('mjJNT_').lower()} joint: a robot "
                "here has hinges and slides only; leave it out of joints=... to fix its body"
            )
        if model.jnt_actgravcomp[index]:
            yield (
                f"joint {name!r} has actuatorgravcomp: its actuator would bear gravity as well as "
                "the law; set it to false"
            )
        if len(driving) > 1:
            rivals = ", ".join(torque.actuator for torque in driving)
            yield (
                f"joint {name!r} has {len(driving)} actuators, {rivals}: name the one to use with "
                "actuators=..."
            )
        if not driving and any(name in coupled for coupled in couplings):
            yield (
                f"joint {name!r} is coupled (equality) and no actuator drives it: leave it out of "
                "joints=..., which locks it, or give it an actuator"
            )
    if not any(drives.values()):
        yield f"no actuator drives {', '.join(map(repr, drives))}: name one with actuators=..."
    fields = ("stiffness", "damping", "frictionloss", "armature", "limited")
    if any(np.any(getattr(model, f"tendon_{field}")) for field in fields):
        yield (
            "the model has tendons with stiffness, damping, friction, armature or limits: the law "
            "does not know them; remove them"
        )
    if model.nflex or model.nplugin:
        yield "the model has flexible bodies or plugins, which have states of their own"
    if model.opt.disableflags & _DISABLE.mjDSBL_ACTUATION:
        yield "the model has its actuation disabled"


def _not_compensated(model: mujoco.MjModel) -> list[str]:
    """Parts of the nominal model that the law ignores."""
    touching = not model.opt.disableflags & _DISABLE.mjDSBL_CONTACT
    present = {
        "dry joint friction (frictionloss)": np.any(model.dof_frictionloss),
        "joint limits": np.any(model.jnt_limited),
        "contacts": touching and np.any(model.geom_contype | model.geom_conaffinity),
    }
    words = ", ".join(word for word, there in present.items() if there)
    return [f"not compensated by the law, a disturbance to it: {words}"] if words else []
