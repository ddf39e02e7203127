"""A campaign, ready to run: its specification, its family, its laws and their requirements."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import NEXT, ArgumentError, GrosmcError, Mistakes, unknown_name
from grosmc_mj.experiments.experiment import Experiment, undesigned
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS
from grosmc_mj.experiments.file.reading import parse_case_file, resolved_text
from grosmc_mj.experiments.file.schema import CaseFile, file_name
from grosmc_mj.experiments.file.shipped import campaign_files, find_file, shipped_files
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
from grosmc_mj.fields import Range, checked
from grosmc_mj.loop import relooped
from grosmc_mj.physics.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.sweep.family import Family, Quantity, corner_points, family_of, inside, random_points
from grosmc_mj.sweep.parameters import Varied, varied
from grosmc_mj.sweep.search import largest_passing

# Plants of one part: enough to fill all cores, few enough to lose little and to fit in memory.
SHARD = 512
_MOST_PARTS = 10**7
# Of one run [s]: eleven days.
_Time = Annotated[float, Range(0, 1e6, unit="s", above=True)] | None


@checked()
class Specification:
    """A family of plants and how much of it is run.

    Attributes:
        name: Of the campaign.
        text: The case file, with all that it extends.
        folder: Where it lies, and what it names.
        runs: Plants; each meets every controller.
        seed: Of the sampler.
        sampler: ``random``, which alone gives intervals, or ``corners``.
        controllers: Names of those to run; empty for all of the file.
        control_period: Instead of the file's [s].
        duration: Instead of the file's [s].
        integrator: Instead of the file's: ``implicitfast`` is several times as fast as ``RK4``.
        shard: Plants of one part.
        screen: ``auto``, ``equations`` or ``none``: whether runs are made on the equations, and in
            MuJoCo only those that need it.
    """

    name: str
    text: str
    folder: str
    runs: Annotated[int, Range(1, 10**12, whole=True)] = 1024
    seed: Annotated[int, Range(0, 2**63, whole=True, below=True)] = 0
    sampler: Literal["random", "corners"] = "random"
    controllers: tuple[str, ...] = ()
    control_period: _Time = None
    duration: _Time = None
    integrator: Integrator | None = None
    shard: Annotated[int, Range(1, 10**6, whole=True)] = SHARD
    screen: Literal["auto", "equations", "none"] = "auto"

    def __post_init__(self) -> None:
        if self.shards > _MOST_PARTS:
            raise ArgumentError(
                f"{self.runs} runs in parts of {self.shard} are {self.shards} parts: at most "
                f"{_MOST_PARTS} are kept; take a larger shard"
            )
        try:
            file_name(self.name)
        except ValueError as error:
            raise ArgumentError(f"name: {error}") from None

    @property
    def path(self) -> Path:
        """Where the file lay."""
        return Path(self.folder) / f"{self.name}.toml"

    @property
    def file(self) -> CaseFile:
        """The case file with the specification's own numbers."""
        file = parse_case_file(self.text, self.path)
        options = ("control_period", "duration", "integrator")
        own = {name: value for name in options if (value := getattr(self, name)) is not None}
        # Campaigns run in MuJoCo, where there is a model: no laws are designed for other plants.
        modelled = file.plant.system is not None or file.plant.model is not None
        compared = {"compare": ["physics"]} if modelled else {}
        return file.model_copy(
            update={
                "run": file.run.model_copy(update=own),
                "plant": file.plant.model_copy(update=compared),
            }
        )

    @property
    def shards(self) -> int:
        """Number of parts."""
        return -(-self.runs // self.shard)

    def ids(self, index: int) -> range:
        """Numbers of the runs in one part."""
        return range(index * self.shard, min((index + 1) * self.shard, self.runs))

    def document(self) -> dict[str, Any]:
        """As plain values."""
        return {**asdict(self), "controllers": list(self.controllers)}

    @classmethod
    def of_document(cls, content: dict[str, Any]) -> Specification:
        """From plain values.

        Raises:
            ArgumentError: If they are not those of a specification.
        """
        return cls(**{**content, "controllers": tuple(content.get("controllers", ()))})


def specification_of(target: str, **options: Any) -> Specification:
    """The specification of a campaign on a system of the package or a file.

    Args:
        target: Name of a system, of a case of the package, or path of a case file.
        options: What else ``Specification`` has; None for its default.

    Raises:
        ArgumentError: If there is no such thing, or a number does not fit.
    """
    path = _path_of(target)
    text = resolved_text(path)
    options = {name: value for name, value in options.items() if value is not None}
    folder, name = str(path.parent.resolve()), parse_case_file(text, path).name
    return Specification(name=name, text=text, folder=folder, **options)


def _path_of(target: str) -> Path:
    known = {**shipped_files(), **campaign_files()}
    if target in known:
        return known[target]
    if Path(target).exists() or Path(target).suffix == ".toml":
        return find_file(target)
    valid = [*campaign_files(), "or a path that ends in .toml"]
    raise ArgumentError(unknown_name("system", target, valid))


# How far a family is scaled at most, by searches and promises, and to which share that is known.
LARGEST_SCALE, _FINE = 8.0, 1e-3
# Uncertain numbers that can make a machine impossible; a start can lie beyond a stop.
_OF_MACHINES = ("body", "joint", "start", *MACHINE_PARTS)


@dataclass(frozen=True, eq=False)
class Campaign:
    """A specification with its laws designed and its family read.

    Attributes:
        specification: As plain values.
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
    def load(cls, target: str, **options: Any) -> Campaign:
        """The campaign of a system of the package, one of its cases, or a case file.

        Args:
            target: ``arm``, ``arm/case1`` or the path of a case file.
            options: What else a ``Specification`` has, such as ``runs=1024`` or ``seed=1``.

        Raises:
            ArgumentError: If there is no such thing, or the file or a number is wrong.
        """
        return cls.of(specification_of(target, **options))

    @classmethod
    def of(cls, specification: Specification) -> Campaign:
        """Design and check a campaign.

        Raises:
            ArgumentError: If the file or the specification is wrong, in one line.
        """
        try:
            experiment = undesigned(specification.file, specification.path)
            campaign = cls._designed(specification, experiment)
            campaign._refuse_impossible()
        except GrosmcError as error:
            raise ArgumentError(f"{specification.path}: {error}") from error
        return campaign

    @classmethod
    def _designed(cls, specification: Specification, experiment: Experiment) -> Campaign:
        mistakes, case = Mistakes(), experiment.case
        with mistakes.gathered():
            experiment = experiment.with_laws(specification.controllers)
        plant: PlantName = "physics" if "physics" in experiment.plant_names else "corrected"
        with mistakes.gathered():
            experiment.checked()
        with mistakes.gathered():
            family = family_of(experiment.file, case, experiment.plant(plant))
            corners = family.corner_count
            if specification.sampler == "corners" and specification.runs > corners:
                raise ArgumentError(
                    f"corners: {specification.runs} runs, but there are {corners} corners: each "
                    "number needs two ends, and none may be correlated"
                )
        mistakes.refuse()
        laws = {name: experiment.laws[plant, name] for name in experiment.controllers}
        onsets = [_onset(disturbance, family) for disturbance in case.disturbances]
        limits, notes = judgeable(experiment.required, transient(case.duration, onsets))
        return cls(specification, experiment, family, laws, required(limits, laws), tuple(notes))

    def _refuse_impossible(self) -> None:
        """Refuse what cannot be run or measured on the nominal plant, or at the ranges' ends."""
        nominal, settings = self.plant_sample(self.family.nominal), self.experiment.settings
        nominal.plant(self.plant)
        for limit in self.requirements:
            if limit.of_initial_error:
                require_initial_error(limit.kind, self.laws[limit.of[0]], nominal.case.x0)
        for owners in (_OF_MACHINES, LOOP_PARTS):
            for values in _extremes(self.family, owners):
                try:
                    self._build(values, owners)
                except GrosmcError as error:
                    pairs = zip(self.family.quantities, values.tolist(), strict=True)
                    words = [of.words(value) for of, value in pairs if of.owner in owners]
                    raise ArgumentError(
                        f"uncertain: {' and '.join(words)} can occur, where there is no such "
                        f"machine or loop: {str(error).split(NEXT)[-1]}; narrow the ranges or, "
                        "where delays must be equal, let that of computing = true vary instead"
                    ) from error
        for law in self.laws.values():
            meters_of(law, settings.timestep, NO_WINDOWS, 0.0)
            problem, _ = prepare(
                self.plant,
                law,
                self.experiment.case.x0,
                duration=self.duration,
                control_period=settings.control_period,
                timestep=settings.timestep,
                disturbances=self.experiment.case.disturbances,
                record=False,
            )
            last = (problem.steps - 1) * problem.timestep
            for after in windows(self.requirements).after:
                if after * (1 - 1e-12) > last:
                    raise ArgumentError(
                        f"an error after {after:g} s: the last timestep of a run begins at "
                        f"{last:g} s"
                    )

    def _build(self, values: Array, owners: Collection[str]) -> None:
        """Compile a machine and put every law into its loop: shows whether there is such a run."""
        sample = self.plant_sample(values)
        if owners is LOOP_PARTS and sample.case.loop is not None:
            for law in self.laws.values():
                relooped(law, sample.case.loop)
        if owners is _OF_MACHINES and isinstance(self.plant, MujocoPlant) and self.plant.parts:
            plant: Any = sample.plant(self.plant)
            _ = plant.undrawn_model

    @property
    def judged(self) -> list[str]:
        """The laws that something is required of."""
        return [law for law in self.laws if any(law in limit.of for limit in self.requirements)]

    @cached_property
    def plant(self) -> Plant:
        """The plant with the file's edits."""
        plants = self.experiment.plants
        return plants.get("physics") or plants["corrected"]

    @cached_property
    def largest_scale(self) -> float:
        """How far searches and promises scale the uncertainty: to what can be, and no farther."""
        most = min(LARGEST_SCALE, self.family.largest_scale * (1 - 1e-9))

        def can_be(scale: float) -> bool:
            try:
                for values in _extremes(self.family, _OF_MACHINES):
                    self._build(self.family.scaled(values, scale), _OF_MACHINES)
            except GrosmcError:
                return False
            return True

        return largest_passing(can_be, min(1.0, most), most, most, _FINE)[0]

    @property
    def duration(self) -> float:
        """Of each run [s]."""
        return self.experiment.case.duration

    @property
    def idle(self) -> list[str]:
        """Of each disturbance that begins after the end of every run: its label or body."""
        return [
            disturbance.label or disturbance.body
            for disturbance in self.experiment.case.disturbances
            if _onset(disturbance, self.family)[0] >= self.duration
        ]

    def points(self, sampler: str, first: int, count: int, more: int = 0) -> Array:
        """Points of the unit cube (count, d), of the campaign's seed and so many more."""
        dimensions = len(self.family.quantities)
        if sampler == "corners":
            return corner_points(dimensions, first, count)
        return random_points(dimensions, self.specification.seed + more, first, count)

    def values(self, ids: range) -> Array:
        """The uncertain numbers of runs, (n, d)."""
        points = self.points(self.specification.sampler, ids.start, len(ids))
        return self.family.values(points)

    def as_run(self, quantity: Quantity, values: Array) -> Array:
        """What drawn values of an uncertain number (n,) are run as, (n,)."""
        settings = self.experiment.settings
        periods = (settings.timestep, settings.control_period)
        return np.array([quantity.as_run(value, *periods) for value in values.tolist()])

    def pairs_as_run(self, values: Array) -> list[tuple[Quantity, float, float]]:
        """The uncertain numbers with their values in a plant (d,) and nominal ones, as run."""
        nominal, quantities = self.family.nominal, self.family.quantities
        pairs = zip(quantities, values, nominal, strict=True)
        return [(of, *self.as_run(of, np.array(pair)).tolist()) for of, *pair in pairs]

    def words(self, values: Array) -> str:
        """The uncertain numbers of a plant (d,) that are not nominal, as they are run."""
        pairs = self.pairs_as_run(values)
        parts = [of.words(value) for of, value, nominal in pairs if value != nominal]
        return ", ".join(parts) or "the nominal one"

    def named(self, values: Array | None) -> dict[str, float] | None:
        """The uncertain numbers of a plant (d,) by name."""
        names = self.family.names
        return None if values is None else dict(zip(names, values.tolist(), strict=True))

    def plant_sample(self, values: Sequence[float] | Array) -> Varied:
        """The case, with its plant, that these values make."""
        row = np.asarray(values, float).tolist()
        return varied(self.experiment, zip(self.family.quantities, row, strict=True))


def _onset(disturbance: Disturbance, family: Family) -> tuple[float, float]:
    """When a disturbance begins at the earliest and at the latest [s]."""
    for number in family.quantities:
        if (number.of, number.quantity) == (disturbance.label, "onset"):
            return number.distribution.support
    return disturbance.window[0], disturbance.window[0]


def _extremes(family: Family, owners: Collection[str]) -> Iterator[Array]:
    """Values (d,) with all numbers of these at their ends: alike, and each unlike the others."""
    ends = {i: _ends(of) for i, of in enumerate(family.quantities) if of.owner in owners}
    if not ends:
        return
    for unlike in (None, *ends) if len(ends) > 1 else (None,):
        for side in (0, 1):
            values = family.nominal
            for i, pair in ends.items():
                values[i] = pair[1 - side if i == unlike else side]
            yield values


def _ends(quantity: Quantity) -> tuple[float, float]:
    """The smallest and the largest value that can be drawn."""
    low, high = quantity.distribution.support
    least, most = quantity.distribution.quantiles(inside(np.array([0.0, 1.0]))).tolist()
    return (low if math.isfinite(low) else least), (high if math.isfinite(high) else most)
