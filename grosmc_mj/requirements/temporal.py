"""Formulas of signal temporal logic, and their margins on a sampled run.

A margin is positive where a formula is kept: of a comparison it is the distance to equality, of
``and`` and ``always`` the least one, of ``or`` and ``eventually`` the largest one. Beyond the end
of a run nothing is asked by ``always`` and nothing is found by ``eventually``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import minimum_filter1d

from grosmc_mj.arrays import Array
from grosmc_mj.requirements.expressions import Expression


@dataclass(frozen=True)
class Formula:
    """A formula."""

    @property
    def parts(self) -> tuple[Formula, ...]:
        """Formulas in it."""
        return ()

    @property
    def horizon(self) -> float:
        """Time after an instant that its margin there needs [s]."""
        return max((part.horizon for part in self.parts), default=0.0)

    def comparisons(self) -> Iterator[Comparison]:
        """Yield all comparisons in it."""
        for part in self.parts:
            yield from part.comparisons()

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the margin at each instant, (N,).

        Args:
            signals: Signals by name, (N,) each; ``t`` is among them.
            period: Time between two instants [s].
        """
        raise NotImplementedError


@dataclass(frozen=True)
class Comparison(Formula):
    """``less`` is below ``more``; the margin is in parts of ``scale``."""

    less: Expression
    more: Expression
    scale: float = 1.0

    @property
    def limit(self) -> float | None:
        """Magnitude of the finite constant that is compared with; None without one."""
        for side in (self.more, self.less):
            if side.constant and math.isfinite(side.constant):
                return abs(side.constant)
        return None

    def comparisons(self) -> Iterator[Comparison]:
        """Yield itself."""
        yield self

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return ``more - less``."""
        margin = (self.more.values(signals) - self.less.values(signals)) / self.scale
        return np.broadcast_to(margin, signals["t"].shape)


@dataclass(frozen=True)
class Not(Formula):
    """The inner formula does not hold."""

    inner: Formula

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The inner formula."""
        return (self.inner,)

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the negative margin."""
        return -self.inner.margins(signals, period)


@dataclass(frozen=True)
class And(Formula):
    """Both formulas hold."""

    first: Formula
    second: Formula

    @property
    def parts(self) -> tuple[Formula, ...]:
        """Both."""
        return self.first, self.second

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the smaller margin."""
        first = self.first.margins(signals, period)
        return np.minimum(first, self.second.margins(signals, period))


@dataclass(frozen=True)
class Or(And):
    """One of the formulas holds."""

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the larger margin."""
        first = self.first.margins(signals, period)
        return np.maximum(first, self.second.margins(signals, period))


@dataclass(frozen=True)
class Always(Formula):
    """The inner formula holds from ``begin`` to ``end`` after the instant [s]."""

    inner: Formula
    begin: float = 0.0
    end: float = math.inf

    @property
    def parts(self) -> tuple[Formula, ...]:
        """The inner formula."""
        return (self.inner,)

    @property
    def horizon(self) -> float:
        """Time up to the end, or to the begin if there is no end, and what follows."""
        last = self.end if math.isfinite(self.end) else self.begin
        return last + super().horizon

    def samples(self, period: float, count: int) -> tuple[int, int]:
        """Return the first and last sample of the interval after an instant.

        Args:
            period: Time between two samples [s].
            count: Number of samples of the run.
        """
        first = min(round(self.begin / period), count)
        last = count if math.isinf(self.end) else min(round(self.end / period), count)
        return first, last

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the least margin in the interval."""
        inner = self.inner.margins(signals, period)
        return _least(inner, *self.samples(period, len(inner)))


@dataclass(frozen=True)
class Eventually(Always):
    """The inner formula holds at an instant from ``begin`` to ``end`` later [s]."""

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the largest margin in the interval."""
        inner = self.inner.margins(signals, period)
        return -_least(-inner, *self.samples(period, len(inner)))


@dataclass(frozen=True)
class Until(Eventually):
    """The inner formula holds in the interval, and ``before`` at all instants before that."""

    before: Formula | None = None

    @property
    def parts(self) -> tuple[Formula, ...]:
        """Both formulas."""
        assert self.before is not None
        return self.inner, self.before

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the best choice of the instant at which the inner formula holds."""
        assert self.before is not None
        inner = self.inner.margins(signals, period)
        before = self.before.margins(signals, period)
        count = len(inner)
        first, last = self.samples(period, count)

        best = np.full(count, -np.inf)
        held = np.full(count, np.inf)
        for later in range(min(last, count - 1) + 1):
            start = slice(count - later)
            if later >= first:
                chosen = np.minimum(held[start], inner[later:])
                best[start] = np.maximum(best[start], chosen)
            held[start] = np.minimum(held[start], before[later:])
        return best


def _least(values: Array, first: int, last: int) -> Array:
    """Return the least value from ``first`` to ``last`` samples later, infinite after the end."""
    count = len(values)
    moved = np.full(count, np.inf)
    moved[: count - first] = values[first:]
    size = last - first + 1
    if size >= count:
        return np.minimum.accumulate(moved[::-1])[::-1]
    return minimum_filter1d(moved, size, mode="constant", cval=np.inf, origin=-(size // 2))
