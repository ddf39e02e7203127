"""The parameters that a log is fitted by: numbers of the plant, of loads, sensors and delay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import QUANTITIES, UncertainTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, unknown_name
from grosmc_mj.identify.model import LogModel
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.studies.sweep.family import family_of
from grosmc_mj.studies.sweep.quantities import Quantity, with_values
from grosmc_mj.theory.plants import Plant

# Numbers beside the plant's that a log shows: of a load, how late inputs arrive, how a sensor errs.
_VISIBLE = (
    ("disturbance", "amplitude"),
    ("computing", "delay"),
    ("actuator", "delay"),
    ("sensor", "delay"),
    ("sensor", "bias"),
    ("sensor", "scale"),
)
# Owners of numbers that stand in an [[edit]].
_EDITED = ("body", "joint", "parameter")
# A number without a range is searched from and to so many times its value.
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
    def huber(self) -> bool:
        """Whether the case's ``[log]`` asks for Huber's loss."""
        table = self.experiment.file.log
        return table is not None and table.loss == "huber"

    @property
    def first(self) -> Array:
        """Start of the search: the case's values, moved inside the bounds, (d,)."""
        low, high = self.bounds
        inside = 1e-3 * (high - low)
        return np.clip(self.nominal, low + inside, high - inside)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Smallest and largest values, (d,) each."""
        supports = [quantity.distribution.support for quantity in self.quantities]
        low, high = np.array(supports, float).T
        return low, high

    @property
    def scales(self) -> Array:
        """A size of each parameter, by which changes are compared, (d,)."""
        low, high = self.bounds
        return np.maximum(np.abs(self.nominal), (high - low) / 4)

    def model(self, values: Array, base: Plant) -> LogModel:
        """Return the machine with these values.

        Args:
            values: Of all parameters, (d,).
            base: The plant before any change.
        """
        of_plant = []
        case = self.experiment
        for quantity, value in zip(self.quantities, values, strict=True):
            if quantity.of_plant:
                of_plant.append((quantity, float(value)))
            else:
                # A delay in a fit is no whole number of timesteps.
                case = quantity.changed_case(case, float(value))

        of_machine = with_values(self.experiment, of_plant)
        if isinstance(base, MujocoPlant):
            plant: Plant = base.changed(*of_machine.edits)
        else:
            plant = of_machine.plant(base.kind)
        return LogModel(plant, case.loop, case.disturbances)


def parameters_of(experiment: Experiment, names: Sequence[str]) -> Parameters:
    """The parameters of a case to fit.

    Args:
        experiment: Its ``[[uncertain]]`` are fitted within their ranges.
        names: Of some of them, or paths OWNER.NAME.FIELD such as ``edit.shaft.damping``; all of
            them by default.

    Raises:
        ArgumentError: If there is no such parameter, or none at all.
    """
    plant = experiment.plant(experiment.nominal.truest)
    declared = {table.called: table for table in experiment.file.uncertain}
    tables = list(declared.values())
    if names:
        tables = [_table_of(name, experiment, declared) for name in names]
    if not tables:
        raise ArgumentError(
            f"{experiment.path} has no [[uncertain]]: name what to fit, such as --fit "
            "edit.shaft.damping"
        )

    try:
        quantities = _quantities(experiment, plant, tables)
    except ArgumentError as error:
        raise ArgumentError(f"{experiment.path}: {error}") from None
    fitted = [quantity for quantity in quantities if _is_visible(quantity)]
    # Whoever names a number is told of it; those of the file that no log shows are left out.
    for quantity in quantities:
        if names and quantity not in fitted:
            raise ArgumentError(
                f"--fit {quantity.name}: no log shows it: fit numbers of the plant or a delay"
            )
    for quantity in fitted:
        if not all(map(math.isfinite, quantity.distribution.support)):
            raise ArgumentError(f"{quantity.name} needs a range: give it least and most")
    return Parameters(experiment, fitted)


def _quantities(
    experiment: Experiment, plant: Plant, tables: Sequence[UncertainTable]
) -> Sequence[Quantity]:
    """The quantities of a case with other [[uncertain]] tables."""
    update = {"uncertain": list(tables), "correlation": []}
    file = experiment.file.model_copy(update=update)
    return family_of(file, experiment, plant).quantities


def _is_visible(quantity: Quantity) -> bool:
    """Whether a log can show a number."""
    return quantity.of_plant or (quantity.owner, quantity.quantity) in _VISIBLE


def _table_of(
    name: str, experiment: Experiment, declared: Mapping[str, UncertainTable]
) -> UncertainTable:
    """The declared table of a name, or the table of a path."""
    if name in declared:
        return declared[name]
    return _table_of_path(name, experiment, list(declared))


def _table_of_path(path: str, experiment: Experiment, names: Sequence[str]) -> UncertainTable:
    """The table of a path, with a wide range around the value of the case."""
    numbers = {number: owner for owner in _EDITED for number in QUANTITIES[owner]}
    table, _, of_and_quantity = path.partition(".")
    of, _, quantity = of_and_quantity.rpartition(".")
    if table != "edit" or quantity not in numbers:
        paths = [f"edit.NAME.{number}" for number in numbers]
        raise ArgumentError(f"--fit {unknown_name('parameter', path, [*names, *paths])}")

    owner = numbers[quantity]
    name = f"{of} {quantity.replace('_', ' ')}"
    table = UncertainTable.model_validate({owner: of, quantity: list(_RANGE), "name": name})
    # Numbers of bodies and parameters are factors already.
    if owner != "joint":
        return table

    plant = experiment.plant(experiment.nominal.truest)
    nominal = _quantities(experiment, plant, [table])[0].nominal
    if nominal <= 0:
        raise ArgumentError(
            f"--fit {path}: the case has none: give it a range in an [[uncertain]] of the file"
        )
    spread = [factor * nominal for factor in _RANGE]
    return UncertainTable.model_validate({owner: of, quantity: spread, "name": name})
