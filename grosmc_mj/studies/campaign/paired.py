"""Two laws on the same plants: differences of their pass rates and margins."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.tables import Table, names, numbers, table, text
from grosmc_mj.studies.sweep.sampled import SampledRuns, between, p_value_words


class PairedDifference(NamedTuple):
    """Difference of two laws, the second less the first, plant by plant.

    Attributes:
      runs: Plants, each under both laws.
      both: Plants on which both keep the requirement.
      only_first: Plants on which the first alone does.
      only_second: Plants on which the second alone does.
      neither: Plants on which none does.
      difference: Pass rate of the second less that of the first.
      median: Median of margin of the second less margin of the first, in the margin's unit.
      confidence: Of each interval.
      low: Lower end of the interval of the difference; this and what follows is None where runs
        are not independent.
      high: Upper end.
      p_value: McNemar's, exact: probability of a split at least as uneven of the plants that tell
        the laws apart, if neither law were better.
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
    """McNemar's exact p-value: each side has as many of the runs that differ, but for chance."""
    differing = only_first + only_second
    if not differing:
        return 1.0
    return float(stats.binomtest(only_first, differing).pvalue)


def paired(
    first: Array,
    second: Array,
    confidence: float = 0.95,
    *,
    independent: bool = True,
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
    """
    runs = len(first)
    first_keeps = first >= 0
    second_keeps = second >= 0
    both = int(np.count_nonzero(first_keeps & second_keeps))
    only_first = int(np.count_nonzero(first_keeps & ~second_keeps))
    only_second = int(np.count_nonzero(~first_keeps & second_keeps))

    # Where neither run completed the difference stays 0.
    changes = np.zeros(runs)
    either_completed = (first > -np.inf) | (second > -np.inf)
    np.subtract(second, first, out=changes, where=either_completed)

    difference = PairedDifference(
        runs=runs,
        both=both,
        only_first=only_first,
        only_second=only_second,
        neither=runs - both - only_first - only_second,
        difference=(only_second - only_first) / runs,
        median=_median(changes),
        confidence=confidence,
    )
    if not independent:
        return difference

    each_confidence = 1 - (1 - confidence) / 2
    worse = stats.binomtest(only_first, runs).proportion_ci(each_confidence)
    better = stats.binomtest(only_second, runs).proportion_ci(each_confidence)
    median: Any = stats.quantile_test(changes, q=0, p=0.5).confidence_interval(confidence)
    return difference._replace(
        low=float(better.low - worse.high),
        high=float(better.high - worse.low),
        p_value=mcnemar(only_first, only_second),
        # Too few runs leave an end open, which SciPy calls NaN.
        median_low=-math.inf if np.isnan(median.low) else float(median.low),
        median_high=math.inf if np.isnan(median.high) else float(median.high),
    )


def _median(changes: Array) -> float:
    """The middle value, or the mean of both; 0 of -inf and inf, each way being as frequent."""
    rising = np.sort(changes)
    low = float(rising[(len(rising) - 1) // 2])
    high = float(rising[len(rising) // 2])
    if low == high:
        return low
    if low == -high:
        return 0.0
    return (low + high) / 2


def paired_table(
    differences: Mapping[tuple[str, str, str], PairedDifference],
    units: Mapping[str, str],
    sampled: SampledRuns,
) -> Table:
    """Return laws against each other on the same plants.

    Args:
        differences: Differences by requirement, first and second law.
        units: Units of margins, by requirement.
        sampled: The runs.
    """
    rows = [
        (
            requirement,
            f"{first},\n{second}",
            *_cells(difference, units[requirement]),
        )
        for (requirement, first, second), difference in differences.items()
    ]
    headers = ("only\nfirst", "only\nsecond", "pass rate\n[% points]", "p", "median of\nmargins")
    return table(
        "Two laws on the same plants: second less first",
        [*text("requirement"), *names("laws"), *numbers(*headers)],
        rows,
        grouped=True,
        legend="Only: plants on which one law alone keeps the requirement. In brackets: intervals, "
        "of the rates two of Clopper and Pearson together, of the median by order statistics; p: "
        f"McNemar's, exact. All requirements: of each law its own.\n{sampled.sentences}",
    )


def _cells(pair: PairedDifference, unit: str) -> list[str]:
    """Counts, difference of the pass rates, its p, and median difference of the margins."""
    low = high = None
    if pair.low is not None and pair.high is not None:
        low = 100 * pair.low
        high = 100 * pair.high
    return [
        str(pair.only_first),
        str(pair.only_second),
        between("", 100 * pair.difference, low, high),
        p_value_words(pair.p_value),
        between(unit, pair.median, pair.median_low, pair.median_high),
    ]
