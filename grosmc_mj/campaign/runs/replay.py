"""One run of a campaign again: recorded, on either engine, and compared bit by bit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.family import LARGEST_SCALE
from grosmc_mj.campaign.family.plant_sample import PlantSample
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.campaign.runs.manifest import read_json
from grosmc_mj.campaign.runs.part import margin_column
from grosmc_mj.campaign.runs.shard import EQUATIONS, Outcomes, laws_with_meters, outcomes, plants_of
from grosmc_mj.errors import ArgumentError, DivergenceError, SetupError
from grosmc_mj.experiments.metrics import METRICS, Metric, compare_with_optimum, measure, settling
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.simulate import Engine, simulate

WORST, RADIUS = "worst.json", "radius.json"
# Plants that are not samples, by what they are called.
FOUND = {"worst": WORST, "shrunk": WORST, "outside": RADIUS}


@dataclass(frozen=True, eq=False)
class ReplayedRun:
    """A run that was repeated.

    Attributes:
        result: The run, recorded, in MuJoCo where there is a model, to be drawn.
        judged: The run that is compared: on the equations if these judged it in the campaign. Its
            metrics are those that the campaign stores, of the law's samples; what a campaign does
            not store, such as costs, is of the recording.
        outcome: What the meters say of that.
        values: The uncertain numbers, by name.
        differences: Of the stored row, a line each; empty if it is the same bit by bit.
        stored: Whether there was a row to compare with.
    """

    result: RunResult
    judged: RunResult
    outcome: Outcomes
    values: Mapping[str, float]
    differences: tuple[str, ...]
    stored: bool


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
    name = list(campaign.laws)[-1] if controller is None else controller
    require_known("controller", name, campaign.laws)
    number = _number(campaign, which)
    if number is None:
        values = found_values(campaign, folder.path, which, name)
    else:
        values = campaign.values(range(number, number + 1))[0]
    plant_sample = campaign.plant_sample(values, number or 0)
    (plant,) = plants_of(campaign, [plant_sample])
    result, outcome = _run(campaign, name, values, plant_sample, plant, which, engine)
    judged = result
    stored = None if number is None else _stored(campaign, folder, number, name)
    if stored is not None and stored.get("judged_by") == EQUATIONS:
        equations = plant.analytic()
        judged, outcome = _run(campaign, name, values, plant_sample, equations, which, engine)
    return ReplayedRun(
        result=result,
        judged=judged,
        outcome=outcome,
        values=dict(zip(campaign.family.names, values.tolist(), strict=True)),
        differences=() if stored is None else _differences(campaign, stored, outcome),
        stored=stored is not None,
    )


def _number(campaign: Campaign, which: str) -> int | None:
    """Number of a run; None for a plant that was searched for."""
    if which in FOUND:
        return None
    runs = campaign.specification.runs
    if not which.isdecimal() or len(which) > 18 or not int(which) < runs:
        raise ArgumentError(f"run {which!r}: there are 0 to {runs - 1}, {', '.join(FOUND)}")
    return int(which)


def found_values(campaign: Campaign, folder: Path, which: str, controller: str) -> Array:
    """The uncertain numbers of a plant that was searched for, (d,).

    Args:
        campaign: The campaign.
        folder: Its folder.
        which: ``worst``, ``shrunk`` or ``outside``.
        controller: For whom it was found.

    Raises:
        SetupError: If there is no such plant, or one that the family cannot have.
    """
    path = folder / FOUND[which]
    how = {WORST: "--worst", RADIUS: "--radius"}[FOUND[which]]
    try:
        found = read_json(path).get("controllers")
    except FileNotFoundError:
        raise SetupError(f"{folder} has no {path.name}: run the campaign with {how}") from None
    for key, absent in ((controller, {}), (which, None)):
        if not isinstance(found, dict):
            raise SetupError(f"{path}: cannot be read: it has no table of {controller}")
        found = found.get(key, absent)
    if found is None:
        raise SetupError(f"{path}: no plant was found that fails under {controller}")
    if not isinstance(found, dict) or set(found) != set(campaign.family.names):
        raise SetupError(
            f"{path}: cannot be read: {which} of {controller} must have the numbers "
            f"{', '.join(campaign.family.names)} and no others"
        )
    # Nothing was searched for farther from the nominal plant than that.
    scale = min(LARGEST_SCALE, campaign.family.largest_scale) if which == "outside" else 1.0
    for quantity in campaign.family.quantities:
        value, ends = found[quantity.name], (quantity.nominal, *quantity.ends(scale))
        slack = 1e-9 * (1 + max(abs(end) for end in ends if math.isfinite(end)))
        least, most = min(ends) - slack, max(ends) + slack
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not (number and least <= value <= most and quantity.physical(value)):
            raise SetupError(
                f"{path}: cannot be read: {which} of {controller}: {quantity.name} = "
                f"{str(value)[:40]} must be a number from {min(ends):g} to {max(ends):g}"
            )
    return np.array([float(found[name]) for name in campaign.family.names])


def _run(
    campaign: Campaign,
    controller: str,
    values: Array,
    plant_sample: PlantSample,
    plant: Plant,
    which: str,
    engine: Engine,
) -> tuple[RunResult, Outcomes]:
    """The run, recorded, on a plant, with the metrics that a campaign stores of it."""
    law = campaign.laws[controller]
    (looped,), meters = laws_with_meters(campaign, law, [plant_sample], [plant])
    settings, ended = campaign.experiment.settings, ""
    try:
        run = simulate(
            plant,
            looped,
            plant_sample.case.x0,
            duration=campaign.duration,
            control_period=campaign.control_period,
            timestep=settings.timestep,
            disturbances=plant_sample.case.disturbances,
            meters=meters[0],
            engine=engine,
        )
    except DivergenceError as error:
        run, ended = error.trajectory, str(error)
    comparison = compare_with_optimum(run, law)
    metrics = measure(run, law, comparison, plant_sample.case.onset)
    case = replace(plant_sample.case, name=which, title=f"{plant_sample.case.title}: run {which}")
    experiment = replace(campaign.experiment, case=case)
    noted = np.atleast_1d(run.meters)
    ends = (noted, run.state[-1:], [run.status], [run.valid_until])
    rows = outcomes(campaign, controller, values[None], [plant_sample], *ends, plant.kind)
    if not ended:
        stored = {name: float(rows.metrics[name][0]) for name in METRICS if name in metrics}
        metrics = {**metrics, **{name: _metric(metrics[name], stored[name]) for name in stored}}
    result = RunResult(experiment, plant.kind, law, run, comparison, metrics, ended, plant)
    return result, rows


def _metric(recorded: Metric, stored: float) -> Metric:
    """A recorded metric with the value that a campaign stores; infinite stands for never."""
    if recorded.note == "no surface":
        return recorded
    return settling(stored) if math.isinf(stored) else Metric(stored, recorded.unit)


def _stored(
    campaign: Campaign, folder: Folder, number: int, controller: str
) -> Mapping[str, Any] | None:
    """The row of a run; None if its part is not there."""
    names = [*METRICS, *(margin_column(each.key) for each in campaign.requirements)]
    names += ["relative", "order", "ended", "status"]
    if campaign.specification.screen != "none":
        names.append("judged_by")
    index = number // campaign.specification.shard
    columns = folder.columns(campaign, names, [index])[controller]
    place = number - campaign.specification.ids(index).start
    there = all(map(len, columns.values()))
    return {name: each[place] for name, each in columns.items()} if there else None


def _differences(campaign: Campaign, stored: Mapping[str, Any], found: Outcomes) -> tuple[str, ...]:
    """What of a stored row a replay has not to the last bit."""
    own: dict[str, Any] = {
        **found.metrics,
        **{margin_column(key): each for key, each in found.margins.items()},
        "relative": found.relative,
        "order": found.order,
        "ended": found.ended,
        "status": found.status,
        "judged_by": found.judged_by,
    }
    return tuple(
        f"{name}: {stored[name]} was stored, {own[name][0]} is found"
        for name in stored
        if np.asarray(stored[name]).tobytes() != np.asarray(own[name][0]).tobytes()
    )
