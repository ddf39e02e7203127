"""A campaign, ready to run: its specification, its family, its laws and their requirements."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from grosmc_mj.experiments.assumptions.notes import never_acts, notes_on_plant
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.conditions import end_of_transient
from grosmc_mj.experiments.requirements.judging import (
    decidable,
    of_laws,
    unfailing_line,
    windows_of,
)
from grosmc_mj.experiments.requirements.measurement import Measurement
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import MISTAKE_SEPARATOR, ArgumentError, GrosmcError, Mistakes
from grosmc_mj.ground.wording import counted, plural, unit_after
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.simulation.loop.loop import RANDOM
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.studies.campaign.specification import Specification, specification_of
from grosmc_mj.studies.sweep.family import Family, corner_points, family_of, inside, random_points
from grosmc_mj.studies.sweep.quantities import Quantity, with_values
from grosmc_mj.studies.sweep.runs import plant_of
from grosmc_mj.studies.sweep.search import largest_passing
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant

# How far a family is scaled at most, by searches...
LARGEST_SCALE = 8.0
# ...and to which part of itself a smaller bound is known.
_FINE = 1e-3
# Owners of uncertain numbers that can make a machine impossible; a start can lie beyond a stop.
_OF_MACHINES = ("edit", "run", *MACHINE_PARTS)
_OF_LOOPS = tuple(LOOP_PARTS)


@dataclass(frozen=True, eq=False)
class Campaign:
    """Specification with its laws designed and its family read.

    Attributes:
        specification: Its plain values.
        experiment: The case file, with its laws designed.
        family: The uncertain numbers.
        laws: The controllers, by name.
        requirements: Requirements that runs can decide.
        not_judged: A line on each other requirement, and why runs cannot decide it.
    """

    specification: Specification
    experiment: Experiment
    family: Family
    laws: Mapping[str, Controller]
    requirements: tuple[Requirement, ...]
    not_judged: tuple[str, ...] = ()

    @classmethod
    def load(cls, target: str, **options: Any) -> Campaign:
        """Load the campaign of a system of the package, one of its cases, or a case file.

        Args:
            target: ``arm``, ``arm/case1`` or the path of a case file.
            options: Other attributes of ``Specification``, such as ``runs=1024`` or ``seed=1``.

        Raises:
            ArgumentError: If there is no such file, or the file or a number is wrong.
        """
        return cls.of(specification_of(target, **options))

    @classmethod
    def of(cls, specification: Specification) -> Campaign:
        """Design and check a campaign.

        Raises:
            ArgumentError: If the file or the specification is wrong, in one line.
        """
        try:
            experiment = Experiment.of_file(specification.file, specification.path)
            campaign = cls._designed(specification, experiment)
            campaign._refuse_impossible()
        except GrosmcError as error:
            raise ArgumentError(f"{specification.path}: {error}") from error
        return campaign

    @classmethod
    def _designed(cls, specification: Specification, experiment: Experiment) -> Campaign:
        """The campaign of an experiment, with its laws designed and its family read."""
        case = experiment
        mistakes = Mistakes()
        with mistakes.gathered():
            experiment = experiment.changed(laws=specification.controllers)
        kind: PlantName = "physics" if "physics" in experiment.plant_names else "corrected"
        with mistakes.gathered():
            experiment.checked()
        with mistakes.gathered():
            family = family_of(experiment.file, case)
            _refuse_missing_corners(specification, family)
        mistakes.refuse()

        laws = {name: experiment.laws[kind, name] for name in experiment.controllers}
        onsets = [_onset(disturbance, family) for disturbance in case.disturbances]
        transient = min(end_of_transient(onsets), case.duration)
        judged, notes = decidable(experiment.required, transient)
        return cls(specification, experiment, family, laws, of_laws(judged, laws), tuple(notes))

    def _refuse_impossible(self) -> None:
        """Refuse what cannot be run or measured on the nominal plant, or at the ranges' ends."""
        nominal = self.plant_sample(self.family.nominal)
        plant_of(nominal, self.plant)
        for requirement in self.requirements:
            requirement.refuse_start(self.laws[requirement.laws[0]], nominal.x0)
        self._refuse_extremes(_OF_MACHINES, self._compile_machine)
        self._refuse_extremes(_OF_LOOPS, self._make_loops)
        for law in self.laws.values():
            self._refuse_unmeasured(law)

    def _refuse_extremes(self, owners: Collection[str], make: Callable[[Array], None]) -> None:
        """Refuse ranges at whose ends there is no machine or no loop.

        Args:
            owners: Owners of the numbers that are at their ends.
            make: Makes machine or loop with values (d,) of all numbers.
        """
        for values in _extremes(self.family, owners):
            try:
                make(values)
            except GrosmcError as error:
                pairs = zip(self.family.quantities, values.tolist(), strict=True)
                words = [number.words(value) for number, value in pairs if number.owner in owners]
                raise ArgumentError(
                    f"uncertain: {' and '.join(words)} can occur, where there is no such "
                    f"machine or loop: {str(error).split(MISTAKE_SEPARATOR)[-1]}; narrow the "
                    "ranges or, where delays must be equal, let computing.delay vary "
                    "instead"
                ) from error

    def _compile_machine(self, values: Array) -> None:
        """Make a case with values (d,), and compile its machine, if it has parts as built."""
        case = self.plant_sample(values)
        if isinstance(self.plant, MujocoPlant) and self.plant.parts:
            plant: Any = plant_of(case, self.plant)
            _ = plant.undrawn_model

    def _make_loops(self, values: Array) -> None:
        """Make a case with values (d,), and put every law into its loop, if it has one."""
        case = self.plant_sample(values)
        if case.loop is None:
            return
        for name, law in self.laws.items():
            predict = self.experiment.predicts(name)
            self.experiment.loop_around(law, case.loop, predict=predict)

    def _refuse_unmeasured(self, law: Controller) -> None:
        """Refuse a law that cannot be run or measured, and an error after the end of its run."""
        settings = self.experiment.settings
        _ = Measurement(law, settings.timestep, self.duration).accumulator
        problem, _ = prepare(
            self.plant,
            law,
            self.experiment.x0,
            duration=self.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=self.experiment.disturbances,
            record=False,
        )
        last = (problem.steps - 1) * problem.timestep
        for after in windows_of(self.requirements).after:
            # Rounding must not refuse an error that is measured from the last timestep on.
            if after * (1 - 1e-12) > last:
                raise ArgumentError(
                    f"an error after {after:g} s: the last timestep of a run begins at {last:g} s"
                )

    @property
    def judged(self) -> list[str]:
        """The laws that something is required of."""
        names: set[str] = set()
        for requirement in self.requirements:
            names.update(requirement.laws)
        return [law for law in self.laws if law in names]

    # Every run asks for it.
    @cached_property
    def plant(self) -> Plant:
        """The plant with the file's edits."""
        plants = self.experiment.plants
        return plants.get("physics") or plants["corrected"]

    # Every law's radius asks for it, and it compiles many models.
    @cached_property
    def largest_scale(self) -> float:
        """The largest scale of the uncertainty at which every plant can be built."""
        most = min(LARGEST_SCALE, self.family.largest_scale * (1 - 1e-9))
        largest, _ = largest_passing(self._can_be, min(1.0, most), most, most, _FINE)
        return largest

    def _can_be(self, scale: float) -> bool:
        """Whether there are machines at the ends of the ranges, scaled."""
        try:
            for values in _extremes(self.family, _OF_MACHINES):
                self._compile_machine(self.family.scaled(values, scale))
        except GrosmcError:
            return False
        return True

    @property
    def target(self) -> str:
        """SYSTEM/NAME."""
        return f"{self.experiment.system}/{self.specification.name}"

    @property
    def random(self) -> bool:
        """Whether runs draw random numbers: noise, jitter or missed samples of their loop."""
        loop = self.experiment.loop
        if loop is not None and loop.random:
            return True
        numbers = [quantity.number for quantity in self.family.quantities]
        return any(number.of_loop and number.place.field in RANDOM for number in numbers)

    @property
    def duration(self) -> float:
        """Duration of each run [s]."""
        return self.experiment.duration

    @property
    def idle(self) -> list[str]:
        """Label, or body or signal, of each disturbance that begins after the end of every run."""
        return [
            disturbance.label or disturbance.of
            for disturbance in self.experiment.disturbances
            if _onset(disturbance, self.family)[0] >= self.duration
        ]

    # Every batch of runs asks for it.
    @cached_property
    def unfailing(self) -> dict[str, str]:
        """Names of the requirements that no run can fail, each with a line on the reason."""
        lines: dict[str, str] = {}
        for requirement in self.requirements:
            reasons = [
                requirement.why_unfailing(self.laws[law], self._input_limits)
                for law in requirement.laws
            ]
            for line in unfailing_line(requirement, reasons):
                lines[requirement.name] = line
        return lines

    @property
    def notes(self) -> list[str]:
        """Notes beside the pass rates, a line each."""
        lines = list(self.not_judged)
        lines += [f"{never_acts(name, self.duration)}." for name in self.idle]
        lines += self.unfailing.values()
        lines += [
            f"{quantity.name}: its nominal value {quantity.nominal:.4g}{unit_after(quantity.unit)} "
            "lies outside of its declared values; --worst and --radius begin there."
            for quantity in self.family.quantities
            if not quantity.distribution.contains(quantity.nominal)
        ]
        lines += notes_on_plant(self.experiment, self.plant)
        return list(dict.fromkeys(lines))

    @property
    def _input_limits(self) -> Array:
        """Least and largest of each input, (2, m); infinite where a limit is uncertain."""
        limits = self.experiment.input_limits(self.plant)
        if any(number.owner in ("actuator", "motor") for number in self.family.quantities):
            limits[:] = [[-np.inf], [np.inf]]
        return limits

    def points(
        self,
        sampler: str,
        first: int,
        count: int,
        more: int = 0,
    ) -> Array:
        """Return points of the unit cube, (count, d).

        Args:
            sampler: ``random`` or ``corners``.
            first: Number of the first point.
            count: Number of points.
            more: Added to the campaign's seed, for points that are none of its runs.
        """
        dimensions = len(self.family.quantities)
        if sampler == "corners":
            return corner_points(dimensions, first, count)
        return random_points(dimensions, self.specification.seed + more, first, count)

    def values(self, ids: range) -> Array:
        """Return the uncertain numbers of runs, (n, d)."""
        points = self.points(self.specification.sampler, ids.start, len(ids))
        return self.family.values(points)

    def as_run(self, quantity: Quantity, values: Array) -> Array:
        """Return the values that runs have of drawn values of an uncertain number, both (n,)."""
        timestep = self.experiment.settings.timestep
        control_period = self.experiment.settings.control_period
        return np.array(
            [quantity.number.as_run(value, timestep, control_period) for value in values.tolist()]
        )

    def pairs_as_run(self, values: Array) -> list[tuple[Quantity, float, float]]:
        """Return the uncertain numbers with their values in a plant (d,) and nominal, as run."""
        pairs: list[tuple[Quantity, float, float]] = []
        for quantity, value in zip(self.family.quantities, values, strict=True):
            drawn = np.array([value, quantity.nominal])
            as_run, nominal = self.as_run(quantity, drawn).tolist()
            pairs.append((quantity, as_run, nominal))
        return pairs

    def words(self, values: Array) -> str:
        """Return the uncertain numbers of a plant (d,) that are not nominal, as they are run."""
        pairs = self.pairs_as_run(values)
        changed = [quantity.words(value) for quantity, value, nominal in pairs if value != nominal]
        return ", ".join(changed) or "the nominal one"

    def named(self, values: Array | None) -> dict[str, float] | None:
        """Return the uncertain numbers of a plant (d,) by name; None for no plant."""
        if values is None:
            return None
        return dict(zip(self.family.names, values.tolist(), strict=True))

    def plant_sample(self, values: Sequence[float] | Array) -> Experiment:
        """Return the case, with its plant, that these values make."""
        row = np.asarray(values, float).tolist()
        return with_values(self.experiment, zip(self.family.quantities, row, strict=True))


