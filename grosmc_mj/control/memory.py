"""What a law remembers between two samples; it belongs to the run, never to the law."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from grosmc_mj.arrays import Array


@dataclass
class Memory:
    """Memory of a law without dynamics. Every field is recorded at every sample.

    Attributes:
        v: The input that the law's quadratic index weighs: u, or the v of eqs. (23) and (44).
        undefined: 1 once the law has met a state where it is not defined, else 0.
    """

    v: float = 0.0
    undefined: float = 0.0


@dataclass
class SurfaceMemory(Memory):
    """Memory of the integral surface, eqs. (8), (31) and (51).

    Attributes:
        s: The sliding variable at the last sample.
        z0: The error state at t = 0, (2,).
        integral: Of G (A - B K) z up to the last sample.
        rate: The integrand at the last sample.
        t: Time of the last sample [s].
    """

    s: float = 0.0
    z0: Array = field(default_factory=lambda: np.zeros(2))
    integral: float = 0.0
    rate: float = 0.0
    t: float = 0.0
