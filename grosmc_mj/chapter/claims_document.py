"""Claims and premises as plain values, for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grosmc_mj.assumptions.audit import Audit, Premise, Reading
from grosmc_mj.chapter.claims.claim import (
    Finding,
    Kind,
    Verdict,
    sentences_of,
    verdicts_of,
)
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName


def claims_document(findings: Sequence[Finding], lab: Laboratory) -> dict[str, Any]:
    """How many sentences and statements have which verdict; then each sentence, and each claim."""
    counts = {}
    for kind in Kind:
        verdicts = verdicts_of(findings, kind)
        counts[kind.plural] = {each.value: verdicts.count(each) for each in Verdict}
    return {
        "verdicts": counts,
        "sentences": [
            {
                "quote": sentence.quote,
                "system": sentence.findings[0].claim.system,
                "verdict": sentence.verdict.value,
                "claims": [finding.claim.id for finding in sentence.findings],
            }
            for sentence in sentences_of(findings)
        ],
        "claims": [claim_document(finding, lab) for finding in findings],
    }


def claim_document(finding: Finding, lab: Laboratory) -> dict[str, Any]:
    """One claim with what was found."""
    claim = finding.claim
    return {
        "id": claim.id,
        "system": claim.system,
        "source": claim.source,
        "statement": claim.statement,
        "quote": claim.quote,
        "equation": claim.equation,
        "criterion": claim.criterion,
        "sense": claim.sense,
        "threshold": claim.threshold,
        "unit": claim.unit,
        "why": claim.why,
        "word": claim.word,
        "kind": claim.kind.value,
        "quantifier": claim.quantifier,
        "choices": [choice.name for choice in claim.choices],
        "cause": claim.cause,
        "near_its_threshold": finding.near,
        "turns": finding.turns,
        "needs": finding.needs,
        "verdict": finding.verdict.value,
        "because": finding.because,
        "untested": claim.untested,
        "plants": {name: _plant(finding, name, lab) for name in finding.plants},
        "expected": {
            "verdicts": {name: verdict.value for name, verdict in claim.verdicts.items()},
            "reason": claim.reason,
        },
    }


def _plant(finding: Finding, plant: PlantName, lab: Laboratory) -> dict[str, Any]:
    """What was found on one plant, with the evidence that it has converged."""
    found = finding.plants[plant]
    evidence: dict[str, Any] = {"exact": found.refined is None}
    if found.refined is not None:
        evidence |= {
            "control_period": [lab.settings.control_period, lab.settings.control_period / 2],
            "timestep": [lab.settings.timestep, lab.settings.timestep / 2],
            "values": [found.measured.value, found.refined.value],
            "notes": [found.measured.note, found.refined.note],
            "plants": [plant, found.finer],
        }
    return {
        "value": found.measured.value,
        "note": found.measured.note,
        "verdict": found.verdict.value,
        "evidence": evidence,
        "trials": {name: trial.value for name, trial in finding.trials.items()},
    }


def audit_document(audit: Audit) -> dict[str, Any]:
    """The premises of one law in one case."""
    return {
        "system": audit.case.system,
        "case": audit.case.name,
        "controller": audit.controller,
        "premises": [_premise(premise) for premise in audit.premises],
    }


def _premise(premise: Premise) -> dict[str, Any]:
    """One premise."""
    return {
        "name": premise.name,
        "source": premise.source,
        "requirement": premise.requirement,
        "unit": premise.unit,
        "holds": premise.holds,
        "region": _reading(premise.region),
        "along_run": _reading(premise.along),
        "restored_by": premise.restores,
        "note": premise.note,
    }


def _reading(reading: Reading | None) -> dict[str, Any] | None:
    """A premise at its worst point."""
    if reading is None:
        return None
    return {
        "margin": reading.margin,
        "violated": reading.violated,
        "worst": {"t": reading.worst.t, "x": list(reading.worst.x)},
    }
