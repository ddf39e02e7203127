"""Answer of a ladder: words, tables, charts and document."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any

from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.measured import MEASURED
from grosmc_mj.ground.wording import counted_of
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    CellChart,
    ReportTable,
    Result,
    result,
)
from grosmc_mj.output.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.output.results.verdicts import Verdict, first_failed, standings, values_of
from grosmc_mj.studies.ladder.climb import ALONE, UP_TO, climbs, fallen
from grosmc_mj.studies.ladder.ladder import Ladder
from grosmc_mj.studies.matrix import (
    charts_by_condition,
    conditions_document,
    law_document,
    verdict_chart,
    verdict_table,
)
from grosmc_mj.studies.target import Condition

STANDS = "stands"
_UNFINISHED = "not finished"
LEGEND = (
    "How much of the tightest limit is used; above 1 it is not kept. ended: the run ended early; "
    "never: it does not settle; 7 of 10: kept in so many draws; ?: an assumed number decides; "
    "-: there is no such law."
)
CLAIMS = "Rung on which each claim fails"
_TITLES = {
    UP_TO: "Rungs added one by one",
    ALONE: "Each alone on the sampled plant",
}


def verdict(studied: Ladder, rows: Sequence[Verdict], condition: str) -> str:
    """Return one sentence: how many laws pass, and which rungs break most of them.

    A law that has not climbed all rungs yet does not count.
    """
    climbed = climbs(rows, condition).values()
    top = studied.climbing[-1].name
    finished = 0
    complete = 0
    every = 0
    broken_by = Counter[str]()
    for rungs in climbed:
        failed = first_failed(rungs)
        last = rungs[-1]
        if failed is not None:
            broken_by[failed.step] += 1
        if last.step != top:
            continue
        finished += 1
        if last.kept:
            complete += 1
            every += failed is None

    passing = counted_of(every, finished, "law", "passes", "pass")
    answer = f"{passing} every rung, {complete} the complete machine"
    if finished == 0:
        answer = "no law has climbed every rung yet"
    breaks = ", ".join(f"{rung} breaks {count}" for rung, count in broken_by.most_common(3))
    if breaks:
        answer += f"; {breaks}"
    under_it = [row for row in rows if row.condition == condition]
    return f"{answer}.{_agreement(under_it, top)}"


def _agreement(rows: Iterable[Verdict], top: str) -> str:
    """Return how often the model's verdict on the complete machine is that of the measured one."""
    modelled = {}
    measured = {}
    for row in rows:
        if row.group == UP_TO and row.step == top:
            modelled[row.law] = row.kept
        if row.step == MEASURED:
            measured[row.law] = row.kept
    if not measured:
        return ""
    laws = len(measured)
    agree = sum(modelled.get(law) == kept for law, kept in measured.items())
    return f" The measured machine agrees with the model on {counted_of(agree, laws, 'law')}."


def answer_table(studied: Ladder, rows: Sequence[Verdict], condition: Condition) -> Table:
    """Return which laws pass every rung and the complete machine, and where each breaks first."""
    climbed = climbs(rows, condition.name)
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


def _height(rungs: Sequence[Verdict]) -> int:
    """Number of rungs below the first that is not kept."""
    failed = first_failed(rungs)
    if failed is None:
        return len(rungs)
    return rungs.index(failed)


def _answer_row(law: str, rungs: Sequence[Verdict], top: str) -> list[str]:
    """The row of one law, with the swings on the rung where it breaks or on its last."""
    failed = first_failed(rungs)
    last = rungs[-1]
    every = _UNFINISHED
    machine = _UNFINISHED
    if last.step == top:
        every = "yes"
        machine = f"{'yes' if last.kept else 'no'} ({last.cell})"

    breaks = ""
    measured = last
    if failed is not None:
        every = "no"
        breaks = f"{failed.step}: {failed.words}"
        measured = failed
    values = [measured.numbers.get(name) for name in ("amplitude", "frequency", "variation")]
    swings = ["" if value is None else number(value) for value in values]
    return [law, every, machine, breaks, *swings]


