"""Tables of texts: for the terminal, for Markdown, and for the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, model_validator
from rich import box
from rich.cells import cell_len
from rich.markup import escape
from rich.table import Table as RichTable

from grosmc_mj.output.palette import VERDICT_COLOURS

# Columns of the terminal that a table with text to wrap takes, and a legend.
WIDTH = 100
# Width of a column of names: longer names wrap.
_NAME_WIDTH = 20
# Units for people, and the factor to them.
_SHOWN = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
# Prefixes of units, by the negative power of a thousand.
_PREFIXES = ("", "m", "µ")
# An escaped bar, which does not end the cell of a Markdown table.
BAR = "\\|"

Kind = Literal["words", "numbers", "names", "phrases", "text", "verdict"]
# Rich's options for a column of each kind.
_RICH_OPTIONS: dict[Kind, dict[str, Any]] = {
    "words": {"no_wrap": True},
    "numbers": {"no_wrap": True, "justify": "right"},
    "names": {"overflow": "fold", "max_width": _NAME_WIDTH},
    "phrases": {"overflow": "fold"},
    "text": {"overflow": "fold", "ratio": 1, "min_width": _NAME_WIDTH},
    "verdict": {"no_wrap": True},
}


# Kinds of columns that are never broken, and the space beside each.
_UNBROKEN = ("words", "numbers", "verdict")
_GAP = 2


class Column(BaseModel):
    """A column of a table.

    Attributes:
        header: Title of the column.
        kind: Kind of its cells.
        width: Width in the terminal; None for as wide as the cells need.
        cut: Whether texts beyond the width are cut off; else they wrap.
        detail: Whether a brief answer leaves the column out.
    """

    model_config = ConfigDict(frozen=True)
    header: str
    kind: Kind = "words"
    width: int | None = None
    cut: bool = False
    detail: bool = False


def _columns(kind: Kind, headers: Iterable[str]) -> list[Column]:
    return [Column(header=header, kind=kind) for header in headers]


def details(columns: Iterable[Column]) -> list[Column]:
    """Return columns that a brief answer leaves out."""
    return [column.model_copy(update={"detail": True}) for column in columns]


def words(*headers: str) -> list[Column]:
    """Return columns of words, aligned left and never broken."""
    return _columns("words", headers)


def numbers(*headers: str) -> list[Column]:
    """Return columns of numbers, aligned right and never broken."""
    return _columns("numbers", headers)


def names(*headers: str) -> list[Column]:
    """Return columns of users' names, which may have any length."""
    return _columns("names", headers)


def phrases(*headers: str) -> list[Column]:
    """Return columns of words that wrap where the table would be too wide, the longest first."""
    return _columns("phrases", headers)


def text(header: str = "") -> list[Column]:
    """Return a column of text, which takes what the other columns leave of 100."""
    return [Column(header=header, kind="text")]


def verdicts(header: str = "") -> list[Column]:
    """Return a column of verdicts, in their colours."""
    return [Column(header=header, kind="verdict")]


