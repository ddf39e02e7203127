"""Answer of a ladder: words, tables, charts and document."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.measured import MEASURED
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    CellChart,
    ReportTable,
    Result,
    StudyVerdict,
    Value,
    finite,
    result,
)
from grosmc_mj.output.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.ladder.ladder import Ladder
from grosmc_mj.studies.ladder.row import ENDED, RungResult, fallen, first_failed, ways
from grosmc_mj.studies.matrix import (
    Cell,
    charts_by_condition,
    conditions_document,
    law_document,
    verdict_chart,
    verdict_table,
)
from grosmc_mj.studies.target import Condition

STANDS = "stands"
LEGEND = (
    "How much of the tightest limit is used; above 1 it is not kept. ended: the run ended early; "
    "never: it does not settle; 7 of 10: kept in so many draws; ?: an assumed number decides; "
    "-: there is no such law."
)
CLAIMS = "Rung on which each claim fails"
_TITLES = {
    True: "Rungs added one by one",
    False: "Each alone on the sampled plant",
}


def verdict(studied: Ladder, rows: Sequence[RungResult], condition: str) -> str:
    """Return one sentence: how many laws pass, and which rungs break most of them."""
    climbed = ways(rows, condition).values()
    top = studied.climbing[-1].name
    complete = 0
    every = 0
    broken_by = Counter[str]()
    for rungs in climbed:
        failed = first_failed(rungs)
        last = rungs[-1]
        if failed is not None:
            broken_by[failed.rung] += 1
        if last.rung == top and last.kept:
            complete += 1
            every += failed is None

    answer = f"{every} of {len(climbed)} laws pass every rung, {complete} the complete machine"
    breaks = ", ".join(f"{rung} breaks {count}" for rung, count in broken_by.most_common(3))
    if breaks:
        answer += f"; {breaks}"
    under_it = [row for row in rows if row.condition == condition]
    return f"{answer}.{_agreement(under_it, top)}"


def _agreement(rows: Iterable[RungResult], top: str) -> str:
    """Return how often the model's verdict on the complete machine is that of the measured one."""
    modelled = {}
    measured = {}
    for row in rows:
        if row.together and row.rung == top:
            modelled[row.law] = row.kept
        if row.rung == MEASURED:
            measured[row.law] = row.kept
    if not measured:
        return ""
    agree = sum(modelled.get(law) == kept for law, kept in measured.items())
    return f" The measured machine agrees with the model on {agree} of {len(measured)} laws."


def answer_table(studied: Ladder, rows: Sequence[RungResult], condition: Condition) -> Table:
    """Return which laws pass every rung and the complete machine, and where each breaks first."""
    climbed = ways(rows, condition.name)
    top = studied.climbing[-1].name
    ordered = sorted(climbed, key=lambda law: _height(climbed[law]), reverse=True)
    output, input_unit = studied.units
    columns = [
        *names("law"),
        *words("passes\nevery rung", "passes the\ncomplete\nmachine"),
        *text("breaks first at"),
        *numbers(f"swings by\n[{output}]", "at\n[Hz]", f"variation\n[{input_unit}/s]"),
    ]
    return table(condition.title, columns, [_answer_row(law, climbed[law], top) for law in ordered])


def _height(rungs: Sequence[RungResult]) -> int:
    """Number of rungs below the first that is not kept."""
    failed = first_failed(rungs)
    if failed is None:
        return len(rungs)
    return rungs.index(failed)


def _answer_row(law: str, rungs: Sequence[RungResult], top: str) -> list[str]:
    """The row of one law, with the swings on the rung where it breaks or on its last."""
    failed = first_failed(rungs)
    last = rungs[-1]
    every = ""
    machine = ""
    if last.rung == top:
        every = "yes"
        machine = f"{'yes' if last.kept else 'no'} ({last.cell})"

    breaks = ""
    measured = last
    if failed is not None:
        every = "no"
        breaks = f"{failed.rung}: {failed.reason}"
        measured = failed
    values = (measured.amplitude, measured.frequency, measured.variation)
    swings = ["" if value is None else number(value) for value in values]
    return [law, every, machine, breaks, *swings]


def cell_of(row: RungResult) -> Cell:
    """Return the cell of a row in the matrix of laws and rungs."""
    verdict = "failed"
    broken = row.tightest
    words = row.reason
    if row.impossible:
        verdict = ""
    elif row.kept:
        verdict = "kept"
        broken = ""
        words = f"{row.share_text} of the limit"
    elif row.partly:
        verdict = "partly"

    marks = []
    if row.partly:
        marks.append(f"{row.kept_draws} of {row.draws}")
    if row.hangs_on:
        marks.append("?")
        words += f"; turned by {', '.join(row.hangs_on)}"
    return Cell(
        law=row.law,
        step=row.rung,
        condition=row.condition,
        verdict=verdict,
        text=row.cell,
        broken=broken,
        mark=" ".join(marks),
        words=words,
    )


