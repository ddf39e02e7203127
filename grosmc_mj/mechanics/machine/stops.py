"""Ends of a joint's range, and walls that a body can touch."""

from __future__ import annotations

from typing import Annotated

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError
from grosmc_mj.ground.fields import Name, Point, Range, Vector, checked
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.machine.bounces import solref, spring_and_damper
from grosmc_mj.mechanics.machine.part import MachinePart, Oscillation, positive, signed
from grosmc_mj.mechanics.physics.dry_friction import STIFFEST
from grosmc_mj.mechanics.physics.edits import COLOUR
from grosmc_mj.theory.plants import System
from grosmc_mj.theory.plants.owner_units import ANGLE

# Speed after a bounce over that before it: some of it is lost.
_Restitution = Annotated[float, Range(0, 1, below=True)]


@checked(ModelError)
class Stop(MachinePart):
    """Two ends of a joint's range, which throw it back.

    Attributes:
        joint: Name of the joint.
        low: Lower end [rad or m].
        high: Upper end [rad or m].
        restitution: Speed after a bounce over that before it, from 0 to below 1.
        duration: Duration of a bounce [s]: the shorter, the harder.
    """

    joint: Name
    low: Annotated[float, signed(ANGLE)]
    high: Annotated[float, signed(ANGLE)]
    restitution: _Restitution = 0.0
    duration: Annotated[float, positive("s")] = 0.02

    kind = "stop"
    effect = "stops"
    owner = "joint"
    order = 10

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ModelError(
                f"stop of {self.joint!r}: low = {self.low:g} must be below high = {self.high:g}"
            )

    def __str__(self) -> str:
        return f"{self.joint}: stops at {self.low:.4g} and {self.high:.4g}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Limit the joint to its range."""
        joint = spec.joint(self.joint)
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.range = [self.low, self.high]
        joint.margin = 0.0
        joint.solref_limit = solref(self.restitution, self.duration)
        joint.solimp_limit = STIFFEST

    def oscillation(self, model: mujoco.MjModel) -> Oscillation:
        """Motion during a bounce."""
        return Oscillation(*spring_and_damper(self.restitution, self.duration), constrained=True)

    def require_start(self, system: System, x0: Array) -> None:
        """Refuse a start beyond it, as ``Edit`` says."""
        if self.joint not in system.joints:
            return

        index = system.joints.index(self.joint)
        start = x0[index]
        if not self.low <= start <= self.high:
            unit = unit_after(system.states[index].unit)
            raise ArgumentError(
                f"{system.name}: {self.joint} starts at {start:.6g}{unit}, beyond its stops "
                f"at {self.low:.6g} and {self.high:.6g}{unit}: move the start or the stops"
            )


@checked(ModelError)
class Wall(MachinePart):
    """A plane that a ball on a body can touch, without friction: a table, the end of a room.

    Attributes:
        body: Name of the body.
        radius: Radius of the ball [m].
        at: Centre of the ball, in the body's own frame [m], (3,).
        point: A point of the plane, in the world [m], (3,).
        normal: Direction that the plane faces, (3,), of any length.
        restitution: Speed after a bounce over that before it, from 0 to below 1.
        duration: Duration of a bounce [s].
    """

    body: Name
    radius: Annotated[float, positive("m")]
    at: Point = (0.0, 0.0, 0.0)
    point: Point = (0.0, 0.0, 0.0)
    normal: Vector = (0.0, 0.0, 1.0)
    restitution: _Restitution = 0.0
    duration: Annotated[float, positive("s")] = 0.02

    kind = "wall"
    effect = "stops"
    owner = "body"
    order = 13
    several = True

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ModelError(f"wall of {self.body!r}: normal = [0, 0, 0] must point somewhere")

    def __str__(self) -> str:
        x, y, z = self.point
        return f"{self.body}: a wall at ({x:.3g}, {y:.3g}, {z:.3g})"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Add a plane and a ball that touch each other and nothing else."""
        _enable_contacts(spec)
        number = sum(geom.name.startswith("wall ") for geom in spec.geoms) + 1
        orientation = np.zeros(4)
        mujoco.mju_quatZ2Vec(orientation, np.array(self.normal) / np.linalg.norm(self.normal))
        plane = spec.worldbody.add_geom(
            name=f"wall {number}",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0.3, 0.3, 0.1],
            pos=self.point,
            quat=orientation,
            rgba=(0.23, 0.27, 0.32, 0.5),
            contype=0,
            conaffinity=0,
        )
        ball = spec.body(self.body).add_geom(
            name=f"bumper {number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[self.radius, 0, 0],
            pos=self.at,
            rgba=COLOUR,
            contype=0,
            conaffinity=0,
            mass=0,
        )

        pair = spec.add_pair(geomname1=plane.name, geomname2=ball.name, condim=1)
        pair.solref = solref(self.restitution, self.duration)
        pair.solimp = STIFFEST

    def oscillation(self, model: mujoco.MjModel) -> Oscillation:
        """Motion during a bounce."""
        return Oscillation(*spring_and_damper(self.restitution, self.duration), constrained=True)


def _enable_contacts(spec: mujoco.MjSpec) -> None:
    """Enable contacts in a model without them, in which no geom touches another one."""
    disabled = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if not spec.option.disableflags & disabled:
        return

    spec.option.disableflags &= ~disabled
    for geom in spec.geoms:
        geom.contype = 0
        geom.conaffinity = 0
