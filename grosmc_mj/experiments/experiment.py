"""A case file as an experiment, and its runs: plants, laws, requirements, judgements."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Set
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.arguments import require, require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import (
    ArgumentError,
    DivergenceError,
    GrosmcError,
    ImplausibleWarning,
    Mistakes,
)
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.parts import (
    known_loop_of_file,
    loop_of_file,
    machine_of_file,
    run_of_file,
)
from grosmc_mj.experiments.file.paths import set_number
from grosmc_mj.experiments.file.reading import case_file_of, read_case_file
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.file.user_code import blamed, named_in
from grosmc_mj.experiments.file.values import disturbances_of, edits_of, state_of
from grosmc_mj.experiments.plants import NominalPlant, PlantName, nominal_plant
from grosmc_mj.experiments.plausible import implausible
from grosmc_mj.experiments.runs import Run
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.files import name_in_files
from grosmc_mj.loop import AppliedLoop
from grosmc_mj.loop.timing import stride_of
from grosmc_mj.machine import MachinePart
from grosmc_mj.physics.edit import Edit
from grosmc_mj.plants import System
from grosmc_mj.requirements.judging import Judgement, judge_runs
from grosmc_mj.requirements.metrics import Metric
from grosmc_mj.requirements.optimum import compare_with_optimum
from grosmc_mj.requirements.run_metrics import measure
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.simulation.law_inputs import require_answer
from grosmc_mj.simulation.prepare import ANALYTIC_TIMESTEP
from grosmc_mj.simulation.problem import Plant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.units import in_units

# The package's own laws are designed once for all experiments on one task and nominal plant.
_shared_designs: dict[str, dict[Any, Controller]] = {}
# Attributes of a case that stand in its file.
_OF_FILE = (
    "x0",
    "duration",
    "edits",
    "disturbances",
    "loop",
    "known_loop",
    "run_number",
)


@dataclass(frozen=True, eq=False)
class Experiment(Case):
    """A case that can be run."""

    @classmethod
    def load(cls, target: str | Path) -> Experiment:
        """Load the experiment of a case file, with all its laws designed.

        Args:
            target: ``system/case`` of the package, or the path of a case file.

        Raises:
            ArgumentError: If the file is wrong, or names a missing thing, in one line that begins
                with its path.
        """
        require("target", target, (str, Path), "SYSTEM/CASE or the path of a case file")
        path = find_file(str(target))
        experiment = experiment_of(read_case_file(path), path)
        for line in implausible(experiment):
            warnings.warn(f"{path}: {line}", ImplausibleWarning, stacklevel=2)
        return experiment

    def changed(self, changes: Mapping[str, Any]) -> Experiment:
        """Return a copy with other numbers, as if its file had them.

        Args:
            changes: New values by their paths OWNER.NAME.FIELD in the file: ``edit.pole.mass``,
                ``sensor.pole angle.delay``, ``laws.grosmc.k``, ``run.duration``; two tables of one
                name need an index, ``edit.pole[2].mass``. A value is a number in the unit of the
                file's key, or a text with a unit. An edit that the file does not have is added.

        Raises:
            ArgumentError: If there is no such path, or the file could not have the value.
        """
        content = deepcopy(self.file.content)
        for path, value in changes.items():
            set_number(content, path, in_units(value))
        owners = {re.split(r"[.\[]", path)[0] for path in changes}
        try:
            return self._with_content(content, owners)
        except GrosmcError as error:
            raise ArgumentError(str(error)) from error

    def _with_content(self, content: dict[str, Any], owners: Set[str]) -> Experiment:
        """Return a copy with tables of a file's content; all else that was varied stays.

        Args:
            content: The whole content.
            owners: Names of its tables that differ from those of the case's own file.

        Raises:
            GrosmcError: If a file could not have the content.
        """
        before = case_file_of(self.file.content, self.path)
        after = case_file_of(content, self.path)
        old = experiment_without_designs(before, self.path)
        new = experiment_without_designs(after, self.path)

        values: dict[str, Any] = {}
        for name in _OF_FILE:
            if getattr(new, name) != getattr(old, name):
                values[name] = getattr(new, name)
        if owners & {"edit", "plant", "design"}:
            values["nominal"] = new.nominal
        settings = {
            name: value
            for name, value in vars(new.settings).items()
            if value != getattr(old.settings, name)
        }
        # A file with further laws, or of a campaign, keeps its other tables.
        file = self.file.model_copy(update={owner: getattr(after, owner) for owner in owners})
        file._content = content
        return replace(
            self,
            file=file,
            settings=replace(self.settings, **settings),
            _designs=new._designs,
            **values,
        )

    def run(self, plant: PlantName | None = None, law: str | None = None) -> RunResult:
        """Run one controller on one plant.

        Args:
            plant: Name of the plant; by default physics or, where there is none, the equations.
            law: Name of a controller of the file or of a law; the file's last one by default.

        Raises:
            GrosmcError: If there is no such plant or law, or a user's own law fails, with its
                file and line.
        """
        if plant is None:
            plant = self.nominal.truest
        true = self.plant(plant)
        name = law or self.controllers[-1]
        controller = self.law(plant, name)
        loop = self.applied_loop(plant, name)
        try:
            with blamed(self.path.parent):
                # Compiled code does not say where a law fails, or that it does.
                require_answer(controller, np.array(self.x0), len(self.nominal.system.inputs))
                return run_on(self, plant, controller, true, loop)
        except GrosmcError as error:
            raise ArgumentError(f"{self.path}: {error}") from error

    def runs(self) -> Iterator[RunResult]:
        """Run every controller on every plant, one by one; raises as ``run`` does."""
        for plant in self.plant_names:
            for name in self.controllers:
                yield self.run(plant, name)

    def document(self) -> dict[str, Any]:
        """Return the resolved file as plain values."""
        return self.file.model_dump(exclude_none=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class RunResult(Run):
    """A run of an experiment, with its requirements and its film.

    Attributes:
        case: The experiment.
        judged: Judgements over several draws of its loop; of this run alone by default.
    """

    case: Experiment
    judged: tuple[Judgement, ...] | None = None

    # A page, a figure and a document ask for them.
    @cached_property
    def requirements(self) -> list[Judgement]:
        """Judgements of this run, or of its draws, by the experiment's requirements."""
        if self.judged is not None:
            return list(self.judged)
        return judge_runs(self.case.limits, [self])

    def film(self, path: str | Path) -> Path:
        """Write a film of the run, and return its path.

        Raises:
            ArgumentError: If the run is not on physics.
            SetupError: If it cannot be rendered or written.
        """
        from grosmc_mj.experiments.films import film_of, write_case_film

        film = film_of([self])
        return write_case_film(self.case, film, Path(path), settings=self.case.settings).film

    def __repr__(self) -> str:
        """Return case, end, metrics, costs and requirements in five lines."""
        end = f"{self.status.name.lower()} at {self.trajectory.time[-1]:g} s"
        if self.ended:
            end += f": {self.ended}"
        metrics = [
            f"{name.replace('_', ' ')} {_with_unit(self.metrics[name])}"
            for name in ("deviation", "settling_time", "max_input")
        ]
        continuous, switched = self.cost_shares
        costs = f"J(u_c)/J* {_with_unit(continuous)}, J(u_d)/J* {_with_unit(switched)}"
        kept = [item.kept for item in self.requirements]
        requirements = f"{sum(kept)} of {len(kept)} kept" if kept else "none"
        return "\n".join(
            [
                f"{self.key}: {self.case.title}",
                end,
                ", ".join(metrics),
                costs,
                f"requirements: {requirements}",
            ]
        )


