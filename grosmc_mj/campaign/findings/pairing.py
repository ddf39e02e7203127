"""Two laws on the same plants: who keeps a requirement where the other does not."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.findings.statistics import Margins, Share, sorted_margins
from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import checked_call


class PairedDifference(NamedTuple):
    """The second law less the first, plant by plant.

    Attributes:
      runs: Plants, each under both laws.
      both: Plants on which both keep the requirement.
      only_first: On which the first alone does.
      only_second: On which the second alone does.
      neither: On which none does.
      difference: Pass rate of the second less that of the first.
      median: Median of margin of the second less margin of the first, in the margin's unit.
      confidence: Of each interval.
      low: Lower end of the interval of the difference; this and what follows is None where runs
        are not independent.
      high: Upper end.
      p_value: McNemar's, exact: of a split of the plants that tell the laws apart at least as
        uneven, if neither law were better.
      median_low: Lower end of the interval of the median, -inf if the runs give none.
      median_high: Upper end, inf if they give none.
    """

    runs: int
    both: int
    only_first: int
    only_second: int
    neither: int
    difference: float
    median: float
    confidence: float
    low: float | None = None
    high: float | None = None
    p_value: float | None = None
    median_low: float | None = None
    median_high: float | None = None


def mcnemar(only_first: int, only_second: int) -> float:
    """McNemar's exact p-value: of runs that differ, each side has as many but for chance."""
    differing = only_first + only_second
    return float(stats.binomtest(only_first, differing).pvalue) if differing else 1.0


@checked_call
def paired(
    first: Margins, second: Margins, confidence: Share = 0.95, *, independent: bool = True
) -> PairedDifference:
    """Compare the margins of two laws on the same plants.

    With b and c the plants that only the first and only the second keeps, the difference of the
    pass rates is (c - b) / n. Its interval is conservative: the difference of the ends of two
    Clopper-Pearson intervals, of b / n and of c / n, each at 1 - alpha / 2 for alpha =
    1 - confidence, so that both hold together with at least the confidence (Bonferroni). The
    interval of the median lies between two order statistics and assumes no distribution.

    Args:
      first: Margins of the first law, (n,), -inf for a run that did not complete.
      second: Margins of the second, run by run on the same plants, (n,). If both runs of a plant
        did not complete, their difference counts as 0; if one, as -inf or inf.
      confidence: Of each interval, between 0 and 1.
      independent: Whether the plants were drawn independently; others give no interval and no p.

    Raises:
      ArgumentError: If there are no margins, the lengths differ, one is NaN or +inf, or the
        confidence is no share.
    """
    for name, margins in (("first", first), ("second", second)):
        sorted_margins(name, margins)
    runs = len(first)
    if runs != len(second):
        raise ArgumentError(f"first has {runs} margins and second {len(second)}: give one a run")
    both, only_first, only_second = (
        int(np.count_nonzero(plants))
        for plants in (
            (first >= 0) & (second >= 0),
            (first >= 0) & (second < 0),
            (first < 0) & (second >= 0),
        )
    )
    changes = np.zeros(runs)
    np.subtract(second, first, out=changes, where=(first > -np.inf) | (second > -np.inf))
    difference = PairedDifference(
        runs, both, only_first, only_second, runs - both - only_first - only_second,
        (only_second - only_first) / runs, _median(changes), confidence,
    )  # fmt: skip
    if not independent:
        return difference
    (worse_low, worse_high), (better_low, better_high) = (
        stats.binomtest(count, runs).proportion_ci(1 - (1 - confidence) / 2)
        for count in (only_first, only_second)
    )
    ends: Any = stats.quantile_test(changes, q=0, p=0.5).confidence_interval(confidence)
    return difference._replace(
        low=float(better_low - worse_high),
        high=float(better_high - worse_low),
        p_value=mcnemar(only_first, only_second),
        # Too few runs leave an end open, which SciPy calls NaN.
        median_low=-math.inf if np.isnan(ends.low) else float(ends.low),
        median_high=math.inf if np.isnan(ends.high) else float(ends.high),
    )


def _median(changes: Array) -> float:
    """The middle one, or the mean of the two; of -inf and inf, 0: one way as often as the other."""
    rising = np.sort(changes)
    low, high = float(rising[(len(rising) - 1) // 2]), float(rising[len(rising) // 2])
    return low if low == high else 0.0 if low == -high else (low + high) / 2
