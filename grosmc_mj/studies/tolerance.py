"""Largest imperfections of its loop that each law stands: equations search, MuJoCo confirms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rich.cells import cell_len

from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import LOOP_UNITS, unit_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.loop import Loop, Sensor
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.plants import System
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.results.charts import cell_charts
from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.result import (
    MEASURED,
    OPEN,
    Answer,
    CellChart,
    ReportTable,
    StudyVerdict,
    Value,
    result,
)
from grosmc_mj.results.tables import (
    WIDTH,
    Table,
    number,
    numbers,
    prefixed,
    table,
    words,
)
from grosmc_mj.studies.studied import (
    BENCH,
    Condition,
    StudiedLaw,
    case_for,
    chosen_laws,
    conditions_of,
    judgeable_in,
    limits_in,
    of_system,
)
from grosmc_mj.sweep.agreement import FACTOR, LEAST_BAND
from grosmc_mj.sweep.runs import MARGIN, Outcomes, Row, run_rows
from grosmc_mj.sweep.search import Search

# Name of all imperfections at once, in the bench's proportions.
ALL = "all"
# The grid: factors on an amount, each twice the one before.
LEAST = 2.0**-4
MOST = 2.0**10
# Factors up to this many times the largest that is kept are tried.
BEYOND = 2.0**5
# Ratio of the smallest factor that fails to the largest that is kept, at which a search ends.
RESOLUTION = 2.0**0.125
# More of these is less of an imperfection.
_LIMITS = ("limit", "rate_limit")
# Times are below this [s].
_LONGEST = 1.0
# Largest share of samples that are missed.
_MISSED = 0.99
# Amounts that are shown are about so many times the bench's, but for limits.
_TYPICAL = 100.0
# Share of the answers that are confirmed at random, though the equations are sure of them.
_RANDOM = 0.1
LEGEND = (
    "The largest amount up to which all is kept, of the first part. no: not kept without it; "
    "none: only without it; ≥ and ≤: kept up to the last that was tried; *: kept again beyond; "
    "!: MuJoCo differs from the equations, and counts."
)
NOTE = f"{LEGEND} Green: more than the bench has; red: less."
# Letters in a line of a header.
_LETTERS = 12
# Range of a chart's colours, to both sides of the bench's amount [octaves].
_OCTAVES = 6.0


# The design: imperfections, conditions, laws


class Amount(NamedTuple):
    """A number of one part of a loop.

    Attributes:
        kind: ``computing``, ``sensor`` or ``actuator``; ``run`` for the control period.
        of: State or input of the part; empty for the computer and the control period.
        quantity: Name of the number.
        value: Value on the bench, in ``unit``.
        unit: Its unit.
        most: The factor on it at which a physical bound is reached.
    """

    kind: str
    of: str
    quantity: str
    value: float
    unit: str
    most: float

    def scaled(self, factor: float) -> float:
        """Return the amount for a factor, within its bound; the ideal for 0."""
        if self.quantity not in _LIMITS:
            return self.value * min(factor, self.most)
        if factor > 0:
            return self.value / factor
        return math.inf


@dataclass(frozen=True)
class Imperfection:
    """Part of a loop that a factor scales, all else ideal.

    Attributes:
        name: Name for people.
        base: The loop without the imperfection.
        full: The loop with it, for every factor above 0, before the amounts are scaled.
        amounts: Numbers that the factor scales; none for an imperfection without a size.
        timestep: Timestep of the physics; times are whole multiples of it [s].
    """

    name: str
    base: Loop
    full: Loop
    amounts: tuple[Amount, ...]
    timestep: float

    @property
    def single(self) -> bool:
        """Whether it has a size, and is not all of them at once."""
        return bool(self.amounts) and self.name != ALL

    @property
    def limits(self) -> bool:
        """Whether less of it is worse."""
        return self.single and self.amounts[0].quantity in _LIMITS

    @property
    def least(self) -> float:
        """Smallest factor that is tried."""
        return LEAST

    @property
    def most(self) -> float:
        """Largest factor; of all at once each amount ends at its own bound."""
        if not self.single:
            return MOST
        return min(MOST, *(amount.most for amount in self.amounts))

    def control_period(self, factor: float) -> float | None:
        """Control period [s] of runs with this factor; None for that of the target."""
        return None

    def at(self, factor: float) -> Loop:
        """Return the loop with this factor on the bench's amounts, times on the timestep's grid."""
        loop = self.full if factor > 0 else self.base
        for amount in self.amounts:
            scaled = {amount.quantity: amount.scaled(factor)}
            loop = loop.changed(amount.kind, amount.of, **scaled)
        return loop.rounded(self.timestep)

    def amount(self, factor: float) -> float:
        """Return the first amount for a factor as it is run, in its unit; else the factor."""
        if not self.single:
            return factor
        first = self.amounts[0]
        value = first.scaled(factor)
        if first.quantity in TIMES:
            return time_as_run(first.quantity, value, self.timestep)
        return value

    @property
    def unit(self) -> tuple[str, float]:
        """The unit in which amounts are shown, and the factor to it; empty for none."""
        if not self.amounts:
            return "", 1.0
        if not self.single:
            return "times the bench", 1.0

        first = self.amounts[0]
        if not first.unit:
            return "%", 100.0
        typical = abs(first.value)
        if not self.limits:
            typical *= _TYPICAL
        return prefixed(first.unit, typical)

    @property
    def heading(self) -> str:
        """Name and unit."""
        unit, _ = self.unit
        if not unit:
            return self.name
        return f"{self.name} [{unit}]"

    def text(self, factor: float) -> str:
        """Return the amount for a factor, in the unit that is shown."""
        _, scale = self.unit
        return number(self.amount(factor) * scale)


@dataclass(frozen=True)
class LongerPeriod(Imperfection):
    """A longer control period than the target's in an ideal loop.

    A factor multiplies the period of the target. The result is a whole multiple of the timestep.
    """

    @property
    def least(self) -> float:
        """Smallest factor: the target's own period."""
        return 1.0

    def at(self, factor: float) -> Loop:
        """The ideal loop, with every factor."""
        return self.base

    def amount(self, factor: float) -> float:
        """Control period [s] for a factor; 0 for none."""
        return round(self.amounts[0].scaled(factor) / self.timestep) * self.timestep

    def control_period(self, factor: float) -> float | None:
        """Control period [s] of runs with this factor; None for that of the target."""
        if factor <= self.least:
            return None
        return self.amount(factor)


