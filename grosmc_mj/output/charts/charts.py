"""Charts of results as figures: cells, curves and maps."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import NullLocator

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.charts.figure import figure_written, in_lines
from grosmc_mj.output.palette import (
    BLACK,
    BLUE,
    CELLS,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
)
from grosmc_mj.output.results.result import CellChart, GridChart, LineChart, Series

# Width and height of a cell, and of a panel of curves or of a map; width of the rows' names [inch].
_CELL = (0.72, 0.32)
_PANEL = (3.8, 3.1)
_ROW_NAMES = 1.9
# Letters in a line of a column's name.
_COLUMN_NAME = 12
_NOTE = {"fontsize": 9, "x": 0.01, "ha": "left", "color": "#444444"}
_COLOURS = (VERMILION, ORANGE, BLUE, GREEN, PURPLE, SKY, BLACK, "#888888")
_MARKERS = "osDv^P"
# Colours of cells: kept, in some draws, and not kept.
_CELL_COLOURS = LinearSegmentedColormap.from_list("kept", CELLS)
# Values along an axis that each get a tick, at most.
_MOST_TICKS = 12
# An axis is logarithmic if its largest number is more than so many times its smallest.
_FAR = 10.0


def write_cells(
    path: Path,
    title: str,
    charts: Sequence[CellChart],
    note: str,
) -> Path:
    """Draw charts of cells below each other.

    Args:
        path: Path of the PNG; the SVG lies beside it.
        title: Title of the figure.
        charts: The charts, at least one.
        note: Text below the charts.

    Raises:
        SetupError: If a file cannot be written.
    """
    most_columns = max(4, *(len(chart.columns) for chart in charts))
    width = _CELL[0] * most_columns + _ROW_NAMES
    height = _CELL[1] * sum(_rows_of_height(chart) for chart in charts) + 1.1

    with figure_written(path, (width, height)) as figure:
        figure.suptitle(title, fontsize=14)
        ratios = [len(chart.rows) for chart in charts]
        panels = figure.subplots(len(charts), 1, squeeze=False, height_ratios=ratios)[:, 0]
        for chart, panel in zip(charts, panels, strict=True):
            _draw_cells(panel, chart, most_columns)
        figure.supxlabel(in_lines(note, round(13 * width)), **_NOTE)
    return path


def _column_names(chart: CellChart) -> list[str]:
    return [in_lines(name, _COLUMN_NAME) for name in chart.columns]


def _rows_of_height(chart: CellChart) -> float:
    """Return the height of a chart with its title and the names of its columns, in cells."""
    breaks = max((name.count("\n") for name in _column_names(chart)), default=0)
    return len(chart.rows) + 1.2 + 0.6 * (1 + breaks)


def _draw_cells(panel: Axes, chart: CellChart, columns: int) -> None:
    """Draw a chart in a panel with room for so many columns; a missing cell is grey."""
    values = np.full((len(chart.rows), columns), np.nan)
    for i, row in enumerate(chart.values):
        for j, value in enumerate(row):
            if value is not None:
                values[i, j] = value
            panel.text(j, i, chart.texts[i][j] or "", ha="center", va="center", fontsize=7.5)
    panel.imshow(values, cmap=_CELL_COLOURS, vmin=-chart.most, vmax=chart.most, aspect="auto")
    panel.set_facecolor("#eeeeee")

    names = _column_names(chart)
    panel.set_yticks(range(len(chart.rows)), chart.rows)
    panel.set_xticks(range(len(names)), names, fontsize=8.5)
    panel.set_xlim(-0.5, max(len(names), 1) - 0.5)

    # White lines between the cells, on minor ticks.
    panel.set_xticks(np.arange(1, len(names)) - 0.5, minor=True)
    panel.set_yticks(np.arange(1, len(chart.rows)) - 0.5, minor=True)
    panel.grid(visible=False)
    panel.grid(which="minor", color="white", lw=2)

    panel.tick_params(which="both", length=0)
    panel.spines[:].set_visible(False)
    panel.set_title(chart.name, loc="left", fontsize=11.5, fontweight="bold")


def write_panels(path: Path, title: str, rows: Sequence[Sequence[LineChart | GridChart]]) -> Path:
    """Draw charts of curves or of maps in rows, with one legend.

    Args:
        path: Path of the PNG; the SVG lies beside it.
        title: Title of the figure.
        rows: The charts of each row. Maps show the outline of the first row's map above them.

    Raises:
        SetupError: If a file cannot be written.
    """
    columns = max(len(row) for row in rows)
    with figure_written(path, (_PANEL[0] * columns, _PANEL[1] * len(rows) + 0.9)) as figure:
        figure.suptitle(in_lines(title, 32 * columns), fontsize=14)
        panels = figure.subplots(len(rows), columns, squeeze=False)

        legend: dict[str, Artist] = {}
        for i, row in enumerate(rows):
            for unused in panels[i][len(row) :]:
                unused.set_axis_off()
            # After an interrupt the last row has fewer charts than the first.
            for panel, top, chart in zip(panels[i], rows[0], row, strict=False):
                panel.set_title(in_lines(chart.name, 36), loc="left", fontsize=11)
                if isinstance(chart, LineChart):
                    _draw_curves(panel, chart)
                    handles, labels = panel.get_legend_handles_labels()
                    legend.update(zip(labels, handles, strict=True))
                    continue

                legend.update(_draw_map(panel, chart))
                if i > 0 and isinstance(top, GridChart):
                    legend.update(_draw_outline(panel, chart, top))

        figure.legend(
            list(legend.values()),
            list(legend),
            loc="outside lower center",
            ncols=min(len(legend), 2 * columns),
        )
    return path


def _draw_curves(panel: Axes, chart: LineChart) -> None:
    """Draw the curves of a chart with its limit and its marks."""
    for i, (series, colour) in enumerate(zip(chart.lines, cycle(_COLOURS), strict=False)):
        marker = _MARKERS[i] if i < len(_MARKERS) else None
        _draw_series(panel, series, colour, marker)

    for mark in chart.marks:
        panel.axvline(mark, color=BLACK, lw=0.9, ls=(0, (2, 2)))
    if chart.limit is not None:
        panel.axhline(chart.limit, color=BLACK, lw=0.9, ls=(0, (2, 2)))
    panel.set_xlabel(chart.titles[0])
    panel.set_ylabel(chart.titles[1])
    _scale_axes(panel, chart)


def _draw_series(
    panel: Axes,
    series: Series,
    colour: str,
    marker: str | None,
) -> None:
    """Draw one curve, with hollow markers where a requirement fails; dashed without a marker."""
    y = [math.nan if value is None else value for value in series.y]
    style: dict[str, Any] = {"ls": (0, (2, 2))}
    if marker is not None:
        style = {"marker": marker, "ms": 4, "markevery": max(1, len(y) // 10)}
    panel.plot(series.x, y, color=colour, lw=1.4, label=series.name, **style)

    failed = [i for i, good in enumerate(series.good) if good is False]
    hollow: dict[str, Any] = {"color": colour, "mfc": "white"}
    panel.plot([series.x[i] for i in failed], [y[i] for i in failed], "o", **hollow)

    # A run that ended early has no value: its marker stands at the lower edge.
    ended = [series.x[i] for i in failed if series.y[i] is None]
    edge = panel.get_xaxis_transform()
    panel.plot(ended, [0.03] * len(ended), "^", transform=edge, **hollow)


def _scale_axes(panel: Axes, chart: LineChart) -> None:
    """Make an axis logarithmic if its numbers are far apart, or both axes of one scale."""
    if chart.equal:
        panel.set_aspect("equal", adjustable="datalim")
        return

    x = {x for series in chart.lines for x in series.x if isinstance(x, float)}
    if _spans_decades(x):
        panel.set_xscale("log")
    if _spans_decades(x) and len(x) <= _MOST_TICKS:
        panel.set_xticks(sorted(x), [f"{value:g}" for value in sorted(x)])
        panel.xaxis.set_minor_locator(NullLocator())

    y = {y for series in chart.lines for y in series.y if y is not None}
    if _spans_decades(y):
        panel.set_yscale("log")
    elif y and min(y) <= 0 and max(y) > _FAR:
        panel.set_yscale("symlog", linthresh=1e-2)


def _spans_decades(numbers: Collection[float]) -> bool:
    """Return True if numbers are positive and far apart."""
    if not numbers:
        return False
    return min(numbers) > 0 and max(numbers) > _FAR * min(numbers)


def _draw_map(panel: Axes, chart: GridChart) -> dict[str, Artist]:
    """Draw a map; return the entries of its legend."""
    letters = [entry.letter for entry in chart.legend]
    index = np.array([[letters.index(letter) for letter in row] for row in chart.grid])
    colours = ListedColormap([entry.colour for entry in chart.legend])
    x_edges, y_edges = _cell_edges(chart)
    panel.pcolormesh(
        x_edges,
        y_edges,
        index,
        cmap=colours,
        vmin=-0.5,
        vmax=len(letters) - 0.5,
        rasterized=True,
    )
    panel.set_xlabel(chart.axes[0][0])
    panel.set_ylabel(chart.axes[1][0])
    return {
        entry.name: Patch(facecolor=entry.colour, edgecolor="#444444") for entry in chart.legend
    }


def _draw_outline(panel: Axes, chart: GridChart, top: GridChart) -> dict[str, Artist]:
    """Draw the edge of the first letter of the top row's map; return the entry of its legend."""
    best = chart.legend[0]
    inside = np.array([[float(letter == best.letter) for letter in row] for row in top.grid])
    if not 0 < inside.mean() < 1:
        return {}

    x, y = [(edges[:-1] + edges[1:]) / 2 for edges in _cell_edges(chart)]
    stroke: list[AbstractPathEffect] = [withStroke(linewidth=3.2, foreground=BLACK)]
    line = panel.contour(x, y, inside, levels=[0.5], colors="white", linewidths=1.6)
    line.set_path_effects(stroke)
    handle = Line2D([], [], color="white", linewidth=1.6, path_effects=stroke)
    return {f"edge of {best.name} in the top row": handle}


def _cell_edges(chart: GridChart) -> list[Array]:
    """Return the edges of a map's cells along its first and its second axis."""
    count = len(chart.grid) + 1
    return [np.linspace(-limit, limit, count) for _, limit in chart.axes]
