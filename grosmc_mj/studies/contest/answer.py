"""Answer of a contest: the sentence, the table, the chart and the document."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from grosmc_mj.ground.errors import name_list
from grosmc_mj.ground.wording import counted, counted_of, plural, spelled
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    CellChart,
    ReportTable,
    Result,
    Value,
    result,
)
from grosmc_mj.output.results.tables import Table, number, numbers, table, words
from grosmc_mj.output.results.verdicts import (
    Verdict,
    described,
    standings,
    values_of,
    worst_failed,
    worst_of,
)
from grosmc_mj.studies.contest.contest import PIECES, ContestStudy
from grosmc_mj.studies.contest.row import ContestLaw, Entry, simplest
from grosmc_mj.studies.disturbance.row import ENDED
from grosmc_mj.studies.margins.changes import DELAY, GAIN_DOWN, GAIN_UP
from grosmc_mj.studies.matrix import conditions_document, verdict_chart
from grosmc_mj.studies.sweep.pass_rates import pass_rate
from grosmc_mj.studies.target import under
from grosmc_mj.studies.tune.row import AS_IN_FILE, TUNED

LEGEND = (
    "Kept: draws of no search that keep all, under all conditions together. Share: measured over "
    "allowed value of the tightest limit in the worst of them; above 1 it is not kept. Margins are "
    "those of the nominal task; input and its variation those of one run under each condition, the "
    "largest."
)
NOTE = (
    "Green: all requirements are kept. Orange: the named requirement is not. Yellow: kept in some "
    "draws, so many of so many."
)
# Words for the numbers of a law in tables and charts.
_STEPS = {AS_IN_FILE: "file", TUNED: "tuned"}


def contest_table(study: ContestStudy, rows: Sequence[ContestLaw]) -> Table:
    """Return the table of a contest: two rows a law, with the file's numbers and tuned ones."""
    unit = study.case.nominal.system.inputs[0].unit
    plants = ["plants kept", "95 %"] if study.has_plants else []
    disturbance = ["worst disturbance"] if study.on else []
    columns = [
        *words("law", "with"),
        *numbers("kept", "worst share", *plants, *disturbance),
        *numbers("delay", "gain down", "gain up"),
        *numbers(f"largest input [{unit}]", f"variation [{unit}/s]", "runs"),
    ]
    lines = []
    for row in rows:
        if row.refused:
            lines.append([row.law, "not tuned", *["-"] * (len(columns) - 2)])
        for entry in row.entries:
            numbers_of = _STEPS[entry.step]
            runs = ""
            if entry.step == TUNED:
                numbers_of = f"{len(row.numbers)} tuned"
                if row.unchanged:
                    numbers_of += ", as in the file"
                runs = str(row.runs)
            lines.append([row.law, numbers_of, *_cells(study, entry), runs])
    return table("Contest", columns, lines, grouped=True, legend=LEGEND)


def _cells(study: ContestStudy, entry: Entry) -> list[str]:
    """Cells of a law with some numbers."""
    kept = sum(verdict.kept_draws for verdict in entry.on_machine)
    draws = sum(verdict.draws for verdict in entry.on_machine)
    plants = entry.on_plants
    of_plants: list[str] = []
    if plants is not None:
        rate = pass_rate(plants.kept_draws, plants.draws)
        interval = f"{_percent(rate.low)} to {_percent(rate.high)} %"
        of_plants = [f"{plants.kept_draws} of {plants.draws}", interval]
    disturbance = [_of_disturbance(entry.worst_disturbance)] if study.on else []
    return [
        f"{kept} of {draws}",
        described(worst_of(entry.verdicts)).text.removesuffix("x"),
        *of_plants,
        *disturbance,
        *(entry.margin(kind) for kind in (DELAY, GAIN_DOWN, GAIN_UP)),
        _shown(entry.largest_input),
        _shown(entry.variation),
    ]


def _percent(end: float | None) -> str:
    """An end of an interval [%]."""
    assert end is not None
    return f"{100 * end:.0f}"


def _of_disturbance(share: float | None) -> str:
    """Share under the worst disturbance, as text."""
    if share is not None and share > ENDED:
        return "ends early"
    return _shown(share)


def _shown(value: float | None) -> str:
    return "-" if value is None else number(value)


def contest_chart(study: ContestStudy, rows: Sequence[ContestLaw]) -> CellChart:
    """Return the chart of laws by conditions, with the file's numbers and tuned ones."""
    headings = {
        f"{step}, {item.name}": f"{heading}: {item.name}"
        for step, heading in _STEPS.items()
        for item in study.tuning.conditions
    }
    verdicts = [
        described(verdict).changed(step=f"{entry.step}, {verdict.condition}")
        for row in rows
        for entry in row.entries
        for verdict in entry.verdicts
    ]
    return verdict_chart(f"Contest on {study.target}", verdicts, headings, climbing=False)


