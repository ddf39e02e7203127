"""Intervals of the change of a pass rate or of a mean margin between two campaigns."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.arrays import Array

# Of each interval by itself.
CONFIDENCE = 0.99
# Differences that rounding makes, of the largest margin.
_ROUNDING = 1e-9


class ChangeInterval(NamedTuple):
    """Interval of the change of a rate or of a mean.

    Attributes:
        low: Lower end, in the unit of the number.
        high: Upper end.
        counts: Plants behind it, in words; empty for a mean.
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
        """The counts, and the interval."""
        interval = f"change {self.low:.2g} to {self.high:.2g} ({100 * CONFIDENCE:g} % interval)"
        return f"{self.counts}; {interval}" if self.counts else interval


def same_plants_rate(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> ChangeInterval:
    """Change of the pass rate on the same plants, from the plants that were lost and won.

    Of the plants whose verdict changed, the share that was won has an interval of Clopper and
    Pearson. It excludes one half where McNemar's exact test finds a difference, and it needs no
    random plants: each plant is compared with itself.

    Args:
        before: Whether each plant kept the requirement, (n,).
        after: Whether it does now, (n,).
    """
    plants = len(before)
    lost = int(np.count_nonzero(before & ~after))
    won = int(np.count_nonzero(~before & after))
    counts = f"{lost} of {plants} plants lost, {won} won"
    changed = lost + won
    if changed == 0:
        return ChangeInterval(0.0, 0.0, counts)

    # The rate changes by (won - lost) / n.
    share = stats.binomtest(won, changed).proportion_ci(CONFIDENCE)
    low = (2 * float(share.low) - 1) * changed / plants
    high = (2 * float(share.high) - 1) * changed / plants
    return ChangeInterval(low, high, counts)


def other_plants_rate(before: NDArray[np.bool_], after: NDArray[np.bool_]) -> ChangeInterval:
    """Change of the pass rate between independent random plants, (n,) before and (m,) after.

    The interval is conservative: both rates have an interval of Clopper and Pearson at
    1 - alpha / 2 with alpha = 1 - confidence, so that both hold together with the confidence.
    """
    kept_before = int(np.count_nonzero(before))
    kept_after = int(np.count_nonzero(after))
    confidence = 1 - (1 - CONFIDENCE) / 2
    old = stats.binomtest(kept_before, len(before)).proportion_ci(confidence)
    new = stats.binomtest(kept_after, len(after)).proportion_ci(confidence)
    counts = f"{kept_before} of {len(before)} plants before, {kept_after} of {len(after)} after"
    return ChangeInterval(float(new.low - old.high), float(new.high - old.low), counts)


def same_plants_mean(before: Array, after: Array) -> ChangeInterval:
    """Change of the mean margin on the same plants: Student's interval of their changes, (n,)."""
    scale = max(float(np.abs(before).max()), float(np.abs(after).max()))
    changes = after - before
    changes[np.abs(changes) <= _ROUNDING * scale] = 0.0
    plants = len(changes)
    if plants < 2:
        return ChangeInterval(-math.inf, math.inf)

    error = float(changes.std(ddof=1)) / math.sqrt(plants)
    return _about(float(changes.mean()), error, plants - 1)


def other_plants_mean(before: Array, after: Array) -> ChangeInterval:
    """Change of the mean margin between independent plants, (n,) and (m,): Welch's interval."""
    if min(len(before), len(after)) < 2:
        return ChangeInterval(-math.inf, math.inf)

    change = float(after.mean() - before.mean())
    variances = [float(margins.var(ddof=1)) / len(margins) for margins in (before, after)]
    variance = sum(variances)
    if variance == 0:
        return ChangeInterval(change, change)

    # Degrees of freedom by Welch and Satterthwaite.
    parts = variances[0] ** 2 / (len(before) - 1) + variances[1] ** 2 / (len(after) - 1)
    return _about(change, math.sqrt(variance), variance**2 / parts)


def _about(change: float, error: float, degrees_of_freedom: float) -> ChangeInterval:
    """Student's interval about a change with a standard error."""
    quantile: Any = stats.t.isf((1 - CONFIDENCE) / 2, degrees_of_freedom)
    half = float(quantile) * error
    return ChangeInterval(change - half, change + half)
