"""claims.json, sweeps.json and self_test.json."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.chapter.claims.claim import Finding, Kind, Verdict, sentences_of, verdicts_of
from grosmc_mj.chapter.claims.self_test import Caught
from grosmc_mj.chapter.claims.story import (
    EVIDENCE,
    claim_tables,
    claims_tables,
    evidence_table,
    is_told,
    noticed_table,
    turning_table,
)
from grosmc_mj.chapter.claims.sweep import Swept
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.results.document import plain
from grosmc_mj.results.result import (
    KEPT,
    MEASURED,
    NOT_KEPT,
    Answer,
    LineChart,
    Series,
    Sheet,
    Value,
    result,
)
from grosmc_mj.results.tables import table, text, words

# Fields of a claim and of a finding that a document has as they are.
_OF_CLAIM = ("id", "system", "source", "statement", "quote", "equation", "criterion", "sense",
             "threshold", "unit", "why", "word", "quantifier", "cause", "untested")  # fmt: skip
_OF_FINDING = ("turns", "needs", "because")
# How closely a value repeats that switching amplifies.
_SWITCHED = 0.1
_HOLDS = {True: "the claim holds", False: "it does not", None: "nothing can be told"}


def claims_result(findings: Sequence[Finding], lab: Laboratory) -> dict[str, Any]:
    """The content of claims.json."""
    wrong = sum(bool(finding.unexpected) for finding in findings)
    answer = Answer(
        question="Claims",
        verdict=NOT_KEPT if wrong else KEPT,
        words=f"{wrong} of {len(findings)} verdicts differ from the expected ones"
        if wrong
        else "All verdicts are as expected",
        more=counts_words(findings),
    )
    return result(
        "claims", asdict(lab.settings), seed=0, answers=[answer], sheets=claims_sheets(findings),
        values=claims_values(findings), **claims_numbers(findings, lab),
    )  # fmt: skip


def counts_words(findings: Sequence[Finding]) -> str:
    """Sentences of the chapter by verdict."""
    counts = Counter(verdict.value for verdict in verdicts_of(findings, Kind.CLAIM))
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    return said and f"sentences of the chapter: {said}"


def claims_sheets(findings: Sequence[Finding]) -> list[Sheet]:
    """All tables, the stories of the claims that the page tells, and all values."""
    told = [finding for finding in findings if is_told(finding)]
    stories = [(each.claim.id, *row) for each in told for row in claim_tables(each)[0].rows]
    values = [(each.claim.id, *row) for each in findings for row in evidence_table(each).rows]
    tables = [
        *claims_tables(findings),
        table("Stories of claims", [*words("claim", ""), *text()], stories, grouped=True),
        table("Values of claims", [*words("claim"), *EVIDENCE], values, grouped=True),
    ]
    return [Sheet(table=each) for each in tables if each.rows]


def claims_values(findings: Sequence[Finding]) -> Iterator[Value]:
    """The verdicts and values of claims."""
    for finding in findings:
        claim = finding.claim
        words = "not as expected" if finding.unexpected else "as expected"
        yield Value(name=claim.id, value=words)
        for plant, found in finding.plants.items():
            name, value = f"{claim.id} on {plant}", found.measured.value
            yield Value(name=f"{name}: verdict", value=found.verdict.value)
            yield Value(name=name, value=plain(value), unit=claim.unit, relative=_SWITCHED)


def claims_numbers(findings: Sequence[Finding], lab: Laboratory) -> dict[str, Any]:
    """How many sentences and statements have which verdict; then each sentence, and each claim."""
    counts = {kind.plural: Counter(verdicts_of(findings, kind)) for kind in Kind}
    return {
        "verdicts": {
            name: {verdict.value: own[verdict] for verdict in Verdict}
            for name, own in counts.items()
        },
        "sentences": [
            {
                "quote": sentence.quote,
                "system": sentence.findings[0].claim.system,
                "verdict": sentence.verdict.value,
                "claims": [finding.claim.id for finding in sentence.findings],
            }
            for sentence in sentences_of(findings)
        ],
        "claims": [claim_numbers(finding, lab) for finding in findings],
    }


def claim_numbers(finding: Finding, lab: Laboratory) -> dict[str, Any]:
    """One claim with its measurements."""
    claim = finding.claim
    return {
        **{name: getattr(claim, name) for name in _OF_CLAIM},
        **{name: getattr(finding, name) for name in _OF_FINDING},
        "kind": claim.kind.value,
        "choices": [choice.name for choice in claim.choices],
        "near_its_threshold": finding.near,
        "verdict": finding.verdict.value,
        "plants": {name: _plant(finding, name, lab) for name in finding.plants},
        "expected": {
            "verdicts": {name: verdict.value for name, verdict in claim.verdicts.items()},
            "reason": claim.reason,
        },
    }


def _plant(finding: Finding, plant: PlantName, lab: Laboratory) -> dict[str, Any]:
    """The measurement on one plant, with the evidence that it has converged."""
    found, settings = finding.plants[plant], lab.settings
    evidence: dict[str, Any] = {"exact": found.refined is None}
    if found.refined is not None:
        evidence |= {
            "control_period": [settings.control_period, settings.control_period / 2],
            "timestep": [settings.timestep, settings.timestep / 2],
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


def sweeps_result(swept: Sequence[Swept], lab: Laboratory) -> dict[str, Any]:
    """The content of sweeps.json."""
    rows = [each.document() for each in swept]
    unprinted = {row["claim"] for row in rows if row["flips"] and not row["printed"]}
    claims = {row["claim"] for row in rows}
    words = f"{len(unprinted)} of {len(claims)} answers turn on a choice that is not printed"
    values = []
    for row in rows:
        for trial in row["values"]:
            name, value = f"{row['claim']} with {trial['choice']}", plain(trial["measured"])
            values.append(Value(name=name, value=_HOLDS[trial["holds"]]))
            values.append(Value(name=f"{name}: measured", value=value, relative=_SWITCHED))
    charts = [_sweep_chart(row) for row in sorted(rows, key=lambda row: not row["flips"])]
    return result(
        "sweeps", asdict(lab.settings), seed=0, values=values, sweeps=rows,
        answers=[Answer(question="Choices that are not printed", verdict=MEASURED, words=words)],
        sheets=[Sheet(table=turning_table(rows), charts=charts)],
    )  # fmt: skip


def _sweep_chart(row: Mapping[str, Any]) -> LineChart:
    """The measured values over a choice."""
    trials = row["values"]
    values = [trial["choice"].removeprefix(f"{row['choice']} = ") for trial in trials]
    line = Series(
        name=row["claim"],
        x=values,
        y=[plain(trial["measured"]) for trial in trials],
        texts=values,
        good=[trial["holds"] for trial in trials],
    )
    name = f"{row['claim']}: {row['choice']}" + (", turns" if row["flips"] else "")
    return LineChart(name=name, titles=(row["choice"], "measured"), lines=[line])


def self_test_result(caught: Sequence[Caught], settings: Settings) -> dict[str, Any]:
    """The content of self_test.json."""
    missed = [each.fault.name for each in caught if not each.claims]
    words = f"All {len(caught)} faults are noticed"
    if missed:
        words = f"{len(missed)} of {len(caught)} faults are not noticed: {'; '.join(missed)}"
    answer = Answer(
        question="Faults put into laws and plants",
        verdict=NOT_KEPT if missed else KEPT,
        words=words,
    )
    return result(
        "self_test", asdict(settings), seed=0, answers=[answer],
        sheets=[Sheet(table=noticed_table(caught))],
        noticed_by={each.fault.name: list(each.claims) for each in caught},
    )  # fmt: skip
