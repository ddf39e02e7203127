"""Largest imperfections of its loop that each law stands: equations search, MuJoCo confirms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.executors import executor_for
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.study import Advance, CellRunner, Study, StudyCell, dependencies
from grosmc_mj.studies.sweep.confirmation import MarginConfirmation, drawn_at_random
from grosmc_mj.studies.sweep.runs import MARGIN, Outcomes, Row, run_rows
from grosmc_mj.studies.sweep.search import Search
from grosmc_mj.studies.target import (
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
from grosmc_mj.studies.tolerance.imperfections import (
    LEAST,
    MOST,
    Imperfection,
    LongerPeriod,
    imperfections,
)
from grosmc_mj.theory.control.controller import Controller

# Factors in an octave of the grid that is searched for the first failure: most are no whole
# multiples of the bench's amounts, nor of its control period.
PER_OCTAVE = 4
# The same below the first failure found: sign switching may fail between two that are kept.
FINER = 32
# Factors up to this many times the largest that is kept are tried.
BEYOND = 2.0**5
# Ratio of the smallest factor that fails to the largest that is kept, at which a search ends.
RESOLUTION = 2.0**0.125


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of a law to an imperfection under a condition, in factors on the bench's amounts.

    Attributes:
        law: Name of the law.
        imperfection: The imperfection.
        condition: Name of the condition.
        kept_ideally: Whether all requirements are kept without the imperfection.
        largest_kept: Largest factor up to which all that was tried is kept; 0 if none is.
        smallest_failed: Smallest factor found at which one fails; None if none was found.
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
            **vars(self),
            "imperfection": self.imperfection.name,
            "largest_kept": self._level(self.largest_kept),
            "smallest_failed": smallest_failed,
            "kept_again": [[self._level(low), self._level(high)] for low, high in self.kept_again],
        }

    def _level(self, factor: float) -> dict[str, float]:
        return {"factor": factor, "shown": self.imperfection.amount(factor)}


class LawTolerances(BaseModel):
    """Finished answers of one law, as they are stored.

    Attributes:
        law: Name of the law.
        answers: Fields of each ``Tolerance``, its imperfection by name.
    """

    model_config = ConfigDict(frozen=True, ser_json_inf_nan="constants")
    law: str
    answers: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, rows: Sequence[Tolerance]) -> LawTolerances:
        """Return the answers of one law, to be stored."""
        answers = [{**vars(row), "imperfection": row.imperfection.name} for row in rows]
        return cls(law=rows[0].law, answers=tuple(answers))

    def rows(self, studied: ToleranceStudy) -> list[Tolerance]:
        """Return the answers that were stored."""
        kinds = {kind.name: kind for kind in studied.imperfections}
        return [
            Tolerance(**{**answer, "imperfection": kinds[answer["imperfection"]]})
            for answer in self.answers
        ]


@dataclass(frozen=True, eq=False)
class ToleranceStudy(Study[LawTolerances]):
    """A target, ready to be studied.

    Attributes:
        experiment: Experiment of the target, without a loop.
        bench: The loop whose numbers are the units.
        bench_of: SYSTEM/CASE of the bench.
        laws: The laws.
        imperfections: Imperfections of the loop.
        conditions: Plants and loads, the nominal one first.
        named: The target on the command line.
        draws: Runs of a loop in which something is drawn.
    """

    kind = "tolerance"
    row = LawTolerances

    experiment: Experiment
    bench: Loop
    bench_of: str
    laws: Sequence[StudiedLaw]
    imperfections: Sequence[Imperfection]
    conditions: Sequence[Condition]
    named: str
    draws: int = 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process reads the target anew."""
        longer_period = any(isinstance(kind, LongerPeriod) for kind in self.imperfections)
        read = partial(tolerance_study, longer_period=longer_period, draws=self.draws)
        return read, (self.named, [law.name for law in self.laws])

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return self.experiment.target

    @property
    def plants(self) -> list[PlantName]:
        """The equations, if the target has any, and physics, if it has it."""
        return [name for name in self.experiment.nominal.names if name != "printed"]

    @property
    def case(self) -> Experiment:
        """The experiment."""
        return self.experiment

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Requirement, ...]:
        """Return the limits that a law must keep, whichever laws the file names."""
        return limits_in(self.experiment.file.requirement, law, condition, self.plants)

    def configuration(self) -> dict[str, Any]:
        """Return the configuration as the result has it."""
        settings = self.experiment.settings
        return {
            "target": self.target,
            "bench": self.bench_of,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "draws": self.draws,
            "factors": {
                "least": LEAST,
                "most": MOST,
                "grid": 2.0 ** (1 / PER_OCTAVE),
                "grid_below_the_first_failure": 2.0 ** (1 / FINER),
                "beyond_the_last_kept": BEYOND,
                "resolution": RESOLUTION,
            },
        }

    def cells(self) -> list[StudyCell[LawTolerances]]:
        """Return a cell for each law."""
        names = [kind.name for kind in self.imperfections]
        configuration = [self.configuration(), names, asdict(self.bench)]
        depends_on = dependencies(configuration, self.conditions)
        return [
            StudyCell(law.name, (law.name,), depends_on, partial(self._measure, index))
            for index, law in enumerate(self.laws)
        ]

    def _measure(self, index: int, _: Advance | None = None, *, threads: int = 0) -> LawTolerances:
        """Return the row of a law, in this process or in another one."""
        return LawTolerances.of(tolerances(self, index, threads=threads))

    def rows(
        self, cells: Sequence[StudyCell[LawTolerances]], runner: CellRunner[LawTolerances]
    ) -> Iterator[LawTolerances]:
        """Yield the stored rows; then the others, in the order in which processes finish them."""
        missing = []
        for index, cell in enumerate(cells):
            row = runner.read(cell)
            if row is None:
                missing.append(index)
            else:
                runner.progress(cell.name)
                yield row
        if not missing:
            return

        executor = executor_for(len(missing))
        study_law = partial(self._measure, threads=executor.threads_per_worker)
        with closing(executor.run(study_law, missing, runner.notice)) as parts:
            for part in parts:
                cell = cells[part.index]
                runner.write(cell, part.report)
                runner.progress(cell.name)
                yield part.report

    def tolerances(self, rows: Iterable[LawTolerances]) -> list[Tolerance]:
        """Return the answers of finished rows, law by law."""
        order = [law.name for law in self.laws]
        finished = sorted(rows, key=lambda row: order.index(row.law))
        return [answer for row in finished for answer in row.rows(self)]


