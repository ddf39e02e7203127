"""The worst plant of a family: searched for, and shrunk towards the nominal one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted
from grosmc_mj.output.results.result import (
    MEASURED,
    NOT_KEPT,
    Answer,
    ReportTable,
    Result,
    Value,
    finite,
)
from grosmc_mj.output.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.campaign.batch import evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.manifest import result_of
from grosmc_mj.studies.campaign.screening import screened_search
from grosmc_mj.studies.sweep.compass import CompassSearch
from grosmc_mj.studies.sweep.family import inside
from grosmc_mj.studies.sweep.sampled import NO_PROOF
from grosmc_mj.studies.sweep.search import largest_passing

WORST = "worst.json"
# Starts of a search: the worst samples, the corners of the ranges, and random plants.
_STARTS = 64
_SAMPLES = 16
_CORNERS = 16
# Plants of a batch of random ones.
_BATCH = 64
# The fewest runs of a search: its starts, and as many again.
LEAST = 2 * _STARTS
# How near to the nominal plant the nearest failing one is known, of its distance.
_NEAR = 1 / 256
# Where the worst plant may come from; of equally bad ones the first counts.
SOURCES = ("samples", "search", "random")


@dataclass(frozen=True, eq=False)
class WorstPlant:
    """The worst plant for one controller, and the least margin of each source, all in MuJoCo.

    Attributes:
        controller: Its name.
        values: The uncertain numbers of the worst plant, (d,).
        relative: Its least margin in parts of the limit; negative if something is not kept. Of
            plants that never settle the worst has the largest error left, see ``Outcomes.order``.
        winner: Its source, one of ``SOURCES``.
        run: Number of the run whose random numbers its loop draws.
        samples: Least margin of the worst sample of the campaign, with which the search began.
        search: Least margin of the worst plant of the search.
        random: Least margin of the worst of as many random plants.
        evaluations: Runs that the search could take, and number of random plants.
        shrunk: The nearest plant to the nominal one that was found to fail, (d,); None if nothing
            fails.
        shrunk_relative: Its least margin.
        changed: Names of the numbers that are not nominal in the shrunk plant.
    """

    controller: str
    values: Array
    relative: float
    winner: str
    run: int
    samples: float
    search: float
    random: float
    evaluations: int
    shrunk: Array | None = None
    shrunk_relative: float | None = None
    changed: tuple[str, ...] = ()

    @property
    def fails(self) -> bool:
        """Whether it is a counterexample."""
        return self.relative < 0

    def sentence(self, campaign: Campaign) -> str:
        """Return a line on the plant, and on the nearest one that fails."""
        line = (
            f"{self.controller}: worst plant found, by {self.winner}: margin "
            f"{number(self.relative)} of its limit, {campaign.words(self.values)}"
        )
        if self.shrunk is not None:
            line += f"; nearest found that fails: {campaign.words(self.shrunk)}"
        return line

    @property
    def words(self) -> str:
        """Margin of the plant, as a phrase behind words on the law."""
        fails = " fails" if self.fails else ""
        return f"worst plant found{fails}: margin {number(self.relative)} of its limit"


def worst(
    campaign: Campaign,
    controller: str,
    ids: Sequence[int],
    evaluations: int,
    advance: Callable[[int], object] = lambda _: None,
) -> WorstPlant:
    """Search by compass search from the worst of many starts, and try as many random plants.

    Samples have the random numbers of their own runs. All other plants have those of the worst
    run, with which a search does not lose the failure that it begins with.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        ids: Its worst runs, the worst first.
        evaluations: Runs that the search may take, ``LEAST`` or more; as many random plants are
            tried.
        advance: Called with the number of runs done.
    """
    family = campaign.family
    draw = ids[0] if campaign.random else 0

    def order(points: Array) -> Array:
        values = family.values(inside(points))
        runs = screened_search(campaign, controller, values, [draw] * len(values))
        advance(len(points))
        return runs["order"]

    sampler = campaign.specification.sampler
    sampled_runs = list(ids[:_SAMPLES])
    samples = np.concatenate([campaign.points(sampler, run, 1) for run in sampled_runs])
    search = CompassSearch(order, family.search_bounds)
    starts = _starts(campaign, samples)
    search.descend(starts, search.judge(starts), evaluations)

    random = campaign.points("random", 0, evaluations, more=1)
    batches = [random[first : first + _BATCH] for first in range(0, evaluations, _BATCH)]
    orders = np.concatenate([order(batch) for batch in batches])
    worst_random = random[orders.argmin()]

    sampled = family.values(samples)
    by_sample = evaluate(campaign, controller, sampled, sampled_runs)
    worst_sample = int(by_sample["order"].argmin())
    others = family.values(inside(np.stack([search.point, worst_random])))
    candidates = np.stack([sampled[worst_sample], *others])
    runs = [sampled_runs[worst_sample], draw, draw]
    outcome = evaluate(campaign, controller, candidates, runs)
    margins = outcome["relative"].tolist()
    winner = int(outcome["order"].argmin())
    worst_plant = WorstPlant(
        controller,
        values=candidates[winner],
        relative=margins[winner],
        winner=SOURCES[winner],
        run=runs[winner],
        samples=margins[0],
        search=margins[1],
        random=margins[2],
        evaluations=evaluations,
    )
    return _with_shrunk(campaign, worst_plant) if worst_plant.fails else worst_plant


def _starts(campaign: Campaign, samples: Array) -> Array:
    """The worst samples, the corners of the ranges, and random points."""
    corners = campaign.family.corners(_CORNERS)
    missing = _STARTS - len(samples) - len(corners)
    return np.concatenate([samples, corners, campaign.points("random", 0, missing, more=2)])


def _with_shrunk(campaign: Campaign, worst_plant: WorstPlant) -> WorstPlant:
    """A failing plant with the plant that it is shrunk to."""
    plant = shrunk(campaign, worst_plant.controller, worst_plant.values, worst_plant.run)
    margins = evaluate(campaign, worst_plant.controller, plant[None], [worst_plant.run])["relative"]
    pairs = zip(campaign.family.quantities, plant, strict=True)
    return replace(
        worst_plant,
        shrunk=plant,
        shrunk_relative=float(margins[0]),
        changed=tuple(number.name for number, value in pairs if value != number.nominal),
    )


def shrunk(campaign: Campaign, controller: str, values: Array, run: int = 0) -> Array:
    """Bring a failing plant towards the nominal one as far as it fails still, (d,).

    Numbers are made nominal one by one, each time the number without which it fails worst; then
    all that are not nominal are moved towards their nominal values together.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers of the plant, (d,).
        run: Number of the run whose random numbers its loop draws.
    """
    nominal = campaign.family.nominal
    plant = _with_fewest_changes(campaign, controller, values, run)

    def passes(share: float) -> bool:
        nearer = nominal + share * (plant - nominal)
        return bool(screened_search(campaign, controller, nearer[None], [run])["order"][0] >= 0)

    _, share = largest_passing(passes, 0.0, 1.0, 1.0, 0.0, _NEAR)
    if share >= 1.0:
        return plant
    return nominal + share * (plant - nominal)


def _with_fewest_changes(campaign: Campaign, controller: str, values: Array, run: int) -> Array:
    """A failing plant with as many nominal numbers as it can have and fail still, (d,)."""
    nominal = campaign.family.nominal
    plant = values.copy()
    while True:
        changed = np.flatnonzero(plant != nominal)
        if not len(changed):
            return plant

        # A candidate for each changed number, in which that number is nominal.
        candidates = np.tile(plant, (len(changed), 1))
        candidates[range(len(changed)), changed] = nominal[changed]
        runs = [run] * len(candidates)
        order = screened_search(campaign, controller, candidates, runs)["order"]
        if not order.min() < 0:
            return plant
        plant = candidates[int(order.argmin())]


def worst_table(campaign: Campaign, searches: Sequence[WorstPlant]) -> Table:
    """The worst plant under each controller, and the least margin of each source."""
    runs = searches[0].evaluations
    return table(
        "The worst plant found: least margin in parts of its limit",
        [
            *names("law"),
            *numbers("samples", "search", "random"),
            *words("worst by"),
            *text("the worst plant"),
            *text("nearest found to the nominal plant that fails"),
        ],
        [_table_row(campaign, plant) for plant in searches],
        legend="Samples: the worst run of the campaign; what its loop draws at random, all other "
        "plants have, too. Search: compass search from the worst of samples, corners of the "
        f"ranges and random plants, along one number at a time, up to {counted(runs, 'run')}; "
        f"random: {counted(runs, 'random plant')}. All three were judged in MuJoCo; of equally "
        "bad ones the first is named. Of plants that never settle the one with the largest error "
        "left is the worst, of runs that end early the earliest. Below zero something is not kept; "
        f"numbers not named are nominal. {NO_PROOF}",
    )


def _table_row(campaign: Campaign, plant: WorstPlant) -> tuple[str, ...]:
    """The row of one controller."""
    nearest = "none was found"
    if plant.shrunk is not None:
        nearest = f"{campaign.words(plant.shrunk)}: margin {number(plant.shrunk_relative)}"
    return (
        plant.controller,
        number(plant.samples),
        number(plant.search),
        number(plant.random),
        plant.winner,
        f"{campaign.words(plant.values)}: margin {number(plant.relative)}",
        nearest,
    )


def worst_result(campaign: Campaign, searches: Sequence[WorstPlant]) -> Result:
    """Return the worst plants that were found, the worst first."""
    answers = []
    for plant in sorted(searches, key=lambda plant: plant.relative):
        answer = Answer(
            question=f"Worst plants of {campaign.specification.name}",
            verdict=NOT_KEPT if plant.fails else MEASURED,
            words=plant.sentence(campaign),
        )
        answers.append(answer)
    return result_of(
        campaign,
        "worst",
        answers=answers,
        sheets=[ReportTable(table=worst_table(campaign, searches))],
        remarks=[NO_PROOF],
        values=[_least_margin(campaign.target, plant) for plant in searches],
        controllers={plant.controller: _content(campaign, plant) for plant in searches},
    )


def _least_margin(target: str, plant: WorstPlant) -> Value:
    """The margin by which two results are compared."""
    name = f"{target} {plant.controller}: least margin"
    return Value(name=name, value=finite(plant.relative), better=1)


def _content(campaign: Campaign, plant: WorstPlant) -> dict[str, Any]:
    """The worst plant of one controller as plain values."""
    return {
        "fails": plant.fails,
        "relative": plant.relative,
        "worst": campaign.named(plant.values),
        "worst_run": plant.run,
        "worst_by": plant.winner,
        "worst_of_the_samples": plant.samples,
        "worst_of_the_search": plant.search,
        "worst_of_as_many_random_plants": plant.random,
        "evaluations": plant.evaluations,
        "shrunk": campaign.named(plant.shrunk),
        "shrunk_run": plant.run,
        "shrunk_relative": plant.shrunk_relative,
        "not_nominal": list(plant.changed),
    }