def imperfections(
    bench: Loop,
    system: System,
    timestep: float,
    control_period: float,
    *,
    longer_period: bool = False,
) -> list[Imperfection]:
    """Return each number of a bench's loop alone, rates that are estimated, and everything.

    Args:
        bench: The loop whose numbers are the units.
        system: System of the loop.
        timestep: Timestep of the physics [s].
        control_period: Control period of the target [s].
        longer_period: Whether a longer control period is one of them.
    """
    everything = list(_amounts(bench, system, timestep, control_period))
    groups: dict[str, list[Amount]] = {}
    # The bench's loop with ideal numbers: only its rates are estimated.
    estimated = bench
    for amount in everything:
        ideal_number = {amount.quantity: amount.scaled(0.0)}
        estimated = estimated.changed(amount.kind, amount.of, **ideal_number)
        title = f"{amount.kind} {amount.quantity}".replace("_", " ")
        groups.setdefault(title, []).append(amount)
    ideal = replace(estimated, estimators=(), sensors=_with_exact_rates(bench, estimated))

    kinds = [
        Imperfection(title, ideal, ideal, tuple(amounts), timestep)
        for title, amounts in groups.items()
    ]
    if longer_period:
        most = (_LONGEST - timestep) / control_period
        period = Amount("run", "", "control_period", control_period, "s", most)
        kinds.append(LongerPeriod("control period", ideal, ideal, (period,), timestep))

    if bench.estimators:
        rates = "estimated rates"
        kinds.append(Imperfection(rates, ideal, estimated, (), timestep))
        for title, amounts in groups.items():
            if title in ("sensor resolution", "sensor noise"):
                name = f"{title}, {rates}"
                kind = Imperfection(name, estimated, estimated, tuple(amounts), timestep)
                kinds.append(kind)
    kinds.append(Imperfection(ALL, estimated, estimated, tuple(everything), timestep))
    return kinds


def _with_exact_rates(bench: Loop, estimated: Loop) -> tuple[Sensor, ...]:
    """Sensors of a loop, and exact ones of the states that a bench estimates."""
    measured = {sensor.of for sensor in estimated.sensors}
    exact: list[Sensor] = []
    for part in bench.estimators:
        exact += [Sensor(name, exact=True) for name in part.of if name not in measured]
    return (*estimated.sensors, *exact)


