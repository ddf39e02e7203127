"""Runs on the equations, with those confirmed in MuJoCo that need it."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.runs.screening import (
    Screening,
    band_for,
    equations_of,
    shares,
    verdicts_overturned,
)
from grosmc_mj.campaign.runs.shard import Outcomes, evaluate_all, plants_of, run_on
from grosmc_mj.errors import ModelError

# Of a campaign's runs the worst are confirmed, each part giving its share, and of the others...
WORST = 100
# ...this part, drawn at random.
RANDOM = 0.02
# Beside the seed, so that what is drawn has nothing to do with the runs' own numbers.
_DRAW = 0x5C4EE7


def screened_all(
    campaign: Campaign,
    screening: Screening,
    controllers: Iterable[str],
    values: Array,
    threads: int,
    ids: range,
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
    """
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
        wanted = _always(campaign, ours, ids)
        while True:
            new = np.flatnonzero((wanted | _within(campaign, ours, band)) & ~confirmed)
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


def _always(campaign: Campaign, ours: Outcomes, ids: range) -> NDArray[np.bool_]:
    """Runs that are confirmed whatever the band is, (n,)."""
    specification = campaign.specification
    chosen = np.array(ours.status) != "completed"
    worst = math.ceil(WORST * len(ids) / specification.runs)
    chosen[ours.relative.argsort(kind="stable")[:worst]] = True
    rest = np.flatnonzero(~chosen)
    random = np.random.default_rng([specification.seed, _DRAW, ids.start])
    chosen[random.permutation(rest)[: math.ceil(RANDOM * len(rest))]] = True
    return chosen


def _within(campaign: Campaign, ours: Outcomes, band: float) -> NDArray[np.bool_]:
    """Runs with a margin within the band about its limit, (n,)."""
    near = np.zeros(len(ours.relative), bool)
    for share in shares(campaign, ours):
        near |= np.abs(share) <= band
    return near
