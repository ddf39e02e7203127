"""Distributions of one number, by their quantile functions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.file.schema import DistributionTable
from grosmc_mj.experiments.file.units import number_in

# The numbers of each distribution, and those that it may have besides.
_NUMBERS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "uniform": (("least", "most"), ()),
    "loguniform": (("least", "most"), ()),
    "triangular": (("least", "mode", "most"), ()),
    "normal": (("mean", "deviation"), ("least", "most")),
    "lognormal": (("median", "spread"), ("least", "most")),
}
# Pure numbers, whatever the unit of the quantity.
_PURE = ("spread",)


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
        ArgumentError: If a number is missing or wrong, or the range is empty.
    """
    if not isinstance(spread, DistributionTable):
        least, most = spread
        spread = DistributionTable(distribution="uniform", least=least, most=most)
    return _checked(spread.distribution, _read(spread, unit))


def _read(table: DistributionTable, unit: str) -> dict[str, float]:
    """The numbers of a table, in the quantity's unit."""
    needed, allowed = _NUMBERS[table.distribution]
    given = {
        name: getattr(table, name)
        for name in DistributionTable.model_fields
        if name != "distribution" and getattr(table, name) is not None
    }
    if missing := [name for name in needed if name not in given]:
        raise ArgumentError(f"{table.distribution} needs {' and '.join(missing)}")
    if idle := [name for name in given if name not in (*needed, *allowed)]:
        valid = ", ".join((*needed, *allowed))
        raise ArgumentError(f"{table.distribution} has no {', '.join(idle)}; valid: {valid}")
    found = {}
    for name, value in given.items():
        try:
            found[name] = number_in(value, "" if name in _PURE else unit)
        except ArgumentError as error:
            raise ArgumentError(f"{name}: {error}") from None
    return found


def _checked(kind: str, numbers: dict[str, float]) -> Distribution:
    """The distribution of numbers that make one."""
    least, most = numbers.get("least", -np.inf), numbers.get("most", np.inf)
    if not least < most:
        raise ArgumentError(f"from {least:g} to {most:g} is no range: least must be below most")
    for name in ("deviation", "spread", "median"):
        if name in numbers and not numbers[name] > 0:
            raise ArgumentError(f"{name} = {numbers[name]:g} must be positive")
    if kind == "uniform":
        frozen = stats.uniform(least, most - least)
    elif kind == "loguniform":
        if not least > 0:
            raise ArgumentError(f"loguniform needs least above 0, not {least:g}")
        frozen = stats.loguniform(least, most)
    elif kind == "triangular":
        mode = numbers["mode"]
        if not least <= mode <= most:
            raise ArgumentError(f"mode = {mode:g} must lie between {least:g} and {most:g}")
        frozen = stats.triang((mode - least) / (most - least), least, most - least)
    elif kind == "normal":
        frozen = stats.norm(numbers["mean"], numbers["deviation"])
    else:
        frozen = stats.lognorm(numbers["spread"], scale=numbers["median"])
    # The ends as given: far out, a quantile function does not find them again.
    support = max(least, float(frozen.support()[0])), min(most, float(frozen.support()[1]))
    low, high = frozen.cdf(support)
    if not low < high:
        raise ArgumentError(f"{kind} has nothing between {least:g} and {most:g}")
    words = ", ".join(f"{name} {value:.4g}" for name, value in numbers.items())
    return Distribution(frozen, support, f"{kind}: {words}")
