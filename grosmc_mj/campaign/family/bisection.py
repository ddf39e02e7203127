"""Where along a factor something fails for the first time."""

from __future__ import annotations

from collections.abc import Callable


def narrowed(
    fails: Callable[[float], bool], low: float, high: float, relative: float, absolute: float = 0.0
) -> tuple[float, float]:
    """Halve the range between a factor that holds and one that fails until it is narrow.

    Args:
        fails: Whether it fails at a factor.
        low: A factor at which it holds.
        high: A larger one at which it fails.
        relative: Width to reach, over ``low``.
        absolute: Width that is narrow in any case.

    Returns:
        A factor at which it holds and the next one at which it fails.
    """
    while high - low > max(relative * low, absolute):
        middle = (low + high) / 2
        low, high = (low, middle) if fails(middle) else (middle, high)
    return low, high
