"""A robot's torques as linear in the inertia of one of its bodies, by MuJoCo's recursion.

MuJoCo's recursive Newton-Euler algorithm is linear in ``mjData.cinert``, ten numbers a body: its
inertia about the tree's centre of mass, its first moment and its mass. So a column of the
regressor is that recursion over a robot whose other bodies weigh nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np

from grosmc_mj.compilation import array_at, pointer
from grosmc_mj.control.coordinates.torques import LinearTorques
from grosmc_mj.jitable import jitable
from grosmc_mj.robots.dynamics import (
    WORKSPACE,
    inertia,
    load_mujoco,
    mj_com_pos,
    mj_com_vel,
    mj_kinematics,
    mj_passive,
    mj_rne,
)

# Mass, first moment and inertia of a body.
INERTIAL = 10
# Rows and columns of a symmetric tensor's entries, in MuJoCo's order.
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Torques of a velocity v enter by their symmetric bilinear form c(v, r), with c(v, v) what the
# recursion gives: c(v, r) = (c(v + r, v + r) - c(v - r, v - r)) / 4. Gravity cancels there, and is
# in the recursion at rest, with the accelerations. Each has its share of r, of v, and its weight.
_AT_REST, _FASTER, _SLOWER = (0.0, 0.0, 1.0), (1.0, 1.0, 0.25), (-1.0, 1.0, -0.25)
_PASSES = (_AT_REST, _FASTER, _SLOWER)

Torque = Callable[[float, Any, Any, Any], Any]


@cache
def torques_of_body(model: mujoco.MjModel, body: int) -> LinearTorques:
    """The torques of a robot by what is unknown of one body and by a constant load on each joint.

    theta has what the body has more than in the nominal model: its mass [kg], first moment
    [kg m] and inertia xx, yy, zz, xy, xz, yz [kg m^2], all in the body's frame and about its
    origin, then the loads [N m or N]. All of it is nominally zero.

    Args:
        model: Of the dynamics, see ``nominal_model``.
        body: Index of a body that moves.
    """
    n = int(model.nv)
    reference = reference_torques(n)
    rows = body_regressor(n, body, int(model.body_rootid[body]), int(model.nbody))
    count = INERTIAL + n
    none = (0.0,) * count

    def known(x: Any, r: Any, a: Any, memory: Any, p: Any) -> Any:
        if memory.workspace == 0.0:
            memory.undefined = 1.0
            return np.zeros(n)
        return reference(memory.workspace, x, r, a)

    def regressor(x: Any, r: Any, a: Any, memory: Any, p: Any) -> Any:
        if memory.workspace == 0.0:
            memory.undefined = 1.0
            return np.zeros(n * count)
        return rows(memory.workspace, x, r, a)

    return LinearTorques(
        size=count,
        nominal=jitable(lambda p: none),
        known=jitable(known),
        regressor=jitable(regressor),
        inertia=lambda q, _: inertia(model, q),
    )


@cache
def reference_torques(n: int) -> Torque:
    """M(q) a + C(q, q') r + G(q) - passive of a robot of n joints, in Python and compiled code.

    M has the joints' armature; what is passive, as springs and damping, is so at the state.

    Returns:
        A function (workspace, x, r, a), as ``inverse_dynamics``; returns (n,).
    """
    load_mujoco()

    @numba.njit
    def torque(workspace: float, x: Any, r: Any, a: Any) -> Any:
        arrays = array_at(np.int64(workspace), (1,), WORKSPACE)[0]
        m, d = pointer(arrays.model), pointer(arrays.data)
        armature = array_at(arrays.armature, (n,), np.float64)
        qpos = array_at(arrays.qpos, (n,), np.float64)
        qvel = array_at(arrays.qvel, (n,), np.float64)
        qacc = array_at(arrays.qacc, (n,), np.float64)
        passive = array_at(arrays.qfrc_passive, (n,), np.float64)
        result = pointer(arrays.qfrc_inverse)
        bodies = array_at(result, (n,), np.float64)
        total = np.zeros(n)
        for i in range(n):
            qpos[i], qvel[i], qacc[i] = x[i], x[i + n], a[i]
        mj_kinematics(m, d)
        mj_com_pos(m, d)
        mj_com_vel(m, d)
        mj_passive(m, d)
        for i in range(n):
            total[i] = armature[i] * a[i] - passive[i]
        for share, moving, weight in _PASSES:
            for i in range(n):
                qvel[i] = moving * x[i + n] + share * r[i]
            mj_com_vel(m, d)
            mj_rne(m, d, np.int32(1 if moving == 0.0 else 0), result)
            for i in range(n):
                total[i] += weight * bodies[i]
        return total

    return torque


@cache
def body_regressor(n: int, body: int, root: int, bodies: int) -> Torque:
    """Y of one body's inertia and of a load on each joint, in Python and in compiled code.

    Args:
        n: Joints.
        body: Index of the body.
        root: Index of its tree's first body.
        bodies: How many there are, with the world.

    Returns:
        A function (workspace, x, r, a), as ``inverse_dynamics``; returns Y row by row,
        (n * (10 + n),), whose columns are those of ``torques_of_body``.
    """
    load_mujoco()
    columns = INERTIAL + n

    @numba.njit
    def regressor(workspace: float, x: Any, r: Any, a: Any) -> Any:
        arrays = array_at(np.int64(workspace), (1,), WORKSPACE)[0]
        m, d = pointer(arrays.model), pointer(arrays.data)
        qpos = array_at(arrays.qpos, (n,), np.float64)
        qvel = array_at(arrays.qvel, (n,), np.float64)
        qacc = array_at(arrays.qacc, (n,), np.float64)
        cinert = array_at(arrays.cinert, (bodies, INERTIAL), np.float64)
        xpos = array_at(arrays.xpos, (bodies, 3), np.float64)
        xmat = array_at(arrays.xmat, (bodies, 9), np.float64)
        centre = array_at(arrays.subtree_com, (bodies, 3), np.float64)
        result = pointer(arrays.qfrc_inverse)
        torques = array_at(result, (n,), np.float64)
        for i in range(n):
            qpos[i], qacc[i] = x[i], a[i]
        mj_kinematics(m, d)
        mj_com_pos(m, d)
        units, Y = np.empty((INERTIAL, INERTIAL)), np.zeros(n * columns)
        for i in range(bodies):
            for j in range(INERTIAL):
                cinert[i, j] = 0.0
        _units(xpos[body], centre[root], xmat[body], units)
        for share, moving, weight in _PASSES:
            for i in range(n):
                qvel[i] = moving * x[i + n] + share * r[i]
            mj_com_vel(m, d)
            for j in range(INERTIAL):
                for k in range(INERTIAL):
                    cinert[body, k] = units[j, k]
                mj_rne(m, d, np.int32(1 if moving == 0.0 else 0), result)
                for i in range(n):
                    Y[i * columns + j] += weight * torques[i]
        for i in range(n):
            Y[i * columns + INERTIAL + i] = 1.0
        return Y

    return regressor


@numba.njit
def _units(place: Any, centre: Any, turned: Any, units: Any) -> None:
    """``cinert`` of a body with one parameter of 1 and the others 0, a row for each of them.

    With c = place - centre and R the body's axes, a mass m, first moment h and inertia I about
    the body's origin are, about the tree's centre of mass and along the world's axes, m, R h + m c
    and R I R' + 2 (c.Rh) 1 - c (Rh)' - (Rh) c' + m (c.c 1 - c c').
    """
    c, g = np.empty(3), np.empty(3)
    for i in range(3):
        c[i] = place[i] - centre[i]
    for j in range(INERTIAL):
        for k in range(INERTIAL):
            units[j, k] = 0.0
    units[0, 9] = 1.0
    for j in range(4):
        # The mass is as a first moment of c/2, twice along itself.
        for i in range(3):
            g[i] = c[i] / 2 if j == 0 else turned[3 * i + j - 1]
            units[j, 6 + i] = c[i] if j == 0 else g[i]
        along = 2 * (c[0] * g[0] + c[1] * g[1] + c[2] * g[2])
        for k in range(6):
            row, column = _ENTRIES[k]
            units[j, k] = -c[row] * g[column] - g[row] * c[column]
            if row == column:
                units[j, k] += along
    for j in range(6):
        p, q = _ENTRIES[j]
        for k in range(6):
            row, column = _ENTRIES[k]
            entry = turned[3 * row + p] * turned[3 * column + q]
            if p != q:
                entry += turned[3 * row + q] * turned[3 * column + p]
            units[4 + j, k] = entry
