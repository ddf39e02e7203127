"""Distributions of one number, by their quantile functions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.file.schema import DistributionTable
from grosmc_mj.experiments.file.units import numbers_of

_ENDS = ("least", "most")
# By name: the numbers that each needs, those that it may have, and scipy's distribution of them.
_KINDS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...], Callable[..., Any]]] = {
    "uniform": (_ENDS, (), lambda least, most: stats.uniform(least, most - least)),
    "loguniform": (_ENDS, (), lambda least, most: stats.loguniform(least, most)),
    "triangular": (
        (*_ENDS, "mode"),
        (),
        lambda least, most, mode: stats.triang(
            (mode - least) / (most - least), least, most - least
        ),
    ),
    "normal": (
        ("mean", "deviation"),
        _ENDS,
        lambda mean, deviation, **_: stats.norm(mean, deviation),
    ),
    "lognormal": (
        ("median", "spread"),
        _ENDS,
        lambda median, spread, **_: stats.lognorm(spread, scale=median),
    ),
}


@dataclass(frozen=True)
class Distribution:
    """A distribution of scipy, cut off at both ends of its support.

    Attributes:
        frozen: scipy's frozen distribution, not cut off.
        support: Smallest and largest value; infinite where it has none.
        words: For people.
    """

    frozen: Any
    support: tuple[float, float]
    words: str

    def quantiles(self, u: Array) -> Array:
        """The values of which a share u (n,) lies below; (n,)."""
        low, high = self.frozen.cdf(self.support)
        values = self.frozen.ppf(low + (high - low) * u)
        return np.clip(values, *self.support)


def distribution(spread: list[Any] | DistributionTable, unit: str) -> Distribution:
    """The distribution that a file's range or table describes.

    Args:
        spread: ``[least, most]``, or a table of numbers.
        unit: Of the quantity.

    Raises:
        ArgumentError: If a number is missing, or the numbers make no distribution.
    """
    if not isinstance(spread, DistributionTable):
        least, most = spread
        spread = DistributionTable(distribution="uniform", least=least, most=most)
    kind = spread.distribution
    needed, allowed, frozen_of = _KINDS[kind]
    names = [name for name in DistributionTable.model_fields if name != "distribution"]
    numbers = numbers_of(spread, names, lambda name: "" if name == "spread" else unit)
    if not set(needed) <= numbers.keys() <= {*needed, *allowed}:
        more = f" and may have {' and '.join(allowed)}" if allowed else ""
        raise ArgumentError(
            f"{kind} needs {' and '.join(needed)}{more}, not {', '.join(numbers) or 'nothing'}"
        )
    words = f"{kind}: {', '.join(f'{name} {value:.4g}' for name, value in numbers.items())}"
    least, most = numbers.get("least", -np.inf), numbers.get("most", np.inf)
    if least < most:
        frozen = frozen_of(**numbers)
        # The ends of the table: far out, a quantile function does not find them again.
        support = max(least, float(frozen.support()[0])), min(most, float(frozen.support()[1]))
        low, high = frozen.cdf(support)
        if low < high:
            return Distribution(frozen, support, words)
    raise ArgumentError(
        f"{words} is no distribution: least must be below most with some values between them, mode "
        "from least to most; deviation, median, spread and least of loguniform must be positive"
    )
