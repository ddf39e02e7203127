"""All claims, and how they are judged."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
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
from grosmc_mj.chapter.claims.reading import read_claims
from grosmc_mj.errors import ArgumentError, GrosmcError, unknown_name
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants import SYSTEMS, find_system

# A system that the chapter says nothing of has no file.
_FILES = [Path(__file__).with_name(f"{system}.toml") for system in SYSTEMS]
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
    if name not in claims:
        raise ArgumentError(unknown_name("claim", name, claims))
    return claims[name]


def judge(lab: Laboratory, claim: Claim, *, refine: bool = True) -> Finding:
    """Measure a claim on every plant, at the laboratory's settings and at half the time steps.

    Args:
        lab: Where it is measured.
        claim: What is judged.
        refine: Whether to look at half the time steps too.
    """
    # What a choice turns it turns on every plant: it is tried on the one that decides.
    trials = _trials(lab, claim)
    plants: dict[PlantName, PlantFinding] = {
        name: _on(lab, claim, name, trials, refine=refine) for name in claim.plants
    }
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


def _trials(lab: Laboratory, claim: Claim) -> dict[str, Measured]:
    """What is measured at the values of the choices that the claim is meant for."""
    return {
        choice.written(value): tried(lab, claim, claim.plants[-1], choice, value)
        for choice in claim.choices
        if choice.name in (*claim.every, *claim.some)
        for value in choice.values
    }


def _on(
    lab: Laboratory,
    claim: Claim,
    plant: PlantName,
    trials: Mapping[str, Measured],
    *,
    refine: bool,
) -> PlantFinding:
    """What is found on one plant."""
    measured = claim.measure(lab, plant)
    refined = None if claim.exact or not refine else claim.measure(lab.refined, plant)
    verdict = _verdict(claim, measured, refined)
    if not trials or verdict is Verdict.INCONCLUSIVE:
        return PlantFinding(measured, refined, verdict)
    answers = {claim.holds(each) for each in (measured, *trials.values()) if not each.broken}
    if len(answers) > 1:
        verdict = Verdict.SUPPORTED if claim.some else Verdict.UNDETERMINED
    return PlantFinding(measured, refined, verdict)


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
