"""Reading a robot's MJCF: from where, which joints and actuators, and what is refused."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arguments import require_each, require_known
from grosmc_mj.errors import ModelError, one_line
from grosmc_mj.physics.files import compile_spec, joint_names
from grosmc_mj.robots.actuators import TorqueInput, first, torque_input

_JOINT, _DISABLE = mujoco.mjtJoint, mujoco.mjtDisableBit
Names = Iterable[str] | None


def read_spec(model: Any) -> mujoco.MjSpec:
    """An editable copy of a model.

    Args:
        model: A path, XML text, an MjSpec, or an MJCF element of dm_control.

    Raises:
        ModelError: If it is something else, or MuJoCo cannot read it.
    """
    spec = mujoco.MjSpec
    try:
        if isinstance(model, spec):
            return model.copy()
        if hasattr(model, "to_xml_string") and hasattr(model, "get_assets"):
            return spec.from_string(model.to_xml_string(), assets=model.get_assets())
        if isinstance(model, str) and model.lstrip().startswith("<"):
            return spec.from_string(model)
        if isinstance(model, (str, Path)):
            return spec.from_file(str(model))
    except ValueError as error:
        raise ModelError(f"the MJCF cannot be read: {one_line(str(error))}") from error
    raise ModelError(
        f"a {type(model).__name__} cannot be edited: give the path of an MJCF file, XML text, an "
        "MjSpec or an MJCF element of dm_control"
    )


def robot_specs(
    model: Any, joints: Names = None, actuators: Names = None
) -> tuple[mujoco.MjSpec, mujoco.MjSpec | None, list[str]]:
    """A robot's model with ideal torque inputs, the same as it is built, and notes.

    As built, actuators have the lags and delays of the model, with torque at the joint as their
    input, and joints are coupled as in the model; None where there is none of this.

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
    if problem := first(_problems(compiled, drives, couplings)):
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
    undriven = {joint.name for joint in locked}
    left_out = [a for a in spec.actuators if a.name not in used or a.target in undriven]
    for actuator in left_out:
        if actuators is not None and actuator.name in used:
            raise ModelError(
                f"actuator {actuator.name!r} drives the joint {actuator.target!r}, which joints="
                "... leaves out"
            )
    for words, parts in (
        ("locked where the model has them: joints", locked),
        ("left out: actuators", left_out),
    ):
        if parts:
            notes.append(f"{words} {', '.join(part.name for part in parts)}")
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
    if len(set(chosen)) < len(chosen):
        raise ModelError(f"{kind}s = {chosen}: one is named twice")
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
        names = " and ".join(map(repr, coupled))
        if equality.active and joints.issuperset(coupled):
            couplings.append(coupled)
            kind = "couples the joints" if len(coupled) > 1 else "holds the joint"
            unknown = "which no law knows: laws move each on its own"
            notes.append(f"the plant {kind} {names} (equality), {unknown}")
        else:
            spec.delete(equality)
            if equality.active:
                notes.append(f"left out: the coupling (equality) of {names}")
    return couplings


def _problems(
    model: mujoco.MjModel, drives: Mapping[str, list[TorqueInput]], couplings: list[list[str]]
) -> dict[str, Any]:
    """What makes it no tree of hinges and slides that torques drive and inverse dynamics tells of.

    Args:
        model: Compiled.
        drives: The torque inputs of every joint.
        couplings: Joints of which each is coupled to the other.

    Returns:
        Whether it is so, by the words for it.
    """
    problems: dict[str, Any] = {"the model has no joint that a law could move": not drives}
    for index, (name, driving) in enumerate(drives.items()):
        kind = _JOINT(int(model.jnt_type[index]))
        rivals = ", ".join(torque.actuator for torque in driving)
        problems |= {
            f"joint {name!r} is a {kind.name.removeprefix('mjJNT_').lower()} joint: a robot here "
            "has hinges and slides only; leave it out of joints=... to fix its body": (
                kind in (_JOINT.mjJNT_FREE, _JOINT.mjJNT_BALL)
            ),
            f"joint {name!r} has actuatorgravcomp: its actuator would bear gravity as well as the "
            "law; set it to false": model.jnt_actgravcomp[index],
            f"joint {name!r} has {len(driving)} actuators, {rivals}: name the one to use with "
            "actuators=...": len(driving) > 1,
            f"joint {name!r} is coupled (equality) and no actuator drives it: leave it out of "
            "joints=..., which locks it, or give it an actuator": (
                not driving and any(name in coupled for coupled in couplings)
            ),
        }
    fields = ("stiffness", "damping", "frictionloss", "armature", "limited")
    return problems | {
        f"no actuator drives {', '.join(map(repr, drives))}: name one with actuators=...": (
            not any(drives.values())
        ),
        "the model has tendons with stiffness, damping, friction, armature or limits: the law does "
        "not know them; remove them": any(np.any(getattr(model, f"tendon_{f}")) for f in fields),
        "the model has flexible bodies or plugins, which have states of their own": (
            model.nflex or model.nplugin
        ),
        "the model has its actuation disabled": (
            model.opt.disableflags & _DISABLE.mjDSBL_ACTUATION
        ),
    }


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
