"""A robot's torques as linear in the inertia of one of its bodies, by MuJoCo's recursion.

MuJoCo's recursive Newton-Euler algorithm is linear in ``mjData.cinert``, ten numbers a body: its
inertia about the tree's centre of mass, its first moment and its mass. So a column of the
regressor is that recursion over a robot whose other bodies weigh nothing.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np

from grosmc_mj.control.coordinates.base import LinearTorques
from grosmc_mj.jitable import jitable
from grosmc_mj.robots.dynamics import WORKSPACE, inertia, mj_com_vel, mj_rne, place, vector_at
from grosmc_mj.structures import array_at, pointer

# Mass, first moment and inertia of a body.
INERTIAL = 10
# Rows and columns of a symmetric tensor's entries, in MuJoCo's order.
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
# Torques of a velocity v enter by their symmetric bilinear form c(v, r), with c(v, v) what the
# recursion gives: c(v, r) = (c(v + r, v + r) - c(v - r, v - r)) / 4. Gravity cancels there, and is
# in the recursion at rest, with the accelerations. Each has its share of r, of v, and its weight.
_AT_REST, _FASTER, _SLOWER = (0.0, 0.0, 1.0), (1.0, 1.0, 0.25), (-1.0, 1.0, -0.25)
_PASSES = (_AT_REST, _FASTER, _SLOWER)


@cache
def torques_of_body(model: mujoco.MjModel, body: int) -> LinearTorques:
    """The torques of a robot by what is unknown of one body and by a constant load on each joint.

    theta has what the body has more than in the nominal model: its mass [kg], first moment
    [kg m] and inertia xx, yy, zz, xy, xz, yz [kg m^2], all in the body's frame and about its
    origin, then the loads [N m or N]. All of it is nominally zero. Without a workspace all torques
    are zero: the law is undefined then, see ``RobotCoordinates.virtual_input``.

    Args:
        model: Of the dynamics, see ``nominal_model``.
        body: Index of a body that moves.
    """
    n, root, bodies = int(model.nv), int(model.body_rootid[body]), int(model.nbody)
    count = INERTIAL + n
    none = (0.0,) * count

    def known(x: Any, r: Any, a: Any, memory: Any, p: Any) -> Any:
        torques = np.zeros(n)
        if memory.workspace != 0.0:
            reference_torques(memory.workspace, x, r, a, torques)
        return torques

    def regressor(x: Any, r: Any, a: Any, memory: Any, p: Any) -> Any:
        Y = np.zeros((n, count))
        if memory.workspace != 0.0:
            body_regressor(memory.workspace, x, r, a, (body, root, bodies), Y)
        return Y.ravel()

    return LinearTorques(
        size=count,
        nominal=jitable(lambda p: none),
        known=jitable(known),
        regressor=jitable(regressor),
        inertia=lambda q, _: inertia(model, q),
    )


@numba.njit
def reference_torques(workspace: float, x: Any, r: Any, a: Any, tau: Any) -> None:
    """Write M(q) a + C(q, q') r + G(q) - passive of a robot, as ``inverse_dynamics``.

    M has the joints' armature; what is passive, as springs and damping, is so at the state.
    """
    n, w = len(tau), array_at(np.int64(workspace), (1,), WORKSPACE)[0]
    armature, passive = vector_at(w.armature, n), vector_at(w.qfrc_passive, n)
    qacc, bodies = vector_at(w.qacc, n), vector_at(w.qfrc_inverse, n)
    place(w, x, n)
    qacc[:] = a
    tau[:] = armature * qacc - passive
    for share, moving, weight in _PASSES:
        _move(w, x, r, share, moving)
        _recur(w, moving)
        tau += weight * bodies


@numba.njit
def body_regressor(workspace: float, x: Any, r: Any, a: Any, body: Any, Y: Any) -> None:
    """Write Y of one body's inertia and of a load on each joint, as ``reference_torques``.

    Args:
        workspace: Address of a ``NominalData``.
        x: State, (2 n,).
        r: Reference rates, (n,).
        a: Reference accelerations, (n,).
        body: Index of the body, that of its tree's first one, and how many there are.
        Y: (n, 10 + n), whose columns are those of ``torques_of_body``.
    """
    index, root, count = body
    n, w = len(Y), array_at(np.int64(workspace), (1,), WORKSPACE)[0]
    qacc, torques = vector_at(w.qacc, n), vector_at(w.qfrc_inverse, n)
    cinert = array_at(w.cinert, (count, INERTIAL), np.float64)
    xpos = array_at(w.xpos, (count, 3), np.float64)
    xmat = array_at(w.xmat, (count, 9), np.float64)
    centre = array_at(w.subtree_com, (count, 3), np.float64)
    place(w, x, n)
    units = np.empty((INERTIAL, INERTIAL))
    _units(xpos[index], centre[root], xmat[index], units)
    cinert[:] = 0.0
    Y[:] = 0.0
    Y[:, INERTIAL:] = np.eye(n)
    qacc[:] = a
    for share, moving, weight in _PASSES:
        _move(w, x, r, share, moving)
        for j in range(INERTIAL):
            cinert[index] = units[j]
            _recur(w, moving)
            Y[:, j] += weight * torques


@numba.njit
def _move(w: Any, x: Any, r: Any, share: float, moving: float) -> None:
    """Give the joints the rates moving x' + share r."""
    n = len(r)
    vector_at(w.qvel, n)[:] = moving * x[n:] + share * r
    mj_com_vel(pointer(w.model), pointer(w.data))


@numba.njit
def _recur(w: Any, moving: float) -> None:
    """Torques at these rates, with accelerations at rest, in ``qfrc_inverse``."""
    accelerated = np.int32(1 if moving == 0.0 else 0)
    mj_rne(pointer(w.model), pointer(w.data), accelerated, pointer(w.qfrc_inverse))


@numba.njit
def _units(place: Any, centre: Any, turned: Any, units: Any) -> None:
    """``cinert`` of a body with one parameter of 1 and the others 0, a row for each of them.

    With c = place - centre and R the body's axes, a mass m, first moment h and inertia I about
    the body's origin are, about the tree's centre of mass and along the world's axes, m, R h + m c
    and R I R' + 2 (c.Rh) 1 - c (Rh)' - (Rh) c' + m (c.c 1 - c c').
    """
    c, R = place - centre, turned.reshape(3, 3)
    units[:] = 0.0
    for j in range(4):
        # The mass is as a first moment of c/2, twice along itself.
        g = c / 2 if j == 0 else R[:, j - 1].copy()
        units[j, 6:9] = g
        along = 2 * (c[0] * g[0] + c[1] * g[1] + c[2] * g[2])
        for k in range(6):
            row, column = _ENTRIES[k]
            entry = -c[row] * g[column] - g[row] * c[column]
            units[j, k] = entry + along if row == column else entry
    units[0, 6:9], units[0, 9] = c, 1.0
    for j in range(6):
        p, q = _ENTRIES[j]
        for k in range(6):
            row, column = _ENTRIES[k]
            entry = R[row, p] * R[column, q]
            units[4 + j, k] = entry if p == q else entry + R[row, q] * R[column, p]
