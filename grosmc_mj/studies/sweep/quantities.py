"""Uncertain numbers of an experiment: a number with its distribution and its name in results."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.number import Number, set_numbers
from grosmc_mj.ground.fields import Range
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.machine.part import MOST
from grosmc_mj.output.results.tables import shown_unit
from grosmc_mj.studies.sweep.distributions import Distribution

# Factors that would turn the sign of what they are of, or take it away, if they were not positive.
_POSITIVE = (("sensor", "scale"), ("edit", "scale"))


@dataclass(frozen=True)
class Quantity:
    """One uncertain number.

    Attributes:
        number: The number of the experiment.
        name: Its name in results.
        distribution: Distribution of its values.
        nominal: Value without uncertainty.
    """

    number: Number
    name: str
    distribution: Distribution
    nominal: float = 0.0

    @property
    def owner(self) -> str:
        """Table that the number stands in: ``edit``, ``run``, ``disturbance``, ``sensor`` ..."""
        return self.number.place.owner

    @property
    def unit(self) -> str:
        """Unit of its values; empty for a factor."""
        return self.number.unit

    @property
    def bounds(self) -> Range:
        """The values that it can have."""
        if (self.owner, self.number.place.field) in _POSITIVE:
            return Range(0, above=True)
        return self.number.bounds

    @property
    def shown_unit(self) -> tuple[str, float]:
        """The unit that people read, and the factor to it; frequencies stay in rad/s."""
        if self.number.place.field in ("frequency", "bandwidth"):
            return self.unit, 1.0
        return shown_unit(self.unit)

    def words(self, value: float) -> str:
        """Return a value with its name, in the unit that people read."""
        unit, factor = self.shown_unit
        return f"{self.name} {value * factor:.4g}{unit_after(unit)}"

    def physical(self, value: float) -> bool:
        """Whether a plant can have this value; of a range without an end, one that is far out."""
        return self.bounds.holds(max(-MOST, min(value, MOST)))

    def ends(self, scale: float) -> tuple[float, float]:
        """Smallest and largest value at a scale of the uncertainty; infinite where it has none."""
        low, high = self.distribution.support
        smallest = self.nominal + scale * (low - self.nominal)
        largest = self.nominal + scale * (high - self.nominal)
        return smallest, largest

    @property
    def largest_scale(self) -> float:
        """The factor on distances from the nominal value up to which all values are physical."""
        low, high = self.distribution.support
        down = up = math.inf
        if low < self.nominal:
            down = (self.nominal - self.bounds.low) / (self.nominal - low)
        if high > self.nominal:
            # A share of samples stays below all of them.
            up = (self.bounds.high - self.nominal) / (high - self.nominal) * (1 - 1e-9)
        return min(down, up)


def with_values(case: Experiment, values: Iterable[tuple[Quantity, float]]) -> Experiment:
    """Return a case with other values of some quantities; times become whole timesteps.

    Args:
        case: The case.
        values: Quantities and their values.

    Raises:
        GrosmcError: If a value is out of its bounds.
    """
    timestep = case.settings.timestep
    period = case.settings.control_period
    return set_numbers(
        case,
        [
            (quantity.number, quantity.number.as_run(value, timestep, period))
            for quantity, value in values
        ],
    )
