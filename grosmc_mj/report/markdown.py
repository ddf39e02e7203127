"""Tables of the pages that are kept in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from grosmc_mj.report.tables import Column

# A bar that is none of the table's.
BAR = "\\|"


def markdown_table(columns: Sequence[Column], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table, a line each; bars in its texts are bars.

    Args:
        columns: As for :func:`grosmc_mj.report.tables.table`; numbers stand at the right.
        rows: A cell a column each.
    """
    sides = ["---:" if each.options.get("justify") == "right" else "---" for each in columns]
    return [_line(each.header for each in columns), f"|{'|'.join(sides)}|", *map(_line, rows)]


def _line(cells: Iterable[str]) -> str:
    """A row."""
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"
