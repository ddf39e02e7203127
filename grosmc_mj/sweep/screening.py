"""Runs of a campaign's plants: on the equations, with those that need it confirmed in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.sweep.agreement import FACTOR, LEAST_BAND, model_mismatch
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import random_points
from grosmc_mj.sweep.parameters import Varied
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows

# What judges a run.
EQUATIONS, PHYSICS = "equations", "physics"
# Runs of the sample, and on how many of its plants accelerations are compared.
SAMPLE, _PLANTS = 32, 8
# Beyond it equations would judge little: ``auto`` leaves all to MuJoCo.
LARGEST_BAND = 0.1
# With fewer runs the sample and the confirmed ones are most of them: nothing is said, or lost.
FEWEST = 512
# The part of a campaign's runs that is confirmed by chance, and what is mixed into its seed, so
# that the draw has nothing to do with the runs' own numbers.
RANDOM, _DRAW = 0.02, 0x5C4EE7
# Of the plants that a search tries together the worst are confirmed: one of them decides.
_WORST_OF_SEARCH = 4


@dataclass(frozen=True, eq=False)
class Batch:
    """Plants that each controller meets; compiled once for all of them.

    The outcomes of their runs have more columns: ``controller``, ``id``, the uncertain numbers and,
    of screening, ``judged_by``, ``EQUATIONS`` or ``PHYSICS``; ``screened``, ``relative`` by the
    equations of those that were screened, NaN of others; ``overturned``, how many verdicts MuJoCo
    overturned; ``drawn``, 1 for a run that was confirmed in MuJoCo by chance alone; ``band``, how
    near to its limit a screened margin is confirmed, in parts of the limit.

    Attributes:
        campaign: The campaign.
        values: The uncertain numbers, (n, d).
        ids: Numbers of the runs, (n,), for what their loops draw; 0 for plants that are no runs.
        threads: 0 for all cores.
    """

    campaign: Campaign
    values: Array
    ids: Sequence[int]
    threads: int = 0

    @cached_property
    def samples(self) -> list[Varied]:
        """The case with each of the values, n of them."""
        return [self.campaign.plant_sample(values) for values in self.values]

    @cached_property
    def physics(self) -> list[Plant]:
        """The plants; those with the same edits are one."""
        plants: dict[Any, Plant] = {}
        keys = [(sample.case.edits, sample.scales) for sample in self.samples]
        for key, sample in zip(keys, self.samples, strict=True):
            plants[key] = plants.get(key) or sample.plant(self.campaign.plant)
        return [plants[key] for key in keys]

    @cached_property
    def equations(self) -> list[AnalyticPlant]:
        """The equations with the numbers of the plants' models; none if they lack something."""
        try:
            equations = {plant: plant.analytic() for plant in dict.fromkeys(self.physics)}
        except ModelError:
            return []
        return [equations[plant] for plant in self.physics]

    def row(self, controller: str, index: int, plant: Plant) -> Row:
        """A row of the design, on its plant or its equations."""
        law, case = self.campaign.laws[controller], self.samples[index].case
        return Row(law, case=case, number=self.ids[index], plant=plant)

    def run(
        self,
        controller: str,
        rows: NDArray[np.intp] | None = None,
        plants: Sequence[Plant] | None = None,
    ) -> Outcomes:
        """Run the plants, or some of them, in MuJoCo where there is a model, or other plants."""
        campaign, plants = self.campaign, plants or self.physics
        numbers = list(range(len(self.values))) if rows is None else rows.tolist()
        design = [self.row(controller, index, plants[index]) for index in numbers]
        limits = campaign.requirements
        runs = run_rows(campaign.experiment, design, limits, threads=self.threads)
        return self.completed(runs, controller, numbers, plants[0])

    def completed(self, runs: Outcomes, controller: str, rows: Any, plant: Plant) -> Outcomes:
        """Runs of some rows with the columns of a part."""
        count, names = len(rows), self.campaign.family.names
        judge = PHYSICS if plant.kind == "physics" else EQUATIONS
        return runs.changed(
            controller=np.array([controller] * count, object),
            id=np.asarray(self.ids, np.int64)[rows],
            **dict(zip(names, self.values[rows].T, strict=True)),
            judged_by=np.array([judge] * count, object),
            screened=np.full(count, np.nan),
            overturned=np.zeros(count, np.int64),
            drawn=np.zeros(count, np.int64),
            band=np.zeros(count),
        )


