"""The largest factor up to which something passes."""

from __future__ import annotations

import math
from collections.abc import Callable


def largest_passing(
    passes: Callable[[float], bool],
    low: float,
    high: float,
    largest: float,
    relative: float,
    absolute: float = 0.0,
) -> tuple[float, float]:
    """Double a factor until it fails, then halve the range in which it fails first.

    Args:
        passes: Whether a factor passes.
        low: A factor that passes.
        high: The next one to be tried.
        largest: None is tried beyond this one.
        relative: Width of the range to reach, over its lower end.
        absolute: Width that is narrow in any case.

    Returns:
        The largest factor that passed, and the smallest one above it that failed: infinite if none
        did.
    """
    while passes(high):
        if high >= largest:
            return high, math.inf
        low, high = high, min(2 * high, largest)
    while high - low > max(relative * low, absolute):
        middle = (low + high) / 2
        low, high = (middle, high) if passes(middle) else (low, middle)
    return low, high
