"""Edits of bodies, joints and inputs of a nominal model.

The parts of a machine as built are edits, too.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterable
from typing import Annotated, Any, NoReturn

import mujoco
import numpy as np

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import KeyName, Name, Numbers, Point, Range, checked
from grosmc_mj.mechanics.physics.dry_friction import set_dry_friction
from grosmc_mj.mechanics.physics.edit import Change, Edit
from grosmc_mj.mechanics.physics.files import compile_spec
from grosmc_mj.theory.plants.owner_units import DAMPING, FORCE, GEAR, INERTIA

_SIZELESS = (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
# A compiler refuses a body that moves and has less mass or inertia.
_LEAST = mujoco.mjMINVAL
# Added parts are drawn in a colour of their own, with the density of stone [kg/m^3].
COLOUR = (0.85, 0.33, 0.1, 1.0)
_DENSITY = 2500.0


def apply_edits(
    spec: mujoco.MjSpec,
    edits: Iterable[Edit],
    nominal: mujoco.MjModel | None = None,
    timestep: float | None = None,
) -> mujoco.MjSpec:
    """Copy a model with edits applied.

    Scales come first, so an added mass sits where its position says in the scaled body. Parts of a
    machine come last, so a transmission lies between a motor and the edited joint.

    Args:
        spec: The nominal model, which stays as it is.
        edits: The changes.
        nominal: The same compiled, if it is at hand.
        timestep: Of the edited model [s]; None for the nominal one's.

    Raises:
        ModelError: If a body, joint or input is unknown, is edited twice or cannot have the edit.
    """
    edits = tuple(edits)
    edited = spec.copy()
    if timestep is not None:
        edited.option.timestep = timestep
    if not edits:
        return edited

    _require_owners(spec, edits)
    if nominal is None:
        nominal = compile_spec(spec)
    if any(edit.owner == "body" for edit in edits):
        _keep_inertias(edited, nominal)
    for edit in sorted(edits, key=lambda edit: edit.order):
        edit.write(edited, nominal)
    return edited


def _require_owners(spec: mujoco.MjSpec, edits: Iterable[Edit]) -> None:
    """Refuse an edit of something that the model lacks, or that has an edit of the kind already.

    Raises:
        ModelError: With the first such edit.
    """
    count = Counter((type(edit), edit.of) for edit in edits if not edit.several)
    for edit in edits:
        require_owner(spec, edit, f"{edit.kind}: ")
        if count[type(edit), edit.of] > 1:
            raise ModelError(
                f"{edit.owner} {edit.of!r} has two of the kind {edit.kind!r}: give one"
            )


def require_owner(spec: mujoco.MjSpec, edit: Edit, where: str = "") -> None:
    """Refuse an edit of something that the model lacks.

    Args:
        spec: The model.
        edit: The edit.
        where: Beginning of the message.

    Raises:
        ModelError: With the valid names, or the body of a site that is called so.
    """
    owners = {"joint": spec.joints, "body": spec.bodies[1:], "input": spec.actuators}
    names = [owner.name for owner in owners[edit.owner]]
    site = spec.site(edit.of)
    if edit.owner == "body" and edit.of not in names and site is not None:
        place = ", ".join(f'"{number:g} m"' for number in site.pos)
        raise ModelError(
            f'{where}body: {edit.of!r} is a site: write body = "{site.parent.name}", and at = '
            f"[{place}] for its place"
        )
    require_known(edit.owner, edit.of, names, where, ModelError)


@checked(ModelError)
class BodyEdit(Edit):
    """Scale a body's mass by a and all its lengths by b, or give it another mass and inertia.

    The body stays similar to itself: its inertia about its centre of mass scales by a b^2, the
    offset of that centre, its sites, its child bodies' places and its drawn geometry by b.

    Attributes:
        body: Name of the body.
        mass_scale: Factor a on the body's mass and inertia.
        length_scale: Factor b on all lengths of the body.
        mass: Mass [kg], in the place of a times the nominal one; its inertia scales with it.
        inertia: Principal moments about its centre of mass [kg m^2], (3,); by default they scale.
    """

    body: Name
    mass_scale: Annotated[float, Range(0, above=True, usual=(0.01, 100))] = 1.0
    length_scale: Annotated[float, Range(0, above=True, usual=(0.01, 100))] = 1.0
    mass: Annotated[float, Range(0, unit="kg", above=True)] | None = None
    inertia: Annotated[tuple[float, float, float], Numbers(3, "kg m^2")] | None = None

    owner = "body"
    order = 0

    def __post_init__(self) -> None:
        scales = [name for name in ("mass_scale", "length_scale") if getattr(self, name) != 1]
        if self.mass is not None and "mass_scale" in scales:
            self._refuse_both("mass", "mass_scale")
        if self.inertia is not None and scales:
            self._refuse_both("inertia", " and ".join(scales))
        if self.inertia is not None and min(self.inertia) <= 0:
            raise ModelError(f"edit of {self.body!r}: inertia {self.inertia} must be positive")

    def _refuse_both(self, number: str, scales: str) -> NoReturn:
        raise ModelError(
            f"edit of {self.body!r}: {number} and {scales}: give the number or its scale"
        )

    def __str__(self) -> str:
        mass = f"mass x{self.mass_scale:.3g}"
        if self.mass is not None:
            mass = f"mass {self.mass:.3g} kg"

        size = f"length x{self.length_scale:.3g}"
        if self.inertia is not None:
            moments = ", ".join(f"{moment:.3g}" for moment in self.inertia)
            size = f"inertia {moments} kg m^2"
        return f"{self.body}: {mass}, {size}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write the inertia of the edited body, and scale its looks and places."""
        body = spec.body(self.body)
        index = nominal.body(self.body).id
        nominal_mass = float(nominal.body_mass[index])
        b = self.length_scale

        if nominal_mass:
            a = self.mass_scale if self.mass is None else self.mass / nominal_mass
            write_inertia(body, self.mass or a * nominal_mass, nominal, index)
            body.inertia = self.inertia or a * (b * b) * nominal.body_inertia[index]
            body.ipos = b * nominal.body_ipos[index]
        elif self.mass or self.mass_scale != 1 or self.inertia:
            raise ModelError(f"body {self.body!r} has no mass to scale: edit the body that has")

        if b != 1:
            _scale_geometry(spec, body, b)

    def changes(
        self, model: mujoco.MjModel, undrawn_bodies: Collection[str]
    ) -> list[Change] | None:
        """Its changes of a compiled model; None for other numbers, and for lengths of geoms."""
        a = self.mass_scale
        b = self.length_scale
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, self.body)
        if index < 1 or (b != 1 and self.body not in undrawn_bodies):
            return None
        if self.mass or self.inertia:
            return None

        # Mass and three moments of inertia.
        before = np.array([model.body_mass[index], *model.body_inertia[index]])
        with np.errstate(all="ignore"):
            after = np.array([a, *[a * (b * b)] * 3]) * before
        acceptable = np.isfinite(after) & ((after >= _LEAST) | (before < _LEAST))
        if not before[0] or not np.all(acceptable):
            return None
        changes: list[Change] = [
            ("body_mass", index, after[0]),
            ("body_inertia", index, after[1:]),
        ]
        if b == 1:
            return changes

        changes.append(("body_ipos", index, b * model.body_ipos[index]))
        bodies = np.flatnonzero(model.body_parentid == index)
        if bodies.size:
            changes.append(("body_pos", bodies, b * model.body_pos[bodies]))
        sites = np.flatnonzero(model.site_bodyid == index)
        if sites.size:
            changes.append(("site_pos", sites, b * model.site_pos[sites]))
        return changes


