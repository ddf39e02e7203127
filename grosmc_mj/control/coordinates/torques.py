"""A mechanical system's torques as a law that adapts its parameters asks for them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from grosmc_mj.arrays import Array
from grosmc_mj.jitable import jitable
from grosmc_mj.plants.parametrization import LinearParametrization


class LinearTorques(NamedTuple):
    """M(q) a + C(q, q') r + G(q) = known + Y theta, in the unit of the inputs.

    C is the matrix of Christoffel's symbols, so that M' - 2 C is skew-symmetric. All but
    ``inertia`` are jitable, and ``known`` and ``regressor`` take (x, r, a, memory, p): the state,
    reference rates and accelerations, the run's memory and the law's parameters.

    Attributes:
        size: k, the number of parameters.
        nominal: p -> theta by which the nominal plant's torques come out, k numbers.
        known: The torques that no unknown parameter has a part in, (m,).
        regressor: Y row by row, m k numbers.
        inertia: (q, plant's parameters) -> the nominal M(q), (m, m).
    """

    size: int
    nominal: Callable[[Any], Any]
    known: Callable[..., Any]
    regressor: Callable[..., Any]
    inertia: Callable[[Array, Any], Array]


@cache
def torques_of(found: LinearParametrization) -> LinearTorques:
    """The torques of a plant whose equations are written out: all of them are Y theta."""
    regressor, nominal = found.regressor, found.nominal
    nothing = (0.0,) * len(found.r)
    return LinearTorques(
        size=len(found.theta),
        nominal=jitable(lambda p: nominal(p.plant)),
        known=jitable(lambda x, r, a, memory, p: nothing),
        regressor=jitable(lambda x, r, a, memory, p: regressor(x, r, a, p.plant)),
        inertia=found.inertia,
    )
