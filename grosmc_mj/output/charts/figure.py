"""Charts as printed figures by Matplotlib: PNG and SVG, written whole or not at all."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import NullLocator

from grosmc_mj.ground.files import atomic_write
from grosmc_mj.output.charts.chart import (
    Band,
    Cells,
    Chart,
    ChartAxis,
    Curve,
    Layer,
    LevelLine,
    Marks,
    Outline,
    Panel,
    Span,
    Symbol,
    Tiles,
    column_name,
    in_lines,
    letters_in,
)
from grosmc_mj.output.palette import BLACK, CELLS, FAILED, GRID, INK, Dash, Stroke

# Sizes of letters [point].
_TITLE_SIZE = 12.5
_PANEL_TITLE_SIZE = 11
_LEGEND_SIZE = 8.5
_NOTE_SIZE = 9
_REMARK_SIZE = 8
# Part of their size by which values differ that are one number, and the room around them.
_ROUNDING = 1e-4
_ROOM = 0.1
# Share of a panel's part of the figure that its title has, beside the names of its axis.
_TITLE_SHARE = 0.85
# Width of a legend beside the panels [inch].
LEGEND_BESIDE = 1.6
# Width of a legend's line and of the space around its label, in letters.
_HANDLE = 7
_MOST_COLUMNS = 3
_NOTE_INK = "#444444"
_EMPTY_CELL = "#eeeeee"
# A layer of more points is a picture in an SVG.
_MOST_POINTS = 1000
# Place of a mark at the lower edge, as a part of the panel's height.
_EDGE = 0.03
ENDINGS = (".png", ".svg")

_SYMBOLS: Mapping[Symbol, str] = {
    "": "",
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle-up": "^",
    "cross": "P",
    "star": "*",
    "triangle-down": "v",
    "x": "X",
}
_DASHES: Mapping[Dash, Any] = {
    "solid": "-",
    "dash": (0, (4, 2)),
    "dot": (0, (1, 1.6)),
    "dashdot": (0, (5, 2, 1, 2)),
    "longdash": (0, (8, 3)),
    "longdashdot": (0, (8, 3, 1, 3)),
}
# Layers from the lowest to the highest kind.
_ORDER: Sequence[type[Layer]] = (Cells, Tiles, Span, Band, Curve, LevelLine, Outline, Marks)
# Colours of cells: kept, in some draws, and not kept.
_CELL_COLOURS = LinearSegmentedColormap.from_list("kept", CELLS)

# Matplotlib's own settings: without them a matplotlibrc, such as one in the working folder, counts.
DEFAULTS: dict[Any, Any] = {
    name: value for name, value in mpl.rcParamsDefault.items() if not name.startswith("backend")
}
_STYLE: dict[Any, Any] = {
    **DEFAULTS,
    "font.size": 10,
    "axes.titlesize": _PANEL_TITLE_SIZE,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "legend.fontsize": _LEGEND_SIZE,
    "legend.framealpha": 0.9,
    "savefig.dpi": 150,
    "svg.hashsalt": "grosmc_mj",
    "figure.constrained_layout.use": True,
}


def write_chart(chart: Chart, path: Path, suffixes: Sequence[str] = ENDINGS) -> Path:
    """Write a chart as a figure, to all of its files or to none; return the path.

    The files have no date in them: the same chart gives the same bytes.

    Args:
        chart: The chart.
        path: Path of the PNG; the SVG lies beside it.
        suffixes: Kinds of files to write, of ``.png`` and ``.svg``.

    Raises:
        SetupError: If a file cannot be written.
    """
    figure = drawn(chart)
    with mpl.rc_context(_STYLE), contextlib.ExitStack() as stack:
        for suffix in suffixes:
            part = stack.enter_context(atomic_write(path.with_suffix(suffix)))
            dated_by = "Date" if suffix == ".svg" else "Software"
            figure.savefig(part, format=suffix[1:], metadata={dated_by: None})
            # All files have the layout of the first.
            figure.set_layout_engine("none")
    return path


def drawn(chart: Chart) -> Figure:
    """Return Matplotlib's figure of a chart."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=chart.size)
        columns = max(len(row) for row in chart.rows)
        axes = figure.subplots(
            len(chart.rows),
            columns,
            squeeze=False,
            sharex="x" in chart.shared,
            sharey="y" in chart.shared,
            height_ratios=[max(panel.height for panel in row) for row in chart.rows],
        )
        _write_texts(figure, chart)

        letters = letters_in(_TITLE_SHARE * chart.size[0] / columns, _PANEL_TITLE_SIZE)
        legend: dict[str, Artist] = {}
        for row_of_axes, row in zip(axes, chart.rows, strict=True):
            for unused in row_of_axes[len(row) :]:
                unused.set_axis_off()
            for panel_axes, panel in zip(row_of_axes, row, strict=False):
                entries = _draw_panel(panel_axes, panel, letters)
                if not panel.own_legend:
                    legend |= {name: entries[name] for name in entries if name not in legend}
        _write_legend(figure, chart, legend)
    return figure


