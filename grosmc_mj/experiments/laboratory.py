"""Where claims are measured: runs that are made once for all, and what may be wrong with them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.case import Case, find_case
from grosmc_mj.experiments.runs import (
    PlantName,
    RunResult,
    Settings,
    case_plant,
    design_variant,
    nominal_controller,
    run_on,
)
from grosmc_mj.plants import AnalyticPlant, Plant, Variant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.edits import Edit
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Fault:
    """Something wrong with the laboratory, which the claims must notice.

    Attributes:
        name: Short name.
        what: In words.
        controller: What it makes of a controller, of a case and a plant.
        case: What it makes of a case.
        plant: What it makes of a plant of that name for that case.
        settings: What it makes of the settings.
    """

    name: str
    what: str
    controller: Callable[[Controller, Case, PlantName], Controller] = lambda law, _case, _name: law
    case: Callable[[Case], Case] = lambda case: case
    plant: Callable[[Plant, Case, PlantName], Plant] = lambda plant, _case, _name: plant
    settings: Callable[[Settings], Settings] = lambda settings: settings


SOUND = Fault("none", "nothing is wrong")


class Laboratory:
    """Makes the runs that claims ask for, each once.

    Args:
        settings: How cases are run.
        fault: What is wrong, to try the claims themselves.
        known: Results that are there already; of a sound laboratory with these settings only.
    """

    def __init__(
        self, settings: Settings, fault: Fault = SOUND, known: Iterable[RunResult] = ()
    ) -> None:
        self.settings = fault.settings(settings)
        self._fault = fault
        self._runs: dict[tuple[Case, PlantName, str], RunResult] = {
            (result.case, result.plant, result.controller.name): result for result in known
        }
        self._kept: dict[Any, Any] = {}

    @cached_property
    def refined(self) -> Laboratory:
        """The same laboratory with half the timestep and half the control period."""
        finer = replace(
            self.settings,
            timestep=self.settings.timestep / 2,
            control_period=self.settings.control_period / 2,
        )
        return Laboratory(finer, replace(self._fault, settings=lambda settings: settings))

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """What ``make`` gives, made the first time that the key is asked for."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def run(self, case: Case, plant: PlantName, controller: str) -> RunResult:
        """A case on a plant under a controller designed for it."""
        key = (case, plant, controller)
        if key not in self._runs:
            law = self.controller(case, plant, controller)
            self._runs[key] = self._run(case, plant, law)
        return self._runs[key]

    def run_misdesigned(
        self, case: Case, plant: PlantName, controller: str, variant: Variant
    ) -> RunResult:
        """A case under a controller designed from the equations of another variant."""
        law = self.controller(case, plant, controller, variant)
        key = ("misdesigned", case, plant, controller, variant)
        return self.once(key, lambda: self._run(case, plant, law))

    def _run(self, case: Case, plant: PlantName, law: Controller) -> RunResult:
        """A run, with what is wrong."""
        return run_on(self._fault.case(case), plant, law, self.plant(case, plant), self.settings)

    def case(self, system: str, name: str, plant: PlantName, controller: str) -> RunResult:
        """One of the chapter's cases, by name."""
        return self.run(find_case(system, name), plant, controller)

    def controller(
        self, case: Case, plant: PlantName, name: str, variant: Variant | None = None
    ) -> Controller:
        """A controller as it is used: designed from the nominal plant, of a variant if named."""
        law = nominal_controller(
            case.system,
            name,
            variant or design_variant(plant),
            self.settings.realization(case.controllers),
            case.controllers,
        )
        return self._fault.controller(law, case, plant)

    def plant(self, case: Case, name: PlantName) -> Plant:
        """A plant as it is used."""
        return self._fault.plant(case_plant(case, name, self.settings), case, name)

    def equations(self, case: Case, name: PlantName) -> AnalyticPlant:
        """The corrected equations of a plant as it is used, or the equations that it is."""
        return self.plant(case, name).analytic()

    def batch(
        self, cases: Sequence[Case], plant: PlantName, controller: str
    ) -> tuple[Controller, Trajectory]:
        """Cases of one system and one duration at once, and the law that they ran under."""
        law = self.controller(cases[0], plant, controller)
        used = [self._fault.case(case) for case in cases]
        run = simulate(
            [self.plant(case, plant) for case in cases],
            law,
            [case.x0 for case in used],
            duration=cases[0].duration,
            control_period=self.settings.control_period,
            timestep=self.settings.timestep,
            disturbances=[case.disturbances for case in used],
            engine=self.settings.engine_for(law),
        )
        return law, run

    def derivative(self, plant: Plant) -> Callable[[Array, ArrayLike, Array], Array]:
        """x' as a function of x, u and the wrenches, of the equations or of MuJoCo."""
        return plant.derivative


def trial(
    system: str,
    name: str,
    x0: tuple[float, ...],
    duration: float,
    edits: tuple[Edit, ...] = (),
    disturbances: tuple[Disturbance, ...] = (),
) -> Case:
    """An experiment of this project's own, beside the chapter's cases."""
    return Case(system, name, name, "this project", x0, duration, edits, disturbances)
