"""How much of each imperfection of its loop each law stands: equations search, MuJoCo confirms."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import LOOP_UNITS, unit_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit
from grosmc_mj.loop import Loop
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.plants import System
from grosmc_mj.results.tables import number, prefixed
from grosmc_mj.studies.search import MOST, Search, Trial, TrialResult, Trials
from grosmc_mj.studies.studied import (
    Condition,
    Named,
    StudiedLaw,
    Unlimited,
    case_for,
    chosen_laws,
    conditions_of,
    laws_of,
    limits_in,
    of_system,
)
from grosmc_mj.sweep.agreement import FACTOR, LEAST_BAND

# The case of a system whose loop is that of equipment that one can buy.
BENCH = "bench"
# Name of all imperfections at once, in the bench's proportions.
WHOLE = "all"
# More of these is less of an imperfection.
_LIMITS = ("limit", "rate_limit")
# Times are below this [s], and so many samples come through at least.
_LONGEST, _MISSED = 1.0, 0.99
# Amounts that are shown are about so many times the bench's, but for limits.
_TYPICAL = 100.0
# Of the answers that the equations are sure of, this part is confirmed all the same.
_RANDOM = 0.1


# The result


class Part(BaseModel):
    """An amount of one number of a loop; infinite for no limit."""

    of: str
    quantity: str
    unit: str
    value: Unlimited


class Level(BaseModel):
    """How much of an imperfection: its factor on the bench, and the amounts that it makes.

    Attributes:
        factor: On what the bench has.
        shown: The amount of the first part as it is run, in its unit; of all at once the factor.
        parts: The amounts.
    """

    factor: float
    shown: Unlimited
    parts: list[Part]


class Kind(BaseModel):
    """An imperfection, and how its amounts are shown.

    Attributes:
        name: For people.
        unit: In which amounts are shown; empty for none.
        scale: Factor to that unit.
        bench: What the bench has, in the unit of ``Level.shown``.
        limits: Whether less of it is worse.
        graded: Whether there is more or less of it.
        whole: Whether it is all imperfections at once.
    """

    name: str
    unit: str
    scale: float
    bench: float
    limits: bool
    graded: bool
    whole: bool

    @property
    def heading(self) -> str:
        """Name and unit."""
        unit = "times the bench" if self.whole else self.unit
        return f"{self.name} [{unit}]" if unit else self.name

    def text(self, level: Level) -> str:
        """An amount with its unit."""
        return f"{number(level.shown * self.scale)} {self.unit or 'times the bench'}"


class Tolerance(BaseModel):
    """How much of an imperfection a law stands under a condition.

    Attributes:
        law: Name of the law.
        imperfection: Name of the imperfection.
        condition: Name of the condition.
        kept_ideally: Whether all is kept without any of it.
        largest_kept: Up to where all that was tried is kept; a factor of 0 if only none of it is.
        smallest_failed: The smallest that fails; None if none that was tried does.
        kept_again: Where all is kept again beyond that, from where to where.
        breaks: The requirement that fails there, or how that run ended.
        physics_agrees: Whether MuJoCo says the same at both ends; None where it was not run.
        impossible: Why there can be no such loop.
    """

    model_config = ConfigDict(frozen=True)
    law: str
    imperfection: str
    condition: str
    kept_ideally: bool
    largest_kept: Level
    smallest_failed: Level | None = None
    kept_again: list[tuple[Level, Level]] = []
    breaks: str | None = None
    physics_agrees: bool | None = None
    impossible: str | None = None

    @property
    def weakness(self) -> float:
        """By which tolerances are compared: the factor that fails, infinite if none does."""
        if not self.kept_ideally or self.impossible:
            return 0.0
        return math.inf if self.smallest_failed is None else self.smallest_failed.factor

    @property
    def none(self) -> bool:
        """Whether all is kept only without it: with less than half a timestep of it at most."""
        return self.largest_kept.factor == 0 or self.largest_kept.shown == 0


class Tolerances(BaseModel):
    """The tolerances of a target's laws: what the study writes and its tables are made from.

    Attributes:
        target: SYSTEM/CASE.
        conditions: Under which laws are studied.
        imperfections: Of the loop.
        tolerances: A row for each law, imperfection and condition.
    """

    target: str
    conditions: list[Named]
    imperfections: list[Kind]
    tolerances: list[Tolerance]

    def kind(self, row: Tolerance) -> Kind:
        """The imperfection of a row."""
        return next(kind for kind in self.imperfections if kind.name == row.imperfection)

    def stands_ideally(self, law: str, condition: str) -> bool:
        """Whether a law keeps everything without any imperfection under a condition."""
        own = (x for x in self.tolerances if (x.law, x.condition) == (law, condition))
        return any(row.kept_ideally for row in own if self.kind(row).graded)

    def least(self) -> list[Tolerance]:
        """The least of each law and imperfection, over the conditions that the law stands."""
        rows: dict[tuple[str, str], Tolerance] = {}
        for row in self.tolerances:
            if self.stands_ideally(row.law, row.condition):
                key = row.law, row.imperfection
                least = (rows.get(key, row), row)
                rows[key] = min(least, key=lambda x: (x.weakness, x.largest_kept.factor))
        return list(rows.values())


# What is varied


class Amount(NamedTuple):
    """A number of one part of a loop.

    Attributes:
        kind: ``computing``, ``sensor`` or ``actuator``.
        of: The state or input that it is of; empty of the computer.
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
    def most(self) -> float:
        """The factor where it ends; of all at once each ends where it must."""
        return min([MOST, *(x.most for x in self.amounts if self.name != WHOLE)])

    def at(self, factor: float) -> Loop:
        """The loop with this factor on what the bench has, its times on the timestep's grid."""
        loop = self.full if factor > 0 else self.base
        for amount in self.amounts:
            loop = loop.changed(amount.kind, amount.of, **{amount.quantity: amount.scaled(factor)})
        return loop.rounded(self.timestep)

    def level(self, factor: float) -> Level:
        """The amounts for a factor."""
        shown = factor
        if self.name != WHOLE and self.amounts:
            first = self.amounts[0]
            shown = first.scaled(factor)
            if first.quantity in TIMES:
                shown = time_as_run(first.quantity, shown, self.timestep)
        parts = [
            Part(of=f"{x.kind} {x.of}".strip(), quantity=x.quantity, unit=x.unit,
                 value=x.scaled(factor))
            for x in self.amounts
        ]  # fmt: skip
        return Level(factor=factor, shown=shown, parts=parts)

    @property
    def kind(self) -> Kind:
        """How it is shown."""
        whole, graded = self.name == WHOLE, bool(self.amounts)
        unit, scale, limits = "", 1.0, False
        if graded and not whole:
            first = self.amounts[0]
            limits = first.quantity in _LIMITS
            typical = abs(first.value) * (1.0 if limits else _TYPICAL)
            unit, scale = prefixed(first.unit, typical) if first.unit else ("%", 100.0)
        return Kind(
            name=self.name, unit=unit, scale=scale, bench=self.level(1.0).shown, limits=limits,
            graded=graded, whole=whole,
        )  # fmt: skip


