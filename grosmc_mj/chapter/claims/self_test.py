"""Faults put into laws and plants, one at a time, and which claims notice them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from typing import NamedTuple

from grosmc_mj.chapter.claims.claim import Claim
from grosmc_mj.chapter.claims.judging import judge, parts_of
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.laboratory import Fault, Laboratory
from grosmc_mj.experiments.runs import Settings


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
    # By fault and claim that was tried, whether it noticed.
    answers: dict[str, dict[str, bool]] = {fault.name: {} for fault in faults}
    parts, left = parts_of(claims), list(faults)
    for again in (True,) if thorough else (False, True):
        work = partial(_tried, Laboratory(settings), parts, left, again)
        with closing(executor.run(work, range(len(parts)), notice)) as reports:
            for part in reports if left else ():
                for name, report in part.report.items():
                    answers[name].update(report)
                for claim in parts[part.index] if again is thorough else ():
                    advance(claim.id)
                left = [fault for fault in faults if not any(answers[fault.name].values())]
                if again and not (thorough or left):
                    break
    return [
        Caught(fault, tuple(claim.id for claim in claims if own.get(claim.id)), len(own))
        for fault, own in zip(faults, answers.values(), strict=True)
    ]


def _tried(
    sound: Laboratory,
    parts: Sequence[Sequence[Claim]],
    faults: Sequence[Fault],
    again: bool,
    index: int,
) -> dict[str, dict[str, bool]]:
    """Try the claims of a part, fault by fault; with ``again`` also those that noticed one."""
    verdicts = {claim.id: _verdicts(sound, claim) for claim in parts[index]}
    report: dict[str, dict[str, bool]] = {}
    for fault in faults:
        faulty = Laboratory(sound.settings, fault)
        noticed = {name for own in report.values() for name, answer in own.items() if answer}
        left = [claim for claim in parts[index] if again or claim.id not in noticed]
        report[fault.name] = {c.id: _verdicts(faulty, c) != verdicts[c.id] for c in left}
    return report


def _verdicts(lab: Laboratory, claim: Claim) -> object:
    """A claim's verdict on every plant."""
    try:
        finding = judge(lab, claim, refine=False)
    except (ValueError, RuntimeError) as error:
        # A laboratory so wrong that it cannot measure has been noticed as well.
        return type(error)
    return {name: on_plant.verdict for name, on_plant in finding.plants.items()}
