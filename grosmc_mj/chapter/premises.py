"""The premises of the theorems in each case: tables, and premises_SYSTEM.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.experiments.assumptions.audit import Audit, Premise, Reading
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.wording import counted, counted_of, plural, unit_after
from grosmc_mj.output.results.document import plain
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    Answer,
    CellChart,
    ReportTable,
    Result,
    Value,
    result,
)
from grosmc_mj.output.results.tables import (
    Column,
    Table,
    number,
    numbers,
    table,
    text,
    verdicts,
    words,
)


def premises_result(audits: Sequence[Audit], settings: Settings) -> Result:
    """Return the premises of a law in each case of a system."""
    values = []
    cells = {}
    for audit in audits:
        case = audit.case.name
        law = f"{audit.case.system}/{case} {audit.controller}"
        for premise in audit.premises:
            values += _values(f"{law}: {premise.name}", premise)
            cells[f"{case}, {audit.controller}", premise.name] = _cell(premise)

    chart = CellChart.of("premises", cells, 2.0)
    sheets = [ReportTable(table=failures_table(audits), charts=[chart], brief=True)]
    sheets += [ReportTable(table=audit_table(audit)) for audit in audits]
    return result(
        "premises",
        asdict(settings),
        answers=[_answer(audits)],
        values=values,
        sheets=sheets,
        premises=[audit_document(audit) for audit in audits],
    )


def _values(name: str, premise: Premise) -> Iterator[Value]:
    """Verdict and margins of a premise."""
    yield Value(name=name, value="holds" if premise.holds else "fails")
    for where, reading in _readings(premise):
        yield Value(
            name=f"{name}, margin {where}",
            value=plain(reading.margin),
            unit=premise.unit,
            better=1,
            relative=0.1,
        )


def _cell(premise: Premise) -> tuple[float, str, str]:
    """Cell of the chart of all premises: its number, its text and the text on hovering."""
    details = _restored(premise) or premise.requirement
    if premise.holds:
        return -1.0, "✓", details
    return 1.0, f"✗ {number(_worst(premise).margin)}", details


def _answer(audits: Sequence[Audit]) -> Answer:
    """The number of premises that fail, over all cases."""
    law = audits[0].controller
    failed = sum(len(audit.failed()) for audit in audits)
    total = sum(len(audit.premises) for audit in audits)

    verdict = KEPT
    sentence = f"All {counted(total, 'premise')} of {law} hold"
    if failed:
        verdict = NOT_KEPT
        verb = plural(failed, "fails", "fail")
        sentence = f"{counted_of(failed, total, 'premise')} of {law} {verb}"
    points = [f"{audit.case.name}: {line}" for audit in audits for line in worst_points(audit)]
    return Answer(
        question=f"Premises of {law} on {audits[0].case.system}",
        verdict=verdict,
        words=sentence,
        faults=points,
    )


def audit_document(audit: Audit) -> dict[str, Any]:
    """Return the premises of one law in one case as plain values."""
    return {
        "system": audit.case.system,
        "case": audit.case.name,
        "controller": audit.controller,
        "premises": [_premise_document(premise) for premise in audit.premises],
    }


def _premise_document(premise: Premise) -> dict[str, Any]:
    return {
        "name": premise.name,
        "source": premise.source,
        "requirement": premise.requirement,
        "unit": premise.unit,
        "holds": premise.holds,
        "region": _reading_document(premise.region),
        "along_run": _reading_document(premise.along),
        "restored_by": premise.restores,
        "note": premise.note,
    }


def _reading_document(reading: Reading | None) -> dict[str, Any] | None:
    if reading is None:
        return None
    return {
        "margin": reading.margin,
        "violated": reading.violated,
        "worst": {"t": reading.t, "x": list(reading.x)},
    }


def _readings(premise: Premise) -> list[tuple[str, Reading]]:
    """The readings that the premise has, each after the words for where it was taken."""
    readings = []
    if premise.region is not None:
        readings.append(("in the region", premise.region))
    if premise.along is not None:
        readings.append(("in the run", premise.along))
    return readings


def _worst(premise: Premise) -> Reading:
    """The reading with the least margin."""
    readings = [reading for _, reading in _readings(premise)]
    return min(readings, key=lambda reading: reading.margin)


def _restored(premise: Premise) -> str:
    """The gain that restores a premise, in words; empty if there is none."""
    if not premise.restores:
        return ""
    return f"restored by {premise.restores}"


def audit_table(audit: Audit) -> Table:
    """Return the table of the premises of one law in one case."""
    columns = [
        *words("premise"),
        *numbers("region", "along run"),
        *verdicts(),
        *text("what is required, and what was found"),
    ]
    return table(
        f"{audit.case.system}, {audit.case.name}, {audit.controller}: {audit.case.title}",
        columns,
        [_audit_row(premise) for premise in audit.premises],
        legend="\n".join(worst_points(audit)),
    )


def _audit_row(premise: Premise) -> tuple[str, ...]:
    details = [
        f"{premise.requirement} [{premise.source}]",
        premise.note,
        _restored(premise),
    ]
    return (
        premise.name,
        _margin(premise.region, premise.unit),
        _margin(premise.along, premise.unit),
        "holds" if premise.holds else "FAILS",
        "; ".join(filter(None, details)),
    )


def failures_table(audits: Sequence[Audit]) -> Table:
    """Return the table of the premises that fail, the largest shortfall first."""
    failed = [(audit.case.name, premise) for audit in audits for premise in audit.failed()]
    failed.sort(key=lambda case_and_premise: _worst(case_and_premise[1]).margin)

    rows = []
    for case, premise in failed:
        margin = _margin(_worst(premise), premise.unit)
        rows.append((case, premise.name, margin, premise.restores))

    columns = [
        *words("case", "FAILS"),
        *numbers("least margin"),
        Column(header="restored by", width=45),
    ]
    return table(
        "Premises of the theorems",
        columns,
        rows,
        legend="Margins are positive where a premise holds, in the declared region and the run.",
    )


def _margin(reading: Reading | None, unit: str) -> str:
    """The least margin, and the share of points that violate the premise."""
    if reading is None:
        return ""

    margin = f"{reading.margin:.3g}{unit_after(unit)}"
    if reading.violated:
        margin += f" ({100 * reading.violated:.0f} %)"
    return margin


def worst_points(audit: Audit) -> Iterator[str]:
    """Yield a line for each place where a premise that fails is worst."""
    for premise in audit.failed():
        for where, reading in _readings(premise):
            if reading.margin < 0 and reading.x:
                x = ", ".join(f"{value:.3g}" for value in reading.x)
                point = f"t = {reading.t:.3g} s, x = [{x}]"
                yield f"{premise.name}: worst {where} at {point}"
