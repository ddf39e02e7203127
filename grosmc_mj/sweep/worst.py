"""The worst plant of a family: searched for, and shrunk towards the nominal one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from grosmc_mj.arrays import Array
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import (
    MEASURED,
    NOT_KEPT,
    Answer,
    ReportTable,
    Value,
    finite,
)
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import inside
from grosmc_mj.sweep.screening import evaluate, screened_search
from grosmc_mj.sweep.search import largest_passing
from grosmc_mj.sweep.store import NO_PROOF, result_of

WORST = "worst.json"
# Plants of one generation.
_POPULATION = 64
# How many of the first generation are the worst samples and corners: what leaves the cube is drawn
# anew inside, so that evolution nears a corner but never reaches it.
_SAMPLES = 16
_CORNERS = 16
# The fewest runs of a search: two generations.
LEAST = 2 * _POPULATION
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
        samples: Least margin of the worst sample of the campaign, with which the search began.
        search: Least margin of the worst plant of the search.
        random: Least margin of the worst of as many random plants.
        evaluations: Runs of the search, and of the random plants.
        shrunk: The nearest plant to the nominal one that was found to fail, (d,); None if nothing
            fails.
        shrunk_relative: Its least margin.
        changed: Names of the numbers that are not nominal in the shrunk plant.
    """

    controller: str
    values: Array
    relative: float
    winner: str
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


def worst(
    campaign: Campaign,
    controller: str,
    ids: Sequence[int],
    evaluations: int,
    advance: Callable[[int], object] = lambda _: None,
) -> WorstPlant:
    """Search by differential evolution, a generation as one batch, and try as many random plants.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        ids: Its worst runs, the worst first.
        evaluations: Runs that the search may take, ``LEAST`` or more; as many random plants are
            tried.
        advance: Called with the number of runs done.
    """
    sampler = campaign.specification.sampler
    samples = np.concatenate([campaign.points(sampler, run, 1) for run in ids[:_SAMPLES]])
    search = _WorstOfAll(campaign, controller, advance)
    search.evolve(_first_generation(campaign, samples), evaluations)

    random = _WorstOfAll(campaign, controller, advance)
    for start in range(0, search.runs, _POPULATION):
        random.run(campaign.points("random", start, _POPULATION, more=1))

    sampled = campaign.family.values(samples)
    worst_sample = int(evaluate(campaign, controller, sampled)["order"].argmin())
    candidates = np.stack([sampled[worst_sample], search.values, random.values])
    outcome = evaluate(campaign, controller, candidates)
    margins = outcome["relative"].tolist()
    winner = int(outcome["order"].argmin())
    worst_plant = WorstPlant(
        controller,
        values=candidates[winner],
        relative=margins[winner],
        winner=SOURCES[winner],
        samples=margins[0],
        search=margins[1],
        random=margins[2],
        evaluations=search.runs,
    )
    return _with_shrunk(campaign, worst_plant) if worst_plant.fails else worst_plant


def _first_generation(campaign: Campaign, samples: Array) -> Array:
    """The worst samples, the corners of the ranges, and random points up to a full generation."""
    corners = campaign.family.corners(_CORNERS)
    missing = _POPULATION - len(samples) - len(corners)
    return np.concatenate([samples, corners, campaign.points("random", 0, missing, more=2)])


class _WorstOfAll:
    """The worst of all plants that are run.

    Attributes:
        values: Its uncertain numbers, (d,).
        runs: Number of plants that were run.
    """

    def __init__(
        self, campaign: Campaign, controller: str, advance: Callable[[int], object]
    ) -> None:
        self.values = np.zeros(0)
        self.runs = 0
        self._least = math.inf
        self._campaign = campaign
        self._controller = controller
        self._advance = advance

    def run(self, points: Array) -> Array:
        """Run the plants at points of the unit cube, (n, d).

        Returns:
            Their order, (n,): the worse a plant, the less.
        """
        values = self._campaign.family.values(inside(points))
        order = screened_search(self._campaign, self._controller, values)["order"]
        if order.min() < self._least:
            self._least = float(order.min())
            self.values = values[int(order.argmin())]

        self.runs += len(points)
        self._advance(len(points))
        return order

    def evolve(self, first_generation: Any, evaluations: int) -> None:
        """Run the plants of a differential evolution, a generation as one batch.

        Args:
            first_generation: Points of the unit cube, (n, d).
            evaluations: Runs that it may take.
        """
        dimensions = len(self._campaign.family.quantities)
        differential_evolution(
            # SciPy's points are columns, (d, n).
            lambda columns: self.run(columns.T.reshape(-1, dimensions)),
            [(0.0, 1.0)] * dimensions,
            init=first_generation,
            maxiter=evaluations // _POPULATION - 1,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=np.random.default_rng(self._campaign.specification.seed),
        )


