"""Screening of a campaign by the equations: MuJoCo confirms the runs that need it; a summary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import plural
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.studies.campaign.batch import Batch
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.sweep.agreement import model_mismatch
from grosmc_mj.studies.sweep.confirmation import (
    FACTOR,
    RANDOM,
    MarginConfirmation,
    Mask,
    band_of,
    confirmation_words,
    wrong_at_most,
)
from grosmc_mj.studies.sweep.family import random_points
from grosmc_mj.studies.sweep.runs import Outcomes, plant_of

# Judges of a run.
EQUATIONS = "equations"
PHYSICS = "physics"
# Runs of the sample, and on how many of its plants accelerations are compared.
SAMPLE = 32
_PLANTS = 8
# Beyond it equations would judge little: ``auto`` leaves all to MuJoCo.
LARGEST_BAND = 0.1
# With fewer runs the sample and the confirmed ones are most of them: nothing is gained.
FEWEST = 512
# Mixed into a campaign's seed, so that the draw of runs to confirm has nothing to do with the runs'
# own numbers.
_DRAW = 0x5C4EE7
# Of the plants that a search tries together the worst are confirmed: one of them decides.
_WORST_OF_SEARCH = 4
# Runs that MuJoCo overturned are named, up to so many.
_NAMED = 16


@dataclass(frozen=True)
class Screening:
    """Screening of a campaign's runs by the equations, in plain values that travel.

    Attributes:
        bands: Distance from its limit within which a margin is confirmed in MuJoCo, in parts of
            the limit, by controller. Empty if nothing is screened.
        why_not: Reason why nothing is screened that could be, for people.
        worst: ``order`` of the worst run of the sample, by controller; worse runs are confirmed.
    """

    bands: Mapping[str, float] = field(default_factory=dict)
    why_not: str = ""
    worst: Mapping[str, float] = field(default_factory=dict)


UNSCREENED = Screening()


# Its runs take seconds, and every search of a campaign asks for it.
@lru_cache(maxsize=4)
def screening_of(campaign: Campaign) -> Screening:
    """Measure how far equations and MuJoCo agree on a family, once."""
    specification = campaign.specification
    automatic = specification.screen == "auto"
    if specification.screen == "none" or campaign.plant.kind != "physics":
        return UNSCREENED
    if automatic and specification.runs < FEWEST:
        return UNSCREENED

    reason = _campaign_mismatch(campaign)
    if reason:
        return Screening(why_not=reason)
    # Of another seed: the campaign's own first runs would be judged twice.
    points = campaign.points("random", 0, SAMPLE, more=1)
    batch = Batch(campaign, campaign.family.values(points), range(SAMPLE))
    reason = _sample_mismatch(batch)
    if reason:
        return Screening(why_not=reason)

    bands: dict[str, float] = {}
    worst: dict[str, float] = {}
    for controller in campaign.laws:
        by_equations = batch.run(controller, plants=batch.equations)
        by_physics = batch.run(controller)
        bands[controller] = band_of(by_equations.shares, by_physics.shares)
        worst[controller] = float(by_physics["order"].min())

        overturned = int((verdicts_overturned(by_equations, by_physics) > 0).sum())
        if automatic and (overturned or bands[controller] > LARGEST_BAND):
            difference = bands[controller] / FACTOR
            return Screening(
                why_not=f"under {controller} margins differ from MuJoCo's by up to "
                f"{difference:.2g} of a limit on {SAMPLE} plants, verdicts on {overturned}"
            )
    return Screening(bands, worst=worst)


def _campaign_mismatch(campaign: Campaign) -> str:
    """Reason why no equations can describe its plants; empty if they may."""
    plant = campaign.plant
    nominal = plant_of(campaign.plant_sample(campaign.family.nominal), plant)
    if isinstance(nominal, MujocoPlant) and (nominal.parts or not nominal.system.symbolic):
        return model_mismatch(nominal)
    if plant.stepped_by != "RK4":
        return f"equations are stepped by RK4, the model by {plant.stepped_by}"
    return ""


def _sample_mismatch(batch: Batch) -> str:
    """Reason why the equations do not describe a sampled plant; empty if they do."""
    plants = batch.physics
    if batch.equations:
        # All of them have equations; accelerations are compared on the first ones alone.
        plants = plants[:_PLANTS]
    for plant in plants:
        reason = model_mismatch(plant)
        if reason:
            return reason
    return ""


def verdicts_overturned(by_equations: Outcomes, by_physics: Outcomes) -> NDArray[np.int64]:
    """Count the verdicts on which two judges of the same runs differ, of all requirements, (n,)."""
    differing = by_equations.verdicts != by_physics.verdicts
    return differing.sum(axis=0, dtype=np.int64)


def screened_search(
    campaign: Campaign,
    controller: str,
    values: Array,
    ids: Sequence[int],
) -> Outcomes:
    """Run plants that a search tries, on the equations where these may judge.

    Confirmed in MuJoCo, whose outcome counts then, are runs that ended early, that have a margin
    within the band about its limit, and the worst of all.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers, (n, d).
        ids: Numbers of the runs, (n,), for what their loops draw.
    """
    screening = screening_of(campaign)
    batch = Batch(campaign, values, ids)
    if not screening.bands or not batch.equations:
        return batch.run(controller)

    by_equations = batch.run(controller, plants=batch.equations)
    worst = np.zeros(len(values), bool)
    worst[by_equations["order"].argsort(kind="stable")[:_WORST_OF_SEARCH]] = True
    confirmation = MarginConfirmation(
        by_equations.shares,
        doubtful=~by_equations.completed,
        checked=worst,
        band=screening.bands[controller],
    )
    return _confirmed(batch, controller, by_equations, confirmation)


def screened_all(
    campaign: Campaign,
    screening: Screening,
    controllers: Iterable[str],
    ids: range,
    threads: int = 0,
) -> list[Outcomes]:
    """Run a part of a campaign under each controller, on the equations where these may judge.

    A run is confirmed in MuJoCo, whose outcome counts then, if it ended early, if a margin is
    within the band about its limit, if it is worse than the worst of the sample by which the
    screening was measured, or by chance; all of a part are if one that was not in doubt is
    overturned.

    Args:
        campaign: The campaign.
        screening: Measured agreement of equations and MuJoCo.
        controllers: Names of the controllers.
        ids: Numbers of the runs, n of them.
        threads: Number of threads; 0 for all cores.

    Returns:
        The runs under each controller, with the columns of ``SCREENING``: ``judged_by``,
        ``EQUATIONS`` or ``PHYSICS``; ``screened``, ``relative`` by the equations, NaN of runs that
        were not screened; ``overturned``, the number of verdicts that MuJoCo overturned; ``drawn``,
        1 for a run that was confirmed by chance alone; ``band``, how near to its limit a margin is
        confirmed, in parts of the limit.
    """
    batch = Batch(campaign, campaign.values(ids), ids, threads)
    if not screening.bands or not batch.equations:
        return [_unscreened(batch, controller) for controller in controllers]

    by_chance = drawn_by_chance(campaign.specification.seed, ids)
    return [_screened(batch, screening, controller, by_chance) for controller in controllers]


def _unscreened(batch: Batch, controller: str) -> Outcomes:
    """Runs under one controller, in MuJoCo where there is a model."""
    outcome = batch.run(controller)
    count = len(batch.values)
    judge = PHYSICS if batch.physics[0].kind == "physics" else EQUATIONS
    return outcome.changed(
        judged_by=np.full(count, judge, object),
        screened=np.full(count, np.nan),
        overturned=np.zeros(count, np.int64),
        drawn=np.zeros(count, np.int64),
        band=np.zeros(count),
    )


def _screened(batch: Batch, screening: Screening, controller: str, by_chance: Mask) -> Outcomes:
    """Runs under one controller on the equations, those that need it confirmed in MuJoCo."""
    by_equations = batch.run(controller, plants=batch.equations)
    beyond_sample = by_equations["order"] < screening.worst.get(controller, -math.inf)
    confirmation = MarginConfirmation(
        by_equations.shares,
        doubtful=~by_equations.completed | beyond_sample,
        checked=by_chance,
        band=screening.bands[controller],
    )
    outcome = _confirmed(batch, controller, by_equations, confirmation)
    return outcome.changed(
        screened=by_equations["relative"],
        overturned=verdicts_overturned(by_equations, outcome),
        drawn=confirmation.drawn.astype(np.int64),
        band=np.full(len(by_chance), confirmation.band),
    )


def _confirmed(
    batch: Batch,
    controller: str,
    by_equations: Outcomes,
    confirmation: MarginConfirmation,
) -> Outcomes:
    """Runs on the equations, in which those that MuJoCo confirms are replaced by its own."""
    outcome = by_equations
    for rows in confirmation.rounds():
        by_physics = batch.run(controller, rows)
        outcome = outcome.with_rows(rows, by_physics)
        overturned = verdicts_overturned(by_equations.rows(rows), by_physics) > 0
        confirmation.note_margins(rows, overturned, by_physics.shares)

    judged_by = np.where(confirmation.confirmed, PHYSICS, EQUATIONS)
    return outcome.changed(judged_by=judged_by.astype(object))


def drawn_by_chance(seed: int, ids: range) -> Mask:
    """Return True for each run that is confirmed by chance, (n,), by the seed and its number.

    So a run is drawn in whatever part it is made.
    """
    return random_points(1, seed ^ _DRAW, ids.start, len(ids))[:, 0] < RANDOM


class ScreeningSummary(NamedTuple):
    """Shares of the equations and of MuJoCo in judging the runs of one controller.

    Attributes:
        runs: Number of runs.
        by_equations: Number of runs that the equations judged; MuJoCo judged the others.
        overturned: Number of runs of which MuJoCo overturned a verdict of the equations.
        overturned_runs: Numbers of the first of these.
        band: The band about a limit within which margins were confirmed, in parts of it.
        difference: Largest difference of a least margin that was confirmed, in parts of a limit.
        drawn: Number of runs that were confirmed by chance alone.
        drawn_overturned: Number of these of which MuJoCo overturned a verdict.
    """

    runs: int
    by_equations: int
    overturned: int
    overturned_runs: list[int]
    band: float
    difference: float
    drawn: int
    drawn_overturned: int

    @property
    def wrong_at_most(self) -> float:
        """Bound on the share of the runs by equations of which MuJoCo would overturn a verdict."""
        return wrong_at_most(self.drawn, self.drawn_overturned)

    @classmethod
    def of(cls, rows: Mapping[str, Array]) -> ScreeningSummary:
        """Return the summary of one controller's rows."""
        difference = np.abs(rows["screened"] - rows["relative"])
        overturned = rows["overturned"] > 0
        drawn = rows["drawn"] > 0
        return cls(
            runs=len(overturned),
            by_equations=int((rows["judged_by"] == EQUATIONS).sum()),
            overturned=int(overturned.sum()),
            overturned_runs=rows["id"][overturned][:_NAMED].astype(int).tolist(),
            band=float(rows["band"].max()),
            difference=float(difference[np.isfinite(difference)].max(initial=0.0)),
            drawn=int(drawn.sum()),
            drawn_overturned=int((drawn & overturned).sum()),
        )


