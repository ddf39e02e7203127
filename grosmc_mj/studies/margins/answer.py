"""Answer of a margins study: words, tables, document."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, replace

from grosmc_mj.experiments.assumptions.growth import growth
from grosmc_mj.ground.errors import name_list
from grosmc_mj.ground.wording import titled, unit_after
from grosmc_mj.output.results.result import (
    MEASURED,
    OPEN,
    Answer,
    ReportTable,
    Result,
    Standing,
    Value,
    finite,
    result,
)
from grosmc_mj.output.results.tables import Table, names, number, numbers, phrases, table, words
from grosmc_mj.output.results.verdicts import Verdict, standings, values_of
from grosmc_mj.studies.margins.changes import DELAY, GAIN_DOWN, GAIN_UP, milliseconds
from grosmc_mj.studies.margins.chatter import Chatter
from grosmc_mj.studies.margins.figure import charts, in_figures
from grosmc_mj.studies.margins.frequency_response import Margins
from grosmc_mj.studies.margins.margins import MarginStudy, Setup
from grosmc_mj.studies.margins.row import LEVELS, SEED, LawMargins, shared_level, together
from grosmc_mj.studies.margins.task import AS_IS

LEGEND = (
    "gain down, gain up, delay: the largest change with which all draws keep the task, and the "
    "case that decides. The others by S at the plant's input, of a law that does not switch by the "
    "smallest signals; ±: standard error and error of interpolation; A to B: over the amplitudes. "
    "≥: nothing more was tried."
)

# Margins of the table that may depend on the amplitude: field, name in a note, factor, unit there.
_OF_AMPLITUDE = (
    ("delay", "delay by S", 1e3, " ms"),
    ("phase", "phase margin", 1.0, "°"),
    ("disk", "disk margin", 1.0, ""),
)


def verdict(rows: Sequence[LawMargins]) -> str:
    """Return a sentence about the last setup: the laws with the least and the largest delay.

    Before it stand the laws that keep the task under no condition.
    """
    setup = rows[-1].setup
    delays: dict[str, float] = {}
    for row in rows:
        worst = row.worst_of_task(DELAY)
        if row.setup == setup and worst is not None:
            delays[row.law] = worst.largest_kept or 0.0
    failing = [row.law for row in rows if row.setup == setup and not row.changes]
    first = f"Without any change {name_list(failing)}: not kept. " if failing else ""
    if not delays:
        return f"{setup}: the task is not kept by {name_list(failing)}."

    least = min(delays, key=delays.__getitem__)
    most = max(delays, key=delays.__getitem__)
    sentence = f"{first}{setup}: {least} tolerates {milliseconds(delays[least])} ms more delay"
    if most != least:
        sentence += f", {most} {milliseconds(delays[most])} ms"
    return f"{sentence}."


# -- the table of a setup --------------------------------------------------------------------------


def margin_table(setup: Setup, rows: Sequence[LawMargins]) -> Table:
    """Return laws by margins of the task and of S at the plant's input.

    Args:
        setup: The setup.
        rows: Its rows.
    """
    shared = shared_level(rows)
    under = ", ".join(condition.name for condition in setup.conditions)
    title = f"{setup.name}: what the task tolerates ({_draws_words(rows)}{under})"
    if shared is not None:
        (example, *_) = [row for row in rows if row.switches and row.trusted]
        sizes = [f"{number(level.rms)}{unit_after(level.unit)}" for level in example.at(shared)]
        title += f", and S at {', '.join(sizes)} rms of laws that switch"

    several = len(setup.case.nominal.system.inputs) > 1
    failing = any(row.refused for row in rows)
    columns = names("law")
    if failing:
        columns += names("not kept\nas it is")
    columns += [*numbers(GAIN_DOWN, GAIN_UP, "delay\n[ms]")]
    columns += numbers("delay by\nS [ms]", "phase\n[°]", "disk")
    if several:
        columns += numbers("disk,\ntogether")
    columns += numbers("bandwidth\n[Hz]")

    nominal = setup.conditions[0].name
    cells = []
    for row in rows:
        named = [row.law]
        if failing:
            named.append(", ".join(refused.condition for refused in row.refused))
        of_task = [_task_text(row, kind, nominal) for kind in (GAIN_DOWN, GAIN_UP, DELAY)]
        cells.append([*named, *of_task, *_input_cells(row, shared, several)])
    return table(title, columns, cells)


def _draws_words(rows: Sequence[LawMargins]) -> str:
    """Number of draws of a setup in words; empty where nothing is drawn."""
    draws = max((margin.draws for row in rows for margin in row.changes), default=1)
    return f"{draws} draws; " if draws > 1 else ""


def _task_text(row: LawMargins, kind: str, nominal: str) -> str:
    """The least margin of a kind, with the condition that decides if it is not the nominal one."""
    worst = row.worst_of_task(kind)
    if worst is None:
        return "-"
    if worst.smallest_failed is not None and worst.condition != nominal:
        return f"{worst.text} {worst.condition}"
    return worst.text


def _input_cells(row: LawMargins, shared: int | None, several: bool) -> list[str]:
    """Texts of the margins by S at the inputs, of the input with the least disk margin."""
    index = row.level_index(shared)
    if index is None:
        return ["-"] * (5 if several else 4)

    levels = row.at(index)
    worst = min(levels, key=lambda level: level.margins.disk)
    margins = worst.margins
    errors = worst.errors
    mark = "*" if row.switches and index != shared else ""
    cells = [
        _range_text(row, "delay", 1e3) or _with_error(1e3 * margins.delay, 1e3 * errors.delay),
        _range_text(row, "phase") or _with_error(margins.phase, errors.phase),
        _range_text(row, "disk") or _with_error(margins.disk, errors.disk),
    ]
    cells[0] += mark
    if several:
        cells.append(number(together(levels)))
    return [*cells, number(finite(margins.bandwidth))]


def _range_text(row: LawMargins, margin: str, factor: float = 1.0) -> str:
    """The least and the largest value of a margin, if trusted amplitudes disagree; else empty."""
    levels = row.disagreeing(margin)
    if levels is None:
        return ""
    least, largest = [number(factor * getattr(level.margins, margin)) for level in levels]
    return f"{least} to {largest}"


def _with_error(value: float, error: float) -> str:
    """A number with its error, if that is more than half a percent of it."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "∞"
    if not error > 0.005 * value:
        return number(value)
    return f"{number(value)}±{error:.1g}"


