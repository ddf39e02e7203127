"""What a plant has that its nominal model lacks, as edits: masses, lengths, frictions, parts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from grosmc_mj.arguments import real, reals, require, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError, shown
from grosmc_mj.machine.building import build
from grosmc_mj.machine.parts import MachinePart
from grosmc_mj.machine.writing import draw_ball, linear, write_inertia
from grosmc_mj.physics.files import compile_spec

_SIZELESS = (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
# Sine of the angle within which an axis lies along z, but for rounding.
_PARALLEL = 1e-9


@dataclass(frozen=True)
class BodyEdit:
    """Scale a body's mass by a and every length of it by b.

    The body stays similar to itself: its inertia about its centre of mass scales by a b^2, the
    offset of that centre, its sites, its child bodies' places and its drawn geometry by b.

    Attributes:
        body: Name of the body.
        mass_scale: a.
        length_scale: b.
    """

    body: str
    mass_scale: float = 1.0
    length_scale: float = 1.0

    def __post_init__(self) -> None:
        require("body", self.body, str, "the name of a body", ModelError)
        for name in ("mass_scale", "length_scale"):
            _require(f"edit of {self.body!r}", name, getattr(self, name), positive=True)

    def __str__(self) -> str:
        return f"{self.body}: mass x{self.mass_scale:.3g}, length x{self.length_scale:.3g}"


@dataclass(frozen=True)
class AddedMass:
    """A point mass fixed to a body: a load that nobody has told the law of.

    Attributes:
        body: Name of the body.
        mass: [kg].
        position: In the body's own frame [m], (3,).
    """

    body: str
    mass: float
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require("body", self.body, str, "the name of a body", ModelError)
        _require(f"load on {self.body!r}", "mass", self.mass, positive=True)
        position = reals(self.position)
        if position.shape != (3,) or not np.all(np.isfinite(position)):
            raise ModelError(
                f"load on {self.body!r}: position = {shown(self.position)} must be three finite "
                "numbers"
            )

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg more"


@dataclass(frozen=True)
class JointEdit:
    """Give a joint other numbers; those left out stay as the model has them.

    Attributes:
        joint: Name of the joint.
        damping: [N m s/rad] or [N s/m].
        friction: Dry friction, MuJoCo's ``frictionloss`` [N m] or [N].
        armature: Inertia of what drives it [kg m^2] or [kg].
        tilt: Angle by which its axis a turns towards the z-axis of its body, about a x z [rad]. An
            axis along z, of either direction, turns towards the x-axis.
    """

    joint: str
    damping: float | None = None
    friction: float | None = None
    armature: float | None = None
    tilt: float | None = None

    def __post_init__(self) -> None:
        require("joint", self.joint, str, "the name of a joint", ModelError)
        for name in ("damping", "friction", "armature"):
            value = getattr(self, name)
            if value is not None:
                _require(f"edit of joint {self.joint!r}", name, value)
        if self.tilt is not None and not abs(real(self.tilt)) < math.pi / 2:
            raise ModelError(
                f"edit of joint {self.joint!r}: tilt = {shown(self.tilt)} must be less than a "
                "quarter of a turn"
            )

    def __str__(self) -> str:
        names = ("damping", "friction", "armature", "tilt")
        given = {name: getattr(self, name) for name in names}
        words = [f"{name} {value:.3g}" for name, value in given.items() if value is not None]
        return f"{self.joint}: {', '.join(words) or 'as it is'}"


@dataclass(frozen=True)
class InputEdit:
    """Give an input of the model another gear.

    Attributes:
        input: Name of the actuator.
        gear: Torque or force at its joint for one unit of it, of either sign.
    """

    input: str
    gear: float

    def __post_init__(self) -> None:
        require("input", self.input, str, "the name of an input", ModelError)
        if not (math.isfinite(real(self.gear)) and self.gear):
            raise ModelError(
                f"edit of input {self.input!r}: gear = {shown(self.gear)} must be finite, not zero"
            )

    def __str__(self) -> str:
        return f"{self.input}: gear {self.gear:.4g}"


Edit = BodyEdit | AddedMass | JointEdit | InputEdit | MachinePart


def shrunk(edit: Edit, part: float) -> Edit:
    """A part of an edit of mass and length, from 0 to 1; a joint's numbers stay as they are."""
    if isinstance(edit, AddedMass):
        return replace(edit, mass=max(part, 1e-9) * edit.mass)
    if isinstance(edit, BodyEdit):
        return replace(
            edit,
            mass_scale=1 + part * (edit.mass_scale - 1),
            length_scale=1 + part * (edit.length_scale - 1),
        )
    return edit


