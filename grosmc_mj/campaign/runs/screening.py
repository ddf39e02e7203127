"""Whether a campaign can be screened by equations: measured on a sample of its family."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.sampling import unit_points
from grosmc_mj.campaign.runs.shard import Outcomes, plants_of, run_on
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.studies.agreement import FACTOR, LEAST_BAND, model_mismatch

# Runs of the sample, and on how many of its plants accelerations are compared.
SAMPLE, _PLANTS = 32, 8
# Beyond it equations would judge little: ``auto`` leaves all to MuJoCo.
LARGEST_BAND = 0.1
# With fewer runs the sample and the confirmed ones are most of them: nothing is said, or lost.
FEWEST = 512


@dataclass(frozen=True)
class Screening:
    """How the runs of a campaign are screened by the equations, plain values that travel.

    Attributes:
        bands: By controller: how near to its limit a margin is confirmed in MuJoCo, in parts of
            the limit. Empty if nothing is screened.
        why_not: Why nothing is that could be, for people.
        worst: By controller: ``Outcomes.order`` of the worst run of the sample; what is worse is
            confirmed.
    """

    bands: Mapping[str, float]
    why_not: str = ""
    worst: Mapping[str, float] = field(default_factory=dict)


UNSCREENED = Screening({})


@lru_cache(maxsize=4)
def screening_of(campaign: Campaign) -> Screening:
    """Measure how far equations and MuJoCo agree on a family, once, if it is asked for."""
    wanted, runs = campaign.specification.screen, campaign.specification.runs
    if wanted == "none" or campaign.plant.kind != "physics":
        return UNSCREENED
    if wanted == "auto" and runs < FEWEST:
        return UNSCREENED
    if why_not := _campaign_mismatch(campaign):
        return Screening({}, why_not)
    dimensions, seed = len(campaign.family.quantities), campaign.specification.seed
    # Of another seed: the campaign's own first runs would be judged twice.
    values = campaign.family.values(unit_points("random", dimensions, seed + 1, 0, SAMPLE))
    samples = [campaign.plant_sample(row, run) for run, row in enumerate(values)]
    physics = plants_of(campaign, samples)
    for plant in physics[:_PLANTS]:
        if why_not := model_mismatch(plant):
            return Screening({}, why_not)
    try:
        equations = equations_of(physics)
    except ModelError as error:
        return Screening({}, str(error))
    bands: dict[str, float] = {}
    worst: dict[str, float] = {}
    for controller in campaign.laws:
        ours, theirs = (
            run_on(plants, campaign, controller, values, samples) for plants in (equations, physics)
        )
        overturned = int((verdicts_overturned(ours, theirs) > 0).sum())
        bands[controller] = band_for(campaign, ours, theirs)
        worst[controller] = float(theirs.order.min())
        if wanted == "auto" and (overturned or bands[controller] > LARGEST_BAND):
            difference = bands[controller] / FACTOR
            return Screening(
                {},
                f"under {controller} margins differ from MuJoCo's by up to {difference:.2g} of a "
                f"limit on {SAMPLE} plants, verdicts on {overturned}",
            )
    return Screening(bands, worst=worst)


def equations_of(plants: Sequence[Plant]) -> list[AnalyticPlant]:
    """The equations of plants with the numbers of their models, each plant's read once.

    Raises:
        ModelError: If a plant has what its equations have no term for.
    """
    made = {plant: plant.analytic() for plant in dict.fromkeys(plants)}
    return [made[plant] for plant in plants]


def band_for(
    campaign: Campaign, ours: Outcomes, theirs: Outcomes, band: float = LEAST_BAND
) -> float:
    """How near to a limit the equations cannot be believed, in parts of the limit.

    It is ``FACTOR`` times the largest difference of a margin, and beyond every margin of a run
    that MuJoCo judges otherwise.

    Args:
        campaign: The campaign.
        ours: Runs on the equations.
        theirs: The same runs in MuJoCo.
        band: The least that it can be.
    """
    for one, other in zip(shares(campaign, ours), shares(campaign, theirs), strict=True):
        both = np.isfinite(one) & np.isfinite(other)
        band = max(band, FACTOR * float(np.abs(one[both] - other[both]).max(initial=0.0)))
        apart = np.isfinite(one) & ((one >= 0) != (other >= 0))
        band = max(band, FACTOR * float(np.abs(one)[apart].max(initial=0.0)))
    return band


def shares(campaign: Campaign, found: Outcomes) -> list[Array]:
    """Margins in parts of their limits, of each requirement of the controller, (n,)."""
    asked = [each for each in campaign.requirements if found.controller in each.of]
    return [found.margins[each.key] / each.value for each in asked]


def verdicts_overturned(ours: Outcomes, theirs: Outcomes) -> Array:
    """On how many verdicts two judges of the same runs differ, each requirement's one, (n,)."""
    differ = (np.array(ours.status) == "completed") != (np.array(theirs.status) == "completed")
    count = differ.astype(np.int64)
    for key, margins in ours.margins.items():
        count += (margins >= 0) != (theirs.margins[key] >= 0)
    return count


def _campaign_mismatch(campaign: Campaign) -> str:
    """What no equations of any of its plants can have; empty if they may have everything."""
    plant = campaign.plant
    nominal = campaign.plant_sample(campaign.family.nominal).plant(plant)
    if isinstance(nominal, MujocoPlant) and (nominal.parts or not nominal.system.symbolic):
        return model_mismatch(nominal)
    if plant.stepped_by != "RK4":
        return f"equations are stepped by RK4, the model by {plant.stepped_by}"
    return ""
