"""Charts of results as figures of the page."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from grosmc_mj.output.palette import (
    BLUE,
    CELLS,
    COLOURS,
    FAILED,
    GREEN,
    KEPT,
    OTHERS,
    VERMILION,
    label_of,
)
from grosmc_mj.output.results.result import CellChart, Chart, GridChart, LineChart, Series

# An object of Plotly's: a trace, a shape or an axis.
Item = dict[str, Any]


class Entry(NamedTuple):
    """Entry of a legend.

    Attributes:
        name: Name of the entry.
        colour: Colour of its sign; ``INK`` for that of the text.
        sign: ``line``, ``dash``, ``dot``, ``area``, or a symbol.
    """

    name: str
    colour: str
    sign: str = "line"


class Figure(NamedTuple):
    """Plotly's figure, and the legend that the page shows above it.

    Attributes:
        data: Traces.
        layout: Layout with its height.
        legend: Entries of the legend.
    """

    data: list[Item]
    layout: Item
    legend: list[Entry]


# The page puts the colour of its text in place of this word.
INK = "ink"
_GREY = "#888888"
_SHADES = (BLUE, VERMILION, GREEN, *OTHERS)
_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "triangle-down")
# Colours of cells: kept, kept in part, and not kept.
_CELL_COLOURS = [[0, CELLS[0]], [0.5, CELLS[1]], [1, CELLS[2]]]
# An axis is logarithmic if its largest number is more than so many times its smallest.
_FAR = 10.0


def chart_figure(chart: Chart) -> Figure:
    """Return the figure of a chart of a result."""
    if isinstance(chart, CellChart):
        return _cells(chart)
    if isinstance(chart, LineChart):
        return _lines(chart)
    return _grid(chart)


def figure_of(
    data: Sequence[Item],
    height: int,
    legend: Sequence[Entry] = (),
    **layout: Any,
) -> Figure:
    """Return a figure from Plotly's traces and options of its layout.

    Args:
        data: The traces.
        height: Height of the figure [pixel].
        legend: Entries of the legend above the figure.
        layout: Further options.
    """
    defaults = {
        "height": height,
        "showlegend": False,
        "margin": {"l": 56, "r": 12, "t": 8, "b": 44},
    }
    return Figure(list(data), defaults | layout, list(legend))


def axis_of(title: str, **options: Any) -> Item:
    """Return an axis with a title."""
    return {"title": {"text": plain_text(title), "standoff": 6}, "automargin": True, **options}


def plain_text(text: str | None) -> str:
    """Escape the tags that Plotly would read in a text."""
    return html.escape(text or "", quote=False)


def _plain_rows(rows: Sequence[Sequence[str | None]]) -> list[list[str]]:
    return [[plain_text(text) for text in row] for row in rows]


def _cells(chart: CellChart) -> Figure:
    """Return the figure of coloured cells."""
    heat_map = {
        "type": "heatmap",
        "x": [plain_text(name) for name in chart.columns],
        "y": [plain_text(name) for name in chart.rows],
        "z": chart.values,
        "zmin": -chart.most,
        "zmax": chart.most,
        "colorscale": _CELL_COLOURS,
        "text": _plain_rows(chart.texts),
        "customdata": _plain_rows(chart.whys),
        "texttemplate": "%{text}",
        "textfont": {"color": "#1d2125"},
        "showscale": False,
        "xgap": 2,
        "ygap": 2,
        "hovertemplate": "%{y}, %{x}: %{text}<br>%{customdata}<extra></extra>",
    }
    return figure_of(
        [heat_map],
        134 + 30 * len(chart.rows),
        xaxis={"side": "top", "type": "category", "tickangle": -35, "automargin": True},
        yaxis={"autorange": "reversed", "type": "category", "automargin": True},
        margin={"l": 110, "r": 20, "t": 90, "b": 8},
    )


def _lines(chart: LineChart) -> Figure:
    """Return the figure of curves: a circle where the requirement holds, a cross where not."""
    limits = [] if chart.limit is None else [chart.limit]
    x_axis = _axis_type(x for series in chart.lines for x in series.x)
    y_values = [y for series in chart.lines for y in series.y]
    y_axis = _axis_type([*y_values, *limits])

    traces = [_series(series, number, x_axis) for number, series in enumerate(chart.lines)]
    shapes = [_dashed({"xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y}) for y in limits]
    # A logarithmic axis has no place for zero.
    marks = [x for x in chart.marks if x_axis != "log" or x > 0]
    shapes += [_dashed({"yref": "paper", "y0": 0, "y1": 1, "x0": x, "x1": x}) for x in marks]
    y_options: Item = {"type": y_axis, "exponentformat": "power"}
    if chart.equal:
        y_options["scaleanchor"] = "x"
    legend: list[Entry] = []
    if len(chart.lines) > 1:
        legend = [_series_entry(series, number) for number, series in enumerate(chart.lines)]
    return figure_of(
        traces,
        340,
        legend,
        shapes=shapes,
        xaxis=axis_of(chart.titles[0], type=x_axis),
        yaxis=axis_of(chart.titles[1], **y_options),
    )


def _axis_type(values: Iterable[float | str | None]) -> str:
    """Return Plotly's type of an axis: category for words, log for numbers that are far apart."""
    numbers: list[float] = []
    for value in values:
        if isinstance(value, str):
            return "category"
        if value is not None:
            numbers.append(value)
    if numbers and min(numbers) > 0 and max(numbers) > _FAR * min(numbers):
        return "log"
    return "linear"


