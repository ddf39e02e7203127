"""The parameters that a log is fitted by: numbers of the plant, and of its sensors and delay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import QUANTITIES, UncertainTable
from grosmc_mj.identify.replay import ideal
from grosmc_mj.plants import Plant
from grosmc_mj.sweep.family import Quantity, family_of
from grosmc_mj.sweep.parameters import varied

# Numbers of a loop that a log shows: how late inputs arrive, and how a sensor errs.
_OF_LOOP = {("computing", "delay"), ("actuator", "delay")}
_OF_LOOP |= {("sensor", quantity) for quantity in ("delay", "bias", "scale")}
# What a path can be of.
_PATHS = ("body", "joint", "parameter")
# Of a number without a range: from and to so many times its value.
_RANGE = (0.1, 10.0)


@dataclass(frozen=True, eq=False)
class Parameters:
    """The parameters of a fit.

    Attributes:
        experiment: The case.
        quantities: What is fitted.
    """

    experiment: Experiment
    quantities: Sequence[Quantity]

    @property
    def names(self) -> list[str]:
        """Their names."""
        return [quantity.name for quantity in self.quantities]

    @property
    def nominal(self) -> Array:
        """Values of the case file, (d,)."""
        return np.array([quantity.nominal for quantity in self.quantities])

    @property
    def first(self) -> Array:
        """Where the search begins: the same within the bounds, (d,)."""
        low, high = self.bounds
        inside = 1e-3 * (high - low)
        return np.clip(self.nominal, low + inside, high - inside)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Smallest and largest values, (d,) each."""
        ends = [quantity.distribution.support for quantity in self.quantities]
        low, high = np.array(ends, float).T
        return low, high

    @property
    def scales(self) -> Array:
        """A size of each parameter, by which changes are compared, (d,)."""
        low, high = self.bounds
        return np.maximum(np.abs(self.nominal), (high - low) / 4)

    def plant(self, values: Array, base: Plant) -> Plant:
        """The plant with these values."""
        pairs = zip(self.quantities, map(float, values), strict=True)
        own = [(quantity, value) for quantity, value in pairs if quantity.of_plant]
        sample = varied(self.experiment, own)
        return base.changed(sample.case.edits, dict(sample.scales))

    def input_delay(self, values: Array) -> float:
        """How late the inputs arrive [s]."""
        late = {("computing", "delay"), ("actuator", "delay")}
        return sum(
            float(v)
            for q, v in zip(self.quantities, values, strict=True)
            if (q.owner, q.quantity) in late
        )

    def sensor(self, state: str, quantity: str, values: Array) -> float:
        """The ``scale``, ``bias`` or ``delay`` of the sensor of a state; ideal by default."""
        fitted = (
            float(v)
            for q, v in zip(self.quantities, values, strict=True)
            if (q.owner, q.of, q.quantity) == ("sensor", state, quantity)
        )
        return next(fitted, ideal(state, quantity))


def parameters_of(experiment: Experiment, names: Sequence[str]) -> Parameters:
    """The parameters of a case to fit.

    Args:
        experiment: Its ``[[uncertain]]`` are fitted within their ranges.
        names: Of some of them, or paths OWNER.OF.QUANTITY such as ``joint.shaft.damping``; all of
            them by default.

    Raises:
        ArgumentError: If there is no such parameter, or none at all.
    """
    file, plant = experiment.file, experiment.plant(experiment.nominal.truest)
    tables = {table.called: table for table in file.uncertain}
    chosen = [
        tables[name] if name in tables else _table_of(name, experiment, list(tables))
        for name in names
    ] or list(tables.values())
    if not chosen:
        raise ArgumentError(
            f"{experiment.path} has no [[uncertain]]: name what to fit, such as --fit "
            "joint.shaft.damping"
        )
    declared = file.model_copy(update={"uncertain": chosen, "correlation": []})
    try:
        quantities = family_of(declared, experiment.case, plant).quantities
    except ArgumentError as error:
        raise ArgumentError(f"{experiment.path}: {error}") from None
    fitted = [q for q in quantities if q.of_plant or (q.owner, q.quantity) in _OF_LOOP]
    if names and len(fitted) < len(quantities):
        left = next(q.name for q in quantities if q not in fitted)
        raise ArgumentError(f"--fit {left}: no log shows it: fit numbers of the plant or a delay")
    for quantity in fitted:
        if not all(map(math.isfinite, quantity.distribution.support)):
            raise ArgumentError(f"{quantity.name} needs a range: give it least and most")
    return Parameters(experiment, fitted)


def _table_of(path: str, experiment: Experiment, known: Sequence[str]) -> UncertainTable:
    """The table of a path, with a wide range around the value of the case."""
    owner, _, rest = path.partition(".")
    of, _, quantity = rest.rpartition(".")
    if owner not in _PATHS or quantity not in QUANTITIES[owner]:
        paths = [f"{owner}.NAME.{number}" for owner in _PATHS for number in QUANTITIES[owner]]
        raise ArgumentError(f"--fit {unknown_name('parameter', path, [*known, *paths])}")
    name = f"{of} {quantity.replace('_', ' ')}"
    table = UncertainTable.model_validate({owner: of, quantity: list(_RANGE), "name": name})
    if owner != "joint":
        return table
    plant = experiment.plant(experiment.nominal.truest)
    declared = experiment.file.model_copy(update={"uncertain": [table], "correlation": []})
    nominal = family_of(declared, experiment.case, plant).quantities[0].nominal
    if nominal <= 0:
        raise ArgumentError(
            f"--fit {path}: the case has none: give it a range in an [[uncertain]] of the file"
        )
    spread = [factor * nominal for factor in _RANGE]
    return UncertainTable.model_validate({owner: of, quantity: spread, "name": name})
