"""Largest scale of an uncertainty without a failure, beside the scale that premises promise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.palette import label_of
from grosmc_mj.output.results.result import (
    MEASURED,
    Answer,
    LineChart,
    ReportTable,
    Result,
    Series,
    Value,
    finite,
)
from grosmc_mj.output.results.tables import Table, names, numbers, table, text
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.manifest import result_of
from grosmc_mj.studies.campaign.promise import Promise, promise
from grosmc_mj.studies.campaign.screening import screened_search
from grosmc_mj.studies.sweep.compass import TOGETHER, CompassSearch
from grosmc_mj.studies.sweep.family import inside
from grosmc_mj.studies.sweep.runs import Outcomes
from grosmc_mj.studies.sweep.sampled import NO_PROOF
from grosmc_mj.studies.sweep.search import largest_passing

RADIUS = "radius.json"
# The radius is known to this part of itself; below the least scale it counts as none.
_TOLERANCE = 0.01
_LEAST = 0.01
# At each scale: plants at most, and corners of the family among them.
PLANTS = 128
_CORNERS = 64
# Runs of one compass search at most.
_MOST_RUNS = 1024
# Margin that the plants of a scale must keep: of all requirements, or of |s| to its bound.
Condition = Literal["order", "room"]


@dataclass(frozen=True, eq=False)
class ScaleTrial:
    """The plants at one scale.

    Attributes:
        scale: Scale of the uncertainty; 1 is as declared.
        values: Their uncertain numbers, (n, d).
        relative: Least margins in parts of their limits, (n,).
        order: By which a worse plant is told from a better one, negative of a failure, (n,).
        growth: |s| - |s(0)| over what the promise allows, (n,): inf if one did not complete, NaN
            where nothing is promised.
        ids: Numbers of the runs whose random numbers they draw, (n,).
    """

    scale: float
    values: Array
    relative: Array
    order: Array
    growth: Array
    ids: tuple[int, ...]

    @property
    def room(self) -> Array:
        """Room of |s| below the bound of the promise, over the bound; negative beyond it, (n,)."""
        return 1 - self.growth

    @property
    def failures(self) -> int:
        """Number of plants that fail."""
        return int((self.relative < 0).sum())

    @property
    def least(self) -> float:
        """Least margin of the worst plant, in parts of its limit."""
        return float(self.relative[self.order.argmin()])

    @property
    def worst(self) -> Array:
        """The uncertain numbers of the worst plant, (d,)."""
        return self.values[self.order.argmin()]

    @property
    def worst_run(self) -> int:
        """Number of the run whose random numbers the worst plant draws."""
        return self.ids[int(self.order.argmin())]

    @property
    def leaving(self) -> int:
        """Number of plants whose |s| leaves its bound."""
        return int((self.growth > 1).sum())

    @property
    def surface(self) -> float | None:
        """The largest growth of |s|; None where nothing is promised."""
        largest = float(self.growth.max())
        return None if np.isnan(largest) else largest

    @property
    def leaver(self) -> Array:
        """The uncertain numbers of the plant whose |s| grows most, (d,)."""
        return self.values[self.growth.argmax()]

    def with_more(self, other: ScaleTrial) -> ScaleTrial:
        """Return the trial with further plants of the same scale."""
        return ScaleTrial(
            self.scale,
            np.concatenate([self.values, other.values]),
            np.concatenate([self.relative, other.relative]),
            np.concatenate([self.order, other.order]),
            np.concatenate([self.growth, other.growth]),
            (*self.ids, *other.ids),
        )


@dataclass(frozen=True, eq=False)
class Radius:
    """Scales up to which one controller keeps what is required.

    Attributes:
        controller: Its name.
        plants: Number of plants at each scale: samples and corners; besides there are those that
            compass searches found to fail.
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

    @property
    def sentence(self) -> str:
        """A line on the scales of the uncertainty at which the law fails."""
        line = f"{self.controller}: no failure found up to {self.found:.3g} times the uncertainty"
        if self.outside is not None:
            line += f", one found at {self.outside.scale:.3g}"
        if self.promised.scale is not None:
            line += f"; |s| is promised its bound up to {self.promised.scale:.3g}"
        if self.stayed is not None:
            line += f", found to keep it up to {self.stayed:.3g}"
        if self.left is not None:
            line += f", to leave it at {self.left.scale:.3g}"
        return line

    def _largest_below(self, end: ScaleTrial | None) -> float:
        """The largest scale below another one, or of all; 0 if there is none."""
        scales = [trial.scale for trial in self.trials if end is None or trial.scale < end.scale]
        return max(scales, default=0.0)


