"""Cached runs for the claims, and faults by which the claims themselves are tested."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult, Settings, run_on
from grosmc_mj.physics.edits import Edit
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory


def _unchanged(value: Any, *_context: Any) -> Any:
    """Return the first argument."""
    return value


@dataclass(frozen=True)
class Fault:
    """A fault of the laboratory, which the claims must notice.

    Attributes:
        name: Short name.
        what: Name in words.
        controller: Change of a controller, given its experiment and the name of its plant.
        experiment: Change of an experiment.
        plant: Change of a plant, given the experiment and the plant's name.
        settings: Change of the settings.
    """

    name: str
    what: str
    controller: Callable[[Controller, Experiment, PlantName], Controller] = _unchanged
    experiment: Callable[[Experiment], Experiment] = _unchanged
    plant: Callable[[Plant, Experiment, PlantName], Plant] = _unchanged
    settings: Callable[[Settings], Settings] = _unchanged


SOUND = Fault("none", "nothing is wrong")


class Laboratory:
    """Cache of the runs that claims ask for.

    Args:
        settings: Settings of all runs; each that is not the default replaces the experiment's own.
        fault: A fault, by which the claims themselves are tested.
        known: Results of earlier runs, without a fault and with these settings.
        number: A key of the case files and the value that replaces theirs.
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
        self._runs: dict[Any, RunResult] = {}
        for result in known:
            key = (*result.experiment.key, result.plant, result.controller.name)
            self._runs[key] = result
        self._cache: dict[Any, Any] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the laboratory for another process, without the runs made here."""
        return Laboratory, (self.settings, self._same_fault, (), self._number)

    @property
    def refined(self) -> Laboratory:
        """Laboratory with half the timestep and half the control period."""
        finer = replace(
            self.settings,
            timestep=self.settings.timestep / 2,
            control_period=self.settings.control_period / 2,
        )
        return self.once(
            "refined", lambda: Laboratory(finer, self._same_fault, number=self._number)
        )

    @property
    def _same_fault(self) -> Fault:
        """The fault for a laboratory whose settings have been changed by it already."""
        return replace(self._fault, settings=_unchanged)

    def varied(self, key: str, value: Any) -> Laboratory:
        """Return a laboratory with another number in every file, see ``Experiment.changed``."""
        return self.once(
            ("varied", key, repr(value)),
            lambda: Laboratory(self.settings, self._same_fault, number=(key, value)),
        )

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return the cached value of a key, which ``make`` computes the first time."""
        if key not in self._cache:
            self._cache[key] = make()
        return self._cache[key]

    def run(self, experiment: Experiment, plant: PlantName, controller: str) -> RunResult:
        """Run an experiment on a plant under a controller designed for it."""
        key = (*experiment.key, plant, controller)
        if key not in self._runs:
            law = self.controller(experiment, plant, controller)
            self._runs[key] = self.run_with(experiment, plant, law)
        return self._runs[key]

    def run_misdesigned(
        self, experiment: Experiment, plant: PlantName, controller: str, believed: PlantName
    ) -> RunResult:
        """Run an experiment under a controller designed for another plant."""
        law = self.controller(experiment, plant, controller, believed)
        key = ("misdesigned", experiment.key, plant, controller, believed)
        return self.once(key, lambda: self.run_with(experiment, plant, law))

    def run_with(self, experiment: Experiment, plant: PlantName, law: Controller) -> RunResult:
        """Run an experiment under a given controller, with the fault."""
        return run_on(self._with_fault(experiment), plant, law, self.plant(experiment, plant))

    def case(self, system: str, name: str, plant: PlantName, controller: str) -> RunResult:
        """Run a case of the package by name."""
        return self.run(find_experiment(system, name), plant, controller)

    def controller(
        self, experiment: Experiment, plant: PlantName, name: str, believed: PlantName | None = None
    ) -> Controller:
        """Return a controller designed for ``believed``, by default the plant it runs on."""
        law = self.as_set(experiment).law(believed or plant, name)
        return self._fault.controller(law, experiment, plant)

    def plant(self, experiment: Experiment, name: PlantName) -> Plant:
        """Return a plant with the laboratory's settings and fault."""
        return self._fault.plant(self.as_set(experiment).plant(name), experiment, name)

    def equations(self, experiment: Experiment, name: PlantName) -> AnalyticPlant:
        """Return the corrected equations of ``plant``, or the plant if it is equations."""
        return self.plant(experiment, name).analytic()

    def batch(
        self, experiments: Sequence[Experiment], plant: PlantName, controller: str
    ) -> tuple[Controller, Trajectory]:
        """Run experiments of one system and duration at once.

        Args:
            experiments: The experiments, n of them.
            plant: Name of the plant of all.
            controller: Name of the controller of all, designed for the first experiment.

        Returns:
            The controller, and the trajectories, (n,).
        """
        law = self.controller(experiments[0], plant, controller)
        with_fault = [self._with_fault(experiment) for experiment in experiments]
        settings = with_fault[0].settings
        trajectories = simulate(
            [self.plant(experiment, plant) for experiment in experiments],
            law,
            [experiment.case.x0 for experiment in with_fault],
            duration=experiments[0].case.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=[experiment.case.disturbances for experiment in with_fault],
            engine=settings.engine_for(law),
        )
        return law, trajectories

    def as_set(self, experiment: Experiment) -> Experiment:
        """Return an experiment with the laboratory's settings and number."""
        changes = self.settings.changes()
        if experiment.case.loop is not None:
            # A loop keeps its own control period; physics can be finer, but no coarser than its
            # delays.
            finer = min(1.0, self.settings.timestep / Settings().timestep)
            changes["timestep"] = experiment.settings.timestep * finer
            changes.pop("control_period", None)
        with_settings = experiment.with_settings(**changes)
        if self._number is None:
            return with_settings
        key, value = self._number
        designs = self.once(("designs", experiment.path.parent), dict)
        return with_settings.changed(key, value, designs)

    def _with_fault(self, experiment: Experiment) -> Experiment:
        """Return an experiment with the laboratory's settings and fault."""
        return self._fault.experiment(self.as_set(experiment))


def trial(
    system: str,
    name: str,
    x0: tuple[float, ...],
    duration: float,
    edits: tuple[Edit, ...] = (),
    disturbances: tuple[Disturbance, ...] = (),
) -> Experiment:
    """Return an experiment that is not in the chapter, under the laws of the nominal case.

    Args:
        system: Name of the system.
        name: Name and title of the case.
        x0: Start, (n,).
        duration: Duration [s].
        edits: Edits of the plant.
        disturbances: Wrenches on the plant.
    """
    return find_experiment(system, "nominal").varied(
        name=name,
        title=name,
        source="this project",
        x0=x0,
        duration=duration,
        edits=edits,
        disturbances=disturbances,
    )