# -- notes -----------------------------------------------------------------------------------------


def notes(rows: Sequence[LawMargins]) -> list[str]:
    """Return lines about laws: what breaks, chatter, and what cannot be trusted.

    Args:
        rows: Rows of one setup.
    """
    laws: dict[str, list[str]] = {}
    for row in rows:
        for note in _notes_of(row):
            laws.setdefault(note, []).append(row.law)
    return [f"{'; '.join(names)}: {note}" for note, names in laws.items()]


def _notes_of(row: LawMargins) -> Iterator[str]:
    """Lines about a law."""
    if row.impossible:
        yield row.impossible
    if row.chatter is not None:
        yield _chatter_words(row.chatter)
    for margin, title, factor, unit in _OF_AMPLITUDE:
        levels = row.disagreeing(margin)
        if levels is not None:
            texts = []
            for level in levels:
                value = number(factor * getattr(level.margins, margin))
                texts.append(f"{value}{unit} at {number(level.rms)}{unit_after(level.unit)} rms")
            yield f"{title} depends on the amplitude: {', '.join(texts)}"
    if row.levels and not row.trusted:
        doubts = [level.doubt for level in row.at(len(LEVELS) - 1) if level.doubt]
        yield f"S is not trustworthy, because {(doubts or ['it is not at all inputs'])[0]}"


def _chatter_words(chatter: Chatter) -> str:
    """The gain and the delay at which chatter begins, in words."""
    if chatter.at_rest:
        return "chatters at rest; S tells how it answers slow signals"
    begins = []
    if math.isfinite(chatter.gain):
        begins.append(f"gain {number(chatter.gain)}")
    if math.isfinite(chatter.delay):
        begins.append(f"delay {number(1e3 * chatter.delay)} ms")
    if not begins:
        return "does not chatter"
    return f"begins to chatter at {', '.join(begins)}"


# -- all tables ------------------------------------------------------------------------------------


def sheets(studied: MarginStudy, rows: Sequence[LawMargins]) -> list[ReportTable]:
    """Return the tables of each setup, the first one with charts."""
    parts = []
    measured = list(by_setup(studied, rows))
    # One screen has no room for all: those nearest to the machine.
    nearest = measured[-2:]
    for setup, of_setup in measured:
        first = margin_table(setup, of_setup)
        brief = (setup, of_setup) in nearest
        drawn = []
        for laws in in_figures(row.law for row in of_setup):
            drawn += charts(setup, of_setup, laws)
        parts.append(ReportTable(table=first, charts=drawn, brief=brief))
        parts.append(ReportTable(table=_task_table(setup, of_setup)))
        parts.append(ReportTable(table=_level_table(setup, of_setup)))
    return parts


