"""Reading a robot's MJCF: its joints and actuators, and the models that are refused."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ModelError, one_line
from grosmc_mj.ground.fields import Items
from grosmc_mj.ground.files import require_regular
from grosmc_mj.mechanics.physics.files import compile_spec, joint_names
from grosmc_mj.mechanics.robots.actuators import TorqueInput, torque_input
from grosmc_mj.mechanics.robots.removal import remove

Names = Iterable[str] | None
# Models that MuJoCo reads together with an MJCF.
_INCLUDED = re.compile(r"""<(?:include|model)\b[^<>]*?\bfile\s*=\s*["']([^"']+)""")


def read_spec(model: Any) -> mujoco.MjSpec:
    """Read an editable copy of a model.

    Args:
        model: A path, XML text, an MjSpec, or an MJCF element of dm_control.

    Raises:
        ModelError: If it is something else, or MuJoCo cannot read it.
    """
    try:
        spec = _unchecked_spec(model)
        if spec is not None:
            _require_regular_assets(spec)
            return spec
    except ValueError as error:
        raise ModelError(f"the MJCF cannot be read: {one_line(str(error))}") from error
    raise ModelError(
        f"a {type(model).__name__} cannot be edited: give the path of an MJCF file, XML text, an "
        "MjSpec or an MJCF element of dm_control"
    )


def _unchecked_spec(model: Any) -> mujoco.MjSpec | None:
    """Read an editable copy of a model, whose meshes and textures are read later.

    Returns:
        The copy; None if the model is of no known kind.

    Raises:
        ValueError: If it cannot be read.
    """
    spec = mujoco.MjSpec
    if isinstance(model, spec):
        return model.copy()
    if hasattr(model, "to_xml_string") and hasattr(model, "get_assets"):
        return spec.from_string(model.to_xml_string(), assets=model.get_assets())
    if isinstance(model, str) and model.lstrip().startswith("<"):
        _require_regular_includes(model, Path(), set())
        return spec.from_string(model)
    if isinstance(model, (str, Path)):
        return spec.from_file(_checked_path(Path(model)))
    return None


def _checked_path(path: Path) -> str:
    """Return the path of an MJCF file; MuJoCo would wait for a pipe, and take any bytes for names.

    Raises:
        ValueError: If it is no text in UTF-8; as ArgumentError, if it or a model that it includes
            is no regular file.
    """
    require_regular(path)
    if path.is_file():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            raise ValueError(f"{path} is no text in UTF-8") from None
        _require_regular_includes(text, path.parent, {path})
    return str(path)


def _require_regular_includes(text: str, folder: Path, seen: set[Path]) -> None:
    """Refuse an MJCF that includes a pipe or another file that reading would not end with.

    Args:
        text: The MJCF.
        folder: Folder of the first MJCF, in which MuJoCo looks for all of them.
        seen: Files that are checked already.

    Raises:
        ArgumentError: With the name of the file.
    """
    for name in _INCLUDED.findall(text):
        path = folder / name
        if path in seen:
            continue
        seen.add(path)
        require_regular(path)
        if path.is_file():
            included = path.read_text(encoding="utf-8", errors="replace")
            _require_regular_includes(included, folder, seen)


def _require_regular_assets(spec: mujoco.MjSpec) -> None:
    """Refuse meshes, height fields, skins and textures that reading would not end with.

    Raises:
        ArgumentError: With the name of the file.
    """
    assets = [*spec.meshes, *spec.hfields, *spec.skins, *spec.textures]
    files = [asset.file for asset in assets]
    for texture in spec.textures:
        files += texture.cubefiles

    folder = Path(spec.modelfiledir)
    for file in filter(None, files):
        for place in ("", spec.meshdir, spec.texturedir):
            require_regular(folder / place / file)


def robot_specs(
    model: Any, joints: Names = None, actuators: Names = None
) -> tuple[mujoco.MjSpec, mujoco.MjSpec | None, list[str], dict[str, float]]:
    """Make a robot's model with ideal torque inputs, the model as it is built, notes and gears.

    As built, actuators have the lags and delays of the model, with torque at the joint as their
    input, and joints are coupled as in the model; None without lags, delays and couplings.

    Args:
        model: As for ``read_spec``.
        joints: The joints to move; all others are locked where the model has them. All by
            default.
        actuators: The actuators to use; all others are left out. All by default.

    Returns:
        Both models, the changes of the model that was read, in sentences, and of each motor the
        torque for a command of 1.

    Raises:
        ModelError: If it is no such robot, with the reason and what to do.
    """
    spec = read_spec(model)
    notes: list[str] = []
    if spec.joints and not spec.actuators:
        joint = spec.joints[0].name or "NAME"
        raise ModelError(
            f'the model has no actuator: add <actuator> with <motor joint="{joint}"/>, one '
            "for each joint that a law moves"
        )
    _name_all_parts(spec)
    _select(spec, joints, actuators, notes)
    couplings = _couplings(spec, notes)

    compiled = compile_spec(spec)
    drives: dict[str, list[TorqueInput]] = {joint: [] for joint in joint_names(compiled)}
    for actuator in spec.actuators:
        torque = torque_input(spec, compiled, actuator.name)
        drives[torque.joint].append(torque)
        if torque.note:
            notes.append(torque.note)
    _refuse_joints(compiled, drives, couplings)
    _refuse_model(compiled)

    idle = [joint for joint, driving in drives.items() if not driving]
    if idle:
        notes.append(
            f"no actuator drives {', '.join(idle)}: laws are designed from MuJoCo's linearization "
            "about an operating point (a joint left out of joints=... is locked)"
        )
    notes += _not_compensated(compiled)

    # In the order of the joints, each of which has one torque at most.
    torques = list(itertools.chain.from_iterable(drives.values()))
    built = _replace_actuators(spec, torques)
    gears = {torque.actuator: torque.gear for torque in torques if torque.gear is not None}
    return spec, built, notes, gears


def _replace_actuators(spec: mujoco.MjSpec, torques: Sequence[TorqueInput]) -> mujoco.MjSpec | None:
    """Replace actuators and couplings of a model by ideal torques.

    Returns:
        The model as it is built, with lags, delays and couplings; None if it has none of them.
    """
    for actuator in spec.actuators:
        spec.delete(actuator)
    built = None
    if spec.equalities or any(torque.built for torque in torques):
        built = spec.copy()
    for equality in spec.equalities:
        spec.delete(equality)

    for torque in torques:
        torque.add_to(spec)
        if built is not None:
            torque.add_to(built, as_built=True)
    return built


def _name_all_parts(spec: mujoco.MjSpec) -> None:
    """Name bodies, joints and actuators that have no name."""
    kinds = {"body": spec.bodies[1:], "joint": spec.joints, "actuator": spec.actuators}
    for kind, parts in kinds.items():
        names = {part.name for part in parts}
        for index, part in enumerate(parts, start=1):
            if part.name:
                continue
            name = f"{kind}{index}"
            if name in names:
                name += "_"
            part.name = name


def _select(
    spec: mujoco.MjSpec,
    joints: Names,
    actuators: Names,
    notes: list[str],
) -> None:
    """Remove the joints and actuators that are not named, and all that refers to them."""
    moved = _names("joint", joints, [joint.name for joint in spec.joints])
    used = _names("actuator", actuators, [actuator.name for actuator in spec.actuators])

    notes += remove(spec, moved, used, named=actuators is not None)


def _names(kind: str, names: Names, valid: Sequence[str]) -> list[str]:
    """Return names of parts that exist, each once; all of them for None."""
    if names is None:
        return list(valid)

    chosen: Any = [names] if isinstance(names, str) else names
    Items(str, f"names of {kind}s").require(f"{kind}s", chosen, ModelError)
    for name in chosen:
        require_known(kind, name, valid, error=ModelError)
    if len(set(chosen)) < len(chosen):
        raise ModelError(f"{kind}s = {chosen}: one is named twice")
    return list(chosen)


def _couplings(spec: mujoco.MjSpec, notes: list[str]) -> list[list[str]]:
    """List the joints of each coupling; delete those that are off, or of joints that are locked.

    Raises:
        ModelError: If a constraint is none between joints.
    """
    joints = {joint.name for joint in spec.joints}
    couplings: list[list[str]] = []
    for equality in spec.equalities:
        if equality.active and equality.type != mujoco.mjtEq.mjEQ_JOINT:
            kind = mujoco.mjtEq(equality.type).name.removeprefix("mjEQ_").lower()
            raise ModelError(
                f"the model has equality constraints ({kind}): they close loops, and its torques "
                "are no function of q, q' and q'' alone; remove them, or couple joints"
            )

        coupled = [name for name in (equality.name1, equality.name2) if name]
        names = " and ".join(map(repr, coupled))
        if equality.active and joints.issuperset(coupled):
            couplings.append(coupled)
            effect = "couples the joints" if len(coupled) > 1 else "holds the joint"
            notes.append(
                f"the plant {effect} {names} (equality), which no law knows: laws move each on "
                "its own"
            )
            continue

        if equality.active:
            notes.append(f"left out: the coupling (equality) of {names}")
        spec.delete(equality)
    return couplings


def _refuse_joints(
    model: mujoco.MjModel,
    drives: Mapping[str, list[TorqueInput]],
    couplings: list[list[str]],
) -> None:
    """Refuse joints that no law can move by torques.

    Args:
        model: Compiled.
        drives: Torque inputs of every joint.
        couplings: Joints of each coupling.

    Raises:
        ModelError: With the first such joint and the remedy.
    """
    if not drives:
        raise ModelError("the model has no joint that a law could move")

    coupled = set(itertools.chain.from_iterable(couplings))
    for index, (name, driving) in enumerate(drives.items()):
        kind = mujoco.mjtJoint(int(model.jnt_type[index]))
        if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL):
            raise ModelError(
                f"joint {name!r} is a {kind.name.removeprefix('mjJNT_').lower()} joint: a robot "
                "here has hinges and slides only; leave it out of joints=... to fix its body"
            )
        if model.jnt_actgravcomp[index]:
            raise ModelError(
                f"joint {name!r} has actuatorgravcomp: its actuator would bear gravity as well as "
                "the law; set it to false"
            )
        if len(driving) > 1:
            actuators = ", ".join(torque.actuator for torque in driving)
            raise ModelError(
                f"joint {name!r} has {len(driving)} actuators, {actuators}: name the one to use "
                "with actuators=..."
            )
        if not driving and name in coupled:
            raise ModelError(
                f"joint {name!r} is coupled (equality) and no actuator drives it: leave it out of "
                "joints=..., which locks it, or give it an actuator"
            )

    if not any(drives.values()):
        raise ModelError(
            f"no actuator drives {', '.join(map(repr, drives))}: name one with actuators=..."
        )


