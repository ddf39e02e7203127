"""Throughput of a batch of robots under GROSMC beside the same batch in open loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.batches import closed_loop, open_batches
from benchmarks.timing import Throughput, measured
from grosmc_mj.experiments.cases.jaco.jaco import jaco
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

_SIMULATIONS = 1024
_STEPS = 200
# A compiled Jaco is 1.7 MB of meshes, so several simulations share one.
_PAYLOADS = 64
# Largest mass of a payload [kg].
_HEAVIEST = 1.5


def benchmark_robots(rounds: int = 5) -> list[Throughput]:
    """Measure 1024 Jaco arms with 64 different payloads, the law sampled at every timestep.

    In open loop the same batch holds zero torque from the same start.

    Args:
        rounds: Number of rounds.

    Raises:
        SetupError: If dm_control is not installed.
    """
    experiment = Experiment.load("jaco/sines").changed(switching="sign", surface="printed")
    law = experiment.law("physics", "grosmc")
    plants = _loaded_arms(experiment)
    starts = np.tile(experiment.x0, (_SIMULATIONS, 1))

    name = "GROSMC, native, batch"
    shipped, untimed = open_batches(plants, starts, _STEPS)
    loops = [
        closed_loop(name, plants, law, starts, _STEPS),
        closed_loop(f"{name}, recorded", plants, law, starts, _STEPS, record=True),
    ]
    return measured(shipped, untimed, loops, rounds)


def _loaded_arms(experiment: Experiment) -> list[MujocoPlant]:
    """Arms with the payload of a case in different masses, one for each simulation."""
    (payload,) = experiment.edits
    nominal = jaco().plant
    masses = np.linspace(0.0, _HEAVIEST, _PAYLOADS + 1)[1:].tolist()
    loaded = [nominal.changed(replace(payload, mass=mass)) for mass in masses]
    return [loaded[i % _PAYLOADS] for i in range(_SIMULATIONS)]
