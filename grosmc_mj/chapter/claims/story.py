"""The tables and stories of claims, for the terminal, Markdown and the page alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from grosmc_mj.chapter.claims.claim import (
    RULE,
    Claim,
    ClaimFinding,
    ClaimValue,
    ClaimVerdict,
    Kind,
    PlantFinding,
    sentences_of,
    verdicts_of,
)
from grosmc_mj.chapter.claims.formulas import in_text
from grosmc_mj.chapter.claims.sweep import stored_flips
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.output.results.tables import Column, Table, numbers, table, text, verdicts, words

LEGEND = (
    "* turns within 50 % of its threshold or with a choice that is not printed. In brackets: the "
    "choice that the statement needs. Values are on the plant that decides."
)
EVIDENCE = [
    *words("plant"),
    *numbers("at T", "at T/2"),
    *verdicts("verdict"),
    *text("note"),
]


def number_of(measured: ClaimValue | None) -> str:
    """Return a value in short, or ``none``."""
    if measured is None or measured.value is None:
        return "none"
    return f"{measured.value:.3g}"


def criterion_text(claim: Claim) -> str:
    """Return the criterion in few characters."""
    relation = "≤" if claim.sense == "at most" else "≥"
    limit = f"{relation} {claim.threshold:g}"
    if claim.unit == "unit of s/s":
        return limit
    return f"{limit}{unit_after(claim.unit)}"


def has_story(finding: ClaimFinding) -> bool:
    """Whether the page has the claim's story: of equations, proofs, and claims not supported."""
    if finding.claim.kind in (Kind.MISPRINT, Kind.PROOF):
        return True
    return finding.verdict is not ClaimVerdict.SUPPORTED


def turning_reasons(finding: ClaimFinding) -> list[str]:
    """Return what can turn the verdict: a near threshold, and choices that are not printed."""
    reasons = []
    if finding.near:
        reasons.append("within 50 % of its threshold")

    flips = stored_flips(finding.claim.id)
    unprinted = [choice.name for choice in finding.claim.choices if not choice.printed]
    return reasons + [f"flips {flips[name]}" for name in unprinted if name in flips]


def counts_table(findings: Sequence[ClaimFinding]) -> Table:
    """Return the counts of sentences and statements by verdict."""
    rows = []
    for kind in Kind:
        of_kind = verdicts_of(findings, kind)
        if of_kind:
            counts = [str(of_kind.count(verdict)) for verdict in ClaimVerdict]
            rows.append([kind.value, *counts, str(len(of_kind))])

    headers = [verdict.value for verdict in ClaimVerdict]
    return table("Verdicts of physics", [*words(""), *numbers(*headers, "all")], rows)


def causes_table(findings: Sequence[ClaimFinding]) -> Table:
    """Return the causes for which claims are not supported, the most frequent first."""
    causes: dict[str, list[str]] = {}
    for finding in findings:
        if finding.verdict is not ClaimVerdict.SUPPORTED:
            causes.setdefault(finding.claim.cause, []).append(finding.claim.id)

    rows = []
    for cause, claims in sorted(causes.items(), key=lambda item: -len(item[1])):
        rows.append([cause, ", ".join(claims), str(len(claims))])
    columns = [
        Column(header="not supported since", width=50, cut=True),
        Column(header="statements", width=42, cut=True),
        *numbers(""),
    ]
    return table("", columns, rows)


def sentences_table(findings: Sequence[ClaimFinding]) -> Table:
    """Return each sentence of the chapter with its verdict and the claims under it."""
    rows = []
    for sentence in sentences_of(findings):
        claims = "; ".join(
            f"{finding.claim.id}: {finding.verdict.value}" for finding in sentence.findings
        )
        rows.append([sentence.quote, claims, sentence.verdict.value])

    columns = [*text("sentence"), *text("claims under it"), *verdicts("verdict")]
    return table(Kind.CLAIM.value, columns, rows, legend=RULE)


def statements_tables(findings: Sequence[ClaimFinding]) -> list[Table]:
    """Return for each kind the table of its statements, with the value on the deciding plant."""
    columns = [*words("claim"), *text("statement"), *numbers("found"), *verdicts("verdict")]
    tables = []
    for kind in Kind:
        rows = [_statement(finding) for finding in findings if finding.claim.kind is kind]
        title = "claims under them" if kind is Kind.CLAIM else kind.value
        if rows:
            tables.append(table(title, columns, rows, legend=LEGEND))
    return tables


def _statement(finding: ClaimFinding) -> list[str]:
    """The row of one claim."""
    claim = finding.claim
    statement = claim.statement
    if finding.needs:
        statement += f" (with {finding.needs})"
    verdict = finding.verdict.value
    if turning_reasons(finding):
        verdict += " *"
    return [
        claim.id,
        f"{statement}: {claim.criterion} [{claim.source}]",
        f"{number_of(finding.representative)} ({criterion_text(claim)})",
        verdict,
    ]


def story_of(finding: ClaimFinding) -> dict[str, str]:
    """Return the story of one claim: titles and texts."""
    claim = finding.claim
    story = {
        "statement": claim.statement,
        "source": claim.source,
        "in words": claim.quote and f'"{claim.quote}"',
        "equation": claim.equation,
        "criterion": claim.criterion,
        "why so": claim.why,
        "meant": claim.quantifier,
        "it needs": finding.needs,
        "it is": finding.turns,
        "turns": "; ".join(turning_reasons(finding)),
        "cause": claim.cause,
        "because": finding.because and f"a premise failed: {finding.because}",
        "expected": claim.reason,
        "not tested": claim.untested,
    }
    return {title: words for title, words in story.items() if words}


def claim_tables(finding: ClaimFinding) -> list[Table]:
    """Return the story of one claim, and its values on each plant at T and at half of it."""
    story = story_of(finding)
    if "equation" in story:
        story["equation"] = in_text(story["equation"])
    columns = [*words(finding.claim.id), *text(finding.verdict.value.upper())]

    rows = [
        _evidence(plant, on_plant, finding.claim.unit) for plant, on_plant in finding.plants.items()
    ]
    return [table("", columns, story.items()), table("", EVIDENCE, rows)]


def _evidence(plant: PlantName, on_plant: PlantFinding, unit: str) -> list[str]:
    """The row of one plant."""
    suffix = unit_after(unit)
    refined = "exact"
    if on_plant.refined is not None:
        refined = number_of(on_plant.refined) + suffix
    return [
        plant,
        number_of(on_plant.measured) + suffix,
        refined,
        on_plant.verdict.value,
        on_plant.measured.note,
    ]


def claims_tables(findings: Sequence[ClaimFinding]) -> list[Table]:
    """Return all tables of claims, the briefest first."""
    return [
        counts_table(findings),
        causes_table(findings),
        sentences_table(findings),
        *statements_tables(findings),
    ]


def turning_table(sweeps: Iterable[Mapping[str, Any]]) -> Table:
    """Return where claims change their answer, choices that are not printed first.

    Args:
        sweeps: Rows that ``sweep`` yields.
    """
    rows = []
    for row in sorted(sweeps, key=lambda row: row["printed"]):
        if row["flips"]:
            choice = row["choice"]
            if row["printed"]:
                choice += " (printed)"
            rows.append([row["claim"], choice, row["flips"]])
    return table("What the claims turn on", [*words("claim", "choice"), *text("flips")], rows)
