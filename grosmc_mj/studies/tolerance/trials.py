"""Runs of a law in many loops, judged and none made twice."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.sweep.runs import MARGIN, Outcomes, Row, run_rows
from grosmc_mj.studies.target import Condition, StudiedLaw, judgeable_in
from grosmc_mj.theory.control.controller import Controller


class Trial(NamedTuple):
    """A loop under a condition.

    Attributes:
        condition: Plant and loads.
        loop: The loop.
        control_period: Control period [s]; None for that of the target.
    """

    condition: Condition
    loop: Loop
    control_period: float | None = None


class TrialResult(NamedTuple):
    """Result of a run.

    Attributes:
        kept: Whether it keeps all requirements.
        margin: The least margin over its limit; -inf for a run that ended early.
        worst: The requirement with the least margin, or how the run ended.
        number: Number of the draw.
        impossible: Why such a run cannot exist; empty if it can.
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
        limits: Limits that it must keep, by condition.
        built: The whole loop that the trials' loops are parts of.
        draws: Runs of a loop in which something is drawn.
        threads: Threads of the runs; 0 for all cores.
        known: Results by trial and number of the run.
    """

    law: StudiedLaw
    plant: PlantName
    limits: Mapping[Condition, Sequence[Requirement]]
    built: Loop
    draws: int
    threads: int = 0
    known: dict[tuple[Trial, int], TrialResult] = field(default_factory=dict)

    def results(self, runs: Sequence[tuple[Trial, int]]) -> list[TrialResult]:
        """Return results of runs, each a trial and a number.

        Runs under one condition with one control period run together.
        """
        groups: dict[tuple[Condition, float | None], list[tuple[Trial, int]]] = {}
        for run in dict.fromkeys(runs):
            if run not in self.known:
                trial = run[0]
                groups.setdefault((trial.condition, trial.control_period), []).append(run)
        for (condition, control_period), group in groups.items():
            self._run(condition, control_period, group)
        return [self.known[run] for run in runs]

    def worst(self, trials: Sequence[Trial]) -> list[TrialResult]:
        """Return the worst result of all runs of each trial."""
        first = self.results([(trial, 0) for trial in trials])
        runs: list[tuple[Trial, int]] = []
        for trial, result_of_first in zip(trials, first, strict=True):
            if result_of_first.kept and trial.loop.drawn:
                runs += [(trial, i) for i in range(1, self.draws)]
        self.results(runs)
        return [self._worst(trial) for trial in trials]

    def _worst(self, trial: Trial) -> TrialResult:
        """The worst result of the runs of a trial that have been made."""
        results = [self.known[trial, i] for i in range(self.draws) if (trial, i) in self.known]
        return min(results, key=lambda result: (result.kept, result.margin))

    def _run(
        self,
        condition: Condition,
        control_period: float | None,
        runs: Sequence[tuple[Trial, int]],
    ) -> None:
        """Make runs under one condition with one control period, and note their results."""
        experiment = condition.experiment
        law: str | Controller = self.law.controller
        if control_period is not None:
            # By its name the law, and its discrete surface, are designed for this period.
            experiment = experiment.with_settings(control_period=control_period, **self.law.sampled)
            law = self.law.base

        limits = self.limits[condition]
        plant = experiment.plant(self.plant)
        rows: list[Row] = []
        for trial, i in runs:
            case = experiment.varied(loop=trial.loop.draw(i))
            row = Row(law, case=case, number=i, plant=plant, predict=self.law.predict)
            rows.append(row)
        outcomes = run_rows(
            experiment, rows, limits, self.plant, keep_impossible=True, threads=self.threads
        )

        for index, (trial, i) in enumerate(runs):
            judged = judgeable_in(limits, trial.loop, self.built)
            self.known[trial, i] = _judged(outcomes, index, judged, i)


def _judged(
    outcomes: Outcomes,
    row: int,
    limits: Sequence[Requirement],
    number: int,
) -> TrialResult:
    """The result of a row of outcomes, judged by these limits."""
    impossible = outcomes.impossible.get(row)
    if impossible:
        return TrialResult(False, -math.inf, "", number, impossible)
    if not outcomes.completed[row]:
        return TrialResult(False, -math.inf, outcomes["status"][row], number)

    margins: list[tuple[float, str]] = []
    for limit in limits:
        margin = float(outcomes[MARGIN + limit.name][row] / limit.number)
        # A value that cannot be measured is not kept.
        margins.append((-math.inf if math.isnan(margin) else margin, limit.name))
    margin, worst = min(margins, default=(1.0, ""))
    return TrialResult(margin >= 0, margin, worst, number)
