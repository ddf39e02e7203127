"""From a film's value to its storyboard: the scenes, and the still parts of the frames.

The still parts are title, labels, and three plots with their curves. Nothing is rendered yet.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import titled
from grosmc_mj.output.charts.envelope import jumps
from grosmc_mj.output.charts.figure import DEFAULTS
from grosmc_mj.output.films.film import Film, Take
from grosmc_mj.output.films.frames import (
    CLOCK,
    OVERSAMPLING,
    Box,
    FilmPlots,
    Scene,
    Stage,
    Storyboard,
)
from grosmc_mj.output.films.scene import LIT, place, surroundings_of
from grosmc_mj.output.palette import DISTURBANCE, GRID, OPTIMUM, red_green_blue
from grosmc_mj.theory.plants.system import Signal

# About this many poses decide the place of the camera.
_POSES = 100
# The pictures of a film are small: more detail cannot be seen in them. Twice the shadow map with
# half more slices changes at most 0.6 % of the pixels visibly and takes a third more time.
_QUALITY = {"offsamples": 0, "shadowsize": 1024, "numslices": 32, "numstacks": 12, "numquads": 1}
_DPI = 100
_TITLE_INK = "#111111"
_NOTE_INK = "#555555"
_WARNING = "#b00020"
# Height of the part above the pictures and of the pictures, as parts of a frame's height; the plots
# have the rest.
_ABOVE = 0.114
_PICTURE = 0.50
# Middle of the labels, as a part of the height above the pictures.
_LABEL = 0.8
# Pixels between pictures.
_GAP = 2
# Width of the clock, in sizes of the font.
_CLOCK = 13.5
# Margins of a plot for its numbers and titles, in sizes of the font.
_LEFT = 4.3
_RIGHT = 1.2
_TOP = 1.9
_BOTTOM = 3.1
# More signals of one kind than this are shown by one curve of their norm.
_FEW = 2
# Strength of the colours that tell several signals of one run apart.
_TINTS = {"dark": 1.0, "pale": 0.5}
# Room of a plot above and below its whole runs, beside one that ended early, as a part of theirs.
_ROOM = 0.5
_GHOST: dict[str, Any] = {"lw": 1.1, "ls": (0, (3, 2)), "zorder": 3}


class PlotCurve(NamedTuple):
    """A curve of a plot.

    Attributes:
        time: [s].
        values: Values at these times.
        style: Style of the line for matplotlib.
        ended: Whether its run ended early.
    """

    time: Array
    values: Array
    style: dict[str, Any]
    ended: bool = False


class Plot(NamedTuple):
    """A plot: its title with a unit, and its curves."""

    title: str
    curves: list[PlotCurve]

    @property
    def range_of_whole_runs(self) -> tuple[float, float] | None:
        """Range that shows the complete runs, beside one that ended early.

        A run that grows without bound would leave of the others a line. None if no run ended early,
        or all did.
        """
        drawn = [curve for curve in self.curves if len(curve.time)]
        whole = [curve.values for curve in drawn if not curve.ended]
        if not whole or len(whole) == len(drawn):
            return None
        low = min(float(np.nanmin(values)) for values in whole)
        high = max(float(np.nanmax(values)) for values in whole)
        if low == high:
            return None
        room = _ROOM * (high - low)
        return low - room, high + room


def storyboard(film: Film) -> Storyboard:
    """Prepare a film; nothing is rendered yet."""
    chart = draw_chart(film)
    stage = None if film.model is None else _stage(film, film.model, chart.pictures[0])
    return Storyboard(
        stage=stage,
        chart=chart,
        times=film.times,
        speed=film.format.speed,
        fonts=Path(mpl.get_data_path()) / "fonts" / "ttf",
    )


def _stage(film: Film, model: mujoco.MjModel, picture: Box) -> Stage:
    """Prepare the pictures of a film: the model, its camera and the poses."""
    rows, columns = picture
    width = columns.stop - columns.start
    height = rows.stop - rows.start
    drawn = film_model(model, width, height)
    scenes = tuple(_scene(film, model, take) for take in film.takes)
    states = np.concatenate([scene.physics for scene in scenes])
    poses = states[:: len(states) // _POSES + 1]
    surroundings = surroundings_of(drawn, poses)
    if surroundings.light is not None:
        drawn.vis.map.shadowclip = LIT
    return Stage(
        model=drawn,
        camera=film.camera,
        placement=place(drawn, film.camera, poses, width / height),
        surroundings=surroundings,
        scenes=scenes,
        largest=_largest_wrench(scenes),
    )


def _largest_wrench(scenes: Sequence[Scene]) -> Array:
    """Largest force [N] and largest torque [N m] of a film, (2,)."""
    wrenches = [scene.wrench for scene in scenes if scene.wrench is not None]
    none = np.zeros((1, 2, 3))
    parts = np.concatenate([none, *(wrench.reshape(-1, 2, 3) for wrench in wrenches)])
    return np.linalg.norm(parts, axis=2).max(axis=0)


def film_model(model: mujoco.MjModel, width: int, height: int) -> mujoco.MjModel:
    """Copy of a model with the detail and the off-screen buffer that its pictures need."""
    drawn = copy.copy(model)
    for name, value in _QUALITY.items():
        setattr(drawn.vis.quality, name, value)
    # MuJoCo's cameras are pairs of eyes; a picture of one would show the mean of two.
    drawn.cam_ipd[:] = 0
    drawn.vis.global_.offwidth = OVERSAMPLING * width
    drawn.vis.global_.offheight = OVERSAMPLING * height
    return drawn


def _scene(film: Film, model: mujoco.MjModel, take: Take) -> Scene:
    """States, ghost and wrenches of one run at the frames of a film."""
    run = take.run
    rows = film.rows(take)
    physics = np.asarray(run.physics)[rows]

    wrench = None
    if run.wrench is not None and len(run.wrench):
        bodies = [model.body(name).id for name in run.system.bodies]
        wrench = np.zeros((len(rows), model.nbody, 6))
        # There is one interval less than instants; after its end nothing acts.
        acts = film.times < run.time[-1]
        wrench[np.ix_(acts, bodies)] = run.wrench[rows[acts]].reshape(sum(acts), -1, 6)

    ghost = None
    if take.ghost is not None:
        joints = [model.joint(run.system.joints[index]) for index in run.system.controlled]
        columns = [int(joint.qposadr[0]) for joint in joints]
        ghost = physics[:, 1 : 1 + model.nq].copy()
        ghost[:, columns] = take.ghost[rows]
    return Scene(physics, ghost, wrench, np.array(red_green_blue(take.colour)))


def draw_chart(film: Film) -> FilmPlots:
    """Draw title, labels and plots of a film."""
    width = film.format.width
    height = film.format.height
    font = min(height / 40, width / 66)
    pictures = _picture_boxes(film)
    with mpl.rc_context(_style(font * 72 / _DPI)):
        figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        _label(figure, film, pictures, font)
        margins = _margins(film, pictures[0][0].stop, font)
        axes: Any = figure.subplots(1, 3, gridspec_kw=margins)
        lines = []
        for panel, plot in zip(axes, (outputs(film), surfaces(film), inputs(film)), strict=True):
            lines += _draw(panel, plot, film)

        drawn = _pixels(canvas)
        for line in lines:
            line.set_visible(False)
        empty = _pixels(canvas)

    areas = []
    for panel in axes:
        extent = panel.get_window_extent()
        rows = slice(round(height - extent.y1), round(height - extent.y0))
        areas.append((rows, slice(round(extent.x0), round(extent.x1))))
    times = film.format.start, film.stop
    return FilmPlots(empty, drawn, tuple(areas), pictures, times, font)


def _picture_boxes(film: Film) -> tuple[Box, ...]:
    """Boxes of the pictures from left to right, all of one size."""
    count = len(film.takes)
    across = (film.format.width - _GAP * (count - 1)) // count
    top = round(_ABOVE * film.format.height)
    # Equations have no picture: the plots have its place.
    share = 0.0 if film.model is None else _PICTURE
    rows = slice(top, top + round(share * film.format.height))
    first_columns = range(0, count * (across + _GAP), across + _GAP)
    return tuple((rows, slice(first, first + across)) for first in first_columns)


def _margins(film: Film, bottom: int, font: float) -> dict[str, float]:
    """Margins of the three plots below the pictures, as parts of the frame.

    Args:
        film: Film.
        bottom: Lower end of the pictures [pixels from the top].
        font: Size of ordinary text [pixels].
    """
    width = film.format.width
    height = film.format.height
    aside = (_LEFT + _RIGHT) * font
    return {
        "left": _LEFT * font / width,
        "right": 1 - _RIGHT * font / width,
        "top": 1 - (bottom + _TOP * font) / height,
        "bottom": _BOTTOM * font / height,
        "wspace": aside / (width / 3 - aside),
    }


def _style(points: float) -> dict[Any, Any]:
    """Style of matplotlib with sizes for a font of so many points."""
    return {
        **DEFAULTS,
        "font.family": "DejaVu Sans",
        "font.size": 0.8 * points,
        "axes.titlesize": 0.95 * points,
        "axes.titlelocation": "left",
        "axes.titley": 1.0,
        "axes.titlepad": 0.35 * points,
        "xtick.major.size": 0.25 * points,
        "xtick.major.pad": 0.25 * points,
        "ytick.major.size": 0.25 * points,
        "ytick.major.pad": 0.25 * points,
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


def _label(
    figure: Figure,
    film: Film,
    pictures: Sequence[Box],
    font: float,
) -> None:
    """Write the title, and above each picture its law, its ghost and whether it is disturbed."""
    points = font * 72 / _DPI
    pad = 0.8 * font
    top = pictures[0][0].start
    width = film.format.width

    def write(x: float, part: float, text: str, size: float, **style: Any) -> Any:
        """Write a text at x [pixels] and a part of the height above the pictures."""
        y = 1 - part * top / film.format.height
        return figure.text(x / width, y, text, size=size * points, va="center_baseline", **style)

    title = write(pad, CLOCK, film.title, 1.25, color=_TITLE_INK, weight="bold")
    space = width - 2 * pad - _CLOCK * font
    title.set_size(title.get_size() * min(1.0, space / title.get_window_extent().width))

    for take, (_, columns) in zip(film.takes, pictures, strict=True):
        notes = []
        if take.ended:
            notes.append((take.ended, _WARNING))
        if take.ghost is not None:
            notes.append((f"ghost: {film.ghost_label} {film.ghost_symbol}", _NOTE_INK))
        if take.run.disturbed is not None:
            notes.append(("disturbance", DISTURBANCE))

        text = write(columns.start + pad, _LABEL, take.label, 1.1, color=take.colour, weight="bold")
        for note, colour in notes:
            end = text.get_window_extent().x1
            text = write(end + 1.3 * font, _LABEL, note, 0.85, color=colour)
            # A note that does not fit beside the name is left out.
            text.set_visible(text.get_window_extent().x1 <= columns.stop - pad)


def outputs(film: Film) -> Plot:
    """Controlled coordinates of the system with their ghosts; of many, one norm of each run.

    It is that of the distance from the ghost if every run has one, else of the coordinates.
    """
    system = film.takes[0].run.system
    columns = list(system.controlled)
    many = len(columns) > _FEW
    values = [take.run.state[:, columns] for take in film.takes]
    errors = [
        take.run.state[:, columns] - take.ghost for take in film.takes if take.ghost is not None
    ]
    norm = "size of the coordinates |q|"
    if many and len(errors) == len(film.takes):
        values = errors
        norm = f"distance |q − {film.ghost_symbol}|"
    plot = _plot(film, [system.states[i] for i in columns], values, norm)

    ghosts = []
    for take in film.takes:
        # The ghost of a run that ended early would end early too.
        if take.ghost is not None and take.run.time[-1] == film.end and not many:
            # A reference is that of all laws, an optimum that of one.
            colour = OPTIMUM if film.one_ghost else take.colour
            style = {**_GHOST, "color": colour}
            ghosts += [PlotCurve(take.run.time, ghost, style) for ghost in take.ghost.T]
    if not ghosts:
        return plot
    return Plot(f"{plot.title}  (dashed: {film.ghost_symbol})", plot.curves + ghosts)


def surfaces(film: Film) -> Plot:
    """Sliding variables of the laws that have some, or a state in their place."""
    if film.beside is not None:
        states = [take.run.state[:, [film.beside]] for take in film.takes]
        return _plot(film, [film.takes[0].run.system.states[film.beside]], states)

    sliding = [take.run.sliding for take in film.takes]
    count = max((s[0].size for s in sliding if s is not None), default=1)
    values = [np.zeros((0, count)) if s is None else s.reshape(-1, count) for s in sliding]
    unit = max(take.sliding_unit for take in film.takes)
    symbols = ["s"] if count == 1 else [f"s{chr(0x2081 + i)}" for i in range(count)]
    signals = [Signal("sliding variable", symbol, unit) for symbol in symbols]
    return _plot(film, signals, values, "size of the sliding variable |s|")


def inputs(film: Film) -> Plot:
    """Inputs that the actuators applied; of many, their norm."""
    signals = film.takes[0].run.system.inputs
    values = [take.run.input.reshape(-1, len(signals)) for take in film.takes]
    return _plot(film, signals, values, "size of the input |u|")


def _plot(
    film: Film,
    signals: Sequence[Signal],
    values: Sequence[Array],
    norm: str = "",
) -> Plot:
    """Plot of signals, from the values of each run, (N, signals).

    Of many signals the Euclidean norm is drawn, of those with the unit of the first one.

    Args:
        film: Film.
        signals: Signals.
        values: Values of each run.
        norm: Name of their norm.
    """
    unit = signals[0].unit
    title = " ".join(dict.fromkeys([signals[0].name, signals[0].symbol]))
    if len(signals) > _FEW:
        alike = [i for i, signal in enumerate(signals) if signal.unit == unit]
        values = [np.linalg.norm(rows[:, alike], axis=1)[:, None] for rows in values]
        title = norm if len(alike) == len(signals) else f"{norm} of {len(alike)} joints"
    elif len(signals) > 1:
        names = [f"{s.symbol} {tint}" for s, tint in zip(signals, _TINTS, strict=True)]
        title = ", ".join(names)

    curves = []
    for take, rows in zip(film.takes, values, strict=True):
        for column, strength in zip(rows.T, _TINTS.values(), strict=False):
            colour = tuple(1 - strength * (1 - part) for part in to_rgb(take.colour))
            time = take.run.time[: len(column)]
            curves.append(PlotCurve(time, column, {"color": colour}, bool(take.ended)))
    return Plot(titled(title, unit), curves)


def _draw(axes: Axes, plot: Plot, film: Film) -> list[Any]:
    """Draw a plot between the film's two instants, on fixed axes; returns the lines."""
    start = film.format.start
    stop = film.stop
    axes.set_title(plot.title)
    axes.set_xlabel("time t [s]", labelpad=0.1 * mpl.rcParams["font.size"])
    # The title may have all of the width above the axes: a power of ten stands below it.
    axes.yaxis.set_offset_position("right")
    power = axes.yaxis.get_offset_text()
    power.set_verticalalignment("top")
    axes.yaxis.OFFSETTEXTPAD = 0
    power.set_bbox({"facecolor": "white", "alpha": 0.8, "pad": 1.0, "linewidth": 0})

    lines = []
    for curve in plot.curves:
        first, end = np.searchsorted(curve.time, (start - 1e-9, stop + 1e-9))
        values = curve.values[first:end]
        line: dict[str, Any] = {"lw": 1.9}
        if jumps(values):
            # A law that switches fills its band, and the others are drawn on it.
            line = {"lw": 0.35, "alpha": 0.75, "zorder": 1.9}
        lines += axes.plot(curve.time[first:end], values, **{**line, **curve.style})
    axes.set_xlim(start, stop)
    shown = plot.range_of_whole_runs
    if shown is not None:
        low, high = axes.get_ylim()
        axes.set_ylim(max(low, shown[0]), min(high, shown[1]))
    axes.autoscale(enable=False)
    axes.axhline(0, color=GRID, lw=0.7, zorder=1)

    run = max((take.run for take in film.takes), key=lambda run: len(run.time))
    if run.disturbed is not None:
        acts = np.flatnonzero(run.disturbed)
        if len(acts):
            begin = float(run.time[acts[0]])
            end = float(run.time[acts[-1] + 1])
            axes.axvspan(max(begin, start), min(end, stop), color=DISTURBANCE, alpha=0.13, lw=0)
    return lines


def _pixels(canvas: FigureCanvasAgg) -> np.ndarray:
    """Pixels of a canvas, (height, width, 3)."""
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3].copy()
