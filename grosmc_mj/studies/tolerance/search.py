"""The largest amount of something up to which all is kept, from below.

A coarse grid first, so that amounts beyond the first that fails are seen too, then bisection.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from typing import NamedTuple

# The grid: factors on what the bench has.
LEAST, MOST = 2.0**-4, 2.0**10
# What is tried beyond the last factor that is kept, before the rest is left.
BEYOND = 2.0**5
# Between the largest that is kept and the smallest that fails.
RESOLUTION = 2.0**0.125


class Span(NamedTuple):
    """Factors beyond the first failure at which all is kept again.

    Attributes:
        low: The smallest that was tried.
        high: The largest that was tried.
    """

    low: float
    high: float


class Search:
    """What is to be tried next, and what came out.

    Args:
        most: Where the factor ends; the physical bound of what it scales.
        same: What two factors have in common that are one: a time on the timestep's grid.

    Attributes:
        known: Whether all is kept, by factor.
    """

    def __init__(
        self, most: float = MOST, same: Callable[[float], Hashable] = lambda factor: factor
    ) -> None:
        self.most, self._same = min(most, MOST), same
        self.known: dict[float, bool] = {}

    @property
    def grid(self) -> list[float]:
        """Factors from the least to the most, each twice the one before."""
        count = math.ceil(math.log2(self.most / LEAST) - 1e-9)
        found = [LEAST * 2**i for i in range(count)] + [self.most]
        return [factor for factor in found if factor > 0]

    def told(self, factor: float, *, kept: bool) -> None:
        """Note what came out."""
        self.known[factor] = kept

    @property
    def largest(self) -> float | None:
        """The largest factor below which all that was tried is kept; None if the first fails."""
        found = None
        for factor in sorted(self.known):
            if not self.known[factor]:
                break
            found = factor
        return found

    @property
    def failed(self) -> float | None:
        """The smallest factor that fails; None if none that was tried does."""
        return min((factor for factor, kept in self.known.items() if not kept), default=None)

    @property
    def again(self) -> list[Span]:
        """Where all is kept again beyond the first failure."""
        found: list[Span] = []
        inside = False
        for factor in sorted(self.known):
            if self.failed is None or factor < self.failed:
                continue
            if self.known[factor]:
                found = [*found[:-1], Span(found[-1].low, factor)] if inside else [
                    *found, Span(factor, factor)
                ]  # fmt: skip
            inside = self.known[factor]
        return found

    @property
    def tried(self) -> float:
        """The largest factor that was tried."""
        return max(self.known, default=0.0)

    def asks(self) -> list[float]:
        """Factors to be tried now; none when it is done."""
        return self._of_grid() or self._between()

    def local(self) -> list[float]:
        """The same without a grid: from what is known down to what is kept, up to what fails."""
        low, high = self.largest, self.failed
        if low is None and high is not None:
            return [high / 2] if high > LEAST else []
        if high is None and low is not None and low < self.most:
            return [min(2 * low, self.most)]
        return self._between()

    def _of_grid(self) -> list[float]:
        """What of the grid is still to be tried, as far as it says anything."""
        kept = [factor for factor, kept in self.known.items() if kept]
        end = BEYOND * max(max(kept, default=LEAST), 1.0 / BEYOND)
        return [factor for factor in self.grid if factor not in self.known and factor <= end]

    def _between(self) -> list[float]:
        """The middle between the largest that is kept and the smallest that fails."""
        low, high = self.largest, self.failed
        if low is None or high is None or high / low <= RESOLUTION * (1 + 1e-9):
            return []
        middle = math.sqrt(low * high)
        return [] if self._same(middle) in {self._same(low), self._same(high)} else [middle]
