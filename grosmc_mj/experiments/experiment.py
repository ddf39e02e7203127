"""A case file as an experiment: what is run, and whether it keeps what is required."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.arguments import require, require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.switching import SwitchingNumbers, find_switching
from grosmc_mj.control.task import AS_PRINTED, Realization
from grosmc_mj.control.uncertainty import Uncertainty
from grosmc_mj.errors import ArgumentError, GrosmcError, ImplausibleWarning, Mistakes, MistakesError
from grosmc_mj.experiments.case import Case, case_of, edits_of
from grosmc_mj.experiments.file.numbers import uncertainty
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable, RequirementTable
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.file.user_code import blamed, is_named, named_in
from grosmc_mj.experiments.laws import design
from grosmc_mj.experiments.plants import NominalPlant, PlantName, design_variant, nominal_plant
from grosmc_mj.experiments.plausible import implausible
from grosmc_mj.experiments.requirements import (
    Judgement,
    Limit,
    judge_all,
    judgeable,
    limits,
    require_initial_error,
    transient,
)
from grosmc_mj.experiments.runs import RunResult, Settings, run_on
from grosmc_mj.loop import in_loop
from grosmc_mj.loop.timing import stride_of
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.law_inputs import require_answer
from grosmc_mj.simulation.prepare import ANALYTIC_TIMESTEP
from grosmc_mj.simulation.problem import Plant


@dataclass(frozen=True, eq=False)
class Experiment:
    """A case file, ready to run; its plants and laws are made when they are asked for.

    Attributes:
        file: What the file says.
        path: The file.
        nominal: The plant that its laws believe in.
        case: Start, duration, edits, disturbances.
        settings: How it is run.
        asked: The settings that count instead of what the file says of a controller.
        chosen: Names of the laws that are run; empty for all controllers of the file.
    """

    file: CaseFile
    path: Path
    nominal: NominalPlant
    case: Case
    settings: Settings
    asked: frozenset[str] = frozenset()
    chosen: tuple[str, ...] = ()
    _designs: dict[Any, Controller] = field(default_factory=dict, repr=False)

    @classmethod
    def load(cls, target: str | Path) -> Experiment:
        """The experiment of a case file, with all its laws designed.

        Args:
            target: ``system/case`` of the package, or the path of a case file.

        Raises:
            ArgumentError: If the file or what it names is wrong, in one line that begins with its
                path.
        """
        require("target", target, (str, Path), "SYSTEM/CASE or the path of a case file")
        path = find_file(str(target))
        experiment = experiment_of(read_case_file(path), path)
        for line in implausible(experiment.case, experiment.nominal.system):
            warnings.warn(f"{path}: {line}", ImplausibleWarning, stacklevel=2)
        return experiment

    @property
    def key(self) -> tuple[Path, Case]:
        """What tells it from others: where its laws are from, and the case."""
        return self.path, self.case

    @property
    def on_machine(self) -> bool:
        """Whether its plant has parts of a machine as built."""
        return bool(self.case.parts)

    @property
    def controllers(self) -> list[str]:
        """Names of the laws that are run."""
        return list(self.chosen or self._declared)

    @property
    def _declared(self) -> list[str]:
        """Names of the file's controllers."""
        return [table.called for table in self.file.controller]

    @property
    def plant_names(self) -> list[PlantName]:
        """The plants that they are run on."""
        compared = self.file.plant.compare or self.nominal.names
        return [name for name in self.nominal.names if name in compared]

    @cached_property
    def plants(self) -> Mapping[PlantName, Plant]:
        """The plants that the laws meet, with the case's edits."""
        return {name: self.plant(name) for name in self.plant_names}

    @cached_property
    def laws(self) -> Mapping[tuple[PlantName, str], Controller]:
        """The controllers, by the plant that they run on and by their names."""
        laws, mistakes = {}, {}
        for plant in self.plant_names:
            for name in self._declared:
                try:
                    laws[plant, name] = self.law(plant, name)
                except GrosmcError as error:
                    # What is wrong with the task is wrong for each of them.
                    mistakes.setdefault(str(error.__cause__ or error), str(error))
        if mistakes:
            raise MistakesError(mistakes.values())
        return laws

    @property
    def limits(self) -> Sequence[Limit]:
        """What the laws must keep, as far as a run tells."""
        return self._judged[0]

    @property
    def not_judged(self) -> Sequence[str]:
        """Which requirements a run does not tell about, and why."""
        return self._judged[1]

    @cached_property
    def _judged(self) -> tuple[Sequence[Limit], Sequence[str]]:
        case = self.case
        onsets = [(d.window[0], d.window[0]) for d in case.disturbances]
        return judgeable(self.required, transient(case.duration, onsets))

    @cached_property
    def required(self) -> Sequence[Limit]:
        """All that the file requires of the laws."""
        return self._all_limits("requirement", self.file.requirement)

    @cached_property
    def claimed(self) -> Sequence[Limit]:
        """All that the file's claims ask of the laws."""
        return self._all_limits("claim", self.file.claim)

    def _all_limits(self, kind: str, tables: Sequence[RequirementTable]) -> list[Limit]:
        """The limits in the tables of a kind."""
        laws = [self.laws[self.plant_names[0], name] for name in self._declared]
        required, mistakes, end = [], Mistakes(), self.file.run.duration
        for index, table in enumerate(tables):
            with mistakes.gathered(f"{kind} {index + 1}: "):
                for name in table.of or ():
                    require_known("controller", name, self._declared)
                for name in table.on or ():
                    require_known("plant", name, self.plant_names)
                if 0 < end <= table.after:
                    raise ArgumentError(
                        f"after = {table.after:g} s must be before the end of a run at {end:g} s"
                    )
                own = limits(table, laws, self.plant_names, self.case.duration)
                for limit in own:
                    if limit.of_initial_error:
                        require_initial_error(limit.kind, laws[0], self.case.x0)
                required += own
        mistakes.refuse()
        return required

    def checked(self) -> Experiment:
        """The same, once its plants, laws and requirements are made.

        Raises:
            ArgumentError: All that is wrong with them.
        """
        mistakes = Mistakes()
        for part in ("plants", "laws", "required", "claimed"):
            with mistakes.gathered():
                getattr(self, part)
        mistakes.refuse()
        return self

    def plant(self, name: PlantName) -> Plant:
        """One of the plants that there are, whether the file compares it or not.

        Raises:
            ArgumentError: If there is none of that name, or the case starts beyond its stops.
        """
        require_known("plant", name, self.nominal.names)
        settings = self.settings
        plant = self.nominal.true(name, self.case.edits, settings.timestep, settings.integrator)
        plant.require_start(np.array(self.case.x0))
        return plant

    def law(self, plant: PlantName, name: str) -> Controller:
        """A controller of the file, or a law by its name, designed for a plant to run on.

        Physics and the corrected equations get one and the same controller.

        Raises:
            GrosmcError: If there is no such law, a number does not fit, or the design fails.
        """
        table, period = self.file.law(name), self.settings.control_period
        if self.case.loop is not None:
            # A loop is made for the instants of its runs: what is wrong with these is told first.
            self.plant(plant)
            stride_of(period, self.settings.timestep)
        key = design_variant(plant), repr(table), period if is_named(table.law) else 0.0
        try:
            if key not in self._designs:
                self._designs[key] = design(
                    table, self.file, self.nominal, plant, self.path.parent, period
                )
            controller = self._designs[key]
            controller = _sampled(
                _realized(controller, self._realization_of(table, controller)), period
            )
            if self.case.loop is None:
                return controller
            # The law knows its loop if its table says so.
            return _in_loop(
                controller,
                self.case.loop,
                self.nominal.system,
                control_period=period,
                timestep=self.settings.timestep,
                predict=bool(table.predict),
                run=self.case.run,
                known=self.case.known_loop,
            )
        except GrosmcError as error:
            owner = "" if str(error).startswith("task: ") else f"controller {name}: "
            raise ArgumentError(f"{owner}{error}") from error

    def law_for(self, nominal: AnalyticPlant, name: str) -> Controller:
        """The same, designed for a nominal plant that is not the file's.

        Raises:
            GrosmcError: As for ``law``.
        """
        table, period = self.file.law(name), self.settings.control_period
        controller = design(
            table, self.file, NominalPlant(nominal), "corrected", self.path.parent, period
        )
        return _realized(controller, self._realization_of(table, controller))

    @property
    def region(self) -> tuple[float, ...] | None:
        """Bounds of |z1|, |z2| ... that the file declares, itself or for the gains of a law."""
        if self.file.task.region is not None:
            return tuple(self.file.task.region)
        return None if self.uncertainty is None else self.uncertainty.region

    @property
    def uncertainty(self) -> Uncertainty | None:
        """The first uncertainty that the gains of a law are computed from, if one is declared."""
        laws = [self.file.law(name) for name in (*self._declared, *self.file.laws)]
        declared = (law.numbers.get("uncertainty", {}) for law in laws)
        # Those of laws on the linearization have no region.
        return next((uncertainty(table) for table in declared if "region" in table), None)

    @property
    def slope(self) -> float:
        """L of the super-twisting law, in the unit of s per second squared."""
        return self.file.task.slope or SwitchingNumbers.slope

    @property
    def realization(self) -> Realization:
        """How a sliding mode law is sampled of which the file says nothing."""
        return self._realization(self.settings.switching, self.settings.surface)

    def _realization_of(self, table: ControllerTable, controller: Controller) -> Realization:
        """How a law is sampled: as its table says, unless a setting that is chosen counts."""
        own = {"switching", "surface"} & table.model_fields_set
        if controller.design is None or not controller.design.switching:
            if own:
                raise ArgumentError(f"it does not switch, so it has no {', '.join(sorted(own))}")
            return AS_PRINTED
        settings = {name: getattr(self.settings, name) for name in ("switching", "surface")}
        return self._realization(
            **{**settings, **{name: getattr(table, name) for name in own - self.asked}}
        )

    def _realization(self, switching: str, surface: str) -> Realization:
        law = find_switching(switching, slope=self.slope)
        return Realization(law, self.settings.control_period if surface == "discrete" else None)

    def with_settings(self, **changes: Any) -> Experiment:
        """The same experiment, run in another way.

        Args:
            changes: Fields of ``Settings``; those that are None stay as the file has them.

        Raises:
            ArgumentError: If there is no such setting, or it has no such value.
        """
        chosen = {name: value for name, value in changes.items() if value is not None}
        for name in chosen:
            require_known("setting", name, vars(self.settings))
        settings = replace(self.settings, **chosen)
        return replace(self, settings=settings, asked=self.asked | chosen.keys())

    def with_laws(self, names: Sequence[str]) -> Experiment:
        """The same experiment under some laws.

        Args:
            names: Of its controllers, and of the file's ``[laws]``; none for all controllers.

        Raises:
            ArgumentError: If there is no such law.
        """
        further = [name for name in self.file.laws if name not in self._declared]
        known = [*self._declared, *further]
        for name in names:
            require_known("law", name, known)
        added = [ControllerTable(law=name) for name in further if name in names]
        file = self.file.model_copy(update={"controller": [*self.file.controller, *added]})
        return replace(self, file=file, chosen=tuple(name for name in known if name in names))

    def varied(self, **changes: Any) -> Experiment:
        """The same laws in another case.

        Args:
            changes: Fields of ``Case``, such as ``x0``, ``duration``, ``edits``, ``disturbances``.
        """
        return replace(self, case=replace(self.case, **changes))

    def changed(self, key: str, value: Any, designs: dict[Any, Controller]) -> Experiment:
        """The same experiment with another number in its file.

        Args:
            key: Where it stands: ``task.Q``, ``laws.grosmc.epsilon``, or a setting of ``run``.
            value: What stands there instead.
            designs: Where the laws of experiments with this number are kept.
        """
        if key == "run.duration":
            return self.varied(duration=value)
        if key.startswith("run."):
            return self.with_settings(**{key.removeprefix("run."): value})
        return replace(self, file=_with(self.file, key.split("."), value), _designs=designs)

    def run(self, plant: PlantName | None = None, law: str | None = None) -> RunResult:
        """One controller on one plant.

        Args:
            plant: Its name; by default physics or, where there is none, the equations.
            law: Name of a controller of the file or of a law; the file's last one by default.

        Raises:
            GrosmcError: If there is no such plant or law, or one of the user's own fails, with its
                file and line.
        """
        where = self.nominal.truest if plant is None else plant
        true, controller = self.plant(where), self.law(where, law or self.controllers[-1])
        try:
            with blamed(self.path.parent):
                # Compiled code does not say where a law fails, or that it does.
                require_answer(controller, np.array(self.case.x0), len(self.nominal.system.inputs))
                return run_on(self, where, controller, true)
        except GrosmcError as error:
            raise ArgumentError(f"{self.path}: {error}") from error

    def runs(self) -> Iterator[RunResult]:
        """Run every controller on every plant, one by one; raises as ``run`` does."""
        for plant in self.plant_names:
            for name in self.controllers:
                yield self.run(plant, name)

    def document(self) -> dict[str, Any]:
        """The resolved file as plain values."""
        return self.file.model_dump(exclude_none=True)