def _write_texts(figure: Figure, chart: Chart) -> None:
    """Write the title of a chart and the note below it."""
    width = chart.size[0]
    # The title is in the middle of the figure: it has a legend's room on both sides.
    beside = 2 * LEGEND_BESIDE if chart.legend == "right" else 0.0
    letters = letters_in(width - beside, _TITLE_SIZE)
    title = "\n".join(in_lines(line, letters) for line in chart.title.splitlines())
    if title:
        figure.suptitle(title, fontsize=_TITLE_SIZE)
    if chart.note:
        note = in_lines(chart.note, letters_in(width, _NOTE_SIZE))
        figure.supxlabel(note, x=0.01, ha="left", fontsize=_NOTE_SIZE, color=_NOTE_INK)


def _write_legend(figure: Figure, chart: Chart, legend: Mapping[str, Artist]) -> None:
    """Draw one legend for all panels, no wider than the figure."""
    if not legend:
        return
    place: dict[str, Any] = {"loc": "outside right upper", "frameon": False}
    if chart.legend == "below":
        letters = letters_in(chart.size[0], _LEGEND_SIZE)
        place = {"loc": "outside lower center", "ncols": _columns_in(list(legend), letters)}
    figure.legend(list(legend.values()), list(legend), **place)


def _columns_in(labels: Sequence[str], letters: int) -> int:
    """Return the number of columns, filled one after the other, that fit into so many letters."""
    widths = [len(label) + _HANDLE for label in labels]
    for count in range(min(_MOST_COLUMNS, len(labels)), 1, -1):
        columns = np.array_split(widths, count)
        if sum(int(column.max(initial=0)) for column in columns) <= letters:
            return count
    return 1


# -- panels ----------------------------------------------------------------------------------------


def _draw_panel(axes: Axes, panel: Panel, letters: int) -> dict[str, Artist]:
    """Draw a panel whose title may have so many letters a line; return its legend."""
    legend: dict[str, Artist] = {}
    for layer in sorted(panel.layers, key=lambda layer: _ORDER.index(type(layer))):
        # Layers without an order of their own lie above each other in that of the list.
        legend.update(_draw_layer(axes, layer, 2 + 0.1 * _ORDER.index(type(layer))))
    legend = {name: artist for name, artist in legend.items() if name}

    if panel.name:
        bold = any(isinstance(layer, Cells) for layer in panel.layers)
        weight = "bold" if bold else "normal"
        axes.set_title(in_lines(panel.name, letters), fontweight=weight)
    if panel.remark:
        axes.set_title(panel.remark, loc="right", fontsize=_REMARK_SIZE, color=FAILED, pad=3)
    if panel.framed:
        for side in axes.spines.values():
            side.set(visible=True, color=FAILED, linewidth=1.6)

    _set_axis(axes, "x", panel.x)
    _set_axis(axes, "y", panel.y)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if panel.own_legend and legend:
        # Above the curves, where it hides nothing.
        place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1, 1)}
        handles = list(legend.values())
        axes.legend(handles, list(legend), ncols=3, frameon=False, borderaxespad=0, **place)
    return legend


