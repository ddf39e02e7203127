"""Drivers of a margin: uncertain numbers that explain it, told from noise by permutations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.results.tables import Table, numbers, table, text, words
from grosmc_mj.studies.sweep.sampled import SampledRuns, p_value_words

# A number is named as a driver if fewer campaigns without one would show as large a share.
LEVEL = 0.01
# Random orders of the margins: the smallest p is 1 / 2000, and at the level it is known to 0.002.
_PERMUTATIONS = 1999
# Ranks that are permuted at the same time, which bounds the memory to some 100 MB.
_RANKS_AT_ONCE = 2**22
# With fewer runs no order of the margins is rare.
_FEWEST = 4
_MOST_BINS = 32
# Shares that differ by rounding alone are equal.
_ROUNDING = 1e-9


class Sensitivity(NamedTuple):
    """Influence of one number on a margin; None where it cannot be told.

    Attributes:
        parameter: Its name.
        correlation: Spearman's rank correlation with the margin: its sign says which way.
        share: Part of the variance of the margins' ranks that the number explains alone.
        p_value: Probability that one of all the numbers shows a share as large if none of them
            has an influence; None where runs are not independent.
        note: Reason why it cannot be told.
    """

    parameter: str
    correlation: float | None = None
    share: float | None = None
    p_value: float | None = None
    note: str = ""

    @property
    def drives(self) -> bool:
        """Whether it may be named as a driver of the margin: its share is no noise."""
        return self.p_value is not None and self.p_value < LEVEL


@dataclass(frozen=True, eq=False)
class _Bins:
    """Bins of equal count of the values of one number.

    Attributes:
        members: 1 where a run is in a bin, (n, bins).
    """

    members: Array

    @classmethod
    def of(cls, value_ranks: Array) -> _Bins:
        """Return the bins of ranked values, (n,); equal values share a bin."""
        runs = len(value_ranks)
        most = min(math.isqrt(runs), _MOST_BINS)
        bins = ((value_ranks - 0.5) * most / runs).astype(int)
        return cls((bins[:, None] == np.unique(bins)).astype(float))

    def share(self, ranks: Array) -> Array:
        """Part of the variance of ranks (..., n) that lies between bins, less what chance gives."""
        runs, count = self.members.shape
        centred = ranks - (runs + 1) / 2
        sums = centred @ self.members
        between = np.sum(sums**2 / self.members.sum(axis=0), axis=-1) / np.sum(centred**2, axis=-1)
        by_chance = (count - 1) / (runs - 1)
        return (between - by_chance) / (1 - by_chance)


def sensitivities(
    values: Mapping[str, Array],
    margins: Array,
    *,
    independent: bool = True,
) -> list[Sensitivity]:
    """Order the uncertain numbers by the share that each explains, the strongest first.

    The share is a first-order Sobol index of the margins' ranks: the variance of the means over
    bins of equal count of the number, over the whole variance, less what chance gives,
    (share - e) / (1 - e) with e = (bins - 1) / (n - 1) (Kelley's), and never below 0. It sees
    what is not monotone, such as a start angle of either sign, and is never above
    1 - 1 / bins² or so. It does not see what two numbers do only together; shares of
    correlated numbers overlap.

    The p-value is that of a permutation test on the largest share of all numbers, so that it is
    corrected for their number (Westfall and Young's single step): with no influence at all, one of
    them is below a level with that probability at most.

    Args:
        values: Values of each number, run by run, (n,).
        margins: Signed margins, (n,). Runs that did not complete, -inf, are tied at the lowest
            rank.
        independent: Whether the runs are independent; others give no p.
    """
    ranks = stats.rankdata(margins)
    rows = [_untold(name, column, ranks) for name, column in values.items()]
    varied = [row.parameter for row in rows if not row.note]
    if not varied:
        return rows

    bins = [_Bins.of(stats.rankdata(values[name])) for name in varied]
    shares = [float(number_bins.share(ranks)) for number_bins in bins]
    p_values: list[float | None] = [None] * len(varied)
    if independent:
        p_values = list(_p_values(bins, ranks, shares))

    told: list[Sensitivity] = []
    for name, share, p_value in zip(varied, shares, p_values, strict=True):
        test: Any = stats.spearmanr(values[name], ranks)
        told.append(Sensitivity(name, float(test.statistic), max(0.0, share), p_value))
    told.sort(key=lambda row: (row.share, abs(row.correlation or 0.0)), reverse=True)
    return told + [row for row in rows if row.note]


def _untold(name: str, values: Array, margin_ranks: Array) -> Sensitivity:
    """A number with the reason why its influence cannot be told, if there is one."""
    note = ""
    if len(margin_ranks) < _FEWEST:
        note = f"fewer than {_FEWEST} runs"
    elif np.ptp(margin_ranks) == 0:
        note = "the margins are all the same"
    elif np.ptp(values) == 0:
        note = "the number does not vary"
    return Sensitivity(name, note=note)


def _p_values(bins: list[_Bins], ranks: Array, shares: list[float]) -> list[float | None]:
    """Part of the orders of the margins in which the largest share of all is as large as each."""

    def largest_share(orders: Array, axis: int) -> Array:
        assert axis == -1
        return np.max([number_bins.share(orders) for number_bins in bins], axis=0)

    test: Any = stats.permutation_test(
        (ranks,),
        largest_share,
        permutation_type="pairings",
        alternative="greater",
        n_resamples=_PERMUTATIONS,
        batch=max(1, _RANKS_AT_ONCE // len(ranks)),
        vectorized=True,
        axis=-1,
        # The same runs have the same answer.
        rng=np.random.default_rng(0),
    )
    largest = test.null_distribution
    # The order that was observed is one of them.
    orders = 1 + len(largest)
    return [(1 + np.count_nonzero(largest >= share - _ROUNDING)) / orders for share in shares]


def driver_words(law: str, rows: list[Sensitivity]) -> str:
    """Return a sentence on the number that drives a law's margin most; empty if none can be told.

    Args:
        law: Name of the law.
        rows: Its sensitivities, the strongest first.
    """
    strongest = rows[0]
    if strongest.p_value is None:
        return ""
    if not strongest.drives:
        return f"{law}: no uncertain number alone drives its margin more than chance would"
    return (
        f"{law}: {strongest.parameter} drives its margin most "
        f"({100 * (strongest.share or 0):.0f} % of the variance of the ranks, "
        f"p {p_value_words(strongest.p_value)})"
    )


def drivers_table(law: str, rows: list[Sensitivity], sampled: SampledRuns) -> Table:
    """Return the influence of each uncertain number on the least margin under one law.

    Args:
        law: Name of the law.
        rows: Its sensitivities.
        sampled: The runs that they rest on.
    """
    return table(
        f"What drives the margin of 'all requirements' under {law}",
        [*text("number"), *numbers("share %", "p", "rank correlation"), *words("")],
        [_cells(row) for row in rows],
        styles=["dim" if row.note else "" for row in rows],
        legend="Share of the variance of the margins' ranks that the number explains alone, less "
        "what chance gives; p: that one of the numbers shows a share as large if none has an "
        f"influence, by {_PERMUTATIONS} random orders of the margins; below {LEVEL:g} it is named "
        "as a driver. Correlation: Spearman's, positive if more of the number leaves more margin. "
        f"Shares of correlated numbers overlap.\n{sampled.sentences}",
    )


def _cells(row: Sensitivity) -> tuple[str, ...]:
    """The row of one number."""
    if row.share is None or row.correlation is None:
        return (row.parameter, "-", "", "-", row.note)
    p_value = p_value_words(row.p_value)
    return (row.parameter, f"{100 * row.share:.0f}", p_value, f"{row.correlation:+.2f}", "")
