"""One run of a campaign again: recorded, on either engine, and compared bit by bit."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.experiments.metrics import METRICS, Metric, settling
from grosmc_mj.experiments.runs import RunResult, run_on
from grosmc_mj.plants import Plant
from grosmc_mj.results.result import KEPT, MEASURED, NOT_KEPT, Answer
from grosmc_mj.simulation.simulate import Engine
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.radius import RADIUS
from grosmc_mj.sweep.runs import MARGIN, Outcomes, ready
from grosmc_mj.sweep.screening import EQUATIONS, Batch
from grosmc_mj.sweep.store import Folder, result_of
from grosmc_mj.sweep.worst import WORST

# Plants that are no runs: where they stand, and the option that searches for them.
SEARCHED = {
    "worst": (WORST, "--worst"),
    "shrunk": (WORST, "--worst"),
    "outside": (RADIUS, "--radius"),
}


@dataclass(frozen=True, eq=False)
class ReplayedRun:
    """A run that was repeated.

    Attributes:
        result: The run, recorded, in MuJoCo where there is a model, to be drawn.
        judged: The run that is compared: on the equations if these judged it in the campaign. Its
            metrics are those that the campaign stores, of the law's samples; what a campaign does
            not store, such as costs, is of the recording.
        outcome: What the meters say of that, one row.
        differences: Of the stored row, a line each; empty if it is the same bit by bit; None if
            there is no row.
    """

    result: RunResult
    judged: RunResult
    outcome: Outcomes
    differences: list[str] | None


def replay(
    campaign: Campaign, folder: Folder, which: str, controller: str | None, engine: Engine
) -> ReplayedRun:
    """Repeat a run.

    Args:
        campaign: The campaign.
        folder: Where it is kept.
        which: Number of the run, or ``worst``, ``shrunk`` or ``outside``.
        controller: Its name; None for the campaign's last one.
        engine: ``native`` or ``python``.

    Raises:
        GrosmcError: If there is no such run or controller.
    """
    law = list(campaign.laws)[-1] if controller is None else controller
    require_known("controller", law, campaign.laws)
    runs, stored = campaign.specification.runs, None
    campaign = replace(campaign, experiment=campaign.experiment.with_settings(engine=engine))
    if which in SEARCHED:
        batch = Batch(campaign, searched_values(campaign, folder.path, which, law)[None], [0])
    elif which.isdecimal() and len(which) <= 18 and int(which) < runs:
        number = int(which)
        batch = Batch(campaign, campaign.values(range(number, number + 1)), [number])
        stored = _stored(campaign, folder, number, law)
    else:
        raise ArgumentError(f"run {which!r}: there are 0 to {runs - 1}, {', '.join(SEARCHED)}")
    result, outcome = _run(batch, law, batch.physics[0], which)
    if stored is None:
        return ReplayedRun(result, result, outcome, None)
    judged = result
    if stored.get("judged_by") == EQUATIONS:
        judged, outcome = _run(batch, law, batch.equations[0], which)
    lines = [
        f"{name}: {value} was stored, {outcome[name][0]} is found"
        for name, value in stored.items()
        if np.asarray(value).tobytes() != np.asarray(outcome[name][0]).tobytes()
    ]
    return ReplayedRun(result, judged, outcome, lines)


def searched_values(campaign: Campaign, folder: Path, which: str, controller: str) -> Array:
    """The uncertain numbers of a plant that was searched for, (d,).

    Args:
        campaign: The campaign.
        folder: Its folder.
        which: ``worst``, ``shrunk`` or ``outside``.
        controller: For whom it was found.

    Raises:
        SetupError: If there is no such plant.
    """
    name, option = SEARCHED[which]
    path = folder / name
    if not path.is_file():
        raise SetupError(f"{folder} has no {name}: run the campaign with {option}")
    try:
        plant = json.loads(path.read_text(encoding="utf-8"))["controllers"][controller][which]
        values = plant and np.array([float(plant[name]) for name in campaign.family.names])
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        raise SetupError(f"{path} cannot be read: run the campaign with {option} again") from None
    if values is None:
        raise SetupError(f"{path}: no plant was found that fails under {controller}")
    return values


def _run(batch: Batch, controller: str, plant: Plant, which: str) -> tuple[RunResult, Outcomes]:
    """The run, recorded, on a plant, with the metrics that a campaign stores of it."""
    experiment, (sample,) = batch.campaign.experiment, batch.samples
    outcome = batch.run(controller, plants=[plant])
    title = f"{sample.case.title}: run {which}"
    named = replace(experiment, case=replace(sample.case, name=which, title=title))
    law = ready(experiment, batch.row(controller, 0, plant)).law
    result = run_on(named, plant.kind, law, plant)
    if result.ended:
        return result, outcome
    common = result.metrics.keys() & METRICS.keys()
    stored = {name: _metric(result.metrics[name], float(outcome[name][0])) for name in common}
    return replace(result, metrics={**result.metrics, **stored}), outcome


def _metric(recorded: Metric, stored: float) -> Metric:
    """A recorded metric with the value that a campaign stores; infinite stands for never."""
    if recorded.note == "no surface":
        return recorded
    return settling(stored) if math.isinf(stored) else Metric(stored, recorded.unit)


def _stored(
    campaign: Campaign, folder: Folder, number: int, controller: str
) -> dict[str, Any] | None:
    """The row of a run by column; None if its part is not there."""
    names = [*METRICS, *(MARGIN + limit.key for limit in campaign.requirements)]
    names += ["relative", "order", "ended", "status"]
    names += ["judged_by"] if campaign.specification.screen != "none" else []
    part, place = divmod(number, campaign.specification.shard)
    columns = folder.columns(campaign, names, [part])
    return {name: columns[controller][name][place] for name in names} if columns else None


def replay_document(campaign: Campaign, replayed: ReplayedRun, engine: str) -> dict[str, Any]:
    """One run that was repeated, as a result."""
    outcome, differences = replayed.outcome, replayed.differences
    law = outcome["controller"][0]
    question = f"Run {outcome['id'][0]} of {campaign.specification.name} under {law} again"
    words = "not compared" if differences is None else "as stored, bit by bit"
    verdict = MEASURED if differences is None else NOT_KEPT if differences else KEPT
    if differences:
        words = f"not as stored: {'; '.join(differences)}"
    return result_of(
        campaign,
        "replay",
        answers=[Answer(question=question, verdict=verdict, words=words)],
        engine=engine,
        controller=law,
        judged_by=outcome["judged_by"][0],
        uncertain={name: outcome[name][0] for name in campaign.family.names},
        status=outcome["status"][0],
        ended=outcome["ended"][0],
        metrics={name: outcome[name][0] for name in METRICS},
        margins={limit.words: outcome[MARGIN + limit.key][0] for limit in campaign.limits_of(law)},
        as_stored=None if differences is None else not differences,
        differences=differences or [],
    )
