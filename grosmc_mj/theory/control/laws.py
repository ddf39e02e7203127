"""The laws of the chapter: optimal feedback and GROSMC, of a linear plant or through eq. (44).

Every function here makes a law (t, x, memory, p, u) for some error coordinates. It is cached, so
that all controllers on these coordinates have one law, which is compiled once. The law's memory
has the error state z (n,) and v (m,).
"""

from __future__ import annotations

from functools import cache
from typing import Any

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.theory.control.coordinates.base import Coordinates
from grosmc_mj.theory.control.law import Law
from grosmc_mj.theory.control.matrices import norm, norm_of_product, row_times
from grosmc_mj.theory.control.surface import integral_surface
from grosmc_mj.theory.control.switching import SwitchingTerm


# A law of the same coordinates is one function, which is compiled once.
@cache
def optimal_feedback(error: Coordinates, *, linearizing: bool) -> Law:
    """v = -K z: eq. (5) with v as the input, eqs. (23)+(28) and (44)+(49) through linearization."""
    error_state = error.state
    apply, _ = error.input_maps(linearizing=linearizing)

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        z = memory.z
        v = memory.v
        error_state(t, x, p, z)
        for i in range(len(v)):
            v[i] = 0.0 - row_times(i, p.K, z)
        apply(t, x, v, memory, p, u)

    return law


@cache
def grosmc(
    error: Coordinates,
    linearizing: bool,
    regulating: bool,
    reach: SwitchingTerm,
) -> Law:
    """v = -K z + (G B)^-1 phi, with phi the rate that the switching law asks of s.

    It is eq. (12) of a linear plant, about its operating point, and eqs. (37) and (55) through
    feedback linearization. With s of eq. (31), (ds/dx) g = G B E(x), and u_con of eq. (36) is
    E^-1 (v_0 - K(x)), so u_dis of eq. (37) is E^-1 (G B)^-1 phi. The switching term has the gains

        k and rho = eta + epsilon + (gamma0 + gamma1 |z|) |G B E(x)|,

    with k = epsilon = 0 in eqs. (12) and (37), E = 1 in (12) and eta = gamma0 = gamma1 = 0 in (55).

    The surface supposes that the nominal input -K z is applied. Where an actuator cuts it off, s
    grows by what is missing, as an integrator winds up, and the switching term goes on paying it
    back when the limit is long past. So a linear plant's nominal input is kept within
    ``p.limit``, in law and surface alike: s' = G (x' - A x - B u_0). Without a limit it is the
    printed law.

    Args:
        error: The error coordinates; in symbols for ``regulating``.
        linearizing: Whether v goes through feedback linearization; else it is the input.
        regulating: Whether rho follows E(x), eq. (37).
        reach: The switching law.
    """
    error_state = error.state
    apply, _ = error.input_maps(linearizing=linearizing)
    reach = jitable(reach)
    input_gain = _size_of_GBE(error) if regulating else _size_of_GB

    def law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        z = memory.z
        v = memory.v
        phi = memory.phi
        m = len(v)

        error_state(t, x, p, z)
        integral_surface(t, z, memory, p)

        # The nominal input, within the limit; u holds how much the limit changes it.
        for i in range(m):
            v[i] = 0.0 - row_times(i, p.K, z)
        if not linearizing:
            for i in range(m):
                nominal = min(p.limit, max(-p.limit, v[i]))
                u[i] = nominal - v[i]
                v[i] = nominal
            for i in range(m):
                memory.rate[i] += row_times(i, p.GB_held, u)

        # The switching term.
        bound = p.gamma0 + p.gamma1 * norm(z)
        rho = p.eta + p.epsilon + bound * input_gain(x, p)
        reach(memory.s, p.k, rho, memory, p.switching, phi)
        for i in range(m):
            v[i] += row_times(i, p.GB_inverse, phi)

        apply(t, x, v, memory, p, u)

    return law


@jitable
def _size_of_GB(x: Any, p: Any) -> float:
    """|G B|, for a law whose switching gain does not follow E(x)."""
    return p.size_of_GB


def _size_of_GBE(error: Any) -> Any:
    """Jitable (x, p) -> |G B E(x)| by the nominal plant's decoupling matrix."""
    matrix = error.linearization.decoupling_matrix
    return jitable(lambda x, p: norm_of_product(p.GB, matrix(x, p.plant)))
