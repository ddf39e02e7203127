"""The premises of the theorems in each case: tables, and premises_SYSTEM.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.assumptions.audit import Audit, Premise, Reading
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.results.document import plain
from grosmc_mj.results.result import KEPT, NOT_KEPT, Answer, CellChart, Sheet, Value, result
from grosmc_mj.results.tables import Column, Table, number, numbers, table, text, verdicts, words


def premises_result(audits: Sequence[Audit], settings: Settings) -> dict[str, Any]:
    """The content of premises_SYSTEM.json."""
    values, cells = [], {}
    for audit in audits:
        for premise in audit.premises:
            name = f"{audit.case.system}/{audit.case.name} {audit.controller}: {premise.name}"
            values.append(Value(name=name, value="holds" if premise.holds else "fails"))
            values += [
                Value(name=f"{name}, margin {where}", value=plain(reading.margin),
                      unit=premise.unit,
                      better=1, relative=0.1)
                for where, reading in _readings(premise)
            ]  # fmt: skip
            cell = "✓" if premise.holds else f"✗ {number(_worst(premise).margin)}"
            key = (f"{audit.case.name}, {audit.controller}", premise.name)
            why = premise.restores and f"restored by {premise.restores}"
            cells[key] = (-1.0 if premise.holds else 1.0, cell, why or premise.requirement)
    failing = any(audit.failed() for audit in audits)
    answer = Answer(
        question=f"Premises of {audits[0].controller} on {audits[0].case.system}",
        verdict=NOT_KEPT if failing else KEPT,
        words=premises_words(audits),
    )
    return result(
        "premises", asdict(settings), answers=[answer], values=values,
        sheets=[
            Sheet(table=failures_table(audits), charts=[CellChart.of("premises", cells, 2.0)]),
            *(Sheet(table=audit_table(audit)) for audit in audits),
        ],
        premises=[audit_document(audit) for audit in audits],
    )  # fmt: skip


def premises_words(audits: Sequence[Audit]) -> str:
    """How many premises hold, in a sentence."""
    failed = sum(len(audit.failed()) for audit in audits)
    premises, law = sum(len(audit.premises) for audit in audits), audits[0].controller
    if failed:
        return f"{failed} of {premises} premises of {law} fail"
    return f"All {premises} premises of {law} hold"


def audit_document(audit: Audit) -> dict[str, Any]:
    """The premises of one law in one case, as plain values."""
    return {
        "system": audit.case.system,
        "case": audit.case.name,
        "controller": audit.controller,
        "premises": [
            {
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
            for premise in audit.premises
        ],
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


def _readings(premise: Premise) -> list[tuple[str, Reading]]:
    both = (("in the region", premise.region), ("in the run", premise.along))
    return [(where, reading) for where, reading in both if reading is not None]


def _worst(premise: Premise) -> Reading:
    return min((reading for _, reading in _readings(premise)), key=lambda each: each.margin)


def audit_table(audit: Audit) -> Table:
    """The premises of one law in one case."""
    rows = []
    for premise in audit.premises:
        story = [f"{premise.requirement} [{premise.source}]"]
        story += [premise.note] if premise.note else []
        story += [f"restored by {premise.restores}"] if premise.restores else []
        margins = (_margin(each, premise.unit) for each in (premise.region, premise.along))
        holds = "holds" if premise.holds else "FAILS"
        rows.append((premise.name, *margins, holds, "; ".join(story)))
    return table(
        f"{audit.case.system}, {audit.case.name}, {audit.controller}: {audit.case.title}",
        [
            *words("premise"), *numbers("region", "along run"), *verdicts(),
            *text("what is required, and what was found"),
        ],
        rows,
    )  # fmt: skip


def failures_table(audits: Sequence[Audit]) -> Table:
    """The premises that fail, a line each, the largest shortfall first."""
    failed = [(audit, premise) for audit in audits for premise in audit.failed()]
    rows = [
        (audit.case.name, premise.name, _margin(_worst(premise), premise.unit), premise.restores)
        for audit, premise in sorted(failed, key=lambda each: _worst(each[1]).margin)
    ]
    columns = [*words("case", "FAILS"), *numbers("least margin")]
    return table(
        "Premises of the theorems",
        [*columns, Column(header="restored by", width=45)],
        rows,
        legend="Margins are positive where a premise holds, in the declared region and the run.",
    )


def _margin(reading: Reading | None, unit: str) -> str:
    """The least margin, and how often it is violated."""
    if reading is None:
        return ""
    margin = f"{reading.margin:.3g}" + (f" {unit}" if unit != "1" else "")
    return margin + (f" ({100 * reading.violated:.0f} %)" if reading.violated else "")


def worst_points(audit: Audit) -> Iterator[str]:
    """Where the premises that fail are worst."""
    for premise in audit.failed():
        for where, reading in _readings(premise):
            if reading.margin < 0 and reading.worst.x:
                x = ", ".join(f"{value:.3g}" for value in reading.worst.x)
                at = f"t = {reading.worst.t:.3g} s, x = [{x}]"
                yield f"{premise.name}: worst {where} at {at}"
