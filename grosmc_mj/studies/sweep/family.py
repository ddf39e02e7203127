"""The family of a case file: its uncertain numbers, their correlation, points and values."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import (
    CaseFile,
    CorrelationTable,
    DistributionTable,
    UncertainTable,
)
from grosmc_mj.experiments.number import Number
from grosmc_mj.experiments.requirements.metrics import may_be_stored
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, Mistakes, placed
from grosmc_mj.ground.units import in_units, number_in
from grosmc_mj.ground.wording import spelled
from grosmc_mj.studies.sweep.distributions import EDGE, distribution
from grosmc_mj.studies.sweep.quantities import Quantity
from grosmc_mj.studies.sweep.runs import MARGIN

# Share of a range without an end that searches leave out there, where nothing is the worst.
_TAIL = 0.001


def random_points(
    dimensions: int,
    seed: int,
    first: int,
    count: int,
) -> Array:
    """Draw independent points of the unit cube, each by the seed and its own number alone.

    Args:
        dimensions: Dimensions of the cube, d.
        seed: Seed of all points.
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
    """Return corners of the unit cube, (count, d): bit j of a corner's number is coordinate j.

    Args:
        dimensions: Dimensions of the cube, d.
        first: Number of the first corner.
        count: Number of corners.
    """
    numbers = np.arange(first, first + count)
    bits = numbers[:, None] >> np.arange(dimensions) & 1
    return bits.astype(float)


def inside(points: Array) -> Array:
    """Return points of the cube, moved off its faces."""
    return np.clip(points, EDGE, 1 - EDGE)


# Columns of rows that may have been screened by equations, with their units.
SCREENING = {"judged_by": "", "screened": "1", "overturned": "1", "drawn": "1", "band": "1"}
# Columns of the results, beside the uncertain numbers.
_RESERVED = {"id", "controller", "relative", "order", "status", "ended", *SCREENING}


@dataclass(frozen=True, eq=False)
class Family:
    """Uncertain numbers and their correlation.

    Attributes:
        quantities: The numbers, in the order of the file.
        correlation: Correlation matrix of the Gaussian copula, (d, d).
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
        """The smallest of the numbers' largest scales."""
        return min(number.largest_scale for number in self.quantities)

    @property
    def bounded(self) -> bool:
        """Whether every number has a smallest and a largest value."""
        supports = [number.distribution.support for number in self.quantities]
        return bool(np.all(np.isfinite(supports)))

    @property
    def independent(self) -> bool:
        """Whether nothing is correlated."""
        return np.array_equal(self.correlation, np.eye(len(self.quantities)))

    @property
    def corner_count(self) -> int:
        """Number of corners of the ranges; 0 without ends, or of correlated numbers."""
        if not (self.bounded and self.independent):
            return 0
        return 2 ** len(self.quantities)

    def corners(self, most: int) -> Array:
        """Return the corners of the ranges as points of the unit cube, (2^d, d).

        There are none, (0, d), if the ranges have none or more than ``most``.
        """
        d = len(self.quantities)
        if not 0 < self.corner_count <= most:
            return np.zeros((0, d))
        return np.array(list(itertools.product((0.0, 1.0), repeat=d)))

    @property
    def search_bounds(self) -> Array:
        """Points of the unit cube between which searches move, (2, d): all of a bounded range."""
        bounds = np.zeros((2, len(self.quantities)))
        bounds[1] = 1.0
        for index, number in enumerate(self.quantities):
            low, high = number.distribution.support
            if not math.isfinite(low):
                bounds[0, index] = _TAIL
            if not math.isfinite(high):
                bounds[1, index] = 1 - _TAIL
        return bounds

    def values(self, points: Array) -> Array:
        """Return the values at points of the unit cube, both (n, d)."""
        if not self.independent:
            mixing = np.linalg.cholesky(self.correlation)
            points = stats.norm.cdf(stats.norm.ppf(points) @ mixing.T)

        columns = [
            number.distribution.quantiles(points[:, i]) for i, number in enumerate(self.quantities)
        ]
        return np.stack(columns, axis=1)

    def scaled(self, values: Array, scale: float) -> Array:
        """Return values (..., d) moved to ``scale`` times their distance from the nominal ones."""
        return self.nominal + scale * (values - self.nominal)


