"""Design models: the plant as a law knows it, which observers and predictions move by a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable

# Jitable (t, x, u, h, memory, p, own): move x, (n,), by h [s] under the input u, (m,), with memory
# and numbers p of the law and ``own`` of the model.
Advance = Callable[[float, Any, Any, float, Any, Any, Any], None]


class DesignModel(NamedTuple):
    """Motion of a design model.

    Attributes:
        advance: Moves a state.
        own: Scratch space of ``advance``, 2 n numbers, then the numbers of the model.
    """

    advance: Advance
    own: Array


def midpoint(slope_at: Callable[[Any, Any, Any, Any, Any], None]) -> Advance:
    """One step of the midpoint rule with a jitable (x, u, numbers, p, slope)."""

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        n = len(x)
        slope = own[:n]
        stage = own[n : 2 * n]
        numbers = own[2 * n :]
        slope_at(x, u, numbers, p, slope)
        for i in range(n):
            stage[i] = x[i] + 0.5 * h * slope[i]
        slope_at(stage, u, numbers, p, slope)
        for i in range(n):
            x[i] += h * slope[i]

    return advance
