"""Integral sliding mode beside an actuator's limit: a nominal input that the actuator can apply.

The surface (8) supposes that the nominal input -K x is applied. Where the actuator cuts it off, s
grows by what is missing, as an integrator winds up, and the switching term goes on paying it back
when the limit is long past. Here the nominal input is the limited one, in law and surface alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

from grosmc_mj.control import laws
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.surface import integral_surface
from grosmc_mj.control.switching import Reach
from grosmc_mj.control.task import BoundedParameters
from grosmc_mj.errors import GainError
from grosmc_mj.vectors import norm, row_times


@dataclass(frozen=True, eq=False)
class LimitedParameters(BoundedParameters):
    """Numbers of the law with a limited nominal input.

    Attributes:
        limit: Largest nominal input, in the unit of the input.
    """

    limit: float


def limited(controller: Controller, limit: float) -> Controller:
    """Section 2's sliding mode on all states with |u_0| <= limit.

    Args:
        controller: The law (12) for one input, as printed, such as ``holding_ism``.
        limit: Less than the actuator's own, so that the switching term has a share.

    Raises:
        GainError: If the limit is not positive, or the law is another.
    """
    p, design = controller.parameters, controller.designed
    error = design.error
    if not (isinstance(p, BoundedParameters) and isinstance(error, StateCoordinates)):
        raise GainError(f"{controller.name}: only the law (12) on the state can be limited")
    if not (math.isfinite(limit) and limit > 0) or len(p.K) != 1:
        raise GainError(f"limit {limit:g} of one input must be finite and positive")
    with_reach = partial(limited_sliding_mode, error)
    return replace(
        controller,
        law=with_reach(p.switching.reach(1)),
        parameters=LimitedParameters(**vars(p), limit=float(limit)),
        design=replace(
            design,
            with_reach=with_reach,
            source="eqs. (8)+(12) with a limited nominal input",
            gains={**design.gains, "limit": float(limit)},
        ),
    )


@cache
def limited_sliding_mode(error: StateCoordinates, reach: Reach) -> laws.Law:
    """u = u_0 + u_d with u_0 = -K x within the limit, and s' = G (x' - A x - B u_0).

    Within the limit it is ``laws.grosmc_linear``.
    """
    error_state, surface = error.state, integral_surface(1, error.size)

    def law(t: float, x: Any, memory: Any, p: Any) -> float:
        z = error_state(t, x, p)
        s = surface(t, z, memory, p)
        wanted = -row_times(0, p.K, z)
        nominal = min(p.limit, max(-p.limit, wanted))
        # The surface has noted S z = G (A - B K) z for the time up to the next sample.
        memory.rate[0] += p.GB[0, 0] * (nominal - wanted)
        rho = p.eta + (p.gamma0 + p.gamma1 * norm(z)) * p.size_of_GB
        u = nominal + p.GB_inverse[0, 0] * reach(s, 0.0, rho, memory, p.switching)[0]
        memory.v[0] = u
        return u

    return law
