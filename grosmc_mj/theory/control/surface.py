"""The integral sliding surface, eqs. (8), (31) and (51), as printed and for a sampled law."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import GainError, array_text, value_text
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.matrices import row_times


@jitable
def integral_surface(t: float, z: Any, memory: Any, p: Any) -> None:
    """s = G [z - z(0)] - integral of S z, eqs. (8), (31) and (51), into ``memory.s``.

    The integral is a left Riemann sum over the samples before this one, as a sampled controller
    can form it. s is zero at the start: there is no reaching phase.

    Args:
        t: Time [s].
        z: Error state, (n,).
        memory: A ``SurfaceMemory``, which is brought up to this sample.
        p: With G (m, n) and S (m, n), see ``surface_rates``.
    """
    z0 = memory.z0
    s = memory.s
    if not memory.begun:
        memory.t = t
        for j in range(len(z)):
            z0[j] = z[j]

    integrate(t, memory)
    for i in range(len(s)):
        memory.rate[i] = row_times(i, p.S, z)
        total = 0.0
        for j in range(len(z)):
            total += p.G[i, j] * (z[j] - z0[j])
        s[i] = total - memory.integral[i]


@jitable
def integrate(t: float, memory: Any) -> None:
    """Bring the integral of ``memory.rate`` up to the sample at t [s]."""
    # The difference of the exact instants k T: it is off the control period by their rounding, but
    # the sum of all of them is t.
    memory.elapsed = t - memory.t
    memory.t = t
    for i in range(len(memory.rate)):
        memory.integral[i] += memory.rate[i] * memory.elapsed


def surface_rates(
    G: Array, optimum: LqrDesign, control_period: float | None
) -> tuple[Array, Array]:
    """Rates of G z: S z on the optimal trajectory, eqs. (8), (31), (51), and GB for a unit input.

    As printed, S = G (A - B K) and GB = G B; the sum over the samples leaves an error of the order
    of the control period T. The discrete-time surface takes S = G (A_d - B_d K - I) / T and
    GB = G B_d / T, with the exact transition A_d, B_d under a held input: s is then zero at every
    sample of the nominal plant.

    Args:
        G: Projection, (m, n).
        optimum: The design that the surface follows.
        control_period: T [s] of the discrete-time surface; None for the printed one.

    Returns:
        S (m, n) and GB (m, m).
    """
    if control_period is None:
        return G @ optimum.closed_loop, G @ optimum.B

    # The held input is a state of its own, with the rate zero.
    n, m = optimum.B.shape
    held = np.zeros((n + m, n + m))
    held[:n, :n] = optimum.A
    held[:n, n:] = optimum.B
    transition = scipy.linalg.expm(held * control_period)
    A_d, B_d = np.split(transition[:n], [n], axis=1)

    closed_loop = A_d - B_d @ optimum.K
    S = G @ (closed_loop - np.eye(n)) / control_period
    GB = G @ B_d / control_period
    return S, GB


def surface_matrix(G: ArrayLike | None, B: Array) -> Array:
    """Projection G of the surface, by default B+ = (B'B)^-1 B', which makes G B the identity.

    Args:
        G: Projection, (m, n); None for the default.
        B: Input matrix, (n, m).

    Returns:
        G, (m, n).

    Raises:
        GainError: If G does not fit B or G B is singular.
    """
    projection = np.linalg.pinv(B) if G is None else np.atleast_2d(reals(G))
    if projection.shape != B.T.shape or not np.all(np.isfinite(projection)):
        rows, columns = B.T.shape
        raise GainError(f"G = {value_text(G)} must be {rows} x {columns} finite numbers")

    GB = projection @ B
    least = np.linalg.svd(GB, compute_uv=False).min()
    # Compared with |G| |B|, the most that G B could be: every 1x1 G B has condition number one.
    rounding = 1e-12 * np.linalg.norm(projection) * np.linalg.norm(B)
    if not least > rounding:
        raise GainError(f"G B = {array_text(GB)} is singular, so s' cannot be steered: choose G")
    return projection
