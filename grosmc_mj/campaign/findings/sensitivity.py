"""Which uncertain parameters drive a margin."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.findings.checks import checked_margins, checked_share, checked_values
from grosmc_mj.campaign.findings.replicates import INDEPENDENT, Draws
from grosmc_mj.errors import ArgumentError

# Fisher's transformation of a correlation needs more than three runs.
_FEWEST = 4
_MOST_BINS = 32


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
    correlation: float | None
    low: float | None
    high: float | None
    share: float | None
    p_value: float | None
    note: str = ""


def sensitivities(
    values: Mapping[str, Any], margins: Any, confidence: float = 0.95, draws: Draws = INDEPENDENT
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
    exchange of neighbours short of 1; it is approximate. It and the p-value are of independent
    runs only.

    Args:
      values: Each parameter's values, run by run, (n,).
      margins: Signed margins, (n,). Runs that did not complete, -inf, are tied at the lowest rank.
      confidence: Of each interval, between 0 and 1.
      draws: How the runs were drawn.

    Raises:
      ArgumentError: If there are no parameters or margins, the lengths differ, a value is not
        finite, a margin is NaN or +inf, or the confidence is no share.
    """
    checked_share("confidence", confidence)
    found = checked_margins("margins", margins)
    if not values:
        raise ArgumentError("no parameter is given: name at least one")
    ranks = stats.rankdata(found)
    rows = [
        _driver(name, checked_values(name, column, len(found)), ranks, confidence)
        for name, column in values.items()
    ]
    if not draws.independent:
        rows = [each._replace(low=None, high=None, p_value=None) for each in rows]
    return sorted(rows, key=_importance, reverse=True)


def _importance(driver: Sensitivity) -> tuple[float, float]:
    """The share, then the correlation; nothing to tell comes last."""
    if driver.share is None or driver.correlation is None:
        return (-1.0, 0.0)
    return (driver.share, abs(driver.correlation))


def _driver(name: str, values: Array, ranks: Array, confidence: float) -> Sensitivity:
    """One parameter against the margins' ranks."""
    note = ""
    if len(ranks) < _FEWEST:
        note = f"fewer than {_FEWEST} runs"
    elif np.ptp(ranks) == 0:
        note = "the margins are all the same"
    elif np.ptp(values) == 0:
        note = "the parameter does not vary"
    if note:
        return Sensitivity(name, None, None, None, None, None, note)
    own = stats.rankdata(values)
    correlation = float(np.clip(np.corrcoef(own, ranks)[0, 1], -1, 1))
    low, high = _correlation_interval(correlation, len(ranks), confidence)
    share, p_value = _share(own, ranks)
    return Sensitivity(name, correlation, low, high, share, p_value)


def _correlation_interval(r: float, runs: int, confidence: float) -> tuple[float, float]:
    """Bonett and Wright's interval of a rank correlation."""
    # Few runs that agree do not show that all would: short of 1 by half an exchange of neighbours.
    most = 1 - max(6 / (runs * (runs * runs - 1)), 1e-12)
    inner = min(max(r, -most), most)
    half = stats.norm.isf((1 - confidence) / 2) * math.sqrt((1 + inner * inner / 2) / (runs - 3))
    low, high = math.tanh(math.atanh(inner) - half), math.tanh(math.atanh(inner) + half)
    return (-1.0 if r <= -most else low, 1.0 if r >= most else high)


def _share(own: Array, ranks: Array) -> tuple[float, float]:
    """The share of the ranks' variance between the bins, and the p-value of its excess."""
    runs = len(ranks)
    bins = min(math.isqrt(runs), _MOST_BINS)
    # Equal values have equal ranks, so that they share a bin; some bins may stay empty.
    places = ((own - 0.5) * bins / runs).astype(int)
    counts = np.bincount(places)
    sums = np.bincount(places, weights=ranks)[counts > 0]
    counts = counts[counts > 0]
    means = sums / counts
    middle = (runs + 1) / 2
    between = float(counts @ (means - middle) ** 2 / ((ranks - middle) ** 2).sum())
    chance = (len(counts) - 1) / (runs - 1)
    share = max(0.0, (between - chance) / (1 - chance))
    return share, float(stats.chi2.sf((runs - 1) * between, len(counts) - 1))
