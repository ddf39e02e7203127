"""Pass rates, margins, paired differences and drivers, with intervals of independent runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array

# The worst part whose mean is the CVaR [%].
TAIL = 5
# Fisher's transformation of a correlation needs more than three runs.
_FEWEST = 4
_MOST_BINS = 32
# A smaller share rounds to 0 %: it drives nothing.
LEAST_SHARE = 0.005


class PassRate(NamedTuple):
    """Share of the runs that kept a requirement.

    Attributes:
      kept: Runs that kept it.
      runs: All runs.
      rate: kept / runs.
      low: Lower end of the interval; None if the runs are not independent.
      high: Upper end.
      confidence: Probability with which the interval covers the share of the declared design that
        passes.
    """

    kept: int
    runs: int
    rate: float
    low: float | None
    high: float | None
    confidence: float


def pass_rate(
    kept: int,
    runs: int,
    confidence: float = 0.95,
    *,
    independent: bool = True,
) -> PassRate:
    """Pass rate with the exact two-sided interval of Clopper and Pearson.

    The interval covers the rate p of the sampled distribution with at least the confidence
    whatever p is, if the runs are independent: P(X <= kept | p = high) = P(X >= kept | p = low) =
    (1 - confidence) / 2 for X ~ Bin(runs, p).

    Args:
      kept: Runs that kept the requirement.
      runs: All runs, 1 or more.
      confidence: Between 0 and 1.
      independent: Whether the runs are; others give no interval.
    """
    low = high = None
    if independent:
        ends = stats.binomtest(kept, runs).proportion_ci(confidence, method="exact")
        low = float(ends.low)
        high = float(ends.high)
    return PassRate(kept, runs, kept / runs, low, high, confidence)


def rate_shown(kept: int, runs: int, confidence: float = 0.95) -> float:
    """The largest pass rate that "at least this" holds for with the confidence.

    It is the one-sided lower bound of Clopper and Pearson, for independent runs:
    P(X >= kept | p = bound) = 1 - confidence for X ~ Bin(runs, p); 0 if none was kept.
    """
    test = stats.binomtest(kept, runs, alternative="greater")
    return float(test.proportion_ci(confidence, method="exact").low)


def runs_needed(rate: float, confidence: float = 0.95) -> int:
    """Runs without one failure after which "at least ``rate`` passes" has the confidence.

    The smallest n with rateⁿ <= 1 - confidence, for independent runs.
    """
    # Rounding must not miss a tie such as 0.1¹ = 1 - 0.9.
    return math.ceil(math.log1p(-confidence) / math.log(rate) * (1 - 1e-12))


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


def margin_summary(
    margins: Array, confidence: float = 0.95, *, independent: bool = True
) -> MarginSummary:
    """Quantiles of the margins, and the means of all and of the worst of them.

    The q-quantile is the smallest margin m such that at least q of the runs have m or less; the
    CVaR is the mean of the ceil(0.05 n) smallest. The interval of the mean is Student's.

    Args:
      margins: Signed margins, (n,), -inf for a run that did not complete.
      confidence: Of the interval of the mean, between 0 and 1.
      independent: Whether the runs are; others give no interval.
    """
    rising = np.sort(margins)
    diverged = int(np.count_nonzero(rising == -np.inf))
    low = high = None
    if independent and not diverged and np.ptp(rising) > 0:
        test: Any = stats.ttest_1samp(margins, 0.0)
        low, high = map(float, test.confidence_interval(confidence))

    return MarginSummary(
        least=float(rising[0]),
        q01=_quantile(rising, 1),
        q05=_quantile(rising, 5),
        median=_quantile(rising, 50),
        q95=_quantile(rising, 95),
        cvar=float(rising[: _count(TAIL, len(rising))].mean()),
        diverged=diverged,
        runs=len(margins),
        mean=float(margins.mean()),
        mean_low=low,
        mean_high=high,
        confidence=confidence,
    )


def _quantile(rising: Array, percent: int) -> float:
    """The smallest value such that at least this percentage of all have it or less."""
    return float(rising[_count(percent, len(rising)) - 1])


def _count(percent: int, runs: int) -> int:
    """A percentage of the runs, rounded up; in whole numbers: 0.05 * 140 is not 7."""
    return -(-percent * runs // 100)


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


class Sensitivity(NamedTuple):
    """Influence of one parameter on a margin; None where it cannot be told.

    Attributes:
      parameter: Its name.
      correlation: Spearman's rank correlation with the margin: its sign says which way.
      low: Lower end of its interval; None where runs are not independent.
      high: Upper end.
      share: Part of the variance of the margins' ranks that the parameter explains alone.
      p_value: Kruskal and Wallis's (from chi-squared): probability of a share at least as large if
        the parameter explained nothing; None where runs are not independent.
      note: Reason why it cannot be told.
    """

    parameter: str
    correlation: float | None = None
    low: float | None = None
    high: float | None = None
    share: float | None = None
    p_value: float | None = None
    note: str = ""

    @property
    def drives(self) -> bool:
        """Whether it may be named as a driver of the margin: its share is not 0 %."""
        return self.share is not None and self.share >= LEAST_SHARE


def sensitivities(
    values: Mapping[str, Array],
    margins: Array,
    confidence: float = 0.95,
    *,
    independent: bool = True,
) -> list[Sensitivity]:
    """Order the parameters by the share that each explains, the strongest first.

    The share is a first-order Sobol index of the margins' ranks: the variance of the means over
    bins of equal count of the parameter, over the whole variance, less what chance gives,
    (share - e) / (1 - e) with e = (bins - 1) / (n - 1) (Kelley's), and never below 0. It sees
    what is not monotone, such as a start angle of either sign, and is never above
    1 - 1 / bins² or so. It does not see what two parameters do only together; shares of
    correlated parameters overlap.

    The interval of the correlation r is tanh(artanh r ± q sqrt((1 + r²/2) / (n - 3))) with the
    normal quantile q (Bonett and Wright, 2000), |r| being at most 1 - 6 / (n³ - n), half an
    exchange of neighbours short of 1; it is approximate.

    Args:
      values: Each parameter's values, run by run, (n,).
      margins: Signed margins, (n,). Runs that did not complete, -inf, are tied at the lowest rank.
      confidence: Of each interval, between 0 and 1.
      independent: Whether the runs are independent; others give no intervals and no p.
    """
    ranks = stats.rankdata(margins)
    drivers = [_driver(name, column, ranks, confidence) for name, column in values.items()]
    if not independent:
        drivers = [driver._replace(low=None, high=None, p_value=None) for driver in drivers]
    return sorted(drivers, key=_importance, reverse=True)


def _importance(driver: Sensitivity) -> tuple[float, float]:
    """The share, then the correlation; a parameter without a share comes last."""
    share = -1.0 if driver.share is None else driver.share
    return share, abs(driver.correlation or 0.0)


def _driver(
    name: str,
    values: Array,
    margin_ranks: Array,
    confidence: float,
) -> Sensitivity:
    """Influence of one parameter on the margins' ranks."""
    runs = len(margin_ranks)
    if runs < _FEWEST:
        return Sensitivity(name, note=f"fewer than {_FEWEST} runs")
    if np.ptp(margin_ranks) == 0:
        return Sensitivity(name, note="the margins are all the same")
    if np.ptp(values) == 0:
        return Sensitivity(name, note="the parameter does not vary")

    value_ranks = stats.rankdata(values)
    r = np.corrcoef(value_ranks, margin_ranks)[0, 1]
    correlation = float(np.clip(r, -1, 1))
    low, high = _correlation_interval(correlation, runs, confidence)
    share, p_value = _explained_share(value_ranks, margin_ranks)
    return Sensitivity(name, correlation, low, high, share, p_value)


def _explained_share(value_ranks: Array, margin_ranks: Array) -> tuple[float, float]:
    """Share of the variance of the margins' ranks between the bins of a parameter, and its p."""
    runs = len(margin_ranks)
    # Equal values have equal ranks, so that they share a bin; some bins may stay empty.
    count = min(math.isqrt(runs), _MOST_BINS)
    bins = ((value_ranks - 0.5) * count / runs).astype(int)
    groups = [margin_ranks[bins == index] for index in np.unique(bins)]

    # Its statistic is (n - 1) times the part of the variance that lies between the bins.
    test: Any = stats.kruskal(*groups)
    between = test.statistic / (runs - 1)
    by_chance = (len(groups) - 1) / (runs - 1)
    share = max(0.0, float((between - by_chance) / (1 - by_chance)))
    return share, float(test.pvalue)


def _correlation_interval(r: float, runs: int, confidence: float) -> tuple[float, float]:
    """Bonett and Wright's interval of a rank correlation."""
    # Few runs that agree do not show that all would: short of 1 by half an exchange of neighbours.
    most = 1 - max(6 / (runs * (runs * runs - 1)), 1e-12)
    inner = min(max(r, -most), most)

    quantile = stats.norm.isf((1 - confidence) / 2)
    half = quantile * math.sqrt((1 + inner * inner / 2) / (runs - 3))
    low = math.tanh(math.atanh(inner) - half)
    high = math.tanh(math.atanh(inner) + half)
    if r <= -most:
        low = -1.0
    if r >= most:
        high = 1.0
    return low, high
