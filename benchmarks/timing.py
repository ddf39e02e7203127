"""Rates of loops that are timed in turn, as ratios within one run."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np


class Throughput(NamedTuple):
    """One measured loop.

    Attributes:
        loop: What ran.
        simulations: How many at once.
        rate: Median physics steps per second, over all simulations.
        ratio: Median of its rate over the baseline's in the same round.
        low: The quarter of these ratios that are smallest lie below it.
        high: The quarter that are largest lie above it.
        baseline: What it is compared with.
    """

    loop: str
    simulations: int
    rate: float
    ratio: float
    low: float
    high: float
    baseline: str


class TimedLoop(NamedTuple):
    """A loop to measure.

    Attributes:
        name: What runs.
        simulations: How many at once.
        steps: Physics steps of each.
        ready: Sets it up, untimed, and returns what is timed.
        baseline: Name of the loop that it is compared with.
    """

    name: str
    simulations: int
    steps: int
    ready: Callable[[], Callable[[], object]]
    baseline: str


def measured(loops: Sequence[TimedLoop], rounds: int) -> list[Throughput]:
    """Run all loops once in each round, in turn: a slow moment of the machine meets all of them.

    Ratios are taken within a round, and their median is reported.

    Args:
        loops: Each baseline before what is compared with it.
        rounds: How often each loop is measured.
    """
    rates: dict[str, list[float]] = {loop.name: [] for loop in loops}
    for _ in range(rounds):
        for loop in loops:
            run = loop.ready()
            gc.collect()
            start = time.perf_counter()
            run()
            elapsed = time.perf_counter() - start
            rates[loop.name].append(loop.simulations * loop.steps / elapsed)
    return [_throughput(loop, rates[loop.name], rates[loop.baseline]) for loop in loops]


def _throughput(loop: TimedLoop, rates: Sequence[float], baseline: Sequence[float]) -> Throughput:
    """A loop's rates beside its baseline's, round by round."""
    ratios = [own / base for own, base in zip(rates, baseline, strict=True)]
    low, ratio, high = np.quantile(ratios, (0.25, 0.5, 0.75)).tolist()
    return Throughput(
        loop.name, loop.simulations, statistics.median(rates), ratio, low, high, loop.baseline
    )