def imperfections(
    bench: Loop, system: System, timestep: float, control_period: float
) -> list[Imperfection]:
    """Each number of a bench's loop alone, rates that are estimated, and everything.

    Args:
        bench: The loop whose numbers are the units.
        system: Whose.
        timestep: [s].
        control_period: [s].
    """
    everything = list(_amounts(bench, system, timestep, control_period))
    estimated = bench
    groups: dict[tuple[str, str], list[Amount]] = {}
    for amount in everything:
        ideal_number = {amount.quantity: amount.scaled(0.0)}
        estimated = estimated.changed(amount.kind, amount.of, **ideal_number)
        groups.setdefault((amount.kind, amount.quantity), []).append(amount)
    ideal = replace(estimated, estimators=())
    names = {key: " ".join(key).replace("_", " ") for key in groups}
    single = [
        Imperfection(names[key], ideal, ideal, tuple(amounts), timestep)
        for key, amounts in groups.items()
    ]
    whole = Imperfection(WHOLE, estimated, estimated, tuple(everything), timestep)
    if not bench.estimators:
        return [*single, whole]
    name = "estimated rates"
    rates = [Imperfection(name, ideal, estimated, (), timestep)] + [
        Imperfection(f"{names[key]}, {name}", estimated, estimated, tuple(amounts), timestep)
        for key, amounts in groups.items()
        if key in (("sensor", "resolution"), ("sensor", "noise"))
    ]
    return [*single, *rates, whole]


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
            if item.name in LOOP_UNITS[kind] and value != 0 and math.isfinite(value):
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
        return setting, (self.named, [law.name for law in self.laws])

    @property
    def plants(self) -> list[PlantName]:
        """The equations, if there are any, and physics, if there is."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Limit, ...]:
        """Limits that a law must keep, whichever laws the file names."""
        return limits_in(self.experiment.file.requirement, law, condition, self.plants)

    def of_rows(self, rows: Sequence[Tolerance]) -> Tolerances:
        """The result."""
        case = self.experiment.case
        return Tolerances(
            target=f"{case.system}/{case.name}",
            conditions=[c.named for c in self.conditions],
            imperfections=[imperfection.kind for imperfection in self.imperfections],
            tolerances=list(rows),
        )


def setting(target: str, chosen: Sequence[str] = (), *, rivals: bool = False) -> Setting:
    """A target with its bench, conditions and laws.

    Args:
        target: A system, which means its bench, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        rivals: Whether all includes the rivals.

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
    period = bare.settings.control_period
    return Setting(
        experiment=bare,
        bench=owner.case.loop,
        bench_of=f"{owner.case.system}/{owner.case.name}",
        laws=chosen_laws(laws_of(bare), chosen, rivals=rivals),
        imperfections=imperfections(owner.case.loop, bare.nominal.system, timestep, period),
        conditions=conditions_of(bare),
        named=target,
    )


