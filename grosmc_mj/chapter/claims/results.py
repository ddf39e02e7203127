"""claims.json and sweeps.json."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.chapter.claims.claim import ClaimFinding, Kind, sentences_of
from grosmc_mj.chapter.claims.ledger import CLAIMS
from grosmc_mj.chapter.claims.story import claim_tables, claims_tables, turning_table
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.wording import counted_of
from grosmc_mj.output.results.document import plain
from grosmc_mj.output.results.result import (
    KEPT,
    MEASURED,
    NOT_KEPT,
    Answer,
    LineChart,
    ReportTable,
    Result,
    Series,
    Value,
    report_tables,
    result,
)

# Fields of a claim and of a finding that a document repeats.
_OF_CLAIM = (
    "id",
    "system",
    "source",
    "statement",
    "quote",
    "equation",
    "criterion",
    "sense",
    "threshold",
    "unit",
    "why",
    "word",
    "quantifier",
    "cause",
    "untested",
)
_OF_FINDING = ("turns", "needs", "because")
# Relative tolerance of a value on another machine: switching amplifies rounding.
_SWITCHED = 0.1
_HOLDS = {True: "the claim holds", False: "it does not", None: "nothing can be told"}


def claims_result(
    findings: Sequence[ClaimFinding],
    settings: Settings,
    faults: Sequence[str] = (),
    of: str = "the chapter",
) -> Result:
    """Return the result of judged claims; of a single one it tells how it was judged.

    Args:
        findings: The judged claims.
        settings: Settings of their runs.
        faults: Verdicts that are not the expected ones, a line each.
        of: System or place in the chapter that the claims are about.
    """
    question = f"Claims of {of}"
    if len(findings) == 1:
        question = f"Claim {findings[0].claim.id}"
    verdict = KEPT
    sentence = "All verdicts are as expected"
    unexpected = sum(bool(finding.unexpected) for finding in findings)
    if unexpected:
        verdict = NOT_KEPT
        sentence = (
            f"{counted_of(unexpected, len(findings), 'verdict', 'differs', 'differ')} "
            f"from the expected ones"
        )

    answer = Answer(
        question=question,
        verdict=verdict,
        words=sentence,
        more=counts_words(findings),
        standard="expected",
        faults=faults,
    )
    tables = claims_tables(findings)
    brief = 2
    if len(findings) == 1:
        tables = claim_tables(findings[0])
        brief = len(tables)
    return result(
        "claims",
        asdict(settings),
        seed=0,
        answers=[answer],
        sheets=report_tables(tables, brief),
        values=claims_values(findings),
        claims=[claim_numbers(finding) for finding in findings],
    )


def counts_words(findings: Sequence[ClaimFinding]) -> str:
    """Return the counts of the chapter's sentences by verdict, in words; empty without any.

    A sentence of which some claims are left out has no verdict.
    """
    under = Counter((claim.system, claim.quote) for claim in CLAIMS if claim.kind is Kind.CLAIM)
    counts = Counter[str]()
    words = []
    for sentence in sentences_of(findings):
        claim = sentence.findings[0].claim
        judged = len(sentence.findings)
        all_claims = under[claim.system, claim.quote]
        if judged < all_claims:
            words.append(
                f"{judged} of the {all_claims} claims under one sentence: see docs/claims.md"
            )
        else:
            counts[sentence.verdict.value] += 1

    if counts:
        shares = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
        words.insert(0, f"sentences of the chapter: {shares}")
    return "; ".join(words)


def claims_values(findings: Sequence[ClaimFinding]) -> Iterator[Value]:
    """Yield the verdicts and values of claims."""
    for finding in findings:
        claim = finding.claim
        expectation = "not as expected" if finding.unexpected else "as expected"
        yield Value(name=claim.id, value=expectation)
        for plant, on_plant in finding.plants.items():
            name = f"{claim.id} on {plant}"
            value = plain(on_plant.measured.value)
            yield Value(name=f"{name}: verdict", value=on_plant.verdict.value)
            yield Value(name=name, value=value, unit=claim.unit, relative=_SWITCHED)


def claim_numbers(finding: ClaimFinding) -> dict[str, Any]:
    """Return one claim with its measurements, at T and at half of it."""
    claim = finding.claim
    plants = {}
    for plant, on_plant in finding.plants.items():
        plants[plant] = {
            "value": on_plant.measured.value,
            "note": on_plant.measured.note,
            "verdict": on_plant.verdict.value,
        }
        if on_plant.refined is not None:
            plants[plant]["refined"] = {**on_plant.refined._asdict(), "plant": on_plant.finer}
    return {
        **{name: getattr(claim, name) for name in _OF_CLAIM},
        **{name: getattr(finding, name) for name in _OF_FINDING},
        "kind": claim.kind.name.lower(),
        "choices": [choice.name for choice in claim.choices],
        "near_its_threshold": finding.near,
        "verdict": finding.verdict.value,
        "plants": plants,
        "trials": {name: trial.value for name, trial in finding.trials.items()},
        "expected": {
            "verdicts": {plant: verdict.value for plant, verdict in claim.verdicts.items()},
            "reason": claim.reason,
        },
    }


def sweeps_result(rows: Sequence[Mapping[str, Any]], settings: Settings) -> Result:
    """Return the result of sweeps, from the rows that ``sweep`` yields."""
    claims = {row["claim"] for row in rows}
    turning = {row["claim"] for row in rows if row["flips"] and not row["printed"]}
    answer = Answer(
        question="Choices that are not printed",
        verdict=MEASURED,
        words=f"{counted_of(len(turning), len(claims), 'answer', 'turns', 'turn')} "
        f"on a choice that is not printed",
    )

    values = []
    charts = []
    for row in sorted(rows, key=lambda row: not row["flips"]):
        values += _sweep_values(row)
        charts.append(_sweep_chart(row))
    return result(
        "sweeps",
        asdict(settings),
        seed=0,
        values=values,
        sweeps=rows,
        answers=[answer],
        sheets=[ReportTable(table=turning_table(rows), charts=charts, brief=True)],
    )


def _sweep_values(row: Mapping[str, Any]) -> Iterator[Value]:
    """Answer and measured value of a claim at each value of a choice."""
    for trial in row["values"]:
        name = f"{row['claim']} with {trial['choice']}"
        measured = plain(trial["measured"])
        yield Value(name=name, value=_HOLDS[trial["holds"]])
        yield Value(name=f"{name}: measured", value=measured, relative=_SWITCHED)


def _sweep_chart(row: Mapping[str, Any]) -> LineChart:
    """Measured value of a claim over the values of a choice."""
    trials = row["values"]
    choices = [trial["choice"].removeprefix(f"{row['choice']} = ") for trial in trials]
    line = Series(
        name=f"{row['claim']} (hollow: does not hold)",
        x=choices,
        y=[plain(trial["measured"]) for trial in trials],
        texts=choices,
        good=[trial["holds"] for trial in trials],
    )
    name = f"{row['claim']}: {row['choice']}"
    if row["flips"]:
        name += ", turns"
    return LineChart(name=name, titles=(row["choice"], "measured"), lines=[line])
