"""The worst plant of a family: searched for, and shrunk towards the nominal one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from grosmc_mj.arrays import Array
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import (
    MEASURED,
    NOT_KEPT,
    Answer,
    Sheet,
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
# Plants of one generation, and how many of the first one are the worst samples and corners: what
# leaves the cube is drawn anew inside, so that evolution nears a corner but never reaches it.
_POPULATION, _SAMPLES, _CORNERS = 64, 16, 16
# The fewest runs of a search: two generations.
LEAST = 2 * _POPULATION
# How near to the nominal plant the nearest failing one is known, of its distance.
_NEAR = 1 / 256
# Who may have the worst plant; of equally bad ones the first has it.
SOURCES = ("samples", "search", "random")


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst plant for one controller, and who came how far. All margins are MuJoCo's.

    Attributes:
        controller: Its name.
        values: The uncertain numbers of the worst plant, (d,).
        relative: Its least margin in parts of the limit; negative if something is not kept. Of
            plants that never settle the worst has the largest error left, see ``Outcomes.order``.
        winner: Which of ``SOURCES`` has it.
        samples: Least margin of the worst sample of the campaign, with which the search began.
        search: The same of the worst plant of the search.
        random: The same of the worst of as many random plants.
        evaluations: Runs of the search, and of the random plants.
        shrunk: The nearest plant to the nominal one that fails, as far as was looked, (d,); None
            if nothing fails.
        shrunk_relative: Its least margin.
        changed: Names of the numbers that are not nominal in it.
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
) -> Worst:
    """Search by differential evolution, a generation as one batch, and try as many random plants.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        ids: Its worst runs, the worst first.
        evaluations: Runs that the search may take, ``LEAST`` or more; the random plants are as
            many.
        advance: Called with the number of runs done.
    """
    family, seed, d = campaign.family, campaign.specification.seed, len(campaign.family.quantities)
    sampler, corners = campaign.specification.sampler, family.corners(_CORNERS)
    samples = np.concatenate([campaign.points(sampler, run, 1) for run in ids[:_SAMPLES]])
    rest = campaign.points("random", 0, _POPULATION - len(samples) - len(corners), more=2)
    first: Any = np.concatenate([samples, corners, rest])
    search = _Contender(campaign, controller, advance)
    differential_evolution(
        lambda x: search(x.T.reshape(-1, d)),
        [(0.0, 1.0)] * d,
        init=first,
        maxiter=evaluations // _POPULATION - 1,
        tol=0.0,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=np.random.default_rng(seed),
    )
    random = _Contender(campaign, controller, advance)
    for start in range(0, search.runs, _POPULATION):
        random(campaign.points("random", start, _POPULATION, more=1))
    sampled = family.values(samples)
    sampled = sampled[int(evaluate(campaign, controller, sampled)["order"].argmin())]
    candidates = np.stack([sampled, search.values, random.values])
    outcome = evaluate(campaign, controller, candidates)
    margins, winner = outcome["relative"].tolist(), int(outcome["order"].argmin())
    shrunk_plant = shrunk_margin = None
    changed: tuple[str, ...] = ()
    if margins[winner] < 0:
        shrunk_plant = shrunk(campaign, controller, candidates[winner])
        shrunk_margin = float(evaluate(campaign, controller, shrunk_plant[None])["relative"][0])
        pairs = zip(family.quantities, shrunk_plant, strict=True)
        changed = tuple(number.name for number, value in pairs if value != number.nominal)
    return Worst(
        controller, candidates[winner], margins[winner], SOURCES[winner], margins[0], margins[1],
        margins[2], search.runs,
        shrunk_plant, shrunk_margin, changed,
    )  # fmt: skip


class _Contender:
    """Unit points (n, d) to how bad their plants are, (n,); keeps the worst of all, (d,)."""

    def __init__(
        self, campaign: Campaign, controller: str, advance: Callable[[int], object]
    ) -> None:
        self._campaign, self._controller, self._advance = campaign, controller, advance
        self._least, self.values, self.runs = math.inf, np.zeros(0), 0

    def __call__(self, points: Array) -> Array:
        values = self._campaign.family.values(inside(points))
        order = screened_search(self._campaign, self._controller, values)["order"]
        if order.min() < self._least:
            self._least, self.values = float(order.min()), values[int(order.argmin())]
        self.runs += len(points)
        self._advance(len(points))
        return order


def shrunk(campaign: Campaign, controller: str, values: Array) -> Array:
    """A failing plant brought towards the nominal one as far as it fails still, (d,).

    Numbers are made nominal one by one, each time the one without which it fails worst; then all
    that are left are moved towards their nominal values together.
    """
    nominal, plant = campaign.family.nominal, values.copy()

    def order(candidates: Array) -> Array:
        return screened_search(campaign, controller, candidates)["order"]

    while len(left := np.flatnonzero(plant != nominal)):
        candidates = np.tile(plant, (len(left), 1))
        candidates[range(len(left)), left] = nominal[left]
        tried = order(candidates)
        if not tried.min() < 0:
            break
        plant = candidates[int(tried.argmin())]

    def passes(share: float) -> bool:
        return bool(order((nominal + share * (plant - nominal))[None])[0] >= 0)

    high = largest_passing(passes, 0.0, 1.0, 1.0, 0.0, _NEAR)[1]
    return plant if high >= 1.0 else nominal + high * (plant - nominal)


def worst_table(campaign: Campaign, searches: Sequence[Worst]) -> Table:
    """The worst plant under each controller, and who came how far."""
    rows = []
    for plant in searches:
        nearest = "none was found"
        if plant.shrunk is not None:
            margin = number(plant.shrunk_relative)
            nearest = f"{campaign.words(plant.shrunk)}: margin {margin}"
        margins = map(number, (plant.samples, plant.search, plant.random))
        values = f"{campaign.words(plant.values)}: margin {number(plant.relative)}"
        rows.append((label_of(plant.controller), *margins, plant.winner, values, nearest))
    runs = searches[0].evaluations
    return table(
        "The worst plant: least margin in parts of its limit",
        [
            *names("law"), *numbers("samples", "search", "random"), *words("worst by"),
            *text("the worst plant"), *text("nearest to the nominal plant that fails"),
        ],
        rows,
        legend="Samples: the worst run of the campaign. Search: differential evolution that begins "
        f"with the worst samples and the corners of the ranges, {runs} runs; random: {runs} random "
        "plants. All three were judged in MuJoCo; of equally bad ones the first is named. Of "
        "plants that never settle the one with the largest error left is the worst, of runs that "
        "end early the earliest. Below zero something is not kept; numbers not named are nominal. "
        f"{NO_PROOF}",
    )  # fmt: skip


def worst_document(campaign: Campaign, searches: Sequence[Worst]) -> dict[str, Any]:
    """The worst plants, by controller."""
    failing = [plant.controller for plant in searches if plant.fails]
    answer = Answer(
        question=f"Worst plants of {campaign.specification.name}",
        verdict=NOT_KEPT if failing else MEASURED,
        words=f"a failing plant was found for {', '.join(failing)}" if failing else "none fails",
    )
    return result_of(
        campaign,
        "worst",
        answers=[answer],
        sheets=[Sheet(table=worst_table(campaign, searches))],
        values=[
            Value(name=f"{plant.controller}: least margin", value=finite(plant.relative), better=1)
            for plant in searches
        ],
        says=NO_PROOF,
        controllers={
            plant.controller: {
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
            for plant in searches
        },
    )
