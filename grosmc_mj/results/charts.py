"""Charts of results as figures: cells, curves, maps."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
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

from grosmc_mj.results.figure import figure_written, in_lines
from grosmc_mj.results.palette import (
    BLACK,
    BLUE,
    FAILED,
    GREEN,
    KEPT,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
)
from grosmc_mj.results.result import CellChart, GridChart, LineChart

# Inches: a cell, the names of rows, a panel of curves or of a map.
_CELL, _NAMES, _PANEL = (1.12, 0.36), 2.8, (3.8, 3.1)
_LETTERS, _NOTE = 13, {"fontsize": 9, "x": 0.01, "ha": "left", "color": "#444444"}
_COLOURS = (VERMILION, ORANGE, BLUE, GREEN, PURPLE, SKY, BLACK, "#888888")
_MARKERS = "osDv^P"
# White is the limit; beyond this part of the scale the colour is too dark for black letters.
_CELLS, _DARK = LinearSegmentedColormap.from_list("kept", [KEPT, "#ffffff", FAILED]), 0.6
# An axis whose largest number is so many times the smallest is logarithmic.
_FAR = 10.0


def cell_charts(
    titles: Mapping[str, str], cells: Iterable[tuple[str, str, str, float, str, str]], most: float
) -> dict[str, CellChart]:
    """A chart for each title that has cells, by its key.

    Args:
        titles: Of the charts, by key.
        cells: Key, row, column, value, text and why of each.
        most: Of the values.
    """
    charts: dict[str, dict[tuple[str, str], tuple[float, str, str]]] = {}
    for key, row, column, value, text, why in cells:
        charts.setdefault(key, {})[row, column] = (value, text, why)
    return {k: CellChart.of(title, charts[k], most) for k, title in titles.items() if k in charts}


def write_cells(path: Path, title: str, charts: Sequence[CellChart], note: str) -> Path:
    """Draw charts of cells below each other.

    Args:
        path: The PNG; the SVG lies beside it.
        title: Above all.
        charts: At least one.
        note: Below all.

    Raises:
        SetupError: If a file cannot be written.
    """
    widest = max(4, *(len(chart.columns) for chart in charts))
    headers = [[in_lines(name, _LETTERS) for name in chart.columns] for chart in charts]
    lines = [1 + max((name.count("\n") for name in names), default=0) for names in headers]
    heights = [len(chart.rows) + 1.2 + 0.6 * n for chart, n in zip(charts, lines, strict=True)]
    width, height = _CELL[0] * widest + _NAMES, _CELL[1] * sum(heights) + 1.1
    with figure_written(path, (width, height)) as figure:
        figure.suptitle(title, fontsize=14)
        sizes = [len(chart.rows) for chart in charts]
        panels = figure.subplots(len(charts), 1, squeeze=False, height_ratios=sizes)[:, 0]
        for chart, names, panel in zip(charts, headers, panels, strict=True):
            _heat_map(panel, chart, names, widest)
        figure.supxlabel(in_lines(note, round(13 * width)), **_NOTE)
    return path


def _heat_map(panel: Axes, chart: CellChart, names: Sequence[str], width: int) -> None:
    """The cells of a chart in a panel with room for so many columns; no cell is grey."""
    values = np.full((len(chart.rows), width), np.nan)
    for i, row in enumerate(chart.values):
        for j, value in enumerate(row):
            values[i, j] = np.nan if value is None else value
            colour = "white" if abs(value or 0.0) > _DARK * chart.most else BLACK
            panel.text(j, i, chart.texts[i][j] or "", ha="center", va="center", color=colour)
    panel.imshow(values, cmap=_CELLS, vmin=-chart.most, vmax=chart.most, aspect="auto")
    panel.set_facecolor("#eeeeee")
    panel.set_yticks(range(len(chart.rows)), chart.rows)
    panel.set_xticks(range(len(names)), names)
    panel.set_xlim(-0.5, max(len(names), 1) - 0.5)
    panel.set_xticks(np.arange(1, len(names)) - 0.5, minor=True)
    panel.set_yticks(np.arange(1, len(chart.rows)) - 0.5, minor=True)
    panel.grid(visible=False)
    panel.grid(which="minor", color="white", lw=2)
    panel.tick_params(which="both", length=0)
    panel.spines[:].set_visible(False)
    panel.set_title(chart.name, loc="left", fontsize=11.5, fontweight="bold")


def write_panels(path: Path, title: str, rows: Sequence[Sequence[LineChart | GridChart]]) -> Path:
    """Draw charts of curves or of maps in rows, with one legend; paths as for `write_cells`."""
    columns = max(len(row) for row in rows)
    with figure_written(path, (_PANEL[0] * columns, _PANEL[1] * len(rows) + 0.9)) as figure:
        figure.suptitle(in_lines(title, 32 * columns), fontsize=14)
        panels = figure.subplots(len(rows), columns, squeeze=False)
        handles: dict[str, Artist] = {}
        for i, row in enumerate(rows):
            for panel, first, chart in zip(panels[i], rows[0], row, strict=True):
                panel.set_title(in_lines(chart.name, 36), loc="left", fontsize=11)
                if isinstance(chart, LineChart):
                    _curves(panel, chart)
                    handles |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
                else:
                    handles |= _map(
                        panel, chart, first if i and isinstance(first, GridChart) else None
                    )
        figure.legend(
            list(handles.values()), list(handles), loc="outside lower center",
            ncols=min(len(handles), 2 * columns),
        )  # fmt: skip
    return path


def _curves(panel: Axes, chart: LineChart) -> None:
    """The curves of a chart; one ends where its value has none."""
    for i, (series, colour) in enumerate(zip(chart.lines, cycle(_COLOURS), strict=False)):
        y = [math.nan if value is None else value for value in series.y]
        style: dict[str, Any] = {"ls": (0, (2, 2))}
        if i < len(_MARKERS):
            style = {"marker": _MARKERS[i], "ms": 4, "markevery": max(1, len(y) // 10)}
        panel.plot(series.x, y, color=colour, lw=1.4, label=series.name, **style)
        bad = [i for i, good in enumerate(series.good) if good is False]
        hollow: dict[str, Any] = {"color": colour, "mfc": "white"}
        panel.plot([series.x[i] for i in bad], [y[i] for i in bad], "o", **hollow)
        # A run that ended early has no value: it stands at the lower edge.
        ended = [series.x[i] for i in bad if series.y[i] is None]
        edge = panel.get_xaxis_transform()
        panel.plot(ended, [0.03] * len(ended), "^", transform=edge, **hollow)
    for mark in chart.marks:
        panel.axvline(mark, color=BLACK, lw=0.9, ls=(0, (2, 2)))
    if chart.limit is not None:
        panel.axhline(chart.limit, color=BLACK, lw=0.9, ls=(0, (2, 2)))
    panel.set_xlabel(chart.titles[0])
    panel.set_ylabel(chart.titles[1])
    for axis, numbers in (
        ("x", [x for series in chart.lines for x in series.x if isinstance(x, float)]),
        ("y", [y for series in chart.lines for y in series.y if y is not None]),
    ):
        low, high = min(numbers, default=0.0), max(numbers, default=0.0)
        if low > 0 and high > _FAR * low:
            panel.set(**{f"{axis}scale": "log"})
            if axis == "x":
                panel.set_xticks(sorted(set(numbers)), [f"{x:g}" for x in sorted(set(numbers))])
                panel.xaxis.set_minor_locator(NullLocator())
        elif axis == "y" and low <= 0 and high > _FAR:
            panel.set_yscale("symlog", linthresh=1e-2)


def _map(panel: Axes, chart: GridChart, nominal: GridChart | None) -> dict[str, Artist]:
    """A map, with the edge of its first letter on the nominal one; returns its legend."""
    letters = [entry.letter for entry in chart.legend]
    index = np.array([[letters.index(letter) for letter in row] for row in chart.grid])
    (across, end), (down, height) = chart.axes
    edges = [np.linspace(-limit, limit, len(index) + 1) for limit in (end, height)]
    colours = ListedColormap([entry.colour for entry in chart.legend])
    panel.pcolormesh(
        *edges, index, cmap=colours, vmin=-0.5, vmax=len(letters) - 0.5, rasterized=True
    )
    panel.set_xlabel(across)
    panel.set_ylabel(down)
    legend: dict[str, Artist] = {
        entry.name: Patch(facecolor=entry.colour, edgecolor="#444444") for entry in chart.legend
    }
    if nominal is not None:
        good = np.array([[float(letter == letters[0]) for letter in row] for row in nominal.grid])
        if 0 < good.mean() < 1:
            centres = [(edge[:-1] + edge[1:]) / 2 for edge in edges]
            outline: list[AbstractPathEffect] = [withStroke(linewidth=3.2, foreground=BLACK)]
            line = panel.contour(*centres, good, levels=[0.5], colors="white", linewidths=1.6)
            line.set_path_effects(outline)
            name = f"edge of {chart.legend[0].name} in the top row"
            legend[name] = Line2D([], [], color="white", linewidth=1.6, path_effects=outline)
    return legend