def _amounts(
    bench: Loop, system: System, timestep: float, control_period: float
) -> Iterator[Amount]:
    """Yield every number of a bench that is an imperfection, with its physical bound."""
    for kind, part in bench.parts:
        if kind == "estimator":
            continue
        of: Any = getattr(part, "of", "")
        for item in fields(part):
            quantity = item.name
            # A factor is 1 where it is ideal, and has no more or less.
            if quantity not in LOOP_UNITS[kind] or quantity in ("scale", "gain"):
                continue
            value: Any = getattr(part, quantity)
            if value != 0 and math.isfinite(value):
                unit = unit_of(kind, of, quantity, system)
                bound = _bound(quantity, unit, timestep, control_period)
                yield Amount(kind, of, quantity, value, unit, bound / abs(value))


def _bound(
    quantity: str,
    unit: str,
    timestep: float,
    control_period: float,
) -> float:
    """The largest value that a number of a loop can have."""
    if quantity == "missed":
        return _MISSED
    if quantity == "jitter":
        return control_period - timestep
    if unit == "s":
        return _LONGEST - timestep
    return math.inf


@dataclass(frozen=True, eq=False)
class ToleranceStudy:
    """A target, ready to be studied.

    Attributes:
        experiment: Experiment of the target, without a loop.
        bench: The loop whose numbers are the units.
        bench_of: SYSTEM/CASE of the bench.
        laws: The laws.
        imperfections: Imperfections of the loop.
        conditions: Plants and loads, the nominal one first.
        named: The target on the command line.
    """

    experiment: Experiment
    bench: Loop
    bench_of: str
    laws: Sequence[StudiedLaw]
    imperfections: Sequence[Imperfection]
    conditions: Sequence[Condition]
    named: str

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process reads the target anew."""
        longer_period = any(isinstance(kind, LongerPeriod) for kind in self.imperfections)
        read = partial(tolerance_study, longer_period=longer_period)
        return read, (self.named, [law.name for law in self.laws])

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return self.experiment.target

    @property
    def plants(self) -> list[PlantName]:
        """The equations, if the target has any, and physics, if it has it."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Requirement, ...]:
        """Return the limits that a law must keep, whichever laws the file names."""
        return limits_in(self.experiment.file.requirement, law, condition, self.plants)


def tolerance_study(
    target: str,
    chosen: Sequence[str] = (),
    *,
    rivals: bool = False,
    longer_period: bool = False,
) -> ToleranceStudy:
    """Return a target with its bench, conditions and laws.

    Args:
        target: A system, which means its bench, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        rivals: Whether the default includes the rivals.
        longer_period: Whether a longer control period is one of the imperfections.

    Raises:
        ArgumentError: If there is no such target or law, no loop, or nothing is required.
    """
    experiment = case_for(target, BENCH)
    owner: Experiment | None = experiment
    if not experiment.loop:
        owner = of_system(experiment, BENCH)
    if owner is None or owner.loop is None:
        raise ArgumentError(
            f"{experiment.path}: there is no loop to take the amounts of imperfections from: give "
            "the file a [computing], a [[sensor]] or an [[actuator]]"
        )

    timestep = min(experiment.settings.timestep, owner.settings.timestep)
    bare = experiment.varied(loop=None).with_settings(timestep=timestep)
    kinds = imperfections(
        owner.loop,
        bare.nominal.system,
        timestep,
        bare.settings.control_period,
        longer_period=longer_period,
    )
    return ToleranceStudy(
        experiment=bare,
        bench=owner.loop,
        bench_of=owner.target,
        laws=chosen_laws(bare, chosen, rivals=rivals),
        imperfections=kinds,
        conditions=conditions_of(bare),
        named=target,
    )


