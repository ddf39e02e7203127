"""Charts of a result's cells, curves and maps: their colours, symbols and scales."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import cycle
from typing import NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.charts.chart import (
    Cells,
    Chart,
    ChartAxis,
    Curve,
    Layer,
    LevelLine,
    Marks,
    Outline,
    Panel,
    Symbol,
    Tiles,
    column_name,
    level_line,
)
from grosmc_mj.output.palette import (
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    INK,
    ORANGE,
    OTHERS,
    PURPLE,
    SKY,
    VERMILION,
    Stroke,
)
from grosmc_mj.output.results.result import CellChart, GridChart, LineChart, ResultChart, Series

# Width and height of a cell, and of a panel of curves or of a map; width of the rows' names [inch].
_CELL = (0.72, 0.32)
_PANEL = (3.8, 3.1)
_ROW_NAMES = 1.9
# Least number of columns that a figure has room for.
_FEWEST_COLUMNS = 4
# Colours and symbols of curves that are no laws, in turn.
_COLOURS = (*OTHERS, BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE, GREY)
_SYMBOLS: Sequence[Symbol] = (
    "circle",
    "square",
    "diamond",
    "triangle-up",
    "cross",
    "star",
    "triangle-down",
)
_CURVE = 1.4
# Line of a bound, and size of the mark of a point [point].
_BOUND = Stroke(INK, 0.9, "dash")
_POINT = 8.0
# Ticks for which an axis has room.
_MOST_TICKS = 12
# An axis is logarithmic if its largest number is more than so many times its smallest.
_FAR = 10.0


def chart_of(chart: ResultChart, beside: Iterable[ResultChart] = ()) -> Chart:
    """Return one chart of a result.

    Args:
        chart: The chart.
        beside: All charts of its table, in which a curve has one colour and one symbol.
    """
    if isinstance(chart, CellChart):
        return cells_chart("", [chart], "")
    return _panels("", [[chart]], _styles(_names_in([*beside, chart])))


# -- cells -----------------------------------------------------------------------------------------


def cells_chart(title: str, charts: Sequence[CellChart], note: str) -> Chart:
    """Return charts of cells below each other, of which there is at least one."""
    most_columns = max(_FEWEST_COLUMNS, *(len(chart.columns) for chart in charts))
    heights = [_height_in_cells(chart) for chart in charts]
    width = _CELL[0] * most_columns + _ROW_NAMES
    rows = [[_cells_panel(chart)] for chart in charts]
    return Chart(rows, title=title, size=(width, _CELL[1] * sum(heights) + 1.1), note=note)


def _height_in_cells(chart: CellChart) -> float:
    """Return the height of a chart with its title and the names of its columns, in cells."""
    names = [column_name(name) for name in chart.columns]
    breaks = max((name.count("\n") for name in names), default=0)
    return len(chart.rows) + 1.2 + 0.6 * (1 + breaks)


def _cells_panel(chart: CellChart) -> Panel:
    """Return the panel of cells."""
    cells = Cells(
        rows=chart.rows,
        columns=chart.columns,
        values=chart.values,
        texts=chart.texts,
        whys=chart.whys,
        most=chart.most,
    )
    return Panel([cells], name=chart.name, height=len(chart.rows))


# -- curves and maps -------------------------------------------------------------------------------


def panels_chart(title: str, rows: Sequence[Sequence[LineChart | GridChart]]) -> Chart:
    """Return charts of curves or of maps in rows, with one legend.

    Args:
        title: Title.
        rows: The charts of each row. Maps show the outline of the first row's map above them.
    """
    return _panels(title, rows, _styles(_names_in(chart for row in rows for chart in row)))


def _names_in(charts: Iterable[ResultChart]) -> list[str]:
    """Return the names of all curves that need a colour, each once."""
    names: dict[str, None] = {}
    for chart in charts:
        if isinstance(chart, LineChart):
            curves = [series.name for series in chart.lines if not series.bound]
            names.update(dict.fromkeys(curves))
    return list(names)


def _panels(
    title: str,
    rows: Sequence[Sequence[LineChart | GridChart]],
    styles: Mapping[str, _SeriesStyle],
) -> Chart:
    """Return charts in rows, whose curves have these styles."""
    panels: list[list[Panel]] = []
    for row in rows:
        in_row = []
        # After an interrupt the last row has fewer charts than the first.
        for chart, top in zip(row, rows[0], strict=False):
            if isinstance(chart, LineChart):
                in_row.append(_lines_panel(chart, styles))
            else:
                above = top if panels and isinstance(top, GridChart) else None
                in_row.append(_map_panel(chart, above))
        panels.append(in_row)

    columns = max(len(row) for row in rows)
    size = (_PANEL[0] * columns, _PANEL[1] * len(rows) + 0.9)
    return Chart(panels, title=title, size=size)


class _SeriesStyle(NamedTuple):
    """Colour and symbol of a curve."""

    colour: str
    symbol: Symbol


def _styles(names: Sequence[str]) -> dict[str, _SeriesStyle]:
    """Return a style for each name: laws have their colours."""
    used = {COLOURS[name] for name in names if name in COLOURS}
    free = cycle([colour for colour in _COLOURS if colour not in used])
    styles = {}
    for place, name in enumerate(names):
        colour = COLOURS.get(name) or next(free)
        styles[name] = _SeriesStyle(colour, _SYMBOLS[place % len(_SYMBOLS)])
    return styles


def _lines_panel(chart: LineChart, styles: Mapping[str, _SeriesStyle]) -> Panel:
    """Return the panel of curves with their limit and marks."""
    x_axis = _x_axis(chart)
    layers: list[Layer] = []
    for series in chart.lines:
        if series.bound:
            y = [math.nan if value is None else value for value in series.y]
            layers.append(Curve(series.x, y, _BOUND, name=series.name))
        else:
            layers += _series_layers(series, styles[series.name], x_axis)
    for x, y in chart.points:
        layers.append(Marks([x], [y], INK, "x", size=_POINT))

    for mark in chart.marks:
        # A logarithmic axis has no place for zero.
        if x_axis.scale != "log" or mark > 0:
            layers.append(LevelLine("x", mark, _BOUND))
    values = [y for series in chart.lines for y in series.y if y is not None]
    if chart.limit is not None:
        layers.append(level_line(chart.limit))
        values.append(chart.limit)

    far = _spans_decades(values) and not chart.equal
    y_axis = ChartAxis(chart.titles[1], "log" if far else "linear")
    return Panel(layers, x_axis, y_axis, name=chart.name, equal=chart.equal)


def _x_axis(chart: LineChart) -> ChartAxis:
    """Return the first axis: words in their order, or numbers."""
    title = chart.titles[0]
    values = {x: None for series in chart.lines for x in series.x}
    if any(isinstance(x, str) for x in values):
        return ChartAxis(title, ticks={float(i): str(word) for i, word in enumerate(values)})

    numbers = [float(x) for x in values]
    if chart.equal or not _spans_decades(numbers):
        return ChartAxis(title)
    if not _have_room(numbers):
        return ChartAxis(title, "log")
    return ChartAxis(title, "log", ticks={x: f"{x:g}" for x in sorted(numbers)})


def _have_room(numbers: Collection[float]) -> bool:
    """Return True if each of some positive numbers can have a tick on a logarithmic axis."""
    places = np.log(sorted(numbers))
    nearest = np.diff(places).min()
    return bool(nearest * _MOST_TICKS >= places[-1] - places[0])


def _spans_decades(numbers: Collection[float]) -> bool:
    """Return True if numbers are positive and far apart."""
    if not numbers:
        return False
    return min(numbers) > 0 and max(numbers) > _FAR * min(numbers)


def _series_layers(series: Series, style: _SeriesStyle, x_axis: ChartAxis) -> list[Layer]:
    """Return a curve, with hollow symbols where its requirement fails."""
    place_of = {word: place for place, word in x_axis.ticks.items()}
    x = [place_of[value] if isinstance(value, str) else value for value in series.x]
    y = [math.nan if value is None else value for value in series.y]
    failed = [i for i, good in enumerate(series.good) if good is False]
    words = any(isinstance(value, str) for value in series.x)
    joined = series.joined and not words
    layers: list[Layer] = [
        Curve(
            x,
            y,
            Stroke(style.colour, _CURVE if joined else 0.0),
            symbol=style.symbol,
            hollow=failed if series.good or not joined else None,
            texts=series.texts,
            name=series.name,
        )
    ]

    # A run that ended early has no value: its mark stands at the lower edge.
    ended = [x[i] for i in failed if series.y[i] is None]
    if ended:
        layers.append(Marks(ended, None, style.colour, "triangle-up", hollow=True))
    return layers


def _map_panel(chart: GridChart, top: GridChart | None) -> Panel:
    """Return the panel of a map, with the outline of the top row's map."""
    letters = {entry.letter: number for number, entry in enumerate(chart.legend)}
    columns = max(map(len, chart.grid), default=0)
    numbers = [
        [letters.get(letter, math.nan) for letter in row.ljust(columns)] for row in chart.grid
    ]
    (x_title, x_end), (y_title, y_end) = chart.axes
    x = x_end * np.linspace(-1, 1, columns + 1)
    y = y_end * np.linspace(-1, 1, len(chart.grid) + 1)
    colours = [(entry.name, entry.colour) for entry in chart.legend]
    layers: list[Layer] = [Tiles(x, y, np.array(numbers, float), colours)]
    if top is not None:
        layers += _outlines(top, x, y)
    return Panel(layers, ChartAxis(x_title), ChartAxis(y_title), name=chart.name)


def _outlines(top: GridChart, x: Array, y: Array) -> list[Layer]:
    """Return the edge of the first letter of a map, if it is in some of it."""
    best = top.legend[0]
    inside = np.array([[float(letter == best.letter) for letter in row] for row in top.grid])
    if not 0 < inside.mean() < 1:
        return []
    columns, rows = [(edges[:-1] + edges[1:]) / 2 for edges in (x, y)]
    return [Outline(columns, rows, inside, name=f"edge of {best.name} in the top row")]
