"""Tests of two samples of runs: a p-value, and the least change that the same test would detect.

Every test is of the difference of two means, of rates as of margins, so that effect, sign and p
speak of one statistic.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.sweep.statistics import mcnemar

# An alarm is raised falsely in one comparison of twenty at most, however many tests it has.
LEVEL = 0.05
# Of changes as large as the least detectable one, this share is detected.
POWER = 0.8
# Differences that rounding makes, of the largest margin.
_ROUNDING = 1e-9
# Up to so many changes signs are flipped, so many times; of more the sum is normal.
_FLIPPED, _FLIPS = 50, 9999


class SampleTest(NamedTuple):
    """A test of whether a mean has changed.

    Attributes:
        name: Of the test.
        p_value: Of a difference at least as far from zero, if there were none.
        detectable: From a level to the least change that is detected at it with the power.
    """

    name: str
    p_value: float
    detectable: Callable[[float], float]


def holm(p_values: Sequence[float]) -> NDArray[np.bool_]:
    """Which of several tests raise an alarm at the level together, (n,), by Holm's step-down.

    The k-th smallest of n p-values is compared with LEVEL / (n - k + 1), until one is too large.
    """
    p, alarms = np.array(p_values), np.zeros(len(p_values), bool)
    rising = p.argsort(kind="stable")
    adjusted = np.maximum.accumulate(p[rising] * np.arange(len(p), 0, -1))
    alarms[rising] = adjusted < LEVEL
    return alarms


def same_plants_rates(before: Array, after: Array) -> SampleTest:
    """McNemar's exact test of the rates of the same plants, 0 or 1 each, (n,).

    It needs no independent plants: without a change each plant whose verdict differs is as likely
    lost as won. A change is detectable by as many differing plants as there are, or by the fewest
    that can raise an alarm.
    """
    lost, won = int((before > after).sum()), int((after > before).sum())

    def detectable(level: float) -> float:
        differing = max(lost + won, math.ceil(1 - math.log2(level)))
        critical = stats.binom.isf(level / 2, differing, 0.5) + 1
        # With that share of them on one side, the critical count is reached with the power.
        share = stats.beta.ppf(POWER, critical, differing - critical + 1)
        return float((2 * share - 1) * differing / len(before))

    return SampleTest("McNemar", mcnemar(lost, won), detectable)


def same_plants_means(before: Array, after: Array) -> SampleTest:
    """Permutation test of the mean change of the same plants, (n,): its signs are flipped.

    Without a change each plant's is as likely up as down; plants that did not change have no say.
    """
    changes, runs = after - before, len(before)
    scale = max(float(np.abs(before).max()), float(np.abs(after).max()))
    changes[np.abs(changes) <= _ROUNDING * scale] = 0.0
    moved = changes[changes != 0]
    spread = float(changes.std())

    def detectable(level: float) -> float:
        """From (sqrt(n) d - q s)² = z² (s² + d²): the change d adds to what the flips scatter."""
        z, q = stats.norm.isf(level / 2), stats.norm.ppf(POWER)
        if runs <= z * z or 2.0 ** (1 - runs) > level:
            return math.inf
        root = z * math.sqrt(runs + q * q - z * z)
        return float(spread * (math.sqrt(runs) * q + root) / (runs - z * z))

    p_value = 1.0
    if len(moved) > _FLIPPED:
        p_value = 2 * stats.norm.sf(abs(moved.sum()) / math.sqrt(moved @ moved))
    elif len(moved):
        flips: Any = stats.permutation_test(
            (moved,), np.mean, permutation_type="samples", n_resamples=_FLIPS, vectorized=True,
            rng=0,
        )  # fmt: skip
        p_value = flips.pvalue
    return SampleTest("sign flips", float(p_value), detectable)


def other_plants_rates(before: Array, after: Array) -> SampleTest:
    """Fisher's exact test of the rates of independent runs on other plants, 0 or 1, (n,), (m,).

    The rate before is taken as it is: what is detectable is the smaller one of a fall and a rise.
    """
    runs, others, kept = len(before), len(after), int(before.sum())

    def p_value(kept: int, count: int) -> float:
        table = [[kept, runs - kept], [count, others - count]]
        test: Any = stats.fisher_exact(table)
        return float(test.pvalue)

    def fall(kept: int, level: float) -> float:
        counts = range(kept * others // runs + 1)
        critical = bisect_right(counts, level, key=lambda count: p_value(kept, count)) - 1
        if critical < 0:
            return math.inf
        # At this rate so few or fewer are kept with the power.
        return kept / runs - float(stats.beta.isf(POWER, critical + 1, others - critical))

    return SampleTest(
        "Fisher",
        p_value(kept, int(after.sum())),
        lambda level: min(fall(kept, level), fall(runs - kept, level)),
    )


def other_plants_means(before: Array, after: Array) -> SampleTest:
    """Welch's test of the means of independent runs on other plants, (n,), (m,)."""
    error = math.sqrt(before.var() / len(before) + after.var() / len(after))
    if error == 0:
        same = before.mean() == after.mean()
        return SampleTest("Welch", float(same), lambda _: 0.0)
    test: Any = stats.ttest_ind(after, before, equal_var=False)
    return SampleTest(
        "Welch",
        float(test.pvalue),
        lambda level: float((stats.norm.isf(level / 2) + stats.norm.ppf(POWER)) * error),
    )
