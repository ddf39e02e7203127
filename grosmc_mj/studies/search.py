"""One search along a factor, and the runs that it asks for."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import NamedTuple

from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit
from grosmc_mj.loop import Loop
from grosmc_mj.studies.studied import Condition, StudiedLaw, judgeable_in
from grosmc_mj.sweep.runs import MARGIN, Row, run_rows

# The grid: factors on an amount, each twice the one before.
LEAST, MOST = 2.0**-4, 2.0**10
# Factors up to this many times the largest that is kept are tried.
BEYOND = 2.0**5
# Between the largest that is kept and the smallest that fails.
RESOLUTION = 2.0**0.125


class Search:
    """Search for the largest factor up to which all is kept: a grid first, then bisection.

    The grid shows amounts beyond the first failure at which all is kept again.

    Args:
        most: Largest factor.
        same: Key that is equal for two factors that are one, such as a time on a timestep's grid.

    Attributes:
        known: Whether all is kept, by factor.
    """

    def __init__(
        self, most: float = MOST, same: Callable[[float], Hashable] = lambda factor: factor
    ) -> None:
        self.known: dict[float, bool] = {}
        self._most, self._same = most, same

    @property
    def failed(self) -> float | None:
        """The smallest factor that fails; None if none that was tried does."""
        return min((factor for factor, kept in self.known.items() if not kept), default=None)

    @property
    def largest(self) -> float | None:
        """The largest factor below the first that fails; None if the first one fails."""
        end = math.inf if self.failed is None else self.failed
        return max((factor for factor in self.known if factor < end), default=None)

    @property
    def again(self) -> list[tuple[float, float]]:
        """Where all is kept again beyond the first failure: first and last factor of each range."""
        beyond = [f for f in sorted(self.known) if self.failed is not None and f > self.failed]
        ranges = [(kept, list(factors)) for kept, factors in groupby(beyond, self.known.get)]
        return [(factors[0], factors[-1]) for kept, factors in ranges if kept]

    def next_factors(self) -> list[float]:
        """Factors to be tried now; none when the search is done."""
        count = math.ceil(math.log2(self._most / LEAST) - 1e-9)
        grid = [factor for i in range(count) if (factor := LEAST * 2**i) > 0] + [self._most]
        kept = [factor for factor, kept in self.known.items() if kept]
        end = max(1.0, BEYOND * max(kept, default=LEAST))
        return [x for x in grid if 0 < x <= end and x not in self.known] or self._between()

    def local_factors(self) -> list[float]:
        """The same without a grid: down to a factor that is kept, up to one that fails."""
        low, high = self.largest, self.failed
        if low is None and high is not None:
            return [high / 2] if high > LEAST else []
        if high is None and low is not None and low < self._most:
            return [min(2 * low, self._most)]
        return self._between()

    def _between(self) -> list[float]:
        low, high = self.largest, self.failed
        if low is None or high is None or high / low <= RESOLUTION * (1 + 1e-9):
            return []
        middle = math.sqrt(low * high)
        return [] if self._same(middle) in {self._same(low), self._same(high)} else [middle]


class Trial(NamedTuple):
    """A loop under a condition."""

    condition: Condition
    loop: Loop


class TrialResult(NamedTuple):
    """Result of a run.

    Attributes:
        kept: Whether it keeps everything.
        margin: The least margin in parts of its limit; -inf for a run that ended early.
        worst: The requirement that it is of, or how the run ended.
        number: Number of the run; it sets the random draws.
        impossible: Why there can be no such run; empty if there can.
    """

    kept: bool
    margin: float
    worst: str
    number: int = 0
    impossible: str = ""


@dataclass(frozen=True, eq=False)
class Trials:
    """The runs of one law on one plant in many loops, none made twice.

    Attributes:
        law: The law.
        plant: ``corrected`` or ``physics``.
        limits: What it must keep under each condition.
        built: The whole loop that the trials' loops are parts of.
        seeds: Runs of a loop in which something is random.
        threads: 0 for all cores.
        known: Results by trial and number of the run.
    """

    law: StudiedLaw
    plant: PlantName
    limits: Mapping[Condition, Sequence[Limit]]
    built: Loop
    seeds: int
    threads: int = 0
    known: dict[tuple[Trial, int], TrialResult] = field(default_factory=dict)

    def results(self, runs: Sequence[tuple[Trial, int]]) -> list[TrialResult]:
        """Results of runs, by trial and number; those under one condition run together."""
        groups: dict[Condition, list[tuple[Trial, int]]] = {}
        for run in dict.fromkeys(runs):
            if run not in self.known:
                groups.setdefault(run[0].condition, []).append(run)
        for condition, group in groups.items():
            self._run(condition, group)
        return [self.known[run] for run in runs]

    def worst(self, trials: Sequence[Trial]) -> list[TrialResult]:
        """The worst result of all runs of each trial."""
        first = self.results([(trial, 0) for trial in trials])
        kept = [t for t, result in zip(trials, first, strict=True) if result.kept]
        self.results([(t, i) for t in kept if t.loop.random for i in range(1, self.seeds)])
        every = ([self.known.get((trial, i)) for i in range(self.seeds)] for trial in trials)
        return [min((r for r in results if r), key=lambda r: (r.kept, r.margin))
                for results in every]  # fmt: skip

    def _run(self, condition: Condition, runs: Sequence[tuple[Trial, int]]) -> None:
        """Make runs under one condition, and note their results."""
        experiment, limits, law = condition.experiment, self.limits[condition], self.law
        plant = experiment.plant(self.plant)
        rows = [
            Row(law.controller, case=replace(experiment.case, loop=trial.loop), number=number,
                plant=plant, predict=law.predict)
            for trial, number in runs
        ]  # fmt: skip
        outcomes = run_rows(
            experiment, rows, limits, self.plant, keep_impossible=True, threads=self.threads
        )
        for i, (trial, number) in enumerate(runs):
            judged = judgeable_in(limits, trial.loop, self.built)
            shares = [(float(outcomes[MARGIN + x.key][i] / x.value), x.key) for x in judged]
            margin, worst = min(shares, default=(1.0, ""))
            result = TrialResult(margin >= 0, margin, worst, number)
            if why := outcomes.impossible.get(i):
                result = TrialResult(False, -math.inf, "", number, why)
            elif not outcomes.completed[i]:
                result = TrialResult(False, -math.inf, outcomes["status"][i], number)
            self.known[trial, number] = result