def tolerance_study(
    target: str,
    chosen: Sequence[str] = (),
    *,
    rivals: bool = False,
    longer_period: bool = False,
    draws: int = 1,
) -> ToleranceStudy:
    """Return a target with its bench, conditions and laws.

    Args:
        target: A system, which means its bench, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        rivals: Whether the default includes the rivals.
        longer_period: Whether a longer control period is one of the imperfections.
        draws: Runs of a loop in which something is drawn.

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
        draws=draws,
    )


# The search of each answer


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
            per_octave=PER_OCTAVE,
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
        factors = self.factors() if local else self.on_grid(BEYOND)
        if factors:
            return factors
        # Whether the bench's own amount is kept is answered by a run of it.
        if self.imperfection.least <= 1.0 <= self.imperfection.most and 1.0 not in self.known:
            return [1.0]
        return self.finely(FINER)

    def unsure(self) -> list[float]:
        """Return the kept factors that count and are known from the first run alone.

        They are the largest one, and the bench's own.
        """
        factors: list[float] = []
        for factor in dict.fromkeys((self.largest, 1.0)):
            if factor is None or factor in self.sure or not self.known.get(factor, False):
                continue
            if self.imperfection.at(factor).drawn:
                factors.append(factor)
        return factors

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


def tolerances(studied: ToleranceStudy, index: int, threads: int = 0) -> list[Tolerance]:
    """Return the tolerances of a law to each imperfection under each condition.

    MuJoCo runs at both ends of those answers of the equations that matter: of the least one over
    the conditions for each imperfection those next to a limit, the least of all, and some at
    random.

    Args:
        studied: The target.
        index: Number of one of its laws.
        threads: Threads of its runs; 0 for all cores.
    """
    law = studied.laws[index]
    limits = {condition: studied.limits(law, condition) for condition in studied.conditions}
    equations, *physics = (
        Trials(law, plant, limits, studied.bench, studied.draws, threads)
        for plant in studied.plants
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
    """Confirm the least answer, some at random and all that are next to a limit.

    If MuJoCo differs on one that was not next to a limit, it confirms all.

    Returns:
        Whether MuJoCo agrees, of each search that it confirmed.
    """
    count = len(searches)
    margins = np.full((2, count), np.nan)
    for i, search in enumerate(searches):
        for j, end in enumerate(search.ends):
            margins[j, i] = search.results[end].margin
    checked = drawn_at_random(count)
    checked[min(range(count), key=lambda i: searches[i].weakness)] = True
    confirmation = MarginConfirmation(margins, np.zeros(count, bool), checked)

    agreed: dict[ToleranceSearch, bool] = {}
    while True:
        rows = confirmation.rows()
        if not len(rows):
            return agreed
        chosen = [searches[i] for i in rows]
        # Noted first: the results of a search that MuJoCo answers otherwise are replaced.
        ends = [
            [(search.trial(end), search.results[end].number) for end in search.ends]
            for search in chosen
        ]
        confirmed = _confirmed(chosen, physics)
        agreed |= confirmed

        by_physics = np.full((2, len(rows)), np.nan)
        for i, runs in enumerate(ends):
            by_physics[: len(runs), i] = [physics.known[run].margin for run in runs]
        overturned = np.array([not confirmed[search] for search in chosen])
        confirmation.note_margins(rows, overturned, by_physics)


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
