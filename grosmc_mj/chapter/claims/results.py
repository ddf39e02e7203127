"""claims.json and sweeps.json."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.chapter.claims.claim import Finding, Kind, verdicts_of
from grosmc_mj.chapter.claims.story import claims_tables, turning_table
from grosmc_mj.experiments.laboratory import Laboratory
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
    words = f"{wrong} of {len(findings)} verdicts differ from the expected ones"
    answer = Answer(
        question="Claims",
        verdict=NOT_KEPT if wrong else KEPT,
        words=words if wrong else "All verdicts are as expected",
        more=counts_words(findings),
    )
    return result(
        "claims", asdict(lab.settings), seed=0, answers=[answer], sheets=claims_sheets(findings),
        values=claims_values(findings), claims=[claim_numbers(one, lab) for one in findings],
    )  # fmt: skip


def counts_words(findings: Sequence[Finding]) -> str:
    """Sentences of the chapter by verdict."""
    counts = Counter(verdict.value for verdict in verdicts_of(findings, Kind.CLAIM))
    shares = ", ".join(f"{count} {verdict}" for verdict, count in counts.most_common())
    return shares and f"sentences of the chapter: {shares}"


def claims_sheets(findings: Sequence[Finding]) -> list[Sheet]:
    """All tables of claims; the page tells the story of each from its numbers."""
    return [Sheet(table=one) for one in claims_tables(findings) if one.rows]


def claims_values(findings: Sequence[Finding]) -> Iterator[Value]:
    """The verdicts and values of claims."""
    for finding in findings:
        claim = finding.claim
        words = "not as expected" if finding.unexpected else "as expected"
        yield Value(name=claim.id, value=words)
        for plant, on_plant in finding.plants.items():
            name, value = f"{claim.id} on {plant}", on_plant.measured.value
            yield Value(name=f"{name}: verdict", value=on_plant.verdict.value)
            yield Value(name=name, value=plain(value), unit=claim.unit, relative=_SWITCHED)


def claim_numbers(finding: Finding, lab: Laboratory) -> dict[str, Any]:
    """One claim with its measurements, and the evidence that they have converged."""
    claim, settings, plants = finding.claim, lab.settings, dict[str, Any]()
    for name, on_plant in finding.plants.items():
        evidence: dict[str, Any] = {"exact": on_plant.refined is None}
        if on_plant.refined is not None:
            evidence |= {
                "control_period": [settings.control_period, settings.control_period / 2],
                "timestep": [settings.timestep, settings.timestep / 2],
                "values": [on_plant.measured.value, on_plant.refined.value],
                "notes": [on_plant.measured.note, on_plant.refined.note],
                "plants": [name, on_plant.finer],
            }
        value, note, _ = on_plant.measured
        plants[name] = {"value": value, "note": note, "verdict": on_plant.verdict.value}
        plants[name]["evidence"] = evidence
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
            "verdicts": {name: verdict.value for name, verdict in claim.verdicts.items()},
            "reason": claim.reason,
        },
    }


def sweeps_result(rows: Sequence[Mapping[str, Any]], lab: Laboratory) -> dict[str, Any]:
    """The content of sweeps.json, of what ``sweep`` yields."""
    turning = {row["claim"] for row in rows if row["flips"] and not row["printed"]}
    claims = {row["claim"] for row in rows}
    words = f"{len(turning)} of {len(claims)} answers turn on a choice that is not printed"
    values, charts = list[Value](), list[LineChart]()
    for row in sorted(rows, key=lambda row: not row["flips"]):
        for trial in row["values"]:
            name, value = f"{row['claim']} with {trial['choice']}", plain(trial["measured"])
            values.append(Value(name=name, value=_HOLDS[trial["holds"]]))
            values.append(Value(name=f"{name}: measured", value=value, relative=_SWITCHED))
        at = [trial["choice"].removeprefix(f"{row['choice']} = ") for trial in row["values"]]
        line = Series(
            name=row["claim"],
            x=at,
            y=[plain(trial["measured"]) for trial in row["values"]],
            texts=at,
            good=[trial["holds"] for trial in row["values"]],
        )
        name = f"{row['claim']}: {row['choice']}" + (", turns" if row["flips"] else "")
        charts.append(LineChart(name=name, titles=(row["choice"], "measured"), lines=[line]))
    return result(
        "sweeps", asdict(lab.settings), seed=0, values=values, sweeps=rows,
        answers=[Answer(question="Choices that are not printed", verdict=MEASURED, words=words)],
        sheets=[Sheet(table=turning_table(rows), charts=charts)],
    )  # fmt: skip
