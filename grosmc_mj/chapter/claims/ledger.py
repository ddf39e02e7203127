"""All claims, and how they are judged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from grosmc_mj.arguments import require_known
from grosmc_mj.chapter.claims.claim import (
    Choice,
    Claim,
    Finding,
    Measured,
    NeedsSlidingModeError,
    PlantFinding,
    Verdict,
)
from grosmc_mj.chapter.claims.reading import read_claims
from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants import SYSTEMS, find_system

# A system that the chapter says nothing of has no file.
_FILES = [Path(__file__).with_name(f"{system}.toml") for system in SYSTEMS]

# Share of the value by which two plants may differ that are taken for one: what rounding leaves
# after a run of 20 s is a thousandth of it.
_SAME = 1e-6

CLAIMS = read_claims(path for path in _FILES if path.is_file())


def select_claims(system: str | None = None) -> list[Claim]:
    """The claims about a system, or all.

    Raises:
        ModelError: If there is no such system.
    """
    if system is None:
        return list(CLAIMS)
    name = find_system(system).name
    return [claim for claim in CLAIMS if claim.system == name]


def find_claim(name: str) -> Claim:
    """A claim by its id.

    Raises:
        ArgumentError: If there is none of that name.
    """
    claims = {claim.id: claim for claim in CLAIMS}
    require_known("claim", name, claims)
    return claims[name]


def judge(lab: Laboratory, claim: Claim, *, refine: bool = True) -> Finding:
    """Measure a claim on every plant, at the laboratory's settings and at half the time steps.

    Where physics gives what the equations give, half the time steps are tried on the equations
    alone: they are integrated by the same method and cost a twentieth.

    Args:
        lab: Where it is measured.
        claim: What is judged.
        refine: Whether to look at half the time steps too.
    """
    plants: dict[PlantName, PlantFinding] = {}
    for name in claim.plants:
        equations = plants.get("corrected") if name == "physics" else None
        plants[name] = _on(lab, claim, name, equations, refine=refine)
    # What a choice turns it turns on every plant: it is tried on the one that decides.
    trials = _trials(lab, claim, plants)
    plants = {name: _with_trials(claim, found, trials) for name, found in plants.items()}
    finding = Finding(claim, plants, trials=trials)
    failed = (Verdict.REFUTED, Verdict.UNDETERMINED)
    if claim.premise is None or finding.verdict not in failed:
        return finding
    because = claim.premise(lab)
    if because:
        for name, found in plants.items():
            if found.verdict is Verdict.REFUTED:
                plants[name] = replace(found, verdict=Verdict.PREMISE_NOT_MET)
    return replace(finding, because=because)


def by_cause(findings: Sequence[Finding]) -> dict[str, list[Finding]]:
    """What is not supported, by its cause: what most of them fail for first."""
    causes: dict[str, list[Finding]] = {}
    for finding in findings:
        if finding.verdict is not Verdict.SUPPORTED:
            causes.setdefault(finding.claim.cause, []).append(finding)
    return dict(sorted(causes.items(), key=lambda each: -len(each[1])))


def verdict_differences(findings: Sequence[Finding]) -> list[str]:
    """One line for each verdict that is not the expected one."""
    return [
        f"claim {finding.claim.id} on {plant}: {found.verdict.value}, expected {wanted.value}"
        for finding in findings
        for plant, found in finding.plants.items()
        if found.verdict is not (wanted := finding.claim.verdicts[plant])
    ]


def _trials(
    lab: Laboratory, claim: Claim, plants: Mapping[PlantName, PlantFinding]
) -> dict[str, Measured]:
    """What is measured at the values of the choices that the claim is meant for.

    Where physics gives what the equations give, it confirms only what is nearest to the threshold
    on either side.
    """
    meant = [each for each in claim.choices if each.name in (*claim.every, *claim.some)]
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


def _on(
    lab: Laboratory,
    claim: Claim,
    plant: PlantName,
    equations: PlantFinding | None,
    *,
    refine: bool,
) -> PlantFinding:
    """What is found on one plant, beside what the equations gave if they may stand in for it."""
    measured, refined, finer = claim.measure(lab, plant), None, plant
    if refine and not claim.exact:
        if equations is not None and _same(measured, equations.measured):
            refined, finer = equations.refined, "corrected"
        else:
            refined = claim.measure(lab.refined, plant)
    return PlantFinding(measured, refined, _verdict(claim, measured, refined), finer)


def _with_trials(claim: Claim, found: PlantFinding, trials: Mapping[str, Measured]) -> PlantFinding:
    """What is found on one plant, with what the choices make of it."""
    if found.verdict is Verdict.INCONCLUSIVE:
        return found
    answers = {claim.holds(each) for each in (found.measured, *trials.values()) if not each.broken}
    if len(answers) < 2:
        return found
    verdict = Verdict.SUPPORTED if claim.some else Verdict.UNDETERMINED
    return replace(found, verdict=verdict)


def _same(one: Measured, other: Measured) -> bool:
    """Whether two plants are one as far as a measurement tells."""
    if one.value is None or other.value is None:
        return False
    same = math.isclose(one.value, other.value, rel_tol=_SAME)
    return same and one.broken is other.broken is False


def tried(lab: Laboratory, claim: Claim, plant: PlantName, choice: Choice, value: Any) -> Measured:
    """What is measured with another value of a choice; broken where no law can be designed."""
    try:
        if choice.argument:
            return partial(claim.measure, **{choice.argument: value})(lab, plant)
        return claim.measure(lab.varied(choice.key, value), plant)
    except NeedsSlidingModeError:
        raise
    except GrosmcError as error:
        return Measured(None, str(error), broken=True)


def _verdict(claim: Claim, measured: Measured, refined: Measured | None) -> Verdict:
    """Supported or refuted if both measurements say so; otherwise there is no telling."""
    both = [measured] if refined is None else [measured, refined]
    answers = {claim.holds(measurement) for measurement in both}
    strange = any(
        measurement.value is not None and not math.isfinite(measurement.value)
        for measurement in both
    )
    if strange or len(answers) > 1 or any(measurement.broken for measurement in both):
        return Verdict.INCONCLUSIVE
    return Verdict.SUPPORTED if answers.pop() else Verdict.REFUTED
