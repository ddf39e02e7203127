"""A planar two-link arm with two torques: the several inputs of section 3, which has no example."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import sympy as sp

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Range, checked
from grosmc_mj.theory.plants.equations import Equations
from grosmc_mj.theory.plants.parametrization import LinearParametrization
from grosmc_mj.theory.plants.system import (
    Model,
    Signal,
    System,
    Variant,
    require_unmodelled_absent,
    wrench_symbols,
)

_BODIES = ("upper", "lower", "payload")


@checked(ModelError, label="two_link_arm")
class TwoLinkParameters:
    """Numbers of the two-link arm.

    Attributes:
        m1: Mass of the upper link [kg].
        l1: Its length, from shoulder to elbow [m].
        c1: Distance of its centre of mass from the shoulder [m].
        I1: Its inertia about that centre [kg m^2].
        m2: Mass of the lower link [kg].
        l2: Its length, from elbow to tip [m].
        c2: Distance of its centre of mass from the elbow [m].
        I2: Its inertia about that centre [kg m^2].
        mp: Payload at the tip [kg].
        Ip: Its inertia about the tip [kg m^2].
        g: Gravity [m/s^2].
    """

    m1: Annotated[float, Range(0, unit="kg", above=True)]
    l1: Annotated[float, Range(0, unit="m", above=True)]
    c1: Annotated[float, Range(0, unit="m")]
    I1: Annotated[float, Range(0, unit="kg m^2")]
    m2: Annotated[float, Range(0, unit="kg", above=True)]
    l2: Annotated[float, Range(0, unit="m", above=True)]
    c2: Annotated[float, Range(0, unit="m")]
    I2: Annotated[float, Range(0, unit="kg m^2")]
    mp: Annotated[float, Range(0, unit="kg")]
    Ip: Annotated[float, Range(0, unit="kg m^2")]
    g: Annotated[float, Range(0, unit="m/s^2", above=True)]

    @classmethod
    def from_model(cls, model: Model, _variant: Variant) -> TwoLinkParameters:
        """Read the numbers back from a compiled model.

        Raises:
            ModelError: If a centre of mass or a link's end is off the link's x axis, or the model
                has what the equations have no term for.
        """
        for actuator in ("shoulder_torque", "elbow_torque"):
            require_unmodelled_absent("two_link_arm", model, ("shoulder", "elbow"), actuator)

        upper = model.body("upper")
        lower = model.body("lower")
        payload = model.body("payload")
        off_axis = [lower.pos[1:], payload.pos[1:], upper.ipos[1:], lower.ipos[1:], payload.ipos]
        if np.any(np.concatenate(off_axis)) or np.any(model.dof_armature):
            raise ModelError(
                "two_link_arm: links' ends and centres must lie on their x axes, the payload's "
                "centre at the tip, and the joints must have no armature"
            )
        return cls(
            m1=float(upper.mass[0]),
            l1=float(lower.pos[0]),
            c1=float(upper.ipos[0]),
            I1=float(upper.inertia[1]),
            m2=float(lower.mass[0]),
            l2=float(payload.pos[0]),
            c2=float(lower.ipos[0]),
            I2=float(lower.inertia[1]),
            mp=float(payload.mass[0]),
            Ip=float(payload.inertia[1]),
            g=float(-model.opt.gravity[2]),
        )


def _dynamics() -> tuple[Equations, LinearParametrization]:
    """M(q) q'' + c(q, q') + G(q) = tau + Q(w); q1 from horizontal, q2 from link 1.

    The joints are along -y; both links move in the x-z plane.
    """
    q1, q2, dq1, dq2 = sp.symbols("q1 q2 dq1 dq2")
    m1, l1, c1, I1, m2, l2, c2, I2, mp, Ip, g = sp.symbols("m1 l1 c1 I1 m2 l2 c2 I2 mp Ip g")
    s2 = sp.sin(q2)
    k2 = sp.cos(q2)
    k1 = sp.cos(q1)
    k12 = sp.cos(q1 + q2)

    # Inertias about the shoulder and the elbow, and first moments about them.
    J1 = I1 + m1 * c1**2 + (m2 + mp) * l1**2
    J2 = I2 + m2 * c2**2 + Ip + mp * l2**2
    b1 = m1 * c1 + (m2 + mp) * l1
    b2 = m2 * c2 + mp * l2

    # M^-1 = adjugate / determinant.
    h = l1 * b2
    bend = l1 * b2 * k2
    adjugate = sp.Matrix([[J2, -J2 - bend], [-J2 - bend, J1 + J2 + 2 * bend]])
    determinant = J1 * J2 - bend**2

    c = h * s2 * sp.Matrix([-dq2 * (2 * dq1 + dq2), dq1**2])
    G = g * sp.Matrix([b1 * k1 + b2 * k12, b2 * k12])
    free = adjugate * (-c - G) / determinant
    pushed = adjugate * _wrench_torques() / determinant
    equations = Equations(
        x=(q1, q2, dq1, dq2),
        f=(dq1, dq2, *free),
        g=((0, 0), (0, 0), *(adjugate / determinant).tolist()),
        h=(q1, q2),
        w=wrench_symbols(*_BODIES),
        d=(0, 0, *pushed),
    )

    # A load on each joint is nominally zero.
    return equations, _parametrization(theta=(J1, J2, h, g * b1, g * b2, 0, 0))


def _parametrization(theta: tuple[Any, ...]) -> LinearParametrization:
    """Torques as linear in J1, J2, l1 b2, g b1, g b2 and a load on each joint."""
    q1, q2, dq1, dq2, r1, r2, a1, a2 = sp.symbols("q1 q2 dq1 dq2 r1 r2 a1 a2")
    s2 = sp.sin(q2)
    k2 = sp.cos(q2)
    k1 = sp.cos(q1)
    k12 = sp.cos(q1 + q2)
    upper = (2 * a1 + a2) * k2 - s2 * (dq2 * r1 + (dq1 + dq2) * r2)
    lower = a1 * k2 + s2 * dq1 * r1
    return LinearParametrization(
        x=(q1, q2, dq1, dq2),
        r=(r1, r2),
        a=(a1, a2),
        Y=((a1, a1 + a2, upper, k1, k12, 1, 0), (0, a1 + a2, lower, 0, k12, 0, 1)),
        theta=theta,
    )


def _wrench_torques() -> sp.Matrix:
    """Q(w): torques of the bodies' wrenches about shoulder and elbow.

    A force acts at a body's centre of mass; x and z are its components, t is the torque about y.
    """
    q1, q2, l1, c1, l2, c2 = sp.symbols("q1 q2 l1 c1 l2 c2")
    s1 = sp.sin(q1)
    k1 = sp.cos(q1)
    s12 = sp.sin(q1 + q2)
    k12 = sp.cos(q1 + q2)
    x1, _, z1, _, t1, _ = wrench_symbols("upper")
    x2, _, z2, _, t2, _ = wrench_symbols("lower")
    x3, _, z3, _, t3, _ = wrench_symbols("payload")

    elbow = c2 * (k12 * z2 - s12 * x2) + l2 * (k12 * z3 - s12 * x3) - t2 - t3
    shoulder = c1 * (k1 * z1 - s1 * x1) + l1 * (k1 * (z2 + z3) - s1 * (x2 + x3)) - t1 + elbow
    return sp.Matrix([shoulder, elbow])


_EQUATIONS, _PARAMETRIZATION = _dynamics()


def tip() -> tuple[sp.Expr, sp.Expr]:
    """Position of the tip from the shoulder, (x, z) [m]: outputs for a path in the plane.

    The decoupling matrix of these outputs is J(q) M(q)^-1, which is singular where the arm is
    straight or folded: sin q2 = 0.
    """
    q1, q2, l1, l2 = sp.symbols("q1 q2 l1 l2")
    return (
        l1 * sp.cos(q1) + l2 * sp.cos(q1 + q2),
        l1 * sp.sin(q1) + l2 * sp.sin(q1 + q2),
    )


TWO_LINK_ARM = System(
    name="two_link_arm",
    title="Two-link arm",
    states=(
        Signal("shoulder angle", "q₁", "rad"),
        Signal("elbow angle", "q₂", "rad"),
        Signal("shoulder rate", "q̇₁", "rad/s"),
        Signal("elbow rate", "q̇₂", "rad/s"),
    ),
    inputs=(Signal("shoulder torque", "τ₁", "N m"), Signal("elbow torque", "τ₂", "N m")),
    equations=_EQUATIONS,
    controlled=(0, 1),
    joints=("shoulder", "elbow"),
    actuators=("shoulder_torque", "elbow_torque"),
    bodies=_BODIES,
    read_parameters=TwoLinkParameters.from_model,
    uncertain_body="payload",
    parametrization=_PARAMETRIZATION,
)
