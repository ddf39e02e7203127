"""The integral sliding surface, eqs. (8), (31) and (51)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.errors import GainError
from grosmc_mj.jitable import jitable


@jitable
def integral_surface(t: float, z: Any, memory: Any, p: Any) -> float:
    """s = G [z - z(0)] - integral of G (A - B K) z, with the integral as a left Riemann sum.

    It is zero at the start: there is no reaching phase. The sum runs over the samples before
    this one, as a sampled controller can form it.

    Args:
        t: Time of this sample, exactly k times the control period [s].
        z: Error state, (2,).
        memory: A ``SurfaceMemory``; it is brought up to this sample.
        p: With ``G`` (2,) and ``GA_c`` = G (A - B K), (2,).

    Returns:
        s.
    """
    if t == 0.0:
        memory.z0[0] = z[0]
        memory.z0[1] = z[1]
    memory.integral += memory.rate * (t - memory.t)
    memory.t = t
    memory.rate = p.GA_c[0] * z[0] + p.GA_c[1] * z[1]
    s = p.G[0] * (z[0] - memory.z0[0]) + p.G[1] * (z[1] - memory.z0[1]) - memory.integral
    memory.s = s
    return s


def surface_matrix(G: ArrayLike | None, B: Array) -> Array:
    """G of the surface, by default B+ = (B'B)^-1 B', which makes G B the identity.

    Raises:
        GainError: If G does not fit B or G B is singular.
    """
    G = np.linalg.pinv(B) if G is None else np.atleast_2d(np.asarray(G, float))
    if G.shape != B.T.shape:
        raise GainError(f"G has shape {G.shape}, must be {B.T.shape}")
    if not np.all(np.isfinite(G)):
        raise GainError(f"G = {G.tolist()} must be finite")
    least = np.linalg.svd(G @ B, compute_uv=False).min()
    # Against what G and B could give: a 1x1 G B has no condition number worth the name.
    if not least > 1e-12 * np.linalg.norm(G) * np.linalg.norm(B):
        raise GainError(f"G B = {(G @ B).tolist()} is singular, so s' cannot be steered: choose G")
    return G
