"""Many claims at once, here or in processes; what one process judges shares its runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import groupby

from grosmc_mj.chapter.claims.claim import Claim, Finding
from grosmc_mj.chapter.claims.ledger import judge
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.laboratory import Laboratory

# Claims of one system that a process takes at once: neighbours in its file look at the same runs.
_PART = 8


def judge_claims(
    lab: Laboratory,
    claims: Sequence[Claim],
    executor: Executor,
    advance: Callable[[str], object] = lambda _: None,
    notice: Notice = lambda _: None,
) -> list[Finding]:
    """Judge claims as ``judge`` does, in their order.

    Args:
        lab: Where they are measured; a process has its like, without the runs that are there.
        claims: What is judged.
        executor: Who judges.
        advance: Called with a claim's id when it has been judged.
        notice: Told of a worker that died and was replaced.

    Raises:
        GrosmcError: As a measurement or the executor raises it.
    """
    parts = parts_of(claims)
    found: dict[str, Finding] = {}
    with closing(executor.run(partial(_judged, lab, parts), range(len(parts)), notice)) as answers:
        for part in answers:
            for claim, finding in zip(parts[part.index], part.report, strict=True):
                # What has travelled is a copy.
                found[claim.id] = replace(finding, claim=claim)
                advance(claim.id)
    return [found[claim.id] for claim in claims]


def parts_of(claims: Sequence[Claim]) -> list[list[Claim]]:
    """Claims in parts, each of one system."""
    systems = groupby(sorted(claims, key=lambda claim: claim.system), lambda claim: claim.system)
    return [
        own[first : first + _PART]
        for own in (list(of_system) for _, of_system in systems)
        for first in range(0, len(own), _PART)
    ]


def _judged(lab: Laboratory, parts: Sequence[Sequence[Claim]], index: int) -> list[Finding]:
    """Judge a part; all parts that come to one process are measured in one laboratory."""
    return [judge(lab, claim) for claim in parts[index]]