def _with(table: Any, path: Sequence[str], value: Any) -> Any:
    """A table of a file with another value at a path of keys."""
    key, *rest = path
    if isinstance(table, Mapping):
        return {**table, key: _with(table[key], rest, value) if rest else value}
    inner = _with(getattr(table, key), rest, value) if rest else value
    return table.model_copy(update={key: inner})


_in_loop = lru_cache(maxsize=512)(in_loop)
_realized = lru_cache(maxsize=512)(realized)
_sampled = lru_cache(maxsize=512)(Controller.sampled)


def judge(target: str | Path | Experiment) -> list[Judgement]:
    """Run an experiment, and say of each requirement and run whether it is kept.

    Args:
        target: ``system/case`` of the package, the path of a case file, or an experiment.

    Raises:
        GrosmcError: If the file is wrong, or a law of the user's own fails.
    """
    experiment = target if isinstance(target, Experiment) else Experiment.load(target)
    return judge_all(experiment.limits, list(experiment.runs()))


def experiment_of(file: CaseFile, path: Path) -> Experiment:
    """The experiment of a case file, with all its laws designed.

    Args:
        file: Its content.
        path: Where it lies: what it names is looked for beside it.

    Raises:
        ArgumentError: If it names what is not there, in one line that begins with its path.
    """
    try:
        return undesigned(file, path).checked()
    except GrosmcError as error:
        raise ArgumentError(f"{path}: {error}") from error