def family_of(file: CaseFile, case: Experiment) -> Family:
    """Read the uncertainty that a case file declares.

    Args:
        file: The file.
        case: The case whose numbers are uncertain.

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
            quantities.append(_quantity(table, case))
    mistakes.refuse()

    names = [quantity.name for quantity in quantities]
    steps = [quantity.number.steps for quantity in quantities]
    for quantity in quantities:
        if steps.count(quantity.number.steps) > 1:
            raise ArgumentError(f"uncertain: two are uncertain {quantity.number.path!r}")
        if names.count(quantity.name) > 1:
            raise ArgumentError(f"uncertain: two are called {quantity.name!r}")
    for name in names:
        if name in _RESERVED or name.startswith(MARGIN) or may_be_stored(name):
            raise ArgumentError(f"uncertain: {name!r} is a column of the results: give it a name")
    return Family(tuple(quantities), _correlation(file.correlation, names))


def number_of(table: UncertainTable, case: Experiment) -> Number:
    """Return the number that a table of a case says to be uncertain.

    Raises:
        ArgumentError: If the case has no such number.
    """
    number = Number.of(case, table.number)
    if table.at is None:
        return number
    place = number.place
    if (place.owner, place.field) != ("edit", "added_mass"):
        raise ArgumentError("at is where an added_mass is: give it one")
    return Number.of_mass(case, place.name, tuple(table.at))


def _quantity(table: UncertainTable, case: Experiment) -> Quantity:
    """Read one uncertain number, with its nominal value.

    Raises:
        ArgumentError: If the case has no such number, or a value that can occur is impossible.
    """
    number = number_of(table, case)
    if number.of_file:
        raise ArgumentError(
            f"{number.path} is of the laws or of what they must keep: a campaign varies the plant, "
            "the loop, disturbances and starts"
        )
    values = table.values
    nominal = table.nominal
    if number.bounds.bare:
        values = _with_units(values)
        nominal = in_units(nominal)

    spread_out = distribution(values, number.unit)
    if nominal is None:
        nominal = number.get(case)
    else:
        with placed("nominal: "):
            nominal = number_in(nominal, number.unit)
    quantity = Quantity(number, table.called, spread_out, nominal)
    _refuse_impossible(quantity)
    return quantity


def _with_units(values: Any) -> Any:
    """Return a range or a distribution whose numbers are in the unit of what they are of."""
    if isinstance(values, DistributionTable):
        numbers = values.model_dump(exclude_unset=True, exclude={"distribution", "spread"})
        return values.model_copy(update=in_units(numbers))
    return in_units(values)


def _refuse_impossible(quantity: Quantity) -> None:
    """Refuse a number without nominal value, and values that no plant can have."""
    field = quantity.number.place.field
    if not math.isfinite(quantity.nominal):
        raise ArgumentError(f"{field} is not limited: write nominal into this [[uncertain]]")
    for value in (*quantity.distribution.support, quantity.nominal):
        if not quantity.physical(value):
            end = "least" if value <= quantity.bounds.low else "most"
            raise ArgumentError(
                f"{spelled(field)} = {value:g} can occur, but must be "
                f"{quantity.bounds.wanted}: cut the distribution off with {end}"
            )


def _correlation(tables: Sequence[CorrelationTable], names: Sequence[str]) -> Array:
    """Correlation matrix, (d, d), of numbers in the order of their names."""
    matrix = np.eye(len(names))
    for table in tables:
        for name in table.between:
            require_known("number", name, names, where="correlation: ")
        first, second = table.between
        i = names.index(first)
        j = names.index(second)
        if matrix[i, j]:
            raise ArgumentError(
                f"correlation of {first} and {second}: give it once, of two different numbers"
            )
        matrix[i, j] = matrix[j, i] = table.coefficient

    # Rounding of a matrix that is barely positive definite.
    if np.linalg.eigvalsh(matrix).min() < 1e-12:
        raise ArgumentError(
            "correlation: no numbers can be correlated like that: the matrix is not positive "
            "definite"
        )
    return matrix