# The search


@dataclass(eq=False)
class _Question:
    """One tolerance that is searched."""

    imperfection: Imperfection
    condition: Condition
    search: Search
    results: dict[float, TrialResult] = field(default_factory=dict)
    sure: set[float] = field(default_factory=set)

    @classmethod
    def of(cls, imperfection: Imperfection, condition: Condition) -> _Question:
        return cls(imperfection, condition, Search(imperfection.most, same=imperfection.at))

    def trial(self, factor: float) -> Trial:
        return Trial(self.condition, self.imperfection.at(factor))

    def note(self, factor: float, result: TrialResult) -> None:
        self.results[factor] = result
        if factor > 0:
            self.search.known[factor] = result.kept

    @property
    def hopeless(self) -> bool:
        """Whether it fails without the imperfection, so that less of it cannot help."""
        return not self.results[0.0].kept and not self.results[0.0].impossible

    @property
    def weakness(self) -> tuple[bool, float]:
        """By which the least is chosen; a condition that is not kept ideally comes last."""
        return self.hopeless, self.search.largest or 0.0

    @property
    def impossible(self) -> str:
        """Why there can be no such loop, with any amount; empty if there can."""
        reasons = [result.impossible for factor, result in self.results.items() if factor > 0]
        return reasons[0] if reasons and all(reasons) else ""

    @property
    def ends(self) -> list[float]:
        """The largest factor that is kept, 0 if need be, and the smallest that fails."""
        failed = None if self.impossible else self.search.failed
        return [self.search.largest or 0.0, *([] if failed is None else [failed])]

    def next_factors(self, *, local: bool = False) -> list[float]:
        """Factors to be tried now."""
        if self.hopeless:
            return []
        if not self.imperfection.amounts:
            return [] if self.search.known else [1.0]
        return self.search.local_factors() if local else self.search.next_factors()

    def unsure(self) -> list[float]:
        """The largest factor that is kept, if it is known from the first random run alone."""
        largest = self.search.largest
        random = largest is not None and self.imperfection.at(largest).random
        return [largest] if random and largest is not None and largest not in self.sure else []

    def tolerance(self, law: str, agrees: bool | None) -> Tolerance:
        search, first, level = self.search, self.results[0.0], self.imperfection.level
        end = self.results.get(search.failed or 0.0, first)
        return Tolerance(
            law=law,
            imperfection=self.imperfection.name,
            condition=self.condition.name,
            kept_ideally=first.kept or (bool(first.impossible) and search.largest is not None),
            largest_kept=level(search.largest or 0.0),
            smallest_failed=None if search.failed is None else level(search.failed),
            kept_again=[(level(low), level(high)) for low, high in search.again],
            breaks=None if end.kept else end.worst or None,
            physics_agrees=agrees,
            impossible=self.impossible or None,
        )


def tolerances_of_laws(
    studied: Setting,
    seeds: int,
    executor: Executor,
    notice: Notice = lambda _: None,
    *,
    every: bool = False,
) -> Iterator[tuple[int, list[Tolerance]]]:
    """The tolerances of each law, by its number; several laws at once, in the order they finish.

    Args:
        studied: The target.
        seeds: As for ``tolerances``.
        executor: Where laws are studied; a process reads the target again.
        notice: Called if a worker died and was replaced.
        every: As for ``tolerances``.
    """
    work = partial(_of_law, studied, seeds, executor.threads_per_worker, every)
    with closing(executor.run(work, range(len(studied.laws)), notice)) as answers:
        yield from ((answer.index, answer.report) for answer in answers)


