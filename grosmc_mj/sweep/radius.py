"""Largest scale of an uncertainty without a failure, beside the scale that premises promise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import (
    MEASURED,
    Answer,
    LineChart,
    ReportTable,
    Series,
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
_TOLERANCE = 0.01
_LEAST = 0.01
# At each scale: plants at most, and corners of the family among them.
PLANTS = 128
_CORNERS = 64


@dataclass(frozen=True, eq=False)
class ScaleTrial:
    """The plants at one scale.

    Attributes:
        scale: Scale of the uncertainty; 1 is as declared.
        least: Least margin of the worst plant, in parts of its limit.
        failures: Number of plants that fail.
        values: The uncertain numbers of the worst of them, (d,).
        surface: Largest |s| - |s(0)| of all plants over what the promise allows; inf if one did
            not complete, None where nothing is promised.
        leaving: Number of plants that exceed it.
        leaver: The uncertain numbers of the plant that exceeds it most, (d,).
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
    """Scales up to which one controller keeps what is required.

    Attributes:
        controller: Its name.
        plants: Number of plants at each scale: samples and corners.
        trials: In the order of their scale.
        promised: Promise of the premises.
        largest: Scale beyond which none was tried, or at which plants stop being physical.
    """

    controller: str
    plants: int
    trials: tuple[ScaleTrial, ...]
    promised: Promise
    largest: float

    @property
    def outside(self) -> ScaleTrial | None:
        """The smallest scale at which a plant failed, with that plant; None if none did."""
        return next((trial for trial in self.trials if trial.failures), None)

    @property
    def found(self) -> float:
        """The largest scale below that, at which no failure was found; 0 if there is none."""
        return self._largest_below(self.outside)

    @property
    def left(self) -> ScaleTrial | None:
        """The smallest scale at which |s| left the bound of the promise; None if it never did."""
        return next((trial for trial in self.trials if trial.leaving), None)

    @property
    def stayed(self) -> float | None:
        """The largest scale below that; None where nothing is promised."""
        if self.promised.band is None:
            return None
        return self._largest_below(self.left)

    def _largest_below(self, end: ScaleTrial | None) -> float:
        """The largest scale below another one, or of all; 0 if there is none."""
        scales = [trial.scale for trial in self.trials if end is None or trial.scale < end.scale]
        return max(scales, default=0.0)


class _ScaleTrials:
    """Trials of one controller at scales of the uncertainty, each made once.

    Attributes:
        by_scale: The trials that were made.
    """

    def __init__(
        self,
        campaign: Campaign,
        controller: str,
        values: Array,
        band: float | None,
        advance: Callable[[int], object],
    ) -> None:
        """Begin without a trial.

        Args:
            campaign: The campaign.
            controller: Name of the controller.
            values: The plants at scale 1, (n, d).
            band: Amount by which |s| may exceed |s(0)|; None where nothing is promised.
            advance: Called with the number of runs done.
        """
        self.by_scale: dict[float, ScaleTrial] = {}
        self._campaign = campaign
        self._controller = controller
        self._values = values
        self._band = band
        self._advance = advance

    def nothing_fails(self, scale: float) -> bool:
        """Whether every plant at a scale keeps all requirements."""
        return self._at(scale).failures == 0

    def nothing_leaves(self, scale: float) -> bool:
        """Whether |s| of every plant at a scale stays within the bound of the promise."""
        return self._at(scale).leaving == 0

    def _at(self, scale: float) -> ScaleTrial:
        """The trial of a scale."""
        if scale not in self.by_scale:
            plants = self._campaign.family.scaled(self._values, scale)
            runs = screened_search(self._campaign, self._controller, plants, self._room_left)
            self.by_scale[scale] = _trial(scale, plants, runs, self._band)
            self._advance(len(plants))
        return self.by_scale[scale]

    def _room_left(self, runs: Outcomes) -> list[Array]:
        """Room of |s| below its bound, over the bound, (n,); nothing without a promise."""
        if self._band is None:
            return []
        return [1 - _growth(runs, self._band)]


def radius(
    campaign: Campaign,
    controller: str,
    advance: Callable[[int], object] = lambda _: None,
) -> Radius:
    """Bisect the scales of the uncertainty at which a requirement fails and |s| leaves its bound.

    A promise is of |s| alone, so that it is compared with the second; requirements may be looser
    or stricter. All scales try the same plants, moved towards and away from the nominal one: the
    campaign's first ones and, where they are not too many, all corners of its ranges.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        advance: Called with the number of runs done.
    """
    largest = campaign.largest_scale
    values = campaign.family.values(_points(campaign))
    promised = promise(campaign, controller)

    trials = _ScaleTrials(campaign, controller, values, promised.band, advance)
    conditions = [trials.nothing_fails]
    if promised.band is not None:
        conditions.append(trials.nothing_leaves)
    for condition in conditions:
        if condition(0.0):
            largest_passing(condition, 0.0, min(1.0, largest), largest, _TOLERANCE, _LEAST)

    in_order = tuple(trials.by_scale[scale] for scale in sorted(trials.by_scale))
    return Radius(controller, len(values), in_order, promised, largest)


def _trial(
    scale: float,
    plants: Array,
    runs: Outcomes,
    band: float | None,
) -> ScaleTrial:
    """The trial of plants (n, d) at one scale."""
    relative = runs["relative"]
    worst = int(runs["order"].argmin())
    trial = ScaleTrial(
        scale,
        least=float(relative[worst]),
        failures=int((relative < 0).sum()),
        values=plants[worst],
    )
    if band is None:
        return trial

    growth = _growth(runs, band)
    most = int(growth.argmax())
    return replace(
        trial,
        surface=float(growth[most]),
        leaving=int((growth > 1).sum()),
        leaver=plants[most],
    )


