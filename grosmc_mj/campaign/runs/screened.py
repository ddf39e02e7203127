"""Runs on the equations, with those confirmed in MuJoCo that need it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.plant_sample import PlantSample
from grosmc_mj.campaign.family.sampling import independent
from grosmc_mj.campaign.runs.screening import (
    Screening,
    band_for,
    equations_of,
    screening_of,
    shares,
    verdicts_overturned,
)
from grosmc_mj.campaign.runs.shard import Outcomes, evaluate, evaluate_all, plants_of, run_on
from grosmc_mj.errors import ModelError
from grosmc_mj.plants import Plant

# What a search compares with limits, beside requirements.
Measured = Callable[[Outcomes], list[Array]]
# The part of a campaign's runs that is confirmed by chance.
RANDOM = 0.02
# Beside the seed, so that the draw has nothing to do with the runs' own numbers.
_DRAW = 0x5C4EE7
# Of the plants that a search tries together the worst are confirmed: one of them decides.
_WORST_OF_SEARCH = 4


@dataclass(frozen=True, eq=False)
class _Twins:
    """The same plants in MuJoCo and as equations, n of each, with their numbers (n, d)."""

    campaign: Campaign
    values: Array
    samples: Sequence[PlantSample]
    physics: Sequence[Plant]
    equations: Sequence[Plant]
    threads: int = 0

    @classmethod
    def of(
        cls, campaign: Campaign, values: Array, ids: Sequence[int], threads: int = 0
    ) -> _Twins | None:
        """Those with these numbers; None if the equations lack a term for one of them."""
        samples = [campaign.plant_sample(row, run) for row, run in zip(values, ids, strict=True)]
        physics = plants_of(campaign, samples)
        try:
            return cls(campaign, values, samples, physics, equations_of(physics), threads)
        except ModelError:
            return None

    def by_equations(self, controller: str) -> Outcomes:
        """All plants as equations under a controller."""
        return run_on(
            self.equations, self.campaign, controller, self.values, self.samples, self.threads
        )

    def in_mujoco(self, controller: str, rows: NDArray[np.intp]) -> Outcomes:
        """Some plants in MuJoCo under a controller."""
        samples, physics = (
            [all_of[row] for row in rows] for all_of in (self.samples, self.physics)
        )
        return run_on(physics, self.campaign, controller, self.values[rows], samples, self.threads)


def screened_search(
    campaign: Campaign, controller: str, values: Array, also: Measured = lambda _: []
) -> Outcomes:
    """Run plants that a search tries, as ``evaluate`` does, on the equations where these may judge.

    Confirmed in MuJoCo, whose outcome counts then, are runs that ended early, that have a margin
    within the band about its limit, and the worst of all. The band is widened by what the
    confirmed runs show until nothing new is within it.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers, (n, d).
        also: What else is compared with a limit, as margins in parts of it, (n,) each.
    """
    screening = screening_of(campaign)
    twins = _Twins.of(campaign, values, [0] * len(values)) if screening.bands else None
    if twins is None:
        return evaluate(campaign, controller, values)
    band = screening.bands[controller]
    ours = theirs = twins.by_equations(controller)
    needed = _ended_early(ours)
    needed[ours.order.argsort(kind="stable")[:_WORST_OF_SEARCH]] = True
    confirmed, margins = np.zeros(len(values), bool), [*shares(campaign, ours), *also(ours)]
    while len(rows := np.flatnonzero((needed | _within(margins, band)) & ~confirmed)):
        again = twins.in_mujoco(controller, rows)
        theirs, confirmed[rows] = theirs.with_rows(rows, again), True
        band = band_for(campaign, ours.rows(rows), again, band)
    return theirs


def screened_all(
    campaign: Campaign,
    screening: Screening,
    controllers: Iterable[str],
    values: Array,
    threads: int,
    ids: Sequence[int],
) -> list[Outcomes]:
    """Run the same plants under each controller, as ``evaluate_all`` does, where equations may.

    A run is confirmed in MuJoCo, whose outcome counts then, if it ended early, if a margin is
    within the band about its limit, if it is worse than the worst of the sample by which the
    screening was measured, or by chance. So it depends on the run's own number and margins alone,
    and on no other run of its part.

    Args:
        campaign: The campaign.
        screening: How far equations may be believed.
        controllers: Names of the controllers.
        values: The uncertain numbers, (n, d).
        threads: 0 for all cores.
        ids: Numbers of the runs, n of them.
    """
    twins = _Twins.of(campaign, values, ids, threads) if screening.bands else None
    if twins is None:
        return evaluate_all(campaign, controllers, values, threads, ids)
    by_chance = drawn_by_chance(campaign.specification.seed, ids)
    outcomes = []
    for controller in controllers:
        ours, band = twins.by_equations(controller), screening.bands[controller]
        needed = _ended_early(ours) | _within(shares(campaign, ours), band)
        needed |= ours.order < screening.worst.get(controller, -math.inf)
        rows = np.flatnonzero(needed | by_chance)
        theirs = ours.with_rows(rows, twins.in_mujoco(controller, rows)) if len(rows) else ours
        outcomes.append(
            replace(
                theirs,
                screened=ours.relative,
                overturned=verdicts_overturned(ours, theirs),
                drawn=(by_chance & ~needed).astype(np.int64),
                band=band,
            )
        )
    return outcomes


def drawn_by_chance(seed: int, ids: Sequence[int]) -> NDArray[np.bool_]:
    """Which runs are confirmed by chance, each by the seed and its own number, (n,)."""
    draws = [independent(1, seed ^ _DRAW, run, 1)[0, 0] for run in ids]
    return np.array(draws) < RANDOM


def _ended_early(runs: Outcomes) -> NDArray[np.bool_]:
    """Runs that did not complete, (n,)."""
    return np.array(runs.status) != "completed"


def _within(margins: Sequence[Array], band: float) -> NDArray[np.bool_]:
    """Runs with a margin within the band about its limit, (n,); False if there are no margins."""
    return np.any([np.abs(margin) <= band for margin in margins], axis=0)
