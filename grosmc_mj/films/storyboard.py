"""From a film's value to its storyboard: the scenes, and the still parts of the frames.

The still parts are title, labels, and three plots with their curves. Nothing is rendered yet.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import mujoco
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.films.film import Film, Take
from grosmc_mj.films.frames import CLOCK, OVERSAMPLING, Box, Chart, Scene, Storyboard
from grosmc_mj.films.scene import place
from grosmc_mj.plants.system import Signal
from grosmc_mj.results.envelope import jumps
from grosmc_mj.results.figure import DEFAULTS, shade
from grosmc_mj.results.palette import DISTURBANCE, GRID, OPTIMUM

# About as many poses decide the camera's place.
_LOOKS = 100
# A film's pictures are small: this is all the detail that can be seen in them. Twice the shadow map
# with half more slices changes at most 0.6 % of the pixels visibly and takes a third more time.
_QUALITY = {"offsamples": 0, "shadowsize": 1024, "numslices": 32, "numstacks": 12, "numquads": 1}
_AMBIENT, _DIFFUSE = 0.4, 0.6
_DPI = 100
_TITLE_INK, _NOTE_INK, _WARNING = "#111111", "#555555", "#b00020"
# Parts of a frame's height, from the top; the plots have the rest.
_ABOVE, _PICTURE = 0.114, 0.50
# Where the labels' middle is, as a part of what is above the pictures.
_LABEL = 0.8
# Pixels between pictures, and the clock's width in sizes of the font.
_GAP, _CLOCK = 2, 13.5
# Room that numbers and titles of a plot need, in sizes of the font.
_LEFT, _RIGHT, _TOP, _BOTTOM = 4.3, 1.2, 1.9, 3.1
_SIDES = ("xtick", "ytick")
# More signals than this of one kind are shown by one curve of their size.
_FEW = 2
# How several signals of one run are told apart: its colour as it is, and half as strong.
_TINTS = {"dark": 1.0, "pale": 0.5}
_GHOST: dict[str, Any] = {"color": OPTIMUM, "lw": 1.1, "ls": (0, (3, 2)), "zorder": 3}

# Times [s], values and style of a line.
Curve = tuple[Array, Array, dict[str, Any]]


def storyboard(film: Film) -> Storyboard:
    """Prepare a film; nothing is rendered yet."""
    chart, scenes = draw_chart(film), tuple(_scene(film, take) for take in film.takes)
    height, width = chart.empty[chart.pictures[0]].shape[:2]
    model = film_model(film.model, width, height)
    states = np.concatenate([scene.physics for scene in scenes])
    wrenches = [scene.wrench for scene in scenes if scene.wrench is not None]
    halves = np.concatenate([np.zeros((1, 2, 3)), *(w.reshape(-1, 2, 3) for w in wrenches)])
    return Storyboard(
        model=model,
        camera=film.camera,
        placement=place(model, film.camera, states[:: len(states) // _LOOKS + 1], width / height),
        chart=chart,
        times=film.times,
        speed=film.format.speed,
        scenes=scenes,
        largest=np.linalg.norm(halves, axis=2).max(axis=0),
        fonts=Path(mpl.get_data_path()) / "fonts" / "ttf",
    )


def film_model(model: mujoco.MjModel, width: int, height: int) -> mujoco.MjModel:
    """A copy of a model with the detail and the off-screen buffer that its pictures need."""
    own = copy.copy(model)
    for name, value in _QUALITY.items():
        setattr(own.vis.quality, name, value)
    if own.nlight == 0:
        # MuJoCo's own lamp at the camera is too dim to be the only one.
        own.vis.headlight.ambient[:], own.vis.headlight.diffuse[:] = _AMBIENT, _DIFFUSE
    # MuJoCo's cameras are pairs of eyes; a picture of one would show the mean of two.
    own.cam_ipd[:] = 0
    own.vis.global_.offwidth = OVERSAMPLING * width
    own.vis.global_.offheight = OVERSAMPLING * height
    return own


def _scene(film: Film, take: Take) -> Scene:
    """The recorded rows of one run that the frames show."""
    run, rows, model = take.run, film.rows(take), film.model
    physics, wrench, ghost = np.asarray(run.physics)[rows], None, None
    if run.wrench is not None and len(run.wrench):
        bodies = [model.body(name).id for name in run.system.bodies]
        wrench = np.zeros((len(rows), model.nbody, 6))
        # There is one interval less than instants; after its end nothing acts.
        on = film.times < run.time[-1]
        wrench[np.ix_(on, bodies)] = run.wrench[rows[on]].reshape(sum(on), -1, 6)
    if take.ghost is not None:
        joints = [model.joint(run.system.joints[index]) for index in run.system.controlled]
        ghost = physics[:, 1 : 1 + model.nq].copy()
        ghost[:, [int(joint.qposadr[0]) for joint in joints]] = take.ghost[rows]
    return Scene(physics, ghost, wrench)


def draw_chart(film: Film) -> Chart:
    """Draw title, labels and plots of a film."""
    width, height, count = film.format.width, film.format.height, len(film.takes)
    font = min(height / 40, width / 66)
    top, across = round(_ABOVE * height), (width - _GAP * (count - 1)) // count
    bottom, lefts = top + round(_PICTURE * height), range(0, count * (across + _GAP), across + _GAP)
    pictures = tuple((slice(top, bottom), slice(left, left + across)) for left in lefts)
    aside = (_LEFT + _RIGHT) * font
    margins = {
        "left": _LEFT * font / width,
        "right": 1 - _RIGHT * font / width,
        "top": 1 - (bottom + _TOP * font) / height,
        "bottom": _BOTTOM * font / height,
        "wspace": aside / (width / 3 - aside),
    }
    with mpl.rc_context(_style(font * 72 / _DPI)):
        figure = Figure(figsize=(width / _DPI, height / _DPI), dpi=_DPI)
        canvas = FigureCanvasAgg(figure)
        _label(figure, film, pictures, font)
        plots: Any = figure.subplots(1, 3, gridspec_kw=margins)
        lines = [
            line
            for axes, panel in zip(
                plots, (outputs(film), surfaces(film), inputs(film)), strict=True
            )
            for line in _draw(axes, *panel, film)
        ]
        drawn = _pixels(canvas)
        for line in lines:
            line.set_visible(False)
        empty = _pixels(canvas)
    areas = tuple(
        (slice(round(height - e.y1), round(height - e.y0)), slice(round(e.x0), round(e.x1)))
        for e in (axes.get_window_extent() for axes in plots)
    )
    return Chart(empty, drawn, areas, pictures, (film.format.start, film.stop), font)


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


def _label(figure: Figure, film: Film, pictures: Sequence[Box], font: float) -> None:
    """Write the title, and above each picture its law, its ghost and whether it is disturbed."""
    points, pad, top = font * 72 / _DPI, 0.8 * font, pictures[0][0].start
    width, height = film.format.width, film.format.height

    def write(x: float, part: float, text: str, size: float, **style: Any) -> Any:
        place = x / width, 1 - part * top / height
        return figure.text(*place, text, size=size * points, va="center_baseline", **style)

    title = write(pad, CLOCK, film.title, 1.25, color=_TITLE_INK, weight="bold")
    room = width - 2 * pad - _CLOCK * font
    title.set_size(title.get_size() * min(1.0, room / title.get_window_extent().width))
    ghost = f"ghost: {film.ghost_label} {film.ghost_symbol}"
    for take, (_, columns) in zip(film.takes, pictures, strict=True):
        note = write(columns.start + pad, _LABEL, take.label, 1.1, color=take.colour, weight="bold")
        for text, colour, there in (
            (take.ended, _WARNING, True),
            (ghost, _NOTE_INK, take.ghost is not None),
            ("disturbance", DISTURBANCE, take.run.wrench is not None),
        ):
            end = note.get_window_extent().x1
            if text and there:
                note = write(end + 1.3 * font, _LABEL, text, 0.85, color=colour)
                # A note that does not fit beside the name is left out.
                note.set_visible(note.get_window_extent().x1 <= columns.stop - pad)


def outputs(film: Film) -> tuple[str, list[Curve]]:
    """The controlled coordinates and where they should have been; of many, how far that is."""
    system, takes, symbol = film.takes[0].run.system, film.takes, film.ghost_symbol
    columns = list(system.controlled)
    values = [take.run.state[:, columns] for take in takes]
    errors = [take.run.state[:, columns] - take.ghost for take in takes if take.ghost is not None]
    if len(columns) > _FEW and len(errors) == len(takes):
        values = errors
    title, curves = _curves(
        film, [system.states[i] for i in columns], values, f"distance |q − {symbol}|"
    )
    # Of a run that ended early the ghost would end early too.
    ghosts = [
        (take.run.time, ghost, _GHOST)
        for take in takes
        if take.ghost is not None and take.run.time[-1] == film.end and len(columns) <= _FEW
        for ghost in take.ghost.T
    ]
    return f"{title}  (dashed: {symbol})" if ghosts else title, curves + ghosts


def surfaces(film: Film) -> tuple[str, list[Curve]]:
    """The sliding variables of the laws that have some, or a state in their place."""
    if film.beside is not None:
        states = [take.run.state[:, [film.beside]] for take in film.takes]
        return _curves(film, [film.takes[0].run.system.states[film.beside]], states)
    sliding = [take.run.sliding for take in film.takes]
    count = max((s[0].size for s in sliding if s is not None), default=1)
    values = [np.zeros((0, count)) if s is None else s.reshape(-1, count) for s in sliding]
    unit = max(take.sliding_unit for take in film.takes)
    symbols = ["s"] if count == 1 else [f"s{chr(0x2081 + i)}" for i in range(count)]
    signals = [Signal("sliding variable", symbol, unit) for symbol in symbols]
    return _curves(film, signals, values, "size of the sliding variable |s|")


def inputs(film: Film) -> tuple[str, list[Curve]]:
    """The inputs that the actuators applied; of many, their size."""
    signals = film.takes[0].run.system.inputs
    values = [take.run.input.reshape(-1, len(signals)) for take in film.takes]
    return _curves(film, signals, values, "size of the input |u|")


def _curves(
    film: Film, signals: Sequence[Signal], values: Sequence[Array], size: str = ""
) -> tuple[str, list[Curve]]:
    """Title of a plot, and a curve for each signal of each run, from its values (N, signals).

    Of many signals the Euclidean norm is drawn, of those with the first one's unit.
    """
    title, unit = f"{signals[0].name} {signals[0].symbol}", signals[0].unit
    if len(signals) > _FEW:
        alike = [i for i, signal in enumerate(signals) if signal.unit == unit]
        values = [np.linalg.norm(rows[:, alike], axis=1)[:, None] for rows in values]
        title = size if len(alike) == len(signals) else f"{size} of {len(alike)} joints"
    elif len(signals) > 1:
        title = ", ".join(f"{s.symbol} {tint}" for s, tint in zip(signals, _TINTS, strict=True))
    return f"{title} [{unit}]", [
        (
            take.run.time[: len(column)],
            column,
            {"color": tuple(1 - share * (1 - part) for part in to_rgb(take.colour))},
        )
        for take, rows in zip(film.takes, values, strict=True)
        for column, share in zip(rows.T, _TINTS.values(), strict=False)
    ]


def _draw(axes: Axes, title: str, curves: Sequence[Curve], film: Film) -> list[Any]:
    """Draw the curves of a plot between two instants, on fixed axes; returns the lines."""
    start, stop, lines = film.format.start, film.stop, []
    axes.set_title(title)
    axes.set_xlabel("time t [s]", labelpad=0.1 * mpl.rcParams["font.size"])
    # The left side of the room above the axis is the title's.
    axes.yaxis.set_offset_position("right")
    axes.axhline(0, color=GRID, lw=0.7, zorder=1)
    for time, values, style in curves:
        shown = slice(*np.searchsorted(time, (start - 1e-9, stop + 1e-9)))
        # A law that switches fills its band, and the others are drawn on it.
        thin = jumps(values[shown])
        line = {"lw": 0.35, "alpha": 0.75, "zorder": 1.9} if thin else {"lw": 1.9}
        lines += axes.plot(time[shown], values[shown], **{**line, **style})
    axes.set_xlim(start, stop)
    run = max((take.run for take in film.takes), key=lambda run: len(run.time))
    acts = np.flatnonzero(np.any(run.wrench, axis=1)) if run.wrench is not None else []
    if len(acts):
        first, last = run.time[acts[0]], run.time[acts[-1] + 1]
        shade(axes, max(float(first), start), min(float(last), stop))
    return lines


def _pixels(canvas: FigureCanvasAgg) -> np.ndarray:
    """What the canvas shows, (height, width, 3)."""
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3].copy()