def share_table(
    studied: Ladder, rows: Sequence[RungResult], condition: str, *, together: bool
) -> Table:
    """Return laws by rungs: the share of the tightest limit that is used."""
    cells = [cell_of(row) for row in rows if (row.condition, row.together) == (condition, together)]
    return verdict_table(_TITLES[together], cells, _headings(studied, together=together))


def _headings(studied: Ladder, *, together: bool) -> dict[str, str]:
    """Headings of the rungs, by their names."""
    rungs = studied.climbing if together else studied.alone
    headings = {rung.name: rung.title for rung in rungs}
    if together and studied.machine.file.measured:
        headings[MEASURED] = MEASURED
    return headings


def load_table(studied: Ladder, rows: Sequence[RungResult]) -> Table:
    """Return laws by conditions: the share on the complete machine."""
    top = studied.climbing[-1].name
    loads = "; ".join(f"{load.name}: {load.title}" for load in studied.conditions[1:])
    title = f"The complete machine, nominally and under load ({loads})"
    at_the_top = [row for row in rows if row.together and row.rung == top]
    cells = [cell_of(row)._replace(step=row.condition) for row in at_the_top]
    headings = {condition.name: condition.name for condition in studied.conditions}
    return verdict_table(title, cells, headings)


def deviation_table(studied: Ladder, rows: Sequence[RungResult]) -> Table:
    """Return laws by rungs: the distance from the nominal optimum, of laws that follow it."""
    condition = studied.conditions[0].name
    laws = {law.name for law in studied.laws if law.controller.designed.follows_optimum}
    climbed = [row for row in rows if row.together and row.condition == condition]
    selected = [row for row in climbed if row.law in laws]

    unit, _ = studied.units
    scale = 1.0
    if unit in ("rad", "m"):
        unit = f"m{unit}"
        scale = 1e3
    title = f"Largest distance from the nominal optimum [{unit}], of the laws that follow it"
    cells = [cell_of(row)._replace(text=_deviation_text(row, scale)) for row in selected]
    return verdict_table(title, cells, {rung.name: rung.name for rung in studied.climbing})


def assumed_table(rows: Sequence[RungResult]) -> Table | None:
    """Return the assumed numbers that turn a verdict, with the change; None without any."""
    cells = []
    for row in rows:
        if row.hangs_on:
            verdict = "kept" if row.kept else "not kept"
            cells.append([row.law, row.rung, verdict, ", ".join(row.hangs_on)])
    if not cells:
        return None
    columns = [*names("law"), *words("rung", "verdict"), *text("turned by")]
    return table("Verdicts that an assumed number turns", columns, cells)


def _deviation_text(row: RungResult, scale: float) -> str:
    if row.deviation is not None:
        return number(row.deviation * scale)
    if row.tightest == ENDED:
        return "ended"
    return "-"


def claims_table(studied: Ladder, rows: Sequence[RungResult], condition: str) -> Table | None:
    """Return the rung on which each claim falls, for each law that it is about; None without."""
    climbed: dict[str, list[RungResult]] = {}
    claims: dict[str, None] = {}
    for law, rungs in ways(rows, condition).items():
        for row in rungs:
            if row.claims:
                climbed[law] = rungs
                claims |= dict.fromkeys(row.claims)
    if not claims:
        return None

    cells = [[law, *(_fate(rungs, claim) for claim in claims)] for law, rungs in climbed.items()]
    columns = words("law", *(f"`{claim}`" for claim in claims))
    legend = "; ".join(f"`{claim}`: {studied.statements.get(claim, '')}" for claim in claims)
    title = CLAIMS
    if condition != studied.conditions[0].name:
        title += f" ({condition})"
    return table(title, columns, cells, legend=f"{legend}.")


def _fate(rungs: Sequence[RungResult], claim: str) -> str:
    """The rung on which a claim falls, or that it stands; empty if it is not judged."""
    row = fallen(rungs, claim)
    if row is not None:
        return row.rung
    if any(claim in row.claims for row in rungs):
        return STANDS
    return ""


def assumed_text(studied: Ladder) -> str:
    """Return the numbers that nobody has published, by rung; empty if there are none."""
    assumed = [rung for rung in studied.climbing if rung.assumed]
    if not assumed:
        return ""
    words = ", ".join(f"{rung.name} ({'; '.join(rung.assumed)})" for rung in assumed)
    return f"* rests on numbers that are assumed: {words}."


def charts(studied: Ladder, rows: Sequence[RungResult]) -> dict[str, CellChart]:
    """Return the chart of each condition: laws by rungs, one added on top of the other."""
    cells = [cell_of(row) for row in rows if row.together]
    headings = _headings(studied, together=True)
    return charts_by_condition(studied.conditions, cells, headings, climbing=True)


def alone_chart(studied: Ladder, rows: Sequence[RungResult]) -> CellChart | None:
    """Return the chart of laws by rungs, each alone on the sampled plant; None without any."""
    cells = [cell_of(row) for row in rows if not row.together]
    if not cells:
        return None
    headings = _headings(studied, together=False)
    return verdict_chart(_TITLES[False], cells, headings, climbing=False)


