"""Where claims are measured: runs that are made once for all, and what may be wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult, Settings, run_on
from grosmc_mj.physics.edit import Edit
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Fault:
    """Something wrong with the laboratory, which the claims must notice.

    Attributes:
        name: Short name.
        what: In words.
        controller: What it makes of a controller, of an experiment and a plant.
        experiment: What it makes of an experiment.
        plant: What it makes of a plant of that name for that experiment.
        settings: What it makes of the settings.
    """

    name: str
    what: str
    controller: Callable[[Controller, Experiment, PlantName], Controller] = (
        lambda law, _experiment, _name: law
    )
    experiment: Callable[[Experiment], Experiment] = lambda experiment: experiment
    plant: Callable[[Plant, Experiment, PlantName], Plant] = lambda plant, _experiment, _name: plant
    settings: Callable[[Settings], Settings] = lambda settings: settings


SOUND = Fault("none", "nothing is wrong")


class Laboratory:
    """Makes the runs that claims ask for, each once.

    Args:
        settings: How experiments are run: what is not the default counts instead of their own.
        fault: What is wrong, to try the claims themselves.
        number: A key of the case files and the value that counts instead of theirs.
        known: Results that are there already; of a sound laboratory with these settings only.
    """

    def __init__(
        self,
        settings: Settings,
        fault: Fault = SOUND,
        known: Iterable[RunResult] = (),
        number: tuple[str, Any] | None = None,
    ) -> None:
        self.settings = fault.settings(settings)
        self._fault = fault
        self._number = number
        self._runs: dict[Any, RunResult] = {
            (*result.experiment.key, result.plant, result.controller.name): result
            for result in known
        }
        self._kept: dict[Any, Any] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """What another process gets: the same laboratory, without the runs made here."""
        return Laboratory, (self.settings, self._same_fault, (), self._number)

    @cached_property
    def refined(self) -> Laboratory:
        """The same laboratory with half the timestep and half the control period."""
        finer = replace(
            self.settings,
            timestep=self.settings.timestep / 2,
            control_period=self.settings.control_period / 2,
        )
        return Laboratory(finer, self._same_fault, number=self._number)

    @property
    def _same_fault(self) -> Fault:
        """What is wrong, for a laboratory whose settings have it already."""
        return replace(self._fault, settings=lambda settings: settings)

    def varied(self, key: str, value: Any) -> Laboratory:
        """The same with another number in every case file, see ``Experiment.changed``."""
        return self.once(
            ("varied", key, repr(value)),
            lambda: Laboratory(self.settings, self._same_fault, number=(key, value)),
        )

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """What ``make`` gives, made the first time that the key is asked for."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def run(self, experiment: Experiment, plant: PlantName, controller: str) -> RunResult:
        """An experiment on a plant under a controller designed for it."""
        key = (*experiment.key, plant, controller)
        if key not in self._runs:
            law = self.controller(experiment, plant, controller)
            self._runs[key] = self.run_with(experiment, plant, law)
        return self._runs[key]

    def run_misdesigned(
        self, experiment: Experiment, plant: PlantName, controller: str, believed: PlantName
    ) -> RunResult:
        """An experiment under a controller designed for another plant."""
        law = self.controller(experiment, plant, controller, believed)
        key = ("misdesigned", experiment.key, plant, controller, believed)
        return self.once(key, lambda: self.run_with(experiment, plant, law))

    def run_with(self, experiment: Experiment, plant: PlantName, law: Controller) -> RunResult:
        """A run under this very law, with what is wrong."""
        return run_on(self._used(experiment), plant, law, self.plant(experiment, plant))

    def case(self, system: str, name: str, plant: PlantName, controller: str) -> RunResult:
        """One of the chapter's cases, by name."""
        return self.run(find_experiment(system, name), plant, controller)

    def controller(
        self, experiment: Experiment, plant: PlantName, name: str, believed: PlantName | None = None
    ) -> Controller:
        """A controller as it is used: designed for a plant, or for another one if named."""
        law = self.as_set(experiment).law(believed or plant, name)
        return self._fault.controller(law, experiment, plant)

    def plant(self, experiment: Experiment, name: PlantName) -> Plant:
        """A plant as it is used."""
        return self._fault.plant(self.as_set(experiment).plant(name), experiment, name)

    def equations(self, experiment: Experiment, name: PlantName) -> AnalyticPlant:
        """The corrected equations of a plant as it is used, or the equations that it is."""
        return self.plant(experiment, name).analytic()

    def batch(
        self, experiments: Sequence[Experiment], plant: PlantName, controller: str
    ) -> tuple[Controller, Trajectory]:
        """Experiments of one system and duration at once, and the law that they ran under."""
        law = self.controller(experiments[0], plant, controller)
        used = [self._used(experiment) for experiment in experiments]
        settings = used[0].settings
        run = simulate(
            [self.plant(experiment, plant) for experiment in experiments],
            law,
            [experiment.case.x0 for experiment in used],
            duration=experiments[0].case.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=[experiment.case.disturbances for experiment in used],
            engine=settings.engine_for(law),
        )
        return law, run

    def as_set(self, experiment: Experiment) -> Experiment:
        """An experiment with the laboratory's settings and its number."""
        changes = self.settings.changes()
        if experiment.case.loop is not None:
            # A loop's pace is its own; physics can be finer, but no coarser than its delays.
            finer = min(1.0, self.settings.timestep / Settings().timestep)
            changes["timestep"] = experiment.settings.timestep * finer
            changes.pop("control_period", None)
        used = experiment.with_settings(**changes)
        if self._number is None:
            return used
        designs = self.once(("designs", experiment.path.parent), dict)
        return used.changed(*self._number, designs)

    def _used(self, experiment: Experiment) -> Experiment:
        """An experiment as it is run, with what is wrong."""
        return self._fault.experiment(self.as_set(experiment))


def trial(
    system: str,
    name: str,
    x0: tuple[float, ...],
    duration: float,
    edits: tuple[Edit, ...] = (),
    disturbances: tuple[Disturbance, ...] = (),
) -> Experiment:
    """An experiment of this project's own, beside the chapter's, under the nominal case's laws."""
    return find_experiment(system, "nominal").varied(
        name=name,
        title=name,
        source="this project",
        x0=x0,
        duration=duration,
        edits=edits,
        disturbances=disturbances,
    )
