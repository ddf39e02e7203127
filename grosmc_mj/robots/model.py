"""Reading a robot's MJCF: from where, which joints and actuators, and what is refused."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arguments import require_each, require_known
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.files import compile_spec
from grosmc_mj.robots.actuators import torque_drives
from grosmc_mj.robots.drives import write_drives

_JOINT = mujoco.mjtJoint


def read_spec(model: Any) -> mujoco.MjSpec:
    """An editable copy of a model.

    Args:
        model: A path, XML text, an MjSpec, or an MJCF element of dm_control.

    Raises:
        ModelError: If it is something else, or MuJoCo cannot read it.
    """
    if isinstance(model, mujoco.MjSpec):
        return model.copy()
    if isinstance(model, mujoco.MjModel):
        raise ModelError(
            "a compiled MjModel cannot be edited, and a true plant is an edited one: give its "
            "MJCF file, XML text or MjSpec"
        )
    try:
        if hasattr(model, "to_xml_string") and hasattr(model, "get_assets"):
            return mujoco.MjSpec.from_string(model.to_xml_string(), assets=model.get_assets())
        if isinstance(model, str) and model.lstrip().startswith("<"):
            return mujoco.MjSpec.from_string(model)
        if isinstance(model, (str, Path)) and Path(model).is_file():
            return mujoco.MjSpec.from_file(str(model))
    except ValueError as error:
        raise ModelError(f"the MJCF cannot be read: {' '.join(str(error).split())}") from error
    if isinstance(model, (str, Path)):
        raise ModelError(f"there is no MJCF file {str(model)!r}")
    raise ModelError(
        f"a {type(model).__name__} is no model: give a path, XML text, an MjSpec or an MJCF "
        "element of dm_control"
    )


def robot_spec(
    model: Any, joints: Iterable[str] | None = None, actuators: Iterable[str] | None = None
) -> tuple[mujoco.MjSpec, mujoco.MjSpec | None, tuple[str, ...]]:
    """A model of a robot, whose inputs are torques at joints; as it is built; and what changed.

    As built, actuators with lags, delays or DC motors are what the model has, with torque at the
    joint as their input, and joints are coupled as in the model; None where there is none of this.

    Args:
        model: As for ``read_spec``.
        joints: The joints to move; all others are locked where the model has them. All by
            default.
        actuators: The actuators to use; all others are left out. All by default.

    Raises:
        ModelError: If it is no such robot, with the reason and what to do.
    """
    spec = read_spec(model)
    _name_everything(spec)
    said: list[str] = []
    removed = _keep(spec, joints, actuators, said)
    lost = [sensor for sensor in spec.sensors if {sensor.objname, sensor.refname} & removed]
    for part in (*spec.keys, *lost):
        spec.delete(part)
    couplings = _kept_couplings(spec, said)
    compiled = compile_spec(spec)
    _refuse_unfit(compiled)
    drives = torque_drives(spec, [each.name for each in spec.actuators])
    driven = {drive.joint: drive for drive in drives}
    names = [compiled.joint(i).name for i in range(compiled.njnt)]
    idle = [name for name in names if name not in driven]
    if not driven:
        raise ModelError(
            f"no actuator drives {', '.join(map(repr, idle))}: name one with actuators=..."
        )
    for name in (name for coupled in couplings for name in coupled if name in idle):
        raise ModelError(
            f"joint {name!r} is coupled (equality) and no actuator drives it: leave it out "
            "of joints=..., which locks it, or give it an actuator"
        )
    chosen = [driven[name] for name in names if name in driven]
    built = spec.copy() if couplings or any(drive.built for drive in chosen) else None
    for equality in spec.equalities:
        spec.delete(equality)
    write_drives(spec, chosen)
    if built is not None:
        write_drives(built, chosen, as_built=True)
    said += [drive.said for drive in drives if drive.said]
    said += map(_coupling_words, couplings)
    if idle:
        said.append(
            f"no actuator drives {', '.join(idle)}: laws are designed from MuJoCo's linearization "
            "about an operating point (a joint left out of joints=... is locked)"
        )
    return spec, built, (*said, *_not_compensated(compile_spec(spec)))


def _name_everything(spec: mujoco.MjSpec) -> None:
    """Name bodies, joints and actuators that have no name."""
    for kind, parts in (
        ("body", spec.bodies[1:]),
        ("joint", spec.joints),
        ("actuator", spec.actuators),
    ):
        taken = {part.name for part in parts}
        for index, part in enumerate(parts, start=1):
            if not part.name:
                name = f"{kind}{index}"
                part.name = name if name not in taken else f"{name}_"


def _keep(
    spec: mujoco.MjSpec,
    joints: Iterable[str] | None,
    actuators: Iterable[str] | None,
    said: list[str],
) -> set[str]:
    """Remove the joints that are not named, and the actuators that are not or that have none."""
    locked: list[str] = []
    if joints is not None:
        kept = _chosen("joint", joints, [joint.name for joint in spec.joints])
        for joint in spec.joints:
            if joint.name not in kept:
                locked.append(joint.name)
                spec.delete(joint)
    wanted = [actuator.name for actuator in spec.actuators]
    if actuators is not None:
        wanted = _chosen("actuator", actuators, wanted)
    left_out = []
    for actuator in spec.actuators:
        idle = actuator.target in locked
        if idle and actuators is not None and actuator.name in wanted:
            raise ModelError(
                f"actuator {actuator.name!r} drives the joint {actuator.target!r}, which joints="
                "... leaves out"
            )
        if idle or actuator.name not in wanted:
            left_out.append(actuator.name)
            spec.delete(actuator)
    if locked:
        said.append(f"locked where the model has them: joints {', '.join(locked)}")
    if left_out:
        said.append(f"left out: actuators {', '.join(left_out)}")
    return {*locked, *left_out}


def _kept_couplings(spec: mujoco.MjSpec, said: list[str]) -> list[tuple[str, ...]]:
    """The joints of each coupling; those that are off, or of joints that are not there, go.

    Args:
        spec: The model; what is left out is removed from it.
        said: What differs from the model as it was given; more is added.

    Raises:
        ModelError: If a constraint is none between joints.
    """
    joints, found = {joint.name for joint in spec.joints}, []
    for equality in spec.equalities:
        kind = mujoco.mjtEq(equality.type).name.removeprefix("mjEQ_").lower()
        names = tuple(name for name in (equality.name1, equality.name2) if name)
        if not equality.active:
            spec.delete(equality)
        elif equality.type != mujoco.mjtEq.mjEQ_JOINT:
            raise ModelError(
                f"the model has equality constraints ({kind}): they close loops, and its torques "
                "are no function of q, q' and q'' alone; remove them, or couple joints"
            )
        elif set(names) <= joints:
            found.append(names)
        else:
            spec.delete(equality)
            left = ", ".join(sorted({*names} - joints))
            said.append(f"left out: the coupling (equality) with {left}")
    return found


def _coupling_words(joints: tuple[str, ...]) -> str:
    """What a coupling is to the laws."""
    names = " and ".join(map(repr, joints))
    what = f"couples the joints {names}" if len(joints) > 1 else f"holds the joint {names}"
    return f"the plant {what} (equality), which no law knows: laws move each on its own"


def _chosen(kind: str, names: Iterable[str], valid: Sequence[str]) -> list[str]:
    """Names that exist, each once."""
    chosen = [names] if isinstance(names, str) else names
    require_each(f"{kind}s", chosen, str, f"names of {kind}s", ModelError)
    chosen = list(chosen)
    for name in chosen:
        require_known(kind, name, valid, error=ModelError)
        if chosen.count(name) > 1:
            raise ModelError(f"{kind} {name!r} is named twice")
    return chosen


def _refuse_unfit(model: mujoco.MjModel) -> None:
    """Refuse what is no tree of hinges and slides that inverse dynamics is exact for.

    Raises:
        ModelError: With the reason.
    """
    for index in range(model.njnt):
        name, kind = model.joint(index).name, _JOINT(int(model.jnt_type[index]))
        if kind in (_JOINT.mjJNT_FREE, _JOINT.mjJNT_BALL):
            what = "free" if kind == _JOINT.mjJNT_FREE else "ball"
            raise ModelError(
                f"joint {name!r} is a {what} joint: a robot here has hinges and slides only; leave "
                "it out of joints=... to fix its body"
            )
        if model.jnt_actgravcomp[index]:
            raise ModelError(
                f"joint {name!r} has actuatorgravcomp: its actuator would bear gravity as well as "
                "the law; set it to false"
            )
    if not model.njnt:
        raise ModelError("the model has no joint that a law could move")
    active = (
        model.tendon_stiffness.any()
        or model.tendon_damping.any()
        or model.tendon_frictionloss.any()
        or model.tendon_armature.any()
        or model.tendon_limited.any()
    )
    if active:
        raise ModelError(
            "the model has tendons with stiffness, damping, friction, armature or limits: the law "
            "does not know them; remove them"
        )
    if model.nflex or model.nplugin:
        raise ModelError("the model has flexible bodies or plugins, which have states of their own")
    if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        raise ModelError("the model has its actuation disabled")


def _not_compensated(model: mujoco.MjModel) -> list[str]:
    """What of the nominal model the law does without."""
    found = []
    if np.any(model.dof_frictionloss):
        found.append("dry joint friction (frictionloss)")
    if np.any(model.jnt_limited):
        found.append("joint limits")
    touching = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if touching and np.any(model.geom_contype | model.geom_conaffinity):
        found.append("contacts")
    return [f"not compensated by the law, a disturbance to it: {', '.join(found)}"] if found else []
