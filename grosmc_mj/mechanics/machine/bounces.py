"""Bounces: a spring and a damper that push and never pull, as MuJoCo's constraints."""

from __future__ import annotations

import math
from typing import Any

# A damping ratio from which a bounce is none: 1 % of the speed comes back.
_DEAD = 5.0


def restitution_of(ratio: float) -> float:
    """Coefficient of restitution of a contact: speed after a bounce over that before it.

    The contact ends when its force would become negative: T. Schwager and T. Poeschel, "Coefficient
    of restitution and linear-dashpot model revisited", Granular Matter 9, 2007.
    """
    if ratio == 1:
        return math.exp(-2)
    if ratio < 1:
        root = math.sqrt(1 - ratio * ratio)
        angle = math.atan2(2 * ratio * root, 2 * ratio * ratio - 1)
        return math.exp(-ratio / root * angle)
    root = math.sqrt(ratio * ratio - 1)
    return (ratio + root) ** (-2 * ratio / root)


def spring_and_damper(restitution: float, duration: float) -> tuple[float, float]:
    """Compute stiffness [1/s^2] and damping [1/s] of a contact, both over mass.

    Args:
        restitution: Speed after a bounce over that before it; less than 1 % is 1 %.
        duration: Duration of a bounce without loss [s].
    """
    frequency = math.pi / duration
    ratio = _DEAD
    if restitution > restitution_of(_DEAD):
        # Imported in the function, for few runs need this part of scipy.
        from scipy.optimize import brentq

        root: Any = brentq(lambda r: restitution_of(float(r)) - restitution, 0.0, _DEAD)
        ratio = float(root)
    return frequency**2, 2 * ratio * frequency


def solref(restitution: float, duration: float) -> tuple[float, float]:
    """Return a contact as MuJoCo's ``solref``, whose negative numbers are its spring and damper."""
    stiffness, damping = spring_and_damper(restitution, duration)
    return -stiffness, -damping