# The reduction: a search of each answer


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of a law to an imperfection under a condition, in factors on the bench's amounts.

    Attributes:
        law: Name of the law.
        imperfection: The imperfection.
        condition: Name of the condition.
        kept_ideally: Whether all requirements are kept without the imperfection.
        largest_kept: Largest factor up to which all are kept; 0 if they are only without it.
        smallest_failed: Smallest factor at which one fails; None if none that was tried fails.
        kept_again: Ranges beyond that in which all are kept again.
        breaks: The requirement that fails there, or how that run ended; empty if none fails.
        physics_agrees: Whether MuJoCo gives the same at both ends; None where it was not run.
        impossible: Why such a loop cannot exist; empty if it can.
    """

    law: str
    imperfection: Imperfection
    condition: str
    kept_ideally: bool
    largest_kept: float
    smallest_failed: float | None = None
    kept_again: Sequence[tuple[float, float]] = ()
    breaks: str = ""
    physics_agrees: bool | None = None
    impossible: str = ""

    @property
    def weakness(self) -> float:
        """The smallest factor that fails, by which tolerances are compared; infinite if none."""
        if not self.kept_ideally or self.impossible:
            return 0.0
        if self.smallest_failed is None:
            return math.inf
        return self.smallest_failed

    @property
    def none(self) -> bool:
        """Whether all is kept only without it: with less than half a timestep of it at most."""
        return self.largest_kept == 0 or self.imperfection.amount(self.largest_kept) == 0

    @property
    def reason(self) -> str:
        """The requirement that fails, in words."""
        return self.breaks.replace("_", " ")

    @property
    def cell(self) -> str:
        """The tolerance in a cell of a table, without its unit."""
        cell = self._largest
        if self.kept_again:
            cell += "*"
        if self.physics_agrees is False:
            cell += "!"
        return cell

    @property
    def _largest(self) -> str:
        kind = self.imperfection
        if self.impossible:
            return "-"
        if not kind.amounts:
            return "yes" if self.kept_ideally and self.smallest_failed is None else "no"
        if not self.kept_ideally:
            return "no"
        if self.none:
            return "none"

        amount = kind.text(self.largest_kept)
        if self.smallest_failed is not None:
            return amount
        return f"≤ {amount}" if kind.limits else f"≥ {amount}"

    def amount_text(self, factor: float) -> str:
        """Return the amount for a factor with its unit; of all at once the factor."""
        return f"{self.imperfection.text(factor)} {self.imperfection.unit[0]}"

    def document(self) -> dict[str, Any]:
        """Return it as plain values, factors with their amounts."""
        smallest_failed = None
        if self.smallest_failed is not None:
            smallest_failed = self._level(self.smallest_failed)
        return {
            "law": self.law,
            "condition": self.condition,
            "kept_ideally": self.kept_ideally,
            "largest_kept": self._level(self.largest_kept),
            "smallest_failed": smallest_failed,
            "kept_again": [[self._level(low), self._level(high)] for low, high in self.kept_again],
            "breaks": self.breaks,
            "physics_agrees": self.physics_agrees,
            "impossible": self.impossible,
            "imperfection": self.imperfection.name,
        }

    def _level(self, factor: float) -> dict[str, float]:
        return {"factor": factor, "shown": self.imperfection.amount(factor)}


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
        number: Number of the run; it sets the random draws.
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
        seeds: Runs of a loop in which something is random.
        threads: Threads of the runs; 0 for all cores.
        known: Results by trial and number of the run.
    """

    law: StudiedLaw
    plant: PlantName
    limits: Mapping[Condition, Sequence[Requirement]]
    built: Loop
    seeds: int
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
            if result_of_first.kept and trial.loop.random:
                runs += [(trial, i) for i in range(1, self.seeds)]
        self.results(runs)
        return [self._worst(trial) for trial in trials]

    def _worst(self, trial: Trial) -> TrialResult:
        """The worst result of the runs of a trial that have been made."""
        results = [self.known[trial, i] for i in range(self.seeds) if (trial, i) in self.known]
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
            case = replace(experiment, loop=trial.loop)
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
        margins.append((margin, limit.name))
    margin, worst = min(margins, default=(1.0, ""))
    return TrialResult(margin >= 0, margin, worst, number)


def geometric_mean(low: float, high: float) -> float:
    """Return the middle of two factors."""
    return math.sqrt(low * high)


def resolved(low: float, high: float) -> bool:
    """Whether two factors are near enough to end a search."""
    return high / low <= RESOLUTION * (1 + 1e-9)


