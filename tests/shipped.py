"""Shipped experiments for tests: their cases, plants and laws, and numbers of their files.

A design is a system, or a further task of it: ``servo``, ``two_link_arm regulation``.
"""

from __future__ import annotations

import math
from functools import cache
from types import SimpleNamespace
from typing import Any

from grosmc_mj.experiments import experiment as experiments
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment, find_experiments
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.problem import Plant
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import realized
from grosmc_mj.theory.control.references import Setpoints
from grosmc_mj.theory.control.task import AS_PRINTED, Realization, Task
from grosmc_mj.theory.plants import AnalyticPlant

REGULATION = "two_link_arm regulation"
TWO_LINK_CIRCLE = SimpleNamespace(centre1=0.45, centre2=0.15, radius=0.15, frequency=math.pi)
TWO_LINK_TARGET = Setpoints(math.pi / 3, -math.pi / 2)


def of_design(design: str) -> Experiment:
    """Return the nominal experiment of a design."""
    system, _, further_task = design.partition(" ")
    return find_experiment(system, further_task or "nominal")


def of_case(case: Experiment, settings: Settings | None = None) -> Experiment:
    """Return a case with other settings."""
    return case.changed(**vars(settings or Settings()))


def cases(system: str) -> list[Experiment]:
    return find_experiments(system)


def find_case(system: str, name: str) -> Experiment:
    return find_experiment(system, name)


def controller_names(design: str) -> list[str]:
    return of_design(design).controllers


def run_case(case: Experiment, plant: PlantName, law: str, settings: Settings) -> RunResult:
    return of_case(case, settings).run(plant, law)


def run_on(
    case: Experiment, name: PlantName, law: Controller, plant: Plant, settings: Settings
) -> RunResult:
    """Run any law on any plant."""
    return experiments.run_on(of_case(case, settings), name, law, plant)


def case_plant(case: Experiment, name: PlantName, settings: Settings) -> Plant:
    return of_case(case, settings).plant(name)


def nominal_controller(
    system: str,
    name: str,
    variant: PlantName = "corrected",
    realization: Realization = AS_PRINTED,
    design: str | None = None,
) -> Controller:
    return realized(of_design(design or system).law(variant, name), realization)


def task_of(design: str, plant: AnalyticPlant | None = None) -> Task:
    """Return the task of a design's laws, on its nominal plant or on another one."""
    experiment = of_design(design)
    law = experiment.law("corrected", "lqr")
    nominal: Any = plant or experiment.nominal.equations("corrected")
    error: Any = law.designed.error
    return Task(nominal, error, law.parameters.reference, law.designed.lqr.Q, law.designed.lqr.R)


def error_of(design: str) -> Any:
    return task_of(design).error


def reference_of(design: str) -> Any:
    return task_of(design).reference


def weights_of(design: str) -> tuple[Any, Any]:
    """Return Q and R of a design's LQR."""
    task = task_of(design)
    return task.Q, task.R


def uncertainty_of(design: str) -> Any:
    """Return the uncertainty that a design declares."""
    return of_design(design).uncertainty


def surface_of(design: str) -> Array:
    """Return G of a design's sliding surface, (m, n)."""
    return of_design(design).law("corrected", "grosmc").parameters.G


@cache
def nominal(system: str) -> AnalyticPlant:
    return MujocoPlant.load(system).analytic()


@cache
def robust(system: str) -> Controller:
    return chapter_controller("grosmc", nominal(system))
