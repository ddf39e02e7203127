"""Edits of a nominal model: values that know how they are written into it.

Masses, lengths, joints and inputs are here; the parts of a machine as built are edits, too.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import mujoco
import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.fields import Finite, Name, NotNegative, Range, Vector, checked
from grosmc_mj.physics.files import compile_spec

if TYPE_CHECKING:
    from grosmc_mj.physics.hidden_states import HiddenState
    from grosmc_mj.physics.template import Template
    from grosmc_mj.plants import System

# A field of mjModel, which of its rows, and the value there.
Change = tuple[str, Any, Any]

_SIZELESS = (mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
# Sine of the angle within which an axis lies along z, but for rounding.
_PARALLEL = 1e-9
# A compiler refuses a body that moves and has less mass or inertia.
_LEAST = mujoco.mjMINVAL
# Added parts are drawn in a colour of their own, with the density of stone [kg/m^3].
COLOUR = (0.85, 0.33, 0.1, 1.0)
_DENSITY = 2500.0


@dataclass(frozen=True)
class Edit(ABC):
    """A change of the nominal model that laws do not know of.

    Attributes:
        kind: Its name in messages.
        owner: The field that names its owner: ``body``, ``joint`` or ``input``.
        order: Edits are written in ascending order, whatever the order they are listed in.
        several: Whether one owner may have several of the kind.
        rigid: Whether the rigid system, of which there are equations, can have it.
    """

    kind: ClassVar[str] = "edit"
    owner: ClassVar[str]
    order: ClassVar[int]
    several: ClassVar[bool] = False
    rigid: ClassVar[bool] = True

    @property
    def of(self) -> str:
        """Name of its body, joint or input."""
        return getattr(self, self.owner)

    @abstractmethod
    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write it into an editable model.

        Args:
            spec: With the edits of a lower order.
            nominal: Compiled, without any edit.

        Raises:
            ModelError: If this model cannot have it.
        """

    def changes(self, template: Template) -> list[Change] | None:  # noqa: B027
        """Its changes of a compiled model; None if a model with it must be compiled."""

    def hidden(self, state: HiddenState, model: mujoco.MjModel) -> HiddenState:
        """A hidden state of the compiled model, with its name and unit if it is this edit's."""
        return state

    def require_start(self, system: System, x0: Array) -> None:  # noqa: B027  most have no bounds
        """Refuse a start, (n,), where it cannot be.

        Raises:
            ArgumentError: With the bounds.
        """

    def require_timestep(self, model: mujoco.MjModel, system: str) -> None:  # noqa: B027
        """Refuse a compiled model whose timestep or integrator makes it unstable.

        Raises:
            ModelError: With the name of the system and the timestep that it needs.
        """


def apply_edits(
    spec: mujoco.MjSpec,
    edits: Iterable[Edit],
    nominal: mujoco.MjModel | None = None,
    timestep: float | None = None,
) -> mujoco.MjSpec:
    """A copy of ``spec`` with the edits applied; ``spec`` itself is not touched.

    Scales come first, so an added mass sits where its position says in the scaled body. Parts of a
    machine come last, so a transmission lies between a motor and the edited joint.

    Args:
        spec: The nominal model.
        edits: The changes.
        nominal: The same compiled, if it is at hand.
        timestep: Of the edited model [s]; None for the nominal one's.

    Raises:
        ModelError: If a body, joint or input is unknown, is edited twice or cannot have the edit.
    """
    edits, edited = tuple(edits), spec.copy()
    if timestep is not None:
        edited.option.timestep = timestep
    if not edits:
        return edited
    owners = {"joint": spec.joints, "body": spec.bodies[1:], "input": spec.actuators}
    count = Counter((type(edit), edit.of) for edit in edits if not edit.several)
    for edit in edits:
        names = [owner.name for owner in owners[edit.owner]]
        require_known(edit.owner, edit.of, names, f"{edit.kind}: ", ModelError)
        if count[type(edit), edit.of] > 1:
            raise ModelError(
                f"{edit.owner} {edit.of!r} has two of the kind {edit.kind!r}: give one"
            )
    nominal = compile_spec(spec) if nominal is None else nominal
    if any(edit.owner == "body" for edit in edits):
        _keep_inertias(edited, nominal)
    for edit in sorted(edits, key=lambda edit: edit.order):
        edit.write(edited, nominal)
    return edited


