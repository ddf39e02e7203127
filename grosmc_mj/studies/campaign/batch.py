"""Plants of a campaign that are run under each controller as one batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.sweep.runs import Outcomes, Row, plant_of, run_rows
from grosmc_mj.theory.plants import AnalyticPlant, Plant


@dataclass(frozen=True, eq=False)
class Batch:
    """Plants that each controller meets; compiled once for all of them.

    Attributes:
        campaign: The campaign.
        values: The uncertain numbers, (n, d).
        ids: Numbers of the runs, (n,), for what their loops draw; 0 for plants that are no runs.
        threads: Number of threads; 0 for all cores.
    """

    campaign: Campaign
    values: Array
    ids: Sequence[int]
    threads: int = 0

    # All controllers meet the same samples and plants, and a plant compiles its model.
    @cached_property
    def samples(self) -> list[Experiment]:
        """The case with each of the values, n of them."""
        return [self.campaign.plant_sample(values) for values in self.values]

    # Compiled models are shared by all laws of a part.
    @cached_property
    def physics(self) -> list[Plant]:
        """The plants; those with the same edits are one."""
        plants: dict[Any, Plant] = {}
        plant_of_sample: list[Plant] = []
        for sample in self.samples:
            key = sample.edits, sample.nominal.scales
            if key not in plants:
                plants[key] = plant_of(sample, self.campaign.plant)
            plant_of_sample.append(plants[key])
        return plant_of_sample

    @cached_property
    def equations(self) -> list[AnalyticPlant]:
        """The equations with the numbers of the plants' models; none if they lack something."""
        try:
            equations = {plant: plant.analytic() for plant in dict.fromkeys(self.physics)}
        except ModelError:
            return []
        return [equations[plant] for plant in self.physics]

    def row(self, controller: str, index: int, plant: Plant) -> Row:
        """Return a row of the design, on its plant or its equations."""
        return Row(
            self.campaign.laws[controller],
            case=self.samples[index],
            number=self.ids[index],
            plant=plant,
            predict=self.campaign.experiment.predicts(controller),
        )

    def run(
        self,
        controller: str,
        rows: NDArray[np.intp] | None = None,
        plants: Sequence[Plant] | None = None,
    ) -> Outcomes:
        """Run the plants under a controller.

        Args:
            controller: Its name.
            rows: Indices of the plants that are run; all by default.
            plants: Plants of all rows, such as their equations; those in MuJoCo by default, where
                there is a model.
        """
        plants = plants or self.physics
        numbers = list(range(len(self.values)))
        if rows is not None:
            numbers = rows.tolist()

        design = [self.row(controller, index, plants[index]) for index in numbers]
        return run_rows(
            self.campaign.experiment,
            design,
            self.campaign.requirements,
            unfailing=self.campaign.unfailing,
            threads=self.threads,
        )


def evaluate(
    campaign: Campaign, controller: str, values: Array, ids: Sequence[int] = ()
) -> Outcomes:
    """Run plants (n, d), in MuJoCo where there is a model.

    Args:
        campaign: The campaign.
        controller: Name of the controller.
        values: The uncertain numbers, (n, d).
        ids: Numbers of the runs, (n,), for what their loops draw; 0 by default.
    """
    return Batch(campaign, values, ids or [0] * len(values)).run(controller)
