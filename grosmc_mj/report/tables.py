"""Tables in the house's style, and numbers in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rich import box
from rich.markup import escape
from rich.table import Table
from rich.text import Text

# Of a table that has text to wrap, and of a legend; the longest name that is not wrapped.
WIDTH, _NAME = 100, 20
# Units for people.
_SHOWN = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}
# By the powers of a thousand below one.
_PREFIXES = ("", "m", "µ")

Cell = str | Text


class Column(NamedTuple):
    """A column: its header, and what Rich is told of it."""

    header: str
    options: dict[str, Any]


def words(*headers: str) -> list[Column]:
    """Columns of words, at the left and never broken."""
    return [Column(header, {"no_wrap": True}) for header in headers]


def numbers(*headers: str) -> list[Column]:
    """Columns of numbers, at the right and never broken."""
    return [Column(header, {"no_wrap": True, "justify": "right"}) for header in headers]


def names(*headers: str) -> list[Column]:
    """Columns of names that somebody else chose and that may be of any length."""
    return [Column(header, {"overflow": "fold", "max_width": _NAME}) for header in headers]


def text(header: str = "") -> list[Column]:
    """A column of text, in what the others leave of 100 columns."""
    return [Column(header, {"overflow": "fold", "ratio": 1, "min_width": _NAME})]


class TableData(NamedTuple):
    """What a table is made of, see :func:`table`.

    Attributes:
        title: Above it.
        columns: What its columns hold.
        rows: A cell a column each.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]


def table(
    title: str,
    columns: Sequence[Column],
    rows: Iterable[Sequence[Cell]],
    *,
    styles: Sequence[str] = (),
    grouped: bool = False,
    legend: str = "",
) -> Table:
    """A table in the house's style; brackets in its texts are brackets.

    Args:
        title: Above it; empty for none.
        columns: Of :func:`words`, :func:`numbers`, :func:`names` and :func:`text`.
        rows: A cell a column each.
        styles: A style a row, such as ``red``; none by default.
        grouped: Whether rows with the same first cell are a group, which names it once.
        legend: Below it.
    """
    shown = Table(
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        show_edge=False,
        title=escape(title) or None,
        title_justify="left",
        title_style="bold",
        caption=escape(legend) or None,
        caption_justify="left",
        caption_style="dim",
        width=WIDTH if any("ratio" in column.options for column in columns) else None,
    )
    for column in columns:
        shown.add_column(escape(column.header), **column.options)
    group: Cell | None = None
    for index, (first, *others) in enumerate(rows):
        same = grouped and first == group
        if grouped and group is not None and not same:
            shown.add_section()
        group = first
        cells = ("" if same else first, *others)
        style = styles[index] if styles else ""
        shown.add_row(
            *(escape(cell) if isinstance(cell, str) else cell for cell in cells), style=style
        )
    return shown


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
