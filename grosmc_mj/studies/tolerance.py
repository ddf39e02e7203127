"""How much of each imperfection of its loop each law stands: equations search, MuJoCo confirms."""

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
from grosmc_mj.experiments.requirements import Limit
from grosmc_mj.loop import Loop
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.plants import System
from grosmc_mj.results.charts import cell_charts
from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.result import (
    MEASURED,
    OPEN,
    Answer,
    CellChart,
    Sheet,
    Standing,
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
from grosmc_mj.sweep.runs import MARGIN, Row, run_rows
from grosmc_mj.sweep.search import Search

# The case of a system whose loop is that of equipment that one can buy.
BENCH = "bench"
# Name of all imperfections at once, in the bench's proportions.
ALL = "all"
# The grid: factors on an amount, each twice the one before.
LEAST, MOST = 2.0**-4, 2.0**10
# Factors up to this many times the largest that is kept are tried.
BEYOND = 2.0**5
# Between the largest that is kept and the smallest that fails.
RESOLUTION = 2.0**0.125
# More of these is less of an imperfection.
_LIMITS = ("limit", "rate_limit")
# Times are below this [s], and so many samples come through at least.
_LONGEST, _MISSED = 1.0, 0.99
# Amounts that are shown are about so many times the bench's, but for limits.
_TYPICAL = 100.0
# Of the answers that the equations are sure of, this part is confirmed all the same.
_RANDOM = 0.1
LEGEND = (
    "The largest amount up to which all is kept, of the first part. no: not kept without it; "
    "none: only without it; ≥ and ≤: kept up to the last that was tried; *: kept again beyond; "
    "!: MuJoCo differs from the equations, and counts."
)
NOTE = f"{LEGEND} Green: more than the bench has; red: less."
# Letters in a line of a header, and octaves of a chart's colours.
_LETTERS, _OCTAVES = 12, 6.0


# The design: imperfections, conditions, laws


class Amount(NamedTuple):
    """A number of one part of a loop.

    Attributes:
        kind: ``computing``, ``sensor`` or ``actuator``; ``run`` for the control period.
        of: The state or input that it is of; empty for the computer and the control period.
        quantity: Which number.
        value: What the bench has, in ``unit``.
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
        """The amount for a factor, within its bound; 0 for the ideal."""
        if self.quantity in _LIMITS:
            return self.value / factor if factor > 0 else math.inf
        return self.value * min(factor, self.most)


@dataclass(frozen=True)
class Imperfection:
    """Part of a loop that a factor scales, all else ideal.

    Attributes:
        name: For people.
        base: The loop without it.
        full: The loop with what is there or not, but without what the factor scales.
        amounts: What the factor scales; none for what is there or not.
        timestep: Of the physics; times are whole multiples of it [s].
    """

    name: str
    base: Loop
    full: Loop
    amounts: tuple[Amount, ...]
    timestep: float

    @property
    def single(self) -> bool:
        """Whether there is more or less of it, and it is not all of them at once."""
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
        """The factor where it ends; of all at once each ends where it must."""
        return min([MOST, *(x.most for x in self.amounts if self.single)])

    def control_period(self, factor: float) -> float | None:
        """Control period [s] of runs with this factor; None for that of the target."""
        return None

    def at(self, factor: float) -> Loop:
        """The loop with this factor on what the bench has, its times on the timestep's grid."""
        loop = self.full if factor > 0 else self.base
        for amount in self.amounts:
            loop = loop.changed(amount.kind, amount.of, **{amount.quantity: amount.scaled(factor)})
        return loop.rounded(self.timestep)

    def amount(self, factor: float) -> float:
        """The first amount for a factor as it is run, in its unit; the factor if it has none."""
        if not self.single:
            return factor
        first = self.amounts[0]
        value = first.scaled(factor)
        return (
            time_as_run(first.quantity, value, self.timestep) if first.quantity in TIMES else value
        )

    @property
    def unit(self) -> tuple[str, float]:
        """The unit in which amounts are shown, and the factor to it; empty for none."""
        if not self.single:
            return ("times the bench" if self.amounts else ""), 1.0
        first = self.amounts[0]
        typical = abs(first.value) * (1.0 if self.limits else _TYPICAL)
        return prefixed(first.unit, typical) if first.unit else ("%", 100.0)

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit[0]}]" if self.unit[0] else self.name

    def text(self, factor: float) -> str:
        """The amount for a factor, in the unit that is shown."""
        return number(self.amount(factor) * self.unit[1])


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
        return None if factor <= self.least else self.amount(factor)


