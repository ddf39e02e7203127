"""The ledger tried itself: which claims notice the faults that are put in."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from grosmc_mj.chapter.claims.claim import Claim, Verdict
from grosmc_mj.chapter.claims.judging import parts_of
from grosmc_mj.chapter.claims.ledger import judge
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.runs import Settings

# By claim that was asked, the verdicts that it gives since the fault is there and not before; None
# if it has not noticed.
_Answers = dict[str, tuple[Verdict, ...] | None]


class Caught(NamedTuple):
    """What a fault did to the ledger.

    Attributes:
        fault: The fault.
        claims: Ids of the claims that noticed: a verdict is not what it is in a sound laboratory.
        tried: How many claims were tried.
        became: Verdicts that were not given in the sound laboratory.
    """

    fault: Fault
    claims: tuple[str, ...]
    tried: int = 0
    became: tuple[Verdict, ...] = ()


def self_test(
    settings: Settings,
    claims: Sequence[Claim],
    faults: Sequence[Fault],
    executor: Executor,
    advance: Callable[[str], object] = lambda _: None,
    notice: Notice = lambda _: None,
    *,
    thorough: bool = False,
) -> list[Caught]:
    """Put in each fault and see which claims change a verdict.

    Without refinement: a fault shows at the first look. A claim that has noticed a fault is asked
    again only of those that no claim has noticed.

    Args:
        settings: How cases are run.
        claims: Claims to try.
        faults: Faults to put in.
        executor: Who tries them.
        advance: Called with a claim's id when it has been tried.
        notice: Told of a worker that died and was replaced.
        thorough: Whether to ask every claim of every fault.
    """
    answers: list[_Answers] = [{} for _ in faults]
    parts = parts_of(claims)
    asking = _Asking(settings, parts, faults, again=thorough)
    with closing(executor.run(asking, range(len(parts)), notice)) as reports:
        for done in reports:
            _gather(answers, done.report)
            for claim in parts[done.index]:
                advance(claim.id)
    missed = [index for index, given in enumerate(answers) if not _found(given)]
    if missed and not thorough:
        own, others = [answers[index] for index in missed], [faults[index] for index in missed]
        asking = _Asking(settings, [[claim] for claim in claims], others, again=True)
        with closing(executor.run(asking, range(len(claims)), notice)) as reports:
            for done in reports:
                _gather(own, done.report)
                if all(map(_found, own)):
                    break
    order = [claim.id for claim in claims]
    return [_caught(fault, given, order) for fault, given in zip(faults, answers, strict=True)]


def _gather(answers: Iterable[_Answers], report: Iterable[_Answers]) -> None:
    """Add what a process has found, fault by fault."""
    for known, new in zip(answers, report, strict=True):
        known.update(new)


def _found(answers: _Answers) -> list[str]:
    """Who has noticed."""
    return [name for name, became in answers.items() if became is not None]


def _caught(fault: Fault, answers: _Answers, order: Sequence[str]) -> Caught:
    """What has become of the ledger with one fault."""
    became = {verdict for given in answers.values() for verdict in given or ()}
    noticed = sorted(_found(answers), key=order.index)
    return Caught(fault, tuple(noticed), len(answers), tuple(v for v in Verdict if v in became))


@dataclass(frozen=True)
class _Asking:
    """The work of a process.

    Attributes:
        settings: How cases are run.
        parts: The claims.
        faults: Put in one by one.
        again: Whether a claim that has noticed a fault is asked of the others.
    """

    settings: Settings
    parts: Sequence[Sequence[Claim]]
    faults: Sequence[Fault]
    again: bool

    @cached_property
    def _sound(self) -> Laboratory:
        """Where nothing is wrong, for every part that comes to this process."""
        return Laboratory(self.settings)

    def __call__(self, index: int, /) -> list[_Answers]:
        """Ask the claims of a part, fault by fault."""
        sound = {claim.id: _verdicts(self._sound, claim) for claim in self.parts[index]}
        noticed: set[str] = set()
        report: list[_Answers] = []
        for fault in self.faults:
            faulty, answers = Laboratory(self.settings, fault), _Answers()
            for claim in self.parts[index]:
                if claim.id in noticed and not self.again:
                    continue
                was, now = sound[claim.id], _verdicts(faulty, claim)
                new = tuple(
                    verdict
                    for name, verdict in now.items()
                    if isinstance(verdict, Verdict) and verdict != was.get(name)
                )
                answers[claim.id] = new if now != was else None
            noticed.update(_found(answers))
            report.append(answers)
        return report


def _verdicts(lab: Laboratory, claim: Claim) -> Mapping[str, Verdict | str]:
    """A claim's verdict on every plant."""
    try:
        judged = judge(lab, claim, refine=False)
    except (ValueError, RuntimeError) as error:
        # A laboratory so wrong that it cannot measure has been noticed as well.
        return {"error": type(error).__name__}
    return {name: each.verdict for name, each in judged.plants.items()}
