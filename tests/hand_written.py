"""The plants by hand: x' = f(x) + g(x) u + d(x, w), an oracle for equations, laws and MuJoCo.

``maths`` is the source of sin and cos, so that mpmath can carry f and g to any number of digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array

Column = tuple[Any, ...]


class HandWritten(NamedTuple):
    """One plant, and where it can be used.

    ``size`` is what the terms of the accelerations in f(x) add up to in magnitude.
    """

    drift: Callable[..., Column]
    size: Callable[[Any, Any], float]
    input_matrix: Callable[..., Column]
    disturbance: Callable[..., Column]
    singular: Callable[[Any], bool] = lambda x: False
    linearizable: Callable[[Any], bool] = lambda x: True


# Servo, eqs. (15)-(16): x = [theta, theta'], the input is the current; the load T_d is minus the
# wrench's torque about the shaft (-y).
SERVO = HandWritten(
    drift=lambda x, p, maths=math: (x[1], -p.B * x[1] / p.J),
    size=lambda x, p: abs(p.B * x[1] / p.J),
    input_matrix=lambda x, p, maths=math: (0.0, p.Kt / p.J),
    disturbance=lambda x, w, p: (0.0, -w[4] / p.J),
)


# Pendulum, eq. (40): x = [p, theta, p', theta'], the input is the force on the cart along +x.


def pendulum_coefficient(p: Any) -> float:
    """The a of eq. (40): m/(M+m) as printed, which makes a*m a mass; 1/(M+m) by Lagrange."""
    return (p.m if p.printed != 0.0 else 1.0) / (p.M + p.m)


def pendulum_drift(x: Any, p: Any, maths: Any = math) -> Column:
    """Eq. (40) without u and d, and the cart by the horizontal balance of forces."""
    s = maths.sin(x[1])
    c = maths.cos(x[1])
    w2 = x[3] * x[3]
    a = pendulum_coefficient(p)
    alpha = (p.g * s - a * p.m * p.L * w2 * s * c) / (p.L * (4 / 3 - a * p.m * c * c))
    return (x[2], x[3], p.m * p.L * (alpha * c - w2 * s) / (p.M + p.m), alpha)


def pendulum_size(x: Any, p: Any) -> float:
    s = math.sin(x[1])
    c = math.cos(x[1])
    w2 = x[3] * x[3]
    a = pendulum_coefficient(p)
    terms = abs(p.g * s) + abs(a * p.m * p.L * w2 * s * c)
    alpha = terms / (p.L * (4 / 3 - a * p.m * c * c))
    return max(alpha, p.m * p.L * (alpha * abs(c) + abs(w2 * s)) / (p.M + p.m))


def pendulum_input_matrix(x: Any, p: Any, maths: Any = math) -> Column:
    c = maths.cos(x[1])
    a = pendulum_coefficient(p)
    beta = a * c / (p.L * (4 / 3 - a * p.m * c * c))
    return (0.0, 0.0, (1 + p.m * p.L * beta * c) / (p.M + p.m), beta)


def pendulum_disturbance(x: Any, w: Any, p: Any) -> Column:
    """Wrenches on cart and pole, whose centre is at (-L sin, L cos) from its hinge along -y.

    They meet the true inertia in both variants.
    """
    s = math.sin(x[1])
    c = math.cos(x[1])
    total = p.M + p.m
    Q_p = w[0] + w[6]
    Q_theta = -p.L * (c * w[6] + s * w[8]) - w[10]
    inertia = p.m * p.L * p.L * (4 / 3 - p.m * c * c / total)
    alpha = (Q_theta + p.m * p.L * c * Q_p / total) / inertia
    return (0.0, 0.0, (Q_p + p.m * p.L * c * alpha) / total, alpha)


# Arm, eq. (57): x = [q, q'], q = 0 horizontal, the input is the joint torque.


def arm_inertia(q: Any, p: Any, maths: Any = math) -> Any:
    return p.J + p.m * p.l * p.l + p.M_c * (1 + maths.sin(q))


def arm_coriolis(q: Any, dq: Any, p: Any, maths: Any = math) -> Any:
    """C(q, q'): M'(q)/2 as printed; energy needs M'(q) q'/2."""
    return 0.5 * p.M_c * maths.cos(q) * (1.0 if p.printed != 0.0 else dq)


def arm_drift(x: Any, p: Any, maths: Any = math) -> Column:
    gravity = p.m * p.g * p.l * maths.cos(x[0])
    coriolis = arm_coriolis(x[0], x[1], p, maths)
    return (x[1], -(coriolis * x[1] + gravity) / arm_inertia(x[0], p, maths))


def arm_size(x: Any, p: Any) -> float:
    gravity = p.m * p.g * p.l * math.cos(x[0])
    coriolis = arm_coriolis(x[0], x[1], p)
    return (abs(coriolis * x[1]) + abs(gravity)) / arm_inertia(x[0], p)


def arm_disturbance(x: Any, w: Any, p: Any) -> Column:
    """Wrenches on hub and link: the payload is at (l cos q, l sin q) from the joint along -y."""
    Q = p.l * (math.cos(x[0]) * w[8] - math.sin(x[0]) * w[6]) - w[4] - w[10]
    return (0.0, Q / arm_inertia(x[0], p))


def arm_is_singular(x: Any) -> bool:
    """Whether the eyelet has reached the drum: the cable has length zero at q = pi/2."""
    return x[0] >= math.pi / 2 or x[0] <= -1.5 * math.pi


# Two-link arm, M(q) q'' + c(q, q') + G(q) = tau + Q(w): angles from the right and from link 1.


def two_link_inertia(q: Any, p: Any) -> Array:
    J1 = p.I1 + p.m1 * p.c1**2 + (p.m2 + p.mp) * p.l1**2
    J2 = p.I2 + p.m2 * p.c2**2 + p.Ip + p.mp * p.l2**2
    hc = p.l1 * (p.m2 * p.c2 + p.mp * p.l2) * math.cos(q[1])
    return np.array([[J1 + J2 + 2 * hc, J2 + hc], [J2 + hc, J2]])


def two_link_forces(x: Any, p: Any) -> tuple[Array, Array]:
    """Minus Coriolis and centrifugal torques c, and minus gravity's G."""
    q1, q2, dq1, dq2 = x
    hs = p.l1 * (p.m2 * p.c2 + p.mp * p.l2) * math.sin(q2)
    elbow = p.g * (p.m2 * p.c2 + p.mp * p.l2) * math.cos(q1 + q2)
    upper = p.g * (p.m1 * p.c1 + (p.m2 + p.mp) * p.l1) * math.cos(q1)
    coriolis = np.array([-hs * dq2 * (2 * dq1 + dq2), hs * dq1**2])
    return -coriolis, -np.array([upper + elbow, elbow])


def two_link_size(x: Any, p: Any) -> float:
    inverse = np.abs(np.linalg.inv(two_link_inertia(x, p)))
    return float(max(inverse @ sum(np.abs(each) for each in two_link_forces(x, p))))


def two_link_drift(x: Any, p: Any) -> Column:
    return (x[2], x[3], *np.linalg.solve(two_link_inertia(x, p), sum(two_link_forces(x, p))))


def two_link_input_matrix(x: Any, p: Any) -> Column:
    return (0.0,) * 4 + tuple(np.linalg.inv(two_link_inertia(x, p)).ravel())


def two_link_disturbance(x: Any, w: Any, p: Any) -> Column:
    """Wrenches on upper, lower and payload; the joints are along -y."""
    fx1, _, fz1, _, ty1, _ = w[:6]
    fx2, _, fz2, _, ty2, _ = w[6:12]
    fx3, _, fz3, _, ty3, _ = w[12:]
    s1 = math.sin(x[0])
    k1 = math.cos(x[0])
    s12 = math.sin(x[0] + x[1])
    k12 = math.cos(x[0] + x[1])
    elbow = p.c2 * (k12 * fz2 - s12 * fx2) + p.l2 * (k12 * fz3 - s12 * fx3) - ty2 - ty3
    beyond = p.l1 * (k1 * (fz2 + fz3) - s1 * (fx2 + fx3))
    Q = np.array([p.c1 * (k1 * fz1 - s1 * fx1) - ty1 + beyond + elbow, elbow])
    return (0.0, 0.0, *np.linalg.solve(two_link_inertia(x, p), Q))


def tip(q: Any, p: Any) -> Array:
    """(x, z) of the two-link arm's tip from the shoulder, (2,)."""
    a = q[0]
    b = q[0] + q[1]
    return np.array(
        [p.l1 * math.cos(a) + p.l2 * math.cos(b), p.l1 * math.sin(a) + p.l2 * math.sin(b)]
    )


def elbow_up(point: Array, p: Any) -> Array:
    """The joint angles with q2 < 0 that put the tip at (x, z), (2,)."""
    q2 = -math.acos((point @ point - p.l1**2 - p.l2**2) / (2 * p.l1 * p.l2))
    inward = math.atan2(p.l2 * math.sin(q2), p.l1 + p.l2 * math.cos(q2))
    return np.array([math.atan2(point[1], point[0]) - inward, q2])


# The chapter's plants, and all.
HAND_WRITTEN = {
    "servo": SERVO,
    "cart_pendulum": HandWritten(
        pendulum_drift,
        pendulum_size,
        pendulum_input_matrix,
        pendulum_disturbance,
        linearizable=lambda x: -math.pi / 2 < x[1] < math.pi / 2,
    ),
    "arm": HandWritten(
        arm_drift,
        arm_size,
        lambda x, p, maths=math: (0.0, 1 / arm_inertia(x[0], p, maths)),
        arm_disturbance,
        arm_is_singular,
        lambda x: not arm_is_singular(x),
    ),
}
BY_HAND = {
    **HAND_WRITTEN,
    "two_link_arm": HandWritten(
        two_link_drift, two_link_size, two_link_input_matrix, two_link_disturbance
    ),
}
