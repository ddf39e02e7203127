"""The uncertain numbers of a campaign together: from points of the unit cube to their values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
from scipy import stats

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.distributions import Distribution, distribution
from grosmc_mj.campaign.family.sampling import all_corners
from grosmc_mj.errors import ArgumentError, Mistakes, unknown_name
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.tables.parts import (
    LOOP_UNITS,
    MACHINE_PARTS,
    MACHINE_UNITS,
    in_model,
    unit_of,
)
from grosmc_mj.experiments.file.tables.table import numbers_of
from grosmc_mj.experiments.file.tables.uncertain import QUANTITIES, CorrelationTable, UncertainTable
from grosmc_mj.experiments.metrics.running import METRICS
from grosmc_mj.fields import Range, range_of
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.machine.part import MOST
from grosmc_mj.physics.edits import BodyEdit, JointEdit
from grosmc_mj.physics.files import body_names, joint_names
from grosmc_mj.plants import Plant
from grosmc_mj.results.tables import shown_unit
from grosmc_mj.simulation.disturbances import Pulse

# How far a family is scaled at most, by searches and promises.
LARGEST_SCALE = 8.0

# How the columns of margins begin.
MARGIN = "margin "
# Columns of rows that may have been screened by equations.
SCREENING = ("judged_by", "screened", "overturned", "drawn", "band")
# Columns of the results, beside the uncertain numbers.
RESERVED = ("id", "controller", *METRICS, "relative", "order", "status", "ended", *SCREENING)
# Of loops and disturbances: numbers above zero, numbers not below zero.
_POSITIVE = {"scale", "time_constant", "slope", "bandwidth", "load", "limit", "rate_limit"}
_NOT_NEGATIVE = {
    "added_mass", "delay", "jitter", "resolution", "noise", "period", "lag", "dead_zone",
}  # fmt: skip
_EDITS = {"body": BodyEdit, "joint": JointEdit, **MACHINE_PARTS}
# Rates of turning that nobody gives in degrees.
_FREQUENCIES = ("frequency", "bandwidth")
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
        return (self.unit, 1.0) if self.quantity in _FREQUENCIES else shown_unit(self.unit)

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
        # An added mass is an edit of its own, and may be none.
        edited = self.owner in _EDITS and self.quantity != "added_mass"
        own = range_of(_EDITS[self.owner], self.quantity) if edited else None
        if own is not None:
            return own
        if self.quantity == "missed":
            return Range(0, 1, below=True)
        if self.quantity in _POSITIVE:
            return Range(0, above=True, infinite=True)
        return Range(0 if self.quantity in _NOT_NEGATIVE else -math.inf, infinite=True)

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
        return [each.name for each in self.quantities]

    @property
    def nominal(self) -> Array:
        """Values without uncertainty, (d,)."""
        return np.array([each.nominal for each in self.quantities])

    @property
    def largest_scale(self) -> float:
        """The smallest of the quantities' own."""
        return min(each.largest_scale for each in self.quantities)

    @property
    def bounded(self) -> bool:
        """Whether every number has a smallest and a largest value."""
        return bool(np.all(np.isfinite([each.distribution.support for each in self.quantities])))

    @property
    def independent(self) -> bool:
        """Whether nothing is correlated."""
        return np.array_equal(self.correlation, np.eye(len(self.quantities)))

    def corners(self, most: int) -> Array:
        """The corners of the ranges as points of the unit cube, (2^d, d).

        None, (0, d), where they have none or more than ``most``.
        """
        return all_corners(len(self.quantities), most if self.bounded and self.independent else 0)

    @cached_property
    def _mixing(self) -> Array:
        return np.linalg.cholesky(self.correlation)

    def values(self, points: Array) -> Array:
        """The values at points of the unit cube, (n, d); returns (n, d)."""
        if not self.independent:
            points = stats.norm.cdf(stats.norm.ppf(points) @ self._mixing.T)
        columns = [
            each.distribution.quantiles(points[:, i]) for i, each in enumerate(self.quantities)
        ]
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
    ofs = [f"{each.owner} " * (each.owner in parts) + each.of for each in quantities]
    numbers = [f"{of} {each.quantity}" for of, each in zip(ofs, quantities, strict=True)]
    _refuse_twice(numbers, "uncertain")
    names = [each.name for each in quantities]
    _refuse_twice(names, "called")
    for name in names:
        if not (name.strip() and name.isprintable()):
            raise ArgumentError(f"uncertain: {name!r} is no name: give it one that can be printed")
        if name in RESERVED or name.startswith(MARGIN):
            raise ArgumentError(f"uncertain: {name!r} is a column of the results: give it a name")
    return Family(tuple(quantities), _correlation(file.correlation, names))


def _refuse_twice(names: Sequence[str], how: str) -> None:
    """Refuse two of one name."""
    for name in names:
        if names.count(name) > 1:
            raise ArgumentError(f"uncertain: two are {how} {name!r}")


def _quantity(table: UncertainTable, case: Case, plant: Plant) -> Quantity:
    """One uncertain number, with its unit and its nominal value."""
    unit, index, of = QUANTITIES[table.owner][table.quantity], -1, table.of
    if table.owner == "start":
        names = [state.name for state in plant.system.states]
        require_known("state", table.of, names)
        index = names.index(table.of)
        unit = plant.system.states[index].unit
    if table.owner in MACHINE_PARTS:
        of = in_model(table.of, MACHINE_PARTS[table.owner].owner, plant.system)
    if table.owner in {**LOOP_UNITS, **MACHINE_UNITS}:
        unit = unit_of(table.owner, table.of, table.quantity, plant.system)
    found = Quantity(
        name=table.called,
        owner=table.owner,
        of=of,
        quantity=table.quantity,
        at=(table.at[0], table.at[1], table.at[2]),
        unit=unit,
        distribution=distribution(getattr(table, table.quantity), unit),
        nominal=_NOMINAL[table.owner](table, case, plant),
        index=index,
    )
    found = replace(found, **numbers_of(table, ["nominal"], lambda _: unit))
    for value in (*found.distribution.support, found.nominal):
        if not found.physical(value):
            end = "least" if value <= found.bounds.low else "most"
            raise ArgumentError(
                f"{table.quantity.replace('_', ' ')} = {value:g} can occur, but must be "
                f"{found.bounds.wanted}: cut the distribution off with {end}"
            )
    return found