def imperfections(
    bench: Loop,
    system: System,
    timestep: float,
    control_period: float,
    *,
    longer_period: bool = False,
) -> list[Imperfection]:
    """Each number of a bench's loop alone, rates that are estimated, and everything.

    Args:
        bench: The loop whose numbers are the units.
        system: Whose.
        timestep: [s].
        control_period: [s].
        longer_period: Whether a longer control period is one of them.
    """
    everything = list(_amounts(bench, system, timestep, control_period))
    estimated = bench
    groups: dict[tuple[str, str], list[Amount]] = {}
    for amount in everything:
        ideal_number = {amount.quantity: amount.scaled(0.0)}
        estimated = estimated.changed(amount.kind, amount.of, **ideal_number)
        groups.setdefault((amount.kind, amount.quantity), []).append(amount)
    ideal = replace(estimated, estimators=())
    titles = {key: " ".join(key).replace("_", " ") for key in groups}
    single = [
        Imperfection(titles[key], ideal, ideal, tuple(amounts), timestep)
        for key, amounts in groups.items()
    ]
    if longer_period:
        most = (_LONGEST - timestep) / control_period
        period = Amount("run", "", "control_period", control_period, "s", most)
        single.append(LongerPeriod("control period", ideal, ideal, (period,), timestep))
    every = Imperfection(ALL, estimated, estimated, tuple(everything), timestep)
    if not bench.estimators:
        return [*single, every]
    name = "estimated rates"
    rates = [Imperfection(name, ideal, estimated, (), timestep)] + [
        Imperfection(f"{titles[key]}, {name}", estimated, estimated, tuple(amounts), timestep)
        for key, amounts in groups.items()
        if key in (("sensor", "resolution"), ("sensor", "noise"))
    ]
    return [*single, *rates, every]


def _amounts(
    bench: Loop, system: System, timestep: float, control_period: float
) -> Iterator[Amount]:
    """Every number of a bench that is an imperfection, with its physical bound."""
    for kind, part in bench.parts:
        if kind == "estimator":
            continue
        of: Any = getattr(part, "of", "")
        for item in fields(part):
            value: Any = getattr(part, item.name)
            # A sensor's scale is 1 where it is ideal, and has no more or less.
            known = item.name in LOOP_UNITS[kind] and item.name != "scale"
            if known and value != 0 and math.isfinite(value):
                unit = unit_of(kind, of, item.name, system)
                most = _LONGEST - timestep if unit == "s" else math.inf
                most = {"missed": _MISSED, "jitter": control_period - timestep}.get(item.name, most)
                yield Amount(kind, of, item.name, value, unit, most / abs(value))


@dataclass(frozen=True, eq=False)
class Setting:
    """A target, ready to be studied.

    Attributes:
        experiment: The target's.
        bench: The loop whose numbers are the units.
        bench_of: Whose it is.
        laws: The laws.
        imperfections: Of the loop.
        conditions: The nominal one first.
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
        """For another process: the target, to be read there."""
        longer_period = any(isinstance(x, LongerPeriod) for x in self.imperfections)
        read = partial(setting, longer_period=longer_period)
        return read, (self.named, [law.name for law in self.laws])

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return f"{self.experiment.case.system}/{self.experiment.case.name}"

    @property
    def plants(self) -> list[PlantName]:
        """The equations, if there are any, and physics, if there is."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Limit, ...]:
        """Limits that a law must keep, whichever laws the file names."""
        return limits_in(self.experiment.file.requirement, law, condition, self.plants)


