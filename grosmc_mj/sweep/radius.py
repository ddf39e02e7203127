"""How far an uncertainty may grow until a failure is found, beside what the premises promise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.results.figure import board, in_lines
from grosmc_mj.results.palette import FAILED_SHADE, OPTIMUM, label_of, law_styles
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


def radius_table(campaign: Campaign, found: Sequence[Radius]) -> Table:
    """How far the uncertainty may grow under each controller, beside what is promised."""
    rows, notes = [], []
    for search in found:
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
        legend=f"{found[0].plants} plants at each scale, up to "
        f"{max(search.largest for search in found):.3g}. Promised: scale up to which the premises "
        "hold for every extreme plant, so that |s| does not grow but for what one sample does. "
        "Compare it with where |s| leaves that bound: of the requirements, which may be looser or "
        f"stricter, premises say nothing. {' '.join(notes)} {NO_PROOF}",
    )


def radius_document(campaign: Campaign, found: Sequence[Radius]) -> dict[str, Any]:
    """How far each controller keeps what is required."""
    reached = {f"{search.controller}: no failure up to": search.found for search in found}
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
        sheets=[Sheet(table=radius_table(campaign, found), charts=list(map(_chart, found)))],
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
            for search in found
        },
    )


def _chart(search: Radius) -> LineChart:
    """Least margin over the scale of the uncertainty."""
    looks = search.looks
    series = Series(
        name="least margin",
        x=[look.scale for look in looks],
        y=[finite(look.least) for look in looks],
        good=[look.failures == 0 for look in looks],
    )
    return LineChart(
        name=search.controller,
        titles=("scale of the uncertainty (1 as declared)", "least margin over its limit"),
        lines=[series],
        limit=0.0,
        marks=[at for at in (search.found, search.promised.scale) if at],
    )


def draw_radius(searches: Sequence[Radius], title: str) -> Figure:
    """A panel a law: the least margin at each scale that was tried, and the radii."""
    styles = law_styles(search.controller for search in searches)
    with board(len(searches), (5.2, 4.9), title, NO_PROOF) as drawn:
        for axes, search in zip(drawn.panels, searches, strict=True):
            style, chart = styles[search.controller], _chart(search)
            scales, least = np.array([(look.scale, look.least) for look in search.looks]).T
            # A run that did not complete has no least margin: its mark lies on the lower edge.
            low = 1.2 * least[least > -np.inf].min(initial=-0.1)
            shown = np.maximum(least, low)
            axes.axhspan(low, 0, color=FAILED_SHADE, zorder=0)
            axes.plot(scales, shown, color=style.colour, lw=1.2)
            for mask, face, label in (
                (least >= 0, style.colour, "no failure found"),
                (least < 0, "white", "failure found"),
            ):
                axes.plot(scales[mask], shown[mask], "o", mfc=face, mec=style.colour, label=label)
            for at, label, line in _radii(search, style.colour):
                if at:
                    axes.axvline(at, lw=1.8, ls=line[0], color=line[1], label=in_lines(label, 52))
                else:
                    axes.plot([], [], ls="", label=in_lines(label, 52))
            axes.set_title(in_lines(style.label), pad=18)
            axes.set(xlabel=chart.titles[0], ylabel=chart.titles[1], xlim=(0, None))
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), frameon=False)
    return drawn.figure


def _radii(search: Radius, colour: str) -> list[tuple[float | None, str, tuple[str, str]]]:
    """Scale, words and line of each radius."""
    promised, left = search.promised, search.left
    promises = "premises promise no radius"
    if promised.scale is not None:
        promises = f"promised: {promised.scale:.3g}"
    kept = f"|s| keeps the promised bound up to {search.stayed or 0:.3g}"
    kept += f", leaves it at {left.scale:.3g}" if left else ""
    return [
        (search.found, f"no failure found up to {search.found:.3g}", ("-", colour)),
        (promised.scale, f"{promises}: {promised.note}", ("--", OPTIMUM)),
        *([(search.stayed, kept, (":", OPTIMUM))] if search.stayed else []),
    ]
