"""Runs of a campaign's plants under one controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.parameters import Varied
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows

# What a run is judged by.
EQUATIONS, PHYSICS = "equations", "physics"


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
        """The equations with the numbers of the plants' models.

        Raises:
            ModelError: If a plant has what its equations have no term for.
        """
        equations = {plant: plant.analytic() for plant in dict.fromkeys(self.physics)}
        return [equations[plant] for plant in self.physics]

    def run(self, controller: str, rows: NDArray[np.intp] | None = None) -> Outcomes:
        """Run the plants, or some of them, in MuJoCo where there is a model."""
        return self._run(controller, self.physics, rows)

    def run_equations(self, controller: str) -> Outcomes:
        """Run the plants on their equations."""
        return self._run(controller, self.equations)

    def row(self, controller: str, index: int, plant: Plant) -> Row:
        """A row of the design, on its plant or its equations."""
        law, case = self.campaign.laws[controller], self.samples[index].case
        return Row(law, case=case, number=self.ids[index], plant=plant)

    def _run(
        self, controller: str, plants: Sequence[Plant], rows: NDArray[np.intp] | None = None
    ) -> Outcomes:
        campaign = self.campaign
        numbers = range(len(self.values)) if rows is None else rows.tolist()
        design = [self.row(controller, index, plants[index]) for index in numbers]
        limits = campaign.requirements
        runs = run_rows(campaign.experiment, design, limits, threads=self.threads)
        return self.completed(runs, controller, list(numbers), plants[0])

    def completed(
        self, runs: Outcomes, controller: str, rows: Sequence[int], plant: Plant
    ) -> Outcomes:
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