def _series_entry(series: Series, number: int) -> Entry:
    """Return the entry of a series; ``number`` chooses its colour and its symbol."""
    colour = COLOURS.get(series.name, _SHADES[number % len(_SHADES)])
    return Entry(label_of(series.name), colour, _SYMBOLS[number % len(_SYMBOLS)])


def _series(series: Series, number: int, x_axis: str) -> Item:
    """Return the trace of a series; its colour and its symbol are those of its entry."""
    name, colour, symbol = _series_entry(series, number)
    line = {"color": colour}
    marker: Item = {"size": 8 if series.joined else 5}
    if series.good:
        line = {"color": _GREY}
        marker["color"] = [KEPT if good else FAILED for good in series.good]
        marker["symbol"] = [_symbol(good) for good in series.good]
    else:
        marker["color"] = colour
        marker["symbol"] = symbol

    joined = series.joined and x_axis != "category"
    return {
        "type": "scatter",
        "name": plain_text(name),
        "y": series.y,
        "x": [plain_text(x) if isinstance(x, str) else x for x in series.x],
        "mode": "lines+markers" if joined else "markers",
        "text": [plain_text(text) for text in series.texts] or None,
        "line": line,
        "marker": marker,
        "hovertemplate": "%{y:.4g} at %{x} %{text}<extra></extra>",
    }


def _symbol(good: bool | None) -> str:
    """Return the symbol of a point whose requirement holds, does not hold or is not judged."""
    if good is None:
        return "circle-open"
    return "circle" if good else "x"


def _dashed(place: Item) -> Item:
    return {"type": "line", "line": {"color": _GREY, "dash": "dash", "width": 1.4}, **place}


def _grid(chart: GridChart) -> Figure:
    """Return the figure of a plane with a colour for each cell."""
    (x_title, x_end), (y_title, y_end) = chart.axes
    columns = max(map(len, chart.grid), default=0)
    number_of = {entry.letter: number for number, entry in enumerate(chart.legend)}
    count = max(1, len(number_of))

    # A band of one colour for each letter.
    bands = []
    for number, entry in enumerate(chart.legend):
        bands.append([number / count, entry.colour])
        bands.append([(number + 1) / count, entry.colour])

    heat_map = {
        "type": "heatmap",
        "x": _middles(x_end, columns),
        "y": _middles(y_end, len(chart.grid)),
        "z": [[number_of.get(letter) for letter in row.ljust(columns)] for row in chart.grid],
        "zmin": -0.5,
        "zmax": count - 0.5,
        "showscale": False,
        "colorscale": bands or None,
        "hovertemplate": "%{x:.4g}, %{y:.4g}<extra></extra>",
    }
    legend = [Entry(entry.name, entry.colour, "area") for entry in chart.legend]
    return figure_of([heat_map], 420, legend, xaxis=axis_of(x_title), yaxis=axis_of(y_title))


def _middles(end: float, count: int) -> list[float]:
    """Return the middles of so many cells from -end to end."""
    return [end * ((2 * i + 1) / count - 1) for i in range(count)]
