"""The reaching condition, eqs. (9), (14) and (39): what the switching term must dominate.

On a true plant a law's sliding variable moves by s' = push - rho R sgn(s). ``Nominal.reaching``
computes push and R at many states at once. The switching gains are suprema of it over a declared
family of plants (``uncertainty``); the audit of the premises evaluates it along a run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.base import OutputCoordinates
from grosmc_mj.theory.control.lqr import LqrDesign


class Reaching(NamedTuple):
    """s' = push - rho R sgn(s) of a true plant at N states.

    Attributes:
        dz: z' under the continuous part of the law, (N, n).
        push: Rate of s under it, (N, m), in the unit of s per second.
        R: (G_r E*) (G_r E)^-1, (N, m, m), by which the true input gain changes the switching term.
    """

    dz: Array
    push: Array
    R: Array


class NominalLaw(NamedTuple):
    """A law at N states, by its own model of the plant.

    Attributes:
        t: Times [s], (N,).
        x: States, (N, n).
        G: Projection of the surface, (m, size).
        z: Error states, (N, size).
        v_0: v of the law's continuous part, within its limit, (N, m).
        u_c: Input that makes this v, (N, m).
        E: Decoupling matrix, (N, m, m); of a linear model the rows of B with the inputs.
        GE: G_r E, the change of s' by the input, (N, m, m).
        drift: Integrand of the surface, S z as printed, (N, m).
    """

    t: Sequence[float]
    x: Array
    G: Array
    z: Array
    v_0: Array
    u_c: Array
    E: Array
    GE: Array
    drift: Array

    def reaching(self, motion: tuple[Array, Array]) -> Reaching:
        """The reaching condition on a true plant.

        The true plant makes z' = drift + gain u, so s' = G z' - S z. Uncertainty in the rows of z'
        without an input counts too, if G has entries for them.

        Args:
            motion: drift (N, n) and gain (N, n, m), as ``error.error_dynamics`` gives them.
        """
        drift, gain = motion
        dz = drift + matrix_vector(gain, self.u_c)
        push = matrix_vector(self.G, dz) - self.drift
        R = self.G @ gain @ np.linalg.inv(self.GE)
        return Reaching(dz, push, R)


def nominal_law(law: Controller, t: Sequence[float], x: Array, z: Array) -> NominalLaw:
    """Law at many states by its own model: u_c = E^-1 (v_0 - alpha), or v_0 of a linear law.

    Args:
        law: The law; G is B+ for one without a surface.
        t: Times [s], (N,).
        x: States, (N, n).
        z: Error states there, (N, size).
    """
    optimum = law.designed.lqr
    p = law.parameters
    G = p.G if hasattr(p, "G") else np.linalg.pinv(optimum.B)
    limit = getattr(p, "limit", math.inf)
    unlimited = -matrix_vector(p.K, z)
    v_0 = np.clip(unlimited, -limit, limit)

    GB = G @ optimum.B
    drift = matrix_vector(G @ optimum.closed_loop, z) + matrix_vector(GB, v_0 - unlimited)

    u_c, E, GE = _inputs(law, t, x, v_0, G)
    m = len(G)
    E = np.broadcast_to(E, (len(z), m, m))
    GE = np.broadcast_to(GE, (len(z), m, m))
    return NominalLaw(t, x, G, z, v_0, u_c, E, GE, drift)


def _inputs(
    law: Controller,
    t: Sequence[float],
    x: Array,
    v_0: Array,
    G: Array,
) -> tuple[Array, Array, Array]:
    """u_c (N, m), E and G_r E, (m, m) each or (N, m, m), at N states."""
    design = law.designed
    error = design.error
    B = design.lqr.B
    GB = G @ B
    if not isinstance(error, OutputCoordinates):
        return v_0, GB, GB

    rows = list(error.linearization.last_rows)
    if not design.linearizing:
        return v_0, B[rows], GB

    alpha, E = error.dynamics_along(t, x, law.parameters)
    columns = np.linalg.solve(E, (v_0 - alpha)[..., None])
    return columns[..., 0], E, G[:, rows] @ E


def matrix_vector(matrix: Array, vector: Array) -> Array:
    """Product of a matrix (..., i, j) and a vector (..., j), or of many of them."""
    return np.einsum("...ij,...j->...i", matrix, vector)


def gain_margin(R: Array, *, together: bool = False) -> Any:
    """Share r of a switching term that a true input gain leaves; for one input it is E*/E.

    Args:
        R: (G_r E*) (G_r E)^-1, of the true plant and of the law's model, (..., m, m).
        together: Whether the term is along s/|s|: s' R s >= r |s|^2. Else it has one switch in
            each entry, which is driven back by rho (R_ii - sum_j |R_ij|) at least.

    Returns:
        One number for each matrix, (...).
    """
    if together:
        symmetric = (R + np.swapaxes(R, -2, -1)) / 2
        return np.linalg.eigvalsh(symmetric).min(axis=-1)

    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    row_sums = np.abs(R).sum(axis=-1)
    off_diagonal = row_sums - np.abs(diagonal)
    return (diagonal - off_diagonal).min(axis=-1)


def mismatch(optimum: LqrDesign, A_t: Array, B_t: Array) -> tuple[Array, Array]:
    """Difference of a true linear plant from A - B K, and its matched part, (n, n) each.

    On x' = A_t x + B_t u with u = -K x the difference is dA - dB K; B B+ projects on the range of
    the input matrix.

    Args:
        optimum: The design, with the nominal A, B and K.
        A_t: State matrix of the true plant, (n, n).
        B_t: Its input matrix, (n, m).
    """
    difference = A_t - B_t @ optimum.K - optimum.closed_loop
    matched = optimum.B @ np.linalg.pinv(optimum.B) @ difference
    return difference, matched


def sliding_dynamics(
    optimum: LqrDesign,
    G: Array,
    A_t: Array,
    B_t: Array,
) -> Array:
    """Matrix of x' on s = 0 of a linear plant (A_t, B_t), (n, n).

    s' = G (x' - (A - B K) x) = 0 gives the equivalent input, and with X = B_t (G B_t)^-1 G

        x' = [(I - X) A_t + X (A - B K)] x.

    It is A - B K, eq. (11), where A_t - A and B_t - B are matched.
    """
    X = B_t @ np.linalg.solve(G @ B_t, G)
    identity = np.eye(len(A_t))
    return (identity - X) @ A_t + X @ optimum.closed_loop
