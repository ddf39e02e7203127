"""How much of each imperfection each law stands, on the equations and then in physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.studies.agreement import FACTOR, LEAST_BAND
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.search import Search, Span
from grosmc_mj.studies.tolerance.setting import Condition, Setting, StudiedLaw
from grosmc_mj.studies.tolerance.trials import Trial, TrialResult, Trials

# Of the bench, for what is there or not.
_THERE = 1.0
# Of what the equations are sure of, this part is confirmed all the same.
_RANDOM = 0.1


class Tolerance(NamedTuple):
    """How much of an imperfection a law stands under a condition; factors on what the bench has.

    Attributes:
        law: Name of the law.
        imperfection: Of the loop.
        condition: Name of the condition: the plant, and what acts on it.
        ideally: Whether all is kept without any of it.
        largest: The largest factor up to which all that was tried is kept; 0 if only none of it is.
        failed: The smallest that fails; None if none that was tried does.
        again: Where all is kept again beyond that.
        tried: The largest that was tried.
        breaks: The requirement that is not kept at ``failed``, or how that run ended.
        margin: The least margin at ``largest``, in parts of its limit.
        plant: Where it was found.
        agreed: Whether physics said the same at both ends; None where it was not asked.
        impossible: Why there can be no such loop; empty if there can.
    """

    law: str
    imperfection: Imperfection
    condition: str
    ideally: bool
    largest: float
    failed: float | None
    again: tuple[Span, ...]
    tried: float
    breaks: str
    margin: float
    plant: PlantName
    agreed: bool | None = None
    impossible: str = ""

    @property
    def unbroken(self) -> bool:
        """Whether nothing that was tried breaks it."""
        return self.ideally and self.failed is None and not self.impossible


@dataclass(eq=False)
class _Question:
    """One tolerance that is looked for."""

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

    def told(self, factor: float, result: TrialResult) -> None:
        self.results[factor] = result
        if factor > 0:
            self.search.told(factor, kept=result.kept)

    @property
    def first(self) -> TrialResult:
        """What comes of none of it."""
        return self.results[0.0]

    @property
    def hopeless(self) -> bool:
        """Whether less of it cannot help."""
        return not self.first.kept and not self.first.impossible

    @property
    def unsure(self) -> list[float]:
        """What has been found, if that is by the first run alone."""
        found = self.search.largest
        if found is None or found in self.sure or not self.imperfection.at(found).random:
            return []
        return [found]

    @property
    def nearest(self) -> float:
        """The least distance of an end's margin from its limit, in parts of it."""
        return min(abs(self.results[end].margin) for end in _ends(self))

    @property
    def impossible(self) -> str:
        """Why there can be no such loop, with whatever amount; empty if there can."""
        said = [each.impossible for factor, each in self.results.items() if factor > 0]
        return said[0] if said and all(said) else ""

    def tolerance(self, law: str, plant: PlantName, agreed: bool | None) -> Tolerance:
        """What has been found."""
        search, first = self.search, self.first
        ends = self.results.get(search.failed or 0.0, first)
        return Tolerance(
            law=law,
            imperfection=self.imperfection,
            condition=self.condition.name,
            ideally=first.kept or (bool(first.impossible) and search.largest is not None),
            largest=search.largest or 0.0,
            failed=search.failed,
            again=tuple(search.again),
            tried=search.tried,
            breaks="" if ends.kept else ends.worst,
            margin=self.results[search.largest or 0.0].margin,
            plant=plant,
            agreed=agreed,
            impossible=self.impossible,
        )


def tolerances_of_laws(
    studied: Setting,
    seeds: int,
    executor: Executor,
    notice: Notice = lambda _: None,
    *,
    every: bool = False,
) -> Iterator[tuple[int, list[Tolerance]]]:
    """Ask about each law of a target, several at once; which it is, and what it stands.

    Args:
        studied: The target.
        seeds: As for ``tolerances``.
        executor: Who asks; a process reads the target again.
        notice: Told of a worker that died and was replaced.
        every: As for ``tolerances``.
    """
    asking = partial(_of_law, studied, seeds, executor.threads_per_worker, every)
    known = {each: each for each in studied.imperfections}
    with closing(executor.run(asking, range(len(studied.laws)), notice)) as answers:
        for each in answers:
            # What has travelled is a copy.
            rows = [row._replace(imperfection=known[row.imperfection]) for row in each.report]
            yield each.index, rows


