"""The cartpole of dm_control's suite: its own XML, masses, damping, gear and limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np

from grosmc_mj.cases.cartpole.equations import CART_POLE
from grosmc_mj.cases.cartpole.limited import limited
from grosmc_mj.control.cart import HoldingUncertainty, holding_ism, holding_lqr
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ModelError, SetupError
from grosmc_mj.simulation.disturbances import Disturbance, Pulse
from grosmc_mj.simulation.edits import BodyEdit
from grosmc_mj.simulation.linearization import linearize
from grosmc_mj.simulation.mujoco_plant import MujocoPlant

# Its own 0.01 s is too slow for a switching law, which moves s by the period times its gain.
TIMESTEP = 1e-3

# From 30 degrees at rest, with twice the pole's mass and 1 N on it for 0.2 s.
START = (0.0, math.pi / 6, 0.0, 0.0)
HEAVIER = BodyEdit("pole_1", mass_scale=2.0)
PUSH = Disturbance("pole_1", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), Pulse(5.0, 5.2), "push of 1 N")

# Declared. The start leaves 4 of the 10 N to turn the pole round and needs 1.7 of the rail's 1.8 m.
WEIGHTS = (np.diag([1.0, 20.0, 0.3, 1.0]), 3.0)
UNCERTAINTY = HoldingUncertainty(mass=2.0, length=1.0, force=0.0, reaching_rate=0.02, push=1.0)
# Of the actuator's limit, for the nominal input: with 0.8 the nominal falls from 30 degrees.
SHARE = 0.9


def cartpole(*, timestep: float = TIMESTEP) -> MujocoPlant:
    """dm_control's cartpole, in MuJoCo and untouched but for the timestep.

    Its file is read where it is installed; nothing of dm_control is imported.

    Args:
        timestep: [s]; 1 ms instead of the file's own 10 ms, which is too slow for a switching law.

    Raises:
        SetupError: If dm_control is not installed.
    """
    return MujocoPlant(CART_POLE, _spec(), timestep=timestep)


def designs(plant: MujocoPlant | None = None) -> Mapping[str, Controller]:
    """The laws for it, as printed, all from the numbers of the compiled model.

    ``lqr`` on all four states, eqs. (5)-(6); ``grosmc``, section 2's sliding mode (8)+(12) with a
    nominal input that the actuator can apply; and ``grosmc-unlimited``, the same with the nominal
    input as printed, which the actuator's limit makes fall from 30 degrees.

    Args:
        plant: The nominal plant; ``cartpole()`` by default.
    """
    plant = cartpole() if plant is None else plant
    nominal, model = plant.analytic(), linearize(plant)
    largest = float(plant.model.actuator_ctrlrange[0, 1])
    printed = holding_ism(nominal, model, UNCERTAINTY, weights=WEIGHTS)
    made = {
        "lqr": holding_lqr(nominal, model, WEIGHTS),
        "grosmc": limited(printed, SHARE * largest),
        "grosmc-unlimited": printed,
    }
    return {name: replace(controller, name=name) for name, controller in made.items()}


def lqr() -> Controller:
    """LQR on all four states, for the cartpole as it is."""
    return designs()["lqr"]


def grosmc() -> Controller:
    """Section 2's sliding mode within the actuator's limit, for the cartpole as it is."""
    return designs()["grosmc"]


def unlimited() -> Controller:
    """Section 2's sliding mode as printed, for the cartpole as it is."""
    return designs()["grosmc-unlimited"]


@cache
def _spec() -> mujoco.MjSpec:
    """The model with the files that it includes."""
    package = find_spec("dm_control")
    folders = (package and package.submodule_search_locations) or []
    path = next((Path(folder) / "suite" / "cartpole.xml" for folder in folders), None)
    if path is None or not path.is_file():
        raise SetupError(
            "the cartpole is dm_control's, which is not installed (it needs Python 3.12 or older); "
            "run: pip install 'dm_control>=1.0.50,<1.1'"
        )
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise ModelError(f"{path}: {' '.join(str(error).split())}") from error
