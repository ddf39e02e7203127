"""Which uncertain parameters drive a margin."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.findings.statistics import Margins, Share, sorted_margins
from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import Reals, checked_call

# Fisher's transformation of a correlation needs more than three runs.
_FEWEST = 4
_MOST_BINS = 32
# A smaller share rounds to 0 %: it drives nothing.
LEAST_SHARE = 0.005


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


@checked_call
def sensitivities(
    values: Mapping[str, Annotated[Array, Reals((None,))]],
    margins: Margins,
    confidence: Share = 0.95,
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

    Raises:
      ArgumentError: If there are no parameters or margins, the lengths differ, a value is not
        finite, a margin is NaN or +inf, or the confidence is no share.
    """
    sorted_margins("margins", margins)
    if not values:
        raise ArgumentError("values is empty: name at least one parameter")
    for name, column in values.items():
        if len(column) != len(margins):
            raise ArgumentError(
                f"{name} has {len(column)} values and margins {len(margins)}: give one a run"
            )
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
    correlation = float(np.clip(np.corrcoef(own, ranks)[0, 1], -1, 1))
    # Equal values have equal ranks, so that they share a bin; some bins may stay empty.
    bins = ((own - 0.5) * min(math.isqrt(runs), _MOST_BINS) / runs).astype(int)
    groups = [ranks[bins == index] for index in np.unique(bins)]
    # Its statistic is (n - 1) times the part of the variance that lies between the bins.
    test: Any = stats.kruskal(*groups)
    between, chance = test.statistic / (runs - 1), (len(groups) - 1) / (runs - 1)
    share = max(0.0, float((between - chance) / (1 - chance)))
    ends = _correlation_interval(correlation, runs, confidence)
    return Sensitivity(name, correlation, *ends, share, float(test.pvalue))


def _correlation_interval(r: float, runs: int, confidence: float) -> tuple[float, float]:
    """Bonett and Wright's interval of a rank correlation."""
    # Few runs that agree do not show that all would: short of 1 by half an exchange of neighbours.
    most = 1 - max(6 / (runs * (runs * runs - 1)), 1e-12)
    inner = min(max(r, -most), most)
    half = stats.norm.isf((1 - confidence) / 2) * math.sqrt((1 + inner * inner / 2) / (runs - 3))
    low, high = math.tanh(math.atanh(inner) - half), math.tanh(math.atanh(inner) + half)
    return (-1.0 if r <= -most else low, 1.0 if r >= most else high)