def undesigned(file: CaseFile, path: Path) -> Experiment:
    """The experiment of a file, its laws designed when they are asked for."""
    nominal, run = nominal_plant(file, path.parent), file.run
    own = None if file.plant.system is not None else nominal.plant.step_length
    timestep = run.timestep or own or ANALYTIC_TIMESTEP
    settings = Settings(
        engine=run.engine,
        control_period=run.control_period or max(ANALYTIC_TIMESTEP, timestep),
        timestep=timestep,
        integrator=run.integrator or nominal.integrator,
    )
    case = case_of(file, nominal.system, path.parent, nominal.rest)
    # The package's own laws are designed once for all experiments on one task and nominal plant.
    shared = file.plant.system is not None and not named_in(file)
    task = (file.plant.system, edits_of(file, nominal.system, known=True), file.task)
    designs = _shared_designs(repr(task)) if shared else {}
    experiment = Experiment(file, path, nominal, case, settings, _designs=designs)
    mistakes = Mistakes()
    if case.loop is not None:
        with mistakes.gathered():
            case.loop.require_fits(nominal.system, settings.timestep, settings.control_period)
    for table in file.controller:
        if table.predict and case.loop is None:
            mistakes.note(
                f"controller {table.called}: predict: there is no loop that it could know: give "
                "the file a [computing], a [[sensor]] or an [[actuator]]"
            )
        if experiment.controllers.count(table.called) > 1:
            mistakes.note(f"two controllers are called {table.called!r}: give one another name")
    predicting = [table for table in file.controller if file.law(table.called).predict]
    if file.known_loop is not None and not predicting:
        mistakes.note("known_loop: no controller has predict = true, so none knows its loop")
    for name in file.plant.compare or ():
        with mistakes.gathered("plant: compare: "):
            require_known("plant", name, nominal.names)
    mistakes.refuse()
    return experiment


@cache
def _shared_designs(_task: str) -> dict[Any, Controller]:
    """Where the controllers of a task are kept."""
    return {}
