"""The integral sliding surface, eqs. (8), (31) and (51), as printed and for a sampled law."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from grosmc_mj.arguments import reals
from grosmc_mj.arrays import Array
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.errors import GainError, shown
from grosmc_mj.jitable import jitable
from grosmc_mj.vectors import Vector, each, row_times


@cache
def integral_surface(m: int, n: int) -> Callable[[float, Any, Any, Any], Vector]:
    """The surface of m inputs and n entries of z, as a jitable (t, z, memory, p) -> s.

    s = G [z - z(0)] - integral of S z, with the integral as a left Riemann sum over the samples
    before this one, as a sampled controller can form it. It is zero at the start: there is no
    reaching phase. ``p`` has G (m, n) and S (m, n), see ``drift_of_surface``; ``memory`` is a
    ``SurfaceMemory``, which is brought up to this sample.
    """

    def entry(i: int, z: Any, memory: Any, p: Any) -> float:
        moved = 0.0
        for j in range(n):
            moved += p.G[i, j] * (z[j] - memory.z0[j])
        return moved - memory.integral[i]

    value, rate, accumulate = each(m, entry), each(m, row_times), accumulated(m)

    @jitable
    def surface(t: float, z: Any, memory: Any, p: Any) -> Vector:
        if t == memory.first:
            memory.t = t
            for j in range(n):
                memory.z0[j] = z[j]
        accumulate(t, rate(p.S, z), memory)
        s = value(z, memory, p)
        for i in range(m):
            memory.s[i] = s[i]
        return s

    return surface


@cache
def accumulated(m: int) -> Callable[[float, Any, Any], None]:
    """Jitable (t, rates, memory): bring the integral of m rates up to this sample."""

    @jitable
    def accumulate(t: float, rates: Any, memory: Any) -> None:
        memory.elapsed = t - memory.t
        memory.t = t
        for i in range(m):
            memory.integral[i] += memory.rate[i] * memory.elapsed
            memory.rate[i] = rates[i]

    return accumulate


def drift_of_surface(G: Array, optimum: LqrDesign, control_period: float | None) -> Array:
    """S of the surface: what G z drifts by, per second, on the optimal trajectory.

    As printed it is G (A - B K), summed over the samples, which leaves an error of the order of
    the control period T. The discrete-time surface takes G (A_d - B_d K - I) / T, with the exact
    transition A_d, B_d under a held input: it is zero at every sample of the nominal plant.

    Args:
        G: Projection, (m, n).
        optimum: The design that the surface follows.
        control_period: T [s] of the discrete-time surface; None for the printed one.

    Returns:
        S, (m, n).
    """
    if control_period is None:
        return G @ optimum.closed_loop
    A_d, B_d = _held(optimum, control_period)
    return G @ (A_d - B_d @ optimum.K - np.eye(len(A_d))) / control_period


def held_gain(G: Array, optimum: LqrDesign, control_period: float | None) -> Array:
    """What a unit of held input moves G z by, per second: G B as printed, else G B_d / T, (m, m).

    Args:
        G: Projection, (m, n).
        optimum: The design that the surface follows.
        control_period: T [s] of the discrete-time surface; None for the printed one.
    """
    if control_period is None:
        return G @ optimum.B
    return G @ _held(optimum, control_period)[1] / control_period


def _held(optimum: LqrDesign, control_period: float) -> tuple[Array, Array]:
    """A_d (n, n) and B_d (n, m) of z over a control period under a held input."""
    n, m = optimum.B.shape
    held = np.zeros((n + m, n + m))
    held[:n, :n], held[:n, n:] = optimum.A, optimum.B
    transition = scipy.linalg.expm(held * control_period)
    return transition[:n, :n], transition[:n, n:]


def surface_matrix(G: ArrayLike | None, B: Array) -> Array:
    """G of the surface, by default B+ = (B'B)^-1 B', which makes G B the identity.

    Raises:
        GainError: If G does not fit B or G B is singular.
    """
    given, G = G, np.linalg.pinv(B) if G is None else np.atleast_2d(reals(G))
    if np.ndim(reals(given)) == 0 and given is not None and not np.isfinite(reals(given)):
        raise GainError(f"G = {shown(given)} must be a matrix of finite numbers")
    if G.shape != B.T.shape:
        raise GainError(f"G has shape {G.shape}, must be {B.T.shape}")
    if not np.all(np.isfinite(G)):
        raise GainError(f"G = {G.tolist()} must be finite")
    least = np.linalg.svd(G @ B, compute_uv=False).min()
    # Against what G and B could give: a 1x1 G B has no condition number worth the name.
    if not least > 1e-12 * np.linalg.norm(G) * np.linalg.norm(B):
        raise GainError(f"G B = {(G @ B).tolist()} is singular, so s' cannot be steered: choose G")
    return G
