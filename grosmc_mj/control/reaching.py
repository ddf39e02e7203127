"""The reaching condition, eqs. (9), (14) and (39): what the switching term must dominate.

On a true plant a law's sliding variable moves by s' = push - rho R sgn(s). ``Nominal.reaching``
computes push and R at many states at once. The switching gains are its supremum over a declared
family of plants (``uncertainty``); the audit of the premises looks at it along a run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Design
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.lqr import LqrDesign


class Reaching(NamedTuple):
    """s' = push - rho R sgn(s) of a true plant at N states.

    Attributes:
        dz: z' under the continuous part of the law, (N, n).
        push: What moves s then, (N, m), in the unit of s per second.
        R: (G_r E*) (G_r E)^-1, (N, m, m): what becomes of the switching term.
    """

    dz: Array
    push: Array
    R: Array


class Nominal(NamedTuple):
    """A law at N states, as its own model of the plant has it.

    Attributes:
        G: Projection of the surface, (m, n).
        z: Error states, (N, n).
        v_0: What the law's continuous part asks for, within its limit, (N, m).
        u_c: The input that this comes to, (N, m).
        E: Decoupling matrix, (N, m, m); of a linear model the rows of B that it stands in.
        GE: G_r E, what an input does to s', (N, m, m).
        drift: What the surface takes from G z per second, S z as printed, (N, m).
    """

    G: Array
    z: Array
    v_0: Array
    u_c: Array
    E: Array
    GE: Array
    drift: Array

    def reaching(self, motion: tuple[Array, Array]) -> Reaching:
        """The reaching condition on a true plant.

        Where the true plant makes z' = drift + gain u, s' = G z' - S z: what of the uncertainty
        reaches s through the rows without an input counts too, if G looks at them.

        Args:
            motion: drift (N, n) and gain (N, n, m), as ``error.error_dynamics`` gives them.
        """
        dz = motion[0] + times(motion[1], self.u_c)
        return Reaching(
            dz, times(self.G, dz) - self.drift, self.G @ motion[1] @ np.linalg.inv(self.GE)
        )


def nominal(design: Design, p: Any, t: Sequence[float], x: Array, z: Array) -> Nominal:
    """A law at many states by its own model: u_c = E^-1 (v_0 - alpha), or v_0 of a linear law.

    Args:
        design: What it was designed for.
        p: Its parameters: those of GROSMC, or of a law without a surface, for which G is B+.
        t: Times [s], (N,).
        x: States, (N, n).
        z: Error states there, (N, size).
    """
    error, optimum = design.error, design.lqr
    G = p.G if hasattr(p, "G") else np.linalg.pinv(optimum.B)
    unlimited, limit = -times(p.K, z), getattr(p, "limit", math.inf)
    v_0 = np.clip(unlimited, -limit, limit)
    u_c, E, GE = v_0, G @ optimum.B, G @ optimum.B
    if isinstance(error, OutputCoordinates):
        rows = list(error.linearization.last_rows)
        E = optimum.B[rows]
        if design.linearizing:
            alpha, E = error.dynamics_along(t, x, p)
            u_c, GE = np.linalg.solve(E, (v_0 - alpha)[..., None])[..., 0], G[:, rows] @ E
    drift = times(G @ optimum.closed_loop, z) + times(G @ optimum.B, v_0 - unlimited)
    E, GE = (np.broadcast_to(matrix, (len(z), *matrix.shape[-2:])) for matrix in (E, GE))
    return Nominal(G, z, v_0, u_c, E, GE, drift)


def times(matrix: Array, vector: Array) -> Array:
    """The product of a matrix (..., i, j) and a vector (..., j), of one or of many."""
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
        return np.linalg.eigvalsh((R + np.swapaxes(R, -2, -1)) / 2).min(axis=-1)
    diagonal = np.diagonal(R, axis1=-2, axis2=-1)
    return (diagonal - (np.abs(R).sum(axis=-1) - np.abs(diagonal))).min(axis=-1)


def mismatch(optimum: LqrDesign, A_t: Array, B_t: Array) -> tuple[Array, Array]:
    """Difference of a true linear plant from A - B K, and its matched part, (n, n) each.

    On x' = A_t x + B_t u with u = -K x it is dA - dB K; B B+ projects on what the input reaches.
    """
    added = A_t - B_t @ optimum.K - optimum.closed_loop
    return added, optimum.B @ np.linalg.pinv(optimum.B) @ added


def sliding_dynamics(optimum: LqrDesign, G: Array, A_t: Array, B_t: Array) -> Array:
    """The matrix of x' on s = 0 of a linear plant (A_t, B_t), (n, n).

    s' = G (x' - (A - B K) x) = 0 gives the equivalent input, and with X = B_t (G B_t)^-1 G

        x' = [(I - X) A_t + X (A - B K)] x.

    It is A - B K, eq. (11), where A_t - A and B_t - B are matched.
    """
    X = B_t @ np.linalg.solve(G @ B_t, G)
    return (np.eye(len(A_t)) - X) @ A_t + X @ optimum.closed_loop
