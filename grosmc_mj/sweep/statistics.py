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


def pass_rate(
    kept: int, runs: int, confidence: float = 0.95, *, independent: bool = True
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
    ends = stats.binomtest(kept, runs).proportion_ci(confidence, method="exact")
    low, high = (float(ends.low), float(ends.high)) if independent else (None, None)
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
    rising, runs = np.sort(margins), len(margins)
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


def paired(
    first: Array, second: Array, confidence: float = 0.95, *, independent: bool = True
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
    runs, kept, also = len(first), first >= 0, second >= 0
    both, only_first, only_second = (
        int(np.count_nonzero(plants)) for plants in (kept & also, kept & ~also, ~kept & also)
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


class Sensitivity(NamedTuple):
    """What one parameter does to a margin; None where there is nothing to tell.

    Attributes:
      parameter: Its name.
      correlation: Spearman's rank correlation with the margin: its sign says which way.
      low: Lower end of its interval; None where runs are not independent.
      high: Upper end.
      share: Part of the variance of the margins' ranks that the parameter explains alone.
      p_value: Kruskal and Wallis's (from chi-squared), of a share at least as large if it explained
        nothing; None where runs are not independent.
      note: Why there is nothing to tell.
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
        """Whether it may be named as what drives the margin: its share is not 0 %."""
        return self.share is not None and self.share >= LEAST_SHARE


def sensitivities(
    values: Mapping[str, Array],
    margins: Array,
    confidence: float = 0.95,
    *,
    independent: bool = True,
) -> list[Sensitivity]:
    """The parameters in order of the share that each explains, the strongest first.

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
      independent: Whether the runs are; others give no intervals and no p.
    """
    ranks = stats.rankdata(margins)
    drivers = [_driver(name, column, ranks, confidence) for name, column in values.items()]
    if not independent:
        drivers = [driver._replace(low=None, high=None, p_value=None) for driver in drivers]
    return sorted(drivers, key=_importance, reverse=True)


def _importance(driver: Sensitivity) -> tuple[float, float]:
    """The share, then the correlation; nothing to tell comes last."""
    return (-1.0 if driver.share is None else driver.share, abs(driver.correlation or 0.0))


def _driver(name: str, values: Array, ranks: Array, confidence: float) -> Sensitivity:
    """One parameter against the margins' ranks."""
    runs = len(ranks)
    if runs < _FEWEST:
        return Sensitivity(name, note=f"fewer than {_FEWEST} runs")
    if np.ptp(ranks) == 0:
        return Sensitivity(name, note="the margins are all the same")
    if np.ptp(values) == 0:
        return Sensitivity(name, note="the parameter does not vary")
    own = stats.rankdata(values)
    r = float(np.clip(np.corrcoef(own, ranks)[0, 1], -1, 1))
    # Equal values have equal ranks, so that they share a bin; some bins may stay empty.
    bins = ((own - 0.5) * min(math.isqrt(runs), _MOST_BINS) / runs).astype(int)
    groups = [ranks[bins == index] for index in np.unique(bins)]
    # Its statistic is (n - 1) times the part of the variance that lies between the bins.
    test: Any = stats.kruskal(*groups)
    between, chance = test.statistic / (runs - 1), (len(groups) - 1) / (runs - 1)
    share = max(0.0, float((between - chance) / (1 - chance)))
    # Few runs that agree do not show that all would: short of 1 by half an exchange of neighbours.
    most = 1 - max(6 / (runs * (runs * runs - 1)), 1e-12)
    inner = min(max(r, -most), most)
    half = stats.norm.isf((1 - confidence) / 2) * math.sqrt((1 + inner * inner / 2) / (runs - 3))
    low, high = math.tanh(math.atanh(inner) - half), math.tanh(math.atanh(inner) + half)
    ends = (-1.0 if r <= -most else low, 1.0 if r >= most else high)
    return Sensitivity(name, r, *ends, share, float(test.pvalue))