def setting(
    target: str, chosen: Sequence[str] = (), *, rivals: bool = False, longer_period: bool = False
) -> Setting:
    """A target with its bench, conditions and laws.

    Args:
        target: A system, which means its bench, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        rivals: Whether all includes the rivals.
        longer_period: Whether a longer control period is one of the imperfections.

    Raises:
        ArgumentError: If there is no such target or law, no loop, or nothing is required.
    """
    experiment = case_for(target, BENCH)
    owner = experiment if experiment.case.loop else of_system(experiment, BENCH)
    if owner is None or owner.case.loop is None:
        raise ArgumentError(
            f"{experiment.path}: there is no loop to take the amounts of imperfections from: give "
            "the file a [computing], a [[sensor]] or an [[actuator]]"
        )
    timestep = min(experiment.settings.timestep, owner.settings.timestep)
    bare = experiment.varied(loop=None).with_settings(timestep=timestep)
    found = imperfections(
        owner.case.loop,
        bare.nominal.system,
        timestep,
        bare.settings.control_period,
        longer_period=longer_period,
    )
    return Setting(
        experiment=bare,
        bench=owner.case.loop,
        bench_of=f"{owner.case.system}/{owner.case.name}",
        laws=chosen_laws(bare, chosen, rivals=rivals),
        imperfections=found,
        conditions=conditions_of(bare),
        named=target,
    )


# The reduction: a search of each answer


@dataclass(frozen=True)
class Tolerance:
    """How much of an imperfection a law stands under a condition; amounts are factors on the bench.

    Attributes:
        law: Name of the law.
        imperfection: The imperfection.
        condition: Name of the condition.
        kept_ideally: Whether all is kept without any of it.
        largest_kept: Up to where all that was tried is kept; 0 if only none of it is.
        smallest_failed: The smallest that fails; None if none that was tried does.
        kept_again: Where all is kept again beyond that, from where to where.
        breaks: The requirement that fails there, or how that run ended; empty if none does.
        physics_agrees: Whether MuJoCo says the same at both ends; None where it was not run.
        impossible: Why there can be no such loop; empty if there can.
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
        """By which tolerances are compared: the factor that fails, infinite if none does."""
        if not self.kept_ideally or self.impossible:
            return 0.0
        return math.inf if self.smallest_failed is None else self.smallest_failed

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
        kind = self.imperfection
        if self.impossible:
            shown = "-"
        elif not kind.amounts:
            shown = "yes" if self.kept_ideally and self.smallest_failed is None else "no"
        elif not self.kept_ideally:
            shown = "no"
        elif self.none:
            shown = "none"
        else:
            endless = ("≤ " if kind.limits else "≥ ") if self.smallest_failed is None else ""
            shown = endless + kind.text(self.largest_kept)
        return shown + "*" * bool(self.kept_again) + "!" * (self.physics_agrees is False)

    def amount_text(self, factor: float) -> str:
        """The amount for a factor with its unit; of all at once the factor."""
        return f"{self.imperfection.text(factor)} {self.imperfection.unit[0]}"

    def document(self) -> dict[str, Any]:
        """It as plain values, factors with their amounts."""

        def level(factor: float) -> dict[str, float]:
            return {"factor": factor, "shown": self.imperfection.amount(factor)}

        failed = self.smallest_failed
        return {name: value for name, value in vars(self).items() if name != "imperfection"} | {
            "imperfection": self.imperfection.name,
            "largest_kept": level(self.largest_kept),
            "smallest_failed": None if failed is None else level(failed),
            "kept_again": [[level(low), level(high)] for low, high in self.kept_again],
        }


class Trial(NamedTuple):
    """A loop under a condition.

    Attributes:
        condition: Plant and loads.
        loop: The loop.
        control_period: [s]; None for that of the target.
    """

    condition: Condition
    loop: Loop
    control_period: float | None = None


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
        """Results of runs, by trial and number.

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
        """The worst result of all runs of each trial."""
        first = self.results([(trial, 0) for trial in trials])
        kept = [t for t, outcome in zip(trials, first, strict=True) if outcome.kept]
        self.results([(t, i) for t in kept if t.loop.random for i in range(1, self.seeds)])
        runs = ([self.known.get((trial, i)) for i in range(self.seeds)] for trial in trials)
        return [min((r for r in own if r), key=lambda r: (r.kept, r.margin)) for own in runs]

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
            # The law by its name: it is sampled, and its discrete surface designed, once more.
            experiment = experiment.with_settings(control_period=control_period, **self.law.sampled)
            law = self.law.base

        limits = self.limits[condition]
        plant = experiment.plant(self.plant)
        rows = [
            Row(
                law,
                case=replace(experiment.case, loop=trial.loop),
                number=i,
                plant=plant,
                predict=self.law.predict,
            )
            for trial, i in runs
        ]
        outcomes = run_rows(
            experiment, rows, limits, self.plant, keep_impossible=True, threads=self.threads
        )
        for row, (trial, i) in enumerate(runs):
            judged = judgeable_in(limits, trial.loop, self.built)
            shares = [(float(outcomes[MARGIN + x.key][row] / x.value), x.key) for x in judged]
            margin, worst = min(shares, default=(1.0, ""))
            outcome = TrialResult(margin >= 0, margin, worst, i)
            if why := outcomes.impossible.get(row):
                outcome = TrialResult(False, -math.inf, "", i, why)
            elif not outcomes.completed[row]:
                outcome = TrialResult(False, -math.inf, outcomes["status"][row], i)
            self.known[trial, i] = outcome


