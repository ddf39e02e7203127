"""Largest scale of an uncertainty without a failure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted
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
from grosmc_mj.studies.campaign.screening import screened_search
from grosmc_mj.studies.sweep.compass import TOGETHER, CompassSearch
from grosmc_mj.studies.sweep.family import inside
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


@dataclass(frozen=True, eq=False)
class ScaleTrial:
    """The plants at one scale.

    Attributes:
        scale: Scale of the uncertainty; 1 is as declared.
        values: Their uncertain numbers, (n, d).
        relative: Least margins in parts of their limits, (n,).
        order: By which a worse plant is told from a better one, negative of a failure, (n,).
        ids: Numbers of the runs whose random numbers they draw, (n,).
    """

    scale: float
    values: Array
    relative: Array
    order: Array
    ids: tuple[int, ...]

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

    def with_more(self, other: ScaleTrial) -> ScaleTrial:
        """Return the trial with further plants of the same scale."""
        return ScaleTrial(
            self.scale,
            np.concatenate([self.values, other.values]),
            np.concatenate([self.relative, other.relative]),
            np.concatenate([self.order, other.order]),
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
        largest: Scale beyond which none was tried, or at which plants stop being physical.
    """

    controller: str
    plants: int
    trials: tuple[ScaleTrial, ...]
    largest: float

    @property
    def outside(self) -> ScaleTrial | None:
        """The smallest scale at which a plant failed, with that plant; None if none did."""
        return next((trial for trial in self.trials if trial.failures), None)

    @property
    def found(self) -> float:
        """The largest scale below that, at which no failure was found; 0 if there is none."""
        end = self.outside
        scales = [trial.scale for trial in self.trials if end is None or trial.scale < end.scale]
        return max(scales, default=0.0)

    @property
    def fails(self) -> bool:
        """Whether a plant inside the declared ranges was found to fail."""
        return self.outside is not None and self.outside.scale <= 1

    @property
    def sentence(self) -> str:
        """A line on the scales of the uncertainty at which the law fails."""
        line = f"{self.controller}: {self._unfailing}"
        if self.outside is not None:
            line += f", one found at {self.outside.scale:.3g}"
        return line

    @property
    def words(self) -> str:
        """Largest scale without a failure, as a phrase behind words on the law."""
        if self.outside is None or not self.fails:
            return self._unfailing
        return f"{self._unfailing}, one at {self.outside.scale:.3g}, inside the declared ranges"

    @property
    def _unfailing(self) -> str:
        """The largest scale at which no failure was found."""
        return f"no failure found up to {self.found:.3g} times the uncertainty"


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
        advance: Callable[[int], object],
    ) -> None:
        """Begin without a run.

        Args:
            campaign: The campaign.
            controller: Name of the controller.
            advance: Called with the number of runs done.
        """
        self.points, self.ids = _points(campaign)
        self._trials: dict[float, ScaleTrial] = {}
        self._campaign = campaign
        self._controller = controller
        self._advance = advance

    def bisect(self) -> None:
        """Find the largest scale up to which every plant keeps all that is required."""
        largest = self._campaign.largest_scale
        if not self._keeps(0.0):
            return

        while True:
            kept, _ = largest_passing(
                self._keeps, 0.0, min(1.0, largest), largest, _TOLERANCE, _LEAST
            )
            if kept == 0.0:
                return
            if not self._add_failing_nearby(kept):
                return

    def _keeps(self, scale: float) -> bool:
        """Whether every plant at a scale keeps all that is required."""
        return bool(np.all(self._at(scale).order >= 0))

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
        runs = screened_search(self._campaign, self._controller, values, ids)
        self._advance(len(points))
        return ScaleTrial(scale, values, runs["relative"], runs["order"], tuple(ids))

    def _add_failing_nearby(self, scale: float) -> bool:
        """Add the worst point near the worst plants of a scale, and tell whether it fails.

        All points have the random numbers of the worst plant.
        """
        orders = self._at(scale).order
        worst = orders.argsort(kind="stable")[:TOGETHER]
        draw = self.ids[worst[0]]
        search = CompassSearch(
            lambda points: self._run(points, [draw] * len(points), scale).order,
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
    """Search the scale of the uncertainty at which a requirement fails.

    The plants are the campaign's first ones, where they are not too many all corners of its ranges,
    and failing ones that a compass search finds.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        advance: Called with the number of runs done.
    """
    search = RadiusSearch(campaign, controller, advance)
    plants = len(search.points)
    search.bisect()
    return Radius(controller, plants, search.trials(), campaign.largest_scale)


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
    """Scales that each controller reaches."""
    largest = max(search.largest for search in searches)
    return table(
        "How far the uncertainty may grow: 1 is as declared",
        [
            *names("law"),
            *numbers("no failure\nfound up to", "failure\nfound at"),
            *text("the failing plant just outside"),
        ],
        [_table_row(campaign, search) for search in searches],
        legend=f"{counted(searches[0].plants, 'plant')} at each scale, up to {largest:.3g}, and a "
        "compass search for failing ones from the worst at the largest scale without a failure. "
        f"{NO_PROOF}",
    )


def _table_row(campaign: Campaign, search: Radius) -> tuple[str, ...]:
    """The row of one controller."""
    fails_at = "-"
    failing_plant = "none was found"
    if search.outside is not None:
        fails_at = f"{search.outside.scale:.3g}"
        failing_plant = campaign.words(search.outside.worst)
    return (search.controller, f"{search.found:.3g}", fails_at, failing_plant)


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
    return {
        "found": search.found,
        "largest_looked_at": search.largest,
        "plants_at_each_scale": search.plants,
        "outside": outside and campaign.named(outside.worst),
        "outside_run": outside and outside.worst_run,
        "outside_scale": outside and outside.scale,
        "looks": [_trial_content(trial) for trial in search.trials],
    }


def _trial_content(trial: ScaleTrial) -> dict[str, Any]:
    """A trial as plain values, but for its plants."""
    return {
        "scale": trial.scale,
        "least": trial.least,
        "failures": trial.failures,
    }


def chart(search: Radius) -> LineChart:
    """Least margin over the scale of the uncertainty; the radius is marked."""
    trials = search.trials
    series = Series(
        name="least margin (hollow: a failure)",
        x=[trial.scale for trial in trials],
        y=[finite(trial.least) for trial in trials],
        good=[trial.failures == 0 for trial in trials],
    )
    name = f"{search.controller}: no failure found up to {search.found:.3g}"
    return LineChart(
        name=name,
        titles=("scale of the uncertainty (1 as declared)", "least margin over its limit"),
        lines=[series],
        limit=0.0,
        # A scale of 0 is the axis.
        marks=[search.found] if search.found else [],
    )
