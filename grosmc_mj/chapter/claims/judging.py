"""How claims are judged, one here or many in processes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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

    Where physics gives the value of the equations, half the time steps are tried on the equations
    alone: they are integrated by the same method and cost a twentieth.

    Args:
        lab: Where it is measured.
        claim: The claim.
        refine: Whether to look at half the time steps too.
    """
    plants: dict[PlantName, PlantFinding] = {}
    for name in claim.plants:
        equations = plants.get("corrected") if name == "physics" else None
        plants[name] = _on_plant(lab, claim, name, equations, refine=refine and not claim.exact)
    # What a choice turns it turns on every plant: it is tried on the one that decides.
    trials = _trials(lab, claim, plants)
    plants = {name: _with_trials(claim, finding, trials) for name, finding in plants.items()}
    finding = Finding(claim, plants, trials=trials)
    failed = finding.verdict in (Verdict.REFUTED, Verdict.UNDETERMINED)
    because = claim.premise(lab) if failed and claim.premise is not None else ""
    if because:
        for name, on_plant in plants.items():
            if on_plant.verdict is Verdict.REFUTED:
                plants[name] = replace(on_plant, verdict=Verdict.PREMISE_NOT_MET)
    return replace(finding, because=because)


def _on_plant(
    lab: Laboratory,
    claim: Claim,
    plant: PlantName,
    equations: PlantFinding | None,
    *,
    refine: bool,
) -> PlantFinding:
    """The finding on one plant, beside that on the equations if they may stand in for it."""
    measured, refined, finer = claim.measure(lab, plant), None, plant
    if refine and equations is not None and _same(measured, equations.measured):
        refined, finer = equations.refined, "corrected"
    elif refine:
        refined = claim.measure(lab.refined, plant)
    both = [measured] if refined is None else [measured, refined]
    answers = {claim.holds(each) for each in both}
    strange = any(each.broken or not math.isfinite(each.value or 0.0) for each in both)
    verdict = Verdict.SUPPORTED if True in answers else Verdict.REFUTED
    if strange or len(answers) > 1:
        verdict = Verdict.INCONCLUSIVE
    return PlantFinding(measured, refined, verdict, finer)


def _trials(
    lab: Laboratory, claim: Claim, plants: Mapping[PlantName, PlantFinding]
) -> dict[str, Measured]:
    """Measurements at the values of the choices that the claim is meant for.

    Where physics gives the value of the equations, it confirms only those that are nearest to the
    threshold on either side.
    """
    meant = [choice for choice in claim.choices if choice.name in (*claim.every, *claim.some)]
    tries = {choice.written(value): (choice, value) for choice in meant for value in choice.values}
    deciding = claim.plants[-1]
    twins = not claim.exact and deciding == "physics" and "corrected" in plants
    if twins and _same(plants["physics"].measured, plants["corrected"].measured):
        screened = {name: tried(lab, claim, "corrected", *each) for name, each in tries.items()}
        nearest = _nearest(claim, screened)
        confirmed = {name: tried(lab, claim, deciding, *tries[name]) for name in nearest}
        if all(_same(each, screened[name]) for name, each in confirmed.items()):
            return screened | confirmed
    return {name: tried(lab, claim, deciding, *each) for name, each in tries.items()}


def _nearest(claim: Claim, trials: Mapping[str, Measured]) -> list[str]:
    """Of those that hold and of those that don't, the one nearest to the threshold."""
    distance = {
        name: math.inf if each.value is None else abs(each.value - claim.threshold)
        for name, each in trials.items()
        if not each.broken
    }
    sides = [
        [name for name in distance if claim.holds(trials[name]) is answer]
        for answer in (True, False)
    ]
    return [min(side, key=distance.__getitem__) for side in sides if side]


def _with_trials(
    claim: Claim, finding: PlantFinding, trials: Mapping[str, Measured]
) -> PlantFinding:
    """The finding on one plant, with what the choices turn."""
    measured = [each for each in (finding.measured, *trials.values()) if not each.broken]
    turns = len({claim.holds(each) for each in measured}) > 1
    if finding.verdict is Verdict.INCONCLUSIVE or not turns:
        return finding
    return replace(finding, verdict=Verdict.SUPPORTED if claim.some else Verdict.UNDETERMINED)


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