def geometric_mean(low: float, high: float) -> float:
    """The middle of two factors."""
    return math.sqrt(low * high)


def resolved(low: float, high: float) -> bool:
    """Whether two factors are as near as is wanted."""
    return high / low <= RESOLUTION * (1 + 1e-9)


class Question(Search):
    """One tolerance that is searched."""

    def __init__(self, imperfection: Imperfection, condition: Condition) -> None:
        super().__init__(
            imperfection.most,
            geometric_mean,
            resolved,
            least=imperfection.least,
            same=self.trial,
        )
        self.imperfection, self.condition = imperfection, condition
        self.results: dict[float, TrialResult] = {}
        self.sure: set[float] = set()

    def trial(self, factor: float) -> Trial:
        """The trial of a factor."""
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
        """By which the least is chosen; a condition that is not kept ideally comes last."""
        return self.fails_without, self.largest or 0.0

    @property
    def impossible(self) -> str:
        """Why there can be no such loop, with any amount; empty if there can."""
        reasons = [result.impossible for factor, result in self.results.items() if factor > 0]
        return reasons[0] if reasons and all(reasons) else ""

    @property
    def ends(self) -> list[float]:
        """The largest factor that is kept, 0 if need be, and the smallest that fails."""
        failed = None if self.impossible else self.failed
        return [self.largest or 0.0, *([] if failed is None else [failed])]

    def next_factors(self, *, local: bool) -> list[float]:
        """Factors to be tried now, from where the search is or on the grid."""
        if self.fails_without:
            return []
        if not self.imperfection.amounts:
            return [] if self.known else [1.0]
        return self.factors() if local else self.on_grid(BEYOND)

    def unsure(self) -> list[float]:
        """The largest factor that is kept, if it is known from the first random run alone."""
        largest = self.largest
        if largest is None or largest in self.sure:
            return []
        return [largest] if self.imperfection.at(largest).random else []

    def tolerance(self, law: str, agrees: bool | None) -> Tolerance:
        """The answer for a law."""
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
    studied: Setting,
    seeds: int,
    executor: Executor,
    notice: Notice = lambda _: None,
) -> Iterator[tuple[int, list[Tolerance]]]:
    """The tolerances of each law, by its number; several laws at once, in the order they finish.

    Args:
        studied: The target.
        seeds: As for ``tolerances``.
        executor: Where laws are studied; a process reads the target again.
        notice: Called if a worker died and was replaced.
    """
    work = partial(tolerances, studied, seeds=seeds, threads=executor.threads_per_worker)
    with closing(executor.run(work, range(len(studied.laws)), notice)) as answers:
        yield from ((answer.index, answer.report) for answer in answers)


