"""The family of a case file: its uncertain numbers, their correlation, points and values."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.part_tables import in_model
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, unit_of
from grosmc_mj.experiments.file.schema import (
    QUANTITIES,
    CaseFile,
    CorrelationTable,
    DistributionTable,
    UncertainTable,
)
from grosmc_mj.experiments.requirements.metrics import may_be_stored
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, Mistakes
from grosmc_mj.ground.units import number_in, numbers_of, si_number
from grosmc_mj.studies.sweep.distributions import EDGE, distribution
from grosmc_mj.studies.sweep.quantities import (
    QUANTITY_KINDS,
    AddedMassQuantity,
    Quantity,
    state_index,
)
from grosmc_mj.studies.sweep.runs import MARGIN
from grosmc_mj.theory.plants import Plant, System

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


def family_of(file: CaseFile, case: Experiment, plant: Plant) -> Family:
    """Read the uncertainty that a case file declares.

    Args:
        file: The file.
        case: Its start, edits and disturbances.
        plant: Its plant, with the file's edits.

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

    names = [number.name for number in quantities]
    _refuse_twice("uncertain", [number.place_words for number in quantities])
    _refuse_twice("called", names)
    for name in names:
        if name in _RESERVED or name.startswith(MARGIN) or may_be_stored(name):
            raise ArgumentError(f"uncertain: {name!r} is a column of the results: give it a name")
    return Family(tuple(quantities), _correlation(file.correlation, names))


def _refuse_twice(how: str, texts: Sequence[str]) -> None:
    """Refuse a text that is there twice."""
    for text, count in Counter(texts).items():
        if count > 1:
            raise ArgumentError(f"uncertain: two are {how} {text!r}")


def _quantity(table: UncertainTable, case: Experiment, plant: Plant) -> Quantity:
    """Read one uncertain number, with its unit and its nominal value.

    Raises:
        ArgumentError: If the case has no such number, or a value that can occur is impossible.
    """
    owner = table.owner
    of = table.of
    unit = _unit_of(owner, of, table.quantity, plant.system)
    if owner == "joint" and of in plant.system.joints:
        table = _in_si(table, plant.system.joint_units(of)[table.quantity])
    if owner in MACHINE_PARTS:
        of = in_model(of, MACHINE_PARTS[owner].owner, plant.system)

    kind = AddedMassQuantity if table.quantity == "added_mass" else QUANTITY_KINDS[owner]
    x, y, z = table.at
    number = kind(
        owner=owner,
        of=of,
        quantity=table.quantity,
        at=(x, y, z),
        name=table.called,
        unit=unit,
        distribution=distribution(getattr(table, table.quantity), unit),
    )
    nominal = numbers_of(table, ["nominal"], lambda _: unit).get("nominal")
    if nominal is None:
        nominal = number.value(case, plant)
    number = replace(number, nominal=nominal)
    _refuse_impossible(number)
    return number


def _unit_of(owner: str, of: str, quantity: str, system: System) -> str:
    """Unit of a number on a system; empty for a factor.

    Raises:
        ArgumentError: If the system has no such state, input or joint.
    """
    if owner == "start":
        return system.states[state_index(of, system)].unit
    if owner in MACHINE_PARTS or owner in LOOP_PARTS:
        return unit_of(owner, of, quantity, system)
    return QUANTITIES[owner][quantity]


def _refuse_impossible(number: Quantity) -> None:
    """Refuse a number without nominal value, and values that no plant can have."""
    quantity = number.quantity
    if not math.isfinite(number.nominal):
        raise ArgumentError(f"{quantity} is not limited: write nominal into this [[uncertain]]")
    for value in (*number.distribution.support, number.nominal):
        if not number.physical(value):
            end = "least" if value <= number.bounds.low else "most"
            raise ArgumentError(
                f"{quantity.replace('_', ' ')} = {value:g} can occur, but must be "
                f"{number.bounds.wanted}: cut the distribution off with {end}"
            )


def _in_si(table: UncertainTable, unit: str) -> UncertainTable:
    """Return the table of a joint's number with its quantities as numbers in an SI unit."""
    quantity = table.quantity
    spread = getattr(table, quantity)
    changes: dict[str, Any] = {}
    mistakes = Mistakes()
    if isinstance(spread, DistributionTable):
        numbers = {}
        for name, value in spread.model_dump(exclude_unset=True).items():
            if isinstance(value, str) and name not in ("distribution", "spread"):
                with mistakes.gathered(f"{name}: "):
                    numbers[name] = number_in(value, unit)
        changes[quantity] = spread.model_copy(update=numbers)
    else:
        with mistakes.gathered():
            changes[quantity] = [si_number(value, unit) for value in spread]
    if table.nominal is not None:
        with mistakes.gathered("nominal: "):
            changes["nominal"] = si_number(table.nominal, unit)
    mistakes.refuse()
    return table.model_copy(update=changes)


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
