"""The rivals' table in ``docs/rivals.md``.

``python -m grosmc_mj.studies.rivals.report docs/rivals.md`` is what ``make rivals`` runs.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from pathlib import Path

from grosmc_mj.errors import SetupError
from grosmc_mj.report.markdown import markdown_table
from grosmc_mj.report.marked import replace_marked
from grosmc_mj.report.tables import number, numbers, words
from grosmc_mj.studies.rivals.measure import SYSTEMS, Rival, rivals

BEGIN, END = "<!-- rivals -->", "<!-- /rivals -->"
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


def write_page(page: Path) -> None:
    """Run all cases, and put the table between the page's marks.

    Raises:
        SetupError: If the page or a mark is missing.
    """
    rows = (row for system in SYSTEMS for row in rivals(system))
    replace_marked(page, BEGIN, END, lambda: rivals_table(rows))


if __name__ == "__main__":
    try:
        write_page(*map(Path, sys.argv[1:2]))
    except (SetupError, TypeError) as error:
        sys.exit(f"PAGE.md: {error}")