def tolerances(studied: Setting, index: int, seeds: int, threads: int = 0) -> list[Tolerance]:
    """How much of each imperfection a law stands under each condition.

    MuJoCo runs at both ends of those answers of the equations that matter: of the least one over
    the conditions for each imperfection those next to a limit, the least of all, and some at
    random.

    Args:
        studied: The target.
        index: Number of one of its laws.
        seeds: Runs of a loop in which something is random.
        threads: For its runs; 0 for all cores.
    """
    law = studied.laws[index]
    limits = {condition: studied.limits(law, condition) for condition in studied.conditions}
    equations, *physics = (
        Trials(law, plant, limits, studied.bench, seeds, threads) for plant in studied.plants
    )
    questions = [
        Question(imperfection, condition)
        for imperfection in studied.imperfections
        for condition in studied.conditions
    ]
    _answer(questions, equations)
    agreed: dict[Question, bool] = {}
    if physics:
        least = [
            min((q for q in questions if q.imperfection is x), key=lambda q: q.weakness)
            for x in studied.imperfections
        ]
        failing = [question for question in questions if question.fails_without]
        agreed = _screened(list(dict.fromkeys([*least, *failing])), physics[0])
    return [question.tolerance(law.name, agreed.get(question)) for question in questions]


def _answer(questions: Sequence[Question], trials: Trials, *, local: bool = False) -> None:
    """Search until every question is answered, all of a round in one batch.

    Where something is random, the first run looks for the amount, and all of them must keep it.
    """
    missing = [question for question in questions if 0.0 not in question.results]
    bases = trials.worst([question.trial(0.0) for question in missing])
    for question, outcome in zip(missing, bases, strict=True):
        question.note(0.0, outcome)
    while True:
        tried = [(q, factor) for q in questions for factor in q.next_factors(local=local)]
        sure = not tried
        if sure:
            tried = [(q, factor) for q in questions for factor in q.unsure()]
        if not tried:
            return
        chosen = [question.trial(factor) for question, factor in tried]
        results = trials.worst(chosen) if sure else trials.results([(x, 0) for x in chosen])
        for (question, factor), outcome in zip(tried, results, strict=True):
            question.note(factor, outcome)
            if sure:
                question.sure.add(factor)


def _screened(questions: Sequence[Question], physics: Trials) -> dict[Question, bool]:
    """As ``_confirmed``, of the least, of some at random and of all that are next to a limit.

    That is as near as the equations have been wrong, with a factor. Where MuJoCo differs once, it
    confirms all.
    """
    chance = np.random.default_rng(len(questions)).random(len(questions)) < _RANDOM
    chosen = [question for question, drawn in zip(questions, chance, strict=True) if drawn]
    chosen.append(min(questions, key=lambda question: question.weakness))
    agreed: dict[Question, bool] = {}
    band = LEAST_BAND
    while chosen:
        ours = {(q, end): q.results[end] for q in chosen for end in q.ends}
        agreed |= _confirmed(list(dict.fromkeys(chosen)), physics)
        for (question, end), outcome in ours.items():
            theirs = physics.known[question.trial(end), outcome.number]
            difference = abs(outcome.margin - theirs.margin)
            if math.isfinite(difference):
                band = max(band, FACTOR * difference)
        left = [question for question in questions if question not in agreed]
        near = [q for q in left if min(abs(q.results[end].margin) for end in q.ends) <= band]
        chosen = near if all(agreed.values()) else left
    return agreed


def _confirmed(questions: Sequence[Question], physics: Trials) -> dict[Question, bool]:
    """Whether MuJoCo agrees at both ends of each; where it differs, its own answer replaces it.

    Of several runs the one that decides is made.
    """
    ends = [(question, end) for question in questions for end in question.ends]
    runs = [(q.trial(end), q.results[end].number) for q, end in ends]
    theirs = {q: Question(q.imperfection, q.condition) for q in questions}
    differing: dict[Question, Question] = {}
    for (question, end), outcome in zip(ends, physics.results(runs), strict=True):
        theirs[question].note(end, outcome)
        if outcome.kept != question.results[end].kept:
            differing[question] = theirs[question]
    _answer(list(differing.values()), physics, local=True)
    for question, other in differing.items():
        question.known, question.results = other.known, other.results
    return {question: question not in differing for question in questions}


# The answer: words, tables, charts, document


def kept_ideally(rows: Iterable[Tolerance]) -> set[tuple[str, str]]:
    """Laws with the conditions under which each keeps everything without any imperfection."""
    return {(x.law, x.condition) for x in rows if x.imperfection.amounts and x.kept_ideally}


