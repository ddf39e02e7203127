"""Pass rates and margins of one law under one requirement, with intervals of independent runs."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import Range, Reals, checked_call

# The worst part whose mean is the CVaR [%].
TAIL = 5

Share = Annotated[float, Range(0, 1, above=True, below=True)]
Count = Annotated[int, Range(0, whole=True)]
# Signed margins, one a run; -inf stands for a run that did not complete.
Margins = Annotated[Array, Reals((None,), infinite=True)]


class PassRate(NamedTuple):
    """How many runs kept a requirement.

    Attributes:
      kept: Runs that kept it.
      runs: All runs.
      rate: kept / runs.
      low: Lower end of the interval; None if the runs are not independent.
      high: Upper end.
      confidence: With which the interval covers the share of the declared design that passes.
    """

    kept: int
    runs: int
    rate: float
    low: float | None
    high: float | None
    confidence: float


class MarginSummary(NamedTuple):
    """The distribution of a margin; every quantile is a margin that occurred.

    Attributes:
      least: The smallest, in the margin's unit like the others.
      q01: 1 % quantile.
      q05: 5 % quantile.
      median: 50 % quantile.
      q95: 95 % quantile.
      cvar: Mean of the worst 5 % of the margins: the conditional value at risk.
      diverged: Runs at -inf: those that did not complete.
      runs: All runs.
      mean: Mean of all, -inf if a run did not complete.
      mean_low: Lower end of its interval; None if there is none, since runs are not independent,
        all agree, or one did not complete.
      mean_high: Upper end.
      confidence: Of that.
    """

    least: float
    q01: float
    q05: float
    median: float
    q95: float
    cvar: float
    diverged: int
    runs: int
    mean: float
    mean_low: float | None
    mean_high: float | None
    confidence: float


@checked_call
def pass_rate(
    kept: Count, runs: Annotated[int, Range(1, whole=True)], confidence: Share = 0.95
) -> PassRate:
    """Pass rate with the exact two-sided interval of Clopper and Pearson.

    The interval covers the rate p of the sampled distribution with at least the confidence
    whatever p is, if the runs are independent: P(X <= kept | p = high) = P(X >= kept | p = low) =
    (1 - confidence) / 2 for X ~ Bin(runs, p).

    Args:
      kept: Runs that kept the requirement.
      runs: All runs.
      confidence: Between 0 and 1.

    Raises:
      ArgumentError: If there are no runs, more were kept than run, or the confidence is no share.
    """
    if kept > runs:
        raise ArgumentError(f"kept = {kept} must be at most the number of runs, {runs}")
    ends = stats.binomtest(kept, runs).proportion_ci(confidence, method="exact")
    return PassRate(kept, runs, kept / runs, float(ends.low), float(ends.high), confidence)


def rate_shown(kept: int, runs: int, confidence: float = 0.95) -> float:
    """The largest pass rate that "at least this" holds for with the confidence.

    It is the one-sided lower bound of Clopper and Pearson, for independent runs:
    P(X >= kept | p = bound) = 1 - confidence for X ~ Bin(runs, p); 0 if none was kept.

    Args:
      kept: Runs that kept the requirement.
      runs: All runs, 1 or more.
      confidence: Between 0 and 1.
    """
    test = stats.binomtest(kept, runs, alternative="greater")
    return float(test.proportion_ci(confidence, method="exact").low)


@checked_call
def runs_needed(rate: Share, confidence: Share = 0.95) -> int:
    """Runs without one failure after which "at least ``rate`` passes" has the confidence.

    The smallest n with rateⁿ <= 1 - confidence, for independent runs.

    Args:
      rate: Pass rate to be stated, between 0 and 1.
      confidence: Between 0 and 1.

    Raises:
      ArgumentError: If one of them is not between 0 and 1.
    """
    # Rounding must not miss a tie such as 0.1¹ = 1 - 0.9.
    return math.ceil(math.log1p(-confidence) / math.log(rate) * (1 - 1e-12))


@checked_call
def margin_summary(
    margins: Margins, confidence: Share = 0.95, *, independent: bool = True
) -> MarginSummary:
    """Quantiles of the margins, and the means of all and of the worst of them.

    The q-quantile is the smallest margin m such that at least q of the runs have m or less; the
    CVaR is the mean of the ceil(0.05 n) smallest. The interval of the mean is Student's.

    Args:
      margins: Signed margins, (n,), -inf for a run that did not complete.
      confidence: Of the interval of the mean, between 0 and 1.
      independent: Whether the runs are; others give no interval.

    Raises:
      ArgumentError: If there are none, one is NaN or +inf, or the confidence is no share.
    """
    rising = sorted_margins("margins", margins)
    runs = len(rising)
    # In whole numbers: 0.05 * 140 is not 7.
    counts = [max(-(-percent * runs // 100), 1) for percent in (0, 1, 5, 50, 95)]
    least, q01, q05, median, q95 = (float(rising[count - 1]) for count in counts)
    cvar = float(rising[: -(-TAIL * runs // 100)].mean())
    diverged = int(np.count_nonzero(rising == -np.inf))
    low = high = None
    if independent and not diverged and np.ptp(rising) > 0:
        test: Any = stats.ttest_1samp(margins, 0.0)
        low, high = map(float, test.confidence_interval(confidence))
    return MarginSummary(
        least, q01, q05, median, q95, cvar, diverged, runs, float(margins.mean()), low, high,
        confidence,
    )  # fmt: skip


def sorted_margins(name: str, margins: Array) -> Array:
    """Margins in rising order, (n,).

    Raises:
      ArgumentError: If there are none, or one is +inf.
    """
    if not len(margins) or margins.max() == np.inf:
        raise ArgumentError(
            f"{name} must be one number or more, each finite, or -inf for a run that did not "
            "complete"
        )
    return np.sort(margins)
