"""Promise of a sliding mode law's premises for a family of plants.

The promise is eq. (14)'s: with the switching gain that the law has, |s| cannot grow, anywhere in
the operating region, on a plant with these numbers and under wrenches up to these. It is of
continuous time. A law of period h does not see that s has changed its sign until its next sample,
and while the gain covers what pushes, |s'| is at most 2 rho in the meantime, twice what the
switching term does. So what a run is held to is

    max |s| <= |s(0)| + w h rho_max,  w = 2, or the width of a wider boundary layer,

with the largest rho of the law in the operating region on the nominal plant. Of a plant whose input
gain is larger than the nominal one the same would be more.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.assumptions.audit import largest_rate, least_margin
from grosmc_mj.experiments.assumptions.balance import Loads
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GrosmcError, PremiseError
from grosmc_mj.simulation.disturbances import (
    AnyDisturbance,
    Constant,
    Disturbance,
    InputDisturbance,
    Profile,
    Pulse,
    SineFrom,
)
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.sweep.runs import plant_of
from grosmc_mj.studies.sweep.search import largest_passing
from grosmc_mj.theory.control.controller import Controller

# Scales are known to this part of themselves, up to the largest.
_TOLERANCE = 0.01
# Gains that were computed for a plant hold for it to rounding of the largest rates.
_ROUNDING = 1e-9
# Largest change of s between two samples, over h rho.
_SAMPLE = 2.0
# Numbers that the equations, from which the premises are computed, do not have.
_NOT_IN_EQUATIONS = ("damping", "friction", "armature")


class Promise(NamedTuple):
    """Reach of the premises.

    Attributes:
        scale: Scale of the uncertainty up to which they hold; None where they cannot be computed.
        note: Why they cannot, or what limits the scale.
        band: Amount by which |s| may exceed |s(0)| while they hold; None where nothing is
            promised.
    """

    scale: float | None
    note: str
    band: float | None


@dataclass(frozen=True, eq=False)
class PromisedFamily:
    """Premises of one law over the family of a campaign.

    Attributes:
        campaign: The campaign.
        law: The law, as it runs.
        bound: Operating region, |z1|, |z2| ...
    """

    campaign: Campaign
    law: Controller
    bound: tuple[float, ...]

    @classmethod
    def of(cls, campaign: Campaign, controller: str) -> PromisedFamily:
        """Return the premises of a controller.

        Raises:
            PremiseError: If there are none, and why.
        """
        law = campaign.laws[controller]
        region = campaign.experiment.region
        plant = campaign.plant
        if not law.designed.switching:
            raise PremiseError(
                f"{controller} does not switch: it promises nothing about uncertainty"
            )
        if plant.kind != "physics" or plant.system.read_parameters is None:
            raise PremiseError("premises are computed for the package's own systems in MuJoCo only")
        if region is None:
            raise PremiseError("no operating region is declared for this design")
        for number in campaign.family.quantities:
            if number.quantity in _NOT_IN_EQUATIONS:
                raise PremiseError(
                    f"the equations have no {number.quantity}, so {number.name} has no premise"
                )
        return cls(campaign, law, region)

    def margin(self, values: Array, amplitude: Array, of_inputs: Array) -> float:
        """Least difference of configured and required switching rate in the operating region.

        Args:
            values: Uncertain numbers, (d,); those of disturbances and starts play no part.
            amplitude: Largest magnitude of each component of the wrenches, (6 * bodies,).
            of_inputs: Largest magnitude of the disturbance of each input, (m,).
        """
        plant = plant_of(self.campaign.plant_sample(values), self.campaign.plant)
        largest = Loads.of_wrench(amplitude, plant.system)._replace(input=of_inputs[None])
        return least_margin(self.law, plant.analytic(), self.bound, largest)

    def amplitude(self, scale: float) -> Array:
        """The largest wrenches of the family, with its uncertainty scaled, (6 * bodies,)."""
        wrenches = np.zeros(6 * len(self.campaign.plant.system.bodies))
        return self._with_largest(wrenches, Disturbance, scale)

    def input_amplitude(self, scale: float) -> Array:
        """The largest disturbances of the inputs, with the uncertainty scaled, (m,)."""
        inputs = np.zeros(len(self.campaign.plant.system.inputs))
        return self._with_largest(inputs, InputDisturbance, scale)

    def _with_largest(self, sizes: Array, kind: type[AnyDisturbance], scale: float) -> Array:
        """Sizes with the largest magnitudes of all disturbances of a kind added to them."""
        for disturbance in self.campaign.experiment.disturbances:
            if not isinstance(disturbance, kind):
                continue
            factor = self._largest_factor(disturbance.label, scale)
            largest = np.abs(disturbance.amplitudes) * factor * self._peak(disturbance.profile)
            first = disturbance.place(self.campaign.plant.system)
            sizes[first : first + len(largest)] += largest
        return sizes

    def _largest_factor(self, label: str, scale: float) -> float:
        """The largest factor on a disturbance; 1 if its amplitude is certain."""
        for number in self.campaign.family.quantities:
            if number.quantity == "amplitude" and number.of == label:
                low, high = number.ends(scale)
                return max(abs(low), abs(high))
        return 1.0

    def _peak(self, profile: Profile) -> float:
        """The largest magnitude of a profile: 1 of the package's own."""
        if isinstance(profile, (Constant, Pulse, SineFrom)):
            return 1.0
        timestep = self.campaign.experiment.settings.timestep
        steps = round(self.campaign.duration / timestep)
        return max(abs(float(profile(step * timestep))) for step in range(steps))

    def surface_band(self) -> float:
        """w h rho_max, by which |s| may exceed |s(0)|, in the unit of s."""
        campaign = self.campaign
        plant = plant_of(campaign.plant_sample(campaign.family.nominal), campaign.plant)
        rate = largest_rate(self.law, plant.analytic(), self.bound)

        # Only a boundary layer has a width.
        switching = getattr(self.law.parameters, "switching", None)
        width = max(_SAMPLE, getattr(switching, "width", 0.0))
        return width * campaign.experiment.settings.control_period * rate

    def corners(self, scale: float, *, of_starts: bool = False) -> list[Array]:
        """Extreme values of the family's plants, scaled, (d,) each; other numbers are nominal.

        Args:
            scale: Scale of the uncertainty.
            of_starts: Whether the starts are at their ends, instead of the plants.
        """
        ends: list[tuple[float, ...]] = []
        for number in self.campaign.family.quantities:
            varies = number.owner == "start" if of_starts else number.of_plant
            ends.append(number.ends(scale) if varies else (number.nominal,))
        return [np.array(corner) for corner in itertools.product(*ends)]

    def holds(self, scale: float) -> bool:
        """Whether the premises hold for all extreme plants, and the starts lie in the region."""
        if not self.starts_inside(scale):
            return False
        amplitude = self.amplitude(scale)
        of_inputs = self.input_amplitude(scale)
        return all(
            self.margin(values, amplitude, of_inputs) >= -_ROUNDING
            for values in self.corners(scale)
        )

    def starts_inside(self, scale: float) -> bool:
        """Whether every start has its error state in the operating region."""
        corners = self.corners(scale, of_starts=True)
        x0 = np.array([self.campaign.plant_sample(values).x0 for values in corners])
        z = self.law.coordinates.along(np.zeros(len(x0)), x0, self.law.parameters)
        bound = np.array(self.bound) * (1 + _ROUNDING)
        return bool(np.all(np.abs(z) <= bound))

    def reach(self) -> tuple[float, str]:
        """The largest scale of the uncertainty at which the premises hold, and what limits it."""
        if not self.holds(0.0):
            return 0.0, "the premises do not hold for the nominal plant"

        most = self.campaign.largest_scale
        low, high = largest_passing(self.holds, 0.0, most, most, _TOLERANCE, _TOLERANCE**2)
        if low == most:
            return most, f"they hold up to {most:.3g}, as far as was looked"

        bounds = [f"|z{i}| <= {size:.3g}" for i, size in enumerate(self.bound, start=1)]
        region = ", ".join(bounds)
        note = f"over {region}"
        if not self.starts_inside(high):
            note += "; beyond it starts leave that region"
        return low, note


def promise(campaign: Campaign, controller: str) -> Promise:
    """Return how far the premises of a controller reach, or why that cannot be computed."""
    band = None
    try:
        premises = PromisedFamily.of(campaign, controller)
        band = premises.surface_band()
        if not campaign.family.bounded:
            raise PremiseError("the uncertainty has no end, so no premise covers all of it")
        scale, note = premises.reach()
        return Promise(scale, note, band)
    except GrosmcError as error:
        return Promise(None, str(error), band)
