"""The uncertain numbers of a campaign: from points of the unit cube to their values."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.campaign.distributions import Distribution, distribution
from grosmc_mj.campaign.plant_sample import EDITS, edits_of
from grosmc_mj.errors import ArgumentError, Mistakes
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.parts import (
    LOOP_PARTS,
    LOOP_UNITS,
    MACHINE_PARTS,
    MACHINE_UNITS,
    in_model,
    unit_of,
)
from grosmc_mj.experiments.file.schema import (
    QUANTITIES,
    CaseFile,
    CorrelationTable,
    UncertainTable,
)
from grosmc_mj.experiments.file.units import numbers_of
from grosmc_mj.experiments.metrics import METRICS
from grosmc_mj.fields import Range, range_of
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.machine.part import MOST
from grosmc_mj.physics.files import body_names, joint_names
from grosmc_mj.plants import Plant
from grosmc_mj.results.tables import shown_unit
from grosmc_mj.simulation.disturbances import Pulse

# How the columns of margins begin.
MARGIN = "margin "
# Columns of rows that may have been screened by equations, with their units.
SCREENING = {"judged_by": "", "screened": "1", "overturned": "1", "drawn": "1", "band": "1"}
# Columns of the results, beside the uncertain numbers.
_RESERVED = {"id", "controller", *METRICS, "relative", "order", "status", "ended", *SCREENING}
# Bounds of numbers that are no fields of a part or an edit.
_BOUNDS = {"scale": Range(0, above=True), "added_mass": Range(0)}
# Where a model keeps what a joint edit changes.
_OF_JOINT = {"damping": "dof_damping", "friction": "dof_frictionloss", "armature": "dof_armature"}


@dataclass(frozen=True)
class Quantity:
    """One uncertain number.

    Attributes:
        name: What it is called.
        owner: ``body``, ``joint``, ``disturbance``, ``start``, ``parameter``, or a part of the loop
            or of the machine.
        of: Name of that.
        quantity: Which of its numbers.
        at: Of an added mass: where on the body [m].
        unit: Of its values; empty for a factor.
        distribution: Of its values.
        nominal: Value without uncertainty.
        index: Of a start: which of the states.
    """

    name: str
    owner: str
    of: str
    quantity: str
    at: tuple[float, float, float]
    unit: str
    distribution: Distribution
    nominal: float
    index: int = -1

    @property
    def of_plant(self) -> bool:
        """Whether it changes the plant, and not what acts on it or where it starts."""
        return self.owner in {"body", "joint", "parameter", *MACHINE_UNITS}

    @property
    def shown_unit(self) -> tuple[str, float]:
        """The unit that people read, and the factor to it; frequencies stay in rad/s."""
        frequency = self.quantity in ("frequency", "bandwidth")
        return (self.unit, 1.0) if frequency else shown_unit(self.unit)

    def words(self, value: float) -> str:
        """A value with its name, in the unit that people read."""
        unit, factor = self.shown_unit
        return f"{self.name} {value * factor:.4g} {unit}".rstrip()

    def as_run(self, value: float, timestep: float, control_period: float) -> float:
        """What a drawn value is run as: times of a loop are whole timesteps [s]."""
        if self.owner in LOOP_UNITS and self.quantity in TIMES:
            return time_as_run(self.quantity, value, timestep, control_period)
        return value

    @property
    def bounds(self) -> Range:
        """The values that a plant can have."""
        kind = {**EDITS, **LOOP_PARTS}.get(self.owner)
        # An added mass is an edit of its own, and may be none.
        own = None if self.quantity == "added_mass" else kind and range_of(kind, self.quantity)
        return own or _BOUNDS.get(self.quantity, Range())

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
    parts = {*LOOP_UNITS, *MACHINE_UNITS}
    numbers = [f"{q.owner} " * (q.owner in parts) + f"{q.of} {q.quantity}" for q in quantities]
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
    owner, quantity, of, index = table.owner, table.quantity, table.of, -1
    unit = QUANTITIES[owner][quantity]
    if owner == "start":
        names = [state.name for state in plant.system.states]
        require_known("state", of, names)
        index = names.index(of)
        unit = plant.system.states[index].unit
    if owner in MACHINE_PARTS:
        of = in_model(of, MACHINE_PARTS[owner].owner, plant.system)
    if owner in LOOP_UNITS or owner in MACHINE_UNITS:
        unit = unit_of(owner, table.of, quantity, plant.system)
    x, y, z = table.at
    number = Quantity(
        table.called, owner, of, quantity, (x, y, z), unit,
        distribution(getattr(table, quantity), unit), 0.0, index,
    )  # fmt: skip
    own = numbers_of(table, ["nominal"], lambda _: unit)
    number = replace(number, nominal=own.get("nominal", _nominal(number, case, plant)))
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


def _nominal(number: Quantity, case: Case, plant: Any) -> float:
    """The number that a case has without its uncertainty.

    Raises:
        ArgumentError: If the case has no such number.
    """
    owner, of, quantity = number.owner, number.of, number.quantity
    if owner == "start":
        return case.x0[number.index]
    if owner == "parameter":
        if plant.kind == "physics":
            raise ArgumentError("the plant has a model in MuJoCo: name a body or a joint instead")
        require_known("parameter", of, vars(plant.parameters))
        return 1.0
    if owner == "disturbance":
        return _of_disturbance(of, quantity, case)
    if owner in LOOP_UNITS:
        if case.loop is None:
            raise ArgumentError(
                f"the case file has no {owner}, of which this is a number: write one"
            )
        value = getattr(case.loop.part(owner, of), quantity)
    else:
        value = _of_model(number, case, plant)
    return math.inf if value is None else float(value)


def _of_model(number: Quantity, case: Case, plant: Any) -> float | None:
    """A number of a body, a joint or a part of the machine."""
    owner, of, quantity = number.owner, number.of, number.quantity
    if plant.kind != "physics":
        raise ArgumentError(f"the plant has no model in MuJoCo, so no {owner}: name a parameter")
    if owner == "joint":
        require_known("joint", of, joint_names(plant.model))
        joint = plant.model.joint(of)
        return getattr(plant.model, _OF_JOINT[quantity])[joint.dofadr[0]]
    own = edits_of(case.edits, owner, of)
    if owner == "body":
        require_known("body", of, body_names(plant.model))
        nominal = 0.0 if quantity == "added_mass" else 1.0
        return getattr(case.edits[own[0]], quantity, nominal) if own else nominal
    if len(own) != 1:
        count = len(own) or "no"
        raise ArgumentError(f"the file has {count} [[{owner}]] of {of!r}: it must have one")
    return getattr(case.edits[own[0]], quantity)


def _of_disturbance(of: str, quantity: str, case: Case) -> float:
    """A number of a disturbance; without uncertainty there is none."""
    labels = [disturbance.label for disturbance in case.disturbances]
    require_known("disturbance", of, [label for label in labels if label])
    if labels.count(of) > 1:
        raise ArgumentError(f"two disturbances have the label {of!r}: give each its own")
    profile: Any = case.disturbances[labels.index(of)].profile
    if quantity == "amplitude":
        return 0.0
    if isinstance(profile, Pulse) and quantity == "onset":
        return profile.start
    if not hasattr(profile, quantity):
        raise ArgumentError(f"a {type(profile).__name__} profile has no {quantity}")
    return float(getattr(profile, quantity))


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
