"""Figures of curves over time: all quantities of a case, or the one that tells its story.

Laws have their colours and plants their dashes. Equations that coincide with MuJoCo have no line of
their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from grosmc_mj.output.page.charts import INK, Entry, Figure, Item, axis_of, figure_of, plain_text
from grosmc_mj.output.page.reading import Curve, CurvePanel, Curves, Line, Window
from grosmc_mj.output.page.verdicts import main_plant
from grosmc_mj.output.palette import GREEN, PLANTS, label_of
from grosmc_mj.output.results.tables import number

# Curves that are nowhere further apart than this share of their range are one line.
_COINCIDE = 0.01
# A limit is on the axis if it lies no further out than this share of the curves' range.
_NEAR = 0.5
# Space above and below the curves, as a share of their range.
_SPACE = 0.06
# Labels of limits are no nearer to each other than this share of the axis.
_APART = 0.12
_MOST_ENTRIES = 8
# Heights of a panel, of its title, and of the time axis [pixel].
_PANEL = 150
_TITLE = 34
_TIME_AXIS = 42
_GREY = "#888888"
_GREY_LAW = "#9a9a9a"
_DASHES = {"corrected": "dash", "printed": "dot", "measured": "longdashdot"}
# Name of the curve of a state as a law is given it.
_SEEN = "seen"


@dataclass(frozen=True)
class _DrawnPanel:
    """A panel with the curves that are drawn.

    Attributes:
        panel: The panel.
        curves: Curves that are no copy of MuJoCo's.
        axis: Plotly's name of its axis.
        top: Upper end of its axis, as a part of the figure.
        height: Height of its axis, as a part of the figure.
    """

    panel: CurvePanel
    curves: Sequence[Curve]
    axis: str
    top: float
    height: float

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper end of the axis: they fit the curves, and limits that are near."""
        values = [0.0]
        if self.curves:
            values = [value for curve in self.curves for value in _extent(curve)]
        low = min(values)
        high = max(values)
        span = (high - low) or abs(high) or 1.0

        for limit in self.panel.limits:
            if low - _NEAR * span <= min(limit.y) and max(limit.y) <= high + _NEAR * span:
                values += limit.y
        return min(values) - _SPACE * span, max(values) + _SPACE * span

    def traces(self, colours: dict[str, str]) -> Iterator[Item]:
        """Yield the traces of curves, reference and limits."""
        for curve in self.curves:
            colour = colours.get(curve.law, _GREY_LAW)
            if curve.range is not None:
                yield _band(curve, colour, self.axis)
            yield _curve(curve, colour, self.axis, main_plant(self.panel))
        if self.panel.reference is not None:
            yield _line("reference", self.panel.reference, "dashdot", self.axis)
        for limit in self.panel.limits:
            yield _line(f"limit: {limit.words}", limit, "longdash", self.axis)

    def texts(self) -> Iterator[Item]:
        """Yield the title above the panel, and the numbers of its limits beside it."""
        yield {
            "text": plain_text(self.panel.label),
            "xref": "paper",
            "x": 0,
            "xanchor": "left",
            "yref": "paper",
            "y": self.top,
            "yanchor": "bottom",
            "yshift": 3,
            "showarrow": False,
        }
        low, high = self.limits
        taken: list[float] = []
        for limit in self.panel.limits:
            # A limit that follows a reference has no single number.
            if len(set(limit.y)) != 1:
                continue
            value = limit.y[0]
            place = (min(max(value, low), high) - low) / (high - low)
            if all(abs(place - other) > _APART for other in taken):
                taken.append(place)
                yield self._limit_text(value, place)

    def _limit_text(self, value: float, place: float) -> Item:
        """Return the number of a limit, with an arrow if it lies beyond the axis."""
        text = number(value)
        if place == 1:
            text = f"↑ {text}"
        elif place == 0:
            text = f"↓ {text}"
        return {
            "text": text,
            "xref": "paper",
            "x": 1,
            "xanchor": "left",
            "xshift": 4,
            "yref": "paper",
            "y": self.top - (1 - place) * self.height,
            "yanchor": "middle",
            "showarrow": False,
        }


def curves_figure(
    curves: Curves,
    panels: Sequence[CurvePanel],
    *,
    only_main_plant: bool = False,
) -> Figure:
    """Return the figure of quantities of a case over time.

    Args:
        curves: The case.
        panels: The quantities.
        only_main_plant: True to show the runs on one plant, MuJoCo if there are some.
    """
    drawn = list(_drawn_panels(panels, only_main_plant=only_main_plant))
    signs = list(_signs(drawn))
    colours = _colours(curves, drawn, _MOST_ENTRIES - len(signs))

    shapes = [_shaded(window) for window in curves.disturbances]
    shapes += [_play(panel) for panel in drawn if panel.panel.play]
    axes = {}
    for panel in drawn:
        domain = [max(0.0, panel.top - panel.height), panel.top]
        axes[f"yaxis{panel.axis[1:]}"] = {"domain": domain, "range": panel.limits, "nticks": 6}

    return figure_of(
        [trace for panel in drawn for trace in panel.traces(colours)],
        len(drawn) * (_TITLE + _PANEL) + _TIME_AXIS,
        [*_law_entries(colours), *signs],
        shapes=shapes,
        annotations=[text for panel in drawn for text in panel.texts()],
        xaxis=axis_of("time t [s]", range=[0, curves.duration], anchor=drawn[-1].axis),
        margin={"l": 62, "r": 58, "t": 0, "b": _TIME_AXIS},
        **axes,
    )


