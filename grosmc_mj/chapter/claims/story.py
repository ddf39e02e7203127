"""The tables and stories of claims, for the terminal, Markdown and the page alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from grosmc_mj.chapter.claims.claim import (
    RULE,
    Claim,
    Finding,
    Kind,
    Measured,
    Verdict,
    sentences_of,
    verdicts_of,
)
from grosmc_mj.chapter.claims.sweep import stored_flips
from grosmc_mj.results.formulas import in_text
from grosmc_mj.results.tables import Column, Table, numbers, table, text, verdicts, words

LEGEND = (
    "* turns within 50 % of its threshold or with a choice that is not printed. In brackets: the "
    "choice that the statement needs. Values are on the plant that decides."
)
EVIDENCE = [
    *words("plant"), *numbers("at T", "at T/2"), *verdicts("verdict"), *text("note")
]  # fmt: skip


def number_of(measured: Measured | None) -> str:
    """A value, or that there is none."""
    return "none" if measured is None or measured.value is None else f"{measured.value:.3g}"


def needed(claim: Claim) -> str:
    """The criterion in few characters."""
    unit = "" if claim.unit in ("1", "unit of s/s") else f" {claim.unit}"
    return f"{'≤' if claim.sense == 'at most' else '≥'} {claim.threshold:g}{unit}"


def is_told(finding: Finding) -> bool:
    """Whether the page tells a claim's story: an equation or a proof, or one without support."""
    has_story = finding.claim.kind in (Kind.MISPRINT, Kind.PROOF)
    return has_story or finding.verdict is not Verdict.SUPPORTED


def turning(finding: Finding) -> list[str]:
    """What the verdict turns on: its threshold, and what is not printed and turns the record."""
    flips = stored_flips(finding.claim.id)
    own = [choice.name for choice in finding.claim.choices if not choice.printed]
    near = ["within 50 % of its threshold"] if finding.near else []
    return [*near, *(f"flips {flips[name]}" for name in own if name in flips)]


def counts_table(findings: Sequence[Finding]) -> Table:
    """How many sentences and statements have which verdict."""
    rows = [
        (kind.value, *(str(own.count(verdict)) for verdict in Verdict), str(len(own)))
        for kind in Kind
        if (own := verdicts_of(findings, kind))
    ]
    headers = (*(verdict.value for verdict in Verdict), "all")
    return table("Verdicts of physics", [*words(""), *numbers(*headers)], rows)


def causes_table(findings: Sequence[Finding]) -> Table:
    """Why claims are not supported, the cause of most of them first."""
    causes: dict[str, list[str]] = {}
    for finding in findings:
        if finding.verdict is not Verdict.SUPPORTED:
            causes.setdefault(finding.claim.cause, []).append(finding.claim.id)
    rows = [(cause, ", ".join(ids), str(len(ids))) for cause, ids in causes.items()]
    columns = [
        Column(header="not supported since", width=50, cut=True),
        Column(header="statements", width=42, cut=True),
        *numbers(""),
    ]
    return table("", columns, sorted(rows, key=lambda row: -int(row[2])))


def sentences_table(findings: Sequence[Finding]) -> Table:
    """Each sentence of the chapter with its verdict and the claims under it."""
    rows = [
        (
            sentence.quote,
            "; ".join(f"{under.claim.id}: {under.verdict.value}" for under in sentence.findings),
            sentence.verdict.value,
        )
        for sentence in sentences_of(findings)
    ]
    columns = [*text("sentence"), *text("claims under it"), *verdicts("verdict")]
    return table(Kind.CLAIM.value, columns, rows, legend=RULE)


def statements_tables(findings: Sequence[Finding]) -> list[Table]:
    """For each kind its statements, with the value on the plant that decides."""
    columns = [*words("claim"), *text("statement"), *numbers("found"), *verdicts("verdict")]
    rows: dict[Kind, list[tuple[str, ...]]] = {kind: [] for kind in Kind}
    for finding in findings:
        claim, needs = finding.claim, f" (with {finding.needs})" if finding.needs else ""
        rows[claim.kind].append(
            (
                claim.id,
                f"{claim.statement}{needs}: {claim.criterion} [{claim.source}]",
                f"{number_of(finding.shown)} ({needed(claim)})",
                finding.verdict.value + (" *" if turning(finding) else ""),
            )
        )
    titles = {kind: kind.value for kind in Kind} | {Kind.CLAIM: "claims under them"}
    return [table(titles[k], columns, own, legend=LEGEND) for k, own in rows.items() if own]


def facts(finding: Finding) -> dict[str, str]:
    """The story of one claim: a title and a text each."""
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
        "turns": "; ".join(turning(finding)),
        "cause": claim.cause,
        "because": finding.because and f"a premise failed: {finding.because}",
        "expected": claim.reason,
        "not tested": claim.untested,
    }
    return {title: words for title, words in story.items() if words}


def claim_tables(finding: Finding) -> list[Table]:
    """The story of one claim; and its values on each plant, at T and at half of it."""
    story = facts(finding)
    if "equation" in story:
        story["equation"] = in_text(story["equation"])
    end = "" if finding.claim.unit == "1" else f" {finding.claim.unit}"
    rows = [
        (
            plant,
            number_of(on_plant.measured) + end,
            "exact" if on_plant.refined is None else number_of(on_plant.refined) + end,
            on_plant.verdict.value,
            on_plant.measured.note,
        )
        for plant, on_plant in finding.plants.items()
    ]
    columns = [*words(finding.claim.id), *text(finding.verdict.value.upper())]
    return [table("", columns, story.items()), table("", EVIDENCE, rows)]


def claims_tables(findings: Sequence[Finding]) -> list[Table]:
    """All tables of claims, the briefest first."""
    brief = [counts_table(findings), causes_table(findings)]
    return [*brief, sentences_table(findings), *statements_tables(findings)]


def turning_table(sweeps: Iterable[Mapping[str, Any]]) -> Table:
    """Where claims change their answer, those that turn on what is not printed first.

    Args:
        sweeps: As ``sweep`` yields them.
    """
    rows = [
        (row["claim"], row["choice"] + (" (printed)" if row["printed"] else ""), row["flips"])
        for row in sorted(sweeps, key=lambda row: row["printed"])
        if row["flips"]
    ]
    return table("What the claims turn on", [*words("claim", "choice"), *text("flips")], rows)
