"""Film of a log: the simulated machine under the logged inputs, the measured one as its ghost."""

from __future__ import annotations

import numpy as np

from grosmc_mj.errors import ArgumentError
from grosmc_mj.films.film import Film, Take
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import fitted_starts
from grosmc_mj.logs.log import Log
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.palette import BLUE


def film_of_log(rung: LogModel, log: Log, horizon: float) -> Film:
    """Film of the first prediction along a log.

    Args:
        rung: The simulated machine.
        log: The log.
        horizon: Length of the prediction [s].

    Raises:
        ArgumentError: If the plant does not run in MuJoCo, or a coordinate is not measured.
    """
    plant = rung.plant
    if not isinstance(plant, MujocoPlant):
        raise ArgumentError("--film: the case does not run in MuJoCo: there is no film of it")
    system = plant.system
    positions = [system.states[i].name for i in system.controlled]
    for name in positions:
        if name not in log.states:
            raise ArgumentError(f"--film: the log does not measure {name}: there is no ghost")

    predictor = Predictor.leading(log, horizon, plant.step_length)
    window = predictor.windows[0]
    run = predictor.first_run(rung, fitted_starts(predictor.leads, rung))

    # The measured positions at the instants of the simulated run.
    times = log.time[window.samples] - window.start
    ghost = [np.interp(run.time, times, log.states[name][window.samples]) for name in positions]

    # Film draws one more state beside the bodies: the first that is not controlled.
    uncontrolled = [i for i in range(len(system.states)) if i not in system.controlled]
    return Film(
        title=f"{system.title}: {log.name}",
        model=plant.model,
        takes=(Take("simulated", BLUE, run, np.column_stack(ghost)),),
        ghost_label="measured",
        ghost_symbol="y",
        beside=uncontrolled[0],
    )
