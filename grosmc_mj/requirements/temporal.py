"""Formulas of signal temporal logic, and their margins on a sampled run.

A margin is positive where a formula is kept: of a comparison it is the distance to equality, of
``and`` and ``always`` the least one, of ``or`` and ``eventually`` the largest one. Beyond the end
of a run nothing is asked by ``always`` and nothing is found by ``eventually``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.ndimage import minimum_filter1d

from grosmc_mj.arrays import Array
from grosmc_mj.requirements.expressions import Expression


@dataclass(frozen=True)
class Comparison:
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

    def comparisons(self) -> Iterator[Comparison]:
        """Yield itself."""
        yield self

    def scaled(self) -> Comparison:
        """Return the comparison with a margin in parts of its constant."""
        assert self.limit is not None
        return replace(self, scale=self.limit)

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

    def comparisons(self) -> Iterator[Comparison]:
        """Yield all comparisons in it."""
        for part in self.parts:
            yield from part.comparisons()

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
        first = min(round(self.begin / period), count)
        last = count if math.isinf(self.end) else min(round(self.end / period), count)
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


Formula = Comparison | Operation


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
    return minimum_filter1d(moved, size, mode="constant", cval=np.inf, origin=-(size // 2))
