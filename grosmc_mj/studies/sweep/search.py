"""Search along a factor: it asks for factors, and is told which of them pass."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeVar

AnySearch = TypeVar("AnySearch", bound="Search")
# Factor between one that passes and one that fails; None if these are near enough.
Middle = Callable[[float, float], float | None]


class Search:
    """Search for the largest factor up to which all passes.

    Factors are tried in this order, and the search ends when none is left:

    1. a grid, which shows what fails and passes again;
    2. below a factor that fails its half, above one that passes its double;
    3. between one that passes and one that fails the middle;
    4. factors whose own answers are asked for;
    5. a finer grid in the octave below the first failure, for one may lie there.

    Args:
        middle: Returns the factor to try next between one that passes and one that fails.
        most: Largest factor.
        least: A failing factor of this size or less ends the search downwards.
        grid: Rising factors of the grid.
        surely: The grid is tried up to here in any case...
        beyond: ...and up to so many times the largest factor that passes.
        asked: Factors whose own answers are asked for.
        finer: Rising factors of the finer grid.
        same: Key that is equal for two factors that are one, such as a time on a timestep's grid.

    Attributes:
        known: Whether a factor passes, by factor.
    """

    def __init__(
        self,
        middle: Middle,
        most: float,
        *,
        least: float = 0.0,
        grid: Sequence[float] = (),
        surely: float = 1.0,
        beyond: float = 1.0,
        asked: Sequence[float] = (),
        finer: Sequence[float] = (),
        same: Callable[[float], Hashable] = lambda factor: factor,
    ) -> None:
        self.known: dict[float, bool] = {}
        self._middle = middle
        self._most = most
        self._least = least
        self._grid = grid
        self._surely = surely
        self._beyond = beyond
        self._asked = asked
        self._finer = finer
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

    def next_factors(self) -> list[float]:
        """Return the factors to be tried now; none when the search is done."""
        passing = [factor for factor, passes in self.known.items() if passes]
        end = max(self._surely, self._beyond * max(passing, default=self._least))
        untried = [x for x in self._grid if x <= end and x not in self.known]
        if untried:
            return untried

        nearer = self._towards_failure()
        if nearer:
            return nearer
        asked = [x for x in self._asked if x not in self.known]
        return asked or self._below_failure()

    def _towards_failure(self) -> list[float]:
        """The next factor between what passes and what fails; none if these are near enough."""
        low = self.largest
        high = self.failed
        if low is None and high is None:
            return []
        if low is None and high is not None:
            return [high / 2] if high > self._least else []
        if high is None and low is not None:
            return [min(2 * low, self._most)] if low < self._most else []

        assert low is not None
        assert high is not None
        middle = self._middle(low, high)
        if middle is None or self._same(middle) in {self._same(low), self._same(high)}:
            return []
        return [middle]

    def _below_failure(self) -> list[float]:
        """Factors of the finer grid in the octave below the first failure found."""
        largest = self.largest
        if not largest or self.failed is None:
            return []

        untried: list[float] = []
        seen = {self._same(factor) for factor in self.known}
        for factor in self._finer:
            if largest / 2 < factor < largest and self._same(factor) not in seen:
                seen.add(self._same(factor))
                untried.append(factor)
        return untried


def grid_of(least: float, most: float, per_octave: int) -> list[float]:
    """Return the least factor times fractions of powers of two, then the largest one."""
    octaves = math.log2(most / least)
    count = math.ceil(per_octave * octaves - 1e-9)
    return [*(least * 2.0 ** (i / per_octave) for i in range(count)), most]


def run_searches(
    searches: Sequence[AnySearch],
    passing: Callable[[list[tuple[AnySearch, float]]], Sequence[bool]],
) -> None:
    """Run searches to their ends.

    Args:
        searches: The searches.
        passing: Tells which factors of which searches pass; those of a round come together.
    """
    while True:
        tried = [(search, factor) for search in searches for factor in search.next_factors()]
        if not tried:
            return
        for (search, factor), passes in zip(tried, passing(tried), strict=True):
            search.known[factor] = passes


@dataclass(frozen=True)
class Halved:
    """Middle of a range, until it is narrow.

    Attributes:
        relative: Width that is narrow, over the lower end.
        absolute: Width that is narrow in any case.
    """

    relative: float
    absolute: float = 0.0

    def __call__(self, low: float, high: float) -> float | None:
        """Return the middle of a range; None if it is narrow."""
        if high - low <= max(self.relative * low, self.absolute):
            return None
        return (low + high) / 2


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
    search = Search(Halved(relative, absolute), most, grid=[first], surely=first)
    search.known[low] = True
    run_searches([search], lambda tried: [passes(factor) for _, factor in tried])

    assert search.largest is not None
    if search.failed is None:
        return search.largest, math.inf
    return search.largest, search.failed