class RadiusSearch:
    """Search for the largest scale of the uncertainty at which no plant of one controller fails.

    All scales try the same plants, moved towards and away from the nominal one. At the largest
    scale without a failure a compass search goes on from the worst plants; a failing plant that it
    finds is one of the plants from then on, and the scale is bisected again.

    Attributes:
        points: The plants, as points of the unit cube, (n, d).
        ids: Numbers of the runs whose random numbers they draw, (n,).
    """

    def __init__(
        self,
        campaign: Campaign,
        controller: str,
        band: float | None,
        advance: Callable[[int], object],
    ) -> None:
        """Begin without a run.

        Args:
            campaign: The campaign.
            controller: Name of the controller.
            band: Amount by which |s| may exceed |s(0)|; None where nothing is promised.
            advance: Called with the number of runs done.
        """
        self.points, self.ids = _points(campaign)
        self._trials: dict[float, ScaleTrial] = {}
        self._campaign = campaign
        self._controller = controller
        self._band = band
        self._advance = advance

    def bisect(self, condition: Condition) -> None:
        """Find the largest scale up to which every plant keeps a condition.

        Args:
            condition: ``order`` or ``room``, which is negative where it is not kept.
        """
        largest = self._campaign.largest_scale
        if not self._keeps(0.0, condition):
            return

        while True:
            kept, _ = largest_passing(
                lambda scale: self._keeps(scale, condition),
                0.0,
                min(1.0, largest),
                largest,
                _TOLERANCE,
                _LEAST,
            )
            if kept == 0.0:
                return
            if not self._add_failing_nearby(kept, condition):
                return

    def _keeps(self, scale: float, condition: Condition) -> bool:
        """Whether every plant at a scale keeps a condition."""
        return bool(np.all(getattr(self._at(scale), condition) >= 0))

    def _at(self, scale: float) -> ScaleTrial:
        """The trial of all plants at a scale; those of plants that are new are run."""
        trial = self._trials.get(scale)
        if trial is None:
            trial = self._run(self.points, self.ids, scale)
        elif len(trial.order) < len(self.points):
            known = len(trial.order)
            trial = trial.with_more(self._run(self.points[known:], self.ids[known:], scale))
        self._trials[scale] = trial
        return trial

    def _run(self, points: Array, ids: Sequence[int], scale: float) -> ScaleTrial:
        """Run plants at points of the unit cube, (n, d), at a scale."""
        family = self._campaign.family
        values = family.scaled(family.values(inside(points)), scale)
        runs = screened_search(self._campaign, self._controller, values, ids, self._margins)
        self._advance(len(points))
        growth = np.full(len(points), np.nan)
        if self._band is not None:
            growth = _growth(runs, self._band)
        return ScaleTrial(scale, values, runs["relative"], runs["order"], growth, tuple(ids))

    def _margins(self, runs: Outcomes) -> Array:
        """Margins in parts of their limits, and the room of |s| below its bound, (k, n)."""
        if self._band is None:
            return runs.shares
        return np.vstack([runs.shares, 1 - _growth(runs, self._band)])

    def _add_failing_nearby(self, scale: float, condition: Condition) -> bool:
        """Add the worst point near the worst plants of a scale, and tell whether it fails.

        All points have the random numbers of the worst plant.
        """
        orders = getattr(self._at(scale), condition)
        worst = orders.argsort(kind="stable")[:TOGETHER]
        draw = self.ids[worst[0]]
        search = CompassSearch(
            lambda points: getattr(self._run(points, [draw] * len(points), scale), condition),
            self._campaign.family.search_bounds,
        )
        starts = self.points[worst]
        judged = orders[worst]
        if self._campaign.random:
            judged = search.judge(starts)
        search.descend(starts, judged, _MOST_RUNS)
        if not search.order < 0:
            return False
        self.points = np.vstack([self.points, search.point])
        self.ids.append(draw)
        return True

    def trials(self) -> tuple[ScaleTrial, ...]:
        """Return all scales that were tried, in their order, each with all plants."""
        return tuple(self._at(scale) for scale in sorted(self._trials))


