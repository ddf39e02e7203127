"""Films of a log: the simulated machine, and the measured one as its ghost."""

from __future__ import annotations

import numpy as np

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import fitted_starts
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.films.film import Film, Take
from grosmc_mj.output.palette import BLUE
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.plants import Plant


def film_of_log(rung: LogModel, log: Log, horizon: float) -> Film:
    """Film of the first prediction along a log, under the logged inputs.

    Args:
        rung: The simulated machine.
        log: The log.
        horizon: Length of the prediction [s].

    Raises:
        ArgumentError: If the plant does not run in MuJoCo, or a coordinate is not measured.
    """
    plant = filmable(rung.plant, log)
    predictor = Predictor.leading(log, horizon, plant.step_length)
    run = predictor.first_run(rung, fitted_starts(predictor.leads, rung))
    return film_beside_log(plant, run, log, predictor.windows[0].start, "simulated")


def filmable(plant: Plant, log: Log) -> MujocoPlant:
    """Return a plant in MuJoCo whose controlled coordinates a log measures.

    Raises:
        ArgumentError: If it is none, with the reason.
    """
    if not isinstance(plant, MujocoPlant):
        raise ArgumentError("--film: the case does not run in MuJoCo: there is no film of it")
    for index in plant.system.controlled:
        name = plant.system.states[index].name
        if name not in log.states:
            raise ArgumentError(f"--film: the log does not measure {name}: there is no ghost")
    return plant


def film_beside_log(
    plant: MujocoPlant, run: Trajectory, log: Log, start: float, label: str
) -> Film:
    """Film of a run whose ghost is the measured machine.

    Args:
        plant: The plant.
        run: Its run.
        log: The log, which measures the controlled coordinates.
        start: Instant of the log at which the run starts [s].
        label: Name of the run.
    """
    system = plant.system
    positions = [system.states[i].name for i in system.controlled]
    times = log.time - start
    ghost = [np.interp(run.time, times, log.states[name]) for name in positions]

    # Film draws one more state beside the bodies: the first that is not controlled.
    uncontrolled = [i for i in range(len(system.states)) if i not in system.controlled]
    return Film(
        title=f"{system.title}: {log.name}",
        model=plant.model,
        takes=(Take(label, BLUE, run, np.column_stack(ghost)),),
        ghost_label="measured",
        ghost_symbol="y",
        beside=uncontrolled[0],
    )
