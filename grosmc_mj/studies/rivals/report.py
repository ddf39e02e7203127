"""The rivals' table in ``docs/rivals.md``."""

from __future__ import annotations

import math
from collections.abc import Iterable

from grosmc_mj.results.tables import markdown_table, number, numbers, words
from grosmc_mj.studies.rivals.measure import Rival

_WORDS = ("system", "law")
_NUMBERS = (
    "settled", "max |y − y\\*|", "left at the end", "max |u|", "variation of u", "kept",
)  # fmt: skip


def rivals_table(rows: Iterable[Rival]) -> str:
    """The table, in Markdown."""
    cells = []
    for row in rows:
        y, u = row.output_unit, row.input_unit
        own = [
            f"{number(row.settling)} s" if math.isfinite(row.settling) else "not reached",
            f"{number(row.deviation)} {y}",
            f"{number(row.remaining)} {y}" if math.isfinite(row.remaining) else "ended early",
            f"{number(row.peak)} {u}",
            f"{number(row.variation)} {u}/s",
            "yes" if row.kept else "no",
        ]
        cells.append([row.system, row.law, *own])
    return "\n".join(markdown_table([*words(*_WORDS), *numbers(*_NUMBERS)], cells))
