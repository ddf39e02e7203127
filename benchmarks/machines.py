"""Throughput of machines as built under GROSMC beside the same machines in open loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.batches import closed_loop, open_batches
from benchmarks.timing import Throughput, measured
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.theory.plants import SYSTEMS

_SIMULATIONS = 1024
_STEPS = 500
_LAW = "grosmc"


def benchmark_machines(rounds: int = 5) -> dict[str, Sequence[Throughput]]:
    """Measure 1024 copies of each shipped machine with all its parts, without its loop.

    The law is sampled at every timestep; the open loop begins at the same start.

    Args:
        rounds: Number of rounds.

    Returns:
        Measured loops by case.
    """
    return {f"{system}/machine": _benchmark(system, rounds) for system in SYSTEMS}


def _benchmark(system: str, rounds: int) -> list[Throughput]:
    """Measure one machine."""
    machine = find_experiment(system, "machine")
    experiment = machine.changed(loop=None).changed(control_period=machine.settings.timestep)
    law = experiment.law("physics", _LAW)
    plants = [experiment.plant("physics")] * _SIMULATIONS
    starts = np.tile(experiment.x0, (_SIMULATIONS, 1))

    shipped, untimed = open_batches(plants, starts, _STEPS)
    closed = closed_loop(f"{system}: GROSMC, native, batch", plants, law, starts, _STEPS)
    return measured(shipped, untimed, [closed], rounds)
