"""The cartpole of dm_control's suite: its own XML, masses, damping, gear and limits."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import mujoco

from grosmc_mj.errors import ModelError, SetupError
from grosmc_mj.plants.cart_pole import CART_POLE
from grosmc_mj.simulation.mujoco_plant import MujocoPlant

# Its own 0.01 s is a hundred times what a switching law wants: s moves by h rho in a step.
TIMESTEP = 1e-3


def cartpole(*, timestep: float = TIMESTEP) -> MujocoPlant:
    """dm_control's cartpole, in MuJoCo and untouched but for the timestep.

    Its file is read where it is installed; nothing of dm_control is imported.

    Args:
        timestep: [s]; 1 ms instead of the file's own 10 ms, which is too slow for a switching law.

    Raises:
        SetupError: If dm_control is not installed.
    """
    return MujocoPlant(CART_POLE, _spec(), timestep=timestep)


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
