"""How far an uncertainty may grow until a failure is found, beside what the premises promise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.bisection import narrowed
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.sampling import unit_points
from grosmc_mj.campaign.findings.promise import Promise, promise, surface_band
from grosmc_mj.campaign.runs.screened import screened_search
from grosmc_mj.campaign.runs.shard import Outcomes

# The radius is known to this part of itself; below the least scale it counts as none.
_TOLERANCE, _LEAST = 0.01, 0.01
# At each scale: plants at most, and corners of the family among them.
PLANTS, _CORNERS = 128, 64


@dataclass(frozen=True, eq=False)
class Look:
    """The plants at one scale.

    Attributes:
        scale: Of the uncertainty; 1 is as declared.
        least: Least margin of the worst plant, in parts of its limit.
        failures: How many plants fail.
        values: The uncertain numbers of the worst of them, (d,).
        surface: Largest |s| - |s(0)| of all plants over what the promise allows; inf if one did
            not complete, None where nothing is promised.
        leaving: How many plants exceed it.
        leaver: The uncertain numbers of the one that does most, (d,).
    """

    scale: float
    least: float
    failures: int
    values: Array
    surface: float | None = None
    leaving: int = 0
    leaver: Array | None = None


@dataclass(frozen=True, eq=False)
class Radius:
    """How far one controller keeps what is required.

    Attributes:
        controller: Its name.
        plants: Looked at, at each scale: samples and corners.
        looks: In the order of their scale.
        promised: What the premises promise.
        largest: Scale beyond which nobody looked, or at which plants stop being physical.
        band: By how much |s| may exceed |s(0)| while the promise holds; None where nothing is
            promised.
    """

    controller: str
    plants: int
    looks: tuple[Look, ...]
    promised: Promise
    largest: float
    band: float | None = None

    @property
    def outside(self) -> Look | None:
        """The smallest scale at which a plant failed, with that plant; None if none did."""
        return next((look for look in self.looks if look.failures), None)

    @property
    def found(self) -> float:
        """The largest scale below that, at which no failure was found; 0 if there is none."""
        return self._below(self.outside)

    @property
    def left(self) -> Look | None:
        """The smallest scale at which |s| left the bound of the promise; None if it never did."""
        return next((look for look in self.looks if look.leaving), None)

    @property
    def stayed(self) -> float | None:
        """The largest scale below that; None where nothing is promised."""
        return None if self.band is None else self._below(self.left)

    def _below(self, wrong: Look | None) -> float:
        """The largest scale that was looked at below another."""
        limit = wrong.scale if wrong else np.inf
        return max((look.scale for look in self.looks if look.scale < limit), default=0.0)


def radius(
    campaign: Campaign, controller: str, advance: Callable[[int], object] = lambda _: None
) -> Radius:
    """Bisect the scales of the uncertainty at which a requirement fails and |s| leaves its bound.

    A promise is of |s| alone, so that it is compared with the second; requirements may be looser
    or stricter. The same plants are looked at at every scale, moved towards and away from the
    nominal one: the campaign's first ones and, where they are not too many, all corners of its
    ranges.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        advance: Called with the number of runs done.
    """
    family, largest = campaign.family, campaign.largest_scale
    values = family.values(_points(campaign))
    band = surface_band(campaign, controller)
    looks: dict[float, Look] = {}

    def room_left(runs: Outcomes) -> list[Array]:
        return [] if band is None else [1 - _away(runs, band)]

    def look(scale: float) -> Look:
        if scale not in looks:
            plants = family.scaled(values, scale)
            runs = screened_search(campaign, controller, plants, room_left)
            looks[scale] = _look(scale, runs, band)
            advance(len(plants))
        return looks[scale]

    _bisect(lambda scale: look(scale).failures > 0, largest)
    if band is not None:
        _bisect(lambda scale: look(scale).leaving > 0, largest)
    in_order = tuple(sorted(looks.values(), key=lambda look: look.scale))
    promised = promise(campaign, controller)
    return Radius(controller, len(values), in_order, promised, largest, band)


def _bisect(fails: Callable[[float], bool], largest: float) -> None:
    """Look where something fails for the first time, up to the largest scale."""
    low, high = 0.0, min(1.0, largest)
    if fails(low):
        return
    while not fails(high):
        if high >= largest:
            return
        low, high = high, min(2 * high, largest)
    narrowed(fails, low, high, _TOLERANCE, _LEAST)


def _look(scale: float, runs: Outcomes, band: float | None) -> Look:
    """The plants at one scale."""
    least = int(runs.order.argmin())
    failing = (float(runs.relative[least]), int((runs.relative < 0).sum()), runs.values[least])
    if band is None:
        return Look(scale, *failing)
    away = _away(runs, band)
    most = int(away.argmax())
    return Look(scale, *failing, float(away[most]), int((away > 1).sum()), runs.values[most])


def _away(runs: Outcomes, band: float) -> Array:
    """How far |s| left |s(0)|, over what it may, (n,); infinite of a run that ended early."""
    away = (runs.metrics["max_sliding"] - runs.metrics["sliding_start"]) / band
    return np.where(np.isnan(away), np.inf, away)


def _points(campaign: Campaign) -> Array:
    """Points of the unit cube: corners, if the ranges have some, and the first samples."""
    specification, corners = campaign.specification, campaign.family.corners(_CORNERS)
    if specification.sampler == "corners" and len(corners):
        return corners
    samples, d = min(specification.runs, PLANTS - len(corners)), len(campaign.family.quantities)
    own = unit_points(specification.sampler, d, specification.seed, 0, samples)
    return np.concatenate([corners, own])