class Table(BaseModel):
    """A table of texts; Rich and Markdown read no markup in them.

    Attributes:
        title: Title above the table; empty for none.
        columns: The columns, of :func:`words`, :func:`numbers`, :func:`names`, :func:`text` and
            :func:`verdicts`.
        rows: Cells of each row, one for each column.
        styles: Style of each row in the terminal, such as ``red``; empty for none.
        grouped: Whether rows with the same first cell form a group, which shows it once.
        legend: Text below the table.
    """

    model_config = ConfigDict(frozen=True)
    title: str = ""
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    styles: Sequence[str] = ()
    grouped: bool = False
    legend: str = ""

    @model_validator(mode="after")
    def _rows_fit(self) -> Table:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row has {len(row)} cells, not {len(self.columns)}")
        return self

    def __rich__(self) -> RichTable:
        """Return Rich's table for the terminal."""
        wraps = any(column.kind == "text" for column in self.columns)
        rich_table = RichTable(
            box=box.SIMPLE_HEAD,
            padding=(0, 1, 0, 0),
            show_edge=False,
            title=escape(self.title) or None,
            title_justify="left",
            title_style="bold",
            caption=escape(self.legend) or None,
            caption_justify="left",
            caption_style="dim",
            width=WIDTH if wraps else None,
        )
        for i, column in enumerate(self.columns):
            options = _column_options(column)
            if column.kind == "names":
                # A table that is too wide breaks names between words only.
                options["min_width"] = _longest_word(row[i] for row in self.rows)
            rich_table.add_column(escape(column.header), **options)

        styles = self.styles or [""] * len(self.rows)
        group: str | None = None
        for row, style in zip(self.rows, styles, strict=False):
            cells = [
                _rich_cell(column, cell) for column, cell in zip(self.columns, row, strict=True)
            ]
            if self.grouped and row[0] == group:
                cells[0] = ""
            elif self.grouped and group is not None:
                rich_table.add_section()
            group = row[0]
            rich_table.add_row(*cells, style=style)
        return rich_table

    def brief(self, most: int) -> Table:
        """Return the table for an answer: its first rows, without columns of details.

        Columns that are never broken are left out from the first one that has no room.

        Args:
            most: Largest number of rows; the legend says how many more there are.
        """
        shown = [i for i, column in enumerate(self.columns) if not column.detail]
        fitting = self._fitting(shown)
        more = len(self.rows) - most
        legend = f"... and {more} more: --verbose has them" if more > 0 else self.legend
        if len(shown) < len(self.columns) and more <= 0:
            # The legend explains the whole table.
            legend = ""
        left_out = [self.columns[i].header.replace("\n", " ") for i in shown[len(fitting) :]]
        if left_out:
            legend = f"{legend}\nNo room for: {'; '.join(left_out)}; --verbose has all.".strip()
        return self.model_copy(
            update={
                "columns": [self.columns[i] for i in fitting],
                "rows": [[row[i] for i in fitting] for row in self.rows[:most]],
                "legend": legend,
            }
        )

    def _fitting(self, shown: Sequence[int]) -> Sequence[int]:
        """Return the first columns, by index, that fit into the terminal's width."""
        used = 0
        for place, index in enumerate(shown):
            column = self.columns[index]
            if column.kind not in _UNBROKEN:
                return shown
            texts = [column.header, *(row[index] for row in self.rows)]
            longest = max(cell_len(line) for text in texts for line in text.split("\n"))
            used += (column.width or longest) + _GAP
            if used > WIDTH:
                return shown[:place]
        return shown

    def markdown(self) -> list[str]:
        """Return the lines of the table in Markdown, without title and legend."""
        header = [column.header for column in self.columns]
        sides = ["---:" if column.kind == "numbers" else "---" for column in self.columns]
        rule = f"|{'|'.join(sides)}|"
        return [_markdown_row(header), rule, *map(_markdown_row, self.rows)]


def _column_options(column: Column) -> dict[str, Any]:
    """Return Rich's options for a column."""
    options = dict(_RICH_OPTIONS[column.kind])
    if column.width:
        options["width"] = column.width
        options["no_wrap"] = column.cut
        options["overflow"] = "ellipsis" if column.cut else "fold"
    return options


def _longest_word(texts: Iterable[str]) -> int:
    """Return the width of the longest word of some texts; at most that of a column of names."""
    widths = [cell_len(word) for text in texts for word in text.split()]
    return min(_NAME_WIDTH, max(widths, default=1))


def _rich_cell(column: Column, cell: str) -> str:
    """Write a cell for Rich; a verdict has its colour."""
    text = escape(cell)
    if column.kind != "verdict":
        return text
    # A footnote's mark may follow the verdict.
    colour = VERDICT_COLOURS.get(cell.rstrip(" *").lower())
    if colour is None:
        return text
    return f"[bold {colour}]{text}[/]"


def _markdown_row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"


def table(
    title: str,
    columns: Sequence[Column],
    rows: Iterable[Sequence[str]],
    **options: Any,
) -> Table:
    """Return a :class:`Table`; the options are ``styles``, ``grouped`` and ``legend``."""
    return Table(title=title, columns=columns, rows=[list(row) for row in rows], **options)


def prefixed(unit: str, value: float) -> tuple[str, float]:
    """Return the unit with a prefix in which a number is easily read, and the factor to it.

    Args:
        unit: Unit, such as rad.
        value: The number, not negative; it has no prefix from 1 on, at zero and at infinity.
    """
    if not (value > 0 and math.isfinite(value)):
        return unit, 1.0
    power = min(2, max(0, math.ceil(-math.log10(value) / 3 - 1e-9)))
    return _PREFIXES[power] + unit, 1000.0**power


def number(value: float | None) -> str:
    """Write a number in at most six characters, with three significant digits where they fit."""
    if value is None:
        return "-"
    size = abs(value)
    if size == 0 or 0.01 <= size < 999.5:
        return f"{value:.3g}"
    if 999.5 <= size < 9999.5:
        return f"{value:.0f}"
    return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def shown_unit(unit: str) -> tuple[str, float]:
    """Return the unit that people read, and the factor to it."""
    return _SHOWN.get(unit, (unit, 1.0))