def by_setup(
    studied: MarginStudy, rows: Sequence[LawMargins]
) -> Iterator[tuple[Setup, list[LawMargins]]]:
    """Yield each setup that has rows, with them."""
    for setup in studied.setups:
        of_setup = [row for row in rows if row.setup == setup.name]
        if of_setup:
            yield setup, of_setup


def _task_table(setup: Setup, rows: Sequence[LawMargins]) -> Table:
    """Return the margins of the task under each condition, and what breaks."""
    cells = []
    for row in rows:
        of_task = [*row.changes, *row.refused]
        for verdict in of_task:
            change = titled(verdict.step, "ms") if verdict.step == DELAY else verdict.step
            cells.append([row.law, verdict.condition, change, verdict.text, verdict.words])
    columns = words("law", "under", "change", "kept up to", "then breaks")
    return table(f"{setup.name}: the task under each condition", columns, cells, grouped=True)


def _level_table(setup: Setup, rows: Sequence[LawMargins]) -> Table:
    """Return the margins by S at every place and amplitude."""
    quantities = ("gain down", "gain up", "phase [°]", "delay [ms]", "modulus", "disk")
    columns = [
        *words("law", "injected at"),
        *numbers("rms", *quantities, "crossover [Hz]", "bandwidth [Hz]"),
        *phrases("not trustworthy, because"),
    ]
    cells = []
    for row in rows:
        for level in row.levels:
            margins = astuple(_in_milliseconds(level.margins))
            errors = astuple(_in_milliseconds(level.errors))
            values = [_with_error(*pair) for pair in zip(margins, errors, strict=True)]
            rms = f"{number(level.rms)}{unit_after(level.unit)}"
            cells.append([row.law, level.place, rms, *values, level.doubt])
    return table(f"{setup.name}: S at each amplitude", columns, cells, grouped=True)


def _in_milliseconds(margins: Margins) -> Margins:
    """Return margins, or their errors, with the delay [ms] in place of [s]."""
    return replace(margins, delay=1e3 * margins.delay)


# -- document --------------------------------------------------------------------------------------


def margins_result(studied: MarginStudy, rows: Sequence[LawMargins], *, complete: bool) -> Result:
    """Return the result of a study of margins.

    Args:
        studied: The target.
        rows: Finished rows.
        complete: Whether nothing was interrupted.
    """
    lines: list[str] = []
    for setup, of_setup in by_setup(studied, rows):
        grows = growth(setup.case, [law.controller for law in setup.laws])
        lines += [line for line in grows if line not in lines]
        lines += notes(of_setup)
    answer = Answer(
        question=f"Margins of {studied.target}",
        verdict=MEASURED if complete else OPEN,
        words=verdict(rows),
        notes=lines,
    )
    return result(
        "margins",
        studied.configuration(),
        seed=SEED,
        complete=complete,
        answers=[answer],
        standings=_standings(rows, complete=complete),
        sheets=sheets(studied, rows),
        remarks=[LEGEND],
        values=_values(rows),
        target=studied.target,
        rows=[row.model_dump() for row in rows],
    )


def _refused(rows: Sequence[Verdict]) -> list[Verdict]:
    """The verdicts on a task that is not kept without any change."""
    return [row for row in rows if row.step == AS_IS]


def _failed(rows: Sequence[Verdict]) -> Verdict | None:
    """The conditions under which a law fails without any change; None if it keeps them all."""
    refused = _refused(rows)
    if not refused:
        return None
    return refused[0].changed(step=", ".join(row.condition for row in refused))


def _standing_words(rows: Sequence[Verdict]) -> str:
    """Conditions that are not kept, each with the requirement that breaks."""
    return "; ".join(f"{row.condition}: {row.words}" for row in _refused(rows))


def _standings(rows: Sequence[LawMargins], *, complete: bool) -> Iterator[Standing]:
    """Yield the standing of each law in each setup."""
    for row in rows:
        # A law that cannot be run breaks nowhere.
        task = row.task or [Verdict(law=row.law, impossible=row.impossible)]
        yield from standings(row.setup, task, _failed, _standing_words, complete=complete)


def _values(rows: Sequence[LawMargins]) -> Iterator[Value]:
    """Margins that two results are compared by."""
    for row in rows:
        setup = row.setup.replace(",", "")
        yield from values_of(setup, row.task)
        name = f"{setup} {row.law}"
        for level in row.levels:
            if not level.doubt:
                disk = finite(level.margins.disk)
                at = f"{name}, {level.place} {number(level.rms)}: disk margin"
                yield Value(name=at, value=disk, better=1, relative=0.1)
