"""Distribution of a margin over the runs of a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.output.results.tables import Table, names, number, numbers, table, text
from grosmc_mj.studies.sweep.sampled import SampledRuns

# The worst part whose mean is the CVaR [%].
TAIL = 5


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


def margins_table(
    summaries: Mapping[tuple[str, str], MarginSummary],
    units: Mapping[str, str],
    sampled: SampledRuns,
) -> Table:
    """Return the distribution of each requirement's margin.

    Args:
        summaries: Summaries by requirement and law.
        units: Units of margins, by requirement.
        sampled: The runs.
    """
    rows = [
        (requirement, law, *_cells(summary), unit_after(units[requirement]).lstrip())
        for (requirement, law), summary in summaries.items()
    ]
    headers = ("least", f"worst {TAIL} %", "1 %", "5 %", "median", "95 %", "mean", "unit")
    return table(
        "Margins: limit less measured",
        [*text("requirement"), *names("law"), *numbers(*headers)],
        rows,
        grouped=True,
        legend=f"Below zero the requirement failed. Worst {TAIL} %: mean of the worst {TAIL} % of "
        "the margins (CVaR); then quantiles, and the mean with its interval (Student's t). -inf: a "
        f"run that did not complete.\n{sampled.sentences}",
    )


def _cells(summary: MarginSummary) -> list[str]:
    """The quantiles of a margin and its mean with its interval."""
    mean = number(summary.mean)
    if summary.mean_low is not None:
        mean += f"\n({number(summary.mean_low)} ..\n{number(summary.mean_high)})"
    return [
        number(summary.least),
        number(summary.cvar),
        number(summary.q01),
        number(summary.q05),
        number(summary.median),
        number(summary.q95),
        mean,
    ]