@checked(ModelError)
class AddedMass(Edit):
    """A point mass fixed to a body: a load that laws do not know of.

    Attributes:
        body: Name of the body.
        mass: Added mass [kg].
        position: Place of the added mass in the body's own frame [m], (3,).
    """

    body: Name
    mass: Annotated[float, Range(0, unit="kg"), KeyName("added_mass")]
    position: Annotated[Point, KeyName("at")] = (0.0, 0.0, 0.0)

    kind = "load"
    owner = "body"
    order = 1
    several = True

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg more"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Merge the mass into the body's inertia, beside those added before, and draw it."""
        if self.mass == 0:
            return
        # Compiled with the edits before this one.
        model = compile_spec(spec)
        index = model.body(self.body).id
        mass = float(model.body_mass[index])
        centre = model.body_ipos[index]

        place = np.array(self.position)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.body_iquat[index])
        axes = rotation.reshape(3, 3)
        total = mass + self.mass
        with np.errstate(all="ignore"):
            new_centre = (mass * centre + self.mass * place) / total
            about_new = (
                axes @ np.diag(model.body_inertia[index]) @ axes.T
                + mass * _steiner(centre - new_centre)
                + self.mass * _steiner(place - new_centre)
            )
        if not np.isfinite(about_new).all():
            raise ModelError(
                f"load of {self.body!r}: {self.mass:g} kg at {list(self.position)} m has no finite "
                "inertia"
            )
        principal = np.zeros(3)
        vectors = np.zeros(9)
        quaternion = np.zeros(4)
        mujoco.mju_eig3(principal, vectors, quaternion, about_new.ravel())

        body = spec.body(self.body)
        write_inertia(body, total, model, index)
        body.inertia = principal
        body.ipos = new_centre
        body.iquat = quaternion
        draw_ball(body, self.mass, pos=self.position)


