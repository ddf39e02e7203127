"""The equations of the two-link arm by hand: M(q) q'' + c(q, q') + G(q) = tau + Q."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from grosmc_mj.arrays import Array

BODIES = ("upper", "lower", "payload")


@dataclass(frozen=True)
class TwoLinkParameters:
    """Masses [kg], lengths [m], distances of the centres [m], inertias [kg m^2], gravity."""

    m1: float
    l1: float
    c1: float
    I1: float
    m2: float
    l2: float
    c2: float
    I2: float
    mp: float
    Ip: float
    g: float

    @classmethod
    def from_model(cls, model: mujoco.MjModel) -> TwoLinkParameters:
        """Read from a compiled model, edited or not."""
        upper, lower, payload = (model.body(name) for name in BODIES)
        for child in (lower, payload):
            assert not np.any(child.pos[1:]), "a link's end is on its x axis"
        for body in (upper, lower):
            assert not np.any(body.ipos[1:]), "a link's centre is on its x axis"
        assert not np.any(payload.ipos), "the payload's centre is at the tip"
        assert not np.any(model.dof_armature), "no inertia but the bodies'"
        assert not np.any(model.dof_damping), "no damping"
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


def inertia(q: Array, p: TwoLinkParameters) -> Array:
    """M(q), (2, 2)."""
    J1 = p.I1 + p.m1 * p.c1**2 + (p.m2 + p.mp) * p.l1**2
    J2 = p.I2 + p.m2 * p.c2**2 + p.Ip + p.mp * p.l2**2
    hc = p.l1 * (p.m2 * p.c2 + p.mp * p.l2) * math.cos(q[1])
    return np.array([[J1 + J2 + 2 * hc, J2 + hc], [J2 + hc, J2]])


def coriolis(q: Array, dq: Array, p: TwoLinkParameters) -> Array:
    """c(q, q'), the Coriolis and centrifugal torques, (2,)."""
    hs = p.l1 * (p.m2 * p.c2 + p.mp * p.l2) * math.sin(q[1])
    return np.array([-hs * dq[1] * (2 * dq[0] + dq[1]), hs * dq[0] ** 2])


def gravity(q: Array, p: TwoLinkParameters) -> Array:
    """G(q), (2,)."""
    elbow = p.g * (p.m2 * p.c2 + p.mp * p.l2) * math.cos(q[0] + q[1])
    upper = p.g * (p.m1 * p.c1 + (p.m2 + p.mp) * p.l1) * math.cos(q[0])
    return np.array([upper + elbow, elbow])


def generalized_force(q: Array, w: Array, p: TwoLinkParameters) -> Array:
    """Q of the wrenches [force, torque] of upper, lower and payload in world axes, (2,).

    Args:
        q: Joint angles, (2,).
        w: Wrenches at the centres of mass, (18,) or (3, 6).
        p: Numbers of the arm.
    """
    (fx1, _, fz1, _, ty1, _), (fx2, _, fz2, _, ty2, _), (fx3, _, fz3, _, ty3, _) = np.reshape(
        w, (3, 6)
    )
    s1, k1 = math.sin(q[0]), math.cos(q[0])
    s12, k12 = math.sin(q[0] + q[1]), math.cos(q[0] + q[1])
    elbow = p.c2 * (k12 * fz2 - s12 * fx2) + p.l2 * (k12 * fz3 - s12 * fx3) - ty2 - ty3
    beyond = p.l1 * (k1 * (fz2 + fz3) - s1 * (fx2 + fx3))
    return np.array([p.c1 * (k1 * fz1 - s1 * fx1) - ty1 + beyond + elbow, elbow])


def acceleration(q: Array, dq: Array, tau: Array, w: Array, p: TwoLinkParameters) -> Array:
    """q'' = M^-1 (tau + Q - c - G), (2,)."""
    force = tau + generalized_force(q, w, p) - coriolis(q, dq, p) - gravity(q, p)
    return np.linalg.solve(inertia(q, p), force)


def energy(q: Array, dq: Array, p: TwoLinkParameters) -> float:
    """Kinetic and potential energy, the latter zero at the shoulder's height."""
    height = (p.m1 * p.c1 + (p.m2 + p.mp) * p.l1) * math.sin(q[0])
    height += (p.m2 * p.c2 + p.mp * p.l2) * math.sin(q[0] + q[1])
    return float(dq @ inertia(q, p) @ dq / 2 + p.g * height)


def tip(q: Array, p: TwoLinkParameters) -> Array:
    """(x, z) of the tip from the shoulder, (2,)."""
    a, b = q[0], q[0] + q[1]
    return np.array(
        [p.l1 * math.cos(a) + p.l2 * math.cos(b), p.l1 * math.sin(a) + p.l2 * math.sin(b)]
    )


def elbow_up(point: Array, p: TwoLinkParameters) -> Array:
    """The joint angles with q2 < 0 that put the tip at (x, z), (2,)."""
    q2 = -math.acos((point @ point - p.l1**2 - p.l2**2) / (2 * p.l1 * p.l2))
    inward = math.atan2(p.l2 * math.sin(q2), p.l1 + p.l2 * math.cos(q2))
    return np.array([math.atan2(point[1], point[0]) - inward, q2])
