"""Rates of loops that are timed in turn, as ratios within one run."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np


class Ratio(NamedTuple):
    """Rate of a loop over the rate of another one in the same round.

    Attributes:
        median: Median over the rounds.
        low: Lower quartile.
        high: Upper quartile.
    """

    median: float
    low: float
    high: float


class Throughput(NamedTuple):
    """One measured loop.

    Attributes:
        loop: Name.
        simulations: Number of simulations at once.
        rate: Median physics steps per second, over all simulations.
        shipped: Ratio to MuJoCo's open loop as shipped.
        untimed: Ratio to MuJoCo's open loop without its clock.
    """

    loop: str
    simulations: int
    rate: float
    shipped: Ratio
    untimed: Ratio


class TimedLoop(NamedTuple):
    """A loop to measure.

    Attributes:
        name: Name.
        simulations: Number of simulations at once.
        steps: Physics steps of each simulation.
        ready: Sets the loop up, untimed, and returns the function that is timed.
    """

    name: str
    simulations: int
    steps: int
    ready: Callable[[], Callable[[], object]]


def measured(
    shipped: TimedLoop, untimed: TimedLoop, loops: Sequence[TimedLoop], rounds: int
) -> list[Throughput]:
    """Run all loops once in each round, in turn: a slow moment of the machine meets all of them.

    Args:
        shipped: MuJoCo's open loop as shipped.
        untimed: MuJoCo's open loop without its clock.
        loops: Loops to compare with both.
        rounds: Number of rounds.

    Returns:
        Both open loops, then the other loops in their order.
    """
    every = [shipped, untimed, *loops]
    rates: dict[str, list[float]] = {loop.name: [] for loop in every}
    for _ in range(rounds):
        for loop in every:
            rates[loop.name].append(loop.simulations * loop.steps / seconds(loop.ready))

    return [
        Throughput(
            loop.name,
            loop.simulations,
            statistics.median(rates[loop.name]),
            _ratio(rates[loop.name], rates[shipped.name]),
            _ratio(rates[loop.name], rates[untimed.name]),
        )
        for loop in every
    ]


def seconds(ready: Callable[[], Callable[[], object]]) -> float:
    """Time that the function takes that ``ready`` returns [s]."""
    run = ready()
    gc.collect()
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def _ratio(rates: Sequence[float], baseline: Sequence[float]) -> Ratio:
    """Ratio of two loops, round by round."""
    ratios = [rate / base for rate, base in zip(rates, baseline, strict=True)]
    low, median, high = np.quantile(ratios, (0.25, 0.5, 0.75)).tolist()
    return Ratio(median, low, high)
