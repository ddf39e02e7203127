"""All claims, judged."""

from __future__ import annotations

import math

from grosmc_mj.chapter.claims import arm, cart, cart_pendulum, servo, theory, two_link_arm
from grosmc_mj.chapter.claims.claim import Claim, Finding, Measured, PlantFinding, Verdict
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants import SYSTEMS, find_system

CLAIMS: tuple[Claim, ...] = tuple(
    sorted(
        (
            *servo.CLAIMS,
            *cart_pendulum.CLAIMS,
            *cart.CLAIMS,
            *arm.CLAIMS,
            *two_link_arm.CLAIMS,
            *theory.CLAIMS,
        ),
        key=lambda claim: list(SYSTEMS).index(claim.system),
    )
)


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
    found = {claim.id: claim for claim in CLAIMS}
    if name not in found:
        raise ArgumentError(unknown_name("claim", name, found))
    return found[name]


def judge(lab: Laboratory, claim: Claim, *, refine: bool = True) -> Finding:
    """Measure a claim on every plant, at the laboratory's settings and at half the time steps.

    Args:
        lab: Where it is measured.
        claim: What is judged.
        refine: Whether to look at half the time steps too.
    """
    plants: dict[PlantName, PlantFinding] = {
        name: _on(lab, claim, name, refine=refine) for name in claim.plants
    }
    finding = Finding(claim, plants)
    if claim.premise is None or finding.verdict is not Verdict.REFUTED:
        return finding
    return Finding(claim, plants, claim.premise(lab))


def _on(lab: Laboratory, claim: Claim, plant: PlantName, *, refine: bool) -> PlantFinding:
    """What is found on one plant."""
    measured = claim.measure(lab, plant)
    refined = None if claim.exact or not refine else claim.measure(lab.refined, plant)
    return PlantFinding(measured, refined, _verdict(claim, measured, refined))


def _verdict(claim: Claim, measured: Measured, refined: Measured | None) -> Verdict:
    """Supported or refuted if both measurements say so; otherwise there is no telling."""
    both = [measured] if refined is None else [measured, refined]
    answers = {claim.holds(each) for each in both}
    strange = any(each.value is not None and not math.isfinite(each.value) for each in both)
    if strange or len(answers) > 1 or any(each.broken for each in both):
        return Verdict.INCONCLUSIVE
    return Verdict.SUPPORTED if answers.pop() else Verdict.REFUTED