def share_table(studied: Ladder, rows: Sequence[Verdict], condition: str, group: str) -> Table:
    """Return laws by rungs: the share of the tightest limit that is used."""
    chosen = [row for row in rows if (row.condition, row.group) == (condition, group)]
    return verdict_table(_TITLES[group], chosen, _headings(studied, group))


def _headings(studied: Ladder, group: str) -> dict[str, str]:
    """Headings of the rungs, by their names."""
    rungs = studied.climbing if group == UP_TO else studied.alone
    headings = {rung.name: rung.title for rung in rungs}
    if group == UP_TO and studied.machine.file.measured:
        headings[MEASURED] = MEASURED
    return headings


def load_table(studied: Ladder, rows: Sequence[Verdict]) -> Table:
    """Return laws by conditions: the share on the complete machine."""
    top = studied.climbing[-1].name
    loads = "; ".join(f"{load.name}: {load.title}" for load in studied.conditions[1:])
    title = f"The complete machine, nominally and under load ({loads})"
    at_the_top = [row for row in rows if row.group == UP_TO and row.step == top]
    by_condition = [row.changed(step=row.condition) for row in at_the_top]
    headings = {condition.name: condition.name for condition in studied.conditions}
    return verdict_table(title, by_condition, headings)


def deviation_table(studied: Ladder, rows: Sequence[Verdict]) -> Table:
    """Return laws by rungs: the distance from the nominal optimum, of laws that follow it."""
    condition = studied.conditions[0].name
    laws = {law.name for law in studied.laws if law.controller.designed.follows_optimum}
    climbed = [row for row in rows if row.group == UP_TO and row.condition == condition]
    selected = [row for row in climbed if row.law in laws]

    unit, _ = studied.units
    scale = 1.0
    if unit in ("rad", "m"):
        unit = f"m{unit}"
        scale = 1e3
    title = f"Largest distance from the nominal optimum [{unit}], of the laws that follow it"
    headings = {rung.name: rung.name for rung in studied.climbing}
    return verdict_table(title, selected, headings, text=lambda row: _deviation_text(row, scale))


def assumed_table(rows: Sequence[Verdict]) -> Table | None:
    """Return the assumed numbers that turn a verdict, with the change; None without any."""
    cells = []
    for row in rows:
        if row.turned_by:
            verdict = "kept" if row.kept else "not kept"
            cells.append([row.law, row.step, verdict, ", ".join(row.turned_by)])
    if not cells:
        return None
    columns = [*names("law"), *words("rung", "verdict"), *text("turned by")]
    return table("Verdicts that an assumed number turns", columns, cells)


def _deviation_text(row: Verdict, scale: float) -> str:
    deviation = row.numbers.get("deviation")
    if deviation is not None:
        return number(deviation * scale)
    if row.ended:
        return "ended"
    return "-"


def claims_table(studied: Ladder, rows: Sequence[Verdict], condition: str) -> Table | None:
    """Return the rung on which each claim falls, for each law that it is about; None without."""
    climbed: dict[str, list[Verdict]] = {}
    claims: dict[str, None] = {}
    for law, rungs in climbs(rows, condition).items():
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


def _fate(rungs: Sequence[Verdict], claim: str) -> str:
    """The rung on which a claim falls, or that it stands; empty if it is not judged."""
    row = fallen(rungs, claim)
    if row is not None:
        return row.step
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


def charts(studied: Ladder, rows: Sequence[Verdict]) -> dict[str, CellChart]:
    """Return the chart of each condition: laws by rungs, one added on top of the other."""
    climbing = [row for row in rows if row.group == UP_TO]
    headings = _headings(studied, UP_TO)
    return charts_by_condition(studied.conditions, climbing, headings, climbing=True)


def alone_chart(studied: Ladder, rows: Sequence[Verdict]) -> CellChart | None:
    """Return the chart of laws by rungs, each alone on the sampled plant; None without any."""
    alone = [row for row in rows if row.group == ALONE]
    if not alone:
        return None
    return verdict_chart(_TITLES[ALONE], alone, _headings(studied, ALONE), climbing=False)


