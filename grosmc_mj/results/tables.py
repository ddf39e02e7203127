"""Tables as plain values: for the terminal, for Markdown, and for the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, model_validator
from rich import box
from rich.markup import escape
from rich.table import Table as RichTable

from grosmc_mj.results.palette import VERDICT_COLOURS

# Of a table that has text to wrap, and of a legend; the longest name that is not wrapped.
WIDTH, _NAME = 100, 20
# Units for people.
_SHOWN = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
# By the powers of a thousand below one.
_PREFIXES = ("", "m", "µ")
# A bar that is none of a Markdown table's.
BAR = "\\|"

Kind = Literal["words", "numbers", "names", "phrases", "text", "verdict"]
# How Rich shows a column of each kind.
_SHOW: dict[Kind, dict[str, Any]] = {
    "words": {"no_wrap": True},
    "numbers": {"no_wrap": True, "justify": "right"},
    "names": {"overflow": "fold", "max_width": _NAME},
    "phrases": {"overflow": "fold"},
    "text": {"overflow": "fold", "ratio": 1, "min_width": _NAME},
    "verdict": {"no_wrap": True},
}


class Column(BaseModel):
    """A column of a table; of a given width, words that are longer wrap, or are ``cut``."""

    model_config = ConfigDict(frozen=True)
    header: str
    kind: Kind = "words"
    width: int | None = None
    cut: bool = False


def words(*headers: str) -> list[Column]:
    """Columns of words, at the left and never broken."""
    return [Column(header=header, kind="words") for header in headers]


def numbers(*headers: str) -> list[Column]:
    """Columns of numbers, at the right and never broken."""
    return [Column(header=header, kind="numbers") for header in headers]


def names(*headers: str) -> list[Column]:
    """Columns of names that somebody else chose and that may be of any length."""
    return [Column(header=header, kind="names") for header in headers]


def phrases(*headers: str) -> list[Column]:
    """Columns of words that wrap where the table would be too wide, the longest first."""
    return [Column(header=header, kind="phrases") for header in headers]


def text(header: str = "") -> list[Column]:
    """A column of text, in what the others leave of 100 columns."""
    return [Column(header=header, kind="text")]


def verdicts(header: str = "") -> list[Column]:
    """A column of verdicts, in their colours."""
    return [Column(header=header, kind="verdict")]


class Table(BaseModel):
    """A table of texts; brackets and bars in them are brackets and bars.

    Attributes:
        title: Above it; empty for none.
        columns: Of :func:`words`, :func:`numbers`, :func:`names`, :func:`text`, :func:`verdicts`.
        rows: A cell a column each.
        styles: A style a row for the terminal, such as ``red``; none by default.
        grouped: Whether rows with the same first cell are a group, which names it once.
        legend: Below it.
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
        """For the terminal."""
        wraps = any(column.kind == "text" for column in self.columns)
        shown = RichTable(
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
        for column in self.columns:
            overflow = "ellipsis" if column.cut else "fold"
            fixed = {"width": column.width, "no_wrap": column.cut, "overflow": overflow}
            options = _SHOW[column.kind] | (fixed if column.width else {})
            shown.add_column(escape(column.header), **options)
        group: str | None = None
        for (first, *others), style in zip(self.rows, self._styles(), strict=False):
            same = self.grouped and first == group
            if self.grouped and group is not None and not same:
                shown.add_section()
            group = first
            cells = ("" if same else first, *others)
            shown.add_row(*map(self._cell, self.columns, cells), style=style)
        return shown

    @staticmethod
    def _cell(column: Column, cell: str) -> str:
        colour = VERDICT_COLOURS.get(cell.rstrip(" *").lower()) if column.kind == "verdict" else ""
        return f"[bold {colour}]{escape(cell)}[/]" if colour else escape(cell)

    def _styles(self) -> Iterator[str]:
        yield from self.styles or [""] * len(self.rows)

    def markdown(self) -> list[str]:
        """As Markdown, a line each; without title and legend."""
        sides = ["---:" if column.kind == "numbers" else "---" for column in self.columns]
        header = [column.header for column in self.columns]
        return [_line(header), f"|{'|'.join(sides)}|", *map(_line, self.rows)]


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"


def table(
    title: str, columns: Sequence[Column], rows: Iterable[Sequence[str]], **options: Any
) -> Table:
    """A :class:`Table`; its ``styles``, ``grouped`` and ``legend`` are the options."""
    return Table(title=title, columns=columns, rows=[list(row) for row in rows], **options)


def markdown_table(columns: Sequence[Column], rows: Iterable[Sequence[str]]) -> list[str]:
    """A table in Markdown, a line each."""
    return table("", columns, rows).markdown()


def prefixed(unit: str, value: float) -> tuple[str, float]:
    """The unit in which a number of this size is easily read, and the factor to it.

    Args:
        unit: Such as rad.
        value: Not negative; of 1 and above, zero and what is not finite the unit stays.
    """
    if not (value > 0 and math.isfinite(value)):
        return unit, 1.0
    power = min(2, max(0, math.ceil(-math.log10(value) / 3 - 1e-9)))
    return _PREFIXES[power] + unit, 1000.0**power


def number(value: float | None) -> str:
    """A number in at most six characters, with three significant digits where they fit."""
    if value is None:
        return "-"
    if value == 0 or 0.01 <= abs(value) < 9999.5:
        return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"
    return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def shown_unit(unit: str) -> tuple[str, float]:
    """The unit that people read, and the factor to it."""
    return _SHOWN.get(unit, (unit, 1.0))
