"""The still parts of a film's frames: title, labels, axes, and the curves as they end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.films.board import Chart
from grosmc_mj.films.film import Film, Take
from grosmc_mj.films.layout import Box, Layout
from grosmc_mj.films.sizes import FEW, Size, distances, loads
from grosmc_mj.plants.system import Signal
from grosmc_mj.report.figure import DEFAULTS, jumps, shade
from grosmc_mj.report.palette import DISTURBANCE, GRID, OPTIMUM, red_green_blue

_DPI = 100
# Room that numbers and titles of a plot need, in sizes of the font.
_LEFT, _RIGHT, _TOP, _BOTTOM = 4.3, 1.2, 1.9, 3.1
_SPREAD = 0.06
_SIDES = ("xtick", "ytick")
# A sliding variable below this is shown in thousandths of its unit.
_SMALL = 0.1
_ROOM = 1.2
# How several coordinates or inputs of one run are told apart.
_STYLES, _SHARES = ("dark", "pale"), (1.0, 0.5)


def draw_chart(film: Film, layout: Layout) -> Chart:
    """Draw title, labels and plots of a film."""
    form = film.format
    times = (form.start, film.end if form.stop is None else form.stop)
    points = layout.font * 72 / _DPI
    with mpl.rc_context(_style(points)):
        figure = Figure(figsize=(layout.width / _DPI, layout.height / _DPI), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        _write_labels(figure, film, layout)
        plots = [_axes(figure, layout, index) for index in range(3)]
        curves: list[Any] = []
        for axes, draw in zip(plots, (_outputs, _slidings, _inputs), strict=True):
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
            found = write(box, x + 1.3 * layout.font, text, 0.85 * points, colour, "normal")
            if _right_of(found) > box.right - pad:
                # The name matters most; what does not fit beside it is left out.
                found.remove()
            else:
                x = _right_of(found)


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


def _window(take: Take, times: tuple[float, float]) -> slice:
    """The rows of a run that the film shows."""
    first, last = np.searchsorted(take.run.time, (times[0] - 1e-9, times[1] + 1e-9))
    return slice(int(first), int(last))


def _limits(axes: Axes, curves: Sequence[Array]) -> None:
    """Fixed limits around all curves; a curve that is zero still gets an axis."""
    values = np.concatenate([*curves, [0.0]])
    least, most = float(values.min()), float(values.max())
    spread = (most - least) or 1.0
    axes.set_ylim(least - _SPREAD * spread, most + _SPREAD * spread)


def _outputs(axes: Axes, film: Film, times: tuple[float, float]) -> list[Any]:
    """The controlled coordinate, and where it should have been; of many, how far that is."""
    if (size := distances(film)) is not None:
        return _sized(axes, film, times, size)
    run = film.takes[0].run
    controlled = list(run.system.controlled)
    ghosts = _distinct_ghosts(film)
    dashed = f"  (dashed: {film.ghost_symbol})" if ghosts else ""
    axes.set_title(f"{_names([run.system.states[index] for index in controlled])}{dashed}")
    lines, seen = [], []
    for take in film.takes:
        window = _window(take, times)
        for index, column in enumerate(controlled[: len(_STYLES)]):
            y = take.run.state[window, column]
            colour = _tint(take.colour, index)
            lines += axes.plot(take.run.time[window], y, color=colour, lw=2)
            seen.append(y)
    for ghost in ghosts:
        window = _window(film.longest, times)
        style: dict[str, Any] = {"color": OPTIMUM, "lw": 1.1, "ls": (0, (3, 2))}
        lines += axes.plot(film.longest.run.time[window], ghost[window], **style)
        seen.append(ghost[window].ravel())
    _limits(axes, seen)
    return lines


def _names(signals: Sequence[Signal]) -> str:
    """Names, symbols and units; of several, the first one's name and how each is drawn."""
    first = signals[0]
    if len(signals) == 1:
        return f"{first.name} {first.symbol} [{first.unit}]"
    drawn = ", ".join(
        f"{signal.symbol} {style}" for signal, style in zip(signals, _STYLES, strict=False)
    )
    return f"{drawn} [{first.unit}]"


def _distinct_ghosts(film: Film) -> list[Array]:
    """The ghosts' coordinates, each once; those of runs that ended early are left out."""
    found: list[Array] = []
    for take in film.takes:
        if take.ghost is None or len(take.run.time) < len(film.longest.run.time):
            continue
        if not any(np.allclose(take.ghosts, other, atol=1e-9) for other in found):
            found.append(take.ghosts)
    return found