def least_of(rows: Sequence[Tolerance]) -> dict[tuple[str, str], Tolerance]:
    """The least by law and imperfection, over the conditions that the law stands."""
    least: dict[tuple[str, str], Tolerance] = {}
    ideal = kept_ideally(rows)
    for row in rows:
        if (row.law, row.condition) in ideal:
            key = row.law, row.imperfection.name
            pair = (least.get(key, row), row)
            least[key] = min(pair, key=lambda x: (x.weakness, x.largest_kept))
    return least


def verdict(rows: Sequence[Tolerance]) -> str:
    """Which law breaks first, at how much of what."""
    broken = [
        row for row in rows if row.kept_ideally and row.smallest_failed and row.imperfection.single
    ]
    if not broken:
        return "No single imperfection that was tried breaks what a law keeps without it."
    worst = min(broken, key=lambda row: row.weakness)

    def amount(factor: float) -> str:
        return f"{worst.amount_text(factor)} ({number(factor)} times the bench's)"

    kept = "only without it" if worst.none else f"up to {amount(worst.largest_kept)}"
    where = "" if worst.condition == "nominal" else f" under {worst.condition}"
    return (
        f"{worst.law} breaks first, by {worst.imperfection.name}{where}: all is kept {kept}, and "
        f"no longer at {amount(worst.weakness)}: {worst.reason}."
    )


def confirmed(rows: Sequence[Tolerance]) -> tuple[int, int]:
    """How many answers MuJoCo confirmed or not, and how many of them differ."""
    agrees = [x.physics_agrees for x in rows if x.physics_agrees is not None]
    return len(agrees), agrees.count(False)


def least_table(rows: Sequence[Tolerance], title: str = "") -> Table:
    """Laws by imperfections: the least over the conditions that a law keeps ideally.

    The strongest law stands first, and the imperfection of which the least is stood.
    """
    least, ideal = least_of(rows), kept_ideally(rows)
    conditions = dict.fromkeys(row.condition for row in rows)
    stands = {law: [x for x in conditions if (law, x) in ideal] for law, _ in least}
    kinds = {row.imperfection.name: row.imperfection for row in least.values()}

    def weakest(kind: str) -> float:
        own = (row for (_, name), row in least.items() if name == kind and row.kept_ideally)
        return min((row.weakness for row in own), default=0.0)

    def strength(law: str) -> tuple[int, float]:
        row = least.get((law, ALL))
        return len(stands[law]), row.weakness if row else 0.0

    ordered = sorted(kinds, key=weakest)
    headings = [in_lines(kinds[name].heading, _LETTERS) for name in ordered]
    cells = [
        [
            law,
            ", ".join(stands[law]),
            *(row.cell if (row := least.get((law, name))) else "" for name in ordered),
        ]
        for law in sorted(stands, key=strength, reverse=True)
    ]
    columns = [*words("law", "keeps ideally"), *numbers(*headings)]
    return table(title, columns, cells, legend=LEGEND)


def in_width(wide: Table, width: int = WIDTH) -> tuple[Table, list[str]]:
    """The first columns of a table that fit into a width, and the headers of the others."""
    cells = zip([column.header for column in wide.columns], *wide.rows, strict=True)
    widths = [max(cell_len(x) for text in own for x in text.split("\n")) + 2 for own in cells]
    room = sum(sum(widths[: i + 1]) <= width for i in range(len(widths)))
    left = [column.header.replace("\n", " ") for column in wide.columns[room:]]
    rows = [row[:room] for row in wide.rows]
    return wide.model_copy(update={"columns": wide.columns[:room], "rows": rows}), left


def charts(studied: Setting, rows: Sequence[Tolerance]) -> list[CellChart]:
    """A map for each condition: octaves below what the bench has, blue for more of it."""
    cells = []
    for row in rows:
        if not row.impossible:
            factor = row.largest_kept if row.kept_ideally and not row.none else 0.0
            octaves = math.log2(factor) if factor > 0 else -_OCTAVES
            octaves = _OCTAVES if math.isinf(row.weakness) else octaves
            value = -max(-_OCTAVES, min(_OCTAVES, octaves))
            why = f"then breaks: {row.reason}" if row.breaks else ""
            place = (row.condition, row.law, row.imperfection.heading)
            cells.append((*place, value, row.cell, why))
    titles = {x.name: f"{x.name}: {x.title}" for x in studied.conditions}
    return list(cell_charts(titles, cells, _OCTAVES).values())


