"""Charts as figures of the page by Plotly: panels below each other, with the legend above them."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from plotly.offline import get_plotlyjs

from grosmc_mj.output.charts.chart import (
    Band,
    Cells,
    Chart,
    ChartAxis,
    Curve,
    Layer,
    LegendEntry,
    LevelLine,
    Marks,
    Outline,
    Panel,
    Span,
    Tiles,
)
from grosmc_mj.output.palette import CELLS, GREY, INK, Stroke
from grosmc_mj.output.results.tables import number

# An object of Plotly's: a trace, a shape, an annotation or an axis.
Item = dict[str, Any]

# Heights of curves, of a map, and of cells with their names and rows [pixel].
_LINES = 340
_MAP = 420
_CELL_NAMES = 134
_CELL_ROW = 30
# Heights of one of several panels, of its title, and of the axis that they share [pixel].
_PANEL = 150
_TITLE = 34
_SHARED_AXIS = 42
_PIXELS_PER_POINT = 4 / 3
# Curves that have a symbol have about so many.
_SYMBOLS = 10
# Texts of levels are no nearer to each other than this share of the axis.
_APART = 0.12
_CELL_INK = "#1d2125"
# Colours of cells: kept, kept in part, and not kept.
_CELL_COLOURS = [[0, CELLS[0]], [0.5, CELLS[1]], [1, CELLS[2]]]
# Sign of a point at the lower edge.
_EDGE_SYMBOL = "△"


class PageFigure(NamedTuple):
    """Plotly's figure, and the legend that the page shows above it.

    Attributes:
        data: Traces.
        layout: Layout with its height.
        legend: Entries of the legend.
    """

    data: list[Item]
    layout: Item
    legend: list[LegendEntry]


def plotly_script() -> str:
    """Return the JavaScript that draws the figures."""
    return get_plotlyjs()


def page_figure(chart: Chart) -> PageFigure:
    """Return the figure of a chart; the page has its title and its note."""
    panels = chart.panels
    stacked = "x" in chart.shared
    area = len(panels) * (_TITLE + _PANEL)
    layout: Item = {"showlegend": False, "shapes": [], "annotations": []}
    data: list[Item] = []
    for index, panel in enumerate(panels):
        drawn = _DrawnPanel(panel, index, stacked=stacked)
        data += drawn.traces()
        layout["shapes"] += drawn.shapes()
        layout["annotations"] += drawn.texts()
        top = 1 - (index * (_TITLE + _PANEL) + _TITLE) / area
        domain = [max(0.0, top - _PANEL / area), top] if stacked else [0, 1]
        layout |= drawn.axes(domain, lowest=panel is panels[-1])

    layout |= _margins(panels, stacked=stacked)
    entries = chart.entries
    if entries is None:
        entries = _entries(panels)
    return PageFigure(data, layout, list(entries))


def _margins(panels: Sequence[Panel], *, stacked: bool) -> Item:
    """Return height and margins of a figure."""
    if stacked:
        height = len(panels) * (_TITLE + _PANEL) + _SHARED_AXIS
        return {"height": height, "margin": {"l": 62, "r": 58, "t": 0, "b": _SHARED_AXIS}}

    height = _LINES
    for layer in panels[0].layers:
        if isinstance(layer, Cells):
            height = _CELL_NAMES + _CELL_ROW * len(layer.rows)
            return {"height": height, "margin": {"l": 110, "r": 20, "t": 90, "b": 8}}
        if isinstance(layer, Tiles):
            height = _MAP
    return {"height": height, "margin": {"l": 56, "r": 12, "t": 8, "b": 44}}


def _entries(panels: Sequence[Panel]) -> list[LegendEntry]:
    """Return the entries of all layers with names; none for a single one without hollow symbols."""
    entries: dict[str, LegendEntry] = {}
    hollow = False
    for panel in panels:
        for layer in panel.layers:
            entries |= {entry.name: entry for entry in _layer_entries(layer)}
            hollow |= isinstance(layer, Curve) and bool(layer.hollow)
    return list(entries.values()) if len(entries) > 1 or hollow else []


def _layer_entries(layer: Layer) -> Iterator[LegendEntry]:
    """Yield the entries of a layer."""
    match layer:
        case Tiles():
            for name, colour in layer.colours:
                yield LegendEntry(name, colour, "area")
        case Curve(name=name) if name:
            sign = "line" if layer.stroke.dash == "solid" else layer.stroke.dash
            yield LegendEntry(name, layer.stroke.colour, layer.symbol or sign)
        case LevelLine(name=name) if name:
            yield LegendEntry(name, layer.stroke.colour, layer.stroke.dash)
        case Band(name=name, colour=colour) | Span(name=name, colour=colour) if name:
            yield LegendEntry(name, colour, "area")
        case Marks(name=name, colour=colour, symbol=symbol) if name:
            yield LegendEntry(name, colour, symbol)


def plain_text(text: str | None) -> str:
    """Escape the tags that Plotly would read in a text."""
    return html.escape(text or "", quote=False)


def _plain_rows(rows: Sequence[Sequence[str | None]]) -> list[list[str]]:
    return [[plain_text(text) for text in row] for row in rows]


# -- panels ----------------------------------------------------------------------------------------


class _DrawnPanel:
    """A panel on axes of a figure.

    Args:
        panel: The panel.
        index: Its place in the figure, from the top.
        stacked: Whether it is one of panels below each other that share the first axis.
    """

    def __init__(self, panel: Panel, index: int, *, stacked: bool) -> None:
        self._panel = panel
        self._stacked = stacked
        number_of_axis = str(index + 1) if index else ""
        self._y = f"y{number_of_axis}"
        self._y_key = f"yaxis{number_of_axis}"

    def axes(self, domain: Sequence[float], *, lowest: bool) -> Item:
        """Return the axes of the layout; panels that share the first one have it at the lowest."""
        panel = self._panel
        x_axis = _axis(panel.x)
        y_axis = _axis(panel.y)
        for layer in panel.layers:
            if isinstance(layer, Cells):
                x_axis = {"side": "top", "type": "category", "tickangle": -35, "automargin": True}
                y_axis = {"autorange": "reversed", "type": "category", "automargin": True}
        if panel.equal:
            y_axis["scaleanchor"] = "x"
        if not self._stacked:
            return {"xaxis": x_axis, "yaxis": y_axis}

        # Its title stands above the panel.
        y_axis = {key: value for key, value in y_axis.items() if key != "title"}
        layout = {self._y_key: {**y_axis, "domain": domain, "nticks": 6}}
        if lowest:
            layout["xaxis"] = {**x_axis, "anchor": self._y}
        return layout

    def traces(self) -> Iterator[Item]:
        """Yield the traces; bands lie below all curves."""
        layers = self._panel.layers
        bands = [layer for layer in layers if isinstance(layer, Band)]
        for layer in [*bands, *(layer for layer in layers if not isinstance(layer, Band))]:
            for trace in _traces(layer, self._panel):
                yield {**trace, "yaxis": self._y}

    def shapes(self) -> Iterator[Item]:
        """Yield the shapes of spans and levels."""
        for layer in self._panel.layers:
            if isinstance(layer, Span):
                yield {
                    "type": "rect",
                    **self._across(layer.along, layer.start, layer.stop),
                    "fillcolor": _ground(layer.colour),
                    "opacity": layer.opacity,
                    "line": {"width": 0},
                    "layer": "below",
                }
            elif isinstance(layer, LevelLine):
                line = _line(layer.stroke)
                yield {
                    "type": "line",
                    **self._across(layer.along, layer.value, layer.value),
                    "line": line,
                }

    def _across(self, along: str, start: float, stop: float) -> Item:
        """Return the corners of a part of an axis, over all of the other axis."""
        panel = self._panel
        if along == "x":
            first, last = _placed(panel.x, [start, stop])
            return {"xref": "x", "x0": first, "x1": last, "yref": f"{self._y} domain"} | {
                "y0": 0,
                "y1": 1,
            }
        first, last = _placed(panel.y, [start, stop])
        return {"xref": "paper", "x0": 0, "x1": 1, "yref": self._y, "y0": first, "y1": last}

    def texts(self) -> Iterator[Item]:
        """Yield title and remark above a panel, texts beside its marks and at its levels."""
        panel = self._panel
        above = {"xref": "paper", "yref": f"{self._y} domain", "y": 1, "yshift": 3}
        above |= {"yanchor": "bottom", "showarrow": False}
        if self._stacked:
            yield {"text": plain_text(panel.y.title), "x": 0, "xanchor": "left", **above}
        if panel.remark:
            remark = plain_text(panel.remark).replace("\n", "<br>")
            yield {"text": remark, "x": 1, "xanchor": "right", **above}
        for layer in panel.layers:
            if isinstance(layer, Marks):
                yield from self._mark_texts(layer)
        yield from self._notes()

    def _mark_texts(self, marks: Marks) -> Iterator[Item]:
        """Yield the signs of points at the lower edge."""
        if marks.y is not None:
            return
        for x in _placed(self._panel.x, marks.x):
            # An annotation has the logarithm of its place.
            place = math.log10(x) if self._panel.x.scale == "log" else x
            yield {
                "text": _EDGE_SYMBOL,
                "font": {"color": marks.colour, "size": 14},
                "xref": "x",
                "x": place,
                "yref": f"{self._y} domain",
                "y": 0.03,
                "showarrow": False,
            }

    def _notes(self) -> Iterator[Item]:
        """Yield the texts at the ends of level lines, with an arrow at those beyond the axis."""
        low = self._panel.y.low
        high = self._panel.y.high
        if low is None or high is None:
            return
        taken: list[float] = []
        for layer in self._panel.layers:
            if not isinstance(layer, Curve) or not layer.note:
                continue
            value = float(layer.y[-1])
            place = (min(max(value, low), high) - low) / (high - low)
            if any(abs(place - other) <= _APART for other in taken):
                continue
            taken.append(place)
            arrow = {1.0: "↑ ", 0.0: "↓ "}.get(place, "")
            yield {
                "text": plain_text(arrow + layer.note),
                "xref": "paper",
                "x": 1,
                "xanchor": "left",
                "xshift": 4,
                "yref": f"{self._y} domain",
                "y": place,
                "yanchor": "middle",
                "showarrow": False,
            }


def _axis(axis: ChartAxis) -> Item:
    """Return an axis with its title."""
    item: Item = {
        "title": {"text": plain_text(axis.title), "standoff": 6},
        "automargin": True,
        "type": "log" if axis.scale == "log" else "linear",
        "exponentformat": "power",
    }
    ticks = axis.ticks
    if axis.scale == "symlog":
        ticks = {value: number(value) for value in _symlog_ticks(axis)}
    if ticks:
        item["tickvals"] = _placed(axis, ticks)
        item["ticktext"] = [plain_text(text) for text in ticks.values()]
    if axis.low is not None and axis.high is not None:
        ends = _placed(axis, [axis.low, axis.high])
        item["range"] = [math.log10(end) for end in ends] if axis.scale == "log" else ends
    return item


def _placed(axis: ChartAxis, values: Iterable[float]) -> list[float]:
    """Return the places of values on an axis; Plotly has no scale that is linear about zero."""
    if axis.scale != "symlog":
        return [float(value) for value in values]
    places = np.arcsinh(np.array([*values], float) / axis.linear)
    return places.tolist()


def _symlog_ticks(axis: ChartAxis) -> list[float]:
    """Return powers of ten to both sides of zero."""
    powers = [axis.linear * 10.0**power for power in range(1, 13, 2)]
    return [*(-power for power in reversed(powers)), 0.0, *powers]


# -- layers ----------------------------------------------------------------------------------------


def _traces(layer: Layer, panel: Panel) -> Iterator[Item]:
    """Yield the traces of a layer."""
    match layer:
        case Curve():
            yield _curve(layer, panel)
        case Band():
            yield _band(layer, panel)
        case Marks(y=y) if y is not None:
            yield _marks(layer, panel)
        case Cells():
            yield _cells(layer)
        case Tiles():
            yield _tiles(layer)
        case Outline():
            yield {
                "type": "contour",
                "x": layer.x,
                "y": layer.y,
                "z": layer.inside,
                "contours": {"start": 0.5, "end": 0.5, "coloring": "lines"},
                "showscale": False,
                "line": {"color": "white", "width": 2.5},
                "hoverinfo": "skip",
            }


def _line(stroke: Stroke) -> Item:
    """Return the style of a line."""
    width = round(_PIXELS_PER_POINT * stroke.width, 1)
    return {"color": stroke.colour, "width": width, "dash": stroke.dash}


def _curve(curve: Curve, panel: Panel) -> Item:
    """Return the trace of a curve with its symbols."""
    modes = []
    if curve.stroke.width:
        modes.append("lines")
    if curve.symbol:
        modes.append("markers")
    name = plain_text(curve.name)
    trace: Item = {
        "type": "scatter",
        "mode": "+".join(modes),
        "name": name,
        "x": _placed(panel.x, curve.x),
        "y": _finite(_placed(panel.y, curve.y)),
        "opacity": curve.stroke.opacity,
        "line": _line(curve.stroke),
        "text": [plain_text(text) for text in curve.texts] or None,
        "hovertemplate": f"%{{y:.4g}} at %{{x:.4g}} %{{text}}<extra>{name}</extra>",
    }
    if not curve.texts:
        trace["hovertemplate"] = f"%{{y:.4g}} at %{{x:.4g}}<extra>{name}</extra>"
    if curve.symbol:
        trace["marker"] = _marker(curve)
    return trace


def _marker(curve: Curve) -> Item:
    """Return the symbols of a curve: some of many, or each where some are hollow."""
    marker: Item = {"color": curve.stroke.colour, "size": 8, "symbol": curve.symbol}
    if curve.hollow is not None:
        hollow = set(curve.hollow)
        marker["symbol"] = [
            f"{curve.symbol}-open" if i in hollow else curve.symbol for i in range(len(curve.x))
        ]
    elif len(curve.x) > 2 * _SYMBOLS:
        marker["maxdisplayed"] = _SYMBOLS
    return marker


def _finite(values: Sequence[float]) -> list[float | None]:
    """Return numbers with None for NaN."""
    return [None if math.isnan(value) else value for value in values]


def _band(band: Band, panel: Panel) -> Item:
    """Return the trace of an area between two curves."""
    x = _placed(panel.x, band.x)
    low = _placed(panel.y, band.low)
    high = _placed(panel.y, band.high)
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [*x, *reversed(x)],
        "y": [*high, *reversed(low)],
        "fill": "toself",
        "fillcolor": f"{_ground(band.colour)}{round(255 * band.opacity):02x}",
        "line": {"width": 0},
        "hoverinfo": "skip",
    }


def _ground(colour: str) -> str:
    """Return the colour of an area, which is the same on a light and on a dark page."""
    return GREY if colour == INK else colour


def _marks(marks: Marks, panel: Panel) -> Item:
    """Return the trace of points."""
    symbol = f"{marks.symbol}-open" if marks.hollow else marks.symbol
    size = round(_PIXELS_PER_POINT * marks.size, 1)
    name = plain_text(marks.name)
    return {
        "type": "scatter",
        "mode": "markers+text" if marks.text else "markers",
        "name": name,
        "x": _placed(panel.x, marks.x),
        "y": _placed(panel.y, marks.y),
        "text": [plain_text(marks.text)] * len(marks.x),
        "textposition": "top right",
        "marker": {"color": marks.colour, "symbol": symbol, "size": size},
        "hovertemplate": f"%{{y:.4g}} at %{{x:.4g}}<extra>{name}</extra>",
    }


def _cells(cells: Cells) -> Item:
    """Return the trace of coloured cells."""
    return {
        "type": "heatmap",
        "x": [plain_text(name) for name in cells.columns],
        "y": [plain_text(name) for name in cells.rows],
        "z": cells.values,
        "zmin": -cells.most,
        "zmax": cells.most,
        "colorscale": _CELL_COLOURS,
        "text": _plain_rows(cells.texts),
        "customdata": _plain_rows(cells.whys),
        "texttemplate": "%{text}",
        "textfont": {"color": _CELL_INK},
        "showscale": False,
        "xgap": 2,
        "ygap": 2,
        "hovertemplate": "%{y}, %{x}: %{text}<br>%{customdata}<extra></extra>",
    }


def _tiles(tiles: Tiles) -> Item:
    """Return the trace of a plane with a colour for each cell."""
    return {
        "type": "heatmap",
        "x": _middles(tiles.x),
        "y": _middles(tiles.y),
        "z": [_finite(row) for row in tiles.numbers.tolist()],
        "zmin": -0.5,
        "zmax": max(1, len(tiles.colours)) - 0.5,
        "showscale": False,
        "colorscale": _colour_scale([colour for _, colour in tiles.colours]) or None,
        "hovertemplate": "%{x:.4g}, %{y:.4g}<extra></extra>",
    }


def _middles(edges: np.ndarray) -> list[float]:
    """Return the middles of cells between edges."""
    # Halves first: the sum of two large numbers may not be finite.
    return (edges[:-1] / 2 + edges[1:] / 2).tolist()


def _colour_scale(colours: Sequence[str]) -> list[list[Any]]:
    """Return a band of each colour."""
    bands = []
    for place, colour in enumerate(colours):
        bands.append([place / len(colours), colour])
        bands.append([(place + 1) / len(colours), colour])
    return bands