def _set_axis(axes: Axes, name: str, axis: ChartAxis) -> None:
    """Set title, scale, ends and ticks of the axis ``x`` or ``y``."""
    if axis.title:
        axes.set(**{f"{name}label": axis.title})
    if axis.title and name == "x":
        # It is the lowest of those that share the axis.
        axes.tick_params(labelbottom=True)
    if axis.scale == "symlog":
        getattr(axes, f"set_{name}scale")("symlog", linthresh=axis.linear)
    elif axis.scale == "log":
        getattr(axes, f"set_{name}scale")("log")
    if axis.ticks:
        getattr(axes, f"set_{name}ticks")(list(axis.ticks), list(axis.ticks.values()))
        getattr(axes, f"{name}axis").set_minor_locator(NullLocator())
    if axis.low is not None or axis.high is not None:
        getattr(axes, f"set_{name}lim")(axis.low, axis.high)
    elif axis.scale == "linear":
        _give_room(axes, name)


def _give_room(axes: Axes, name: str) -> None:
    """Give values that differ by rounding alone room around them: their ticks would be offsets."""
    low, high = getattr(axes.dataLim, f"interval{name}")
    largest = max(abs(low), abs(high))
    if 0 < high - low < _ROUNDING * largest:
        getattr(axes, f"set_{name}lim")(low - _ROOM * largest, high + _ROOM * largest)


# -- layers ----------------------------------------------------------------------------------------


def _draw_layer(axes: Axes, layer: Layer, order: float) -> dict[str, Artist]:
    """Draw a layer; return its entries of the legend by their names."""
    match layer:
        case Curve():
            return {layer.name: _draw_curve(axes, layer, order)}
        case Band():
            style: dict[str, Any] = {"color": _ink(layer.colour), "alpha": layer.opacity, "lw": 0}
            return {
                layer.name: axes.fill_between(
                    layer.x, layer.low, layer.high, zorder=order, label=layer.name, **style
                )
            }
        case Span():
            draw = axes.axvspan if layer.along == "x" else axes.axhspan
            style = {"color": _ink(layer.colour), "alpha": layer.opacity, "lw": 0}
            return {layer.name: draw(layer.start, layer.stop, label=layer.name, **style)}
        case LevelLine():
            draw = axes.axvline if layer.along == "x" else axes.axhline
            style = _line(layer.stroke)
            return {layer.name: draw(layer.value, zorder=order, label=layer.name, **style)}
        case Marks():
            return {layer.name: _draw_marks(axes, layer, order)}
        case Cells():
            _draw_cells(axes, layer)
        case Tiles():
            return _draw_tiles(axes, layer)
        case Outline():
            return {layer.name: _draw_outline(axes, layer)}
    return {}


def _ink(colour: str) -> str:
    """Return a colour on paper."""
    return BLACK if colour == INK else colour


def _line(stroke: Stroke) -> dict[str, Any]:
    """Return the style of a line."""
    if not stroke.width:
        return {"color": _ink(stroke.colour), "ls": ""}
    return {
        "color": _ink(stroke.colour),
        "lw": stroke.width,
        "ls": _DASHES[stroke.dash],
        "alpha": stroke.opacity,
    }


