"""How far an uncertainty may grow until a failure is found, beside what the premises promise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.family import LARGEST_SCALE
from grosmc_mj.campaign.family.sampling import unit_points
from grosmc_mj.campaign.findings.promise import Promise, promise
from grosmc_mj.campaign.runs.shard import evaluate

# The radius is known to this part of itself; below the least scale it counts as none.
_TOLERANCE, _LEAST = 0.01, 0.01
# At each scale: plants at most, and corners of the family among them.
PLANTS, _CORNERS = 128, 64


@dataclass(frozen=True, eq=False)
class Look:
    """What was found at one scale.

    Attributes:
        scale: Of the uncertainty; 1 is as declared.
        least: Least margin of all plants, in parts of its limit.
        failures: How many plants fail.
        values: The uncertain numbers of the worst of them, (d,).
    """

    scale: float
    least: float
    failures: int
    values: Array


@dataclass(frozen=True, eq=False)
class Radius:
    """How far one controller keeps what is required.

    Attributes:
        controller: Its name.
        plants: Looked at, at each scale: samples and corners.
        looks: In the order of their scale.
        promised: What the premises promise.
        largest: Scale beyond which nobody looked, or at which plants stop being physical.
    """

    controller: str
    plants: int
    looks: tuple[Look, ...]
    promised: Promise
    largest: float

    @property
    def outside(self) -> Look | None:
        """The smallest scale at which a plant failed, with that plant; None if none did."""
        return next((look for look in self.looks if look.failures), None)

    @property
    def found(self) -> float:
        """The largest scale below that, at which no failure was found; 0 if there is none."""
        limit = self.outside.scale if self.outside else np.inf
        return max((look.scale for look in self.looks if look.scale < limit), default=0.0)


def radius(
    campaign: Campaign, controller: str, advance: Callable[[int], object] = lambda _: None
) -> Radius:
    """Bisect the scale of the uncertainty at which the first failure is found.

    The same plants are looked at at every scale, moved towards and away from the nominal one: the
    campaign's first ones and, where they are not too many, all corners of its ranges.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        advance: Called with the number of runs done.
    """
    family = campaign.family
    points = _points(campaign)
    values = family.values(points)
    largest = min(LARGEST_SCALE, family.largest_scale * (1 - 1e-9))
    looks: list[Look] = []

    def fails(scale: float) -> bool:
        tried = family.scaled(values, scale)
        relative = evaluate(campaign, controller, tried).relative
        advance(len(tried))
        least = int(relative.argmin())
        looks.append(Look(scale, float(relative[least]), int((relative < 0).sum()), tried[least]))
        return looks[-1].failures > 0

    low, high = 0.0, min(1.0, largest)
    if not fails(0.0):
        while not fails(high) and high < largest:
            low, high = high, min(2 * high, largest)
        if looks[-1].failures:
            while high - low > max(_TOLERANCE * low, _LEAST):
                middle = (low + high) / 2
                low, high = (low, middle) if fails(middle) else (middle, high)
    return Radius(
        controller=controller,
        plants=len(points),
        looks=tuple(sorted(looks, key=lambda look: look.scale)),
        promised=promise(campaign, controller),
        largest=largest,
    )


def _points(campaign: Campaign) -> Array:
    """Points of the unit cube: corners, if the ranges have some, and the first samples."""
    specification, family = campaign.specification, campaign.family
    d, corners = len(family.quantities), family.corners(_CORNERS)
    if specification.sampler == "corners" and len(corners):
        return corners
    samples = min(specification.runs, PLANTS - len(corners))
    return np.concatenate(
        [corners, unit_points(specification.sampler, d, specification.seed, 0, samples)]
    )
