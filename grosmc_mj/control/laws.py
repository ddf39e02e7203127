"""The laws of the chapter, each written once as (t, x, memory, p) -> u.

Every function here makes a law for given error coordinates. A law is plain Python for one
simulation; ``p`` is the parameter dataclass of its controller, ``memory`` belongs to the run.
Made once per coordinates, so that the compiled engine compiles it once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.control.error_coordinates import ErrorCoordinates
from grosmc_mj.control.surface import integral_surface
from grosmc_mj.jitable import jitable

Law = Callable[[float, Any, Any, Any], float]


@jitable
def sgn(s: float) -> float:
    """The sign function as printed: -1, 0 or 1."""
    if s > 0.0:
        return 1.0
    return -1.0 if s < 0.0 else 0.0


@jitable
def times(K: Any, z: Any) -> float:
    """K z of a row K (2,) and a state z (2,)."""
    return K[0] * z[0] + K[1] * z[1]


@jitable
def norm(z: Any) -> float:
    """The Euclidean norm of z, (2,)."""
    return math.sqrt(z[0] * z[0] + z[1] * z[1])


@cache
def state_feedback(error: ErrorCoordinates) -> Law:
    """The optimal law of a linear plant, eq. (5): u = -K x."""
    error_state = error.state

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        u = -times(p.K, error_state(t, x, p))
        memory.v = u
        return u

    return law


@cache
def linearizing_feedback(error: ErrorCoordinates) -> Law:
    """The optimal law through feedback linearization, eqs. (23)+(28) and (44)+(49)."""
    error_state, error_dynamics = error.state, error.dynamics
    linearizable = error.system.linearizable

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        if not linearizable(x):
            memory.undefined = 1.0
            return 0.0
        alpha, E = error_dynamics(t, x, p)
        v = -times(p.K, error_state(t, x, p))
        memory.v = v
        return (v - alpha) / E

    return law


@cache
def grosmc_linear(error: ErrorCoordinates) -> Law:
    """GROSMC of a linear plant: the surface (8) and the law (12)."""
    error_state = error.state

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        z = error_state(t, x, p)
        s = integral_surface(t, z, memory, p)
        u_c = -times(p.K, z)
        u_d = -(p.eta + (p.gamma0 + p.gamma1 * norm(z)) * abs(p.GB)) * sgn(s) / p.GB
        u = u_c + u_d
        memory.v = u
        return u

    return law


@cache
def grosmc_regulator(error: ErrorCoordinates) -> Law:
    """GROSMC of an affine plant: the surface (31) and the law (37).

    With s of eq. (31), (ds/dx) g = G B E(x), and u_con of eq. (36) is E^-1 (v_0 - K(x)).
    """
    error_state, error_dynamics = error.state, error.dynamics
    linearizable = error.system.linearizable

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        z = error_state(t, x, p)
        s = integral_surface(t, z, memory, p)
        if not linearizable(x):
            memory.undefined = 1.0
            return 0.0
        alpha, E = error_dynamics(t, x, p)
        ds_dx_g = p.GB * E
        u_con = (-times(p.K, z) - alpha) / E
        u_dis = -(p.eta + (p.gamma0 + p.gamma1 * norm(z)) * abs(ds_dx_g)) * sgn(s) / ds_dx_g
        u = u_con + u_dis
        memory.v = alpha + E * u
        return u

    return law


@cache
def grosmc_tracker(error: ErrorCoordinates) -> Law:
    """GROSMC for tracking: the surface (51) and the law (55) in the feedback (44)."""
    error_state, error_dynamics = error.state, error.dynamics
    linearizable = error.system.linearizable

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        z = error_state(t, x, p)
        s = integral_surface(t, z, memory, p)
        if not linearizable(x):
            memory.undefined = 1.0
            return 0.0
        alpha, E = error_dynamics(t, x, p)
        v_c = -times(p.K, z)
        v_d = -(p.k * s + p.epsilon * sgn(s)) / p.GB
        v = v_c + v_d
        memory.v = v
        return (v - alpha) / E

    return law