def _draw_curve(axes: Axes, curve: Curve, order: float) -> Artist:
    """Draw a curve with its symbols; return it."""
    style = _line(curve.stroke)
    if curve.symbol:
        every = 1 if curve.hollow is not None else max(1, len(curve.x) // 10)
        style |= {"marker": _SYMBOLS[curve.symbol], "ms": 4.5, "markevery": every}
    raster = len(curve.x) > _MOST_POINTS
    label = curve.name
    (line,) = axes.plot(curve.x, curve.y, label=label, zorder=order, rasterized=raster, **style)

    if curve.hollow:
        axes.plot(
            np.asarray(curve.x)[list(curve.hollow)],
            np.asarray(curve.y, float)[list(curve.hollow)],
            ls="",
            marker=_SYMBOLS[curve.symbol],
            ms=6,
            color=_ink(curve.stroke.colour),
            mfc="white",
            zorder=order + 0.05,
        )
    return line


def _draw_marks(axes: Axes, marks: Marks, order: float) -> Artist:
    """Draw points; return one for the legend."""
    colour = _ink(marks.colour)
    style: dict[str, Any] = {"ls": "", "marker": _SYMBOLS[marks.symbol], "color": colour}
    if marks.hollow:
        style |= {"mfc": "none", "mew": 1.6}
    elif marks.text:
        style["mec"] = "white"
    else:
        style["mew"] = 0

    place: dict[str, Any] = {"clip_on": False, "rasterized": len(marks.x) > _MOST_POINTS}
    y = marks.y
    if y is None:
        y = np.full(len(marks.x), _EDGE)
        place["transform"] = axes.get_xaxis_transform()
    axes.plot(marks.x, y, ms=marks.size, zorder=order, label=marks.name, **place, **style)

    if marks.text:
        for point in zip(marks.x, y, strict=True):
            beside: dict[str, Any] = {"xytext": (5, 3), "textcoords": "offset points"}
            size = _REMARK_SIZE
            axes.annotate(marks.text, point, fontsize=size, color=colour, rotation=40, **beside)
    return Line2D([], [], ms=6, **style)


def _draw_cells(axes: Axes, cells: Cells) -> None:
    """Draw rows and columns of cells; a missing cell is grey."""
    values = np.array(cells.values, float).reshape(len(cells.rows), len(cells.columns))
    image: dict[str, Any] = {"vmin": -cells.most, "vmax": cells.most, "aspect": "auto"}
    axes.imshow(values, cmap=_CELL_COLOURS, **image)
    axes.set_facecolor(_EMPTY_CELL)
    for i, row in enumerate(cells.texts):
        for j, text in enumerate(row):
            axes.text(j, i, text or "", ha="center", va="center", fontsize=7.5)

    names = [column_name(name) for name in cells.columns]
    axes.set_yticks(range(len(cells.rows)), cells.rows)
    axes.set_xticks(range(len(names)), names, fontsize=8.5)

    # White lines between the cells, on minor ticks.
    axes.set_xticks(np.arange(1, len(names)) - 0.5, minor=True)
    axes.set_yticks(np.arange(1, len(cells.rows)) - 0.5, minor=True)
    axes.grid(visible=False)
    axes.grid(which="minor", color="white", lw=2)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_visible(False)


def _draw_tiles(axes: Axes, tiles: Tiles) -> dict[str, Artist]:
    """Draw a plane of colours; return its legend."""
    colours = [colour for _, colour in tiles.colours]
    ends: dict[str, Any] = {"vmin": -0.5, "vmax": len(colours) - 0.5}
    axes.pcolormesh(
        tiles.x, tiles.y, tiles.numbers, cmap=ListedColormap(colours), rasterized=True, **ends
    )
    return {name: Patch(facecolor=colour, edgecolor=_NOTE_INK) for name, colour in tiles.colours}


def _draw_outline(axes: Axes, outline: Outline) -> Artist:
    """Draw a white line with black edges; return one for the legend."""
    edges: list[AbstractPathEffect] = [withStroke(linewidth=3.2, foreground=BLACK)]
    line = axes.contour(
        outline.x, outline.y, outline.inside, levels=[0.5], colors="white", linewidths=1.6
    )
    line.set_path_effects(edges)
    return Line2D([], [], color="white", linewidth=1.6, path_effects=edges)
