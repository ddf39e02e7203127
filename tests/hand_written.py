"""The three plants of the chapter by hand, as an oracle for what sympy makes of their equations.

Every function takes the source of sin and cos, so that mpmath can carry it to any number of digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

Column = tuple[Any, ...]


class HandWritten(NamedTuple):
    """One plant: x' = f(x) + g(x) u + d(x, w), and where it can be used.

    ``size`` is what the terms of the accelerations in f(x) add up to in magnitude.
    """

    drift: Callable[..., Column]
    size: Callable[[Any, Any], float]
    input_matrix: Callable[..., Column]
    disturbance: Callable[..., Column]
    singular: Callable[[Any], bool]
    linearizable: Callable[[Any], bool]


# Servo, eqs. (15)-(16): x = [theta, theta'], the input is the current i.


def servo_drift(x: Any, p: Any, maths: Any = math) -> Column:
    """f(x) of eq. (15) solved for the acceleration."""
    return (x[1], -p.B * x[1] / p.J)


def servo_size(x: Any, p: Any) -> float:
    return abs(p.B * x[1] / p.J)


def servo_input_matrix(x: Any, p: Any, maths: Any = math) -> Column:
    """g(x): eq. (16) in eq. (15)."""
    return (0.0, p.Kt / p.J)


def servo_disturbance(x: Any, w: Any, p: Any, maths: Any = math) -> Column:
    """-T_d/J of eq. (15): the load T_d is minus the wrench's torque about the shaft (-y)."""
    return (0.0, -w[4] / p.J)


# Pendulum, eq. (40): x = [p, theta, p', theta'], the input is the force on the cart along +x.


def pendulum_coefficient(p: Any) -> float:
    """The a of eq. (40): m/(M+m) as printed, which makes a*m a mass; 1/(M+m) by Lagrange."""
    return (p.m if p.printed != 0.0 else 1.0) / (p.M + p.m)


def pendulum_drift(x: Any, p: Any, maths: Any = math) -> Column:
    """f(x): eq. (40) without u and d, and the cart by the horizontal balance of forces."""
    s, c = maths.sin(x[1]), maths.cos(x[1])
    w2 = x[3] * x[3]
    a = pendulum_coefficient(p)
    alpha = (p.g * s - a * p.m * p.L * w2 * s * c) / (p.L * (4 / 3 - a * p.m * c * c))
    return (x[2], x[3], p.m * p.L * (alpha * c - w2 * s) / (p.M + p.m), alpha)


def pendulum_size(x: Any, p: Any) -> float:
    s, c, w2 = math.sin(x[1]), math.cos(x[1]), x[3] * x[3]
    a = pendulum_coefficient(p)
    terms = abs(p.g * s) + abs(a * p.m * p.L * w2 * s * c)
    alpha = terms / (p.L * (4 / 3 - a * p.m * c * c))
    return max(alpha, p.m * p.L * (alpha * abs(c) + abs(w2 * s)) / (p.M + p.m))


def pendulum_input_matrix(x: Any, p: Any, maths: Any = math) -> Column:
    """g(x) of eq. (40) and of the cart."""
    c = maths.cos(x[1])
    a = pendulum_coefficient(p)
    beta = a * c / (p.L * (4 / 3 - a * p.m * c * c))
    return (0.0, 0.0, (1 + p.m * p.L * beta * c) / (p.M + p.m), beta)


def pendulum_disturbance(x: Any, w: Any, p: Any, maths: Any = math) -> Column:
    """Accelerations under wrenches on cart (w[0:6]) and pole (w[6:12]).

    The hinge is along -y: the pole's centre is at (-L sin(theta), L cos(theta)) from it in the
    x-z plane. The wrench meets the true inertia in both variants.
    """
    s, c = maths.sin(x[1]), maths.cos(x[1])
    Q_p = w[0] + w[6]
    Q_theta = -p.L * (c * w[6] + s * w[8]) - w[10]
    total = p.M + p.m
    inertia = p.m * p.L * p.L * (4 / 3 - p.m * c * c / total)
    alpha = (Q_theta + p.m * p.L * c * Q_p / total) / inertia
    return (0.0, 0.0, (Q_p + p.m * p.L * c * alpha) / total, alpha)


# Arm, eq. (57): x = [q, q'], q = 0 horizontal, the input is the joint torque tau.


def arm_inertia(q: Any, p: Any, maths: Any = math) -> Any:
    """M(q) of eq. (57)."""
    return p.J + p.m * p.l * p.l + p.M_c * (1 + maths.sin(q))


def arm_coriolis(q: Any, dq: Any, p: Any, maths: Any = math) -> Any:
    """C(q, q') of eq. (57): M'(q)/2 as printed; energy needs M'(q) q'/2."""
    half_slope = 0.5 * p.M_c * maths.cos(q)
    return half_slope if p.printed != 0.0 else half_slope * dq


def arm_drift(x: Any, p: Any, maths: Any = math) -> Column:
    """f(x) of eq. (57): -(C q' + G)/M."""
    gravity = p.m * p.g * p.l * maths.cos(x[0])
    coriolis = arm_coriolis(x[0], x[1], p, maths)
    return (x[1], -(coriolis * x[1] + gravity) / arm_inertia(x[0], p, maths))


def arm_size(x: Any, p: Any) -> float:
    gravity, coriolis = p.m * p.g * p.l * math.cos(x[0]), arm_coriolis(x[0], x[1], p)
    return (abs(coriolis * x[1]) + abs(gravity)) / arm_inertia(x[0], p)


def arm_input_matrix(x: Any, p: Any, maths: Any = math) -> Column:
    """g(x) of eq. (57)."""
    return (0.0, 1 / arm_inertia(x[0], p, maths))


def arm_disturbance(x: Any, w: Any, p: Any, maths: Any = math) -> Column:
    """Accelerations under wrenches on hub (w[0:6]) and link (w[6:12]).

    The joint is along -y, and the payload at (l cos q, l sin q) from it in the x-z plane; the
    hub's centre of mass is on the axis. The chapter's d(t) is minus a torque about the joint.
    """
    s, c = maths.sin(x[0]), maths.cos(x[0])
    Q = p.l * (c * w[8] - s * w[6]) - w[4] - w[10]
    return (0.0, Q / arm_inertia(x[0], p, maths))


def never(x: Any) -> bool:
    return False


def always(x: Any) -> bool:
    return True


def pendulum_stands(x: Any) -> bool:
    """Whether the cart's force still turns the pole as it does upright: |theta| < pi/2."""
    return -math.pi / 2 < x[1] < math.pi / 2


def arm_is_singular(x: Any) -> bool:
    """Whether the eyelet has reached the drum: the cable has length zero at q = pi/2."""
    return x[0] >= math.pi / 2 or x[0] <= -1.5 * math.pi


def arm_is_regular(x: Any) -> bool:
    """Wherever the plant is, since 1/M(q) > 0."""
    return not arm_is_singular(x)


HAND_WRITTEN = {
    "servo": HandWritten(
        servo_drift, servo_size, servo_input_matrix, servo_disturbance, never, always
    ),
    "cart_pendulum": HandWritten(
        pendulum_drift,
        pendulum_size,
        pendulum_input_matrix,
        pendulum_disturbance,
        never,
        pendulum_stands,
    ),
    "arm": HandWritten(
        arm_drift, arm_size, arm_input_matrix, arm_disturbance, arm_is_singular, arm_is_regular
    ),
}
