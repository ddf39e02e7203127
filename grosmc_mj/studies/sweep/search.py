"""Search along a factor: it asks for factors, and is told which of them pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable


class Search:
    """Search for the largest factor up to which all passes.

    Args:
        most: Largest factor.
        middle: Factor to try next between one that passes and one that fails.
        narrow: Whether two such factors are as near as is wanted.
        first: Factor to begin with.
        least: A failing factor of this size or less ends the search downwards.
        per_octave: Factors of the grid in an octave.
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
        per_octave: int = 1,
        same: Callable[[float], Hashable] = lambda factor: factor,
    ) -> None:
        self.known: dict[float, bool] = {}
        self._most = most
        self._middle = middle
        self._narrow = narrow
        self._first = first
        self._least = least
        self._per_octave = per_octave
        self._same = same

    @property
    def failed(self) -> float | None:
        """The smallest factor that was tried and fails; None if none does."""
        failing = [factor for factor, passes in self.known.items() if not passes]
        return min(failing, default=None)

    @property
    def largest(self) -> float | None:
        """The largest factor below the first that fails; None if the first one fails."""
        end = self.failed
        if end is None:
            end = math.inf
        return max((factor for factor in self.known if factor < end), default=None)

    @property
    def again(self) -> list[tuple[float, float]]:
        """Ranges beyond the first failure in which all passes: first and last factor of each."""
        ranges: list[tuple[float, float]] = []
        failed = False
        in_range = False
        for factor in sorted(self.known):
            if not self.known[factor]:
                failed = True
                in_range = False
            elif failed and in_range:
                first, _ = ranges.pop()
                ranges.append((first, factor))
            elif failed:
                in_range = True
                ranges.append((factor, factor))
        return ranges

    def on_grid(self, beyond: float) -> list[float]:
        """Factors to be tried now, of a grid first: it shows what fails and passes again.

        Args:
            beyond: The grid ends at so many times the largest factor that passes.
        """
        passing = [factor for factor, passes in self.known.items() if passes]
        end = max(1.0, beyond * max(passing, default=self._least))
        grid = self._grid(self._per_octave)
        untried = [x for x in grid if 0 < x <= end and x not in self.known]
        return untried or self._between()

    def finely(self, per_octave: int) -> list[float]:
        """Factors to be tried in the octave below the first failure found: one may lie there.

        Args:
            per_octave: Factors of the finer grid in an octave.
        """
        largest = self.largest
        if not largest or self.failed is None:
            return []

        untried: list[float] = []
        seen = {self._same(factor) for factor in self.known}
        for factor in self._grid(per_octave):
            if largest / 2 < factor < largest and self._same(factor) not in seen:
                seen.add(self._same(factor))
                untried.append(factor)
        return untried

    def _grid(self, per_octave: int) -> list[float]:
        """The least factor times fractions of powers of two, then the largest one."""
        octaves = math.log2(self._most / self._least)
        count = math.ceil(per_octave * octaves - 1e-9)
        return [*(self._least * 2.0 ** (i / per_octave) for i in range(count)), self._most]

    def factors(self) -> list[float]:
        """Factors to be tried now: the first, then down to one that passes, up to one that fails.

        None when the search is done.
        """
        if self._first is not None and self._first not in self.known:
            return [self._first]

        low = self.largest
        high = self.failed
        if low is None and high is not None:
            return [high / 2] if high > self._least else []
        if high is None and low is not None and low < self._most:
            return [min(2 * low, self._most)]
        return self._between()

    def _between(self) -> list[float]:
        """The factor between a passing and a failing one; none if they are near enough."""
        low = self.largest
        high = self.failed
        if low is None or high is None or self._narrow(low, high):
            return []

        middle = self._middle(low, high)
        if self._same(middle) in {self._same(low), self._same(high)}:
            return []
        return [middle]


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
        middle=lambda low, high: (low + high) / 2,
        narrow=lambda low, high: high - low <= max(relative * low, absolute),
        first=first,
    )
    search.known[low] = True
    while factors := search.factors():
        for factor in factors:
            search.known[factor] = passes(factor)

    assert search.largest is not None
    if search.failed is None:
        return search.largest, math.inf
    return search.largest, search.failed
