"""What a plant has that its equations lack: where nothing is lacking they can stand for MuJoCo."""

from __future__ import annotations

import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant
from grosmc_mj.studies.agreement.measure import AGREEMENT_BOUND, acceleration_difference

# How near to a limit a margin by the equations is not believed, in parts of the limit: it is
# confirmed in MuJoCo within this many times the largest difference found...
FACTOR = 10.0
# ...and within what rounding may come to on another machine.
LEAST_BAND = 1e-9

# Random states, inputs and wrenches in which accelerations are compared.
_STATES = 32


def lacking(plant: Plant) -> str:
    """Why the equations of a plant in MuJoCo do not say what MuJoCo does; empty if they do.

    Its machine, limits of its inputs and numbers without a term are named; anything else shows in
    accelerations at random states.
    """
    if not isinstance(plant, MujocoPlant):
        return f"{plant.system.name} has no model in MuJoCo"
    if plant.parts:
        return "equations lack the machine as built"
    if plant.system.read_parameters is None or not plant.system.symbolic:
        return f"{plant.system.name} has no equations in symbols"
    if np.isfinite(plant.input_limits).any():
        return f"equations lack the limits of {plant.system.name}'s inputs"
    try:
        equations = plant.analytic()
    except ModelError as error:
        return str(error)
    found = acceleration_difference(plant, equations, np.random.default_rng(0), _STATES)
    if found <= AGREEMENT_BOUND:
        return ""
    return (
        f"accelerations differ from MuJoCo's by {found:.1e} of the largest term, more than "
        f"{AGREEMENT_BOUND:.0e}, so that equations lack something"
    )