@checked(ModelError)
class JointEdit(Edit):
    """Give a joint other numbers; those left out stay as the model has them.

    Attributes:
        joint: Name of the joint.
        damping: Damping [N m s/rad or N s/m].
        friction: Dry friction [N m or N], see ``dry_friction``.
        armature: Inertia of what drives it [kg m^2 or kg].
    """

    joint: Name
    damping: Annotated[float, Range(0, unit=DAMPING, bare=True)] | None = None
    friction: Annotated[float, Range(0, unit=FORCE, bare=True)] | None = None
    armature: Annotated[float, Range(0, unit=INERTIA, bare=True)] | None = None

    owner = "joint"
    order = 2

    def __str__(self) -> str:
        numbers: dict[str, float | None] = {
            "damping": self.damping,
            "friction": self.friction,
            "armature": self.armature,
        }
        words = [f"{name} {value:.3g}" for name, value in numbers.items() if value is not None]
        return f"{self.joint}: {', '.join(words) or 'as it is'}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write the numbers."""
        joint = spec.joint(self.joint)
        if self.damping is not None:
            joint.damping = linear_polynomial(self.damping, joint.damping)
        if self.friction is not None:
            set_dry_friction(spec, joint, self.friction)
        if self.armature is not None:
            joint.armature = self.armature


@checked(ModelError)
class InputEdit(Edit):
    """Give an input of the model another gear.

    Attributes:
        input: Name of the actuator.
        gear: Torque or force at its joint for one unit of it, of either sign.
    """

    input: Name
    gear: Annotated[float, Range(unit=GEAR, bare=True)]

    owner = "input"
    order = 3

    def __post_init__(self) -> None:
        if not self.gear:
            raise ModelError(f"edit of {self.input!r}: gear = 0 must not be zero")

    def __str__(self) -> str:
        return f"{self.input}: gear {self.gear:.4g}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write the gear."""
        actuator = spec.actuator(self.input)
        actuator.gear = [self.gear, *actuator.gear[1:]]

    def changes(
        self, model: mujoco.MjModel, undrawn_bodies: Collection[str]
    ) -> list[Change] | None:
        """The gear in a compiled model; None if it has no such actuator."""
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, self.input)
        if index < 0:
            return None
        return [("actuator_gear", (index, 0), self.gear)]


def _keep_inertias(spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
    """Let written masses count in a model that would compute them from its geoms again.

    ``inertiafromgeom="true"`` and ``settotalmass`` overrule a body's own mass: the nominal bodies
    that they lead to are written instead.
    """
    compiler = spec.compiler
    always = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    if compiler.inertiafromgeom != always and compiler.settotalmass <= 0:
        return

    for index, body in enumerate(spec.bodies[1:], start=1):
        write_inertia(body, nominal.body_mass[index], nominal, index)
    compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    compiler.settotalmass = -1


def _scale_geometry(spec: mujoco.MjSpec, body: mujoco.MjsBody, b: float) -> None:
    """Scale a body's geoms, and the places of all that is attached to it, about its origin."""
    meshes = {geom.meshname for geom in body.geoms if geom.meshname}
    elsewhere = {geom.meshname for geom in spec.geoms if geom.parent.name != body.name}
    shared = meshes & elsewhere
    for geom in body.geoms:
        if geom.type in _SIZELESS or geom.meshname in shared:
            raise ModelError(
                f"geom {geom.name or geom.meshname!r} of body {body.name!r}: length edits need "
                "primitive geoms, or meshes that no other body uses"
            )
        geom.size = b * geom.size
        geom.fromto = b * geom.fromto

    for name in sorted(meshes):
        mesh = spec.mesh(name)
        mesh.scale = b * mesh.scale

    attached = (body.geoms, body.sites, body.cameras, body.lights, body.bodies, body.frames)
    for part in itertools.chain.from_iterable(attached):
        part.pos = b * part.pos


def _steiner(offset: Array) -> Array:
    """Inertia of a unit point mass about a point at an offset: the parallel-axis theorem."""
    return float(offset @ offset) * np.eye(3) - np.outer(offset, offset)


def write_inertia(
    body: mujoco.MjsBody,
    mass: float,
    like: mujoco.MjModel,
    index: int,
) -> None:
    """Give a body the inertia of a compiled one, explicit from now on, with another mass."""
    body.explicitinertial = True
    body.mass = mass
    body.inertia = like.body_inertia[index]
    body.fullinertia = np.full(6, np.nan)
    body.ipos = like.body_ipos[index]
    body.iquat = like.body_iquat[index]


def linear_polynomial(coefficient: float, like: Any) -> Array:
    """Polynomial of a spring or damper in MuJoCo that has a linear coefficient only.

    Args:
        coefficient: Of a deflection or a speed.
        like: A polynomial of the size wanted.
    """
    return coefficient * np.eye(np.size(like))[0]


def draw_geom(
    body: mujoco.MjsBody,
    kind: mujoco.mjtGeom,
    size: list[float],
    **place: Any,
) -> None:
    """Draw a geom that neither weighs nor touches."""
    body.add_geom(type=kind, size=size, rgba=COLOUR, contype=0, conaffinity=0, mass=0, **place)


def ball_radius(mass: float) -> float:
    """Radius of the ball that a point mass [kg] is drawn as [m]."""
    return float((3 * mass / (4 * math.pi * _DENSITY)) ** (1 / 3))


def draw_ball(body: mujoco.MjsBody, mass: float, **place: Any) -> None:
    """Draw a point mass [kg]."""
    draw_geom(body, mujoco.mjtGeom.mjGEOM_SPHERE, [ball_radius(mass), 0.0, 0.0], **place)
