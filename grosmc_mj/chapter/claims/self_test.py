"""Faults put into laws and plants, one at a time, and which claims notice them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from functools import partial
from typing import NamedTuple

from grosmc_mj.chapter.claims.claim import Claim
from grosmc_mj.chapter.claims.judging import judge, parts_of
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.runs import Settings

# By claim that was tried, whether it noticed.
_Answers = dict[str, bool]


class Caught(NamedTuple):
    """The claims that noticed a fault.

    Attributes:
        fault: The fault.
        claims: Ids of the claims with another verdict than in a sound laboratory.
        tried: How many claims were tried.
    """

    fault: Fault
    claims: tuple[str, ...]
    tried: int = 0


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

    Without refinement: a fault shows at the first look. A claim that has noticed a fault is tried
    again only with those that no claim has noticed.

    Args:
        settings: How cases are run.
        claims: Claims to try.
        faults: Faults to put in, each of another name.
        executor: Who tries them.
        advance: Called with a claim's id when it has been tried.
        notice: Called when a worker died and was replaced.
        thorough: Whether to try every claim with every fault.
    """
    answers: dict[str, _Answers] = {fault.name: {} for fault in faults}
    parts, left = parts_of(claims), list(faults)
    for again in (thorough, True):
        work = partial(_tried, Laboratory(settings), parts, left, again)
        with closing(executor.run(work, range(len(parts)), notice)) as reports:
            for part in reports:
                for name, report in part.report.items():
                    answers[name].update(report)
                for claim in parts[part.index] if again is thorough else ():
                    advance(claim.id)
                left = [fault for fault in faults if not any(answers[fault.name].values())]
                if again and not (thorough or left):
                    break
        if thorough or not left:
            break
    return [
        Caught(
            fault,
            tuple(claim.id for claim in claims if answers[fault.name].get(claim.id)),
            len(answers[fault.name]),
        )
        for fault in faults
    ]


def _tried(
    sound: Laboratory,
    parts: Sequence[Sequence[Claim]],
    faults: Sequence[Fault],
    again: bool,
    index: int,
) -> dict[str, _Answers]:
    """Try the claims of a part, fault by fault; with ``again`` also those that noticed one."""
    verdicts = {claim.id: _verdicts(sound, claim) for claim in parts[index]}
    noticed: set[str] = set()
    report: dict[str, _Answers] = {}
    for fault in faults:
        faulty = Laboratory(sound.settings, fault)
        left = [claim for claim in parts[index] if again or claim.id not in noticed]
        answers = {claim.id: _verdicts(faulty, claim) != verdicts[claim.id] for claim in left}
        noticed |= {name for name, answer in answers.items() if answer}
        report[fault.name] = answers
    return report


def _verdicts(lab: Laboratory, claim: Claim) -> Mapping[str, object]:
    """A claim's verdict on every plant."""
    try:
        finding = judge(lab, claim, refine=False)
    except (ValueError, RuntimeError) as error:
        # A laboratory so wrong that it cannot measure has been noticed as well.
        return {"error": type(error)}
    return {name: each.verdict for name, each in finding.plants.items()}
