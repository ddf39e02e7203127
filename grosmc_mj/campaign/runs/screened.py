"""Runs on the equations, with those confirmed in MuJoCo that need it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.runs.screening import (
    Screening,
    band_for,
    equations_of,
    screening_of,
    shares,
    verdicts_overturned,
)
from grosmc_mj.campaign.runs.shard import Outcomes, evaluate_all, plants_of, run_on
from grosmc_mj.errors import ModelError

# What a search compares with limits, beside requirements.
Measured = Callable[[Outcomes], list[Array]]
# Of a campaign's runs the worst are confirmed, each part giving its share, and of the others...
WORST = 100
# ...this part, drawn at random.
RANDOM = 0.02
# Beside the seed, so that what is drawn has nothing to do with the runs' own numbers.
_DRAW = 0x5C4EE7
# Of the plants that a search tries together the worst are confirmed: one of them decides.
_WORST_OF_SEARCH = 4


def screened_search(
    campaign: Campaign, controller: str, values: Array, also: Measured = lambda _: []
) -> Outcomes:
    """Run plants that a search tries, as ``evaluate`` does, screened as the campaign's runs are.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers, (n, d).
        also: What else is compared with a limit, as margins in parts of it, (n,) each.
    """
    screening, numbers = screening_of(campaign), [0] * len(values)
    (found,) = screened_all(
        campaign, screening, [controller], values, 0, numbers, _WORST_OF_SEARCH, also
    )
    return found


def screened_all(
    campaign: Campaign,
    screening: Screening,
    controllers: Iterable[str],
    values: Array,
    threads: int,
    ids: Sequence[int],
    worst: int | None = None,
    also: Measured = lambda _: [],
) -> list[Outcomes]:
    """Run the same plants under each controller, as ``evaluate_all`` does, where equations may.

    A run is confirmed in MuJoCo, whose outcome counts then, if it ended early, if a margin is
    within the band of its limit, if it is among the worst, or by chance. The band is widened by
    what the confirmed runs show until nothing new is within it.

    Args:
        campaign: The campaign.
        screening: How far equations may be believed.
        controllers: Names of the controllers.
        values: The uncertain numbers, (n, d).
        threads: 0 for all cores.
        ids: Numbers of the runs, n of them: what is confirmed depends on no other runs.
        worst: How many of the worst are confirmed; by default their share of the campaign's.
        also: What else is compared with a limit, as margins in parts of it, (n,) each.
    """
    if worst is None:
        worst = math.ceil(WORST * len(ids) / campaign.specification.runs)
    if not screening.bands:
        return evaluate_all(campaign, controllers, values, threads, ids)
    samples = [campaign.plant_sample(row, run) for row, run in zip(values, ids, strict=True)]
    physics = plants_of(campaign, samples)
    try:
        equations = equations_of(physics)
    except ModelError:
        # None of the sample was like that.
        return evaluate_all(campaign, controllers, values, threads, ids)
    found = []
    for controller in controllers:
        band = screening.bands[controller]
        ours = run_on(equations, campaign, controller, values, samples, threads)
        theirs, confirmed = ours, np.zeros(len(ids), bool)
        wanted = _always(campaign.specification.seed, ours, ids, worst)
        margins = [*shares(campaign, ours), *also(ours)]
        while True:
            new = np.flatnonzero((wanted | _within(margins, band)) & ~confirmed)
            if not len(new):
                break
            again = run_on(
                [physics[i] for i in new],
                campaign,
                controller,
                values[new],
                [samples[i] for i in new],
                threads,
            )
            theirs = theirs.with_rows(new, again)
            confirmed[new] = True
            band = band_for(campaign, ours.rows(new), again, band)
        found.append(
            replace(
                theirs,
                screened=ours.relative,
                overturned=verdicts_overturned(ours, theirs),
                band=band,
            )
        )
    return found


def _always(seed: int, ours: Outcomes, ids: Sequence[int], worst: int) -> NDArray[np.bool_]:
    """Runs that are confirmed whatever the band is, (n,)."""
    chosen = np.array(ours.status) != "completed"
    chosen[ours.order.argsort(kind="stable")[:worst]] = True
    rest = np.flatnonzero(~chosen)
    random = np.random.default_rng([seed, _DRAW, ids[0]])
    chosen[random.permutation(rest)[: math.ceil(RANDOM * len(rest))]] = True
    return chosen


def _within(margins: Sequence[Array], band: float) -> NDArray[np.bool_]:
    """Runs with a margin within the band about its limit, (n,); False if there are no margins."""
    return np.any([np.abs(each) <= band for each in margins], axis=0)