def evaluate(campaign: Campaign, controller: str, values: Array) -> Outcomes:
    """Run plants (n, d) that are no runs of the campaign, in MuJoCo where there is a model."""
    return Batch(campaign, values, [0] * len(values)).run(controller)


@dataclass(frozen=True)
class Screening:
    """How the runs of a campaign are screened by the equations, plain values that travel.

    Attributes:
        bands: By controller: how near to its limit a margin is confirmed in MuJoCo, in parts of
            the limit. Empty if nothing is screened.
        why_not: Why nothing is that could be, for people.
        worst: By controller: ``order`` of the worst run of the sample; what is worse is confirmed.
    """

    bands: Mapping[str, float] = field(default_factory=dict)
    why_not: str = ""
    worst: Mapping[str, float] = field(default_factory=dict)


UNSCREENED = Screening()


@lru_cache(maxsize=4)
def screening_of(campaign: Campaign) -> Screening:
    """Measure how far equations and MuJoCo agree on a family, once."""
    screen, few = campaign.specification.screen, campaign.specification.runs < FEWEST
    if screen == "none" or campaign.plant.kind != "physics" or (screen == "auto" and few):
        return UNSCREENED
    if why_not := _campaign_mismatch(campaign):
        return Screening(why_not=why_not)
    # Of another seed: the campaign's own first runs would be judged twice.
    points = campaign.points("random", 0, SAMPLE, more=1)
    batch = Batch(campaign, campaign.family.values(points), range(SAMPLE))
    # The plants whose accelerations are compared; of the others, whether there are equations.
    for plant in batch.physics[: _PLANTS if batch.equations else None]:
        if why_not := model_mismatch(plant):
            return Screening(why_not=why_not)
    bands: dict[str, float] = {}
    worst: dict[str, float] = {}
    for controller in campaign.laws:
        ours, theirs = batch.run(controller, plants=batch.equations), batch.run(controller)
        overturned = int((verdicts_overturned(ours, theirs) > 0).sum())
        bands[controller] = band_for(ours, theirs)
        worst[controller] = float(theirs["order"].min())
        if screen == "auto" and (overturned or bands[controller] > LARGEST_BAND):
            difference = bands[controller] / FACTOR
            return Screening(
                why_not=f"under {controller} margins differ from MuJoCo's by up to "
                f"{difference:.2g} of a limit on {SAMPLE} plants, verdicts on {overturned}"
            )
    return Screening(bands, worst=worst)


def _campaign_mismatch(campaign: Campaign) -> str:
    """What no equations of any of its plants can have; empty if they may have everything."""
    plant = campaign.plant
    nominal = campaign.plant_sample(campaign.family.nominal).plant(plant)
    if isinstance(nominal, MujocoPlant) and (nominal.parts or not nominal.system.symbolic):
        return model_mismatch(nominal)
    if plant.stepped_by != "RK4":
        return f"equations are stepped by RK4, the model by {plant.stepped_by}"
    return ""


def band_for(ours: Outcomes, theirs: Outcomes, band: float = LEAST_BAND) -> float:
    """How near to a limit the equations cannot be believed, in parts of the limit.

    It is ``FACTOR`` times the largest difference of a margin, and beyond every margin of a run
    that MuJoCo judges otherwise.

    Args:
        ours: Runs on the equations.
        theirs: The same runs in MuJoCo.
        band: The least that it can be.
    """
    for one, other in zip(ours.shares, theirs.shares, strict=True):
        both = np.isfinite(one) & np.isfinite(other)
        apart = np.isfinite(one) & ((one >= 0) != (other >= 0))
        largest = np.concatenate([np.abs(one[both] - other[both]), np.abs(one[apart])])
        band = max(band, FACTOR * float(largest.max(initial=0.0)))
    return band