class ToleranceSearch(Search):
    """Search for the tolerance of a law to one imperfection under one condition."""

    def __init__(self, imperfection: Imperfection, condition: Condition) -> None:
        super().__init__(
            imperfection.most,
            geometric_mean,
            resolved,
            least=imperfection.least,
            same=self.trial,
        )
        self.imperfection = imperfection
        self.condition = condition
        self.results: dict[float, TrialResult] = {}
        # Factors of which all random runs have been made.
        self.sure: set[float] = set()

    def trial(self, factor: float) -> Trial:
        """Return the trial of a factor."""
        loop = self.imperfection.at(factor)
        return Trial(self.condition, loop, self.imperfection.control_period(factor))

    def note(self, factor: float, result: TrialResult) -> None:
        """Note the result of a factor."""
        self.results[factor] = result
        if factor > 0:
            self.known[factor] = result.kept

    @property
    def fails_without(self) -> bool:
        """Whether it fails without the imperfection, so that less of it cannot help."""
        return not self.results[0.0].kept and not self.results[0.0].impossible

    @property
    def weakness(self) -> tuple[bool, float]:
        """Key of the least search; a condition that is not kept ideally comes last."""
        return self.fails_without, self.largest or 0.0

    @property
    def impossible(self) -> str:
        """Why such a loop cannot exist, with any amount; empty if it can."""
        reasons = [result.impossible for factor, result in self.results.items() if factor > 0]
        if reasons and all(reasons):
            return reasons[0]
        return ""

    @property
    def ends(self) -> list[float]:
        """The largest factor that is kept, 0 if none is, and the smallest that fails."""
        ends = [self.largest or 0.0]
        if self.failed is not None and not self.impossible:
            ends.append(self.failed)
        return ends

    def next_factors(self, *, local: bool) -> list[float]:
        """Return the factors to be tried now, near those that were tried or on the grid."""
        if self.fails_without:
            return []
        if not self.imperfection.amounts:
            return [] if self.known else [1.0]
        if local:
            return self.factors()
        return self.on_grid(BEYOND)

    def unsure(self) -> list[float]:
        """Return the largest factor that is kept, if it is known from the first run alone."""
        largest = self.largest
        if largest is None or largest in self.sure:
            return []
        if not self.imperfection.at(largest).random:
            return []
        return [largest]

    def tolerance(self, law: str, agrees: bool | None) -> Tolerance:
        """Return the answer for a law."""
        first = self.results[0.0]
        end = self.results.get(self.failed or 0.0, first)
        return Tolerance(
            law=law,
            imperfection=self.imperfection,
            condition=self.condition.name,
            kept_ideally=first.kept or (bool(first.impossible) and self.largest is not None),
            largest_kept=self.largest or 0.0,
            smallest_failed=self.failed,
            kept_again=self.again,
            breaks="" if end.kept else end.worst,
            physics_agrees=agrees,
            impossible=self.impossible,
        )


def tolerances_of_laws(
    studied: ToleranceStudy,
    seeds: int,
    executor: Executor,
    notice: Notice = lambda _: None,
) -> Iterator[tuple[int, list[Tolerance]]]:
    """Yield the tolerances of each law, by its number, in the order in which laws finish.

    Args:
        studied: The target.
        seeds: Runs of a loop in which something is random.
        executor: Executor of the processes; each reads the target again.
        notice: Called if a worker died and was replaced.
    """
    study_law = partial(tolerances, studied, seeds=seeds, threads=executor.threads_per_worker)
    with closing(executor.run(study_law, range(len(studied.laws)), notice)) as answers:
        for answer in answers:
            yield answer.index, answer.report


def tolerances(
    studied: ToleranceStudy, index: int, seeds: int, threads: int = 0
) -> list[Tolerance]:
    """Return the tolerances of a law to each imperfection under each condition.

    MuJoCo runs at both ends of those answers of the equations that matter: of the least one over
    the conditions for each imperfection those next to a limit, the least of all, and some at
    random.

    Args:
        studied: The target.
        index: Number of one of its laws.
        seeds: Runs of a loop in which something is random.
        threads: Threads of its runs; 0 for all cores.
    """
    law = studied.laws[index]
    limits = {condition: studied.limits(law, condition) for condition in studied.conditions}
    equations, *physics = (
        Trials(law, plant, limits, studied.bench, seeds, threads) for plant in studied.plants
    )
    searches = [
        ToleranceSearch(imperfection, condition)
        for imperfection in studied.imperfections
        for condition in studied.conditions
    ]
    _answer(searches, equations)

    agreed: dict[ToleranceSearch, bool] = {}
    if physics:
        chosen: list[ToleranceSearch] = []
        for imperfection in studied.imperfections:
            conditions = [search for search in searches if search.imperfection is imperfection]
            chosen.append(min(conditions, key=lambda search: search.weakness))
        chosen += [search for search in searches if search.fails_without]
        agreed = _screened(list(dict.fromkeys(chosen)), physics[0])
    return [search.tolerance(law.name, agreed.get(search)) for search in searches]


