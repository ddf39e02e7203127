"""Row of a law that was tuned."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pydantic import BaseModel

from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.tune.shares import TriedDesign

# Steps of verdicts: the numbers of the file, and those that were found.
AS_IN_FILE = "as in the file"
TUNED = "tuned"


class TunedNumberRow(BaseModel):
    """Number of a law before and after.

    Attributes:
        path: Place in the law's table.
        unit: Its unit.
        before: Value in the file; None if the file has none.
        after: Value of the best design.
        low: Least value of its range, as far as it has grown.
        high: Largest value.
        grown: Whether the range has grown.
        at_end: Whether the best design lies at an end of the range, which cannot grow.
        logarithmic: Whether it was searched by its logarithm.
    """

    path: str
    unit: str
    before: float | None
    after: float
    low: float
    high: float
    grown: bool
    at_end: bool
    logarithmic: bool

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate of the search."""
        if not self.logarithmic:
            return coordinate
        sign = math.copysign(1.0, self.after)
        return sign * 10.0 ** (sign * coordinate)


class TunedLaw(BaseModel):
    """Row of a law.

    Attributes:
        law: Name of the law.
        numbers: Its numbers.
        share: Share of the tightest limit of the best design, on the draws it was tuned on.
        history: Each best design when it was found: runs so far, and its share.
        designs: Designs that were tried, in their order.
        best: Index of the best one.
        runs: Runs of the search.
        before: Verdicts on the numbers of the file on other draws, by condition.
        after: Verdicts on the best design on these draws; none if the search was interrupted.
        complete: False if the search was interrupted.
    """

    law: str
    numbers: list[TunedNumberRow]
    share: float
    history: list[tuple[int, float]]
    designs: list[TriedDesign]
    best: int
    runs: int
    before: list[Verdict] = []
    after: list[Verdict] = []
    complete: bool = True

    @property
    def found(self) -> bool:
        """Whether all is kept on the draws that the law was tuned on."""
        return self.share <= 1

    @property
    def kept(self) -> bool:
        """Whether all is kept on the other draws, too."""
        return self.found and bool(self.after) and all(row.kept for row in self.after)

    @property
    def values(self) -> dict[str, float]:
        """The numbers of the best design, by path."""
        return found_values(self.numbers)


def found_values(numbers: Sequence[TunedNumberRow]) -> dict[str, float]:
    """Return the values that a search found, by path."""
    return {number.path: number.after for number in numbers}
