"""What the runs of one law say of one requirement: pass rate and distribution of margins."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, Decimal
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arguments import whole
from grosmc_mj.campaign.findings.checks import checked_margins, checked_share
from grosmc_mj.campaign.findings.replicates import (
    INDEPENDENT,
    Draws,
    interval_of_mean,
    student,
)
from grosmc_mj.errors import ArgumentError

# The worst part whose mean is the CVaR [%].
TAIL = 5


class PassRate(NamedTuple):
    """How many runs kept a requirement.

    Attributes:
      kept: Runs that kept it.
      runs: All runs.
      rate: kept / runs.
      low: Lower end of the interval; None if there is none.
      high: Upper end.
      confidence: With which the interval covers the share of the declared design that passes.
      note: Why there is no interval.
    """

    kept: int
    runs: int
    rate: float
    low: float | None
    high: float | None
    confidence: float
    note: str = ""


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
      mean_low: Lower end of its interval; None if there is none.
      mean_high: Upper end.
      confidence: Of that.
      note: Why there is no interval.
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
    note: str = ""


def pass_rate(kept: int, runs: int, confidence: float = 0.95) -> PassRate:
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
    checked_share("confidence", confidence)
    good, made = whole(kept), whole(runs)
    if good is None or made is None or not 0 <= good <= made or made < 1:
        raise ArgumentError(f"{kept} of {runs} runs kept: give at least one run, and 0 to all kept")
    found = stats.binomtest(good, made).proportion_ci(confidence, method="exact")
    return PassRate(good, made, good / made, float(found.low), float(found.high), confidence)


def rate_shown(kept: int, runs: int, confidence: float = 0.95) -> float:
    """The largest pass rate that "at least this" holds for with the confidence.

    It is the one-sided lower bound of Clopper and Pearson, for independent runs:
    P(X >= kept | p = bound) = 1 - confidence for X ~ Bin(runs, p); 0 if none was kept.

    Args:
      kept: Runs that kept the requirement.
      runs: All runs, 1 or more.
      confidence: Between 0 and 1.
    """
    found = stats.binomtest(kept, runs, alternative="greater")
    return float(found.proportion_ci(confidence, method="exact").low)


def replicated_pass_rate(
    kept: Sequence[int], runs: Sequence[int], confidence: float = 0.95
) -> PassRate:
    """Pass rate with Student's interval over the replicates' own rates, inside 0 to 1.

    Args:
      kept: Runs of each replicate that kept the requirement, (R,).
      runs: Runs of each replicate; one without any does not count.
      confidence: Between 0 and 1.

    Raises:
      ArgumentError: If there are no runs, or the confidence is no share.
    """
    there = [(int(k), int(n)) for k, n in zip(kept, runs, strict=True) if n]
    if not there:
        raise ArgumentError("no replicate has runs: give at least one run")
    found = student(np.array([k / n for k, n in there]), confidence)
    total, all_runs = sum(k for k, _ in there), sum(n for _, n in there)
    low = None if found.low is None else max(found.low, 0.0)
    high = None if found.high is None else min(found.high, 1.0)
    return PassRate(total, all_runs, total / all_runs, low, high, confidence, found.note)


def runs_needed(rate: float, confidence: float = 0.95) -> int:
    """Runs without one failure after which "at least ``rate`` passes" has the confidence.

    The smallest n with rateⁿ <= 1 - confidence, for independent runs. Both numbers are taken as
    the decimals that they are written as: a tie like 0.1¹ = 1 - 0.9 is met.

    Args:
      rate: Pass rate to be stated, between 0 and 1.
      confidence: Between 0 and 1.

    Raises:
      ArgumentError: If one of them is not between 0 and 1.
    """
    share = Decimal(repr(checked_share("rate", rate)))
    doubt = 1 - Decimal(repr(checked_share("confidence", confidence)))
    runs = int((doubt.ln() / share.ln()).to_integral_value(ROUND_CEILING))
    # A tie that the rounded quotient missed from above.
    return runs - 1 if share ** (runs - 1) <= doubt else runs


def margin_summary(
    margins: Any, confidence: float = 0.95, draws: Draws = INDEPENDENT
) -> MarginSummary:
    """Quantiles of the margins, and the means of all and of the worst of them.

    The q-quantile is the smallest margin m such that at least q of the runs have m or less; the
    CVaR is the mean of the ceil(0.05 n) smallest.

    Args:
      margins: Signed margins, (n,), -inf for a run that did not complete.
      confidence: Of the interval of the mean, between 0 and 1.
      draws: How the runs were drawn.

    Raises:
      ArgumentError: If there are none, one is NaN or +inf, or the confidence is no share.
    """
    found = checked_margins("margins", margins)
    rising = np.sort(found)
    runs = len(rising)

    def count(percent: int) -> int:
        """That many of the runs, rounded up and in whole numbers: 0.05 * 140 is not 7."""
        return max(-(-percent * runs // 100), 1)

    least, q01, q05, median, q95 = (float(rising[count(p) - 1]) for p in (0, 1, 5, 50, 95))
    cvar = float(rising[: count(TAIL)].mean())
    diverged = int(np.count_nonzero(rising == -np.inf))
    mean = interval_of_mean(found, draws, confidence)
    return MarginSummary(
        least=least, q01=q01, q05=q05, median=median, q95=q95, cvar=cvar,
        diverged=diverged,
        runs=runs,
        mean=float(found.mean()),
        mean_low=mean.low,
        mean_high=mean.high,
        confidence=confidence,
        note=mean.note,
    )  # fmt: skip