def _standings(target: str, rows: Sequence[Tolerance], *, complete: bool) -> Iterator[Standing]:
    """Of what each law stands the least."""
    for law in dict.fromkeys(row.law for row in rows):
        own = [row for row in rows if row.law == law and row.kept_ideally]
        failed = [row for row in own if row.smallest_failed is not None]
        at, answer = "", "stands all that was tried"
        if not own:
            at, answer = "ideal loop", "not kept even in an ideal loop"
        elif failed:
            least = min(failed, key=lambda row: row.largest_kept)
            at = "all of them" if least.imperfection.name == ALL else least.imperfection.name
            most = f"up to {least.amount_text(least.largest_kept)}"
            kept = "only without it" if least.none else most
            answer = f"kept {kept}, then {least.reason} ({least.condition})"
        yield Standing(case=target, law=law, breaks_at=at, words=answer, complete=complete)


def _values(target: str, rows: Sequence[Tolerance]) -> Iterator[Value]:
    for row in rows:
        if not row.impossible:
            name = f"{target} {row.condition} {row.law}, {row.imperfection.name}"
            yield Value(name=f"{name}: ideally", value="kept" if row.kept_ideally else "not kept")
            most = row.largest_kept
            yield Value(name=f"{name}: largest kept", value=most, better=1, relative=0.1)


def tolerance_document(
    studied: Setting, rows: Sequence[Tolerance], seeds: int, *, complete: bool
) -> dict[str, Any]:
    """The content of tolerance_NAME.json.

    Args:
        studied: The target.
        rows: Its tolerances.
        seeds: Runs where something is random.
        complete: Whether nothing was interrupted.
    """
    settings, target = studied.experiment.settings, studied.target
    laws = dict.fromkeys(row.law for row in rows)
    weak = {row.law for row in rows if not row.kept_ideally}
    answer = f"{len(laws) - len(weak)} of {len(laws)} laws keep all in every ideal loop"
    checked, differing = confirmed(rows)
    sheet = Sheet(table=least_table(rows, f"{target}: tolerances"), charts=charts(studied, rows))
    return result(
        "tolerance",
        {
            "target": target,
            "bench": studied.bench_of,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "runs_where_random": seeds,
            "factors": {
                "least": LEAST, "most": MOST, "grid": 2.0, "beyond_the_last_kept": BEYOND,
                "resolution": RESOLUTION,
            },
        },
        seed=studied.bench.seed,
        complete=complete,
        answers=[
            Answer(
                question=f"Tolerance of {target}",
                verdict=MEASURED if complete else OPEN,
                words=answer if complete else f"{answer}, so far",
                more=verdict(rows),
            )
        ],
        standings=_standings(target, rows, complete=complete),
        sheets=[sheet],
        values=_values(target, rows),
        target=target,
        conditions=[{"name": x.name, "title": x.title} for x in studied.conditions],
        imperfections=[
            {"name": x.name, "bench": x.amount(1.0), "amounts": [a._asdict() for a in x.amounts]}
            for x in studied.imperfections
        ],
        laws=[
            {
                "name": law.name,
                "predicts": law.predict,
                "sampled": law.sampled,
                "requirements": {
                    condition.name: [limit.words for limit in studied.limits(law, condition)]
                    for condition in studied.conditions
                },
            }
            for law in studied.laws
        ],
        physics={"answers_checked": checked, "answers_that_differ": differing},
        tolerances=[row.document() for row in rows],
    )  # fmt: skip


def tolerances_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """A heading and the table of each document, for ``docs/tolerance.md``."""
    parts = []
    for document in documents:
        least = Table.model_validate(document["sheets"][0]["table"])
        lines = [line.replace("\n", " ") for line in least.markdown()]
        checked, differing = document["physics"].values()
        ending = f"MuJoCo confirmed {checked - differing} of {checked} answers."
        parts.append("\n".join([f"**{document['target']}**", "", *lines, "", ending]))
    return "\n\n".join(parts)
