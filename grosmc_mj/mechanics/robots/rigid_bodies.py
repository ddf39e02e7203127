"""Dynamics of a tree of hinges and slides in plain Python: M(q) and the torques beside it.

Recursive Newton-Euler equations and composite inertias (R. Featherstone, Rigid Body Dynamics
Algorithms, 2008, chapters 5 and 6). A law calls them with the numbers of its nominal robot, so it
needs no MuJoCo: neither in the engines nor as C.

A link is what one joint moves. Its origin lies on the joint. With the joint at rest its axes are
those of the link before it, turned by ``mounting``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.mechanics.robots.vectors import (
    add,
    cross,
    dot,
    plus,
    put,
    row,
    times,
    turned,
    turned_back,
)
from grosmc_mj.theory.control.matrices import solve


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """Numbers of n links, each moved by one joint.

    Attributes:
        before: Index of the link before each, n for the ground, (n,).
        slides: 1 for a slide, 0 for a hinge, (n,).
        rest: Position of the joint at rest [rad or m], (n,).
        vectors: Rows of each link, (n, 4, 3): unit vector of the joint in the link; origin in the
            link before [m]; mass times centre of mass [kg m]; the same of the mass whose weight is
            compensated (``gravcomp``).
        mounting: Rotation from the link to the link before, with the joint at rest, (n, 3, 3).
        inertia: Inertia about the origin [kg m^2], (n, 3, 3).
        mass: Mass [kg], (n,).
        weightless: Mass whose weight is compensated [kg], (n,).
        armature: Inertia of the motor, at the joint [kg m^2 or kg], (n,).
        damping: Viscous damping of the joint [N m s/rad or N s/m], (n,).
        stiffness: Stiffness of the joint's spring [N m/rad or N/m], (n,).
        spring: Position at which that spring is at rest [rad or m], (n,).
        gear: Torque or force at the joint for one unit of its input, of either sign, (n,).
        gravity: Acceleration of gravity in axes of the ground [m/s^2], (3,).
    """

    before: Array
    slides: Array
    rest: Array
    vectors: Array
    mounting: Array
    inertia: Array
    mass: Array
    weightless: Array
    armature: Array
    damping: Array
    stiffness: Array
    spring: Array
    gear: Array
    gravity: Array


# Rows of ``RigidBodies.vectors``.
AXIS = 0
OFFSET = 1
MOMENT = 2
WEIGHTLESS = 3
# Rows of an array (n + 1, ROWS, 3) that is computed in, of each link and last of the ground. All
# are in axes of the link; the first three are the rotation to the link before.
_ARM = 3
_TURNING = 4
_SPINNING = 5
_ACCELERATION = 6
_GRAVITY = 7
_FORCE = 8
_TORQUE = 9
_ROWS = 10
# Rows of an array (n + 1, rows, 3) for the link with all links behind it: the first three are the
# inertia about its origin.
_FIRST_MOMENT = 3
_MASS = 4
_COMPOSITE_ROWS = 5


@jitable
def inverse_dynamics(bodies: Any, x: Any, a: Any, u: Any) -> None:
    """Write u with gear u = M(q) a + h(q, q') - passive.

    Args:
        bodies: ``RigidBodies`` of n links.
        x: Joint positions, then their rates, (2 n,).
        a: Accelerations of the joints, (n,).
        u: Inputs, (n,); they may take the place of the accelerations.
    """
    n = len(bodies.rest)
    links = np.zeros((n + 1, _ROWS, 3))
    _place(bodies, x, links)
    _move(bodies, x, a, links)
    for k in range(n):
        i = n - 1 - k
        _load(bodies, i, links)
        of_joint = _along_joint(bodies, i, row(links, i, _FORCE), row(links, i, _TORQUE))
        torque = of_joint + bodies.armature[i] * a[i] - _passive(bodies, i, x)
        u[i] = torque / bodies.gear[i]
        _pass_to_link_before(bodies, i, links)


@jitable
def forward_dynamics(bodies: Any, x: Any, u: Any, a: Any) -> None:
    """Write a = M(q)^-1 (gear u - h(q, q') + passive), the inverse of ``inverse_dynamics``."""
    n = len(bodies.rest)
    for i in range(n):
        a[i] = 0.0
    inverse_dynamics(bodies, x, a, a)
    for i in range(n):
        a[i] = bodies.gear[i] * (u[i] - a[i])

    M = np.zeros(n * n)
    inertia_matrix(bodies, x, M)
    solve(M, a)


@jitable
def inertia_matrix(bodies: Any, x: Any, M: Any) -> None:
    """Write M(q), with the armatures, row by row, (n n,)."""
    n = len(bodies.rest)
    links = np.zeros((n + 1, _ROWS, 3))
    composite = np.zeros((n + 1, _COMPOSITE_ROWS, 3))
    _place(bodies, x, links)
    _compose(bodies, links, composite)
    for i in range(n):
        _load_by_own_joint(bodies, i, links, composite)
        M[i * n + i] = bodies.armature[i] + _of_last_row(bodies, i, links)
        link = i
        for k in range(n):
            j = n - 1 - k
            if j == bodies.before[link]:
                _carry_last_row(link, links)
                link = j
                entry = _of_last_row(bodies, j, links)
                M[i * n + j] = entry
                M[j * n + i] = entry


# -- motion, from the ground outwards --------------------------------------------------------------


@jitable
def _place(bodies: Any, x: Any, links: Any) -> None:
    """Write rotation and arm of each link, by Rodrigues' formula."""
    for i in range(len(bodies.rest)):
        shift = x[i] - bodies.rest[i]
        angle = 0.0
        if bodies.slides[i] == 0.0:
            angle = shift
            shift = 0.0

        axis = row(bodies.vectors, i, AXIS)
        along = times(shift, turned(bodies.mounting, i, axis))
        put(links, i, _ARM, plus(row(bodies.vectors, i, OFFSET), along))

        cosine = math.cos(angle)
        sine = math.sin(angle)
        for j in range(3):
            fixed = row(bodies.mounting, i, j)
            on_axis = times((1.0 - cosine) * dot(fixed, axis), axis)
            across = plus(on_axis, times(sine, cross(fixed, axis)))
            put(links, i, j, plus(times(cosine, fixed), across))


@jitable
def _move(bodies: Any, x: Any, a: Any, links: Any) -> None:
    """Write velocities and accelerations of the links."""
    n = len(bodies.rest)
    put(links, n, _GRAVITY, bodies.gravity)
    for i in range(n):
        before = int(bodies.before[i]) % (n + 1)
        turning = row(links, before, _TURNING)
        spinning = row(links, before, _SPINNING)
        arm = row(links, i, _ARM)
        # Of the origin: a + w' x r + w x (w x r), in axes of the link before.
        inwards = cross(turning, cross(turning, arm))
        accelerated = plus(row(links, before, _ACCELERATION), cross(spinning, arm))

        put(links, i, _ACCELERATION, turned_back(links, i, plus(accelerated, inwards)))
        put(links, i, _TURNING, turned_back(links, i, turning))
        put(links, i, _SPINNING, turned_back(links, i, spinning))
        put(links, i, _GRAVITY, turned_back(links, i, row(links, before, _GRAVITY)))
        _move_by_joint(bodies, i, x[n + i], a[i], links)


@jitable
def _move_by_joint(bodies: Any, i: int, rate: float, acceleration: float, links: Any) -> None:
    """Add the motion by a link's own joint to that of the link before."""
    axis = row(bodies.vectors, i, AXIS)
    across = times(rate, cross(row(links, i, _TURNING), axis))
    own = times(acceleration, axis)
    if bodies.slides[i] == 0.0:
        add(links, i, _SPINNING, plus(across, own))
        add(links, i, _TURNING, times(rate, axis))
    else:
        coriolis = times(2.0, across)
        add(links, i, _ACCELERATION, plus(coriolis, own))


# -- forces, from the ends inwards -----------------------------------------------------------------


@jitable
def _load(bodies: Any, i: int, links: Any) -> None:
    """Add force and torque that a link's own mass needs for its motion and against its weight."""
    moment = row(bodies.vectors, i, MOMENT)
    turning = row(links, i, _TURNING)
    spinning = row(links, i, _SPINNING)
    acceleration = row(links, i, _ACCELERATION)
    gravity = row(links, i, _GRAVITY)

    inwards = cross(turning, cross(turning, moment))
    add(links, i, _FORCE, times(bodies.mass[i], acceleration))
    add(links, i, _FORCE, plus(cross(spinning, moment), inwards))
    add(links, i, _FORCE, times(bodies.weightless[i] - bodies.mass[i], gravity))

    gyroscopic = cross(turning, turned(bodies.inertia, i, turning))
    hanging = plus(row(bodies.vectors, i, WEIGHTLESS), times(-1.0, moment))
    add(links, i, _TORQUE, plus(turned(bodies.inertia, i, spinning), gyroscopic))
    add(links, i, _TORQUE, plus(cross(moment, acceleration), cross(hanging, gravity)))


@jitable
def _along_joint(bodies: Any, i: int, force: Any, torque: Any) -> float:
    """Part of force and torque on a link that its joint's actuator bears."""
    axis = row(bodies.vectors, i, AXIS)
    if bodies.slides[i] == 0.0:
        return dot(axis, torque)
    return dot(axis, force)


@jitable
def _passive(bodies: Any, i: int, x: Any) -> float:
    """Torque of a joint's damper and spring."""
    n = len(bodies.rest)
    spring = bodies.stiffness[i] * (x[i] - bodies.spring[i])
    return -bodies.damping[i] * x[n + i] - spring


@jitable
def _pass_to_link_before(bodies: Any, i: int, links: Any) -> None:
    """Add force and torque of a link to those of the link before."""
    before = int(bodies.before[i]) % (len(bodies.rest) + 1)
    force = turned(links, i, row(links, i, _FORCE))
    torque = turned(links, i, row(links, i, _TORQUE))
    add(links, before, _FORCE, force)
    add(links, before, _TORQUE, plus(torque, cross(row(links, i, _ARM), force)))


# -- composite inertias ----------------------------------------------------------------------------


@jitable
def _compose(bodies: Any, links: Any, composite: Any) -> None:
    """Write inertia, first moment and mass of each link with all links behind it."""
    n = len(bodies.rest)
    for i in range(n):
        composite[i, _MASS, 0] = bodies.mass[i]
        put(composite, i, _FIRST_MOMENT, row(bodies.vectors, i, MOMENT))
        for j in range(3):
            put(composite, i, j, row(bodies.inertia, i, j))
    for k in range(n):
        _add_to_link_before(bodies, n - 1 - k, links, composite)


@jitable
def _add_to_link_before(bodies: Any, i: int, links: Any, composite: Any) -> None:
    """Add a composite inertia to that of the link before, about that link's origin."""
    before = int(bodies.before[i]) % (len(bodies.rest) + 1)
    arm = row(links, i, _ARM)
    mass = composite[i, _MASS, 0]
    moment = turned(links, i, row(composite, i, _FIRST_MOMENT))
    composite[before, _MASS, 0] += mass
    add(composite, before, _FIRST_MOMENT, plus(moment, times(mass, arm)))

    # R I R' + (m r r + 2 r h) 1 - m r r' - r h' - h r', row by row.
    all_round = mass * dot(arm, arm) + 2.0 * dot(arm, moment)
    to_end = plus(times(mass, arm), moment)
    for j in range(3):
        turned_row = turned(links, i, turned(composite, i, row(links, i, j)))
        products = plus(times(arm[j], to_end), times(moment[j], arm))
        add(composite, before, j, plus(turned_row, times(-1.0, products)))
        composite[before, j, j] += all_round


@jitable
def _load_by_own_joint(bodies: Any, i: int, links: Any, composite: Any) -> None:
    """Write into the last row force and torque for a unit acceleration of joint i alone."""
    n = len(bodies.rest)
    axis = row(bodies.vectors, i, AXIS)
    moment = row(composite, i, _FIRST_MOMENT)
    if bodies.slides[i] == 0.0:
        put(links, n, _FORCE, cross(axis, moment))
        put(links, n, _TORQUE, turned(composite, i, axis))
    else:
        put(links, n, _FORCE, times(composite[i, _MASS, 0], axis))
        put(links, n, _TORQUE, cross(moment, axis))


@jitable
def _carry_last_row(link: int, links: Any) -> None:
    """Turn force and torque of the last row from a link to the link before."""
    n = len(links) - 1
    force = turned(links, link, row(links, n, _FORCE))
    torque = turned(links, link, row(links, n, _TORQUE))
    put(links, n, _FORCE, force)
    put(links, n, _TORQUE, plus(torque, cross(row(links, link, _ARM), force)))


@jitable
def _of_last_row(bodies: Any, i: int, links: Any) -> float:
    """Part of the last row's force and torque that joint i's actuator bears."""
    n = len(bodies.rest)
    return _along_joint(bodies, i, row(links, n, _FORCE), row(links, n, _TORQUE))
