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
    values, cells, law = list[Value](), {}, audits[0].controller
    for audit in audits:
        for premise in audit.premises:
            name = f"{audit.case.system}/{audit.case.name} {audit.controller}: {premise.name}"
            values.append(Value(name=name, value="holds" if premise.holds else "fails"))
            values += [
                Value(name=f"{name}, margin {where}", value=plain(reading.margin),
                      unit=premise.unit, better=1, relative=0.1)
                for where, reading in _readings(premise)
            ]  # fmt: skip
            cell = "✓" if premise.holds else f"✗ {number(_worst(premise).margin)}"
            why = premise.restores and f"restored by {premise.restores}"
            cells[f"{audit.case.name}, {audit.controller}", premise.name] = (
                -1.0 if premise.holds else 1.0, cell, why or premise.requirement
            )  # fmt: skip
    failed = sum(len(audit.failed()) for audit in audits)
    all_of_them = sum(len(audit.premises) for audit in audits)
    answer = Answer(
        question=f"Premises of {law} on {audits[0].case.system}",
        verdict=NOT_KEPT if failed else KEPT,
        words=f"{failed} of {all_of_them} premises of {law} fail"
        if failed
        else f"All {all_of_them} premises of {law} hold",
    )
    return result(
        "premises", asdict(settings), answers=[answer], values=values,
        sheets=[
            Sheet(table=failures_table(audits), charts=[CellChart.of("premises", cells, 2.0)]),
            *(Sheet(table=audit_table(audit)) for audit in audits),
        ],
        premises=[audit_document(audit) for audit in audits],
    )  # fmt: skip


def audit_document(audit: Audit) -> dict[str, Any]:
    """The premises of one law in one case, as plain values."""
    premises = []
    for premise in audit.premises:
        own = {
            where: {
                "margin": at.margin,
                "violated": at.violated,
                "worst": {"t": at.worst.t, "x": list(at.worst.x)},
            }
            for where, at in _readings(premise)
        }
        premises.append(
            {
                "name": premise.name,
                "source": premise.source,
                "requirement": premise.requirement,
                "unit": premise.unit,
                "holds": premise.holds,
                "region": own.get("in the region"),
                "along_run": own.get("in the run"),
                "restored_by": premise.restores,
                "note": premise.note,
            }
        )
    return {
        "system": audit.case.system,
        "case": audit.case.name,
        "controller": audit.controller,
        "premises": premises,
    }


def _readings(premise: Premise) -> list[tuple[str, Reading]]:
    both = (("in the region", premise.region), ("in the run", premise.along))
    return [(where, reading) for where, reading in both if reading is not None]


def _worst(premise: Premise) -> Reading:
    return min((reading for _, reading in _readings(premise)), key=lambda at: at.margin)


def audit_table(audit: Audit) -> Table:
    """The premises of one law in one case."""
    rows = []
    for premise in audit.premises:
        restored = premise.restores and f"restored by {premise.restores}"
        story = [f"{premise.requirement} [{premise.source}]", premise.note, restored]
        margins = (_margin(at, premise.unit) for at in (premise.region, premise.along))
        holds = "holds" if premise.holds else "FAILS"
        rows.append((premise.name, *margins, holds, "; ".join(filter(None, story))))
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
    failed = [(audit.case.name, premise) for audit in audits for premise in audit.failed()]
    rows = [
        (case, premise.name, _margin(_worst(premise), premise.unit), premise.restores)
        for case, premise in sorted(failed, key=lambda own: _worst(own[1]).margin)
    ]
    return table(
        "Premises of the theorems",
        [
            *words("case", "FAILS"), *numbers("least margin"),
            Column(header="restored by", width=45),
        ],
        rows,
        legend="Margins are positive where a premise holds, in the declared region and the run.",
    )  # fmt: skip


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
