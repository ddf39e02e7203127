"""Cost of a batch over its runs and timesteps, of systems with more and more states and inputs."""

from __future__ import annotations

import statistics
from typing import NamedTuple

import numpy as np

from benchmarks.batches import closed_loop, open_batches
from benchmarks.timing import seconds
from grosmc_mj.experiments.experiment import Experiment

_RUNS = 256
_STEPS = 400
_CASES = ("servo/nominal", "cart_pendulum/nominal", "two_link_arm/nominal", "jaco/sines")


class Growth(NamedTuple):
    """Cost of a batch in one thread: fixed + runs (run + steps step).

    Attributes:
        case: Name of the case.
        states: Number of states.
        inputs: Number of inputs.
        integrator: MuJoCo's integrator.
        fixed: Fixed cost [ms].
        run: Cost of a run without steps [us].
        step: Cost of a timestep with its sample of the law [us].
        shipped_step: Cost of a step of MuJoCo as shipped, without a law [us].
    """

    case: str
    states: int
    inputs: int
    integrator: str
    fixed: float
    run: float
    step: float
    shipped_step: float


def benchmark_growth(rounds: int = 5) -> list[Growth]:
    """Measure batches of one run, of many short runs and of many long runs under GROSMC.

    Args:
        rounds: Number of rounds, of which the medians are taken.
    """
    return [_growth(case, rounds) for case in _CASES]


def _growth(case: str, rounds: int) -> Growth:
    """Cost of one case."""
    experiment = Experiment.load(case)
    plant = experiment.plant("physics")
    law = experiment.law("physics", "grosmc")
    x0 = np.tile(experiment.x0, (_RUNS, 1))
    many = [plant] * _RUNS

    sizes = {"one": (1, 1), "short": (_RUNS, 1), "long": (_RUNS, _STEPS)}
    loops = {
        name: closed_loop(name, many[:runs], law, x0[:runs], steps, threads=1)
        for name, (runs, steps) in sizes.items()
    }
    # One simulation of MuJoCo's batch runs in one thread.
    loops["shipped"], _untimed = open_batches(many[:1], x0[:1], _RUNS * _STEPS)

    times: dict[str, list[float]] = {name: [] for name in loops}
    for _ in range(rounds):
        for name, loop in loops.items():
            times[name].append(seconds(loop.ready))
    median = {name: statistics.median(found) for name, found in times.items()}

    step = (median["long"] - median["short"]) / (_RUNS * (_STEPS - 1))
    run = (median["short"] - median["one"]) / (_RUNS - 1) - step
    fixed = median["one"] - run - step
    return Growth(
        case,
        len(plant.system.states),
        len(plant.system.inputs),
        experiment.settings.integrator,
        1e3 * fixed,
        1e6 * run,
        1e6 * step,
        1e6 * median["shipped"] / (_RUNS * _STEPS),
    )