def _require(owner: str, name: str, value: float, *, positive: bool = False) -> None:
    """Refuse a number that is not finite, or negative."""
    number = real(value)
    if not (math.isfinite(number) and (number > 0 or (number == 0 and not positive))):
        wanted = "finite and positive" if positive else "finite and not negative"
        raise ModelError(f"{owner}: {name} = {shown(value)} must be {wanted}")


def apply_edits(
    spec: mujoco.MjSpec,
    edits: Iterable[Edit],
    nominal: mujoco.MjModel | None = None,
    timestep: float | None = None,
) -> mujoco.MjSpec:
    """A fresh copy of ``spec`` with the edits applied; ``spec`` itself is not touched.

    Scales come first; a load sits where its position says in the scaled body. Parts of a machine
    come last, so that a transmission lies between a motor and what was edited.

    Args:
        spec: The nominal model.
        edits: What to change.
        nominal: The same compiled, if it is at hand.
        timestep: Of the edited model [s]; None for the nominal one's.

    Raises:
        ModelError: If a body or joint is unknown or edited twice, a body is massless under a
            mass edit, or drawn by what cannot be scaled under a length edit.
    """
    edits, edited = tuple(edits), spec.copy()
    if timestep is not None:
        edited.option.timestep = timestep
    if not edits:
        return edited
    like = compile_spec(spec) if nominal is None else nominal
    scaled = [edit for edit in edits if isinstance(edit, BodyEdit)]
    loads = [edit for edit in edits if isinstance(edit, AddedMass)]
    joints = [edit for edit in edits if isinstance(edit, JointEdit)]
    inputs = [edit for edit in edits if isinstance(edit, InputEdit)]
    bodies = [like.body(i).name for i in range(1, like.nbody)]
    for edit in (*scaled, *loads):
        require_known("body", edit.body, bodies, error=ModelError)
    _refuse_twice("body", [edit.body for edit in scaled], "give one edit with both scales")
    _refuse_twice("joint", [edit.joint for edit in joints], "give one edit with all its numbers")
    _refuse_twice("input", [edit.input for edit in inputs], "give one edit")
    if scaled or loads:
        _keep_inertias(edited, like)
    for edit in scaled:
        _scale_inertia(edited.body(edit.body), like, edit)
        _scale_geometry(edited, edited.body(edit.body), edit.length_scale)
    for edit in loads:
        # With what was added before: a body may bear several loads.
        _add_load(edited.body(edit.body), compile_spec(edited), edit)
    for edit in joints:
        _edit_joint(edited, edit)
    for edit in inputs:
        names = [actuator.name for actuator in edited.actuators]
        require_known("input", edit.input, names, error=ModelError)
        edited.actuator(edit.input).gear = [edit.gear, *edited.actuator(edit.input).gear[1:]]
    build(edited, [edit for edit in edits if isinstance(edit, MachinePart)])
    return edited


def _refuse_twice(kind: str, names: list[str], instead: str) -> None:
    """Refuse two edits of one thing."""
    for name in names:
        if names.count(name) > 1:
            raise ModelError(f"{kind} {name!r} is edited twice: {instead}")