def _refuse_model(model: mujoco.MjModel) -> None:
    """Refuse a model whose torques inverse dynamics does not give.

    Raises:
        ModelError: With the reason.
    """
    if np.any(model.dof_dampingpoly) or np.any(model.jnt_stiffnesspoly):
        raise ModelError("a damper or spring of a joint is not linear: give it one coefficient")
    for field in ("stiffness", "damping", "frictionloss", "armature", "limited"):
        if np.any(getattr(model, f"tendon_{field}")):
            raise ModelError(
                "the model has tendons with stiffness, damping, friction, armature or limits: the "
                "law does not know them; remove them"
            )
    if model.nflex or model.nplugin:
        raise ModelError("the model has flexible bodies or plugins, which have states of their own")
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION:
        raise ModelError("the model has its actuation disabled")


def _not_compensated(model: mujoco.MjModel) -> list[str]:
    """List the parts of the nominal model that the law ignores, as a note."""
    effects: list[str] = []
    if np.any(model.dof_frictionloss):
        effects.append("dry joint friction (frictionloss)")
    if np.any(model.jnt_limited):
        effects.append("joint limits")
    if model.opt.density or model.opt.viscosity:
        effects.append("the fluid (density, viscosity)")
    touching = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT
    if touching and np.any(model.geom_contype | model.geom_conaffinity):
        effects.append("contacts")

    if not effects:
        return []
    return [f"not compensated by the law, a disturbance to it: {', '.join(effects)}"]
