"""Formulas of signal temporal logic, and their margins on a sampled run.

A margin is positive where a formula is kept: of a comparison it is the distance to equality, of
``and`` and ``always`` the least one, of ``or`` and ``eventually`` the largest one. Beyond the end
of a run nothing is asked by ``always`` and nothing is found by ``eventually``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import scipy

from grosmc_mj.experiments.requirements.expressions import Expression
from grosmc_mj.ground.arrays import Array

# Rounding of an instant k h.
_EARLIER = 1 - 1e-12
_LATER = 1 + 1e-12


@dataclass(frozen=True)
class Bounds:
    """A quantity and the numbers that it must stay between, in base units.

    Attributes:
        quantity: The quantity.
        above: Lower bound; minus infinity for none.
        below: Upper bound; infinite for none.
    """

    quantity: Expression
    above: float = -math.inf
    below: float = math.inf

    def within(self, other: Bounds) -> Bounds | None:
        """Return both bounds of one quantity; None for another quantity."""
        if other.quantity != self.quantity:
            return None
        above = max(self.above, other.above)
        below = min(self.below, other.below)
        return replace(self, above=above, below=below)

    def margin(self, value: Any) -> Any:
        """Return the distance of values of the quantity from the nearer bound."""
        return np.minimum(value - self.above, self.below - value)

    def nearest(self, values: Array) -> float:
        """Return the value that is nearest to its bound, or furthest past it."""
        least = float(np.min(values))
        largest = float(np.max(values))
        if self.margin(least) < self.margin(largest):
            return least
        return largest

    @property
    def undefined(self) -> float:
        """Value of a quotient that is undefined: past any bound."""
        return math.inf if math.isfinite(self.below) else -math.inf


@dataclass(frozen=True)
class Inequality:
    """``less`` is below ``more``; the margin is in parts of ``scale``."""

    less: Expression
    more: Expression
    scale: float = 1.0
    horizon: ClassVar[float] = 0.0

    @property
    def limit(self) -> float | None:
        """Magnitude of the finite constant that is compared with; None without one."""
        for side in (self.more, self.less):
            if side.constant and math.isfinite(side.constant):
                return abs(side.constant)
        return None

    def comparisons(self) -> Iterator[Inequality]:
        """Yield itself."""
        yield self

    def intervals(self) -> Iterator[tuple[float, float]]:
        """Yield nothing: it is about an instant."""
        yield from ()

    def scaled(self) -> Inequality:
        """Return the comparison with a margin in parts of its constant."""
        assert self.limit is not None
        return replace(self, scale=self.limit)

    @property
    def bounds(self) -> Bounds | None:
        """The quantity and its bound; None if both sides have signals, or none has."""
        low = self.less.constant
        high = self.more.constant
        if high is not None and low is None:
            return Bounds(self.less, below=high)
        if low is not None and high is None:
            return Bounds(self.more, above=low)
        return None

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return ``more - less``, see ``Operation.margins``."""
        margin = (self.more.values(signals) - self.less.values(signals)) / self.scale
        return np.broadcast_to(margin, signals["t"].shape)


@dataclass(frozen=True)
class Operation:
    """An operator and the formulas that it is applied to.

    Attributes:
        operator: ``not``, ``and``, ``or``, ``always``, ``eventually`` or ``until``.
        parts: One formula, or two of ``and``, ``or`` and ``until``.
        begin: Time after an instant at which the interval of a temporal operator begins [s].
        end: Time at which it ends [s].
    """

    operator: str
    parts: tuple[Formula, ...]
    begin: float = 0.0
    end: float = math.inf

    @property
    def horizon(self) -> float:
        """Time after an instant that its margin there needs [s]; of no end it needs the begin."""
        last = self.end if math.isfinite(self.end) else self.begin
        return last + max(part.horizon for part in self.parts)

    def comparisons(self) -> Iterator[Inequality]:
        """Yield all comparisons in it."""
        for part in self.parts:
            yield from part.comparisons()

    @property
    def bounds(self) -> Bounds | None:
        """The one quantity that all its parts bound, all of which must hold; None if it is not so.

        It is a plain number that a run can be measured by; any other formula has a margin only.
        """
        bounds = None
        for part in self.parts:
            if self.operator != "and" or part.bounds is None:
                return None
            bounds = part.bounds if bounds is None else bounds.within(part.bounds)
            if bounds is None:
                return None
        return bounds

    def intervals(self) -> Iterator[tuple[float, float]]:
        """Yield the intervals after an instant of all temporal operators in it [s]."""
        if self.operator in ("always", "eventually", "until"):
            yield self.begin, self.end
        for part in self.parts:
            yield from part.intervals()

    def scaled(self) -> Operation:
        """Return the formula whose margins are in parts of the constants compared with."""
        return replace(self, parts=tuple(part.scaled() for part in self.parts))

    def margins(self, signals: Mapping[str, Array], period: float) -> Array:
        """Return the margin at each instant, (N,).

        Args:
            signals: Signals by name, (N,) each; ``t`` is among them.
            period: Time between two instants [s].
        """
        inner, *others = [part.margins(signals, period) for part in self.parts]
        count = len(inner)
        first, last = samples_between(self.begin, self.end, period, count)
        match self.operator:
            case "not":
                return -inner
            case "and":
                return np.minimum(inner, *others)
            case "or":
                return np.maximum(inner, *others)
            case "always":
                return _least(inner, first, last)
            case "eventually":
                return -_least(-inner, first, last)
        return _until(inner, others[0], first, last)


Formula = Inequality | Operation


def samples_between(begin: float, end: float, period: float, most: int) -> tuple[int, int]:
    """Return the first and the last sample in an interval; the first is the larger if none is.

    Args:
        begin: Begin of the interval [s].
        end: End of the interval [s]; it may be infinite.
        period: Time between two samples, of which the first is at 0 [s].
        most: Largest number of a sample.
    """
    first = min(math.ceil(begin / period * _EARLIER), most)
    if math.isinf(end):
        return first, most
    return first, min(math.floor(end / period * _LATER), most)


def _until(before: Array, after: Array, first: int, last: int) -> Array:
    """Return margins for the best sample in the interval at which ``after`` holds, (N,).

    ``before`` must hold at all samples before that.
    """
    count = len(after)
    best = np.full(count, -np.inf)
    held = np.full(count, np.inf)
    for later in range(min(last, count - 1) + 1):
        start = slice(count - later)
        if later >= first:
            chosen = np.minimum(held[start], after[later:])
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
    return scipy.ndimage.minimum_filter1d(
        moved, size, mode="constant", cval=np.inf, origin=-(size // 2)
    )