def _slidings(axes: Axes, film: Film, times: tuple[float, float]) -> list[Any]:
    """The sliding variable of the laws that have one, or a state in its place."""
    if film.beside is not None:
        return _state(axes, film, times, film.beside)
    signals = [(take, take.run.sliding) for take in film.takes if take.run.sliding is not None]
    peak = max((float(np.abs(s).max(initial=0.0)) for _, s in signals), default=0.0)
    scale, prefix = (1e3, "m") if peak < _SMALL else (1.0, "")
    units = sorted({prefix + take.sliding_unit for take, _ in signals})
    most = max((s.shape[1] for _, s in signals if s.ndim > 1), default=1)
    name = "s₁ dark, s₂ pale" if most > 1 else "sliding variable s"
    if most > FEW:
        name = "largest sliding variable |s|"
        signals = [(take, np.abs(s).max(axis=1)) for take, s in signals]
    axes.set_title(f"{name} [{', '.join(units)}]" if units else name)
    lines, seen = [], []
    for take, s in signals:
        for values, index in _columns(s):
            lines += _held(axes, take, scale * values, times, seen, index)
    without = [take.label for take in film.takes if take.run.sliding is None]
    if without:
        axes.text(
            0.98, 0.95, f"{', '.join(without)}: no surface", transform=axes.transAxes,
            ha="right", va="top", color="#555555", zorder=5,
            bbox={"facecolor": "white", "alpha": 0.8, "lw": 0, "pad": 1.5},
        )  # fmt: skip
        if most > FEW:
            # Sizes fill their axes from zero up: room for the words.
            seen += [_ROOM * values for values in seen]
    _limits(axes, seen)
    return lines


def _state(axes: Axes, film: Film, times: tuple[float, float], index: int) -> list[Any]:
    """A state that the laws regulate beside the controlled ones."""
    axes.set_title(_names([film.takes[0].run.system.states[index]]))
    lines, seen = [], []
    for take in film.takes:
        window = _window(take, times)
        y = take.run.state[window, index]
        lines += axes.plot(take.run.time[window], y, color=take.colour, lw=2)
        seen.append(y)
    _limits(axes, seen)
    return lines


def _inputs(axes: Axes, film: Film, times: tuple[float, float]) -> list[Any]:
    """The input that the actuator applied; of many, the largest."""
    if (size := loads(film)) is not None:
        return _sized(axes, film, times, size)
    axes.set_title(_names(film.takes[0].run.system.inputs))
    lines, seen = [], []
    signals = [(take, *each) for take in film.takes for each in _columns(take.run.input)]
    for take, values, index in sorted(signals, key=_restless):
        lines += _held(axes, take, values, times, seen, index)
    _limits(axes, seen)
    return lines


def _sized(axes: Axes, film: Film, times: tuple[float, float], size: Size) -> list[Any]:
    """One curve for each take, of what stands for many signals; from zero up."""
    axes.set_title(size.title)
    lines, seen = [], []
    for take, values in sorted(zip(film.takes, size.curves, strict=True), key=_restless):
        lines += _held(axes, take, values, times, seen, 0)
    _limits(axes, seen)
    return lines


def _restless(drawn: tuple[Any, ...]) -> float:
    """Order of drawing: a law that switches fills its band, and the others are drawn on it."""
    return -float(np.abs(np.diff(drawn[1])).sum())


def _tint(colour: str, index: int) -> tuple[float, ...]:
    """The colour of a take's coordinate or input: its own, then paler."""
    share = _SHARES[index]
    return tuple(1 - share * (1 - part) for part in red_green_blue(colour))


def _columns(values: Array) -> list[tuple[Array, int]]:
    """Each signal of (N,) or (N, m) that is drawn, and its number."""
    rows = values[:, None] if values.ndim == 1 else values
    return [(row, i) for i, row in enumerate(rows.T[: len(_STYLES)])]


def _held(
    axes: Axes,
    take: Take,
    values: Array,
    times: tuple[float, float],
    seen: list[Array],
    index: int,
) -> list[Any]:
    """A signal of the intervals, thin where it jumps at every sample."""
    window = _window(take, times)
    y = values[window]
    seen.append(y)
    style: dict[str, Any] = {"lw": 0.35, "alpha": 0.75} if jumps(y) else {"lw": 1.8}
    colour = _tint(take.colour, index)
    return axes.plot(take.run.time[window][: len(y)], y, color=colour, **style)


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