def sheets(studied: Ladder, rows: Sequence[Verdict]) -> list[ReportTable]:
    """Return every table with its charts: answers and claims, shares, loads, distances."""
    parts: list[ReportTable] = []
    for condition in studied.conditions:
        if climbs(rows, condition.name):
            answer = answer_table(studied, rows, condition)
            parts.append(ReportTable(table=answer, brief=True))
        claims = claims_table(studied, rows, condition.name)
        if claims is not None:
            parts.append(ReportTable(table=claims, brief=True))
    climbing = charts(studied, rows)
    alone = alone_chart(studied, rows)
    first, *loads = studied.conditions
    if first.name in climbing:
        shares = share_table(studied, rows, first.name, UP_TO)
        parts.append(ReportTable(table=shares, charts=[climbing[first.name]]))
    if alone is not None:
        shares = share_table(studied, rows, first.name, ALONE)
        parts.append(ReportTable(table=shares, charts=[alone]))

    if loads:
        under_load = [climbing[load.name] for load in loads if load.name in climbing]
        parts.append(ReportTable(table=load_table(studied, rows), charts=under_load))

    parts.append(ReportTable(table=deviation_table(studied, rows)))
    assumed = assumed_table(rows)
    if assumed is not None:
        parts.append(ReportTable(table=assumed))
    return parts


def _standing_words(rungs: Sequence[Verdict], *, complete: bool) -> str:
    """Words on the climb of a law."""
    failed = first_failed(rungs)
    if failed is not None:
        return f"{failed.words} ({failed.condition})"
    answer = "stands on every rung"
    if any(row.turned_by for row in rungs):
        answer += ", but an assumed number turns it"
    if not complete:
        answer += " so far"
    return answer


def ladder_result(studied: Ladder, rows: Sequence[Verdict], *, complete: bool) -> Result:
    """Return the result of a ladder.

    Args:
        studied: The target.
        rows: Finished rows.
        complete: Whether nothing was interrupted.
    """
    case = studied.machine
    # Under the first condition, which is the file's own.
    first = climbs(rows, studied.conditions[0].name)
    climbed = [row for rungs in first.values() for row in rungs]
    return result(
        "ladder",
        studied.configuration(),
        seed=case.loop.seed if case.loop else None,
        complete=complete,
        answers=_answers(studied, rows, complete=complete),
        standings=standings(
            studied.target,
            climbed,
            first_failed,
            partial(_standing_words, complete=complete),
            complete=complete,
        ),
        sheets=sheets(studied, rows),
        remarks=filter(None, [assumed_text(studied)]),
        values=values_of(studied.target, rows),
        target=studied.target,
        title=case.title,
        units=studied.units,
        conditions=conditions_document(studied.conditions),
        laws=[law_document(law) for law in studied.laws],
        climbing=[rung.document() for rung in studied.climbing],
        alone=[rung.document() for rung in studied.alone],
        claims=[_claim_document(studied, claim) for claim in studied.machine.file.claim],
        verdicts=[row.model_dump() for row in rows],
    )


def _answers(studied: Ladder, rows: Sequence[Verdict], *, complete: bool) -> Iterator[Answer]:
    """Yield the verdict under each condition: whether all laws pass the complete machine."""
    top = studied.climbing[-1].name
    for condition in studied.conditions:
        climbed = climbs(rows, condition.name)
        if not climbed:
            continue
        at_top = [rungs[-1] for rungs in climbed.values() if rungs[-1].step == top]
        judgement = KEPT
        if not complete:
            judgement = OPEN
        # One failure decides, however many laws have not climbed yet.
        if (len(at_top) < len(climbed) and complete) or not all(row.kept for row in at_top):
            judgement = NOT_KEPT
        words = verdict(studied, rows, condition.name)
        if len(studied.conditions) > 1:
            words = f"{condition.name}: {words}"
        yield Answer(question=f"Ladder of {studied.target}", verdict=judgement, words=words)


def _claim_document(studied: Ladder, claim: ClaimTable) -> dict[str, Any]:
    return {
        "claim": claim.id,
        "statement": studied.statements.get(claim.id, ""),
        "under": claim.under,
        "of": list(claim.of or studied.machine.controllers),
    }