def _of_body(table: UncertainTable, case: Case, plant: Any) -> float:
    model = _model(plant, "body")
    bodies = body_names(model)
    require_known("body", table.of, bodies)
    if table.quantity == "added_mass":
        return 0.0
    if table.quantity == "mass_scale" and model.body(table.of).mass[0] == 0:
        raise ArgumentError(f"body {table.of!r} has no mass to scale")
    edits = [each for each in case.edits if isinstance(each, BodyEdit) and each.body == table.of]
    return float(getattr(edits[0], table.quantity)) if edits else 1.0


def _of_joint(table: UncertainTable, case: Case, plant: Any) -> float:
    model = _model(plant, "joint")
    joints = joint_names(model)
    require_known("joint", table.of, joints)
    return float(getattr(model, _OF_JOINT[table.quantity])[model.joint(table.of).dofadr[0]])


def _of_disturbance(table: UncertainTable, case: Case, plant: Any) -> float:
    named = {each.label: each for each in case.disturbances if each.label}
    if table.of not in named:
        raise ArgumentError(
            unknown_name("disturbance", table.of, named)
            if named
            else f"no [[disturbance]] has the label {table.of!r}"
        )
    if [each.label for each in case.disturbances].count(table.of) > 1:
        raise ArgumentError(f"two disturbances have the label {table.of!r}: give each its own")
    profile = named[table.of].profile
    if table.quantity == "amplitude":
        return 0.0
    if isinstance(profile, Pulse) and table.quantity == "onset":
        return profile.start
    value: Any = getattr(profile, table.quantity, None)
    if value is None:
        raise ArgumentError(f"a {type(profile).__name__} profile has no {table.quantity}")
    return float(value)


def _of_start(table: UncertainTable, case: Case, plant: Any) -> float:
    return case.x0[[state.name for state in plant.system.states].index(table.of)]


def _of_parameter(table: UncertainTable, case: Case, plant: Any) -> float:
    if plant.kind == "physics":
        raise ArgumentError("the plant has a model in MuJoCo: name a body or a joint instead")
    if not hasattr(plant.parameters, table.of):
        raise ArgumentError(unknown_name("parameter", table.of, vars(plant.parameters)))
    return 1.0


def _of_loop(table: UncertainTable, case: Case, plant: Any) -> float:
    single = table.owner == "computing"
    header = "[computing]" if single else f"[[{table.owner}]]"
    if case.loop is None or not (single or getattr(case.loop, f"{table.owner}s")):
        of = "" if single else f' with of = "{table.of}"'
        raise ArgumentError(
            f"the case file has no {header}, of which this is a number: write one{of} into it"
        )
    part = case.loop.part(table.owner, table.of)
    value = getattr(part, table.quantity)
    if value is None or (math.isinf(value) and table.nominal is None):
        raise ArgumentError(
            f"the {header} has no {table.quantity}: write one into it, or nominal into this "
            "[[uncertain]]"
        )
    return float(value)


def _of_machine(table: UncertainTable, case: Case, plant: Any) -> float:
    kind = MACHINE_PARTS[table.owner]
    of = in_model(table.of, kind.owner, plant.system)
    own = [each for each in case.edits if isinstance(each, kind) and each.of == of]
    if len(own) != 1:
        raise ArgumentError(
            f"the file has {len(own) or 'no'} [[{table.owner}]] of {table.of!r}: it must have one"
        )
    value = float(getattr(own[0], table.quantity))
    if math.isinf(value) and table.nominal is None:
        raise ArgumentError(
            f"the {table.owner} has no {table.quantity.replace('_', ' ')}: give it one, or nominal"
        )
    return value


_NOMINAL = {
    "body": _of_body,
    "joint": _of_joint,
    "disturbance": _of_disturbance,
    "start": _of_start,
    "parameter": _of_parameter,
    **dict.fromkeys(LOOP_UNITS, _of_loop),
    **dict.fromkeys(MACHINE_UNITS, _of_machine),
}


def _model(plant: Plant, owner: str) -> mujoco.MjModel:
    """The model of a plant that has one."""
    if plant.kind == "physics":
        return plant.model
    raise ArgumentError(f"the plant has no model in MuJoCo, so no {owner}: name a parameter")


def _correlation(tables: Sequence[CorrelationTable], names: Sequence[str]) -> Array:
    """The correlations as a matrix."""
    found = np.eye(len(names))
    for table in tables:
        for name in table.between:
            require_known("number", name, names, where="correlation: ")
        i, j = (names.index(name) for name in table.between)
        if i == j:
            raise ArgumentError(f"correlation of {names[i]} with itself: name two different ones")
        if found[i, j]:
            raise ArgumentError(f"correlation between {' and '.join(table.between)}: given twice")
        found[i, j] = found[j, i] = table.coefficient
    if np.linalg.eigvalsh(found).min() < 1e-12:
        raise ArgumentError(
            "correlation: no numbers can be correlated like that: the matrix is not positive "
            "definite"
        )
    return found
