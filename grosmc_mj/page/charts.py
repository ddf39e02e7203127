"""The page's charts as Plotly's data: curves of cases, and the three forms of charts of results."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any

from grosmc_mj.page.reading import Curve, Curves, Panel
from grosmc_mj.results.palette import BLUE, COLOURS, FAILED, GREEN, KEPT, OTHERS, PLANTS, VERMILION
from grosmc_mj.results.result import CellChart, Chart, GridChart, LineChart

# Plotly's figure: data, layout, and its height.
Figure = dict[str, Any]
_DASHES = {"physics": "solid", "corrected": "dash", "printed": "dot"}
_SHADES = (BLUE, VERMILION, GREEN, *OTHERS)
_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "star", "triangle-down")
# Kept, at the limit and not kept, of cells; axes whose numbers are further apart are logarithmic.
_SCALE, _FAR = [[0, "#7fceb9"], [0.5, "#f4f4f4"], [1, "#f0925a"]], 10.0


def _plain(text: Any) -> str:
    """A text without the tags that Plotly would read."""
    return html.escape(str(text), quote=False)


def chart_figure(chart: Chart) -> Figure:
    """The figure of a chart of a result."""
    if isinstance(chart, CellChart):
        return _cells(chart)
    return _lines(chart) if isinstance(chart, LineChart) else _grid(chart)


def _figure(data: Sequence[Any], height: int, *, legend: bool = True, **layout: Any) -> Figure:
    top = {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0}
    margin = {"l": 64, "r": 12, "t": 40, "b": 48}
    shared = {"height": height, "showlegend": legend, "legend": top, "margin": margin}
    return {"data": list(data), "layout": shared | layout}


def _axis(title: str, **options: Any) -> dict[str, Any]:
    return {"title": {"text": _plain(title)}, "automargin": True, **options}


def _cells(chart: CellChart) -> Figure:
    """Laws by rungs, imperfections or assumptions."""
    heat = {
        "type": "heatmap", "x": [*map(_plain, chart.columns)], "y": [*map(_plain, chart.rows)],
        "z": chart.values, "zmin": -chart.most, "zmax": chart.most, "colorscale": _SCALE,
        "text": [[_plain(text or "") for text in row] for row in chart.texts],
        "customdata": [[_plain(why or "") for why in row] for row in chart.whys],
        "texttemplate": "%{text}", "textfont": {"color": "#1d2125"}, "showscale": False,
        "xgap": 2, "ygap": 2,
        "hovertemplate": "%{y}, %{x}: %{text}<br>%{customdata}<extra></extra>",
    }  # fmt: skip
    return _figure(
        [heat], 134 + 30 * len(chart.rows), legend=False,
        xaxis={"side": "top", "type": "category", "tickangle": -35, "automargin": True},
        yaxis={"autorange": "reversed", "type": "category", "automargin": True},
        margin={"l": 110, "r": 20, "t": 90, "b": 8},
    )  # fmt: skip


def _kind(values: Iterable[Any]) -> str:
    """The kind of axis for values."""
    values = [value for value in values if value is not None]
    if any(isinstance(value, str) for value in values):
        return "category"
    far = bool(values) and min(values) > 0 and max(values) > _FAR * min(values)
    return "log" if far else "linear"


def _lines(chart: LineChart) -> Figure:
    """One quantity over another; a requirement holds at a circle and not at a cross."""
    limits = [] if chart.limit is None else [chart.limit]
    across = _kind(x for line in chart.lines for x in line.x)
    up = _kind([*(y for line in chart.lines for y in line.y), *limits])
    data = []
    for index, line in enumerate(chart.lines):
        colours: Any = COLOURS.get(line.name, _SHADES[index % len(_SHADES)])
        symbols: Any = _SYMBOLS[index % len(_SYMBOLS)]
        if line.good:
            colours = [KEPT if good else FAILED for good in line.good]
            symbols = [{None: "circle-open", True: "circle"}.get(good, "x") for good in line.good]
        data.append({
            "type": "scatter", "name": _plain(line.name), "y": line.y,
            "x": [_plain(x) if isinstance(x, str) else x for x in line.x],
            "mode": "lines+markers" if line.joined and across != "category" else "markers",
            "text": [*map(_plain, line.texts)] or None,
            "line": {"color": "#888888" if line.good else colours},
            "marker": {"size": 8 if line.joined else 5, "color": colours, "symbol": symbols},
            "hovertemplate": "%{y:.4g} at %{x} %{text}<extra></extra>",
        })  # fmt: skip
    dashed = {"type": "line", "line": {"color": "#888888", "dash": "dash", "width": 1.4}}
    shapes = [{**dashed, "xref": "paper", "x0": 0, "x1": 1, "y0": y, "y1": y} for y in limits]
    shapes += [
        {**dashed, "yref": "paper", "y0": 0, "y1": 1, "x0": x, "x1": x}
        for x in chart.marks
        if across != "log" or x > 0
    ]
    titles = chart.titles
    return _figure(
        data, 380, legend=len(chart.lines) > 1, shapes=shapes, xaxis=_axis(titles[0], type=across),
        yaxis=_axis(titles[1], type=up, exponentformat="power"),
    )  # fmt: skip


def _grid(chart: GridChart) -> Figure:
    """A colour for each cell of a plane."""
    numbers = {entry.letter: i for i, entry in enumerate(chart.legend)}
    count = max(1, len(numbers))
    wide = max(map(len, chart.grid), default=0)
    (across, right), (up, top) = chart.axes

    def middles(end: float, n: int) -> list[float]:
        return [end * ((2 * i + 1) / n - 1) for i in range(n)]

    scale = [
        [(i + j) / count, entry.colour] for i, entry in enumerate(chart.legend) for j in (0, 1)
    ]
    heat = {
        "type": "heatmap", "x": middles(right, wide), "y": middles(top, len(chart.grid)),
        "z": [[numbers.get(letter) for letter in row.ljust(wide)] for row in chart.grid],
        "zmin": -0.5, "zmax": count - 0.5, "showscale": False, "colorscale": scale or None,
        "hovertemplate": "%{x:.4g}, %{y:.4g}<extra></extra>",
    }  # fmt: skip
    keys = [
        {"type": "scatter", "mode": "markers", "x": [None], "y": [None], "name": _plain(entry.name),
         "marker": {"color": entry.colour, "symbol": "square", "size": 12}}
        for entry in chart.legend
    ]  # fmt: skip
    return _figure([heat, *keys], 460, xaxis=_axis(across), yaxis=_axis(up))


def curves_figure(curves: Curves) -> Figure:
    """The panels of a case over one time; its last shape is the cursor."""
    data: list[dict[str, Any]] = []
    layout: dict[str, Any] = {"annotations": []}
    count, named = max(1, len(curves.panels)), set[str]()
    shapes = [
        {"type": "rect", "xref": "x", "yref": "paper", "x0": window.start, "x1": window.stop,
         "y0": 0, "y1": 1, "fillcolor": GREEN, "opacity": 0.16, "line": {"width": 0},
         "layer": "below", "label": {"text": _plain(window.label), "textposition": "bottom left"}}
        for window in curves.disturbances
    ]  # fmt: skip
    for index, panel in enumerate(curves.panels):
        axis = f"y{index + 1 if index else ''}"
        top = 1 - index / count - 0.11 / count
        layout[f"yaxis{axis[1:]}"] = {
            "domain": [max(0.0, top - 0.8 / count), top],
            "automargin": True,
        }
        layout["annotations"].append(
            {"text": _plain(panel.label), "x": 0, "xref": "paper", "y": top, "yref": "paper",
             "xanchor": "left", "yanchor": "bottom", "showarrow": False}
        )  # fmt: skip
        data += _panel(panel, axis, curves, named)
        if panel.play:
            shapes.append(
                {"type": "rect", "xref": "paper", "yref": axis, "x0": 0, "x1": 1, "opacity": 0.2,
                 "y0": -panel.play / 2, "y1": panel.play / 2, "fillcolor": "#888888"}
            )  # fmt: skip
    cursor = {"color": "#b0006d", "width": 1.5}
    shapes.append(
        {"type": "line", "xref": "x", "yref": "paper", "x0": 0, "x1": 0, "y0": 0, "y1": 1,
         "line": cursor}
    )  # fmt: skip
    time = _axis("time t [s]", range=[0, curves.duration], anchor=f"y{count if count > 1 else ''}")
    return _figure(data, 150 * count + 90, shapes=shapes, xaxis=time, **layout)


def _panel(panel: Panel, axis: str, curves: Curves, named: set[str]) -> list[dict[str, Any]]:
    """The traces of a panel; a law and a plant stand in the legend once."""
    traces: list[dict[str, Any]] = []
    for curve in panel.curves:
        style, group = curves.laws.get(curve.law), f"{curve.law} {curve.plant} {curve.name}"
        label = _label(curve, curves)
        base = {
            "type": "scatter", "mode": "lines", "yaxis": axis, "name": label, "legendgroup": group,
        }  # fmt: skip
        colour = style.colour if style else "#888888"
        if curve.range is not None:
            low, high = curve.range
            traces.append(
                {**base, "x": [*curve.t, *reversed(curve.t)], "y": [*high, *reversed(low)],
                 "fill": "toself", "fillcolor": colour + "40", "line": {"width": 0},
                 "hoverinfo": "skip", "showlegend": False}
            )  # fmt: skip
        dash = "dot" if curve.name == "seen" else _DASHES.get(curve.plant, "solid")
        width = 2.6 if curve.plant == "physics" else 1.4
        traces.append(
            {**base, "x": curve.t, "y": curve.y, "showlegend": group not in named,
             "line": {"color": colour, "width": width, "dash": dash},
             "hovertemplate": f"%{{y:.4g}} at %{{x:.3f}} s<extra>{label}</extra>"}
        )  # fmt: skip
        named.add(group)
    others = [("reference", panel.reference, "#888888", "dot")] if panel.reference else []
    others += [(_plain(limit.words), limit, VERMILION, "longdash") for limit in panel.limits]
    for name, line, colour, dash in others:
        traces.append(
            {"type": "scatter", "mode": "lines", "yaxis": axis, "x": line.t, "y": line.y,
             "name": name, "legendgroup": name, "showlegend": name not in named,
             "line": {"color": colour, "width": 1.3, "dash": dash}}
        )  # fmt: skip
        named.add(name)
    return traces


def _label(curve: Curve, curves: Curves) -> str:
    style = curves.laws.get(curve.law)
    parts = (style.label if style else curve.law, PLANTS.get(curve.plant, curve.plant), curve.name)
    return _plain(", ".join(filter(None, parts)))