def screening_sentences(summaries: Mapping[str, ScreeningSummary]) -> str:
    """Say who judged all runs, and what is known of their verdicts.

    Args:
        summaries: By law.

    Returns:
        Sentences; nothing where MuJoCo judged all.
    """
    by_equations = sum(summary.by_equations for summary in summaries.values())
    band = max((summary.band for summary in summaries.values()), default=0.0)
    # Without a model in MuJoCo nothing is screened: equations are the plant.
    if not by_equations or not band:
        return ""

    runs = sum(summary.runs for summary in summaries.values())
    difference = max(summary.difference for summary in summaries.values())
    sentences = [
        f"{by_equations:,} of {runs:,} {plural(runs, 'run')} judged by the equations, "
        f"{runs - by_equations:,} in MuJoCo (band {band:.2g} of a limit; margins "
        f"confirmed differ by {difference:.2g})."
    ]
    for law, summary in summaries.items():
        if summary.drawn:
            words = confirmation_words(summary.drawn, summary.drawn_overturned)
            sentences.append(f"{law}: {words}.")
        if summary.overturned:
            runs_named = ", ".join(map(str, summary.overturned_runs))
            if summary.overturned > len(summary.overturned_runs):
                runs_named += ", ..."
            sentences.append(f"MuJoCo overturned {summary.overturned}: {runs_named}.")
    return " ".join(sentences)
