"""A campaign, ready to run: its family, its controllers and what they must keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.extremes import (
    largest_machine,
    refuse_impossible_loops,
    refuse_impossible_machines,
)
from grosmc_mj.campaign.family.family import LARGEST_SCALE, Family, Quantity, family_of
from grosmc_mj.campaign.family.plant_sample import PlantSample, plant_sample_of
from grosmc_mj.campaign.family.sampling import unit_points
from grosmc_mj.campaign.family.specification import Specification, specification_of
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError, Mistakes, unknown_name
from grosmc_mj.experiments.experiment import Experiment, undesigned
from grosmc_mj.experiments.metrics import NO_WINDOWS, meters_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import (
    Limit,
    judgeable,
    require_initial_error,
    required,
    transient,
    windows,
)
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.prepare import prepare


@dataclass(frozen=True, eq=False)
class Campaign:
    """What a specification asks for.

    Attributes:
        specification: What is asked for.
        experiment: The case file, with its laws designed.
        family: The uncertain numbers.
        laws: The controllers, by name.
        requirements: What they must keep, as far as runs tell.
        not_judged: Which requirements they do not tell about, and why.
    """

    specification: Specification
    experiment: Experiment
    family: Family
    laws: Mapping[str, Controller]
    requirements: tuple[Limit, ...]
    not_judged: tuple[str, ...] = ()

    @classmethod
    def load(cls, target: str, **asked: Any) -> Campaign:
        """The campaign of a system of the package, one of its cases, or a case file.

        Args:
            target: ``arm``, ``arm/case1`` or the path of a case file.
            asked: What else a ``Specification`` has, such as ``runs=1024`` or ``seed=1``.

        Raises:
            ArgumentError: If there is no such thing, or the file or a number is wrong.
        """
        return cls.of(specification_of(target, **asked))

    @classmethod
    def of(cls, specification: Specification) -> Campaign:
        """Design and check what is asked for.

        Raises:
            ArgumentError: If the file or the specification is wrong, in one line.
        """
        try:
            return cls._checked(specification, undesigned(specification.file, specification.path))
        except GrosmcError as error:
            raise ArgumentError(f"{specification.path}: {error}") from error

    @classmethod
    def _checked(cls, specification: Specification, experiment: Experiment) -> Campaign:
        """The campaign of an experiment."""
        mistakes, case = Mistakes(), experiment.case
        wanted = specification.controllers or tuple(experiment.controllers)
        for each in wanted:
            if each not in experiment.controllers:
                mistakes.note(unknown_name("controller", each, experiment.controllers))
        name: PlantName = "physics" if "physics" in experiment.plant_names else "corrected"
        with mistakes.gathered():
            experiment.checked()
        with mistakes.gathered():
            family = family_of(experiment.file, case, experiment.plant(name))
            if specification.sampler == "corners":
                _refuse_corners(specification, family)
        mistakes.refuse()
        own = (each for each in experiment.controllers if each in wanted)
        laws = {each: experiment.laws[name, each] for each in own}
        onsets = [_onset(each, family) for each in case.disturbances]
        limits, notes = judgeable(experiment.required, transient(case.duration, onsets))
        requirements = required(limits, laws)
        found = cls(specification, experiment, family, laws, requirements, tuple(notes))
        nominal = found.plant_sample(family.nominal)
        nominal.plant(found.plant)
        for limit in requirements:
            if limit.of_initial_error:
                require_initial_error(limit.kind, laws[limit.of[0]], nominal.case.x0)
        refuse_impossible_machines(family, lambda row: found.plant_sample(row).plant(found.plant))
        refuse_impossible_loops(family, laws, lambda row: found.plant_sample(row).case.loop)
        for law in laws.values():
            found._refuse_unmeasurable(law)
        return found

    def _refuse_unmeasurable(self, law: Controller) -> None:
        """Refuse a run that cannot begin, or errors that are asked for after its last timestep."""
        meters_of(law, self.experiment.settings.timestep, NO_WINDOWS, 0.0)
        problem, _ = prepare(
            self.plant,
            law,
            self.experiment.case.x0,
            duration=self.duration,
            control_period=self.control_period,
            timestep=self.experiment.settings.timestep,
            disturbances=self.experiment.case.disturbances,
            record=False,
        )
        last = (problem.steps - 1) * problem.timestep
        for after in windows(self.requirements).after:
            if after * (1 - 1e-12) > last:
                raise ArgumentError(
                    f"an error after {after:g} s: the last timestep of a run begins at {last:g} s"
                )

    @property
    def judged(self) -> list[str]:
        """The laws that something is required of."""
        return [law for law in self.laws if any(law in each.of for each in self.requirements)]

    @cached_property
    def plant(self) -> Plant:
        """The plant with the file's edits."""
        plants = self.experiment.plants
        return plants.get("physics") or plants["corrected"]

    @cached_property
    def largest_scale(self) -> float:
        """How far searches and promises scale the uncertainty: to what can be, and no farther."""
        most = min(LARGEST_SCALE, self.family.largest_scale * (1 - 1e-9))
        return largest_machine(
            self.family, lambda row: self.plant_sample(row).plant(self.plant), most
        )

    @property
    def control_period(self) -> float:
        """Time between two samples of the laws [s]."""
        return self.experiment.settings.control_period

    @property
    def duration(self) -> float:
        """Of each run [s]."""
        return self.experiment.case.duration

    @property
    def idle(self) -> list[str]:
        """Of each disturbance that begins after the end of every run: its label or body."""
        disturbances = self.experiment.case.disturbances
        return [
            each.label or each.body
            for each in disturbances
            if _onset(each, self.family)[0] >= self.duration
        ]

    def values(self, ids: range) -> Array:
        """The uncertain numbers of runs, (n, d)."""
        specification, dimensions = self.specification, len(self.family.quantities)
        points = unit_points(
            specification.sampler, dimensions, specification.seed, ids.start, len(ids)
        )
        return self.family.values(points)

    def as_run(self, quantity: Quantity, values: Array) -> Array:
        """What drawn values of an uncertain number (n,) are run as, (n,)."""
        settings = self.experiment.settings
        return np.array(
            [
                quantity.as_run(each, settings.timestep, settings.control_period)
                for each in values.tolist()
            ]
        )

    def plant_sample(self, values: Sequence[float] | Array, run: int = 0) -> PlantSample:
        """The plant, disturbances, start and loop that these values make, in a run."""
        row, settings = np.asarray(values, float).tolist(), self.experiment.settings
        return plant_sample_of(
            self.experiment.case,
            self.family.quantities,
            row,
            settings.timestep,
            settings.control_period,
            run,
        )


def _onset(disturbance: Disturbance, family: Family) -> tuple[float, float]:
    """When a disturbance begins at the earliest and at the latest [s]."""
    for each in family.quantities:
        if (each.of, each.quantity) == (disturbance.label, "onset"):
            return each.distribution.support
    return disturbance.window[0], disturbance.window[0]


def _refuse_corners(specification: Specification, family: Family) -> None:
    """Refuse corners that are not there."""
    if not family.bounded:
        raise ArgumentError("corners: a distribution has no end: give it least and most")
    if not family.independent:
        raise ArgumentError("corners: correlated numbers have none: take another sampler")
    corners = 2 ** len(family.quantities)
    if specification.runs > corners:
        raise ArgumentError(f"--runs {specification.runs}: there are {corners} corners")
