"""One region map: the outcome of every start under one law on one plant."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.case import Case
from grosmc_mj.studies.region.outcome import Outcome

Outcomes = NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class RegionMap:
    """The outcome of every start under one law on one plant.

    Attributes:
        case: What is changed against the nominal plant.
        controller: Name of the law.
        grid: Letters of ``Outcome``, (second axis, first axis).
        line: Those of starts on the first axis alone, (4 * points,).
        line_starts: Their values on the first axis.
        seconds: Wall time.
        confirmed: Starts that MuJoCo judged, of all.
        overturned: Those of them of which the equations had said something else.
    """

    case: Case
    controller: str
    grid: Outcomes
    line: Outcomes
    line_starts: Array
    seconds: float
    confirmed: int = 0
    overturned: int = 0

    def counts(self) -> dict[Outcome, int]:
        """Starts of the grid with each outcome."""
        found = Counter(self.grid.ravel().tolist())
        return {outcome: found[outcome.value] for outcome in Outcome}

    def fractions(self) -> dict[Outcome, float]:
        """The same in parts of the grid."""
        return {outcome: count / self.grid.size for outcome, count in self.counts().items()}

    def rest_interval(self) -> tuple[float, float] | None:
        """The farthest starts on the first axis from which, and from all between, it converges.

        None if it does not converge from those next to zero.
        """
        good, middle = self.line == Outcome.CONVERGED.value, len(self.line) // 2
        if not (good[middle - 1] and good[middle]):
            return None
        wrong = np.flatnonzero(~good)
        below, above = wrong[wrong < middle], wrong[wrong >= middle]
        low = below[-1] + 1 if len(below) else 0
        high = above[0] - 1 if len(above) else len(good) - 1
        return float(self.line_starts[low]), float(self.line_starts[high])
