"""Intervals of the change of a pass rate or of a mean margin between two campaigns."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted

# Confidence of each interval.
CONFIDENCE = 0.99
# Differences by rounding, as a share of the largest margin.
_ROUNDING = 1e-9


class ChangeInterval(NamedTuple):
    """Interval of the change of a rate or of a mean.

    Attributes:
        low: Lower end, in the unit of the number.
        high: Upper end.
        counts: Words for the numbers of plants that it comes from; empty for a mean.
    """

    low: float
    high: float
    counts: str = ""

    @property
    def excludes_zero(self) -> bool:
        """Whether the change is more than noise."""
        return self.low > 0 or self.high < 0

    @property
    def words(self) -> str:
        """Counts and interval in words."""
        interval = f"change {self.low:.2g} to {self.high:.2g} ({100 * CONFIDENCE:g} % interval)"
        if not self.counts:
            return interval
        return f"{self.counts}; {interval}"


def same_plants_rate(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> ChangeInterval:
    """Return the interval of a pass rate's change on the same plants, from those lost and won.

    The share of won plants among those whose verdict changed has an interval of Clopper and
    Pearson. It excludes one half where McNemar's exact test finds a difference, and it needs no
    random plants: each plant is compared with itself.

    Args:
        before: Whether each plant kept the requirement in the old campaign, (n,).
        after: Whether it keeps the requirement in the new campaign, (n,).
    """
    plants = len(before)
    lost = int(np.count_nonzero(before & ~after))
    won = int(np.count_nonzero(~before & after))
    counts = f"{lost} of {counted(plants, 'plant')} lost, {won} won"
    changed = lost + won
    if changed == 0:
        return ChangeInterval(0.0, 0.0, counts)

    # The rate changes by (won - lost) / n.
    share = stats.binomtest(won, changed).proportion_ci(CONFIDENCE)
    low = (2 * float(share.low) - 1) * changed / plants
    high = (2 * float(share.high) - 1) * changed / plants
    return ChangeInterval(low, high, counts)


def other_plants_rate(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> ChangeInterval:
    """Return the interval of a pass rate's change between independent random plants.

    The interval is conservative: both rates have an interval of Clopper and Pearson at
    1 - alpha / 2 with alpha = 1 - confidence, so that both hold together with the confidence.

    Args:
        before: Whether each plant kept the requirement in the old campaign, (n,).
        after: Whether each plant keeps the requirement in the new campaign, (m,).
    """
    kept_before = int(np.count_nonzero(before))
    kept_after = int(np.count_nonzero(after))
    confidence = 1 - (1 - CONFIDENCE) / 2
    old = stats.binomtest(kept_before, len(before)).proportion_ci(confidence)
    new = stats.binomtest(kept_after, len(after)).proportion_ci(confidence)
    plants = counted(len(before), "plant")
    counts = f"{kept_before} of {plants} before, {kept_after} of {len(after)} after"
    return ChangeInterval(float(new.low - old.high), float(new.high - old.low), counts)


def same_plants_mean(before: Array, after: Array) -> ChangeInterval:
    """Return Student's interval of a mean margin's change on the same plants.

    Args:
        before: Margins in the old campaign, (n,).
        after: Margins of the same plants in the new campaign, (n,).
    """
    scale = max(float(np.abs(before).max()), float(np.abs(after).max()))
    changes = after - before
    changes[np.abs(changes) <= _ROUNDING * scale] = 0.0
    plants = len(changes)
    if plants < 2:
        return ChangeInterval(-math.inf, math.inf)

    error = float(changes.std(ddof=1)) / math.sqrt(plants)
    return _about(float(changes.mean()), error, plants - 1)


def other_plants_mean(before: Array, after: Array) -> ChangeInterval:
    """Return Welch's interval of a mean margin's change between independent plants.

    Args:
        before: Margins in the old campaign, (n,).
        after: Margins in the new campaign, (m,).
    """
    if min(len(before), len(after)) < 2:
        return ChangeInterval(-math.inf, math.inf)

    change = float(after.mean() - before.mean())
    variance_before = float(before.var(ddof=1)) / len(before)
    variance_after = float(after.var(ddof=1)) / len(after)
    variance = variance_before + variance_after
    if variance == 0:
        return ChangeInterval(change, change)

    # Degrees of freedom by Welch and Satterthwaite.
    parts = variance_before**2 / (len(before) - 1) + variance_after**2 / (len(after) - 1)
    return _about(change, math.sqrt(variance), variance**2 / parts)


def _about(change: float, error: float, degrees_of_freedom: float) -> ChangeInterval:
    """Return Student's interval about a change with a standard error."""
    quantile: Any = stats.t.isf((1 - CONFIDENCE) / 2, degrees_of_freedom)
    half = float(quantile) * error
    return ChangeInterval(change - half, change + half)
