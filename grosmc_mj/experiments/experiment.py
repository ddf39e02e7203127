"""A case file as an experiment, and its runs: plants, laws, requirements, judgements."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache, partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.experiments.consistency import refuse_inconsistent
from grosmc_mj.experiments.file.disturbance_tables import disturbances_of
from grosmc_mj.experiments.file.numbers import in_order, uncertainty
from grosmc_mj.experiments.file.parts import (
    LOOP_PARTS,
    edits_of,
    keep_known_motors,
    known_loop_of_file,
    loop_of_file,
    machine_of_file,
    run_of_file,
)
from grosmc_mj.experiments.file.paths import Place, place_of
from grosmc_mj.experiments.file.reading import case_file_of, read_case_file
from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable, RequirementTable
from grosmc_mj.experiments.file.shipped import find_file
from grosmc_mj.experiments.file.user_code import blamed, is_named, named_in
from grosmc_mj.experiments.file.values import state_of
from grosmc_mj.experiments.law_numbers import OF_FILE
from grosmc_mj.experiments.laws.design import design
from grosmc_mj.experiments.laws.packaged import knows_limits, switching_numbers
from grosmc_mj.experiments.laws.request import LawRequest
from grosmc_mj.experiments.number import find_number
from grosmc_mj.experiments.plants import NominalPlant, PlantName, design_variant, nominal_plant
from grosmc_mj.experiments.plausible import (
    beyond_ranges,
    implausible,
    joint_ranges,
    unusual_limits,
)
from grosmc_mj.experiments.requirement_tables import requirements_in
from grosmc_mj.experiments.requirements.conditions import Conditions, end_of_transient
from grosmc_mj.experiments.requirements.judging import Judgement, decidable, judge_runs
from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.metrics import Metric
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.settings import Settings, settings_of_file
from grosmc_mj.experiments.steps import Change, differences, with_values
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import (
    ArgumentError,
    DivergenceError,
    GrosmcError,
    ImplausibleWarning,
    Mistakes,
    MistakesError,
    name_list,
    placed,
    unknown_name,
)
from grosmc_mj.ground.fields import Is
from grosmc_mj.ground.units import in_units, number_in
from grosmc_mj.ground.wording import spelled, unit_after
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.mechanics.machine.motor import Motor
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.acting import with_acting
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.simulation.law_inputs import require_answer
from grosmc_mj.simulation.loop import AppliedLoop, Loop, apply_loop
from grosmc_mj.simulation.loop.timing import stride_of
from grosmc_mj.simulation.prepare import number_of_steps, prepare
from grosmc_mj.simulation.problem import Plant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import realized
from grosmc_mj.theory.control.switching import find_switching
from grosmc_mj.theory.control.task import AS_PRINTED, Realization
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.plants import AnalyticPlant, System

# The package's own laws are designed once for all experiments on one task and nominal plant.
_shared_designs: dict[str, dict[Any, Controller]] = {}
# Attributes that stand in the file.
_OF_FILE = (
    "x0",
    "duration",
    "edits",
    "disturbances",
    "loop",
    "known_loop",
    "run_number",
)

# Attributes and settings in seconds, which may be given as texts with a unit.
_TIMES = ("duration", "control_period", "timestep")

# Claims and campaigns ask for the same loops thousands of times.
_apply_loop = lru_cache(maxsize=512)(apply_loop)


@dataclass(frozen=True, eq=False)
class Experiment:
    """A case file as values; its plants and laws are made when they are asked for.

    Attributes:
        file: Tables of the file.
        path: The file.
        nominal: Plant that the laws are designed for.
        settings: Settings of the simulation.
        name: ``nominal``, ``case1`` or ``case2``, or the user's own.
        title: Title for people.
        source: Place in the chapter, or a note that this project declares it.
        x0: Start, in the order of the system's states.
        duration: Duration of a run [s]; the chapter prints none.
        edits: Edits of the plant that the laws do not know.
        disturbances: Of bodies, inputs, measured states and rates.
        loop: Sensors, computer and actuators between laws and plant; None without them.
        known_loop: Loop that predicting laws take for theirs; None for the loop itself.
        run_number: Number of the run: each run of a seed has its own noise, jitter and missed
            samples.
        asked: Names of the settings that replace those of a controller in the file.
        chosen: Names of the laws that are run; empty for all controllers of the file.
        varied: Paths of the numbers that ``changed`` has been given.
    """

    file: CaseFile
    path: Path
    nominal: NominalPlant
    settings: Settings
    name: str
    title: str
    source: str
    x0: tuple[float, ...]
    duration: float
    edits: tuple[Edit, ...] = ()
    disturbances: tuple[AnyDisturbance, ...] = ()
    loop: Loop | None = None
    known_loop: Loop | None = None
    run_number: int = 0
    asked: frozenset[str] = frozenset()
    chosen: tuple[str, ...] = ()
    varied: tuple[str, ...] = ()
    _designs: dict[Any, Controller] = field(default_factory=dict, repr=False)

    @classmethod
    def load(cls, target: str | Path) -> Experiment:
        """Load the experiment of a case file, with all its laws designed.

        Args:
            target: ``system/case`` of the package, or the path of a case file.

        Raises:
            ArgumentError: If the file is wrong, or names a missing thing, in one line that begins
                with its path.
        """
        Is((str, Path), "SYSTEM/CASE or the path of a case file").require("target", target)
        path = find_file(str(target))
        file = read_case_file(path)
        with placed(f"{path}: "):
            experiment = cls.of_file(file, path).checked()
        experiment.warn_of_implausible()
        return experiment

    def warn_of_implausible(self) -> None:
        """Warn of each number that is allowed, and probably a mistake."""
        for line in self._implausible():
            warnings.warn(f"{self.path}: {line}", ImplausibleWarning, stacklevel=3)

    def _implausible(self) -> list[str]:
        """Return a line for each number that is allowed, and probably a mistake."""
        lines = list(implausible(self.nominal.system, self.x0, self.edits, self.loop))
        lines += unusual_limits(self.limits)
        ranges = joint_ranges(self.nominal.plant, self.edits)
        lines += beyond_ranges(
            ranges, self.nominal.system, self.x0, self.laws.values(), self.duration
        )
        return lines

    @classmethod
    def of_file(cls, file: CaseFile, path: Path) -> Experiment:
        """Return the experiment of a file, whose laws are designed when they are asked for.

        Args:
            file: The content of the file.
            path: The file; files that it names are beside it.

        Raises:
            GrosmcError: If plant, case or loop do not fit.
        """
        nominal = nominal_plant(file, path.parent)
        system = nominal.system
        settings = settings_of_file(file, nominal)
        mistakes = Mistakes()
        x0 = mistakes.attempt(state_of, file.run.start, system, "run: start", nominal.rest)
        disturbances = mistakes.attempt(disturbances_of, file, system, path.parent)
        loop = mistakes.attempt(loop_of_file, file, system)
        known_loop = mistakes.attempt(known_loop_of_file, file, system, where="known_loop: ")
        model = nominal.plant.spec if isinstance(nominal.plant, MujocoPlant) else None
        edits = mistakes.attempt(partial(edits_of, known=False, model=model), file, system)
        parts = mistakes.attempt(machine_of_file, file, system)
        mistakes.refuse()
        refuse_inconsistent(file, nominal, loop, settings)

        return cls(
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

    @property
    def system(self) -> str:
        """Name of the system."""
        return self.nominal.system.name

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return f"{self.system}/{self.name}"

    @property
    def key(self) -> tuple[Any, ...]:
        """Key that differs between cases: the file of the laws, and what happens to the plant."""
        return self.path, self.name, *[getattr(self, name) for name in _OF_FILE]

    @property
    def parts(self) -> tuple[MachinePart, ...]:
        """Edits that are parts of a machine as built."""
        return tuple(edit for edit in self.edits if isinstance(edit, MachinePart))

    @property
    def motors(self) -> list[Motor]:
        """Motors that stand in the place of ideal inputs."""
        return [part for part in self.parts if isinstance(part, Motor)]

    def judged_on_motors(self, requirements: Sequence[Requirement]) -> list[Requirement]:
        """Return requirements on runs of this case, whose motors may give another input."""
        if not self.motors:
            return list(requirements)
        stronger = any(motor.stronger for motor in self.motors)
        return [requirement.on_motors(stronger=stronger) for requirement in requirements]

    @property
    def onset(self) -> float:
        """End of the transient [s]: onset of the first load after the start; infinite for none."""
        return end_of_transient((load.window[0], load.window[0]) for load in self.disturbances)

    @property
    def on_machine(self) -> bool:
        """Whether its plant has parts of a machine as built."""
        return bool(self.parts)

    def input_limits(self, plant: Plant) -> Array:
        """Return least and largest of each input by a plant and the loop's actuators, (2, m)."""
        loop = self.loop or Loop()
        return loop.input_limits(plant)

    def conditions(self, plant: Plant) -> Conditions:
        """Return the loads of a run on a plant, and the actuators of plant and loop."""
        loop = self.loop or Loop()
        return Conditions(
            loads=[load.window for load in self.disturbances],
            input_limits=loop.input_limits(plant),
            actuators=list(loop.actuated(plant.system)),
        )

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
        """Names of the plants that the laws are run on."""
        compared = self.file.plant.compare or self.nominal.names
        return [name for name in self.nominal.names if name in compared]

    @property
    def plants(self) -> Mapping[PlantName, Plant]:
        """Plants that the laws are run on, with the case's edits."""
        return {name: self.plant(name) for name in self.plant_names}

    # Requirements and runs ask for it; each controller is designed from the file.
    @cached_property
    def laws(self) -> Mapping[tuple[PlantName, str], Controller]:
        """Controllers by the plant that they run on and by name.

        Raises:
            MistakesError: For all controllers that cannot be designed, or not for the loop.
        """
        laws = {}
        # By cause: a mistake in the task is the same for each controller.
        mistakes: dict[str, str] = {}
        for plant in self.plant_names:
            for name in self._declared:
                try:
                    laws[plant, name] = self.law(plant, name)
                    self.applied_loop(plant, name)
                except GrosmcError as error:
                    mistakes.setdefault(str(error.__cause__ or error), str(error))
        if mistakes:
            raise MistakesError(mistakes.values())
        return laws

    @property
    def limits(self) -> Sequence[Requirement]:
        """Requirements that a single run can decide."""
        judged, _ = self._decidable_limits()
        return judged

    @property
    def not_judged(self) -> Sequence[str]:
        """Requirements that a single run cannot decide, with the reasons."""
        _, notes = self._decidable_limits()
        return notes

    def _decidable_limits(self) -> tuple[Sequence[Requirement], Sequence[str]]:
        """Return the requirements that a run can decide, and notes about the other ones."""
        return decidable(self.required, min(self.onset, self.duration))

    # Every judgement of a run asks for it.
    @cached_property
    def required(self) -> Sequence[Requirement]:
        """All requirements of the file."""
        return self._all_limits("requirement", self.file.requirement)

    @property
    def claimed(self) -> Sequence[Requirement]:
        """All limits in the file's claims."""
        return self._all_limits("claim", self.file.claim)

    def _all_limits(self, kind: str, tables: Sequence[RequirementTable]) -> list[Requirement]:
        """Return the limits in the tables of a kind."""
        laws = [self.laws[self.plant_names[0], name] for name in self._declared]
        mistakes = Mistakes()
        base = self.file.base_of(kind)
        make = partial(self._limits_of, laws=laws, base=base)
        required = mistakes.each(kind, tables, make, base)
        mistakes.refuse()
        return list(chain.from_iterable(required))

    def _limits_of(
        self, table: RequirementTable, laws: Sequence[Controller], base: str
    ) -> list[Requirement]:
        """Return the limits in a table of the file, or of the file named that it extends."""
        for name in table.of or ():
            if name not in self._declared:
                unknown = unknown_name("controller", name, self._declared)
                remedy = f"; tables of your own replace those of {base}" if base else ""
                raise ArgumentError(f"{unknown}{remedy}")
        for name in table.on or ():
            require_known("plant", name, self.plant_names)
        end = self.file.run.duration
        if 0 < end <= table.after:
            raise ArgumentError(
                f"after = {table.after:g} s must be before the end of a run at {end:g} s"
            )
        required = requirements_in(table, laws, self.plant_names, self.duration)
        required = self.judged_on_motors(required)
        for requirement in required:
            requirement.refuse_start(laws[0], self.x0)
            requirement.refuse_duration(self.duration)
            requirement.refuse_timestep(self.settings.timestep, self.duration)
        return required

    def checked(self) -> Experiment:
        """Make plants, laws and requirements, and return the experiment.

        Raises:
            ArgumentError: For all mistakes in them.
        """
        mistakes = Mistakes()
        for part in ("plants", "laws", "required", "claimed"):
            with mistakes.gathered():
                getattr(self, part)
        mistakes.refuse()
        return self

    def plant(self, name: PlantName) -> Plant:
        """Return a plant, whether the file compares it or not.

        Raises:
            ArgumentError: If there is none of that name, or the case starts beyond its stops.
        """
        require_known("plant", name, self.nominal.names)
        settings = self.settings
        plant = self.nominal.true(name, self.edits, settings.timestep, settings.integrator)
        plant.require_start(np.array(self.x0))
        return plant

    def law(self, plant: PlantName, name: str) -> Controller:
        """Return a controller of the file, or a law by its name, designed for a plant to run on.

        Physics and the corrected equations get one and the same controller.

        Raises:
            GrosmcError: If there is no such law, a number does not fit, or the design fails.
        """
        try:
            return self._designed_law(plant, name)
        except GrosmcError as error:
            owner = "" if str(error).startswith("task: ") else f"controller {name}: "
            raise ArgumentError(f"{owner}{error}") from error

    def law_for(self, nominal: AnalyticPlant, name: str) -> Controller:
        """Return a law by its name, designed for a nominal plant that is not the file's.

        Raises:
            GrosmcError: As for ``law``.
        """
        other = replace(self, nominal=NominalPlant(nominal), _designs={})
        return other._designed_law("corrected", name)

    def _designed_law(self, plant: PlantName, name: str) -> Controller:
        """Return a law in its realization; it is designed once for all plants with one variant."""
        table = self.file.law(name)
        period = self.settings.control_period
        loop = self._loop_of_design
        actuators = loop.actuators if knows_limits(table, self.nominal) else ()
        # Only a user's own law may depend on the control period.
        key = design_variant(plant), repr(table), period if is_named(table.law) else 0.0, actuators
        if key not in self._designs:
            folder = self.path.parent
            self._designs[key] = design(
                LawRequest(table, self.file, self.nominal, plant, folder, period, loop)
            )
        controller = self._designs[key]
        realization = self._realization_of(table, controller)
        realized_key = *key, period, realization
        if realized_key not in self._designs:
            self._designs[realized_key] = realized(controller, realization).sampled(period)
        return self._designs[realized_key]

    # Every design asks for it.
    @cached_property
    def _loop_of_design(self) -> Loop:
        """Loop whose actuators the file's laws know, whatever has been varied since."""
        system = self.nominal.system
        known = known_loop_of_file(self.file, system)
        if known is not None and known.actuators:
            return known
        return loop_of_file(self.file, system) or Loop()

    def applied_loop(self, plant: PlantName, name: str) -> AppliedLoop | None:
        """Return the case's loop around a controller, see ``law``; None without a loop.

        Raises:
            GrosmcError: As for ``law``, or if a part of the loop does not fit.
        """
        if self.loop is None:
            return None
        # A loop is made for the instants of its runs: their mistakes come first.
        self.plant(plant)
        stride_of(self.settings.control_period, self.settings.timestep)
        controller = self.law(plant, name)
        with placed(f"controller {name}: "):
            return self.loop_around(
                controller,
                self.loop,
                predict=self.predicts(name),
                run=self.run_number,
            )

    def predicts(self, name: str) -> bool:
        """Whether a controller of the file, or a law by its name, predicts over its loop."""
        return bool(self.file.law(name).predict)

    def knows_loop(self, name: str) -> bool:
        """Whether a controller of the file, or a law by its name, knows anything of its loop."""
        return self.predicts(name) or knows_limits(self.file.law(name), self.nominal)

    def loop_around(
        self, controller: Controller, loop: Loop, *, predict: bool = False, run: int = 0
    ) -> AppliedLoop:
        """Return a loop around a controller, for runs of this experiment.

        Args:
            controller: Controller designed for a plant of the experiment.
            loop: Parts of the loop.
            predict: Whether the law knows its loop: the file's known one or the case's own, of an
                experiment without a loop the one around it.
            run: Number of the run, which sets what the loop draws at random.

        Raises:
            GrosmcError: If a part does not fit.
        """
        known = self.loop
        if known is not None and self.known_loop is not None:
            known = self.known_loop
        return _apply_loop(
            loop,
            controller,
            self.nominal.system,
            control_period=self.settings.control_period,
            timestep=self.settings.timestep,
            predict=predict,
            run=run,
            known=known,
        )

    @property
    def region(self) -> tuple[float, ...] | None:
        """Bounds of |z1|, |z2| ... that the file declares, itself or for the gains of a law."""
        bounds = self.file.task.region
        if isinstance(bounds, dict):
            bounds = in_order("task: region", bounds, self._error_names(self._declared[0]))
        if bounds is not None:
            return tuple(bounds)
        if self.uncertainty is None:
            return None
        return self.uncertainty.region

    @property
    def uncertainty(self) -> Uncertainty | None:
        """The first uncertainty that the gains of a law are computed from, if one is declared."""
        for name in (*self._declared, *self.file.laws):
            declared = self.file.law(name).numbers.get("uncertainty", {})
            # The uncertainties of laws on the linearization have no region.
            if "region" in declared:
                names: Sequence[str] = ()
                if isinstance(declared["region"], dict):
                    names = self._error_names(name)
                return uncertainty(declared, names=names)
        return None

    def _error_names(self, law: str) -> Sequence[str]:
        """Names of the entries of the error state of a law."""
        return self.law(self.plant_names[0], law).designed.error.names

    @property
    def realization(self) -> Realization:
        """Realization of a sliding mode law for which the file gives none."""
        return self._realization(self.settings.switching, self.settings.surface, {})

    def _realization_of(self, table: ControllerTable, controller: Controller) -> Realization:
        """Return the realization in a law's table, unless a setting was asked for."""
        written = {"switching", "surface"} & table.model_fields_set
        if controller.design is None or not controller.design.switching:
            if written:
                names = ", ".join(sorted(written))
                raise ArgumentError(f"it does not switch, so it has no {names}")
            return AS_PRINTED

        counting = written - self.asked
        switching = table.switching if "switching" in counting else self.settings.switching
        surface = table.surface if "surface" in counting else self.settings.surface
        numbers = {} if is_named(table.law) else switching_numbers(table, switching)
        return self._realization(switching, surface, numbers)

    def _realization(self, switching: str, surface: str, numbers: Mapping[str, Any]) -> Realization:
        """Return a realization by the names of switching law and surface, and a law's numbers."""
        of_task = {}
        if self.file.task.slope is not None:
            of_task["slope"] = self.file.task.slope
        law = find_switching(switching, **{**of_task, **numbers})
        if surface == "discrete":
            return Realization(law, self.settings.control_period)
        return Realization(law, None)

    def changed(
        self,
        numbers: Mapping[str, Any] | None = None,
        *,
        laws: Sequence[str] | None = None,
        **values: Any,
    ) -> Experiment:
        """Return a copy with other numbers, laws, settings or attributes; all else stays.

        Args:
            numbers: New values by their paths OWNER.NAME.FIELD, as if the file had them:
                ``edit.pole.mass``, ``sensor.pole angle.delay``, ``laws.grosmc.k``,
                ``run.duration``; two tables of one name need an index, ``edit.pole[2].mass``. A
                value is a number in the unit of the file's key, or a text with a unit. An edit
                that the file does not have is added.
            laws: Controllers and ``[laws]`` of the file that are run; none for all controllers.
            values: Fields of ``Settings``, of which those that are None stay, and attributes,
                such as ``x0``, ``duration``, ``edits``, ``disturbances``, whose laws stay. A time
                is a number [s] or a text with a unit.

        Raises:
            ArgumentError: If there is no such path, law, setting or attribute, or the file could
                not have the value.
        """
        changed = self._copy([*self._changes_of(values)])
        if laws is not None:
            changed = changed._copy(changed._changes_of_laws(laws))
        if numbers:
            changed = changed._changed_numbers(numbers)
            varied = tuple(dict.fromkeys([*self.varied, *numbers]))
            changed = replace(changed, varied=varied)
        return changed

    def __repr__(self) -> str:
        """Return case, file, start, laws, and counts of what the file adds, in a few lines."""
        states = self.nominal.system.states
        start = ", ".join(
            f"{state.name} {value:.4g}{unit_after(state.unit)}"
            for state, value in zip(states, self.x0, strict=True)
        )
        counts = {
            "edit": len(self.edits),
            "disturbance": len(self.disturbances),
            "requirement": len(self.file.requirement),
        }
        added = ", ".join(f"{count} [[{kind}]]" for kind, count in counts.items())
        lines = [
            f"Experiment {self.target}: {self.title}",
            f"{self.path}: {added}, {'ideal loop' if self.loop is None else 'a loop'}",
            f"{self.duration:g} s from {start}",
            f"laws {name_list(self.controllers)}; plants {', '.join(self.plant_names)}",
        ]
        if self.varied:
            lines.append(f"changed: {', '.join(self.varied)}")
        return "\n".join(lines)

    def _copy(self, changes: Sequence[Change]) -> Experiment:
        """Return a copy with other values at some steps; for another task it has new designs."""
        copy = with_values(self, changes)
        before = self._designed_for
        if all(part is other for part, other in zip(before, copy._designed_for, strict=True)):
            return copy
        return replace(copy, _designs=_designs_for(copy.file, copy.nominal.system))

    @property
    def _designed_for(self) -> tuple[Any, ...]:
        """Task and nominal plant of the laws."""
        nominal = self.nominal
        return self.file.task, nominal.plant, nominal.believed, nominal.at

    def _changes_of(self, values: Mapping[str, Any]) -> Iterator[Change]:
        """Yield the changes of settings and attributes.

        Raises:
            ArgumentError: If there is no such one, or equations get edits of a model.
        """
        attributes = [item.name for item in fields(self) if item.init]
        settings = vars(self.settings)
        asked = set()
        for name, value in values.items():
            require_known("attribute or setting", name, [*settings, *attributes])
            if name in _TIMES and isinstance(value, str):
                with placed(f"{name}: "):
                    value = number_in(value, "s")
            if name in attributes:
                yield (name,), value
            elif value is not None:
                asked.add(name)
                yield ("settings", name), value
        if asked:
            yield ("asked",), self.asked | asked
        if values.get("edits") and not self.nominal.has_model:
            raise ArgumentError(
                f"{self.system} has no model in MuJoCo to edit: change a parameter, with "
                'changed({"edit.NAME.scale": ...})'
            )

    def _changes_of_laws(self, names: Sequence[str]) -> list[Change]:
        """Return the changes for runs of some laws only, which become controllers of the file.

        Raises:
            ArgumentError: If there is no such law.
        """
        further = [name for name in self.file.laws if name not in self._declared]
        valid = [*self._declared, *further]
        for name in names:
            require_known("law", name, valid)

        added = [name for name in further if name in names]
        tables = [*self.file.controller, *(ControllerTable(law=name) for name in added)]
        file = self.file.model_copy(update={"controller": tables})
        rows = [*self.file.content["controller"], *({"law": name} for name in added)]
        file._content = {**self.file.content, "controller": rows}
        chosen = tuple(name for name in valid if name in names)
        return [(("file",), file), (("chosen",), chosen)]

    def _changed_numbers(self, numbers: Mapping[str, Any]) -> Experiment:
        """Return a copy with other numbers by their paths, see ``changed``."""
        self._refuse_overruled(numbers)
        content = deepcopy(self.file.content)
        places = {path: place_of(self.file.content, path) for path in numbers}
        owners = {place.owner for place in places.values()}
        if "motor" in owners:
            # Laws go on with the motors of the file.
            keep_known_motors(content)
            owners.add("known_motor")
        for path, value in numbers.items():
            number = find_number(self, path, places[path]) if places[path].in_weight else None
            if number is not None:
                number.write(content, number.read(value))
            else:
                places[path].write(content, in_units(value))
        with placed(""):
            file = case_file_of(content, self.path)

        changes: list[Change] = []
        others = False
        for path, value in numbers.items():
            # Laws and requirements are made from the tables, which have the value by now.
            if places[path].owner in OF_FILE:
                continue
            number = find_number(self, path, places[path])
            if number is None:
                others = True
            else:
                changes += number.changes(self, number.read(value))
        if others:
            changes += self._changes_of_file(file, places.values())

        # A campaign's file keeps its other tables.
        tables = self.file.model_copy(update={owner: getattr(file, owner) for owner in owners})
        tables._content = content
        changed = self._copy([*changes, (("file",), tables)])
        loop = changed.loop
        if loop is None and any(getattr(tables, kind) for kind in LOOP_PARTS):
            # The file's loop was taken away: laws that predict over it stay.
            loop = Loop()
        refuse_inconsistent(tables, changed.nominal, loop, changed.settings)
        return changed

    def _changes_of_file(self, file: CaseFile, places: Collection[Place]) -> Iterator[Change]:
        """Yield the changes of values that differ in another file: lists, texts, switches.

        Args:
            file: The file with other values.
            places: Places of the values.
        """
        before = Experiment.of_file(case_file_of(self.file.content, self.path), self.path)
        after = Experiment.of_file(file, self.path)
        for name in (*_OF_FILE, "settings"):
            for steps, value in differences(getattr(before, name), getattr(after, name)):
                yield (name, *steps), value
        for place in places:
            if place.owner == "run" and hasattr(after.settings, place.field):
                yield ("settings", place.field), getattr(after.settings, place.field)
        if {"edit", "plant", "design"} & {place.owner for place in places}:
            yield ("nominal",), replace(after.nominal, scales=self.nominal.scales)

    def _refuse_overruled(self, paths: Iterable[str]) -> None:
        """Refuse changes of a controller's number that a setting for all laws replaces."""
        for path in paths:
            name = path.rpartition(".")[2]
            if path.startswith("controller.") and name in self.asked:
                raise ArgumentError(
                    f"{path!r}: {name} is set for all laws: leave it out of changed({name}=...)"
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
        with placed(f"{self.path}: "), blamed(self.path.parent):
            # Compiled code does not say where a law fails, or that it does.
            require_answer(controller, np.array(self.x0), len(self.nominal.system.inputs))
            result = run_on(self, plant, controller, true, loop)
            # A reference that has no value at some time of the run is refused here.
            _ = result.metrics
            return result

    def runs(self) -> Iterator[RunResult]:
        """Run every controller on every plant, one by one; raises as ``run`` does."""
        for plant in self.plant_names:
            for name in self.controllers:
                yield self.run(plant, name)

    @property
    def record_size(self) -> int:
        """Size of the records of all runs together, each controller on each plant [byte]."""
        settings = self.settings
        size = 0
        for plant in self.plant_names:
            for name in self.controllers:
                # The width of a record does not depend on its length.
                problem, _ = prepare(
                    self.plant(plant),
                    self.law(plant, name),
                    self.x0,
                    loop=self.applied_loop(plant, name),
                    duration=settings.timestep,
                    control_period=settings.control_period,
                    timestep=settings.timestep,
                    disturbances=self.disturbances,
                )
                size += problem.row_size * (self.steps + 1)
        return size

    @property
    def steps(self) -> int:
        """Number of timesteps of a run.

        Raises:
            ArgumentError: If they are too many.
        """
        return number_of_steps(self.duration, self.settings.timestep)

    def document(self) -> dict[str, Any]:
        """Return the resolved file as plain values."""
        return self.file.model_dump(exclude_none=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class RunResult(MeasuredRun):
    """A run of an experiment, with its requirements and its film.

    Attributes:
        case: The experiment.
        judged: Judgements over several draws of its loop; of this run alone by default.
    """

    case: Experiment
    plant: PlantName
    judged: tuple[Judgement, ...] | None = None

    @property
    def key(self) -> str:
        """Name of the run in files: system/case/plant/controller."""
        return "/".join((self.case.system, self.case.name, self.plant, self.controller.name))

    # A page, a figure and a document ask for them.
    @cached_property
    def requirements(self) -> list[Judgement]:
        """Judgements of this run, or of its draws, by the experiment's requirements."""
        if self.judged is not None:
            return list(self.judged)
        return judge_runs(self.case.limits, [self])

    @property
    def kept(self) -> bool | None:
        """Whether all requirements of the law are kept; None if nothing is required of it."""
        if not self.requirements:
            return None
        return all(judgement.kept for judgement in self.requirements)

    def film(self, path: str | Path) -> Path:
        """Write a film of the run, and return its path.

        Raises:
            ArgumentError: If the run is not on physics.
            SetupError: If it cannot be rendered or written.
        """
        from grosmc_mj.experiments.films import film_of, write_case_film

        film = film_of([self])
        return write_case_film(self.case, film, Path(path)).film

    def __repr__(self) -> str:
        """Return case, end, metrics, costs and requirements in five lines."""
        end = f"{self.status.name.lower()} at {self.trajectory.time[-1]:g} s"
        if self.ended:
            end += f": {self.ended}"
        metrics = [
            f"{spelled(name)} {_with_unit(self.metrics[name])}"
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
    run, ended = _simulated(case, law, plant, loop)
    return RunResult(
        case=case,
        plant=name,
        controller=law,
        trajectory=with_acting(run, plant),
        ended=ended,
        true=plant,
    )


def _simulated(
    case: Experiment, law: Controller, plant: Plant, loop: AppliedLoop | None
) -> tuple[Trajectory, str]:
    """Return a run of a case, and the reason why it ended early, if it did."""
    settings = case.settings
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
        return error.trajectory, str(error)
    return run, ""


def _with_unit(metric: Metric) -> str:
    """Return a metric with its unit, or the reason why it has no value."""
    if metric.value is None:
        return f"- ({metric.note})"
    return f"{metric.value:.4g}{unit_after(metric.unit)}"


def _designs_for(file: CaseFile, system: System) -> dict[Any, Controller]:
    """Return the designs of a file's laws so far: files with one task and plant share them."""
    if file.plant.system is None or named_in(file):
        return {}
    task = (file.plant.system, edits_of(file, system, known=True), file.task)
    return _shared_designs.setdefault(repr(task), {})
