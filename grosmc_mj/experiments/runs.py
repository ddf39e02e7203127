"""Running the cases: every plant and every controller of a system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, Literal, get_args

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.switching import SWITCHINGS
from grosmc_mj.control.task import AS_PRINTED, Realization
from grosmc_mj.errors import ArgumentError, DivergenceError, unknown_name
from grosmc_mj.experiments.case import Case, cases, find_case
from grosmc_mj.experiments.designs import (
    DESIGNS,
    chapter_controller,
    controller_names,
    switching_for,
)
from grosmc_mj.experiments.metrics import Comparison, Metric, compare_with_optimum, measure
from grosmc_mj.plants import SYSTEMS, Plant, Variant, find_system
from grosmc_mj.simulation.edits import BodyEdit
from grosmc_mj.simulation.linearization import linearize
from grosmc_mj.simulation.mujoco_plant import Integrator, MujocoPlant
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

PlantName = Literal["printed", "corrected", "physics"]
Surface = Literal["printed", "discrete"]


@dataclass(frozen=True)
class Settings:
    """How the cases are run.

    Attributes:
        engine: ``native`` or ``python``.
        control_period: [s]; the chapter prints none.
        timestep: Physics timestep [s].
        integrator: MuJoCo's integrator.
        switching: Name of the switching law of the sliding mode laws.
        surface: Their surface: ``printed``, or ``discrete`` for the one that is zero at every
            sample of the nominal plant.
    """

    engine: Engine = "native"
    control_period: float = 1e-3
    timestep: float = 1e-3
    integrator: Integrator = "RK4"
    switching: str = "sign"
    surface: Surface = "printed"

    def __post_init__(self) -> None:
        for kind, value, valid in (
            ("engine", self.engine, get_args(Engine)),
            ("surface", self.surface, get_args(Surface)),
            ("switching law", self.switching, SWITCHINGS),
        ):
            if value not in valid:
                raise ArgumentError(unknown_name(kind, value, valid))

    def engine_for(self, law: Controller) -> Engine:
        """The engine, or ``python`` for a law that can't be compiled."""
        return "python" if getattr(law.law, "python_only", False) else self.engine

    def realization(self, design: str) -> Realization:
        """How the sliding mode laws of a design are sampled."""
        period = self.control_period if self.surface == "discrete" else None
        return Realization(switching_for(self.switching, design), period)


@dataclass(frozen=True, eq=False)
class RunResult:
    """One case on one plant under one controller.

    Attributes:
        case: The case.
        plant: ``printed``, ``corrected`` or ``physics``.
        controller: With the numbers of its design.
        trajectory: Up to the end or to where the run stopped being valid.
        comparison: The run beside the optimum that its law was designed for.
        metrics: By name.
        ended: Empty, or why the run ended early.
        true: The plant itself.
    """

    case: Case
    plant: PlantName
    controller: Controller
    trajectory: Trajectory
    comparison: Comparison
    metrics: Mapping[str, Metric]
    ended: str = ""
    true: Plant | None = None

    @property
    def key(self) -> str:
        """Name of the run in files: system/case/plant/controller."""
        return "/".join((self.case.system, self.case.name, self.plant, self.controller.name))

    @property
    def plant_parameters(self) -> Any:
        """The true plant's numbers; None where it has no equations."""
        return self.true.parameters if self.true else None

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.trajectory.status  # pyright: ignore[reportReturnType]


def select_cases(systems: tuple[str, ...], case: str | None) -> list[Case]:
    """The cases of the named systems (all, if none is named), or the one case of each.

    Raises:
        ModelError: If a system is unknown.
        ArgumentError: If a system has no such case.
    """
    names = [find_system(name).name for name in dict.fromkeys(systems or tuple(SYSTEMS))]
    if case is None:
        return [each for name in names for each in cases(name)]
    return [find_case(name, case) for name in names]


def plant_names(system: str) -> list[PlantName]:
    """Plants that a system has: its analytic variants, then physics."""
    return [*find_system(system).variants, "physics"]


def plan(selected: list[Case]) -> list[tuple[Case, PlantName, str]]:
    """Every run of the cases: the case, the plant and the controller's name."""
    return [
        (case, plant, controller)
        for case in selected
        for plant in plant_names(case.system)
        for controller in controller_names(case.controllers)
    ]


def run_all(selected: list[Case], settings: Settings) -> Iterator[RunResult]:
    """Run all of ``plan(selected)``, one by one."""
    for case, plant, controller in plan(selected):
        yield run_case(case, plant, controller, settings)


def run_case(case: Case, plant: PlantName, controller: str, settings: Settings) -> RunResult:
    """Run one case; a run that ends early is a result like any other.

    The controller is designed from the nominal equations: the printed ones for the printed
    plant, the corrected ones for the corrected plant and for physics.
    """
    law = nominal_controller(
        case.system,
        controller,
        design_variant(plant),
        settings.realization(case.controllers),
        case.controllers,
    )
    return run_on(case, plant, law, case_plant(case, plant, settings), settings)


def run_on(
    case: Case, name: PlantName, law: Controller, plant: Plant, settings: Settings
) -> RunResult:
    """Run a case with this very law on this very plant, whatever they are called."""
    ended = ""
    try:
        run = simulate(
            plant,
            law,
            case.x0,
            duration=case.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=case.disturbances,
            engine=settings.engine_for(law),
        )
    except DivergenceError as error:
        run, ended = error.trajectory, str(error)
    comparison = compare_with_optimum(run, law)
    metrics = measure(run, law, comparison, case.onset)
    return RunResult(case, name, law, run, comparison, metrics, ended, plant)


def case_plant(case: Case, plant: PlantName, settings: Settings) -> Plant:
    """The plant of a case, with its edits."""
    physics = _physics(case.system, case.edits, settings.timestep, settings.integrator)
    return physics if plant == "physics" else physics.analytic(plant)


@lru_cache(maxsize=256)
def _physics(
    system: str, edits: tuple[BodyEdit, ...], timestep: float, integrator: Integrator
) -> MujocoPlant:
    """An edited model, compiled once for all runs on it."""
    return MujocoPlant.load(system, edits=edits, timestep=timestep, integrator=integrator)


def design_variant(plant: PlantName) -> Variant:
    """The equations that the law for a plant is designed from."""
    return "printed" if plant == "printed" else "corrected"


@cache
def _as_printed(system: str, name: str, variant: Variant, design: str | None) -> Controller:
    """A controller for the nominal plant of a variant, sampled as printed."""
    physics = MujocoPlant.load(system)
    further = DESIGNS[design or system].further
    model = linearize(physics) if name in further and variant == "corrected" else None
    return chapter_controller(name, physics.analytic(variant), AS_PRINTED, design, model)


@cache
def nominal_controller(
    system: str,
    name: str,
    variant: Variant,
    realization: Realization = AS_PRINTED,
    design: str | None = None,
) -> Controller:
    """A controller for the nominal plant of a variant."""
    return realized(_as_printed(system, name, variant, design), realization)
