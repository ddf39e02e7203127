"""Charts of the page as Plotly's data: curves of cases, and the charts of results."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any

from grosmc_mj.page.reading import Curve, CurvePanel, Curves, Line, Window
from grosmc_mj.results.palette import (
    BLUE,
    CELLS,
    COLOURS,
    FAILED,
    GREEN,
    KEPT,
    OTHERS,
    PLANTS,
    VERMILION,
)
from grosmc_mj.results.result import CellChart, Chart, GridChart, LineChart, Series

# Plotly's figure: data, and layout with its height.
Figure = dict[str, Any]
# An object of Plotly's: a trace, a shape or an axis.
Item = dict[str, Any]

_GREY = "#888888"
_DASHES = {"physics": "solid", "corrected": "dash", "printed": "dot"}
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


def _figure(
    data: Sequence[Item],
    height: int,
    *,
    legend: bool = True,
    **layout: Any,
) -> Figure:
    defaults = {
        "height": height,
        "showlegend": legend,
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "margin": {"l": 64, "r": 12, "t": 40, "b": 48},
    }
    return {"data": list(data), "layout": defaults | layout}


def _axis(title: str, **options: Any) -> Item:
    return {"title": {"text": _plain(title)}, "automargin": True, **options}


def _plain(text: str | None) -> str:
    """Escape the tags that Plotly would read in a text."""
    return html.escape(text or "", quote=False)


def _plain_rows(rows: Sequence[Sequence[str | None]]) -> list[list[str]]:
    return [[_plain(text) for text in row] for row in rows]


def _cells(chart: CellChart) -> Figure:
    """Return the figure of coloured cells."""
    heat_map = {
        "type": "heatmap",
        "x": [_plain(name) for name in chart.columns],
        "y": [_plain(name) for name in chart.rows],
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
    return _figure(
        [heat_map],
        134 + 30 * len(chart.rows),
        legend=False,
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
    return _figure(
        traces,
        380,
        legend=len(chart.lines) > 1,
        shapes=shapes,
        xaxis=_axis(chart.titles[0], type=x_axis),
        yaxis=_axis(chart.titles[1], **y_options),
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


def _series(series: Series, number: int, x_axis: str) -> Item:
    """Return the trace of a series; ``number`` chooses its colour and its symbol."""
    colour = COLOURS.get(series.name, _SHADES[number % len(_SHADES)])
    line = {"color": colour}
    marker: Item = {"size": 8 if series.joined else 5}
    if series.good:
        line = {"color": _GREY}
        marker["color"] = [KEPT if good else FAILED for good in series.good]
        marker["symbol"] = [_symbol(good) for good in series.good]
    else:
        marker["color"] = colour
        marker["symbol"] = _SYMBOLS[number % len(_SYMBOLS)]

    joined = series.joined and x_axis != "category"
    return {
        "type": "scatter",
        "name": _plain(series.name),
        "y": series.y,
        "x": [_plain(x) if isinstance(x, str) else x for x in series.x],
        "mode": "lines+markers" if joined else "markers",
        "text": [_plain(text) for text in series.texts] or None,
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
    # Plotly has no legend for a heat map: traces without points stand in it.
    keys = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": [None],
            "y": [None],
            "name": _plain(entry.name),
            "marker": {"color": entry.colour, "symbol": "square", "size": 12},
        }
        for entry in chart.legend
    ]
    return _figure([heat_map, *keys], 460, xaxis=_axis(x_title), yaxis=_axis(y_title))


def _middles(end: float, count: int) -> list[float]:
    """Return the middles of so many cells from -end to end."""
    return [end * ((2 * i + 1) / count - 1) for i in range(count)]


def curves_figure(curves: Curves) -> Figure:
    """Return the figure of a case: its panels over one time; the last shape is the cursor."""
    data: list[Item] = []
    annotations: list[Item] = []
    y_axes: dict[str, Any] = {}
    shapes = [_shaded(window) for window in curves.disturbances]

    count = max(1, len(curves.panels))
    in_legend: set[str] = set()
    for index, panel in enumerate(curves.panels):
        number = str(index + 1) if index else ""
        top = 1 - index / count - 0.11 / count
        domain = [max(0.0, top - 0.8 / count), top]
        y_axes[f"yaxis{number}"] = {"domain": domain, "automargin": True}
        annotations.append(_panel_title(panel, top))
        data += _panel(panel, f"y{number}", curves, in_legend)
        if panel.play:
            shapes.append(_play(panel.play, f"y{number}"))

    shapes.append(
        {
            "type": "line",
            "xref": "x",
            "yref": "paper",
            "x0": 0,
            "x1": 0,
            "y0": 0,
            "y1": 1,
            "line": {"color": "#b0006d", "width": 1.5},
        }
    )
    lowest = f"y{count}" if count > 1 else "y"
    return _figure(
        data,
        150 * count + 90,
        shapes=shapes,
        xaxis=_axis("time t [s]", range=[0, curves.duration], anchor=lowest),
        annotations=annotations,
        **y_axes,
    )


def _shaded(window: Window) -> Item:
    """Return the shape that shades the time of a disturbance."""
    return {
        "type": "rect",
        "xref": "x",
        "yref": "paper",
        "x0": window.start,
        "x1": window.stop,
        "y0": 0,
        "y1": 1,
        "fillcolor": GREEN,
        "opacity": 0.16,
        "line": {"width": 0},
        "layer": "below",
        "label": {"text": _plain(window.label), "textposition": "bottom left"},
    }


def _play(play: float, y_axis: str) -> Item:
    """Return the shape that shades a gear's backlash."""
    return {
        "type": "rect",
        "xref": "paper",
        "yref": y_axis,
        "x0": 0,
        "x1": 1,
        "opacity": 0.2,
        "y0": -play / 2,
        "y1": play / 2,
        "fillcolor": _GREY,
    }


