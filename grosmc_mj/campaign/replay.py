"""One run of a campaign again: recorded, on either engine, and compared bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.document import FOUND, found_values
from grosmc_mj.campaign.folder import Folder, margin_column
from grosmc_mj.campaign.shard import Outcomes, outcomes, plants_of, with_meters
from grosmc_mj.errors import ArgumentError, DivergenceError, unknown_name
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.validation.metrics import compare_with_optimum, measure
from grosmc_mj.validation.runs import PlantName, RunResult


@dataclass(frozen=True, eq=False)
class Replay:
    """A run that was repeated.

    Attributes:
        result: The run, recorded.
        outcome: What its meters say.
        values: The uncertain numbers, by name.
        differences: Of the stored row, a line each; empty if it is the same bit by bit.
        stored: Whether there was a row to compare with.
    """

    result: RunResult
    outcome: Outcomes
    values: Mapping[str, float]
    differences: tuple[str, ...]
    stored: bool


def replay(
    campaign: Campaign, folder: Folder, which: str, controller: str | None, engine: Engine
) -> Replay:
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
    if name not in campaign.laws:
        raise ArgumentError(unknown_name("controller", name, campaign.laws))
    number = _number(campaign, which)
    if number is None:
        values = found_values(campaign, folder.path, which, name)
    else:
        values = campaign.values(range(number, number + 1))[0]
    run, result, outcome = _run(campaign, name, values, which, engine)
    stored = None if number is None else _stored(campaign, folder, number, name)
    del run
    return Replay(
        result=result,
        outcome=outcome,
        values=dict(zip(campaign.family.names, values.tolist(), strict=True)),
        differences=() if stored is None else _differences(campaign, stored, outcome),
        stored=stored is not None,
    )