def run_on(
    case: Experiment,
    name: PlantName,
    law: Controller,
    plant: Plant,
    loop: AppliedLoop | None = None,
) -> RunResult:
    """Run a case with a given law, loop and plant, and measure the run.

    A run that ends early is a result like any other.

    Args:
        case: Start, duration, disturbances and settings.
        name: Name of the plant in the result.
        law: The controller.
        plant: The plant.
        loop: The loop around the law; ideal by default.
    """
    settings = case.settings
    ended = ""
    try:
        run = simulate(
            plant,
            law,
            case.x0,
            duration=case.duration,
            loop=loop,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=case.disturbances,
            engine=settings.engine_for(law),
        )
    except DivergenceError as error:
        run = error.trajectory
        ended = str(error)
    comparison = compare_with_optimum(run, law)
    metrics = measure(run, law, comparison, case.onset)
    return RunResult(
        case=case,
        plant=name,
        controller=law,
        trajectory=run,
        comparison=comparison,
        metrics=metrics,
        ended=ended,
        true=plant,
    )


def _with_unit(metric: Metric) -> str:
    """Return a metric with its unit, or the reason why it has no value."""
    if metric.value is None:
        return f"- ({metric.note})"
    if metric.unit == "1":
        return f"{metric.value:.4g}"
    return f"{metric.value:.4g} {metric.unit}"


def judge(target: str | Path | Experiment) -> list[Judgement]:
    """Run an experiment, and judge every run by every requirement.

    Args:
        target: ``system/case`` of the package, the path of a case file, or an experiment.

    Raises:
        GrosmcError: If the file is wrong, or a user's own law fails.
    """
    experiment = target if isinstance(target, Experiment) else Experiment.load(target)
    return judge_runs(experiment.limits, list(experiment.runs()))