def _drawn_panels(panels: Sequence[CurvePanel], *, only_main_plant: bool) -> Iterator[_DrawnPanel]:
    """Yield the panels from the top with the curves that are drawn."""
    area = len(panels) * (_TITLE + _PANEL)
    for index, panel in enumerate(panels):
        main = main_plant(panel)
        shown = [curve for curve in panel.curves if curve.plant == main]
        if not only_main_plant:
            others = [curve for curve in panel.curves if curve.plant != main]
            shown += [curve for curve in others if not _coincides(curve, shown)]

        top = 1 - (index * (_TITLE + _PANEL) + _TITLE) / area
        axis = f"y{index + 1}" if index else "y"
        yield _DrawnPanel(panel, shown, axis, top, _PANEL / area)


def _coincides(curve: Curve, others: Sequence[Curve]) -> bool:
    """True if a law's curve is that of the law on another plant."""
    for other in others:
        if (curve.law, curve.name) != (other.law, other.name) or not (curve.t and other.t):
            continue
        low, high = _extent(other)
        difference = np.abs(np.interp(other.t, curve.t, curve.y) - other.y).max()
        if difference <= _COINCIDE * (high - low) and abs(curve.t[-1] - other.t[-1]) < 1e-2:
            return True
    return False


def _extent(curve: Curve) -> tuple[float, float]:
    """Return the least and the largest value of a curve."""
    values = curve.y or [0.0]
    if curve.range is not None:
        values = [*values, *curve.range[0], *curve.range[1]]
    return min(values), max(values)


# -- legend --------------------------------------------------------------------------------------


def _signs(drawn: Sequence[_DrawnPanel]) -> Iterator[Entry]:
    """Yield the entries of lines that are drawn and are no laws."""
    plants = {curve.plant for panel in drawn for curve in panel.curves}
    names = {curve.name for panel in drawn for curve in panel.curves}
    for plant, dash in _DASHES.items():
        if plant in plants and "physics" in plants:
            yield Entry(PLANTS[plant], INK, dash)
    if _SEEN in names:
        yield Entry("as the law sees it", INK, "dot")
    if any(panel.panel.reference is not None for panel in drawn):
        yield Entry("reference", INK, "dashdot")
    if any(panel.panel.limits for panel in drawn):
        yield Entry("limit", INK, "longdash")


def _colours(curves: Curves, drawn: Sequence[_DrawnPanel], most: int) -> dict[str, str]:
    """Return the colour of each law, grey for those beyond so many."""
    laws = list(dict.fromkeys(curve.law for panel in drawn for curve in panel.curves))
    # GROSMC and its variants come first: they are never among the grey ones.
    laws.sort(key=lambda law: not label_of(law).startswith("GROSMC"))
    own_entries = len(laws) if len(laws) <= most else most - 1
    colours = {}
    for index, law in enumerate(laws):
        style = curves.laws.get(law)
        colours[law] = style.colour if style and index < own_entries else _GREY_LAW
    return colours


def _law_entries(colours: dict[str, str]) -> Iterator[Entry]:
    """Yield an entry for each law with a colour, and one for the grey ones."""
    for law, colour in colours.items():
        if colour != _GREY_LAW:
            yield Entry(label_of(law), colour)
    if _GREY_LAW in colours.values():
        yield Entry("other laws", _GREY_LAW)


# -- traces and shapes ---------------------------------------------------------------------------


def _band(curve: Curve, colour: str, axis: str) -> Item:
    """Return the trace of a curve's range."""
    low, high = curve.range or ([], [])
    return {
        "type": "scatter",
        "mode": "lines",
        "yaxis": axis,
        "x": [*curve.t, *reversed(curve.t)],
        "y": [*high, *reversed(low)],
        "fill": "toself",
        "fillcolor": f"{colour}40",
        "line": {"width": 0},
        "hoverinfo": "skip",
    }


def _curve(
    curve: Curve,
    colour: str,
    axis: str,
    main: str,
) -> Item:
    """Return the trace of a curve; that on the main plant is solid."""
    plant = PLANTS.get(curve.plant, curve.plant)
    names = (label_of(curve.law), plant, curve.name)
    label = plain_text(", ".join(filter(None, names)))
    dash = "solid" if curve.plant == main else _DASHES.get(curve.plant, "solid")
    if curve.name == _SEEN:
        dash = "dot"
    return {
        "type": "scatter",
        "mode": "lines",
        "yaxis": axis,
        "name": label,
        "x": curve.t,
        "y": curve.y,
        "line": {"color": colour, "width": 2 if dash == "solid" else 1.5, "dash": dash},
        "hovertemplate": f"%{{y:.4g}} at %{{x:.3f}} s<extra>{label}</extra>",
    }


def _line(
    name: str,
    line: Line,
    dash: str,
    axis: str,
) -> Item:
    """Return the trace of a reference or of a limit."""
    return {
        "type": "scatter",
        "mode": "lines",
        "yaxis": axis,
        "x": line.t,
        "y": line.y,
        "name": plain_text(name),
        "line": {"color": INK, "width": 1.3, "dash": dash},
    }


def _shaded(window: Window) -> Item:
    """Return the shape that shades the time of a disturbance."""
    return {
        "type": "rect",
        "xref": "x",
        "yref": "paper",
        "x0": window.start,
        "x1": window.stop,
        "y0": 0,
        "y1": 1,
        "fillcolor": GREEN,
        "opacity": 0.1,
        "line": {"width": 0},
        "layer": "below",
    }


def _play(panel: _DrawnPanel) -> Item:
    """Return the shape that shades a gear's backlash."""
    play = panel.panel.play
    return {
        "type": "rect",
        "xref": "paper",
        "yref": panel.axis,
        "x0": 0,
        "x1": 1,
        "y0": -play / 2,
        "y1": play / 2,
        "fillcolor": _GREY,
        "opacity": 0.2,
    }
