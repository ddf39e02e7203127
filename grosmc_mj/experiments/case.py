"""A case: a file as values, with its plants, laws and requirements."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.switching import SwitchingNumbers, find_switching
from grosmc_mj.control.task import AS_PRINTED, Realization
from grosmc_mj.control.uncertainty.outputs import Uncertainty
from grosmc_mj.errors import (
    ArgumentError,
    GrosmcError,
    Mistakes,
    MistakesError,
)
from grosmc_mj.experiments.file.numbers import in_order, uncertainty
from grosmc_mj.experiments.file.schema import CaseFile, ControllerTable, RequirementTable
from grosmc_mj.experiments.file.user_code import is_named
from grosmc_mj.experiments.laws import design
from grosmc_mj.experiments.plants import NominalPlant, PlantName, design_variant
from grosmc_mj.experiments.requirements import requirements_in
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.loop import AppliedLoop, Loop, apply_loop
from grosmc_mj.loop.timing import stride_of
from grosmc_mj.machine import MachinePart
from grosmc_mj.physics.edit import Edit
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.requirements.judging import decidable, transient_of_runs
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.simulation.problem import Plant

# Claims and campaigns ask for the same controllers thousands of times.
_apply_loop = lru_cache(maxsize=512)(apply_loop)
_realized = lru_cache(maxsize=512)(realized)
_sampled = lru_cache(maxsize=512)(Controller.sampled)


@dataclass(frozen=True, eq=False)
class Case:
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
    _designs: dict[Any, Controller] = field(default_factory=dict, repr=False)

    @property
    def system(self) -> str:
        """Name of the system."""
        return self.nominal.system.name

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return f"{self.system}/{self.name}"

    @property
    def design(self) -> str:
        """Name of its laws together; empty for the system's name."""
        return self.file.task.name

    @property
    def key(self) -> tuple[Any, ...]:
        """Key that differs between cases: the file of the laws, and what happens to the plant."""
        return (
            self.path,
            self.name,
            self.x0,
            self.duration,
            self.edits,
            self.disturbances,
            self.loop,
            self.known_loop,
            self.run_number,
        )

    @property
    def parts(self) -> tuple[MachinePart, ...]:
        """Edits that are parts of a machine as built."""
        return tuple(edit for edit in self.edits if isinstance(edit, MachinePart))

    @property
    def onset(self) -> float:
        """Onset of the first disturbance [s]; infinite if there is none."""
        onsets = [disturbance.window[0] for disturbance in self.disturbances]
        return min(onsets, default=math.inf)

    @property
    def on_machine(self) -> bool:
        """Whether its plant has parts of a machine as built."""
        return bool(self.parts)

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
        onsets = [(item.window[0], item.window[0]) for item in self.disturbances]
        return decidable(self.required, transient_of_runs(self.duration, onsets))

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
        required = []
        mistakes = Mistakes()
        for index, table in enumerate(tables):
            with mistakes.gathered(f"{kind} {index + 1}: "):
                required += self._limits_of(table, laws)
        mistakes.refuse()
        return required

    def _limits_of(self, table: RequirementTable, laws: Sequence[Controller]) -> list[Requirement]:
        """Return the limits in a table."""
        for name in table.of or ():
            require_known("controller", name, self._declared)
        for name in table.on or ():
            require_known("plant", name, self.plant_names)
        end = self.file.run.duration
        if 0 < end <= table.after:
            raise ArgumentError(
                f"after = {table.after:g} s must be before the end of a run at {end:g} s"
            )
        required = requirements_in(table, laws, self.plant_names, self.duration)
        for requirement in required:
            requirement.refuse_start(laws[0], self.x0)
            requirement.refuse_duration(self.duration)
        return required

    def checked(self) -> Self:
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
        table = self.file.law(name)
        try:
            controller = self._design(table, plant)
            realization = self._realization_of(table, controller)
            return _sampled(_realized(controller, realization), self.settings.control_period)
        except GrosmcError as error:
            owner = "" if str(error).startswith("task: ") else f"controller {name}: "
            raise ArgumentError(f"{owner}{error}") from error

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
        try:
            return self.loop_around(
                controller,
                self.loop,
                predict=self.predicts(name),
                run=self.run_number,
            )
        except GrosmcError as error:
            raise ArgumentError(f"controller {name}: {error}") from error

    def predicts(self, name: str) -> bool:
        """Whether a controller of the file, or a law by its name, knows its loop."""
        return bool(self.file.law(name).predict)

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

    def _design(self, table: ControllerTable, plant: PlantName) -> Controller:
        """Return the controller of a table, designed once for all plants with one variant."""
        period = self.settings.control_period
        # Only a user's own law may depend on the control period.
        key = design_variant(plant), repr(table), period if is_named(table.law) else 0.0
        if key not in self._designs:
            self._designs[key] = design(
                table, self.file, self.nominal, plant, self.path.parent, period
            )
        return self._designs[key]

    def law_for(self, nominal: AnalyticPlant, name: str) -> Controller:
        """Return a law by its name, designed for a nominal plant that is not the file's.

        Raises:
            GrosmcError: As for ``law``.
        """
        table = self.file.law(name)
        controller = design(
            table,
            self.file,
            NominalPlant(nominal),
            "corrected",
            self.path.parent,
            self.settings.control_period,
        )
        return _realized(controller, self._realization_of(table, controller))

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
    def slope(self) -> float:
        """L of the super-twisting law, in the unit of s per second squared."""
        return self.file.task.slope or SwitchingNumbers.slope

    @property
    def realization(self) -> Realization:
        """Realization of a sliding mode law for which the file gives none."""
        return self._realization(self.settings.switching, self.settings.surface)

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
        return self._realization(switching, surface)

    def _realization(self, switching: str, surface: str) -> Realization:
        """Return a realization by the names of switching law and surface."""
        law = find_switching(switching, slope=self.slope)
        if surface == "discrete":
            return Realization(law, self.settings.control_period)
        return Realization(law, None)

    def with_settings(self, **changes: Any) -> Self:
        """Return a copy with other settings.

        Args:
            changes: Fields of ``Settings``; those that are None stay as they are in the file.

        Raises:
            ArgumentError: If there is no such setting, or it has no such value.
        """
        chosen = {name: value for name, value in changes.items() if value is not None}
        for name in chosen:
            require_known("setting", name, vars(self.settings))
        settings = replace(self.settings, **chosen)
        return replace(self, settings=settings, asked=self.asked | chosen.keys())

    def with_laws(self, names: Sequence[str]) -> Self:
        """Return a copy that runs some laws only.

        Args:
            names: Controllers and ``[laws]`` of the file; none for all controllers.

        Raises:
            ArgumentError: If there is no such law.
        """
        further = [name for name in self.file.laws if name not in self._declared]
        valid = [*self._declared, *further]
        for name in names:
            require_known("law", name, valid)

        added = [ControllerTable(law=name) for name in further if name in names]
        file = self.file.model_copy(update={"controller": [*self.file.controller, *added]})
        chosen = tuple(name for name in valid if name in names)
        return replace(self, file=file, chosen=chosen)

    def varied(self, **changes: Any) -> Self:
        """Return a copy with the same laws and other values.

        Args:
            changes: Attributes, such as ``x0``, ``duration``, ``edits``, ``disturbances``.
        """
        return replace(self, **changes)
