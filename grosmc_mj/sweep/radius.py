"""How far an uncertainty may grow until a failure is found, beside what the premises promise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import (
    MEASURED,
    Answer,
    LineChart,
    Series,
    Sheet,
    Value,
    finite,
)
from grosmc_mj.results.tables import Table, names, numbers, table, text
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.promise import Promise, promise
from grosmc_mj.sweep.runs import Outcomes
from grosmc_mj.sweep.screening import screened_search
from grosmc_mj.sweep.search import largest_passing
from grosmc_mj.sweep.store import NO_PROOF, result_of

RADIUS = "radius.json"
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
        promised: By the premises.
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
        return self._below(self.outside)

    @property
    def left(self) -> Look | None:
        """The smallest scale at which |s| left the bound of the promise; None if it never did."""
        return next((look for look in self.looks if look.leaving), None)

    @property
    def stayed(self) -> float | None:
        """The largest scale below that; None where nothing is promised."""
        return None if self.promised.band is None else self._below(self.left)

    def _below(self, wrong: Look | None) -> float:
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
    family, largest, looks = campaign.family, campaign.largest_scale, dict[float, Look]()
    values, promised = family.values(_points(campaign)), promise(campaign, controller)
    band = promised.band

    def room_left(runs: Outcomes) -> list[Array]:
        return [] if band is None else [1 - _away(runs, band)]

    def look(scale: float) -> Look:
        if scale not in looks:
            plants = family.scaled(values, scale)
            runs = screened_search(campaign, controller, plants, room_left)
            looks[scale] = _look(scale, plants, runs, band)
            advance(len(plants))
        return looks[scale]

    passes: list[Callable[[float], bool]] = [lambda scale: look(scale).failures == 0]
    if band is not None:
        passes.append(lambda scale: look(scale).leaving == 0)
    for condition in passes:
        if condition(0.0):
            largest_passing(condition, 0.0, min(1.0, largest), largest, _TOLERANCE, _LEAST)
    in_order = tuple(looks[scale] for scale in sorted(looks))
    return Radius(controller, len(values), in_order, promised, largest)


def _look(scale: float, plants: Array, runs: Outcomes, band: float | None) -> Look:
    """The plants (n, d) at one scale."""
    relative, worst = runs["relative"], int(runs["order"].argmin())
    failing = (float(relative[worst]), int((relative < 0).sum()), plants[worst])
    if band is None:
        return Look(scale, *failing)
    away = _away(runs, band)
    most = int(away.argmax())
    return Look(scale, *failing, float(away[most]), int((away > 1).sum()), plants[most])


def _away(runs: Outcomes, band: float) -> Array:
    """How far |s| left |s(0)|, over what it may, (n,); infinite of a run that ended early."""
    away = (runs["max_sliding"] - runs["sliding_start"]) / band
    return np.where(np.isnan(away), np.inf, away)


def _points(campaign: Campaign) -> Array:
    """Points of the unit cube: corners, if the ranges have some, and the first samples."""
    specification, corners = campaign.specification, campaign.family.corners(_CORNERS)
    if specification.sampler == "corners" and len(corners):
        return corners
    samples = min(specification.runs, PLANTS - len(corners))
    return np.concatenate([corners, campaign.points(specification.sampler, 0, samples)])


def radius_table(campaign: Campaign, searches: Sequence[Radius]) -> Table:
    """How far the uncertainty may grow under each controller, beside what is promised."""
    rows, notes = [], []
    for search in searches:
        law, outside, promised = label_of(search.controller), search.outside, search.promised
        fails_at, leaves_at = (look and look.scale for look in (outside, search.left))
        scales = (search.found, fails_at, promised.scale, search.stayed, leaves_at)
        plant = campaign.words(outside.values) if outside else "none was found"
        rows.append((law, *("-" if at is None else f"{at:.3g}" for at in scales), plant))
        bound = f"; there |s| - |s(0)| is at most {promised.band:.3g}" if promised.band else ""
        notes.append(f"{law}: {promised.note}{bound}.")
    headers = (
        "no failure\nup to", "failure\nat", "promised", "|s| kept\nup to", "|s| leaves\nat",
    )  # fmt: skip
    return table(
        "How far the uncertainty may grow: 1 is as declared",
        [*names("law"), *numbers(*headers), *text("the failing plant just outside")],
        rows,
        legend=f"{searches[0].plants} plants at each scale, up to "
        f"{max(search.largest for search in searches):.3g}. Promised: scale up to which the "
        "premises hold for every extreme plant, so that |s| does not grow but for what one sample "
        "does. Compare it with where |s| leaves that bound: of the requirements, which may be "
        f"looser or stricter, premises say nothing. {' '.join(notes)} {NO_PROOF}",
    )


def radius_document(campaign: Campaign, searches: Sequence[Radius]) -> dict[str, Any]:
    """How far each controller keeps what is required."""
    reached = {f"{search.controller}: no failure up to": search.found for search in searches}
    return result_of(
        campaign,
        "radius",
        answers=[
            Answer(
                question=f"How far the uncertainty of {campaign.specification.name} may grow",
                verdict=MEASURED,
                words="; ".join(f"{name} {scale:.3g}" for name, scale in reached.items()),
            )
        ],
        sheets=[Sheet(table=radius_table(campaign, searches), charts=list(map(chart, searches)))],
        values=[Value(name=name, value=scale, better=1) for name, scale in reached.items()],
        says=NO_PROOF,
        controllers={
            search.controller: {
                "found": search.found,
                "largest_looked_at": search.largest,
                "plants_at_each_scale": search.plants,
                "outside": search.outside and campaign.named(search.outside.values),
                "outside_scale": search.outside and search.outside.scale,
                "promised": search.promised.scale,
                "promised_note": search.promised.note,
                "surface_band": search.promised.band,
                "surface_kept": search.stayed,
                "surface_left_scale": search.left and search.left.scale,
                "surface_left": search.left and campaign.named(search.left.leaver),
                "looks": [
                    {
                        "scale": look.scale,
                        "least": look.least,
                        "failures": look.failures,
                        "surface": look.surface,
                        "leaving": look.leaving,
                    }
                    for look in search.looks
                ],
            }
            for search in searches
        },
    )


def chart(search: Radius) -> LineChart:
    """Least margin over the scale of the uncertainty; marked are the radius and the promise."""
    looks, promised = search.looks, search.promised
    series = Series(
        name="least margin (hollow: a failure)",
        x=[look.scale for look in looks],
        y=[finite(look.least) for look in looks],
        good=[look.failures == 0 for look in looks],
    )
    words = f"no failure up to {search.found:.3g}"
    words += "" if promised.scale is None else f", promised {promised.scale:.3g}"
    return LineChart(
        name=f"{label_of(search.controller)}: {words}",
        titles=("scale of the uncertainty (1 as declared)", "least margin over its limit"),
        lines=[series],
        limit=0.0,
        marks=[at for at in (search.found, promised.scale) if at],
    )