def _of_law(studied: Setting, seeds: int, threads: int, every: bool, index: int) -> list[Tolerance]:
    """The work of a process: a law of a target."""
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
        every: Whether physics is asked at both ends of each answer of the equations, instead of
            those that matter: of the least one over the conditions for each imperfection those
            next to a limit, the least of all, and some at random.
    """
    first, *rest = studied.plants
    trials = Trials(studied, law, first, seeds, threads)
    questions = [
        _Question.of(imperfection, condition)
        for imperfection in studied.imperfections
        for condition in studied.conditions
    ]
    _answer(questions, trials, _asks)
    agreed: dict[_Question, bool] = {}
    if rest:
        physics = Trials(studied, law, rest[0], seeds, threads)
        if every:
            agreed = _confirmed(questions, physics)
        else:
            asked = [_weakest(questions, each) for each in studied.imperfections]
            hopeless = [each for each in questions if each.hopeless]
            agreed = _screened(list(dict.fromkeys([*asked, *hopeless])), physics)
    return [
        each.tolerance(law.name, first if agreed.get(each, True) else rest[0], agreed.get(each))
        for each in questions
    ]


def _weakest(questions: Sequence[_Question], imperfection: Imperfection) -> _Question:
    """The condition under which a law stands the least, of those under which it stands any."""
    return min((each for each in questions if each.imperfection is imperfection), key=_weakness)


def _weakness(question: _Question) -> tuple[bool, float]:
    """By which the least is found."""
    return question.hopeless, question.search.largest or 0.0


def _screened(questions: Sequence[_Question], physics: Trials) -> dict[_Question, bool]:
    """As ``_confirmed``, of the least, of some at random and of all that are next to a limit.

    That is as near as the equations have been found to be wrong, with a factor. Where physics says
    something else once, it is asked about all.
    """
    random = np.random.default_rng(len(questions))
    chance = random.random(len(questions)) < _RANDOM
    wanted = [each for each, drawn in zip(questions, chance, strict=True) if drawn]
    wanted.append(min(questions, key=_weakness))
    agreed: dict[_Question, bool] = {}
    band = LEAST_BAND
    while wanted:
        ours = {(each, end): each.results[end] for each in wanted for end in _ends(each)}
        agreed |= _confirmed(list(dict.fromkeys(wanted)), physics)
        for (each, end), result in ours.items():
            trial = each.trial(end), result.number
            difference = abs(result.margin - physics.known[trial].margin)
            if math.isfinite(difference):
                band = max(band, FACTOR * difference)
        left = [each for each in questions if each not in agreed]
        wanted = [each for each in left if each.nearest <= band] if all(agreed.values()) else left
    return agreed


def _confirmed(questions: Sequence[_Question], physics: Trials) -> dict[_Question, bool]:
    """Whether physics says the same at both ends of each; what it finds itself takes their place.

    Of several runs it is asked for the one that decides.
    """
    asked = {each: _Question.of(each.imperfection, each.condition) for each in questions}
    ends = [(each, factor) for each in questions for factor in _ends(each)]
    runs = [(each.trial(factor), each.results[factor].number) for each, factor in ends]
    differing: dict[_Question, _Question] = {}
    for (each, factor), result in zip(ends, physics.numbered(runs), strict=True):
        asked[each].told(factor, result)
        if result.kept != each.results[factor].kept:
            differing[each] = asked[each]
    _answer(list(differing.values()), physics, _local_asks)
    for each, found in differing.items():
        each.search, each.results = found.search, found.results
    return {each: each not in differing for each in questions}


def _ends(question: _Question) -> list[float]:
    """The largest that is kept, none of it if need be, and the smallest that fails."""
    kept, failed = question.search.largest, question.search.failed
    found = [0.0 if kept is None else kept]
    return found if failed is None or question.impossible else [*found, failed]


def _answer(
    questions: Sequence[_Question],
    trials: Trials,
    asks: Callable[[_Question], list[float]],
) -> None:
    """Ask until every question is answered, all of a round in one batch.

    Where something is random, the first run looks for the amount, and all of them must keep it.
    """
    missing = [each for each in questions if 0.0 not in each.results]
    bases = trials.all([each.trial(0.0) for each in missing])
    for question, result in zip(missing, bases, strict=True):
        question.told(0.0, result)
    while True:
        wanted = [(each, factor) for each in questions for factor in asks(each)]
        sure = not wanted
        if sure:
            wanted = [(each, factor) for each in questions for factor in each.unsure]
        if not wanted:
            return
        made = [each.trial(factor) for each, factor in wanted]
        results = trials.all(made) if sure else trials.first(made)
        for (question, factor), result in zip(wanted, results, strict=True):
            question.told(factor, result)
            if sure:
                question.sure.add(factor)


def _asks(question: _Question, *, local: bool = False) -> list[float]:
    """What is to be tried of a question now."""
    if question.hopeless:
        return []
    if not question.imperfection.graded:
        return [] if question.search.known else [_THERE]
    return question.search.local() if local else question.search.asks()


_local_asks = partial(_asks, local=True)
