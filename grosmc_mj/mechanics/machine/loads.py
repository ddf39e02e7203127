"""Loads that move on a body: one that swings, one that slides."""

from __future__ import annotations

from typing import Annotated

import mujoco

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Name, Vector, checked
from grosmc_mj.mechanics.machine.part import TOKEN, MachinePart, Oscillation, not_negative, positive
from grosmc_mj.mechanics.physics.edits import ball_radius, draw_ball, draw_geom, linear_polynomial


@checked(ModelError)
class SwingingLoad(MachinePart):
    """A point mass that hangs on a body by a massless rod and begins at rest below it.

    Attributes:
        body: Name of the body.
        mass: [kg].
        length: Length of the rod [m].
        damping: Damping of its hinge, whose axis is the y-axis of the body [N m s/rad].
        at: Place of the hinge, in the body's own frame [m], (3,).
    """

    body: Name
    mass: Annotated[float, positive("kg")]
    length: Annotated[float, positive("m")]
    damping: Annotated[float, not_negative("N m s/rad")] = 0.0
    at: Vector = (0.0, 0.0, 0.0)

    kind = "swinging load"
    owner = "body"
    order = 11
    several = True

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg swing on {self.length:.3g} m"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Add a body on a hinge."""
        load = _body(spec, self, "swing")
        load.ipos = [0.0, 0.0, -self.length]
        hinge = load.add_joint(
            name=load.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0]
        )
        hinge.damping = linear_polynomial(self.damping, hinge.damping)

        draw_ball(load, self.mass, pos=load.ipos)
        rod_size = [ball_radius(self.mass) / 4, 0.0, 0.0]
        draw_geom(load, mujoco.mjtGeom.mjGEOM_CAPSULE, rod_size, fromto=[0, 0, 0, *load.ipos])


@checked(ModelError)
class SlidingLoad(MachinePart):
    """A point mass that slides on a body along its x-axis, held by a spring.

    Attributes:
        body: Name of the body.
        mass: [kg].
        stiffness: [N/m].
        damping: [N s/m].
        at: Place at rest, in the body's own frame [m], (3,).
    """

    body: Name
    mass: Annotated[float, positive("kg")]
    stiffness: Annotated[float, positive("N/m")]
    damping: Annotated[float, not_negative("N s/m")] = 0.0
    at: Vector = (0.0, 0.0, 0.0)

    kind = "sliding load"
    owner = "body"
    order = 12
    several = True

    def __str__(self) -> str:
        return f"{self.body}: {self.mass:.3g} kg slide on {self.stiffness:.3g} N/m"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Add a body on a slide."""
        load = _body(spec, self, "slide")
        slide = load.add_joint(
            name=load.name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0]
        )
        slide.stiffness = linear_polynomial(self.stiffness, slide.stiffness)
        slide.damping = linear_polynomial(self.damping, slide.damping)
        draw_ball(load, self.mass)

    def oscillation(self, model: mujoco.MjModel) -> Oscillation:
        """Motion of the mass on its spring."""
        return Oscillation(self.stiffness / self.mass, self.damping / self.mass)


def _body(spec: mujoco.MjSpec, load: SwingingLoad | SlidingLoad, word: str) -> mujoco.MjsBody:
    """Add a body for a load, of a name that is free."""
    names = {body.name for body in spec.bodies}
    name = f"{load.body} {word}"
    number = 2
    while name in names:
        name = f"{load.body} {word}{number}"
        number += 1

    return spec.body(load.body).add_body(
        name=name,
        pos=load.at,
        explicitinertial=True,
        mass=load.mass,
        inertia=[TOKEN] * 3,
    )