def _answer(searches: Sequence[ToleranceSearch], trials: Trials, *, local: bool = False) -> None:
    """Run every search to its end, all runs of a round in one batch.

    Where something is random, the first run looks for the amount, and all of them must keep it.
    """
    unknown = [search for search in searches if 0.0 not in search.results]
    ideal = trials.worst([search.trial(0.0) for search in unknown])
    for search, outcome in zip(unknown, ideal, strict=True):
        search.note(0.0, outcome)

    while True:
        tried = [(search, x) for search in searches for x in search.next_factors(local=local)]
        if tried:
            outcomes = trials.results([(search.trial(factor), 0) for search, factor in tried])
            for (search, factor), outcome in zip(tried, outcomes, strict=True):
                search.note(factor, outcome)
            continue

        unsure = [(search, factor) for search in searches for factor in search.unsure()]
        if not unsure:
            return
        outcomes = trials.worst([search.trial(factor) for search, factor in unsure])
        for (search, factor), outcome in zip(unsure, outcomes, strict=True):
            search.note(factor, outcome)
            search.sure.add(factor)


def _screened(searches: Sequence[ToleranceSearch], physics: Trials) -> dict[ToleranceSearch, bool]:
    """Confirm the least, some at random and all that are next to a limit, as ``_confirmed`` does.

    Next to a limit is as near as the equations have been wrong, with a factor. If MuJoCo differs
    once, it confirms all.
    """
    chance = np.random.default_rng(len(searches)).random(len(searches)) < _RANDOM
    chosen = [search for search, drawn in zip(searches, chance, strict=True) if drawn]
    chosen.append(min(searches, key=lambda search: search.weakness))

    agreed: dict[ToleranceSearch, bool] = {}
    band = LEAST_BAND
    while chosen:
        # Noted first: the results of a search that MuJoCo answers otherwise are replaced.
        ours = [(search, end, search.results[end]) for search in chosen for end in search.ends]
        agreed |= _confirmed(list(dict.fromkeys(chosen)), physics)
        for search, end, outcome in ours:
            theirs = physics.known[search.trial(end), outcome.number]
            difference = abs(outcome.margin - theirs.margin)
            if math.isfinite(difference):
                band = max(band, FACTOR * difference)

        chosen = [search for search in searches if search not in agreed]
        if all(agreed.values()):
            chosen = [search for search in chosen if _least_margin(search) <= band]
    return agreed


def _least_margin(search: ToleranceSearch) -> float:
    """Distance from a limit at the nearer end of a search."""
    return min(abs(search.results[end].margin) for end in search.ends)


def _confirmed(searches: Sequence[ToleranceSearch], physics: Trials) -> dict[ToleranceSearch, bool]:
    """Whether MuJoCo agrees at both ends of each; where it differs, its own answer replaces it.

    Of several runs the one that decides is made.
    """
    ends = [(search, end) for search in searches for end in search.ends]
    runs = [(search.trial(end), search.results[end].number) for search, end in ends]
    theirs = {search: ToleranceSearch(search.imperfection, search.condition) for search in searches}
    differing: dict[ToleranceSearch, ToleranceSearch] = {}
    for (search, end), outcome in zip(ends, physics.results(runs), strict=True):
        theirs[search].note(end, outcome)
        if outcome.kept != search.results[end].kept:
            differing[search] = theirs[search]

    _answer(list(differing.values()), physics, local=True)
    for search, other in differing.items():
        search.known = other.known
        search.results = other.results
    return {search: search not in differing for search in searches}


# The answer: words, tables, charts, document


def kept_ideally(rows: Iterable[Tolerance]) -> set[tuple[str, str]]:
    """Return laws with the conditions under which each keeps all without any imperfection."""
    sized = [row for row in rows if row.imperfection.amounts]
    return {(row.law, row.condition) for row in sized if row.kept_ideally}


def least_of(rows: Sequence[Tolerance]) -> dict[tuple[str, str], Tolerance]:
    """Return the least by law and imperfection, over the conditions that the law stands."""
    least: dict[tuple[str, str], Tolerance] = {}
    ideal = kept_ideally(rows)
    for row in rows:
        if (row.law, row.condition) in ideal:
            key = row.law, row.imperfection.name
            least[key] = min(
                least.get(key, row), row, key=lambda row: (row.weakness, row.largest_kept)
            )
    return least


