"""Reference trajectories y_r(t) with the two derivatives that the laws need (Assumption 8)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from grosmc_mj.jitable import jitable

ReferenceFunction = Callable[[float, Any], tuple[float, float, float]]


@dataclass(frozen=True)
class Setpoint:
    """A constant reference.

    Attributes:
        value: y_r, in the unit of the output.
    """

    value: float = 0.0


@jitable
def setpoint(t: float, p: Any) -> tuple[float, float, float]:
    """(y_r, y_r', y_r'') of a ``Setpoint``."""
    return (p.value, 0.0, 0.0)


@dataclass(frozen=True)
class Sine:
    """y_r = amplitude sin(frequency t).

    Attributes:
        amplitude: In the unit of the output.
        frequency: [rad/s].
    """

    amplitude: float
    frequency: float


@jitable
def sine(t: float, p: Any) -> tuple[float, float, float]:
    """(y_r, y_r', y_r'') of a ``Sine``."""
    w = p.frequency
    s, c = math.sin(w * t), math.cos(w * t)
    return (p.amplitude * s, p.amplitude * w * c, -p.amplitude * w * w * s)
