"""Intervals of means: from independently scrambled replicates, or from independent runs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.findings.checks import checked_share

AGREE = "no interval: all replicates agree; --sampler random gives one"
_ONE = "no interval: there are runs of one replicate only"
_SAME = "no interval: all runs agree"
_SINGLE = "no interval: there is one run only"
_UNBOUNDED = "no interval: a run did not complete"


class Draws(NamedTuple):
    """How the runs of a campaign were drawn, as far as intervals depend on it.

    Attributes:
      replicate: Of each run, which replicate it belongs to, (n,); None if runs are independent.
      why_not: Why there are no intervals; empty if there are.
    """

    replicate: NDArray[Any] | None = None
    why_not: str = ""

    @property
    def independent(self) -> bool:
        """Whether statistics of independent runs hold."""
        return self.replicate is None and not self.why_not


INDEPENDENT = Draws()


class MeanInterval(NamedTuple):
    """An interval of a mean, and the test of whether that is zero.

    Attributes:
      low: Lower end; None if there is no interval.
      high: Upper end.
      p_value: Of means at least as far from zero, if zero were the mean.
      note: Why there is none, in a clause.
    """

    low: float | None
    high: float | None
    p_value: float | None
    note: str = ""


def student(means: Array, confidence: float) -> MeanInterval:
    """Student's interval of the expectation of independent means, of R - 1 degrees of freedom.

    Its ends are mean ± t s / sqrt(R) with the means' standard deviation s. It is exact for normal
    means, and approximate otherwise: of few plants, or near a rate of 0 or 1, they are not.

    Args:
      means: Of R replicates, (R,); replicates of somewhat unequal size count alike.
      confidence: Between 0 and 1.
    """
    checked_share("confidence", confidence)
    if len(means) < 2:
        return MeanInterval(None, None, None, _ONE)
    if not np.isfinite(means).all():
        return MeanInterval(None, None, None, _UNBOUNDED)
    mean, error = float(means.mean()), float(means.std(ddof=1)) / math.sqrt(len(means))
    # Squares of the least numbers are zero.
    if np.ptp(means) == 0 or error == 0:
        return MeanInterval(None, None, None, AGREE)
    freedom = len(means) - 1
    half = float(stats.t.isf((1 - confidence) / 2, freedom)) * error
    p_value = 2 * float(stats.t.sf(abs(mean) / error, freedom))
    return MeanInterval(mean - half, mean + half, p_value)


def interval_of_mean(values: Array, draws: Draws, confidence: float) -> MeanInterval:
    """The interval of the mean of what each run gives.

    Args:
      values: One a run, (n,).
      draws: How the runs were drawn.
      confidence: Between 0 and 1.
    """
    if draws.why_not:
        return MeanInterval(None, None, None, draws.why_not)
    if draws.replicate is not None:
        means = [values[draws.replicate == each].mean() for each in np.unique(draws.replicate)]
        return student(np.array(means), confidence)
    found = student(values, confidence)
    return found._replace(note={AGREE: _SAME, _ONE: _SINGLE}.get(found.note, found.note))
