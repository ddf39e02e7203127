"""How claims are judged, one here or many in processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any

from grosmc_mj.chapter.claims.claim import (
    Choice,
    Claim,
    Finding,
    Measured,
    NeedsSlidingModeError,
    PlantFinding,
    Verdict,
)
from grosmc_mj.errors import GrosmcError
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName

# Share of the value by which two plants may differ that are taken for one: what rounding leaves
# after a run of 20 s is a thousandth of it.
_SAME = 1e-6
# Claims of one system that a process takes at once: neighbours in its file look at the same runs.
_PART = 8


def judge(lab: Laboratory, claim: Claim, *, refine: bool = True) -> Finding:
    """Measure a claim on every plant, at the laboratory's settings and at half the time steps.

    What a choice turns it turns on every plant: it is tried on the one that decides.

    Args:
        lab: Where it is measured.
        claim: The claim.
        refine: Whether to look at half the time steps too.
    """
    trials = {
        choice.written(value): tried(lab, claim, claim.plants[-1], choice, value)
        for choice in claim.choices
        if choice.name in (*claim.every, *claim.some)
        for value in choice.values
    }
    plants: dict[PlantName, PlantFinding] = {}
    for name in claim.plants:
        measured, refined, finer = claim.measure(lab, name), None, name
        if refine and not claim.exact:
            equations = plants.get("corrected") if name == "physics" else None
            # The same value: the equations stand in, which cost a twentieth.
            if equations is not None and _same(measured, equations.measured):
                refined, finer = equations.refined, "corrected"
            else:
                refined = claim.measure(lab.refined, name)
        verdict = _verdict(claim, measured, refined, trials.values())
        plants[name] = PlantFinding(measured, refined, verdict, finer)
    finding = Finding(claim, plants, trials=trials)
    failed = finding.verdict in (Verdict.REFUTED, Verdict.UNDETERMINED)
    because = claim.premise(lab) if failed and claim.premise is not None else ""
    for name, on_plant in plants.items():
        if because and on_plant.verdict is Verdict.REFUTED:
            plants[name] = replace(on_plant, verdict=Verdict.PREMISE_NOT_MET)
    return replace(finding, because=because)


def _verdict(
    claim: Claim, measured: Measured, refined: Measured | None, trials: Iterable[Measured]
) -> Verdict:
    """The verdict on one plant by its values at both time steps and what the choices turn."""
    both = [measured] if refined is None else [measured, refined]
    answers = {claim.holds(one) for one in both}
    strange = any(one.broken or not math.isfinite(one.value or 0.0) for one in both)
    if strange or len(answers) > 1:
        return Verdict.INCONCLUSIVE
    if len(answers | {claim.holds(trial) for trial in trials if not trial.broken}) > 1:
        return Verdict.SUPPORTED if claim.some else Verdict.UNDETERMINED
    return Verdict.SUPPORTED if True in answers else Verdict.REFUTED


def _same(one: Measured, other: Measured) -> bool:
    """Whether two plants are one as far as a measurement tells."""
    if one.value is None or other.value is None or one.broken or other.broken:
        return False
    return math.isclose(one.value, other.value, rel_tol=_SAME)


def tried(lab: Laboratory, claim: Claim, plant: PlantName, choice: Choice, value: Any) -> Measured:
    """A measurement with another value of a choice; broken where no law can be designed."""
    try:
        if choice.argument:
            return claim.measure(lab, plant, **{choice.argument: value})
        return claim.measure(lab.varied(choice.key, value), plant)
    except NeedsSlidingModeError:
        raise
    except GrosmcError as error:
        return Measured(None, str(error), broken=True)


def verdict_differences(findings: Sequence[Finding]) -> list[str]:
    """One line for each verdict that is not the expected one."""
    return [
        f"claim {finding.claim.id} on {plant}: {verdict.value}, expected "
        f"{finding.claim.verdicts[plant].value}"
        for finding in findings
        for plant, verdict in finding.unexpected.items()
    ]


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
        claims: The claims.
        executor: Who judges.
        advance: Called with a claim's id when it has been judged.
        notice: Called when a worker died and was replaced.

    Raises:
        GrosmcError: As a measurement or the executor raises it.
    """
    parts = parts_of(claims)
    findings: dict[str, Finding] = {}
    with closing(executor.run(partial(_judged, lab, parts), range(len(parts)), notice)) as answers:
        for part in answers:
            for claim, finding in zip(parts[part.index], part.report, strict=True):
                # What has travelled is a copy.
                findings[claim.id] = replace(finding, claim=claim)
                advance(claim.id)
    return [findings[claim.id] for claim in claims]


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