def sheets(studied: Ladder, rows: Sequence[RungResult]) -> list[ReportTable]:
    """Return every table with its charts: answers and claims, shares, loads, distances."""
    parts: list[ReportTable] = []
    for condition in studied.conditions:
        if ways(rows, condition.name):
            answer = answer_table(studied, rows, condition)
            parts.append(ReportTable(table=answer, brief=True))
        claims = claims_table(studied, rows, condition.name)
        if claims is not None:
            parts.append(ReportTable(table=claims, brief=True))
    climbing = charts(studied, rows)
    alone = alone_chart(studied, rows)
    first, *loads = studied.conditions
    if first.name in climbing:
        shares = share_table(studied, rows, first.name, together=True)
        parts.append(ReportTable(table=shares, charts=[climbing[first.name]]))
    if alone is not None:
        shares = share_table(studied, rows, first.name, together=False)
        parts.append(ReportTable(table=shares, charts=[alone]))

    if loads:
        under_load = [climbing[load.name] for load in loads if load.name in climbing]
        parts.append(ReportTable(table=load_table(studied, rows), charts=under_load))

    parts.append(ReportTable(table=deviation_table(studied, rows)))
    assumed = assumed_table(rows)
    if assumed is not None:
        parts.append(ReportTable(table=assumed))
    return parts


def _standings(
    studied: Ladder, rows: Sequence[RungResult], *, complete: bool
) -> Iterator[StudyVerdict]:
    """Yield the first rung on which each law breaks, under the first condition."""
    condition = studied.conditions[0].name
    for law, rungs in ways(rows, condition).items():
        failed = first_failed(rungs)
        breaks_at = ""
        answer = "stands on every rung"
        if any(row.hangs_on for row in rungs):
            answer += ", but an assumed number turns it"
        if failed is not None:
            breaks_at = failed.rung
            answer = f"{failed.reason} ({condition})"
        elif not complete:
            answer += " so far"
        yield StudyVerdict(
            case=studied.target,
            law=law,
            breaks_at=breaks_at,
            words=answer,
            complete=complete or failed is not None,
        )


def _values(target: str, rows: Sequence[RungResult]) -> Iterator[Value]:
    for row in rows:
        if not row.impossible:
            how = "up to" if row.together else "alone"
            name = f"{target} {row.condition} {row.law}, {how} {row.rung}"
            yield Value(name=name, value="kept" if row.kept else "not kept")
            used = finite(row.share_of_the_tightest_limit)
            yield Value(name=f"{name}: share of the limit", value=used, better=-1, relative=0.1)


def ladder_result(studied: Ladder, rows: Sequence[RungResult], *, complete: bool) -> Result:
    """Return the result of a ladder.

    Args:
        studied: The target.
        rows: Finished rows.
        complete: Whether nothing was interrupted.
    """
    case = studied.machine
    return result(
        "ladder",
        studied.configuration(),
        seed=case.loop.seed if case.loop else None,
        complete=complete,
        answers=_answers(studied, rows, complete=complete),
        standings=_standings(studied, rows, complete=complete),
        sheets=sheets(studied, rows),
        remarks=filter(None, [assumed_text(studied)]),
        values=_values(studied.target, rows),
        target=studied.target,
        title=case.title,
        units=studied.units,
        conditions=conditions_document(studied.conditions),
        laws=[law_document(law) for law in studied.laws],
        climbing=[rung.document() for rung in studied.climbing],
        alone=[rung.document() for rung in studied.alone],
        claims=[_claim_document(studied, claim) for claim in studied.machine.file.claim],
        climbs=[row.model_dump() for row in rows],
    )


def _answers(studied: Ladder, rows: Sequence[RungResult], *, complete: bool) -> Iterator[Answer]:
    """Yield the verdict under each condition: whether all laws pass the complete machine."""
    top = studied.climbing[-1].name
    for condition in studied.conditions:
        climbed = ways(rows, condition.name)
        if not climbed:
            continue
        at_top = [rungs[-1] for rungs in climbed.values() if rungs[-1].rung == top]
        judgement = KEPT
        if not complete:
            judgement = OPEN
        # One failure decides, however many laws have not climbed yet.
        if (len(at_top) < len(climbed) and complete) or not all(row.kept for row in at_top):
            judgement = NOT_KEPT
        words = verdict(studied, rows, condition.name)
        if len(studied.conditions) > 1:
            words = f"{condition.name}: {words}"
        if not complete:
            words += " Interrupted: not complete."
        yield Answer(question=f"Ladder of {studied.target}", verdict=judgement, words=words)


def _claim_document(studied: Ladder, claim: ClaimTable) -> dict[str, Any]:
    return {
        "claim": claim.id,
        "statement": studied.statements.get(claim.id, ""),
        "under": claim.under,
        "of": list(claim.of or studied.machine.controllers),
    }