def verdict(rows: Sequence[Tolerance]) -> str:
    """Return one sentence: which law breaks first, at which amount of which imperfection."""
    broken = [
        row for row in rows if row.kept_ideally and row.smallest_failed and row.imperfection.single
    ]
    if not broken:
        return "No single imperfection that was tried breaks what a law keeps without it."

    worst = min(broken, key=lambda row: row.weakness)
    kept = f"up to {_beside_bench(worst, worst.largest_kept)}"
    if worst.none:
        kept = "only without it"
    where = ""
    if worst.condition != "nominal":
        where = f" under {worst.condition}"
    return (
        f"{worst.law} breaks first, by {worst.imperfection.name}{where}: all is kept {kept}, and "
        f"no longer at {_beside_bench(worst, worst.weakness)}: {worst.reason}."
    )


def _beside_bench(row: Tolerance, factor: float) -> str:
    """The amount for a factor, and the factor."""
    return f"{row.amount_text(factor)} ({number(factor)} times the bench's)"


def confirmed(rows: Sequence[Tolerance]) -> tuple[int, int]:
    """Return how many answers MuJoCo checked, and how many of them differ."""
    agrees = [row.physics_agrees for row in rows if row.physics_agrees is not None]
    return len(agrees), agrees.count(False)


def least_table(rows: Sequence[Tolerance], title: str = "") -> Table:
    """Return laws by imperfections: the least over the conditions that a law keeps ideally.

    The strongest law stands first, and the imperfection with the smallest tolerance.
    """
    least = least_of(rows)
    ideal = kept_ideally(rows)
    conditions = dict.fromkeys(row.condition for row in rows)
    kept = {law: [name for name in conditions if (law, name) in ideal] for law, _ in least}

    # The weakest law decides the order of imperfections, the least of all at once that of laws.
    kinds: dict[str, Imperfection] = {}
    weakest: dict[str, float] = {}
    strength = {law: (len(names), 0.0) for law, names in kept.items()}
    for (law, kind), row in least.items():
        kinds[kind] = row.imperfection
        if row.kept_ideally:
            weakest[kind] = min(row.weakness, weakest.get(kind, math.inf))
        if kind == ALL:
            strength[law] = (len(kept[law]), row.weakness)

    ordered = sorted(kinds, key=lambda kind: weakest.get(kind, 0.0))
    cells = []
    for law in sorted(kept, key=strength.__getitem__, reverse=True):
        answers = [least.get((law, kind)) for kind in ordered]
        texts = [answer.cell if answer else "" for answer in answers]
        cells.append([law, ", ".join(kept[law]), *texts])

    headings = [in_lines(kinds[kind].heading, _LETTERS) for kind in ordered]
    columns = [*words("law", "keeps ideally"), *numbers(*headings)]
    return table(title, columns, cells, legend=LEGEND)


def in_width(wide: Table, width: int = WIDTH) -> tuple[Table, list[str]]:
    """Return the first columns of a table that fit into a width, and the headers of the others."""
    room = 0
    used = 0
    for index, column in enumerate(wide.columns):
        texts = [column.header, *(row[index] for row in wide.rows)]
        lines = "\n".join(texts).split("\n")
        used += max(cell_len(line) for line in lines) + 2
        if used > width:
            break
        room += 1

    outside = [column.header.replace("\n", " ") for column in wide.columns[room:]]
    rows = [row[:room] for row in wide.rows]
    return wide.model_copy(update={"columns": wide.columns[:room], "rows": rows}), outside


def charts(studied: ToleranceStudy, rows: Sequence[Tolerance]) -> list[CellChart]:
    """Return a map for each condition: octaves below the bench's amount, blue for more of it."""
    cells = []
    for row in rows:
        if not row.impossible:
            reason = ""
            if row.breaks:
                reason = f"then breaks: {row.reason}"
            place = (row.condition, row.law, row.imperfection.heading)
            cells.append((*place, -_octaves(row), row.cell, reason))
    titles = {}
    for condition in studied.conditions:
        titles[condition.name] = f"{condition.name}: {condition.title}"
    return list(cell_charts(titles, cells, _OCTAVES).values())


def _octaves(row: Tolerance) -> float:
    """Octaves from the bench's amount to the largest that is kept, within the chart's colours."""
    if math.isinf(row.weakness):
        return _OCTAVES
    if row.none or not row.kept_ideally:
        return -_OCTAVES
    return max(-_OCTAVES, min(_OCTAVES, math.log2(row.largest_kept)))


