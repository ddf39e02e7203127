"""Measure of designs of a law: shares of the tightest limit, over conditions and draws."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from pydantic import BaseModel

from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GrosmcError
from grosmc_mj.output.results.verdicts import Unlimited, Verdict, over_draws
from grosmc_mj.studies.sweep.runs import Outcomes, Row, run_rows
from grosmc_mj.studies.target import limits_in
from grosmc_mj.studies.tune.conditions import TuningCondition
from grosmc_mj.studies.tune.numbers import Design, TunableLaw

# Value of a design that cannot be made; no run comes near it.
_REFUSED = 1e4
# Logarithm of the largest share that a value tells from a larger one.
_LARGEST = 300.0
# Least share that a value tells from none at all.
_LEAST_SHARE = 1e-6


class TriedDesign(BaseModel):
    """Design that a search has tried.

    Attributes:
        point: Coordinates of its numbers, (d,).
        tightest: Logarithm of the share of the tightest limit in the worst draw, by condition.
        shares: Share used in the worst draw of each limit that a run can fail, by condition and
            requirement.
        complete: Whether all its runs were made; of one that lost a race the others are missing.
        refused: Why it cannot be designed; empty if it can.
    """

    point: list[float]
    tightest: dict[str, float] = {}
    shares: dict[str, dict[str, Unlimited]] = {}
    complete: bool = True
    refused: str = ""

    @property
    def value(self) -> float:
        """Value that a search lowers; no further run of the design can lower it.

        Where limits are exceeded it is the sum of their logarithms over the conditions: a condition
        that cannot be kept is no reason to give up another one. Where all is kept it is that of the
        worst condition, 0 at most.
        """
        if self.refused:
            return _REFUSED
        exceeded = sum(max(0.0, tightest) for tightest in self.tightest.values())
        return exceeded or max(self.tightest.values(), default=-math.inf)

    @property
    def share(self) -> float:
        """Share of the tightest limit under the worst condition; infinite without a run."""
        return math.exp(max(self.tightest.values(), default=math.inf))


class TriedDesigns(BaseModel):
    """Designs that were tried together.

    Attributes:
        designs: The designs.
        runs: Runs that they took.
    """

    designs: list[TriedDesign]
    runs: int

    @property
    def values(self) -> Array:
        """Values of the designs, (n,)."""
        return np.array([design.value for design in self.designs])


@dataclass(eq=False)
class Measure:
    """Shares of the tightest limits of designs of a law, as a function that a search asks.

    A run that ended early or never gets there has a share, too: the longer it lasted, and the
    nearer it came, the smaller.

    Attributes:
        law: The law with its numbers.
        conditions: Conditions, in the order in which designs are run under them.
        limits: Requirements by condition.
        unfailing: Names of requirements by condition that no run can fail: they are judged, and
            have no part in the search.
        races: Whether a design that is worse than its parent already runs no more.
    """

    law: TunableLaw
    conditions: list[TuningCondition]
    races: bool = True
    limits: Mapping[str, tuple[Requirement, ...]] = field(init=False)
    unfailing: Mapping[str, set[str]] = field(init=False)

    def __post_init__(self) -> None:
        plant = self.law.experiment.nominal.truest
        self.limits = {
            item.name: limits_in(
                self.law.experiment.file.requirement, self.law.law, item.condition, [plant]
            )
            for item in self.conditions
        }
        for item in self.conditions:
            if not self.limits[item.name]:
                raise ArgumentError(
                    f"law {self.law.name}: no requirement of {item.condition.experiment.path} can "
                    f"be judged by a run under {item.name}"
                )
        self.unfailing = {item.name: self._unfailing(item) for item in self.conditions}

    def _unfailing(self, item: TuningCondition) -> set[str]:
        """Names of the requirements that no run under a condition can fail."""
        experiment = item.condition.experiment
        ranges = experiment.input_limits(experiment.plant(experiment.nominal.truest))
        controller = self.law.law.controller
        limits = self.limits[item.name]
        return {limit.name for limit in limits if limit.why_unfailing(controller, ranges)}

    @property
    def runs_of_point(self) -> int:
        """Runs of a design at most."""
        return sum(item.draws for item in self.conditions)

    def tried(self, points: Array, beat: Array) -> TriedDesigns:
        """Run designs; a design that cannot beat its value any more runs no more.

        Args:
            points: Coordinates of the designs' numbers, (n, d).
            beat: Value that each has to beat, (n,).
        """
        designs = [TriedDesign(point=point.tolist()) for point in points]
        laws: dict[int, Design] = {}
        for index, point in enumerate(points):
            try:
                laws[index] = self.law.designed(self.law.values_at(point))
            except (GrosmcError, ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
                designs[index].refused = str(error)

        runs = 0
        for item, draws in self._stages():
            racing = [i for i in laws if not self.races or designs[i].value <= beat[i]]
            for index in laws.keys() - set(racing):
                designs[index].complete = False
            if not racing:
                break
            outcomes = self.outcomes([laws[i] for i in racing], item, draws, self.asked(item))
            runs += len(racing) * len(draws)
            for place, index in enumerate(racing):
                rows = range(place * len(draws), (place + 1) * len(draws))
                self._note(designs[index], item, outcomes, rows)
        return TriedDesigns(designs=designs, runs=runs)

    def _stages(self) -> list[tuple[TuningCondition, range]]:
        """Runs of a design in their order: the first draw of the first condition comes alone."""
        first = self.conditions[0]
        stages = [(first, range(1))]
        if first.draws > 1:
            stages.append((first, range(1, first.draws)))
        return stages + [(item, range(item.draws)) for item in self.conditions[1:]]

    def asked(self, item: TuningCondition) -> list[Requirement]:
        """Return the requirements that a run can fail; all of them if there is none."""
        limits = self.limits[item.name]
        can_fail = [limit for limit in limits if limit.name not in self.unfailing[item.name]]
        return can_fail or list(limits)

    def outcomes(
        self,
        designs: Sequence[Design],
        item: TuningCondition,
        draws: Sequence[int],
        limits: Sequence[Requirement],
    ) -> Outcomes:
        """Run designs in draws of a condition: row i * draws + j is draw j of design i."""
        experiment = item.condition.experiment
        cases = [item.case(number) for number in draws]
        predict = self.law.law.predict
        rows = [
            Row(design.controller, case=design.case(case), predict=predict)
            for design in designs
            for case in cases
        ]
        return run_rows(
            experiment,
            rows,
            limits,
            experiment.nominal.truest,
            keep_impossible=True,
        )

    def _note(
        self, design: TriedDesign, item: TuningCondition, outcomes: Outcomes, rows: Sequence[int]
    ) -> None:
        """Note the runs of a design under a condition."""
        # The order of a run that cannot be made has no bound.
        used = np.clip(1 - outcomes["order"][list(rows)], _LEAST_SHARE, math.exp(_LARGEST))
        worst = float(np.log(used).max())
        design.tightest[item.name] = max(design.tightest.get(item.name, worst), worst)

        shares = design.shares.setdefault(item.name, {})
        for row in rows:
            for name, share in outcomes.verdict(row).shares.items():
                shares[name] = max(shares.get(name, 0.0), share)

    def judged(self, design: Design, step: str, first: int, count: int) -> list[Verdict]:
        """Return the verdict on a design under each condition, over draws.

        Args:
            design: The design.
            step: Step of the verdicts.
            first: Number of the first draw; where nothing is drawn there is one run.
            count: Number of draws.
        """
        verdicts = []
        for item in self.conditions:
            draws = range(first, first + count) if item.drawn else range(1)
            outcomes = self.outcomes([design], item, draws, self.limits[item.name])
            runs = [
                self._counted(outcomes.verdict(row, draw=number), item)
                for row, number in enumerate(draws)
            ]
            verdict = over_draws(runs)
            shares = {
                name: max(run.shares.get(name, math.inf) for run in runs) for name in verdict.shares
            }
            verdicts.append(
                verdict.changed(law=self.law.name, step=step, condition=item.name, shares=shares)
            )
        return verdicts

    def _counted(self, verdict: Verdict, item: TuningCondition) -> Verdict:
        """Return a verdict whose tightest limit is one that a run can fail, if there is any."""
        shares = {
            name: share
            for name, share in verdict.shares.items()
            if name not in self.unfailing[item.name]
        }
        if verdict.impossible or verdict.ended or not shares or not verdict.kept:
            return verdict
        tightest = max(shares, key=lambda name: shares[name])
        return verdict.changed(share=shares[tightest], tightest=tightest)
