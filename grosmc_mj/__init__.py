"""Does a robust controller keep its promise on real physics, and where does it break?

The public names load on first use, so that importing the package is quick and does not import
MuJoCo.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from grosmc_mj.control.controller import Controller
    from grosmc_mj.control.lqr import lqr
    from grosmc_mj.errors import DivergenceError, GrosmcError
    from grosmc_mj.plants import AnalyticPlant
    from grosmc_mj.rendering.film import Film, Format, Take
    from grosmc_mj.rendering.write import write_film
    from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
    from grosmc_mj.simulation.edits import BodyEdit
    from grosmc_mj.simulation.models import load_model
    from grosmc_mj.simulation.mujoco_plant import MujocoPlant
    from grosmc_mj.simulation.simulate import simulate
    from grosmc_mj.simulation.trajectory import Status, Trajectory
    from grosmc_mj.validation.cases import cases
    from grosmc_mj.validation.designs import chapter_controller

__version__ = "0.1.0"

_HOMES = {
    "AnalyticPlant": "plants",
    "BodyEdit": "simulation.edits",
    "Constant": "simulation.disturbances",
    "Controller": "control.controller",
    "Disturbance": "simulation.disturbances",
    "DivergenceError": "errors",
    "Film": "rendering.film",
    "Format": "rendering.film",
    "GrosmcError": "errors",
    "MujocoPlant": "simulation.mujoco_plant",
    "Pulse": "simulation.disturbances",
    "SineFrom": "simulation.disturbances",
    "Status": "simulation.trajectory",
    "Take": "rendering.film",
    "Trajectory": "simulation.trajectory",
    "cases": "validation.cases",
    "chapter_controller": "validation.designs",
    "load_model": "simulation.models",
    "lqr": "control.lqr",
    "simulate": "simulation.simulate",
    "write_film": "rendering.write",
}

__all__ = [
    "AnalyticPlant",
    "BodyEdit",
    "Constant",
    "Controller",
    "Disturbance",
    "DivergenceError",
    "Film",
    "Format",
    "GrosmcError",
    "MujocoPlant",
    "Pulse",
    "SineFrom",
    "Status",
    "Take",
    "Trajectory",
    "cases",
    "chapter_controller",
    "load_model",
    "lqr",
    "simulate",
    "write_film",
]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that it lives in."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted([*globals(), *__all__])
