"""The still parts of a film's frames: title, labels, axes, and the curves as they end."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from grosmc_mj.films.film import Film
from grosmc_mj.films.frames import Chart
from grosmc_mj.films.layout import Box, Layout
from grosmc_mj.films.plots import PANELS, Curve, Panel
from grosmc_mj.results.envelope import jumps
from grosmc_mj.results.figure import DEFAULTS, shade
from grosmc_mj.results.palette import DISTURBANCE, GRID

_DPI = 100
_TITLE_INK, _NOTE_INK = "#111111", "#555555"
# Room that numbers and titles of a plot need, in sizes of the font.
_LEFT, _RIGHT, _TOP, _BOTTOM = 4.3, 1.2, 1.9, 3.1
_SIDES = ("xtick", "ytick")
# Around all curves, and above them for a note, as parts of what they span.
_SPREAD, _ROOM = 0.06, 0.2


def draw_chart(film: Film, layout: Layout) -> Chart:
    """Draw title, labels and plots of a film."""
    times = (film.format.start, film.stop)
    with mpl.rc_context(_style(layout.font * 72 / _DPI)):
        figure = Figure(figsize=(layout.width / _DPI, layout.height / _DPI), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        _write_labels(figure, film, layout)
        plots = [_axes(figure, layout, index) for index in range(len(PANELS))]
        curves: list[Any] = []
        for axes, panel in zip(plots, PANELS, strict=True):
            curves += _draw(axes, panel(film), times)
            _shade(axes, film, times)
        canvas.draw()
        for axes in plots:
            _name_the_power(axes)
        drawn = _pixels(canvas)
        for curve in curves:
            curve.set_visible(False)
        empty = _pixels(canvas)
    boxes = [axes.get_window_extent() for axes in plots]
    areas = [(box.x0, layout.height - box.y1, box.width, box.height) for box in boxes]
    return Chart(empty, drawn, tuple(Box(*map(round, area)) for area in areas), times)


def _style(points: float) -> dict[Any, Any]:
    """Sizes that follow the frame's."""
    return {
        **DEFAULTS,
        "font.family": "DejaVu Sans",
        "font.size": 0.8 * points,
        "axes.titlesize": 0.95 * points,
        "axes.titlelocation": "left",
        "axes.titley": 1.0,
        "axes.titlepad": 0.35 * points,
        **{f"{side}.major.{part}": 0.25 * points for side in _SIDES for part in ("size", "pad")},
        "axes.linewidth": 0.8,
        "axes.axisbelow": True,
        "axes.grid": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "grid.color": GRID,
        "grid.linewidth": 0.7,
        "axes.formatter.limits": (-3, 4),
        "axes.formatter.use_mathtext": True,
    }


def _write_labels(figure: Figure, film: Film, layout: Layout) -> None:
    """The title, and above each picture whose it is."""
    points, pad = layout.font * 72 / _DPI, 0.8 * layout.font

    def write(box: Box, x: float, text: str, size: float, **style: Any) -> tuple[Any, float]:
        """A text that begins at x, and where it ends, in pixels."""
        place = (x / layout.width, 1 - (box.top + box.height / 2) / layout.height)
        written = figure.text(*place, text, size=size * points, va="center_baseline", **style)
        return written, written.get_window_extent().x1

    bold: dict[str, Any] = {"weight": "bold"}
    title, end = write(layout.title, pad, film.title, 1.25, color=_TITLE_INK, **bold)
    room = layout.clock.left - 2 * pad
    title.set_size(title.get_size() * min(1.0, room / (end - pad)))
    ghost = "ghost" if film.trace < 0 else "ghost, dots"
    for index, take in enumerate(film.takes):
        box = layout.label(index)
        _, end = write(box, box.left + pad, take.label, 1.1, color=take.colour, **bold)
        words = [(f"{ghost}: {film.ghost_label} {film.ghost_symbol}", _NOTE_INK)]
        words = [] if take.ghost is None else words
        words += [] if take.run.wrench is None else [("disturbance", DISTURBANCE)]
        for text, colour in words:
            written, right = write(box, end + 1.3 * layout.font, text, 0.85, color=colour)
            if right > box.right - pad:
                # The name matters most; what does not fit beside it is left out.
                written.remove()
            else:
                end = right


def _axes(figure: Figure, layout: Layout, index: int) -> Axes:
    """Axes whose area lies on whole pixels."""
    box, font = layout.plot(index), layout.font
    left, top = round(box.left + _LEFT * font), round(box.top + _TOP * font)
    right, bottom = round(box.right - _RIGHT * font), round(box.bottom - _BOTTOM * font)
    part = np.array([left, layout.height - bottom, right - left, bottom - top])
    axes = figure.add_axes(tuple(part / ([layout.width, layout.height] * 2)))
    axes.set_xlabel("time t [s]", labelpad=0.1 * font)
    return axes


def _draw(axes: Axes, panel: Panel, times: tuple[float, float]) -> list[Any]:
    """The curves of a plot between two instants, on fixed axes; returns the lines."""
    axes.set_title(panel.title)
    lines, least, most = [], 0.0, 0.0
    for time, values, style in sorted(panel.curves, key=_restlessness):
        shown = slice(*np.searchsorted(time, (times[0] - 1e-9, times[1] + 1e-9)))
        y = values[shown]
        width = {"lw": 0.35, "alpha": 0.75} if jumps(y) else {"lw": 1.9}
        lines += axes.plot(time[shown], y, **{**width, **style})
        least, most = float(y.min(initial=least)), float(y.max(initial=most))
    span = (most - least) or 1.0
    if panel.note:
        axes.text(
            0.98, 0.95, panel.note, transform=axes.transAxes,
            ha="right", va="top", color=_NOTE_INK, zorder=5,
            bbox={"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.5},
        )  # fmt: skip
        most += _ROOM * span
    axes.set_ylim(least - _SPREAD * span, most + _SPREAD * span)
    axes.set_xlim(*times)
    return lines


def _restlessness(curve: Curve) -> float:
    """Order of drawing: a law that switches fills its band, and the others are drawn on it."""
    return -float(np.abs(np.diff(curve.values)).sum())


def _name_the_power(axes: Axes) -> None:
    """Move a common power of ten from above the axis, where there is no room, to the title."""
    power = axes.yaxis.get_offset_text()
    if power.get_text():
        axes.set_title(f"{axes.get_title(loc='left')}, {power.get_text()}")
        power.set_visible(False)


def _shade(axes: Axes, film: Film, times: tuple[float, float]) -> None:
    """Shade the time in which a disturbance acts."""
    run = film.longest.run
    acts = np.flatnonzero(np.any(run.wrench, axis=1)) if run.wrench is not None else []
    if len(acts):
        first, last = float(run.time[acts[0]]), float(run.time[acts[-1] + 1])
        shade(axes, max(first, times[0]), min(last, times[1]))


def _pixels(canvas: FigureCanvasAgg) -> np.ndarray:
    """What the canvas shows, (height, width, 3)."""
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3].copy()