def verdicts_overturned(ours: Outcomes, theirs: Outcomes) -> NDArray[np.int64]:
    """On how many verdicts two judges of the same runs differ, each requirement's one, (n,)."""
    count = (ours.completed != theirs.completed).astype(np.int64)
    for one, other in zip(ours.shares, theirs.shares, strict=True):
        count += (one >= 0) != (other >= 0)
    return count


def screened_search(
    campaign: Campaign,
    controller: str,
    values: Array,
    also: Callable[[Outcomes], list[Array]] = lambda _: [],
) -> Outcomes:
    """Run plants that a search tries, on the equations where these may judge.

    Confirmed in MuJoCo, whose outcome counts then, are runs that ended early, that have a margin
    within the band about its limit, and the worst of all. The band is widened by what the
    confirmed runs show until nothing new is within it.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers, (n, d).
        also: Other quantities that are compared with a limit, as margins in parts of it, (n,) each.
    """
    screening, batch = screening_of(campaign), Batch(campaign, values, [0] * len(values))
    if not screening.bands or not batch.equations:
        return batch.run(controller)
    band = screening.bands[controller]
    ours = theirs = batch.run(controller, plants=batch.equations)
    needed = ~ours.completed
    needed[ours["order"].argsort(kind="stable")[:_WORST_OF_SEARCH]] = True
    confirmed, margins = np.zeros(len(values), bool), [*ours.shares, *also(ours)]
    while len(rows := np.flatnonzero((needed | _within(margins, band)) & ~confirmed)):
        again = batch.run(controller, rows)
        theirs, confirmed[rows] = theirs.with_rows(rows, again), True
        band = band_for(ours.rows(rows), again, band)
    return theirs


def screened_all(
    campaign: Campaign,
    screening: Screening,
    controllers: Iterable[str],
    ids: range,
    threads: int = 0,
) -> list[Outcomes]:
    """Runs of a campaign under each controller, on the equations where these may judge.

    A run is confirmed in MuJoCo, whose outcome counts then, if it ended early, if a margin is
    within the band about its limit, if it is worse than the worst of the sample by which the
    screening was measured, or by chance. So it depends on the run's own number and margins alone,
    and on no other run of its part.

    Args:
        campaign: The campaign.
        screening: How far equations may be believed.
        controllers: Names of the controllers.
        ids: Numbers of the runs, n of them.
        threads: 0 for all cores.
    """
    batch = Batch(campaign, campaign.values(ids), ids, threads)
    if not screening.bands or not batch.equations:
        return [batch.run(controller) for controller in controllers]
    by_chance, all_runs = drawn_by_chance(campaign.specification.seed, ids), []
    for controller in controllers:
        ours = batch.run(controller, plants=batch.equations)
        band = screening.bands[controller]
        needed = ~ours.completed | _within(ours.shares, band)
        needed |= ours["order"] < screening.worst.get(controller, -math.inf)
        rows = np.flatnonzero(needed | by_chance)
        theirs = ours.with_rows(rows, batch.run(controller, rows)) if len(rows) else ours
        all_runs.append(
            theirs.changed(
                screened=ours["relative"],
                overturned=verdicts_overturned(ours, theirs),
                drawn=(by_chance & ~needed).astype(np.int64),
                band=np.full(len(ids), band),
            )
        )
    return all_runs


def drawn_by_chance(seed: int, ids: range) -> NDArray[np.bool_]:
    """Which runs are confirmed by chance, each by the seed and its own number, (n,)."""
    return random_points(1, seed ^ _DRAW, ids.start, len(ids))[:, 0] < RANDOM


def _within(margins: Sequence[Array], band: float) -> NDArray[np.bool_]:
    """Runs with a margin within the band about its limit, (n,); False if there are no margins."""
    return np.any([np.abs(margin) <= band for margin in margins], axis=0)