def experiment_of(file: CaseFile, path: Path) -> Experiment:
    """Return the experiment of a case file, with all its laws designed.

    Args:
        file: The content of the file.
        path: The file; files that it names are beside it.

    Raises:
        ArgumentError: If it names a missing thing, in one line that begins with its path.
    """
    try:
        return experiment_without_designs(file, path).checked()
    except GrosmcError as error:
        raise ArgumentError(f"{path}: {error}") from error


def experiment_without_designs(file: CaseFile, path: Path) -> Experiment:
    """Return the experiment of a file, whose laws are designed when they are asked for.

    Raises:
        GrosmcError: If plant, case or loop do not fit.
    """
    folder = path.parent
    nominal = nominal_plant(file, folder)
    system = nominal.system
    settings = _settings_of(file, nominal)

    x0: tuple[float, ...] = ()
    disturbances: tuple[AnyDisturbance, ...] = ()
    edits: tuple[Edit, ...] = ()
    parts: tuple[MachinePart, ...] = ()
    loop = None
    known_loop = None
    mistakes = Mistakes()
    with mistakes.gathered():
        x0 = state_of(file.run.start, system, "run: start", nominal.rest)
    with mistakes.gathered():
        disturbances = disturbances_of(file, system, folder)
    with mistakes.gathered():
        loop = loop_of_file(file, system)
    with mistakes.gathered("known_loop: "):
        known_loop = known_loop_of_file(file, system)
    with mistakes.gathered():
        edits = edits_of(file, system, known=False)
    with mistakes.gathered():
        parts = machine_of_file(file, system)
    mistakes.refuse()

    experiment = Experiment(
        file=file,
        path=path,
        nominal=nominal,
        settings=settings,
        name=file.name,
        title=file.title or file.name,
        source=file.source,
        x0=x0,
        duration=file.run.duration,
        edits=(*edits, *parts),
        disturbances=disturbances,
        loop=loop,
        known_loop=known_loop,
        run_number=run_of_file(file),
        _designs=_designs_for(file, system),
    )
    _refuse_inconsistent(experiment)
    return experiment


def _designs_for(file: CaseFile, system: System) -> dict[Any, Controller]:
    """Return the designs of a file's laws so far: files with one task and plant share them."""
    if file.plant.system is None or named_in(file):
        return {}
    task = (file.plant.system, edits_of(file, system, known=True), file.task)
    return _shared_designs.setdefault(repr(task), {})


def _settings_of(file: CaseFile, nominal: NominalPlant) -> Settings:
    """Return the settings of a file, with defaults by its plant."""
    run = file.run
    timestep = run.timestep
    if not timestep and file.plant.system is None:
        timestep = nominal.plant.step_length
    timestep = timestep or ANALYTIC_TIMESTEP
    return Settings(
        engine=run.engine,
        control_period=run.control_period or max(ANALYTIC_TIMESTEP, timestep),
        timestep=timestep,
        integrator=run.integrator or nominal.integrator,
    )


def _refuse_inconsistent(experiment: Experiment) -> None:
    """Refuse loops, controllers and plants that do not fit each other."""
    file = experiment.file
    nominal = experiment.nominal
    loop = experiment.loop
    settings = experiment.settings
    mistakes = Mistakes()
    with mistakes.gathered():
        stride_of(settings.control_period, settings.timestep)
    if loop is not None:
        with mistakes.gathered():
            loop.require_fits(nominal.system, settings.timestep, settings.control_period)
    for table in file.controller:
        if table.predict and loop is None:
            mistakes.note(
                f"controller {table.called}: predict: there is no loop that it could know: give "
                "the file a [computing], a [[sensor]] or an [[actuator]]"
            )
        if experiment.controllers.count(table.called) > 1:
            mistakes.note(f"two controllers are called {table.called!r}: give one another name")
    by_file: dict[str, str] = {}
    for name in dict.fromkeys(experiment.controllers):
        other = by_file.setdefault(name_in_files(name), name)
        if other != name:
            mistakes.note(
                f"controllers {other!r} and {name!r} would share the file of "
                f"{name_in_files(name)}: give one another name"
            )
    predicting = [table for table in file.controller if file.law(table.called).predict]
    if file.known_loop is not None and not predicting:
        mistakes.note("known_loop: no controller has predict = true, so none knows its loop")
    for name in file.plant.compare or ():
        with mistakes.gathered("plant: compare: "):
            require_known("plant", name, nominal.names)
    mistakes.refuse()
