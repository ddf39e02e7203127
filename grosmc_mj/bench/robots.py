"""Throughput of a batch of robots under GROSMC beside the same batch in open loop."""

from __future__ import annotations

import numpy as np

from grosmc_mj.bench.batches import closed_loop, open_batch
from grosmc_mj.bench.timing import Throughput, measured
from grosmc_mj.cases.jaco.jaco import controllers, jaco, joint_sines, payload, start

# A compiled Jaco is 1.7 MB of meshes, so several simulations share one.
_SIMULATIONS, _PAYLOADS, _HEAVIEST, _STEPS = 1024, 64, 1.5, 50


def benchmark_robots(rounds: int = 5) -> list[Throughput]:
    """Measure 1024 Jaco arms with 64 different payloads, the law sampled at every timestep.

    In open loop the same batch holds zero torque from the same start.

    Args:
        rounds: How often each loop is measured.

    Raises:
        SetupError: If dm_control is not installed.
    """
    robot = jaco()
    path = joint_sines(robot)
    law = controllers(robot, path).grosmc
    masses = np.linspace(0.0, _HEAVIEST, _PAYLOADS + 1)[1:]
    loaded = [robot.plant.edited(payload(robot, float(mass))) for mass in masses]
    plants = [loaded[i % _PAYLOADS] for i in range(_SIMULATIONS)]
    starts = np.tile(start(path), (_SIMULATIONS, 1))
    name = "GROSMC, native, batch"
    loops = [
        open_batch(plants, starts, _STEPS),
        closed_loop(name, plants, law, starts, _STEPS),
        closed_loop(f"{name}, recorded", plants, law, starts, _STEPS, record=True),
    ]
    return measured(loops, rounds)
