"""A study on the page: a table, and charts of one of three forms to choose from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

# Of a chart, as ``page.js`` draws it.
Chart = Mapping[str, Any]
# A table of so many rows is open from the start.
_SHORT = 12


class Sheet(NamedTuple):
    """What a study found.

    Attributes:
        title: Above it.
        note: What its words mean.
        head: Of the table's columns; the first names the row.
        rows: The table's cells.
        charts: To choose from; none where a table says it all.
    """

    title: str
    note: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    charts: Sequence[Chart] = ()

    @property
    def told(self) -> bool:
        """Whether the first chart has the table's texts in its cells."""
        return bool(self.charts) and self.charts[0]["form"] == "cells"

    @property
    def open(self) -> bool:
        """Whether the table is open from the start."""
        return not self.told and (not self.charts or len(self.rows) <= _SHORT)


def cells_chart(
    name: str, cells: Mapping[tuple[str, str], tuple[float, str, str]], most: float
) -> Chart:
    """Rows by columns: a cell is blue below zero and red above it, as far as ``most``.

    Args:
        name: Of the chart.
        cells: By row and column a value, its text, and what more there is to say.
        most: Of the values.
    """
    rows, columns = (list(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))

    def grid(part: int) -> Sequence[Sequence[Any]]:
        return [
            [cells[row, x][part] if (row, x) in cells else None for x in columns] for row in rows
        ]

    return {
        "form": "cells",
        "name": name,
        "rows": rows,
        "columns": columns,
        "values": grid(0),
        "texts": grid(1),
        "whys": grid(2),
        "most": most,
    }


def told_sheet(title: str, note: str, first: str, chart: Chart) -> Sheet:
    """A sheet whose table has the texts of a chart of cells."""
    rows = [
        [row, *("" if text is None else text for text in texts)]
        for row, texts in zip(chart["rows"], chart["texts"], strict=True)
    ]
    return Sheet(title, note, [first, *chart["columns"]], rows, [chart])


class Line(NamedTuple):
    """Points of a chart, joined if there are several.

    Attributes:
        name: In the legend.
        x: Numbers or words.
        y: None where there is none.
        texts: Of each point; empty for none.
        good: Whether what was asked for holds at each point; empty where nothing was.
    """

    name: str
    x: Sequence[float | str]
    y: Sequence[float | None]
    texts: Sequence[str] = ()
    good: Sequence[bool | None] = ()


def lines_chart(
    name: str,
    titles: tuple[str, str],
    lines: Sequence[Line],
    *,
    limit: float | None = None,
    marks: Sequence[float] = (),
) -> Chart:
    """One quantity over another; an axis whose numbers are far apart is logarithmic.

    Args:
        name: Of the chart.
        titles: Of the axes.
        lines: What is drawn.
        limit: Dashed along the first axis.
        marks: Dotted along the second one.
    """
    return {
        "form": "lines",
        "name": name,
        "titles": titles,
        "lines": [each._asdict() for each in lines],
        "limit": limit,
        "marks": list(marks),
    }


def grid_chart(
    name: str,
    axes: Sequence[tuple[str, float]],
    grid: Sequence[str],
    legend: Mapping[str, tuple[str, str]],
) -> Chart:
    """A letter for each cell of a plane.

    Args:
        name: Of the chart.
        axes: Title of each, and the end that it has to both sides.
        grid: A string for each value of the second axis, from the lowest.
        legend: By letter its name and colour.
    """
    return {
        "form": "grid",
        "name": name,
        "axes": axes,
        "grid": list(grid),
        "legend": [{"letter": x, "name": n, "colour": c} for x, (n, c) in legend.items()],
    }
