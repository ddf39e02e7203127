"""The one search along a factor: it asks for factors, and is told which of them pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable
from itertools import groupby


class Search:
    """Search for the largest factor up to which all passes.

    Args:
        most: Largest factor.
        middle: Of a factor that passes and one that fails, where to look next.
        narrow: Whether two such factors are as near as is wanted.
        first: Factor to begin with.
        least: A failing factor of this size or less ends the search downwards.
        same: Key that is equal for two factors that are one, such as a time on a timestep's grid.

    Attributes:
        known: Whether a factor passes, by factor.
    """

    def __init__(
        self,
        most: float,
        middle: Callable[[float, float], float],
        narrow: Callable[[float, float], bool],
        first: float | None = None,
        least: float = 0.0,
        same: Callable[[float], Hashable] = lambda factor: factor,
    ) -> None:
        self.known: dict[float, bool] = {}
        self._most, self._middle, self._narrow = most, middle, narrow
        self._first, self._least, self._same = first, least, same

    @property
    def failed(self) -> float | None:
        """The smallest factor that fails; None if none that was tried does."""
        return min((factor for factor, kept in self.known.items() if not kept), default=None)

    @property
    def largest(self) -> float | None:
        """The largest factor below the first that fails; None if the first one fails."""
        end = math.inf if self.failed is None else self.failed
        return max((factor for factor in self.known if factor < end), default=None)

    @property
    def again(self) -> list[tuple[float, float]]:
        """Where all passes again beyond the first failure: first and last factor of each range."""
        beyond = [f for f in sorted(self.known) if self.failed is not None and f > self.failed]
        ranges = [(kept, list(factors)) for kept, factors in groupby(beyond, self.known.get)]
        return [(factors[0], factors[-1]) for kept, factors in ranges if kept]

    def on_grid(self, beyond: float) -> list[float]:
        """Factors to be tried now, of a grid of powers of two first: it shows what passes again.

        Args:
            beyond: The grid ends at so many times the largest factor that passes.
        """
        count = math.ceil(math.log2(self._most / self._least) - 1e-9)
        grid = [factor for i in range(count) if (factor := self._least * 2**i) > 0] + [self._most]
        passing = [factor for factor, kept in self.known.items() if kept]
        end = max(1.0, beyond * max(passing, default=self._least))
        return [x for x in grid if 0 < x <= end and x not in self.known] or self._between()

    def factors(self) -> list[float]:
        """Factors to be tried now: the first, then down to one that passes, up to one that fails.

        None when the search is done.
        """
        low, high = self.largest, self.failed
        if self._first is not None and self._first not in self.known:
            return [self._first]
        if low is None and high is not None:
            return [high / 2] if high > self._least else []
        if high is None and low is not None and low < self._most:
            return [min(2 * low, self._most)]
        return self._between()

    def _between(self) -> list[float]:
        low, high = self.largest, self.failed
        if low is None or high is None or self._narrow(low, high):
            return []
        middle = self._middle(low, high)
        return [] if self._same(middle) in {self._same(low), self._same(high)} else [middle]


def largest_passing(
    passes: Callable[[float], bool],
    low: float,
    first: float,
    most: float,
    relative: float,
    absolute: float = 0.0,
) -> tuple[float, float]:
    """Double a factor until it fails, then halve the range in which it fails first.

    Args:
        passes: Whether a factor passes.
        low: A factor that passes.
        first: The next one to be tried.
        most: None is tried beyond this one.
        relative: Width of the range to reach, over its lower end.
        absolute: Width that is narrow in any case.

    Returns:
        The largest factor that passed, and the smallest one above it that failed: infinite if none
        did.
    """
    search = Search(
        most,
        lambda low, high: (low + high) / 2,
        lambda low, high: high - low <= max(relative * low, absolute),
        first,
    )
    search.known[low] = True
    while factors := search.factors():
        search.known |= {factor: passes(factor) for factor in factors}
    assert search.largest is not None
    return search.largest, math.inf if search.failed is None else search.failed