def contest_result(study: ContestStudy, rows: Sequence[ContestLaw], *, complete: bool) -> Result:
    """Return the result of a contest.

    Args:
        study: The target.
        rows: Its rows.
        complete: Whether nothing was interrupted.
    """
    tuned = [verdict for row in rows if row.tuned for verdict in row.tuned.verdicts]
    return result(
        "contest",
        study.configuration(),
        seed=study.tuning.seed,
        complete=complete,
        answers=[_answer(study, rows, complete=complete)],
        standings=standings(study.target, tuned, worst_failed, _standing_words, complete=complete),
        sheets=[
            ReportTable(
                table=contest_table(study, rows),
                charts=[contest_chart(study, rows)],
                brief=True,
            )
        ],
        remarks=_remarks(study),
        values=_values(study, rows),
        target=study.target,
        conditions=conditions_document(item.condition for item in study.tuning.conditions),
        laws=[_law_document(row) for row in rows],
        left_out=study.left_out,
    )


def _answer(study: ContestStudy, rows: Sequence[ContestLaw], *, complete: bool) -> Answer:
    """The sentence: which laws keep all, and the simplest of them."""
    winner = simplest(rows)
    if winner is None:
        verdict = NOT_KEPT
        answer = f"none of {_laws(rows)} keeps all with the numbers found"
        more = _nearest(rows)
    else:
        verdict = KEPT
        answer = _keeping(rows, winner)
        before = [row.law for row in rows if row.entries and row.entries[0].kept]
        more = f"With the file's numbers: {name_list(before) or 'none'}."
    answer = f"{answer[0].upper()}{answer[1:]}"
    if not complete:
        verdict = OPEN
    return Answer(
        question=f"Contest on {study.target}",
        verdict=verdict,
        words=answer,
        more=more,
        notes=[f"{row.law} was not tuned: {row.refused}" for row in rows if row.refused],
    )


def contest_words(rows: Sequence[ContestLaw]) -> list[str]:
    """Return a line on each tuned law, with its worst share on draws of no search."""
    return [
        f"{row.law}: {_standing_words(row.tuned.verdicts)}, {row.tuned.kept_draws} of "
        f"{row.tuned.draws} draws keep all"
        for row in rows
        if row.tuned
    ]


def _laws(rows: Sequence[ContestLaw]) -> str:
    """The number of laws in words."""
    return counted(len(rows), "law")


def _keeping(rows: Sequence[ContestLaw], winner: ContestLaw) -> str:
    """Which laws keep all, and which is the simplest, in words."""
    keeping = [row.law for row in rows if row.kept]
    tuned_numbers = counted(len(winner.numbers), "tuned number")
    place = _standing_words(winner.entries[-1].verdicts)
    return (
        f"{counted_of(len(keeping), len(rows), 'law', 'keeps', 'keep')} all, tuned: "
        f"{name_list(keeping)}; simplest: {winner.law}, {tuned_numbers}, {place}"
    )


def _nearest(rows: Sequence[ContestLaw]) -> str:
    """The law with the least share and the one with most kept draws; empty if none was judged."""
    judged = [(row, row.entries[-1]) for row in rows if row.entries]
    if not judged:
        return ""
    row, entry = min(judged, key=lambda pair: pair[1].share)
    nearest = f"Nearest: {row.law}, {_standing_words(entry.verdicts)}"
    most, of_most = max(judged, key=lambda pair: pair[1].kept_draws)
    if of_most.kept_draws == entry.kept_draws:
        return f"{nearest}."
    return f"{nearest}; most draws: {most.law}, {of_most.kept_draws} of {of_most.draws}."


def _standing_words(verdicts: Sequence[Verdict]) -> str:
    """The worst verdict on a law in words."""
    worst = worst_of(verdicts)
    if not worst.tightest:
        return f"{described(worst).words}{under(worst.condition)}"
    share = "never" if math.isinf(worst.share) else number(worst.share)
    return f"{share} of {spelled(worst.tightest)}{under(worst.condition)}"


def _remarks(study: ContestStudy) -> list[str]:
    tuning = study.tuning
    conditions = ", ".join(item.name for item in tuning.conditions)
    lines = [
        f"Each law: {tuning.runs:,} {plural(tuning.runs, 'run')} at most, ended at "
        f"{tuning.target_share:g} of each limit; seed {tuning.seed}. Asked under: {conditions}.",
        f"Tuned on {counted(tuning.draws, 'draw')}, judged on "
        f"{counted(tuning.held_out, 'other one')}; margins on "
        f"{study.margin_draws}.",
        "A law that was not found to keep all may do so with other numbers, or more runs.",
    ]
    if study.on:
        lines.append(
            f"Worst disturbance: share under the worst that {PIECES} pieces of {study.bound} on "
            f"{study.on} were found to do, in one draw."
        )
    if study.left_out:
        left_out = "; ".join(f"{name} ({why})" for name, why in study.left_out.items())
        lines.append(f"Left out: {left_out}.")
    return lines


def _values(study: ContestStudy, rows: Sequence[ContestLaw]) -> Iterator[Value]:
    """Yield the values by which two contests are compared."""
    winner = simplest(rows)
    yield Value(name=f"{study.target}: simplest", value=winner.law if winner else "none")
    for row in rows:
        for entry in row.entries:
            yield from values_of(study.target, entry.verdicts)
            # Without any change the verdicts above say whether the task is kept.
            searched = [item for item in entry.margins if item.searched]
            named = [item.changed(group=entry.step) for item in searched]
            yield from values_of(study.target, named)


def _law_document(row: ContestLaw) -> dict[str, Any]:
    """Row of a law as plain values."""
    return {**row.model_dump(), "kept": row.kept}