def radius(
    campaign: Campaign,
    controller: str,
    advance: Callable[[int], object] = lambda _: None,
) -> Radius:
    """Search the scales of the uncertainty at which a requirement fails and |s| leaves its bound.

    A promise is of |s| alone, so that it is compared with the second; requirements may be looser
    or stricter. The plants are the campaign's first ones, where they are not too many all corners
    of its ranges, and failing ones that a compass search finds.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        advance: Called with the number of runs done.
    """
    promised = promise(campaign, controller)
    search = RadiusSearch(campaign, controller, promised.band, advance)
    plants = len(search.points)
    search.bisect("order")
    if promised.band is not None:
        search.bisect("room")
    return Radius(controller, plants, search.trials(), promised, campaign.largest_scale)


def _growth(runs: Outcomes, band: float) -> Array:
    """Growth of |s| beyond |s(0)| over what it may, (n,); infinite of a run that ended early."""
    growth = (runs["max_sliding"] - runs["sliding_start"]) / band
    return np.where(np.isnan(growth), np.inf, growth)


def _points(campaign: Campaign) -> tuple[Array, list[int]]:
    """Points of the unit cube: corners, if the ranges have some, and the first samples.

    Returns:
        The points, (n, d), and the numbers of the runs whose random numbers they draw, (n,): a run
        of the campaign has its own.
    """
    specification = campaign.specification
    corners = campaign.family.corners(_CORNERS)
    if specification.sampler == "corners" and len(corners):
        # A corner's number has a bit for each coordinate.
        numbers = corners @ (1 << np.arange(corners.shape[1]))
        return corners, numbers.astype(int).tolist()

    samples = min(specification.runs, PLANTS - len(corners))
    points = np.concatenate([corners, campaign.points(specification.sampler, 0, samples)])
    return points, [*[0] * len(corners), *range(samples)]


def radius_table(campaign: Campaign, searches: Sequence[Radius]) -> Table:
    """Scales that each controller reaches, beside the scales that are promised."""
    scales = (
        "no failure\nfound up to",
        "failure\nfound at",
        "promised",
        "|s| kept\nup to",
        "|s| leaves\nat",
    )
    largest = max(search.largest for search in searches)
    notes = " ".join(_promise_note(search) for search in searches)
    return table(
        "How far the uncertainty may grow: 1 is as declared",
        [*names("law"), *numbers(*scales), *text("the failing plant just outside")],
        [_table_row(campaign, search) for search in searches],
        legend=f"{searches[0].plants} plants at each scale, up to {largest:.3g}, and a compass "
        "search for failing ones from the worst at the largest scale without a failure. Promised: "
        "scale up to which the premises hold for every extreme plant, so that |s| does not grow "
        "but for what one sample does. Compare it with where |s| leaves that bound: of the "
        "requirements, which may be looser or stricter, premises say nothing. "
        f"{notes} {NO_PROOF}",
    )


def _table_row(campaign: Campaign, search: Radius) -> tuple[str, ...]:
    """The row of one controller."""
    fails_at = None
    failing_plant = "none was found"
    if search.outside is not None:
        fails_at = search.outside.scale
        failing_plant = campaign.words(search.outside.worst)
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


def radius_result(campaign: Campaign, searches: Sequence[Radius]) -> Result:
    """Return how far the uncertainty may grow under each law, the least first."""
    values: list[Value] = []
    for search in searches:
        name = f"{campaign.target} {search.controller}: no failure found up to"
        values.append(Value(name=name, value=search.found, better=1))

    question = f"How far the uncertainty of {campaign.specification.name} may grow"
    answers = [
        Answer(question=question, verdict=MEASURED, words=search.sentence)
        for search in sorted(searches, key=lambda search: search.found)
    ]
    charts = [chart(search) for search in searches]
    return result_of(
        campaign,
        "radius",
        answers=answers,
        sheets=[ReportTable(table=radius_table(campaign, searches), charts=charts)],
        remarks=[NO_PROOF],
        values=values,
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
        "outside": outside and campaign.named(outside.worst),
        "outside_run": outside and outside.worst_run,
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
    name = f"{label_of(search.controller)}: no failure found up to {search.found:.3g}"
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
