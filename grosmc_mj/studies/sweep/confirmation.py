"""Runs by equations that MuJoCo confirms: which ones, and what that shows of the others."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.sweep.pass_rates import rate_shown

Mask = NDArray[np.bool_]
Rows = NDArray[np.intp]

# How near to a limit a margin by the equations is not believed, in parts of the limit: it is
# confirmed in MuJoCo within this many times the largest difference found...
FACTOR = 10.0
# ...and within what rounding may come to on another machine.
LEAST_BAND = 1e-9
# Share of the runs that is confirmed at random.
RANDOM = 0.02
# Confidence with which the share of wrong verdicts is bounded.
CONFIDENCE = 0.95


class Confirmation:
    """Choice of the runs by equations that MuJoCo confirms.

    All runs in doubt are confirmed, such as those beside a limit, and some of those that are not
    in doubt, above all at random. Once MuJoCo overturns the verdict of one that was not in doubt,
    the equations are not believed any more: it confirms all.

    It is used in ``rounds``: run their rows in MuJoCo, ``note`` which verdicts it overturns, and
    ``doubt`` other runs if that is a reason to.

    Attributes:
        doubtful: Runs in doubt before they were confirmed, (n,).
        checked: Runs that are confirmed without a doubt, (n,).
        confirmed: Runs that MuJoCo has judged, (n,).
        overturned: Runs of which it has overturned a verdict, (n,).
    """

    def __init__(self, doubtful: Mask, checked: Mask) -> None:
        self.doubtful = doubtful.copy()
        self.checked = checked
        self.confirmed = np.zeros(len(checked), bool)
        self.overturned = np.zeros(len(checked), bool)

    @property
    def refuted(self) -> bool:
        """Whether a verdict was overturned that was not in doubt."""
        return bool(np.any(self.overturned & ~self.doubtful))

    @property
    def drawn(self) -> Mask:
        """Runs that were checked without a doubt, which stand for all others like them, (n,)."""
        return self.checked & ~self.doubtful

    @property
    def wrong_at_most(self) -> float:
        """One-sided bound on the share of wrong verdicts among runs that are not in doubt.

        It needs ``checked`` to be random.
        """
        drawn = self.drawn
        return wrong_at_most(int(drawn.sum()), int((drawn & self.overturned).sum()))

    def rows(self) -> Rows:
        """Return the indices of the runs to confirm next."""
        chosen = self.doubtful | self.checked
        if self.refuted:
            chosen[:] = True
        return np.flatnonzero(chosen & ~self.confirmed)

    def rounds(self) -> Iterator[Rows]:
        """Yield the indices of the runs to confirm next, until none is left."""
        rows = self.rows()
        while len(rows):
            yield rows
            rows = self.rows()

    def note(self, rows: Rows, overturned: Mask) -> None:
        """Take note of runs in MuJoCo.

        Args:
            rows: Their indices.
            overturned: Whether MuJoCo overturns a verdict of each.
        """
        self.confirmed[rows] = True
        self.overturned[rows] = overturned

    def doubt(self, runs: Mask) -> None:
        """Doubt runs, (n,), that are not confirmed yet."""
        self.doubtful |= runs & ~self.confirmed


class MarginConfirmation(Confirmation):
    """Confirmation of runs with margins: those within a band about their limits are in doubt.

    The band is ``FACTOR`` times the largest difference of a margin between equations and MuJoCo,
    and beyond each margin whose sign MuJoCo overturned.

    Attributes:
        margins: By the equations, (limits, n), in parts of the limits; NaN where there is none.
        band: Width of the band on each side, in parts of a limit.
    """

    def __init__(
        self, margins: Array, doubtful: Mask, checked: Mask, band: float = LEAST_BAND
    ) -> None:
        super().__init__(doubtful, checked)
        self.margins = margins
        self.band = band
        self.doubt(self._within_band())

    def note_margins(self, rows: Rows, overturned: Mask, margins: Array) -> None:
        """Take note of runs in MuJoCo, and widen the band by what they show.

        Args:
            rows: Their indices.
            overturned: Whether MuJoCo overturns a verdict of each.
            margins: Their margins, (limits, len(rows)).
        """
        self.note(rows, overturned)
        self.band = max(self.band, band_of(self.margins[:, rows], margins))
        self.doubt(self._within_band())

    def _within_band(self) -> Mask:
        """True for each run with a margin within the band, (n,)."""
        return np.any(np.abs(self.margins) <= self.band, axis=0)


def band_of(by_equations: Array, by_physics: Array) -> float:
    """Return how near to a limit margins by equations cannot be believed, in parts of the limit.

    Args:
        by_equations: Margins in parts of their limits, of any shape; infinite of runs that ended
            early.
        by_physics: Margins of the same runs in MuJoCo.
    """
    both = np.isfinite(by_equations) & np.isfinite(by_physics)
    overturned = np.isfinite(by_equations) & ((by_equations >= 0) != (by_physics >= 0))
    differences = np.abs(by_equations[both] - by_physics[both])
    largest = np.concatenate([differences, np.abs(by_equations[overturned])])
    return max(LEAST_BAND, FACTOR * float(largest.max(initial=0.0)))


def drawn_at_random(count: int, seed: int = 0) -> Mask:
    """Return True for a random share of some runs, one at least, (count,)."""
    chosen = np.zeros(count, bool)
    order = np.random.default_rng(seed).permutation(count)
    chosen[order[: math.ceil(RANDOM * count)]] = True
    return chosen


def wrong_at_most(drawn: int, overturned: int) -> float:
    """Return the one-sided bound of Clopper and Pearson on the share of wrong verdicts.

    Args:
        drawn: Runs that were confirmed at random.
        overturned: Number of these of which MuJoCo overturned a verdict.
    """
    if not drawn:
        return 1.0
    return 1 - rate_shown(drawn - overturned, drawn, CONFIDENCE)


def confirmation_words(drawn: int, overturned: int) -> str:
    """Return a clause on the runs that were confirmed at random and the bound that they give."""
    if not drawn:
        return "none confirmed at random, so no bound on those by the equations"
    bound = 100 * wrong_at_most(drawn, overturned)
    return (
        f"of {drawn:,} confirmed at random, {overturned:,} overturned: at most {bound:.2g} % of "
        f"those by the equations at {100 * CONFIDENCE:g} %"
    )
