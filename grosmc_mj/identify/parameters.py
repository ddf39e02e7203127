"""The parameters that a log is fitted by: numbers of the plant, of loads, sensors and delay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import UncertainTable
from grosmc_mj.experiments.number import Number, set_numbers
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, placed, unknown_name
from grosmc_mj.ground.units import in_units
from grosmc_mj.identify.model import LogModel
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.studies.sweep.family import family_of
from grosmc_mj.studies.sweep.quantities import Quantity
from grosmc_mj.theory.plants import Plant

# Numbers beside the plant's that a log shows: of a load, how late inputs arrive, how a sensor errs.
_VISIBLE = (
    ("disturbance", "scale"),
    ("disturbance", "amplitude"),
    ("computing", "delay"),
    ("actuator", "delay"),
    ("sensor", "delay"),
    ("sensor", "bias"),
    ("sensor", "scale"),
)
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
        pairs = list(zip(self.quantities, np.asarray(values, float).tolist(), strict=True))
        # A delay in a fit is no whole number of timesteps.
        others = [(item.number, value) for item, value in pairs if not item.number.of_plant]
        case = set_numbers(self.experiment, others)

        of_plant = [(item.number, value) for item, value in pairs if item.number.of_plant]
        of_machine = set_numbers(self.experiment, of_plant)
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
        quantities = _quantities(experiment, tables)
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


def _quantities(experiment: Experiment, tables: Sequence[UncertainTable]) -> Sequence[Quantity]:
    """The quantities of a case with other [[uncertain]] tables."""
    update = {"uncertain": list(tables), "correlation": []}
    file = experiment.file.model_copy(update=update)
    return family_of(file, experiment).quantities


def _is_visible(quantity: Quantity) -> bool:
    """Whether a log can show a number."""
    number = quantity.number
    return number.of_plant or (quantity.owner, number.place.field) in _VISIBLE


def _table_of(
    name: str, experiment: Experiment, declared: Mapping[str, UncertainTable]
) -> UncertainTable:
    """The declared table of a name, or one of a path, with a wide range around its value."""
    if name in declared:
        return declared[name]
    if "." not in name:
        paths = ["edit.NAME.FIELD", "computing.delay", "disturbance.LABEL.scale"]
        raise ArgumentError(f"--fit {unknown_name('parameter', name, [*declared, *paths])}")

    with placed("--fit "):
        nominal = Number.of(experiment, name).get(experiment)
    if not 0 < nominal < math.inf:
        raise ArgumentError(
            f"--fit {name}: the case has none: give it a range in an [[uncertain]] of the file"
        )
    values = in_units([factor * nominal for factor in _RANGE])
    return UncertainTable(number=name, values=values)