@checked(ModelError)
class BodyEdit(Edit):
    """Scale a body's mass by a and all its lengths by b, or give it another mass and inertia.

    The body stays similar to itself: its inertia about its centre of mass scales by a b^2, the
    offset of that centre, its sites, its child bodies' places and its drawn geometry by b.

    Attributes:
        body: Name of the body.
        mass_scale: a.
        length_scale: b.
        mass: In the place of a times the nominal mass [kg].
        inertia: Principal moments about its centre of mass [kg m^2], (3,); by default they scale.
    """

    body: Name
    mass_scale: Annotated[float, Range(0, above=True, usual=(0.01, 100))] = 1.0
    length_scale: Annotated[float, Range(0, above=True, usual=(0.01, 100))] = 1.0
    mass: Annotated[float, Range(0, unit="kg", above=True)] | None = None
    inertia: Vector | None = None

    owner, order = "body", 0

    def __post_init__(self) -> None:
        scaled = {"mass_scale": self.mass_scale != 1, "length_scale": self.length_scale != 1}
        for name, scales in {"mass": ["mass_scale"], "inertia": [*scaled]}.items():
            if clash := getattr(self, name) and [scale for scale in scales if scaled[scale]]:
                raise ModelError(
                    f"edit of {self.body!r}: {name} and {' and '.join(clash)}: give the number or "
                    "its scale"
                )
        if self.inertia is not None and min(self.inertia) <= 0:
            raise ModelError(f"edit of {self.body!r}: inertia {self.inertia} must be positive")

    def __str__(self) -> str:
        mass = f"x{self.mass_scale:.3g}" if self.mass is None else f"{self.mass:.3g} kg"
        moments = ", ".join(f"{moment:.3g}" for moment in self.inertia or ())
        length = f"inertia {moments} kg m^2" if moments else f"length x{self.length_scale:.3g}"
        return f"{self.body}: mass {mass}, {length}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write the inertia of the edited body, and scale its looks and places."""
        body, index = spec.body(self.body), nominal.body(self.body).id
        b, mass = self.length_scale, float(nominal.body_mass[index])
        a = self.mass / (mass or 1.0) if self.mass else self.mass_scale
        if mass:
            write_inertia(body, self.mass or a * mass, nominal, index)
            body.inertia = self.inertia or a * (b * b) * nominal.body_inertia[index]
            body.ipos = b * nominal.body_ipos[index]
        elif a != 1 or self.inertia:
            raise ModelError(f"body {self.body!r} has no mass to scale: edit the body that has")
        if b != 1:
            _scale_geometry(spec, body, b)

    def changes(self, template: Template) -> list[Change] | None:
        """As ``write``, of a body whose lengths are those of sites and other bodies only."""
        model, a, b = template.model, self.mass_scale, self.length_scale
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, self.body)
        if index < 1 or (b != 1 and self.body not in template.undrawn_bodies):
            return None
        if self.mass or self.inertia:
            return None
        before = np.array([model.body_mass[index], *model.body_inertia[index]])
        with np.errstate(all="ignore"):
            after = np.array([a, *[a * (b * b)] * 3]) * before
        large = (after >= _LEAST) | (before < _LEAST)
        if not (before[0] and np.all(np.isfinite(after) & large)):
            return None
        mass = [("body_mass", index, after[0]), ("body_inertia", index, after[1:])]
        sites, bodies = (
            np.flatnonzero(of == index) for of in (model.site_bodyid, model.body_parentid)
        )
        rows = (("body_ipos", index), ("body_pos", bodies), ("site_pos", sites)) if b != 1 else ()
        return mass + [(f, row, b * getattr(model, f)[row]) for f, row in rows if np.size(row)]


@checked(ModelError)
class AddedMass(Edit):
    """A point mass fixed to a body: a load that laws do not know of.

    Attributes:
        body: Name of the body.
        mass: [kg].
        position: In the body's own frame [m], (3,).
    """

    body: Name
    mass: Annotated[float, Range(0, unit="kg", above=True)]
    position: Vector = (0.0, 0.0, 0.0)

    kind, owner, order, several = "load", "body", 1, True

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg more"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Merge the mass into the body's inertia, beside those added before, and draw it."""
        model, body, place = compile_spec(spec), spec.body(self.body), np.array(self.position)
        index = model.body(self.body).id
        mass, centre = float(model.body_mass[index]), model.body_ipos[index]
        total = mass + self.mass
        new_centre = (mass * centre + self.mass * place) / total
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.body_iquat[index])
        axes = rotation.reshape(3, 3)
        about_new = (
            axes @ np.diag(model.body_inertia[index]) @ axes.T
            + mass * _steiner(centre - new_centre)
            + self.mass * _steiner(place - new_centre)
        )
        principal, vectors, turn = np.zeros(3), np.zeros(9), np.zeros(4)
        mujoco.mju_eig3(principal, vectors, turn, about_new.ravel())
        write_inertia(body, total, model, index)
        body.inertia, body.ipos, body.iquat = principal, new_centre, turn
        draw_ball(body, self.mass, pos=self.position)


