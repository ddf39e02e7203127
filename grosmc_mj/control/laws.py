"""The laws of the chapter: optimal feedback and GROSMC, of a linear plant or through eq. (44).

Every function here makes a law (t, x, memory, p, u) for some error coordinates, once: the
compiled engine compiles it once. Its memory has the error state z (n,) and v (m,).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.control.coordinates.base import Coordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.law import Law
from grosmc_mj.control.matrices import norm, norm_of_product, row_times
from grosmc_mj.control.surface import integral_surface
from grosmc_mj.control.switching import SwitchingTerm
from grosmc_mj.jitable import jitable

# Jitable (x, z, p) -> k and rho: the proportional and the switching gain of a sample.
Gains = Callable[[Any, Any, Any], tuple[float, float]]


@cache
def optimal_feedback(error: Coordinates, *, linearizing: bool) -> Law:
    """v = -K z: eq. (5) with v as the input, eqs. (23)+(28) and (44)+(49) through linearization."""
    error_state, (apply, _) = error.state, error.input_maps(linearizing=linearizing)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        z, v = memory.z, memory.v
        error_state(t, x, p, z)
        for i in range(len(v)):
            v[i] = 0.0 - row_times(i, p.K, z)
        apply(t, x, v, memory, p, u)

    return law


@cache
def grosmc(error: Coordinates, gains: Gains, linearizing: bool, reach: SwitchingTerm) -> Law:
    """v = -K z + (G B)^-1 phi, with phi the rate that the switching law asks of s.

    It is eq. (12) of a linear plant, about its operating point, and eqs. (37) and (55) through
    feedback linearization; they differ in k and rho. With s of eq. (31), (ds/dx) g = G B E(x),
    and u_con of eq. (36) is E^-1 (v_0 - K(x)), so u_dis of eq. (37) is E^-1 (G B)^-1 phi.

    The surface supposes that the nominal input -K z is applied. Where an actuator cuts it off, s
    grows by what is missing, as an integrator winds up, and the switching term goes on paying it
    back when the limit is long past. So a linear plant's nominal input is kept within
    ``p.limit``, in law and surface alike: s' = G (x' - A x - B u_0). Without a limit it is the
    printed law.

    Args:
        error: The error coordinates.
        gains: ``gains_of_linear_plant``, ``gains_of_regulator(error)`` or ``gains_of_tracker``.
        linearizing: Whether v goes through feedback linearization; else it is the input.
        reach: The switching law.
    """
    error_state, (apply, _) = error.state, error.input_maps(linearizing=linearizing)
    gains, reach = jitable(gains), jitable(reach)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        z, v, phi = memory.z, memory.v, memory.phi
        m = len(v)
        error_state(t, x, p, z)
        integral_surface(t, z, memory, p)
        for i in range(m):
            v[i] = 0.0 - row_times(i, p.K, z)
        if not linearizing:
            for i in range(m):
                nominal = min(p.limit, max(-p.limit, v[i]))
                u[i], v[i] = nominal - v[i], nominal
            for i in range(m):
                memory.rate[i] += row_times(i, p.GB_held, u)
        k, rho = gains(x, z, p)
        reach(memory.s, k, rho, memory, p.switching, phi)
        for i in range(m):
            v[i] += row_times(i, p.GB_inverse, phi)
        apply(t, x, v, memory, p, u)

    return law


@jitable
def gains_of_linear_plant(x: Any, z: Any, p: Any) -> tuple[float, float]:
    """Eq. (12): rho = eta + (gamma0 + gamma1 |z|) |G B|."""
    return 0.0, p.eta + (p.gamma0 + p.gamma1 * norm(z)) * p.size_of_GB


@cache
def gains_of_regulator(error: ErrorCoordinates) -> Gains:
    """Eq. (37): rho = eta + (gamma0 + gamma1 |z|) |G B E(x)|."""
    matrix = error.linearization.decoupling_matrix

    @jitable
    def gains(x: Any, z: Any, p: Any) -> tuple[float, float]:
        size = norm_of_product(p.GB, matrix(x, p.plant))
        return 0.0, p.eta + (p.gamma0 + p.gamma1 * norm(z)) * size

    return gains


@jitable
def gains_of_tracker(x: Any, z: Any, p: Any) -> tuple[float, float]:
    """Eq. (55): k and rho = epsilon are given."""
    return p.k, p.epsilon
