"""Does a robust controller keep its promise on real physics, and where does it break?

The public names load on first use, so that importing the package is quick and does not import
MuJoCo.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grosmc_mj import environments
    from grosmc_mj.control.controller import Controller
    from grosmc_mj.control.coordinates.feedback_linearization import feedback_linearization
    from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
    from grosmc_mj.control.custom import custom_controller
    from grosmc_mj.control.design import (
        Realization,
        Task,
        computed_torque_pd,
        linearized_lqr,
        regulating_grosmc,
        tracking_grosmc,
    )
    from grosmc_mj.control.gains import Uncertainty
    from grosmc_mj.control.lqr import lqr
    from grosmc_mj.control.references import TIME, Setpoint, Setpoints, constant, reference
    from grosmc_mj.control.switching import find_switching
    from grosmc_mj.errors import DivergenceError, GrosmcError
    from grosmc_mj.experiments.experiment import Experiment, chapter_controller
    from grosmc_mj.films.film import Film, Format, Take
    from grosmc_mj.films.write import write_film
    from grosmc_mj.plants import AnalyticPlant, Signal, System, affine_plant
    from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
    from grosmc_mj.simulation.edits import AddedMass, BodyEdit, JointEdit
    from grosmc_mj.simulation.linearization import linearize
    from grosmc_mj.simulation.models import load_model
    from grosmc_mj.simulation.mujoco_plant import MujocoPlant
    from grosmc_mj.simulation.robots.robot import Robot
    from grosmc_mj.simulation.simulate import simulate
    from grosmc_mj.simulation.trajectory import Status, Trajectory

__version__ = "0.1.0"

_HOMES = {
    "AddedMass": "simulation.edits",
    "affine_plant": "plants",
    "AnalyticPlant": "plants",
    "BodyEdit": "simulation.edits",
    "chapter_controller": "experiments.experiment",
    "computed_torque_pd": "control.design",
    "constant": "control.references",
    "Constant": "simulation.disturbances",
    "Controller": "control.controller",
    "custom_controller": "control.custom",
    "Disturbance": "simulation.disturbances",
    "DivergenceError": "errors",
    "ErrorCoordinates": "control.coordinates.symbolic",
    "Experiment": "experiments.experiment",
    "feedback_linearization": "control.coordinates.feedback_linearization",
    "Film": "films.film",
    "find_switching": "control.switching",
    "Format": "films.film",
    "GrosmcError": "errors",
    "JointEdit": "simulation.edits",
    "linearize": "simulation.linearization",
    "linearized_lqr": "control.design",
    "load_model": "simulation.models",
    "lqr": "control.lqr",
    "MujocoPlant": "simulation.mujoco_plant",
    "Pulse": "simulation.disturbances",
    "Realization": "control.design",
    "reference": "control.references",
    "regulating_grosmc": "control.design",
    "Robot": "simulation.robots.robot",
    "Setpoint": "control.references",
    "Setpoints": "control.references",
    "Signal": "plants",
    "simulate": "simulation.simulate",
    "SineFrom": "simulation.disturbances",
    "Status": "simulation.trajectory",
    "System": "plants",
    "Take": "films.film",
    "Task": "control.design",
    "TIME": "control.references",
    "tracking_grosmc": "control.design",
    "Trajectory": "simulation.trajectory",
    "Uncertainty": "control.gains",
    "write_film": "films.write",
}

_PACKAGES = ("environments",)

__all__ = [
    "TIME",
    "AddedMass",
    "AnalyticPlant",
    "BodyEdit",
    "Constant",
    "Controller",
    "Disturbance",
    "DivergenceError",
    "ErrorCoordinates",
    "Experiment",
    "Film",
    "Format",
    "GrosmcError",
    "JointEdit",
    "MujocoPlant",
    "Pulse",
    "Realization",
    "Robot",
    "Setpoint",
    "Setpoints",
    "Signal",
    "SineFrom",
    "Status",
    "System",
    "Take",
    "Task",
    "Trajectory",
    "Uncertainty",
    "affine_plant",
    "chapter_controller",
    "computed_torque_pd",
    "constant",
    "custom_controller",
    "environments",
    "feedback_linearization",
    "find_switching",
    "linearize",
    "linearized_lqr",
    "load_model",
    "lqr",
    "reference",
    "regulating_grosmc",
    "simulate",
    "tracking_grosmc",
    "write_film",
]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that it lives in."""
    if name in _PACKAGES:
        return importlib.import_module(f"{__name__}.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted([*globals(), *__all__])