@checked(ModelError)
class JointEdit(Edit):
    """Give a joint other numbers; those left out stay as the model has them.

    Attributes:
        joint: Name of the joint.
        damping: [N m s/rad] or [N s/m].
        friction: Dry friction, MuJoCo's ``frictionloss`` [N m] or [N].
        armature: Inertia of what drives it [kg m^2] or [kg].
        tilt: Angle by which its axis a turns towards the z-axis of its body, about a x z [rad]. An
            axis along z, of either direction, turns towards the x-axis.
    """

    joint: Name
    damping: NotNegative | None = None
    friction: NotNegative | None = None
    armature: NotNegative | None = None
    tilt: (
        Annotated[float, Range(-math.pi / 2, math.pi / 2, "rad", above=True, below=True)] | None
    ) = None

    owner, order = "joint", 2

    def __str__(self) -> str:
        numbers = {
            name: getattr(self, name) for name in ("damping", "friction", "armature", "tilt")
        }
        words = [f"{name} {value:.3g}" for name, value in numbers.items() if value is not None]
        return f"{self.joint}: {', '.join(words) or 'as it is'}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write the numbers."""
        joint = spec.joint(self.joint)
        if self.damping is not None:
            joint.damping = linear(self.damping, joint.damping)
        if self.friction is not None:
            joint.frictionloss = self.friction
        if self.armature is not None:
            joint.armature = self.armature
        if self.tilt is not None:
            joint.axis = _tilted(np.array(joint.axis) / np.linalg.norm(joint.axis), self.tilt)


@checked(ModelError)
class InputEdit(Edit):
    """Give an input of the model another gear.

    Attributes:
        input: Name of the actuator.
        gear: Torque or force at its joint for one unit of it, of either sign.
    """

    input: Name
    gear: Finite

    owner, order = "input", 3

    def __post_init__(self) -> None:
        if not self.gear:
            raise ModelError(f"edit of {self.input!r}: gear = 0 must not be zero")

    def __str__(self) -> str:
        return f"{self.input}: gear {self.gear:.4g}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Write the gear."""
        actuator = spec.actuator(self.input)
        actuator.gear = [self.gear, *actuator.gear[1:]]

    def changes(self, template: Template) -> list[Change] | None:
        """As ``write``."""
        index = mujoco.mj_name2id(template.model, mujoco.mjtObj.mjOBJ_ACTUATOR, self.input)
        return None if index < 0 else [("actuator_gear", (index, 0), self.gear)]


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
    """Scale what is drawn and what is attached, about the body's origin."""
    meshes = {geom.meshname for geom in body.geoms if geom.meshname}
    shared = {geom.meshname for geom in spec.geoms if geom.parent.name != body.name} & meshes
    for geom in body.geoms:
        if geom.type in _SIZELESS or geom.meshname in shared:
            raise ModelError(
                f"geom {geom.name or geom.meshname!r} of body {body.name!r}: length edits need "
                "primitive geoms, or meshes that no other body uses"
            )
        geom.size, geom.fromto = b * geom.size, b * geom.fromto
    for name in sorted(meshes):
        mesh = spec.mesh(name)
        mesh.scale = b * mesh.scale
    for part in (*body.geoms, *body.sites, *body.cameras, *body.lights, *body.bodies, *body.frames):
        part.pos = b * part.pos


def _steiner(offset: Array) -> Array:
    """The inertia of a unit point mass about a point this far from it: parallel-axis theorem."""
    return float(offset @ offset) * np.eye(3) - np.outer(offset, offset)


def _tilted(axis: Array, angle: float) -> Array:
    """A unit vector turned towards z, or x if it lies along z: Rodrigues' rotation formula."""
    along_z = np.linalg.norm(axis[:2]) < _PARALLEL
    towards = np.array([1.0, 0.0, 0.0]) if along_z else np.array([0.0, 0.0, 1.0])
    across = towards - (towards @ axis) * axis
    return math.cos(angle) * axis + math.sin(angle) * across / np.linalg.norm(across)


def write_inertia(body: mujoco.MjsBody, mass: float, like: mujoco.MjModel, index: int) -> None:
    """Give a body the inertia of a compiled one, explicit from now on, with another mass."""
    body.explicitinertial = True
    body.mass = mass
    body.inertia, body.ipos = like.body_inertia[index], like.body_ipos[index]
    body.iquat, body.fullinertia = like.body_iquat[index], np.full(6, np.nan)


def linear(coefficient: float, like: Any) -> Array:
    """A spring's or damper's polynomial in MuJoCo that has a linear coefficient only.

    Args:
        coefficient: Of a deflection or a speed.
        like: What stands there, for its size.
    """
    return coefficient * np.eye(np.size(like))[0]


def drawn(body: mujoco.MjsBody, kind: mujoco.mjtGeom, size: list[float], **place: Any) -> None:
    """Draw a geom that neither weighs nor touches."""
    body.add_geom(type=kind, size=size, rgba=COLOUR, contype=0, conaffinity=0, mass=0, **place)


def ball_radius(mass: float) -> float:
    """Radius of the ball that a point mass [kg] is drawn as [m]."""
    return float((3 * mass / (4 * math.pi * _DENSITY)) ** (1 / 3))


def draw_ball(body: mujoco.MjsBody, mass: float, **place: Any) -> None:
    """Draw a point mass [kg]."""
    drawn(body, mujoco.mjtGeom.mjGEOM_SPHERE, [ball_radius(mass), 0.0, 0.0], **place)