def _refuse_missing_corners(specification: Specification, family: Family) -> None:
    """Refuse more runs than the ranges have corners, if these are run."""
    corners = family.corner_count
    if specification.sampler == "corners" and specification.runs > corners:
        raise ArgumentError(
            f"corners: {counted(specification.runs, 'run')}, but there "
            f"{plural(corners, 'is', 'are')} {counted(corners, 'corner')}: each "
            "number needs two ends, and none may be correlated"
        )


def _onset(disturbance: AnyDisturbance, family: Family) -> tuple[float, float]:
    """Earliest and latest begin of a disturbance [s]."""
    for quantity in family.quantities:
        if quantity.number.is_of("disturbance", disturbance.label, "onset"):
            return quantity.distribution.support
    begin = disturbance.window[0]
    return begin, begin


def _extremes(family: Family, owners: Collection[str]) -> Iterator[Array]:
    """Values (d,) with all numbers of some owners at their ends.

    First all are at the same end, then each of them is at the other one.
    """
    ends = {
        index: _ends(number)
        for index, number in enumerate(family.quantities)
        if number.owner in owners
    }
    if not ends:
        return

    alone: list[int | None] = [None]
    if len(ends) > 1:
        alone.extend(ends)
    for opposite in alone:
        for side in (0, 1):
            values = family.nominal
            for index, pair in ends.items():
                values[index] = pair[1 - side] if index == opposite else pair[side]
            yield values


def _ends(quantity: Quantity) -> tuple[float, float]:
    """The smallest and the largest value that can be drawn."""
    low, high = quantity.distribution.support
    shares = inside(np.array([0.0, 1.0]))
    least, most = quantity.distribution.quantiles(shares).tolist()
    if not math.isfinite(low):
        low = least
    if not math.isfinite(high):
        high = most
    return low, high