def _panel_title(panel: CurvePanel, top: float) -> Item:
    return {
        "text": _plain(panel.label),
        "x": 0,
        "xref": "paper",
        "y": top,
        "yref": "paper",
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
    }


def _panel(
    panel: CurvePanel,
    y_axis: str,
    curves: Curves,
    in_legend: set[str],
) -> list[Item]:
    """Return the traces of a panel.

    Args:
        panel: The panel.
        y_axis: Plotly's name of its axis.
        curves: The case, which has the styles of the laws.
        in_legend: Groups that the legend has already; those of this panel are added.
    """
    traces: list[Item] = []
    for curve in panel.curves:
        traces += _curve(curve, y_axis, curves, in_legend)
    if panel.reference is not None:
        traces.append(_line("reference", panel.reference, _GREY, "dot", y_axis, in_legend))
    for limit in panel.limits:
        name = _plain(limit.words)
        traces.append(_line(name, limit, VERMILION, "longdash", y_axis, in_legend))
    return traces


def _curve(
    curve: Curve,
    y_axis: str,
    curves: Curves,
    in_legend: set[str],
) -> list[Item]:
    """Return the trace of a curve, after that of its range if it has one."""
    style = curves.laws.get(curve.law)
    colour = style.colour if style else _GREY
    law = style.label if style else curve.law
    plant = PLANTS.get(curve.plant, curve.plant)
    label = _plain(", ".join(filter(None, (law, plant, curve.name))))
    group = f"{curve.law} {curve.plant} {curve.name}"
    shared = {
        "type": "scatter",
        "mode": "lines",
        "yaxis": y_axis,
        "name": label,
        "legendgroup": group,
    }

    traces: list[Item] = []
    if curve.range is not None:
        low, high = curve.range
        band = {
            **shared,
            "x": [*curve.t, *reversed(curve.t)],
            "y": [*high, *reversed(low)],
            "fill": "toself",
            "fillcolor": colour + "40",
            "line": {"width": 0},
            "hoverinfo": "skip",
            "showlegend": False,
        }
        traces.append(band)

    dash = "dot" if curve.name == "seen" else _DASHES.get(curve.plant, "solid")
    width = 2.6 if curve.plant == "physics" else 1.4
    trace = {
        **shared,
        "x": curve.t,
        "y": curve.y,
        "showlegend": group not in in_legend,
        "line": {"color": colour, "width": width, "dash": dash},
        "hovertemplate": f"%{{y:.4g}} at %{{x:.3f}} s<extra>{label}</extra>",
    }
    traces.append(trace)
    in_legend.add(group)
    return traces


def _line(
    name: str,
    line: Line,
    colour: str,
    dash: str,
    y_axis: str,
    in_legend: set[str],
) -> Item:
    """Return the trace of a reference or of a limit."""
    trace = {
        "type": "scatter",
        "mode": "lines",
        "yaxis": y_axis,
        "x": line.t,
        "y": line.y,
        "name": name,
        "legendgroup": name,
        "showlegend": name not in in_legend,
        "line": {"color": colour, "width": 1.3, "dash": dash},
    }
    in_legend.add(name)
    return trace
