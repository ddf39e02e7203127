"""Tolerances as a document and as tables."""

from __future__ import annotations

from collections.abc import Sequence

from grosmc_mj.results.tables import (
    WIDTH,
    Column,
    Table,
    names,
    number,
    numbers,
    table,
    text,
    words,
)
from grosmc_mj.studies.tolerance.answers import (
    amount_text,
    by_weakness,
    cell_text,
    reason,
    unit_and_scale,
    weakness,
)
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.measure import Tolerance

LEGEND = (
    "The largest amount up to which all is kept, of the first part. no: not kept without it; "
    "none: only without it; ≥ and ≤: kept up to the last that was tried; *: kept again beyond; "
    "!: physics said something else, and counts."
)


def tolerance_table(title: str, rows: Sequence[Tolerance]) -> tuple[Table, list[str]]:
    """One row of each law, the weakest first; the imperfection of which the least is stood first.

    Args:
        title: Above it.
        rows: One of each law and imperfection.

    Returns:
        The table, as wide as an answer, and the imperfections that it has no room for.
    """
    standing = list(dict.fromkeys(row.law for row in rows))
    columns = by_weakness(rows)
    found = {(row.law, row.imperfection): row for row in rows}
    standing.sort(key=lambda law: min(weakness(row) for row in rows if row.law == law))
    room = WIDTH - max(len(law) for law in (*standing, "bench")) - 2
    shown: list[tuple[Column, Imperfection]] = []
    for each in columns:
        header = _header(each)
        texts = [cell_text(found[law, each]) for law in standing if (law, each) in found]
        room -= max(len(line) for line in (*header.split("\n"), *texts)) + 2
        if room < 0:
            break
        shown.append((numbers(header)[0], each))
    cells = [("bench", *(_bench(each) for _, each in shown))]
    cells += [(law, *(_cell(found.get((law, each))) for _, each in shown)) for law in standing]
    made = table(
        title,
        [*words("law"), *(column for column, _ in shown)],
        cells,
        styles=["dim", *[""] * len(standing)],
    )
    return made, [each.name for each in columns[len(shown) :]]


def _cell(row: Tolerance | None) -> str:
    """The text of a cell; nothing of what was interrupted."""
    return "" if row is None else cell_text(row)


def _bench(imperfection: Imperfection) -> str:
    """What the bench has."""
    if not imperfection.graded:
        return "yes"
    return number(imperfection.shown(1.0) * unit_and_scale(imperfection)[1])


def _header(imperfection: Imperfection) -> str:
    """A header of short lines, with the unit."""
    name, _, with_rates = imperfection.name.partition(", ")
    unit = unit_and_scale(imperfection)[0]
    last = "[bench]" if imperfection.whole else f"[{unit}]" if unit else ""
    lines = [*name.split(" ", 1), *(["est. rates"] if with_rates else []), last]
    return "\n".join(line for line in lines if line)


def every_answer(rows: Sequence[Tolerance]) -> Table:
    """Every tolerance, the smallest factor first."""
    return table(
        "Every answer",
        [
            *words("condition"),
            *names("law"),
            *text("imperfection"),
            *numbers("kept up to", "factor"),
            *words("breaks", "again", "physics"),
        ],
        [
            (
                row.condition,
                row.law,
                row.imperfection.name,
                _cell(row)
                if row.largest == 0 or not row.imperfection.graded
                else amount_text(row.imperfection, row.largest),
                number(row.largest) if row.ideally and row.imperfection.graded else "",
                reason(row),
                "; ".join(f"{number(low)} to {number(high)}" for low, high in row.again),
                {None: "", True: "agrees", False: "differs"}[row.agreed],
            )
            for row in sorted(rows, key=weakness)
        ],
    )