def _growth(runs: Outcomes, band: float) -> Array:
    """Growth of |s| beyond |s(0)| over what it may, (n,); infinite of a run that ended early."""
    growth = (runs["max_sliding"] - runs["sliding_start"]) / band
    return np.where(np.isnan(growth), np.inf, growth)


def _points(campaign: Campaign) -> Array:
    """Points of the unit cube: corners, if the ranges have some, and the first samples."""
    specification = campaign.specification
    corners = campaign.family.corners(_CORNERS)
    if specification.sampler == "corners" and len(corners):
        return corners

    samples = min(specification.runs, PLANTS - len(corners))
    return np.concatenate([corners, campaign.points(specification.sampler, 0, samples)])


def radius_table(campaign: Campaign, searches: Sequence[Radius]) -> Table:
    """Scales that each controller reaches, beside the scales that are promised."""
    scales = ("no failure\nup to", "failure\nat", "promised", "|s| kept\nup to", "|s| leaves\nat")
    largest = max(search.largest for search in searches)
    notes = " ".join(_promise_note(search) for search in searches)
    return table(
        "How far the uncertainty may grow: 1 is as declared",
        [*names("law"), *numbers(*scales), *text("the failing plant just outside")],
        [_table_row(campaign, search) for search in searches],
        legend=f"{searches[0].plants} plants at each scale, up to {largest:.3g}. Promised: scale "
        "up to which the premises hold for every extreme plant, so that |s| does not grow but for "
        "what one sample does. Compare it with where |s| leaves that bound: of the requirements, "
        f"which may be looser or stricter, premises say nothing. {notes} {NO_PROOF}",
    )


def _table_row(campaign: Campaign, search: Radius) -> tuple[str, ...]:
    """The row of one controller."""
    fails_at = None
    failing_plant = "none was found"
    if search.outside is not None:
        fails_at = search.outside.scale
        failing_plant = campaign.words(search.outside.values)
    leaves_at = None
    if search.left is not None:
        leaves_at = search.left.scale

    scales = (search.found, fails_at, search.promised.scale, search.stayed, leaves_at)
    cells = ["-" if scale is None else f"{scale:.3g}" for scale in scales]
    return (label_of(search.controller), *cells, failing_plant)


def _promise_note(search: Radius) -> str:
    """The sentence on the promise of one controller."""
    promised = search.promised
    note = f"{label_of(search.controller)}: {promised.note}"
    if promised.band:
        note += f"; there |s| - |s(0)| is at most {promised.band:.3g}"
    return f"{note}."


def radius_document(campaign: Campaign, searches: Sequence[Radius]) -> dict[str, Any]:
    """Return radius.json: the scales that each controller reaches."""
    values: list[Value] = []
    sentences: list[str] = []
    for search in searches:
        name = f"{search.controller}: no failure up to"
        values.append(Value(name=f"{campaign.target} {name}", value=search.found, better=1))
        sentences.append(f"{name} {search.found:.3g}")

    answer = Answer(
        question=f"How far the uncertainty of {campaign.specification.name} may grow",
        verdict=MEASURED,
        words="; ".join(sentences),
    )
    charts = [chart(search) for search in searches]
    return result_of(
        campaign,
        "radius",
        answers=[answer],
        sheets=[ReportTable(table=radius_table(campaign, searches), charts=charts)],
        values=values,
        says=NO_PROOF,
        controllers={search.controller: _content(campaign, search) for search in searches},
    )


def _content(campaign: Campaign, search: Radius) -> dict[str, Any]:
    """The search of one controller as plain values."""
    outside = search.outside
    left = search.left
    return {
        "found": search.found,
        "largest_looked_at": search.largest,
        "plants_at_each_scale": search.plants,
        "outside": outside and campaign.named(outside.values),
        "outside_scale": outside and outside.scale,
        "promised": search.promised.scale,
        "promised_note": search.promised.note,
        "surface_band": search.promised.band,
        "surface_kept": search.stayed,
        "surface_left_scale": left and left.scale,
        "surface_left": left and campaign.named(left.leaver),
        "looks": [_trial_content(trial) for trial in search.trials],
    }


def _trial_content(trial: ScaleTrial) -> dict[str, Any]:
    """A trial as plain values, but for its plants."""
    return {
        "scale": trial.scale,
        "least": trial.least,
        "failures": trial.failures,
        "surface": trial.surface,
        "leaving": trial.leaving,
    }


def chart(search: Radius) -> LineChart:
    """Least margin over the scale of the uncertainty; marked are the radius and the promise."""
    trials = search.trials
    series = Series(
        name="least margin (hollow: a failure)",
        x=[trial.scale for trial in trials],
        y=[finite(trial.least) for trial in trials],
        good=[trial.failures == 0 for trial in trials],
    )
    scales = [search.found]
    name = f"{label_of(search.controller)}: no failure up to {search.found:.3g}"
    if search.promised.scale is not None:
        scales.append(search.promised.scale)
        name += f", promised {search.promised.scale:.3g}"
    return LineChart(
        name=name,
        titles=("scale of the uncertainty (1 as declared)", "least margin over its limit"),
        lines=[series],
        limit=0.0,
        # A scale of 0 is the axis.
        marks=[scale for scale in scales if scale],
    )
