"""The package's experiments as tests ask for them: a case, a plant, a law, a number of its file."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.references import Setpoints
from grosmc_mj.control.task import AS_PRINTED, Realization, Task
from grosmc_mj.experiments import runs
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment, find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.problem import Plant

REGULATION = "two_link_arm regulation"
TWO_LINK_CIRCLE = SimpleNamespace(centre1=0.45, centre2=0.15, radius=0.15, frequency=math.pi)
TWO_LINK_TARGET = Setpoints(math.pi / 3, -math.pi / 2)


def of_design(design: str) -> Experiment:
    """The nominal experiment of a system, or of a further task of it."""
    system, _, further = design.partition(" ")
    return find_experiment(system, further or "nominal")


def of_case(case: Case, settings: Settings | None = None) -> Experiment:
    """A case under the package's laws for it; of a plant of one's own it has no laws."""
    known = find_experiments(case.system if "/" not in case.system else "servo")
    base = next((one for one in known if one.case.design == case.design), known[0])
    return replace(base, case=case).with_settings(**vars(settings or Settings()))


def cases(system: str) -> list[Case]:
    return [experiment.case for experiment in find_experiments(system)]


def find_case(system: str, name: str) -> Case:
    return find_experiment(system, name).case


def controller_names(design: str) -> list[str]:
    return of_design(design).controllers


def run_case(case: Case, plant: PlantName, law: str, settings: Settings) -> RunResult:
    return of_case(case, settings).run(plant, law)


def run_on(
    case: Case, name: PlantName, law: Controller, plant: Plant, settings: Settings
) -> RunResult:
    """Any law on any plant."""
    anything = replace(find_experiment("servo", "nominal"), case=case, settings=settings)
    return runs.run_on(anything, name, law, plant)


def case_plant(case: Case, name: PlantName, settings: Settings) -> Plant:
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
    """What the laws of a design are designed for."""
    law = of_design(design).law("corrected", "lqr")
    nominal: Any = plant or of_design(design).nominal.equations("corrected")
    error: Any = law.designed.error
    return Task(nominal, error, law.parameters.reference, law.designed.lqr.Q, law.designed.lqr.R)


_DESIGNS = {
    "SERVO": "servo", "PENDULUM": "cart_pendulum", "ARM": "arm", "TWO_LINK": REGULATION,
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """A number of the case files, such as ARM_ERROR, SERVO_UNCERTAINTY, TWO_LINK_G."""
    prefix, _, part = name.rpartition("_")
    if prefix not in _DESIGNS:
        raise AttributeError(name)
    design = "two_link_arm" if part == "TIP" else _DESIGNS[prefix]
    match part:
        case "UNCERTAINTY":
            return of_design(design).uncertainty
        case "G":
            return of_design(design).law("corrected", "grosmc").parameters.G
        case "WEIGHTS":
            return task_of(design).Q, task_of(design).R
        case "ERROR" | "TIP" | "JOINTS":
            return task_of(design).error
        case "REFERENCE" | "STEP" | "UPRIGHT":
            return task_of(design).reference
        case _:
            raise AttributeError(name)


@cache
def nominal(system: str) -> AnalyticPlant:
    return MujocoPlant.load(system).analytic()


@cache
def robust(system: str) -> Controller:
    return chapter_controller("grosmc", nominal(system))