def _with_shrunk(campaign: Campaign, worst_plant: WorstPlant) -> WorstPlant:
    """A failing plant with the plant that it is shrunk to."""
    plant = shrunk(campaign, worst_plant.controller, worst_plant.values)
    margins = evaluate(campaign, worst_plant.controller, plant[None])["relative"]
    pairs = zip(campaign.family.quantities, plant, strict=True)
    return replace(
        worst_plant,
        shrunk=plant,
        shrunk_relative=float(margins[0]),
        changed=tuple(number.name for number, value in pairs if value != number.nominal),
    )


def shrunk(campaign: Campaign, controller: str, values: Array) -> Array:
    """Bring a failing plant towards the nominal one as far as it fails still, (d,).

    Numbers are made nominal one by one, each time the number without which it fails worst; then
    all that are not nominal are moved towards their nominal values together.
    """
    nominal = campaign.family.nominal
    plant = _with_fewest_changes(campaign, controller, values)

    def passes(share: float) -> bool:
        nearer = nominal + share * (plant - nominal)
        return bool(screened_search(campaign, controller, nearer[None])["order"][0] >= 0)

    _, share = largest_passing(passes, 0.0, 1.0, 1.0, 0.0, _NEAR)
    if share >= 1.0:
        return plant
    return nominal + share * (plant - nominal)


def _with_fewest_changes(campaign: Campaign, controller: str, values: Array) -> Array:
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
        order = screened_search(campaign, controller, candidates)["order"]
        if not order.min() < 0:
            return plant
        plant = candidates[int(order.argmin())]


def worst_table(campaign: Campaign, searches: Sequence[WorstPlant]) -> Table:
    """The worst plant under each controller, and the least margin of each source."""
    runs = searches[0].evaluations
    return table(
        "The worst plant: least margin in parts of its limit",
        [
            *names("law"),
            *numbers("samples", "search", "random"),
            *words("worst by"),
            *text("the worst plant"),
            *text("nearest to the nominal plant that fails"),
        ],
        [_table_row(campaign, plant) for plant in searches],
        legend="Samples: the worst run of the campaign. Search: differential evolution that begins "
        f"with the worst samples and the corners of the ranges, {runs} runs; random: {runs} random "
        "plants. All three were judged in MuJoCo; of equally bad ones the first is named. Of "
        "plants that never settle the one with the largest error left is the worst, of runs that "
        "end early the earliest. Below zero something is not kept; numbers not named are nominal. "
        f"{NO_PROOF}",
    )


def _table_row(campaign: Campaign, plant: WorstPlant) -> tuple[str, ...]:
    """The row of one controller."""
    nearest = "none was found"
    if plant.shrunk is not None:
        nearest = f"{campaign.words(plant.shrunk)}: margin {number(plant.shrunk_relative)}"
    return (
        label_of(plant.controller),
        number(plant.samples),
        number(plant.search),
        number(plant.random),
        plant.winner,
        f"{campaign.words(plant.values)}: margin {number(plant.relative)}",
        nearest,
    )


def worst_document(campaign: Campaign, searches: Sequence[WorstPlant]) -> dict[str, Any]:
    """Return worst.json: the worst plants, by controller."""
    verdict = MEASURED
    sentence = "none fails"
    failing = [plant.controller for plant in searches if plant.fails]
    if failing:
        verdict = NOT_KEPT
        sentence = f"a failing plant was found for {', '.join(failing)}"

    name = campaign.specification.name
    answer = Answer(question=f"Worst plants of {name}", verdict=verdict, words=sentence)
    return result_of(
        campaign,
        "worst",
        answers=[answer],
        sheets=[ReportTable(table=worst_table(campaign, searches))],
        values=[_least_margin(campaign.target, plant) for plant in searches],
        says=NO_PROOF,
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
        "worst_by": plant.winner,
        "worst_of_the_samples": plant.samples,
        "worst_of_the_search": plant.search,
        "worst_of_as_many_random_plants": plant.random,
        "evaluations": plant.evaluations,
        "shrunk": campaign.named(plant.shrunk),
        "shrunk_relative": plant.shrunk_relative,
        "not_nominal": list(plant.changed),
    }
