"""Pass rates: the share of the runs that keep a requirement, with its interval."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from scipy import stats

from grosmc_mj.ground.wording import unit_after
from grosmc_mj.output.results.tables import Table, names, number, numbers, phrases, table
from grosmc_mj.studies.sweep.margin_summary import MarginSummary
from grosmc_mj.studies.sweep.sampled import SampledRuns

# A pass rate that one may want to state.
_AIM = 0.99


class PassRate(NamedTuple):
    """Share of the runs that kept a requirement.

    Attributes:
        kept: Runs that kept it.
        runs: All runs.
        rate: kept / runs.
        low: Lower end of the interval; None if the runs are not independent.
        high: Upper end.
        confidence: Probability with which the interval covers the share of the declared design
            that passes.
    """

    kept: int
    runs: int
    rate: float
    low: float | None
    high: float | None
    confidence: float

    def interval(self, separator: str) -> str:
        """Return the interval [%] with a text between its ends; empty if there is none."""
        if self.low is None or self.high is None:
            return ""
        # Rounded outwards, so that the interval shown covers the exact one.
        low = math.floor(1e4 * self.low) / 100
        high = math.ceil(1e4 * self.high) / 100
        return f"{low:.2f} {separator} {high:.2f}"

    @property
    def percent(self) -> str:
        """The rate [%]: only all of the runs are 100, and only none 0."""
        if 0 < self.kept < self.runs:
            return f"{min(max(100 * self.rate, 0.01), 99.99):.2f}"
        return f"{100 * self.rate:g}"


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


def pass_rates_table(
    rates: Mapping[tuple[str, str], PassRate],
    summaries: Mapping[tuple[str, str], MarginSummary],
    units: Mapping[str, str],
    sampled: SampledRuns,
) -> Table:
    """Return the number and share of the runs that keep each requirement, the least first.

    Args:
        rates: Pass rates by requirement and law.
        summaries: Summaries of their margins.
        units: Units of margins, by requirement.
        sampled: The runs.
    """
    rows: list[tuple[str, ...]] = []
    for (requirement, law), rate in sorted(rates.items(), key=lambda pair: pair[1].rate):
        margin = "-"
        summary = summaries.get((requirement, law))
        if summary is not None:
            margin = f"{number(summary.least)}{unit_after(units[requirement])}"
            if summary.least == -math.inf:
                margin = "ended early"
        kept = f"{rate.kept} of {rate.runs}"
        interval = rate.interval("..") or "-"
        rows.append((requirement, law, kept, rate.percent, interval, margin))

    confidence = next(iter(rates.values())).confidence
    level = f"{100 * confidence:.6g} %"
    columns = numbers("kept", "rate %", f"{level} interval", "least margin")
    return table(
        "Runs of the declared design that keep each requirement",
        [*phrases("requirement"), *names("law"), *columns],
        rows,
        legend="Intervals of Clopper and Pearson. A run that did not complete keeps nothing. To "
        f'state "at least {100 * _AIM:g} % of the declared design passes" with {level} confidence '
        f"takes {runs_needed(_AIM, confidence)} independent runs without a failure.\n"
        f"{sampled.sentences}",
    )
