"""Tolerances as a document and as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from grosmc_mj.report.document import origin
from grosmc_mj.report.tables import WIDTH, Column, names, number, numbers, table, text, words
from grosmc_mj.studies.tolerance.answers import (
    amount_text,
    by_weakness,
    cell_text,
    disagreements,
    reason,
    unit_and_scale,
    weakness,
)
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.measure import Tolerance
from grosmc_mj.studies.tolerance.search import BEYOND, LEAST, MOST, RESOLUTION
from grosmc_mj.studies.tolerance.setting import Setting

LEGEND = (
    "The largest amount up to which all is kept, of the first part. no: not kept without it; "
    "none: only without it; ≥ and ≤: kept up to the last that was tried; *: kept again beyond; "
    "!: physics said something else, and counts."
)


def tolerance_document(
    studied: Setting, rows: Sequence[Tolerance], seeds: int, *, complete: bool
) -> dict[str, Any]:
    """The content of tolerance_NAME.json.

    Args:
        studied: The target.
        rows: What has been found.
        seeds: Runs where something is random.
        complete: Whether that is all; it is not after an interrupt.
    """
    settings = studied.experiment.settings
    asked, differing = disagreements(rows)
    return {
        **origin(studied.bench.seed),
        "configuration": {
            "target": f"{studied.experiment.case.system}/{studied.experiment.case.name}",
            "bench": studied.bench_of,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "runs_where_random": seeds,
            "factors": {
                "least": LEAST,
                "most": MOST,
                "grid": 2.0,
                "beyond_the_last_kept": BEYOND,
                "resolution": RESOLUTION,
            },
        },
        "complete": complete,
        "conditions": [{"name": c.name, "title": c.title} for c in studied.conditions],
        "laws": [
            {
                "name": law.name,
                "predicts": law.predict,
                "sampled": law.settings,
                "requirements": {
                    each.name: [limit.words for limit in studied.limits(law, each)]
                    for each in studied.conditions
                },
            }
            for law in studied.laws
        ],
        "imperfections": [
            {
                "name": each.name,
                "most": each.most,
                "parts": [amount._asdict() for amount in each.amounts],
            }
            for each in studied.imperfections
        ],
        "tolerances": [_row(row) for row in rows],
        "physics": {"answers_checked": asked, "answers_that_differ": differing},
    }


def _row(row: Tolerance) -> dict[str, Any]:
    """One tolerance; what is not there is null."""
    return {
        "law": row.law.name,
        "imperfection": row.imperfection.name,
        "condition": row.condition.name,
        "kept_ideally": row.ideally,
        "largest_kept": _amounts(row.imperfection, row.largest),
        "smallest_failed": _amounts(row.imperfection, row.failed),
        "kept_again": [
            {"from": _amounts(row.imperfection, low), "to": _amounts(row.imperfection, high)}
            for low, high in row.again
        ],
        "tried_up_to": row.tried,
        "breaks": row.breaks or None,
        "margin_at_largest": row.margin,
        "plant": row.plant,
        "physics_agrees": row.agreed,
        "impossible": row.impossible or None,
    }


def _amounts(imperfection: Imperfection, factor: float | None) -> dict[str, Any] | None:
    """A factor with the amounts of each part that it makes."""
    if factor is None:
        return None
    parts = [
        {"of": f"{each.kind} {each.of}".strip(), "quantity": each.quantity, "unit": each.unit}
        | {"value": each.scaled(factor)}
        for each in imperfection.amounts
    ]
    return {"factor": factor, "shown": imperfection.shown(factor), "parts": parts}


def tolerance_table(title: str, rows: Sequence[Tolerance]) -> tuple[Table, list[str]]:
    """One row of each law, the weakest first; the imperfection of which the least is stood first.

    Args:
        title: Above it.
        rows: One of each law and imperfection.

    Returns:
        The table, as wide as an answer, and the imperfections that it has no room for.
    """
    standing = list(dict.fromkeys(row.law.name for row in rows))
    columns = by_weakness(rows)
    found = {(row.law.name, row.imperfection): row for row in rows}
    standing.sort(key=lambda law: min(weakness(row) for row in rows if row.law.name == law))
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
                row.condition.name,
                row.law.name,
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
