"""Bounces: a spring and a damper that push and never pull, as MuJoCo's constraints."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

# A damping ratio from which a bounce is none: 1 % of the speed comes back.
_DEAD = 5.0
# MuJoCo's largest impedance: a constraint moves as its spring and damper say.
IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)

# Restitution and duration [s] of teeth that do not give way.
TEETH = (0.1, 4e-3)


def restitution_of(ratio: float) -> float:
    """Speed after a bounce over that before it, for a damping ratio of the contact.

    The contact ends when its force would become negative: T. Schwager and T. Poeschel, "Coefficient
    of restitution and linear-dashpot model revisited", Granular Matter 9, 2007.
    """
    if ratio == 1:
        return math.exp(-2)
    if ratio < 1:
        other = math.sqrt(1 - ratio * ratio)
        return math.exp(-ratio / other * math.atan2(2 * ratio * other, 2 * ratio * ratio - 1))
    other = math.sqrt(ratio * ratio - 1)
    return (ratio + other) ** (-2 * ratio / other)


@cache
def spring_and_damper(restitution: float, duration: float) -> tuple[float, float]:
    """Stiffness [1/s^2] and damping [1/s] over mass of a contact.

    Args:
        restitution: Speed after a bounce over that before it; less than 1 % is 1 %.
        duration: Of a bounce without loss [s].
    """
    frequency = math.pi / duration
    ratio = _DEAD
    if restitution > restitution_of(_DEAD):
        # Here, for it is a part of scipy that little needs.
        from scipy.optimize import brentq

        root: Any = brentq(lambda r: restitution_of(float(r)) - restitution, 0.0, _DEAD)
        ratio = float(root)
    return frequency**2, 2 * ratio * frequency


def solref(restitution: float, duration: float) -> tuple[float, float]:
    """The same as MuJoCo's ``solref``, whose negative numbers are stiffness and damping."""
    stiffness, damping = spring_and_damper(restitution, duration)
    return -stiffness, -damping
