"""Cost of a search for numbers: runs a second beside a plain batch, and what racing saves."""

from __future__ import annotations

import math
import statistics
import time
from typing import NamedTuple

from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.tune.numbers import ranges_of, start_of
from grosmc_mj.studies.tune.search import Search
from grosmc_mj.studies.tune.shares import Measure
from grosmc_mj.studies.tune.tune import TuneStudy, tune_study

_TARGET = "servo/machine"
_LAW = "lqr"
# Runs of a search; each of four draws of the nominal plant.
_RUNS = 192
# Share that no design reaches, so that all runs are made.
_NONE = 1e-6


class Tuning(NamedTuple):
    """Cost of a search.

    Attributes:
        runs: Runs of a search.
        rate: Runs a second of a search that does not race.
        beside_batch: That rate over the rate of a batch of as many runs of one design.
        raced: Runs of a search that races over those that its designs would take in full.
    """

    runs: int
    rate: float
    beside_batch: float
    raced: float


class _Asked:
    """A measure as a search asks it."""

    def __init__(self, measure: Measure) -> None:
        self._measure = measure

    @property
    def runs_of_point(self) -> int:
        """Runs of a design at most."""
        return self._measure.runs_of_point

    def __call__(self, points: Array, beat: Array) -> tuple[Array, int]:
        """Return the values of designs and their number of runs."""
        tried = self._measure.tried(points, beat)
        return tried.values, tried.runs


def benchmark_tuning(rounds: int) -> Tuning:
    """Tune LQR on the servo's machine, and run a plain batch, in turn in each round.

    Args:
        rounds: Number of rounds.
    """
    study = tune_study(_TARGET, [_LAW], conditions=["nominal"], runs=_RUNS)
    # Compiled once before.
    _batch(study, study.draws)
    ratios = []
    rates = []
    for _ in range(rounds):
        batch = _batch(study, _RUNS)
        begun = time.perf_counter()
        search = _searched(study, races=False)
        rate = search.runs / (time.perf_counter() - begun)
        rates.append(rate)
        ratios.append(rate / batch)

    racing = _searched(study, races=True)
    in_full = racing.points * sum(item.draws for item in study.conditions)
    return Tuning(
        runs=_RUNS,
        rate=statistics.median(rates),
        beside_batch=statistics.median(ratios),
        raced=racing.runs / in_full,
    )


def _batch(study: TuneStudy, runs: int) -> float:
    """Runs a second of a batch of one design."""
    measure = Measure(study.laws[0], list(study.conditions))
    design = study.laws[0].as_in_file
    (condition,) = study.conditions
    designs = [design] * (runs // study.draws)
    begun = time.perf_counter()
    measure.outcomes(designs, condition, range(study.draws), measure.asked(condition))
    return runs / (time.perf_counter() - begun)


def _searched(study: TuneStudy, *, races: bool) -> Search:
    """A search that has spent its runs."""
    law = study.laws[0]
    measure = Measure(law, list(study.conditions), races=races)
    search = Search(
        _Asked(measure),
        ranges_of(law.numbers),
        start_of(law.numbers),
        budget=study.runs,
        target=math.log(_NONE),
    )
    search.run()
    return search
