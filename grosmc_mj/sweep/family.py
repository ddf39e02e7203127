"""The uncertain numbers of a campaign: distributions, points of the unit cube, their values."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, Mistakes
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.parts import MACHINE_PARTS, in_model
from grosmc_mj.experiments.file.schema import (
    CaseFile,
    CorrelationTable,
    DistributionTable,
    UncertainTable,
)
from grosmc_mj.experiments.file.units import numbers_of
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.machine.part import MOST
from grosmc_mj.plants import Plant
from grosmc_mj.results.tables import shown_unit
from grosmc_mj.sweep.parameters import Parameter
from grosmc_mj.sweep.runs import MARGIN

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


# Points stay off the faces of the cube, where quantiles may be infinite.
_EDGE = 2.0**-53


def random_points(dimensions: int, seed: int, first: int, count: int) -> Array:
    """Independent points of the unit cube, each by the seed and its own number alone.

    Args:
        dimensions: Of the cube, d.
        seed: Of all points.
        first: Number of the first point.
        count: Number of points.

    Returns:
        Points off the faces of the cube, (count, d).
    """
    points = np.zeros((count, dimensions))
    for row in range(count):
        bits = np.random.Philox(key=seed, counter=[0, 0, 0, first + row])
        points[row] = np.random.Generator(bits).random(dimensions)
    return inside(points)


def corner_points(dimensions: int, first: int, count: int) -> Array:
    """Corners of the unit cube, (count, d): bit j of a corner's number is its coordinate j.

    Args:
        dimensions: Of the cube, d.
        first: Number of the first corner.
        count: Number of corners.
    """
    numbers = np.arange(first, first + count)
    bits = numbers[:, None] >> np.arange(dimensions) & 1
    return bits.astype(float)


def inside(points: Array) -> Array:
    """Points of the cube, moved off its faces."""
    return np.clip(points, _EDGE, 1 - _EDGE)


# Columns of rows that may have been screened by equations, with their units.
SCREENING = {"judged_by": "", "screened": "1", "overturned": "1", "drawn": "1", "band": "1"}
# Columns of the results, beside the uncertain numbers.
_RESERVED = {"id", "controller", *METRICS, "relative", "order", "status", "ended", *SCREENING}


@dataclass(frozen=True, kw_only=True)
class Quantity(Parameter):
    """One uncertain number.

    Attributes:
        name: What it is called.
        unit: Of its values; empty for a factor.
        distribution: Of its values.
        nominal: Value without uncertainty.
    """

    name: str
    unit: str
    distribution: Distribution
    nominal: float = 0.0

    @property
    def shown_unit(self) -> tuple[str, float]:
        """The unit that people read, and the factor to it; frequencies stay in rad/s."""
        frequency = self.quantity in ("frequency", "bandwidth")
        return (self.unit, 1.0) if frequency else shown_unit(self.unit)

    def words(self, value: float) -> str:
        """A value with its name, in the unit that people read."""
        unit, factor = self.shown_unit
        return f"{self.name} {value * factor:.4g} {unit}".rstrip()

    def physical(self, value: float) -> bool:
        """Whether a plant can have this value; of a range without an end, one that is far out."""
        return self.bounds.holds(max(-MOST, min(value, MOST)))

    def ends(self, scale: float) -> tuple[float, float]:
        """Smallest and largest value at a scale of the uncertainty; infinite where it has none."""
        low, high = self.distribution.support
        nominal = self.nominal
        return nominal + scale * (low - nominal), nominal + scale * (high - nominal)

    @property
    def largest_scale(self) -> float:
        """The factor on distances from the nominal value up to which all values are physical."""
        (least, most), nominal, bounds = self.distribution.support, self.nominal, self.bounds
        down = (nominal - bounds.low) / (nominal - least) if least < nominal else math.inf
        # A share of samples stays below all of them.
        up = (bounds.high - nominal) / (most - nominal) * (1 - 1e-9) if most > nominal else math.inf
        return min(down, up)


@dataclass(frozen=True, eq=False)
class Family:
    """The uncertain numbers, and how they vary together.

    Attributes:
        quantities: In the order of the file.
        correlation: Of the Gaussian copula, (d, d).
    """

    quantities: tuple[Quantity, ...]
    correlation: Array

    @property
    def names(self) -> list[str]:
        """Names of the numbers."""
        return [number.name for number in self.quantities]

    @property
    def nominal(self) -> Array:
        """Values without uncertainty, (d,)."""
        return np.array([number.nominal for number in self.quantities])

    @property
    def largest_scale(self) -> float:
        """The smallest of the quantities' own."""
        return min(number.largest_scale for number in self.quantities)

    @property
    def bounded(self) -> bool:
        """Whether every number has a smallest and a largest value."""
        return bool(np.all(np.isfinite([of.distribution.support for of in self.quantities])))

    @property
    def independent(self) -> bool:
        """Whether nothing is correlated."""
        return np.array_equal(self.correlation, np.eye(len(self.quantities)))

    @property
    def corner_count(self) -> int:
        """How many corners the ranges have; none without ends, or of correlated numbers."""
        return 2 ** len(self.quantities) if self.bounded and self.independent else 0

    def corners(self, most: int) -> Array:
        """The corners of the ranges as points of the unit cube, (2^d, d).

        None, (0, d), where they have none or more than ``most``.
        """
        d = len(self.quantities)
        if not 0 < self.corner_count <= most:
            return np.zeros((0, d))
        return np.array(list(itertools.product((0.0, 1.0), repeat=d)))

    @cached_property
    def _mixing(self) -> Array:
        return np.linalg.cholesky(self.correlation)

    def values(self, points: Array) -> Array:
        """The values at points of the unit cube, (n, d); returns (n, d)."""
        if not self.independent:
            points = stats.norm.cdf(stats.norm.ppf(points) @ self._mixing.T)
        columns = [of.distribution.quantiles(points[:, i]) for i, of in enumerate(self.quantities)]
        return np.stack(columns, axis=1)

    def scaled(self, values: Array, scale: float) -> Array:
        """Values (..., d) moved to ``scale`` times their distance from the nominal ones."""
        return self.nominal + scale * (values - self.nominal)


