"""The ledger for people, at most 100 columns wide."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from rich.text import Text

from grosmc_mj.assumptions.audit import Audit, Reading
from grosmc_mj.chapter.claims.claim import (
    Claim,
    Finding,
    Kind,
    Measured,
    Verdict,
    sentences_of,
)
from grosmc_mj.chapter.claims.self_test import Caught
from grosmc_mj.chapter.claims.sweep import Swept, flips_of
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.results.formulas import in_text
from grosmc_mj.results.palette import VERDICT_COLOURS
from grosmc_mj.results.tables import WIDTH, Table, numbers, table, text, verdicts, words

_SIGNS = {"at most": "<=", "at least": ">="}


def word(verdict: Verdict) -> Text:
    """A verdict in words and colour."""
    return Text(verdict.value.upper(), style=f"bold {VERDICT_COLOURS[verdict.value]}")


def shown(measured: Measured) -> str:
    """A value, or that there is none."""
    return "none" if measured.value is None else f"{measured.value:.3g}"


def decisive(finding: Finding) -> Measured:
    """What was measured on the plant that decides.

    Of a claim that is meant for some of its choices, or holds for none, it is what comes nearest
    to what is needed; of one that holds for every one of them the worst.
    """
    claim, measured = finding.claim, finding.decisive.measured
    tried = [each for each in (measured, *finding.trials.values()) if each.value is not None]
    if not finding.trials or finding.verdict is Verdict.UNDETERMINED or not tried:
        return measured
    worst = bool(claim.every) and finding.verdict is Verdict.SUPPORTED
    least = (claim.sense == "at most") is not worst
    return (min if least else max)(tried, key=lambda each: each.value or 0.0)


def sentences_table(findings: Sequence[Finding]) -> Table:
    """Each sentence of the chapter with its verdict and the claims under it."""
    return table(
        Kind.CLAIM.plural,
        [*text("sentence"), *text("claims under it"), *verdicts("verdict")],
        [
            (
                sentence.quote,
                ", ".join(finding.claim.id for finding in sentence.findings),
                sentence.verdict.value.upper(),
            )
            for sentence in sentences_of(findings)
        ],
    )


def ledger_tables(findings: Sequence[Finding]) -> Iterator[Table]:
    """One table for each kind: each claim with its value on the plant that decides."""
    for kind in Kind:
        own = [finding for finding in findings if finding.claim.kind is kind]
        if not own:
            continue
        yield table(
            "claims under them" if kind is Kind.CLAIM else kind.plural,
            [*words("claim"), *text("statement"), *numbers("found"), *verdicts("verdict")],
            [
                (
                    finding.claim.id,
                    finding.claim.statement + (f" (with {finding.needs})" if finding.needs else ""),
                    f"{shown(decisive(finding))} {_criterion(finding.claim)}",
                    finding.verdict.value.upper() + (" *" if turning(finding) else ""),
                )
                for finding in own
            ],
        )


def _criterion(claim: Claim) -> str:
    """The threshold, in few characters."""
    unit = "" if claim.unit in ("1", "unit of s/s") else claim.unit
    return f"({_SIGNS[claim.sense]} {claim.threshold:g}{' ' if unit else ''}{unit})"


LEGEND = (
    "* turns within 50 % of its threshold or with one of its choices. In brackets: what the "
    "statement needs. Values are on the plant that decides: physics or, where it cannot be asked, "
    "the printed or the corrected equations; --explain CLAIM tells the rest."
)


def turning(finding: Finding) -> list[str]:
    """What the verdict turns on: its threshold, and what is not printed and turns the record."""
    said = ["within 50 % of its threshold"] if finding.near else []
    flips = [where for choice, where in flips_of(finding.claim) if not choice.printed]
    return [*said, *(f"flips {where}" for where in flips)]


def story(finding: Finding, lab: Laboratory) -> Iterator[Text]:
    """The whole story of one claim, line by line."""
    claim = finding.claim
    yield Text.assemble((claim.id, "bold"), "  ", word(finding.verdict))
    yield from _paragraph("statement", claim.statement)
    yield from _paragraph("source", claim.source)
    if claim.quote:
        yield from _paragraph("in words", f'"{claim.quote}"')
    if claim.equation:
        yield from _paragraph("equation", in_text(claim.equation))
    yield from _paragraph("criterion", claim.criterion)
    yield from _paragraph("why so", claim.why)
    yield from _paragraph("meant", claim.quantifier)
    T = lab.settings.control_period
    for plant, found in finding.plants.items():
        value = (
            f"{shown(found.measured)} {claim.unit}" if claim.unit != "1" else shown(found.measured)
        )
        if found.refined is None:
            evidence = "no time step enters"
        else:
            where = "" if found.finer == plant else ", on the equations"
            evidence = f"{shown(found.refined)} at T/2 (T = {1e3 * T:g} ms){where}"
        line = Text(f"  {plant:<12}").append_text(word(found.verdict))
        yield line.append(f"  {value}, {evidence}")
        if found.measured.note:
            yield from _paragraph("", found.measured.note)
    if finding.needs:
        yield from _paragraph("it needs", finding.needs)
    if finding.turns:
        yield from _paragraph("it turns", finding.turns)
    for each in turning(finding):
        yield from _paragraph("turns", each)
    if claim.cause:
        yield from _paragraph("cause", claim.cause)
    if finding.because:
        yield from _paragraph("because", f"a premise failed: {finding.because}")
    yield from _paragraph("not tested", claim.untested or "nothing that the claim speaks of")
    yield from _paragraph("expected", claim.reason)


def _paragraph(title: str, text: str) -> Iterator[Text]:
    """A titled paragraph within the width."""
    lines = textwrap.wrap(text, WIDTH - 14, break_long_words=False) or [""]
    yield Text(f"  {title:<12}", style="dim").append(lines[0], style="default")
    for line in lines[1:]:
        yield Text(" " * 14 + line)


def audit_table(audit: Audit) -> Table:
    """The premises of one law in one case."""
    rows = []
    for premise in audit.premises:
        said = [f"{premise.requirement} [{premise.source}]"]
        said += [premise.note] if premise.note else []
        said += [f"restored by {premise.restores}"] if premise.restores else []
        margins = (_margin(each, premise.unit) for each in (premise.region, premise.along))
        holds = "holds" if premise.holds else "FAILS"
        rows.append((premise.name, *margins, holds, "; ".join(said)))
    return table(
        f"{audit.case.system}, {audit.case.name}, {audit.controller}: {audit.case.title}",
        [
            *words("premise"), *numbers("region", "along run"), *verdicts(),
            *text("what is required, and what was found"),
        ],
        rows,
    )  # fmt: skip


def _margin(reading: Reading | None, unit: str) -> str:
    """The least margin, and how often it is violated."""
    if reading is None:
        return ""
    text = f"{reading.margin:.3g}" + (f" {unit}" if unit != "1" else "")
    return text + (f"\n({100 * reading.violated:.0f} % violated)" if reading.violated else "")


def worst_points(audit: Audit) -> Iterator[str]:
    """Where the premises that fail are worst."""
    for premise in audit.failed():
        for where, reading in (("region", premise.region), ("run", premise.along)):
            if reading is not None and reading.margin < 0 and reading.worst.x:
                x = ", ".join(f"{value:.3g}" for value in reading.worst.x)
                yield (
                    f"{premise.name}: worst in the {where} at t = {reading.worst.t:.3g} s, "
                    f"x = [{x}]"
                )


def caught_table(found: Sequence[Caught]) -> Table:
    """Which claims noticed each fault."""
    return table(
        "What the claims noticed",
        [*words("fault"), *numbers("noticed by"), *text("claims")],
        [
            (each.fault.name, f"{len(each.claims)} of {each.tried}", ", ".join(each.claims))
            for each in found
        ],
    )


def sweep_table(found: Sequence[Swept]) -> Table:
    """Where claims change their answer, those that turn on what is not printed first."""
    turning = sorted((each for each in found if each.flips), key=lambda each: each.printed)
    return table(
        "What the claims turn on",
        [*words("claim", "choice"), *text("flips")],
        [
            (each.claim, each.choice + (" (printed)" if each.printed else ""), each.flips)
            for each in turning
        ],
    )
