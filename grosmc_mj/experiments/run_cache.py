"""Cached runs for the claims."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from dataclasses import replace
from typing import Any

from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment, RunResult, run_on
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.simulation.disturbances import AnyDisturbance
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import AnalyticPlant, Plant


class RunCache:
    """Runs that the claims share, each made once.

    A subclass may override ``controller``, ``plant`` and ``as_set``: so tests put faults in.

    Args:
        settings: How experiments are run: what is not the default counts instead of their own.
        known: Results that are there already, made with these settings.
        number: A key of the case files and the value that counts instead of theirs.
    """

    def __init__(
        self,
        settings: Settings,
        known: Iterable[RunResult] = (),
        number: tuple[str, Any] | None = None,
    ) -> None:
        self.settings = settings
        self._number = number
        self._runs: dict[Any, RunResult] = {
            (result.case.key, result.plant, result.controller.name): result for result in known
        }
        self._kept: dict[Any, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        """Attributes of a copy, here or in another process, which has no runs yet."""
        return {**vars(self), "_runs": {}, "_kept": {}}

    @property
    def refined(self) -> RunCache:
        """Copy with half the timestep and half the control period."""
        finer = replace(
            self.settings,
            timestep=self.settings.timestep / 2,
            control_period=self.settings.control_period / 2,
        )
        return self.once("refined", lambda: self._with(settings=finer))

    def varied(self, key: str, value: Any) -> RunCache:
        """Copy with another number in every case file, see ``Experiment.changed``."""
        return self.once(
            ("varied", key, repr(value)),
            lambda: self._with(_number=(key, value)),
        )

    def _with(self, **attributes: Any) -> RunCache:
        """Copy with other attributes and without the runs made here."""
        other = copy(self)
        vars(other).update(attributes)
        return other

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the result of ``make``, which is called the first time that a key is asked for."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def run(self, experiment: Experiment, plant: PlantName, controller: str) -> RunResult:
        """An experiment on a plant under a controller designed for it."""
        key = (experiment.key, plant, controller)
        if key not in self._runs:
            law = self.controller(experiment, plant, controller)
            self._runs[key] = self.run_with(
                experiment, plant, law, predict=experiment.predicts(controller)
            )
        return self._runs[key]

    def run_with(
        self,
        experiment: Experiment,
        plant: PlantName,
        law: Controller,
        *,
        predict: bool = False,
    ) -> RunResult:
        """A run under this very law, which knows the experiment's loop or not."""
        used = self.as_set(experiment)
        loop = None
        if used.loop is not None:
            loop = used.loop_around(law, used.loop, predict=predict, run=used.run_number)
        return run_on(used, plant, law, self.plant(experiment, plant), loop)

    def case(
        self,
        system: str,
        name: str,
        plant: PlantName,
        controller: str,
    ) -> RunResult:
        """One of the chapter's cases, by name."""
        return self.run(find_experiment(system, name), plant, controller)

    def controller(self, experiment: Experiment, plant: PlantName, name: str) -> Controller:
        """Controller designed for the plant that it runs on."""
        return self.as_set(experiment).law(plant, name)

    def plant(self, experiment: Experiment, name: PlantName) -> Plant:
        """Plant of that name with the edits of an experiment."""
        return self.as_set(experiment).plant(name)

    def equations(self, experiment: Experiment, name: PlantName) -> AnalyticPlant:
        """Corrected equations of a plant in MuJoCo, or the equations that it is."""
        return self.plant(experiment, name).analytic()

    def as_set(self, experiment: Experiment) -> Experiment:
        """Experiment with the settings of this cache and its number."""
        changes = self.settings.changes()
        if experiment.loop is not None:
            # A loop's pace is its own; physics can be finer, but no coarser than its delays.
            finer = min(1.0, self.settings.timestep / Settings().timestep)
            changes["timestep"] = experiment.settings.timestep * finer
            changes.pop("control_period", None)
        used = experiment.changed(**changes)
        if self._number is None:
            return used
        key, value = self._number
        return used.changed({key: value})


def trial(
    system: str,
    name: str,
    x0: tuple[float, ...],
    duration: float,
    edits: tuple[Edit, ...] = (),
    disturbances: tuple[AnyDisturbance, ...] = (),
) -> Experiment:
    """An experiment of this project's own, beside the chapter's, under the nominal case's laws."""
    return find_experiment(system, "nominal").changed(
        name=name,
        title=name,
        source="this project",
        x0=x0,
        duration=duration,
        edits=edits,
        disturbances=disturbances,
    )