def family_of(file: CaseFile, case: Case, plant: Plant) -> Family:
    """The uncertainty that a case file declares.

    Args:
        file: The file.
        case: Its start, edits and disturbances.
        plant: The plant that it is about, with the file's edits.

    Raises:
        ArgumentError: If there is none, a name is unknown, a range impossible or not physical, or
            something is uncertain twice.
    """
    if not file.uncertain:
        raise ArgumentError("nothing is uncertain: give it an [[uncertain]]")
    quantities: list[Quantity] = []
    mistakes = Mistakes()
    for index, table in enumerate(file.uncertain):
        with mistakes.gathered(f"uncertain {index + 1} ({table.called}): "):
            quantities.append(_quantity(table, case, plant))
    mistakes.refuse()
    numbers = [
        f"{q.owner} " * (q.of_loop or q.owner in MACHINE_PARTS) + f"{q.of} {q.quantity}"
        for q in quantities
    ]
    names = [number.name for number in quantities]
    for how, of_them in (("uncertain", numbers), ("called", names)):
        if twice := [name for name, count in Counter(of_them).items() if count > 1]:
            raise ArgumentError(f"uncertain: two are {how} {twice[0]!r}")
    for name in names:
        if name in _RESERVED or name.startswith(MARGIN):
            raise ArgumentError(f"uncertain: {name!r} is a column of the results: give it a name")
    return Family(tuple(quantities), _correlation(file.correlation, names))


def _quantity(table: UncertainTable, case: Case, plant: Plant) -> Quantity:
    """One uncertain number, with its unit and its nominal value."""
    owner, of, quantity, (x, y, z) = table.owner, table.of, table.quantity, table.at
    unit = Parameter(owner, of, quantity).unit_on(plant.system)
    if owner in MACHINE_PARTS:
        of = in_model(of, MACHINE_PARTS[owner].owner, plant.system)
    spread = distribution(getattr(table, quantity), unit)
    number = Quantity(
        owner, of, quantity, (x, y, z), name=table.called, unit=unit, distribution=spread
    )
    own = numbers_of(table, ["nominal"], lambda _: unit)
    nominal = own["nominal"] if "nominal" in own else number.value(case, plant)
    number = replace(number, nominal=nominal)
    if not math.isfinite(number.nominal):
        raise ArgumentError(f"{quantity} is not limited: write nominal into this [[uncertain]]")
    for value in (*number.distribution.support, number.nominal):
        if not number.physical(value):
            end = "least" if value <= number.bounds.low else "most"
            raise ArgumentError(
                f"{quantity.replace('_', ' ')} = {value:g} can occur, but must be "
                f"{number.bounds.wanted}: cut the distribution off with {end}"
            )
    return number


def _correlation(tables: Sequence[CorrelationTable], names: Sequence[str]) -> Array:
    """The correlations as a matrix."""
    matrix = np.eye(len(names))
    for table in tables:
        for name in table.between:
            require_known("number", name, names, where="correlation: ")
        i, j = (names.index(name) for name in table.between)
        if matrix[i, j]:
            between = " and ".join(table.between)
            raise ArgumentError(f"correlation of {between}: give it once, of two different numbers")
        matrix[i, j] = matrix[j, i] = table.coefficient
    if np.linalg.eigvalsh(matrix).min() < 1e-12:
        raise ArgumentError(
            "correlation: no numbers can be correlated like that: the matrix is not positive "
            "definite"
        )
    return matrix
