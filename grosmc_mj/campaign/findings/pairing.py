"""Two laws on the same plants: who keeps a requirement where the other does not."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.findings.checks import checked_margins, checked_share, same_length
from grosmc_mj.campaign.findings.replicates import INDEPENDENT, Draws, interval_of_mean
from grosmc_mj.campaign.findings.statistics import pass_rate


class PairedDifference(NamedTuple):
    """The second law less the first, plant by plant.

    Attributes:
      runs: Plants, each under both laws.
      both: Plants on which both keep the requirement.
      only_first: On which the first alone does.
      only_second: On which the second alone does.
      neither: On which none does.
      difference: Pass rate of the second less that of the first.
      low: Lower end of its interval; None if there is none.
      high: Upper end.
      p_value: Of independent runs McNemar's, exact: of a split of the plants that tell the laws
        apart at least as uneven, if neither law were better. Of replicates Student's, of means of
        the difference at least as far from zero. None if there is none.
      median: Median of margin of the second less margin of the first, in the margin's unit.
      median_low: Lower end of its interval, -inf if the runs give none; None if they are not
        independent.
      median_high: Upper end, inf if they give none.
      confidence: Of each interval.
      note: Why the difference of the rates has no interval.
    """

    runs: int
    both: int
    only_first: int
    only_second: int
    neither: int
    difference: float
    low: float | None
    high: float | None
    p_value: float | None
    median: float
    median_low: float | None
    median_high: float | None
    confidence: float
    note: str = ""


def paired(
    first: Any, second: Any, confidence: float = 0.95, draws: Draws = INDEPENDENT
) -> PairedDifference:
    """Compare the margins of two laws on the same plants.

    With b and c the plants that only the first and only the second keeps, the difference of the
    pass rates is (c - b) / n. Of independent runs its interval is conservative: the difference of
    the ends of two Clopper-Pearson intervals, of b / n and of c / n, each at 1 - alpha / 2 for
    alpha = 1 - confidence, so that both hold together with at least the confidence (Bonferroni);
    the interval of the median lies between two order statistics and assumes no distribution.
    Of replicates it is Student's over the replicates' own differences, inside -1 to 1.

    Args:
      first: Margins of the first law, (n,), -inf for a run that did not complete.
      second: Margins of the second, run by run on the same plants, (n,). If both runs of a plant
        did not complete, their difference counts as 0; if one, as -inf or inf.
      confidence: Of each interval, between 0 and 1.
      draws: How the plants were drawn.

    Raises:
      ArgumentError: If there are no margins, the lengths differ, one is NaN or +inf, or the
        confidence is no share.
    """
    checked_share("confidence", confidence)
    before = checked_margins("margins of the first law", first)
    after = checked_margins("margins of the second law", second)
    same_length("the first law", len(before), "the second", len(after))
    runs = len(before)
    b = int(np.count_nonzero((before >= 0) & (after < 0)))
    c = int(np.count_nonzero((before < 0) & (after >= 0)))
    both = int(np.count_nonzero((before >= 0) & (after >= 0)))
    changes = _changes(before, after)
    alone = (after >= 0).astype(float) - (before >= 0)
    return PairedDifference(
        runs=runs,
        both=both,
        only_first=b,
        only_second=c,
        neither=runs - both - b - c,
        difference=(c - b) / runs,
        **(
            _of_independent(b, c, changes, confidence)
            if draws.independent
            else _of_replicates(alone, draws, confidence)
        ),
        median=_median(changes),
        confidence=confidence,
    )


def _of_independent(b: int, c: int, changes: Array, confidence: float) -> dict[str, Any]:
    """Intervals and p-value of independent runs."""
    runs, each = len(changes), 1 - (1 - confidence) / 2
    worse, better = pass_rate(b, runs, each), pass_rate(c, runs, each)
    assert worse.low is not None
    assert worse.high is not None
    assert better.low is not None
    assert better.high is not None
    return {
        "low": better.low - worse.high,
        "high": better.high - worse.low,
        "p_value": float(stats.binomtest(b, b + c).pvalue) if b + c else 1.0,
        **_interval(changes, confidence),
    }


def _of_replicates(alone: Array, draws: Draws, confidence: float) -> dict[str, Any]:
    """The same of replicates; of what is neither there is none."""
    found = interval_of_mean(alone, draws, confidence)
    return {
        "low": None if found.low is None else max(found.low, -1.0),
        "high": None if found.high is None else min(found.high, 1.0),
        "p_value": found.p_value,
        "median_low": None,
        "median_high": None,
        "note": found.note,
    }


def _changes(before: Array, after: Array) -> Array:
    """The margins' differences; two runs that did not complete differ by nothing."""
    changes = np.zeros(len(before))
    np.subtract(after, before, out=changes, where=(before > -np.inf) | (after > -np.inf))
    return changes


def _median(changes: Array) -> float:
    """The middle one, or the mean of the two; of -inf and inf, 0: one way as often as the other."""
    rising = np.sort(changes)
    low, high = rising[(len(rising) - 1) // 2], rising[len(rising) // 2]
    if math.isinf(low) and low == -high:
        return 0.0
    return float(low if low == high else (low + high) / 2)


def _interval(changes: Array, confidence: float) -> dict[str, float]:
    """The median's interval; too few runs leave an end open, which SciPy calls NaN."""
    found = stats.quantile_test(changes, q=0, p=0.5).confidence_interval(confidence)
    return {
        "median_low": -math.inf if np.isnan(found.low) else float(found.low),
        "median_high": math.inf if np.isnan(found.high) else float(found.high),
    }
