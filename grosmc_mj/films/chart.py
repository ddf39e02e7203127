"""The still parts of a film's frames: title, labels, axes, and the curves as they end."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from grosmc_mj.films.board import Chart
from grosmc_mj.films.film import Film
from grosmc_mj.films.layout import Box, Layout
from grosmc_mj.films.plots import PLOTS
from grosmc_mj.report.figure import DEFAULTS, shade
from grosmc_mj.report.palette import DISTURBANCE, GRID

_DPI = 100
# Room that numbers and titles of a plot need, in sizes of the font.
_LEFT, _RIGHT, _TOP, _BOTTOM = 4.3, 1.2, 1.9, 3.1
_SIDES = ("xtick", "ytick")


def draw_chart(film: Film, layout: Layout) -> Chart:
    """Draw title, labels and plots of a film."""
    form = film.format
    times = (form.start, film.end if form.stop is None else form.stop)
    points = layout.font * 72 / _DPI
    with mpl.rc_context(_style(points)):
        figure = Figure(figsize=(layout.width / _DPI, layout.height / _DPI), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        _write_labels(figure, film, layout)
        plots = [_axes(figure, layout, index) for index in range(len(PLOTS))]
        curves: list[Any] = []
        for axes, draw in zip(plots, PLOTS, strict=True):
            curves += draw(axes, film, times)
            _shade(axes, film, times)
            axes.set_xlim(*times)
        canvas.draw()
        for axes in plots:
            _name_the_power(axes)
        canvas.draw()
        drawn = _pixels(canvas)
        for curve in curves:
            curve.set_visible(False)
        canvas.draw()
        empty = _pixels(canvas)
    areas = tuple(_area(axes, layout.height) for axes in plots)
    return Chart(empty, drawn, areas, times)


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
    points = layout.font * 72 / _DPI
    pad = 0.8 * layout.font

    def write(box: Box, x: float, text: str, size: float, colour: str, weight: str) -> Any:
        place = (x / layout.width, 1 - (box.top + box.height / 2) / layout.height)
        return figure.text(
            *place, text, size=size, color=colour, weight=weight, va="center_baseline"
        )

    room = layout.clock.left - 2 * pad
    title = write(layout.title, pad, film.title, 1.25 * points, "#111111", "bold")
    if (width := _right_of(title) - pad) > room:
        title.set_size(1.25 * points * room / width)
    for index, take in enumerate(film.takes):
        box = layout.label(index)
        words = []
        if take.ghost is not None:
            drawn = "ghost" if film.trace < 0 else "ghost, dots"
            words.append((f"{drawn}: {film.ghost_label} {film.ghost_symbol}", "#555555"))
        if take.run.wrench is not None:
            words.append(("disturbance", DISTURBANCE))
        x = _right_of(write(box, box.left + pad, take.label, 1.1 * points, take.colour, "bold"))
        for text, colour in words:
            written = write(box, x + 1.3 * layout.font, text, 0.85 * points, colour, "normal")
            if _right_of(written) > box.right - pad:
                # The name matters most; what does not fit beside it is left out.
                written.remove()
            else:
                x = _right_of(written)


def _right_of(text: Any) -> float:
    """Where a text ends, in pixels from the left."""
    return text.get_window_extent().x1


def _axes(figure: Figure, layout: Layout, index: int) -> Axes:
    """Axes whose area lies on whole pixels."""
    box, font = layout.plot(index), layout.font
    left, top = round(box.left + _LEFT * font), round(box.top + _TOP * font)
    right, bottom = round(box.right - _RIGHT * font), round(box.bottom - _BOTTOM * font)
    axes = figure.add_axes(
        (
            left / layout.width,
            1 - bottom / layout.height,
            (right - left) / layout.width,
            (bottom - top) / layout.height,
        )
    )
    axes.set_xlabel("time t [s]", labelpad=0.1 * font)
    return axes


def _name_the_power(axes: Axes) -> None:
    """Move a common power of ten from above the axis, where there is no room, to the title."""
    power = axes.yaxis.get_offset_text()
    if power.get_text():
        axes.set_title(f"{axes.get_title(loc='left')}, {power.get_text()}")
        power.set_visible(False)


def _area(axes: Axes, height: int) -> Box:
    """The pixels within the axes."""
    box = axes.get_window_extent()
    top, bottom = round(height - box.y1), round(height - box.y0)
    return Box(round(box.x0), top, round(box.x1) - round(box.x0), bottom - top)


def _shade(axes: Axes, film: Film, times: tuple[float, float]) -> None:
    """Shade the time in which a disturbance acts."""
    run = film.longest.run
    if run.wrench is None:
        return
    acts = np.flatnonzero(np.any(run.wrench, axis=1))
    if len(acts):
        first, last = float(run.time[acts[0]]), float(run.time[acts[-1] + 1])
        shade(axes, max(first, times[0]), min(last, times[1]))


def _pixels(canvas: FigureCanvasAgg) -> np.ndarray:
    """What the canvas shows, (height, width, 3)."""
    return np.array(canvas.buffer_rgba())[..., :3].copy()