def _of_law(studied: Setting, seeds: int, threads: int, every: bool, index: int) -> list[Tolerance]:
    """The work of a process."""
    return tolerances(studied, studied.laws[index], seeds, threads, every=every)


def tolerances(
    studied: Setting, law: StudiedLaw, seeds: int, threads: int = 0, *, every: bool = False
) -> list[Tolerance]:
    """How much of each imperfection a law stands under each condition.

    Args:
        studied: The target.
        law: One of its laws.
        seeds: Runs of a loop in which something is random.
        threads: For its runs; 0 for all cores.
        every: Whether MuJoCo runs at both ends of each answer of the equations, instead of those
            that matter: of the least one over the conditions for each imperfection those next to a
            limit, the least of all, and some at random.
    """
    limits = {condition: studied.limits(law, condition) for condition in studied.conditions}
    equations, *physics = (
        Trials(law, plant, limits, studied.bench, seeds, threads) for plant in studied.plants
    )
    questions = [
        _Question.of(imperfection, condition)
        for imperfection in studied.imperfections
        for condition in studied.conditions
    ]
    _answer(questions, equations)
    agreed: dict[_Question, bool] = {}
    if physics and every:
        agreed = _confirmed(questions, physics[0])
    elif physics:
        least = [
            min((q for q in questions if q.imperfection is x), key=lambda q: q.weakness)
            for x in studied.imperfections
        ]
        hopeless = [question for question in questions if question.hopeless]
        agreed = _screened(list(dict.fromkeys([*least, *hopeless])), physics[0])
    return [question.tolerance(law.name, agreed.get(question)) for question in questions]


def _answer(questions: Sequence[_Question], trials: Trials, *, local: bool = False) -> None:
    """Search until every question is answered, all of a round in one batch.

    Where something is random, the first run looks for the amount, and all of them must keep it.
    """
    missing = [question for question in questions if 0.0 not in question.results]
    bases = trials.worst([question.trial(0.0) for question in missing])
    for question, result in zip(missing, bases, strict=True):
        question.note(0.0, result)
    while True:
        wanted = [(q, factor) for q in questions for factor in q.next_factors(local=local)]
        sure = not wanted
        if sure:
            wanted = [(q, factor) for q in questions for factor in q.unsure()]
        if not wanted:
            return
        chosen = [question.trial(factor) for question, factor in wanted]
        results = trials.worst(chosen) if sure else trials.results([(x, 0) for x in chosen])
        for (question, factor), result in zip(wanted, results, strict=True):
            question.note(factor, result)
            if sure:
                question.sure.add(factor)


def _screened(questions: Sequence[_Question], physics: Trials) -> dict[_Question, bool]:
    """As ``_confirmed``, of the least, of some at random and of all that are next to a limit.

    That is as near as the equations have been wrong, with a factor. Where MuJoCo differs once, it
    confirms all.
    """
    chance = np.random.default_rng(len(questions)).random(len(questions)) < _RANDOM
    chosen = [question for question, drawn in zip(questions, chance, strict=True) if drawn]
    chosen.append(min(questions, key=lambda question: question.weakness))
    agreed: dict[_Question, bool] = {}
    band = LEAST_BAND
    while chosen:
        ours = {(q, end): q.results[end] for q in chosen for end in q.ends}
        agreed |= _confirmed(list(dict.fromkeys(chosen)), physics)
        for (question, end), result in ours.items():
            theirs = physics.known[question.trial(end), result.number]
            difference = abs(result.margin - theirs.margin)
            if math.isfinite(difference):
                band = max(band, FACTOR * difference)
        left = [question for question in questions if question not in agreed]
        near = [q for q in left if min(abs(q.results[end].margin) for end in q.ends) <= band]
        chosen = near if all(agreed.values()) else left
    return agreed


def _confirmed(questions: Sequence[_Question], physics: Trials) -> dict[_Question, bool]:
    """Whether MuJoCo agrees at both ends of each; where it differs, its own answer replaces it.

    Of several runs the one that decides is made.
    """
    ends = [(question, end) for question in questions for end in question.ends]
    runs = [(q.trial(end), q.results[end].number) for q, end in ends]
    theirs = {q: _Question.of(q.imperfection, q.condition) for q in questions}
    differing: dict[_Question, _Question] = {}
    for (question, end), result in zip(ends, physics.results(runs), strict=True):
        theirs[question].note(end, result)
        if result.kept != question.results[end].kept:
            differing[question] = theirs[question]
    _answer(list(differing.values()), physics, local=True)
    for question, other in differing.items():
        question.search, question.results = other.search, other.results
    return {question: question not in differing for question in questions}
