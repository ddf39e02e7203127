"""The laws of the chapter, each written once as (t, x, memory, p) -> u.

Every function here makes a law for given error coordinates, for any number of inputs. A law is
plain Python for one simulation; ``p`` is the parameter dataclass of its controller, ``memory``
belongs to the run. Made once per coordinates, so that the compiled engine compiles it once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.surface import integral_surface
from grosmc_mj.control.switching import Reach
from grosmc_mj.vectors import algebra, norm

# What a law regulates: outputs' errors through feedback linearization, or the whole state.
Coordinates = OutputCoordinates | StateCoordinates
# For one input u is a number, for more a tuple.
Law = Callable[[float, Any, Any, Any], Any]


@cache
def state_feedback(error: Coordinates) -> Law:
    """The optimal law of a linear plant, eq. (5): u = -K x, about its operating point."""
    error_state, applied, m = error.state, error.applied, error.inputs
    times, subtract, store, given = _operations(m)
    nothing = algebra(m).nothing

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        v = subtract(nothing, times(p.K, error_state(t, x, p)))
        store(memory.v, v)
        return given(applied(v, p))

    return law


@cache
def linearizing_feedback(error: OutputCoordinates) -> Law:
    """The optimal law through feedback linearization, eqs. (23)+(28) and (44)+(49)."""
    error_state, feedback = error.state, error.feedback
    times, subtract, store, given = _operations(error.inputs)
    nothing = algebra(error.inputs).nothing

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        v = subtract(nothing, times(p.K, error_state(t, x, p)))
        store(memory.v, v)
        return given(feedback(t, x, v, memory, p))

    return law


@cache
def grosmc_linear(error: Coordinates, reach: Reach) -> Law:
    """GROSMC of a linear plant, about its operating point: the surface (8) and the law (12).

    The surface supposes that the nominal input -K x is applied. Where an actuator cuts it off, s
    grows by what is missing, as an integrator winds up, and the switching term goes on paying it
    back when the limit is long past. So the nominal input is kept within ``p.limit``, in law and
    surface alike: s' = G (x' - A x - B u_0). Without a limit it is the printed law.
    """
    error_state, applied, m = error.state, error.applied, error.inputs
    surface = integral_surface(m, error.size)
    times, subtract, store, given = _operations(m)
    add, nothing, within = algebra(m).add, algebra(m).nothing, algebra(m).within

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        z = error_state(t, x, p)
        s = surface(t, z, memory, p)
        wanted = subtract(nothing, times(p.K, z))
        nominal = within(wanted, p.limit)
        # The surface has noted S z = G (A - B K) z for the time up to the next sample.
        missing = times(p.GB_held, subtract(nominal, wanted))
        for i in range(m):
            memory.rate[i] += missing[i]
        rho = p.eta + (p.gamma0 + p.gamma1 * norm(z)) * p.size_of_GB
        v_d = times(p.GB_inverse, reach(s, 0.0, rho, memory, p.switching))
        v = add(v_d, nominal)
        store(memory.v, v)
        return given(applied(v, p))

    return law


@cache
def grosmc_regulator(error: ErrorCoordinates, reach: Reach) -> Law:
    """GROSMC of an affine plant: the surface (31) and the law (37).

    With s of eq. (31), (ds/dx) g = G B E(x), and u_con of eq. (36) is E^-1 (v_0 - K(x)); so
    u_dis of eq. (37) is E^-1 v_d with G B v_d the rate that the switching law asks of s.
    """
    error_state, feedback, matrix = error.state, error.feedback, error.decoupling_matrix
    surface, product = integral_surface(error.inputs, error.size), algebra(error.inputs).product
    times, subtract, store, given = _operations(error.inputs)

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        z = error_state(t, x, p)
        s = surface(t, z, memory, p)
        ds_dx_g = product(p.GB, matrix(x, p))
        rho = p.eta + (p.gamma0 + p.gamma1 * norm(z)) * norm(ds_dx_g)
        v_d = times(p.GB_inverse, reach(s, 0.0, rho, memory, p.switching))
        v = subtract(v_d, times(p.K, z))
        store(memory.v, v)
        return given(feedback(t, x, v, memory, p))

    return law


@cache
def grosmc_tracker(error: OutputCoordinates, reach: Reach) -> Law:
    """GROSMC for tracking: the surface (51) and the law (55) in the feedback (44)."""
    error_state, feedback = error.state, error.feedback
    surface = integral_surface(error.inputs, error.size)
    times, subtract, store, given = _operations(error.inputs)

    def law(t: float, x: Any, memory: Any, p: Any) -> Any:
        z = error_state(t, x, p)
        s = surface(t, z, memory, p)
        v_d = times(p.GB_inverse, reach(s, p.k, p.epsilon, memory, p.switching))
        v = subtract(v_d, times(p.K, z))
        store(memory.v, v)
        return given(feedback(t, x, v, memory, p))

    return law


def _operations(m: int) -> tuple[Callable, Callable, Callable, Callable]:
    """What every law computes with: times, subtract, store, given."""
    found = algebra(m)
    return found.times, found.subtract, found.store, found.given
