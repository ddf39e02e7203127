"""Distributions of uncertain numbers: those of scipy that a case file may name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.experiments.file.schema import DistributionTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.units import numbers_of

# Points stay so far off the faces of the unit cube, where quantiles may be infinite.
EDGE = 2.0**-53
# Largest size of a number or a value: its products with others are finite.
_LARGEST = 1e100
_ENDS = ("least", "most")


class _Kind(NamedTuple):
    """Kind of distribution.

    Attributes:
        needed: Names of the numbers that it needs.
        allowed: Names of the numbers that it may have besides: where it is cut off.
        frozen: scipy's distribution with these numbers.
    """

    needed: tuple[str, ...]
    allowed: tuple[str, ...]
    frozen: Callable[..., Any]


def _uniform(least: float, most: float) -> Any:
    return stats.uniform(least, most - least)


def _loguniform(least: float, most: float) -> Any:
    return stats.loguniform(least, most)


def _triangular(least: float, most: float, mode: float) -> Any:
    return stats.triang((mode - least) / (most - least), least, most - least)


def _normal(mean: float, deviation: float, **_ends: float) -> Any:
    return stats.norm(mean, deviation)


def _lognormal(median: float, spread: float, **_ends: float) -> Any:
    return stats.lognorm(spread, scale=median)


_KINDS: Mapping[str, _Kind] = {
    "uniform": _Kind(_ENDS, (), _uniform),
    "loguniform": _Kind(_ENDS, (), _loguniform),
    "triangular": _Kind((*_ENDS, "mode"), (), _triangular),
    "normal": _Kind(("mean", "deviation"), _ENDS, _normal),
    "lognormal": _Kind(("median", "spread"), _ENDS, _lognormal),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution of scipy, cut off at both ends of its support.

    Attributes:
        frozen: scipy's frozen distribution, not cut off.
        support: Smallest and largest value; infinite where it has none.
        words: Kind and numbers, for people.
    """

    frozen: Any
    support: tuple[float, float]
    words: str

    def quantiles(self, u: Array) -> Array:
        """Values below which a share u (n,) of the distribution lies, (n,)."""
        low, high = self.frozen.cdf(self.support)
        values = self.frozen.ppf(low + (high - low) * u)
        return np.clip(values, *self.support)

    def contains(self, value: float) -> bool:
        """Whether a value lies within the support."""
        low, high = self.support
        return low <= value <= high


def distribution(spread: list[Any] | DistributionTable, unit: str) -> Distribution:
    """Return the distribution that a file's range or table describes.

    Args:
        spread: ``[least, most]``, or a table of numbers.
        unit: Unit of the quantity.

    Raises:
        ArgumentError: If a number is missing, or the numbers make no distribution.
    """
    if not isinstance(spread, DistributionTable):
        least, most = spread
        spread = DistributionTable(distribution="uniform", least=least, most=most)

    kind = _KINDS[spread.distribution]
    numbers = _numbers(spread, kind, unit)
    listed = ", ".join(f"{name} {value:.4g}" for name, value in numbers.items())
    words = f"{spread.distribution}: {listed}"

    _refuse_huge(words, numbers.values())
    least = numbers.get("least", -np.inf)
    most = numbers.get("most", np.inf)
    if least < most:
        frozen = kind.frozen(**numbers)
        # The ends of the table: far out, a quantile function does not find them again.
        low, high = frozen.support()
        support = max(least, float(low)), min(most, float(high))
        share_below, share_up_to = frozen.cdf(support)
        if share_below < share_up_to:
            spread_out = Distribution(frozen, support, words)
            with np.errstate(over="ignore"):
                extremes = spread_out.quantiles(np.array([EDGE, 1 - EDGE]))
            _refuse_huge(words, extremes.tolist())
            return spread_out
    raise ArgumentError(
        f"{words} is no distribution: least must be below most with some values between them, mode "
        "from least to most; deviation, median, spread and least of loguniform must be positive"
    )


def _refuse_huge(words: str, values: Iterable[float]) -> None:
    """Refuse a distribution with a huge number or value.

    Raises:
        ArgumentError: If there is one.
    """
    largest = max(map(abs, values))
    if not largest <= _LARGEST:
        raise ArgumentError(f"{words}: {largest:.4g} can occur, but at most {_LARGEST:g} in size")


def _numbers(table: DistributionTable, kind: _Kind, unit: str) -> dict[str, float]:
    """The numbers of a table, by name.

    Raises:
        ArgumentError: If one is missing, or one that the kind does not have is there.
    """
    names = [name for name in DistributionTable.model_fields if name != "distribution"]
    numbers = numbers_of(table, names, lambda name: "" if name == "spread" else unit)

    needed = set(kind.needed)
    if not needed <= numbers.keys() <= needed.union(kind.allowed):
        expected = " and ".join(kind.needed)
        if kind.allowed:
            expected += f" and may have {' and '.join(kind.allowed)}"
        present = ", ".join(numbers) or "nothing"
        raise ArgumentError(f"{table.distribution} needs {expected}, not {present}")
    return numbers