def _standings(target: str, rows: Sequence[Tolerance], *, complete: bool) -> Iterator[StudyVerdict]:
    """Yield the smallest tolerance of each law."""
    for law in dict.fromkeys(row.law for row in rows):
        kept = [row for row in rows if row.law == law and row.kept_ideally]
        failed = [row for row in kept if row.smallest_failed is not None]
        breaks_at = ""
        answer = "stands all that was tried"
        if not kept:
            breaks_at = "ideal loop"
            answer = "not kept even in an ideal loop"
        elif failed:
            least = min(failed, key=lambda row: row.largest_kept)
            breaks_at = least.imperfection.name
            if breaks_at == ALL:
                breaks_at = "all of them"
            amount = f"up to {least.amount_text(least.largest_kept)}"
            if least.none:
                amount = "only without it"
            answer = f"kept {amount}, then {least.reason} ({least.condition})"
        yield StudyVerdict(
            case=target, law=law, breaks_at=breaks_at, words=answer, complete=complete
        )


def _values(target: str, rows: Sequence[Tolerance]) -> Iterator[Value]:
    for row in rows:
        if not row.impossible:
            name = f"{target} {row.condition} {row.law}, {row.imperfection.name}"
            yield Value(name=f"{name}: ideally", value="kept" if row.kept_ideally else "not kept")
            largest = row.largest_kept
            yield Value(name=f"{name}: largest kept", value=largest, better=1, relative=0.1)


def tolerance_document(
    studied: ToleranceStudy, rows: Sequence[Tolerance], seeds: int, *, complete: bool
) -> dict[str, Any]:
    """Return the content of tolerance_NAME.json.

    Args:
        studied: The target.
        rows: Its tolerances.
        seeds: Runs where something is random.
        complete: Whether nothing was interrupted.
    """
    target = studied.target
    checked, differing = confirmed(rows)
    sheet = ReportTable(
        table=least_table(rows, f"{target}: tolerances"), charts=charts(studied, rows)
    )
    return result(
        "tolerance",
        _configuration(studied, seeds),
        seed=studied.bench.seed,
        complete=complete,
        answers=[_document_answer(target, rows, complete=complete)],
        standings=_standings(target, rows, complete=complete),
        sheets=[sheet],
        values=_values(target, rows),
        target=target,
        conditions=[{"name": x.name, "title": x.title} for x in studied.conditions],
        imperfections=[_imperfection_document(kind) for kind in studied.imperfections],
        laws=[_law_document(studied, law) for law in studied.laws],
        physics={"answers_checked": checked, "answers_that_differ": differing},
        tolerances=[row.document() for row in rows],
    )


def _configuration(studied: ToleranceStudy, seeds: int) -> dict[str, Any]:
    settings = studied.experiment.settings
    return {
        "target": studied.target,
        "bench": studied.bench_of,
        "control_period": {"value": settings.control_period, "unit": "s"},
        "timestep": {"value": settings.timestep, "unit": "s"},
        "runs_where_random": seeds,
        "factors": {
            "least": LEAST,
            "most": MOST,
            "grid": 2.0,
            "beyond_the_last_kept": BEYOND,
            "resolution": RESOLUTION,
        },
    }


def _document_answer(target: str, rows: Sequence[Tolerance], *, complete: bool) -> Answer:
    laws = {row.law for row in rows}
    weak = {row.law for row in rows if not row.kept_ideally}
    answer = f"{len(laws) - len(weak)} of {len(laws)} laws keep all in every ideal loop"
    if not complete:
        answer += ", so far"
    return Answer(
        question=f"Tolerance of {target}",
        verdict=MEASURED if complete else OPEN,
        words=answer,
        more=verdict(rows),
    )


def _imperfection_document(kind: Imperfection) -> dict[str, Any]:
    return {
        "name": kind.name,
        "bench": kind.amount(1.0),
        "amounts": [amount._asdict() for amount in kind.amounts],
    }


def _law_document(studied: ToleranceStudy, law: StudiedLaw) -> dict[str, Any]:
    requirements = {}
    for condition in studied.conditions:
        limits = studied.limits(law, condition)
        requirements[condition.name] = [limit.words for limit in limits]
    return {
        "name": law.name,
        "predicts": law.predict,
        "sampled": law.sampled,
        "requirements": requirements,
    }


def tolerances_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Return a heading and the table of each document, for ``docs/tolerance.md``."""
    parts = []
    for document in documents:
        least = Table.model_validate(document["sheets"][0]["table"])
        lines = [line.replace("\n", " ") for line in least.markdown()]
        checked, differing = document["physics"].values()
        ending = f"MuJoCo confirmed {checked - differing} of {checked} answers."
        parts.append("\n".join([f"**{document['target']}**", "", *lines, "", ending]))
    return "\n\n".join(parts)