def _keep_inertias(spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
    """Let what is written be what compiles, in a model that would compute it from geoms again.

    ``inertiafromgeom="true"`` and ``settotalmass`` overrule a body's own mass: their outcome, the
    nominal bodies, is written instead.
    """
    compiler = spec.compiler
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if compiler.inertiafromgeom != always and compiler.settotalmass <= 0:
        return
    for index, body in enumerate(spec.bodies[1:], start=1):
        write_inertia(body, nominal.body_mass[index], nominal, index)
    compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    compiler.settotalmass = -1


def _scale_inertia(body: mujoco.MjsBody, nominal: mujoco.MjModel, edit: BodyEdit) -> None:
    """Write the scaled inertia of the compiled nominal body."""
    index, a, b = nominal.body(edit.body).id, edit.mass_scale, edit.length_scale
    mass = float(nominal.body_mass[index])
    if mass == 0:
        if edit.mass_scale != 1:
            raise ModelError(f"body {edit.body!r} has no mass to scale: edit the body that has")
        return
    write_inertia(body, a * mass, nominal, index)
    body.inertia = a * (b * b) * nominal.body_inertia[index]
    body.ipos = b * nominal.body_ipos[index]


def _scale_geometry(spec: mujoco.MjSpec, body: mujoco.MjsBody, b: float) -> None:
    """Scale what is drawn and what is attached, about the body's origin."""
    if b == 1:
        return
    for geom in body.geoms:
        if geom.type in _SIZELESS:
            raise ModelError(
                f"geom {geom.name!r} of body {body.name!r} is a height field or SDF: length edits "
                "need primitive geoms or meshes"
            )
        geom.size, geom.fromto = b * geom.size, b * geom.fromto
    for name in sorted({geom.meshname for geom in body.geoms if geom.meshname}):
        _scale_mesh(spec, body, name, b)
    for part in (*body.geoms, *body.sites, *body.cameras, *body.lights, *body.bodies, *body.frames):
        part.pos = b * part.pos


def _scale_mesh(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, b: float) -> None:
    """Scale a mesh that this body alone is drawn by."""
    others = {
        other.name
        for other in spec.bodies
        if other.name != body.name and any(geom.meshname == name for geom in other.geoms)
    }
    if others:
        raise ModelError(
            f"mesh {name!r} of body {body.name!r} also draws {', '.join(sorted(others))}: a length "
            "edit needs a mesh that no other body uses"
        )
    mesh = spec.mesh(name)
    mesh.scale = b * mesh.scale


def _add_load(body: mujoco.MjsBody, model: mujoco.MjModel, edit: AddedMass) -> None:
    """Merge a point mass into a body's inertia and draw it."""
    index = model.body(edit.body).id
    mass, centre = float(model.body_mass[index]), model.body_ipos[index]
    total = mass + edit.mass
    new_centre = (mass * centre + edit.mass * np.asarray(edit.position)) / total
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[index])
    axes = rotation.reshape(3, 3)
    about_new = (
        axes @ np.diag(model.body_inertia[index]) @ axes.T
        + mass * _steiner(centre - new_centre)
        + edit.mass * _steiner(np.asarray(edit.position) - new_centre)
    )
    principal, vectors, turn = np.zeros(3), np.zeros(9), np.zeros(4)
    mujoco.mju_eig3(principal, vectors, turn, about_new.ravel())
    write_inertia(body, total, model, index)
    body.inertia, body.ipos, body.iquat = principal, new_centre, turn
    draw_ball(body, edit.mass, pos=edit.position)


def _steiner(offset: Array) -> Array:
    """The inertia of a unit point mass about a point this far from it: parallel-axis theorem."""
    return float(offset @ offset) * np.eye(3) - np.outer(offset, offset)


def _edit_joint(spec: mujoco.MjSpec, edit: JointEdit) -> None:
    """Write a joint's new numbers."""
    names = [joint.name for joint in spec.joints]
    require_known("joint", edit.joint, names, error=ModelError)
    joint = spec.joint(edit.joint)
    if edit.damping is not None:
        joint.damping = linear(edit.damping, joint.damping)
    if edit.friction is not None:
        joint.frictionloss = edit.friction
    if edit.armature is not None:
        joint.armature = edit.armature
    if edit.tilt is not None:
        joint.axis = _tilted(np.array(joint.axis) / np.linalg.norm(joint.axis), edit.tilt)


def _tilted(axis: Array, angle: float) -> Array:
    """A unit vector turned towards z, or x if it lies along z: Rodrigues' rotation formula."""
    along_z = np.linalg.norm(axis[:2]) < _PARALLEL
    towards = np.array([1.0, 0.0, 0.0]) if along_z else np.array([0.0, 0.0, 1.0])
    across = towards - (towards @ axis) * axis
    return math.cos(angle) * axis + math.sin(angle) * across / np.linalg.norm(across)
