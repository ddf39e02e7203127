"""Description of a chart as values: panels with axes, and the layers that lie in them.

A chart knows neither Matplotlib nor Plotly: `figure` writes it as PNG and SVG, and
`interactive` makes a figure of the page of it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.charts.envelope import envelope, jumps
from grosmc_mj.output.palette import INK, Stroke

Symbol = Literal[
    "", "circle", "square", "diamond", "triangle-up", "cross", "star", "triangle-down", "x"
]
Scale = Literal["linear", "log", "symlog"]

# Width of a letter over its size, rounded up.
_LETTER = 0.54


# -- layers ----------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Layer:
    """Part of a panel; one with a name has an entry in the legend."""

    name: str = ""


@dataclass(frozen=True)
class Curve(Layer):
    """A curve through points.

    Attributes:
        x: Numbers, (N,).
        y: Numbers, (N,); NaN where there is none.
        stroke: Colour, width and dashes; of width 0 without a line.
        symbol: Symbol on some ten of the points; empty for none.
        hollow: Indices of points with a hollow symbol, all of which have one then.
        texts: Text of each point, where a reader can point at one; empty for none.
        note: Text at the end of a level line, where there is room for one.
    """

    x: Any
    y: Any
    stroke: Stroke
    symbol: Symbol = ""
    hollow: Sequence[int] | None = None
    texts: Sequence[str] = ()
    note: str = ""


@dataclass(frozen=True)
class Band(Layer):
    """Area between two curves, (N,) each."""

    x: Any
    low: Any
    high: Any
    colour: str
    opacity: float = 0.25


@dataclass(frozen=True)
class Span(Layer):
    """Area between two values of an axis."""

    along: Literal["x", "y"]
    start: float
    stop: float
    colour: str
    opacity: float = 0.13


@dataclass(frozen=True)
class LevelLine(Layer):
    """Straight line at a value of an axis."""

    along: Literal["x", "y"]
    value: float
    stroke: Stroke


@dataclass(frozen=True)
class Marks(Layer):
    """Points without a line.

    Attributes:
        x: Numbers, (N,).
        y: Numbers, (N,); None for the lower edge of the panel.
        colour: Colour of the symbols.
        symbol: Their form.
        size: Their size [point].
        hollow: Whether only their edge is drawn.
        text: Text beside each of them.
    """

    x: Any
    y: Any
    colour: str
    symbol: Symbol = "circle"
    size: float = 6.0
    hollow: bool = False
    text: str = ""


@dataclass(frozen=True)
class Cells(Layer):
    """Rows and columns of coloured cells with a text in each, from kept to not kept.

    Attributes:
        rows: Names of the rows.
        columns: Names of the columns.
        values: Value of each cell; None for an empty cell.
        texts: Text in each cell.
        whys: Explanation of each cell, where a reader can point at one.
        most: Value of the end of the colour scale, to both sides.
    """

    rows: Sequence[str]
    columns: Sequence[str]
    values: Sequence[Sequence[float | None]]
    texts: Sequence[Sequence[str | None]]
    whys: Sequence[Sequence[str | None]]
    most: float


@dataclass(frozen=True)
class Tiles(Layer):
    """Plane of cells with one of some colours each.

    Attributes:
        x: Edges of the columns, (n + 1,).
        y: Edges of the rows, (m + 1,).
        numbers: Number of the colour of each cell, (m, n).
        colours: Name in the legend and colour of each number.
    """

    x: Array
    y: Array
    numbers: Array
    colours: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Outline(Layer):
    """White line around the part of a plane in which something is true.

    Attributes:
        x: Middles of the columns, (n,).
        y: Middles of the rows, (m,).
        inside: 1 inside and 0 outside, (m, n).
    """

    x: Array
    y: Array
    inside: Array


# -- panels ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ChartAxis:
    """An axis.

    Attributes:
        title: Quantity with its unit.
        scale: Logarithmic beyond ``linear`` to both sides of zero, if it is ``symlog``.
        linear: End of the linear part of a ``symlog`` axis.
        low: Lower end; None for one that fits the layers.
        high: Upper end; None for one that fits the layers.
        ticks: Texts of the ticks by their places; empty for ticks that suit the numbers.
    """

    title: str = ""
    scale: Scale = "linear"
    linear: float = 1.0
    low: float | None = None
    high: float | None = None
    ticks: Mapping[float, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Panel:
    """Layers on two axes; those of one kind lie above each other in their order.

    Attributes:
        layers: The layers.
        x: Horizontal axis.
        y: Vertical axis.
        name: Title at the left.
        remark: What is wrong with it, in the colour of failures above it; its frame has the colour.
        framed: Whether it has that frame.
        equal: Whether both axes have one scale.
        own_legend: Whether its legend stands above it, and not with that of the other panels.
        height: Height as a multiple of other panels'.
    """

    layers: Sequence[Layer]
    x: ChartAxis = ChartAxis()
    y: ChartAxis = ChartAxis()
    name: str = ""
    remark: str = ""
    framed: bool = False
    equal: bool = False
    own_legend: bool = False
    height: float = 1.0


@dataclass(frozen=True)
class LegendEntry:
    """Entry of a legend.

    Attributes:
        name: Its text.
        colour: Colour of its sign; ``INK`` for that of the text.
        sign: ``line``, ``dash``, ``dot`` ..., ``area``, or a symbol.
    """

    name: str
    colour: str
    sign: str = "line"


@dataclass(frozen=True)
class Chart:
    """Panels in rows with one legend.

    Attributes:
        rows: Panels of each row, from the top; a row may be shorter than the first.
        title: Title; empty for none.
        size: Width and height of a printed figure [inch].
        note: Text below the panels.
        legend: Where the legend of a printed figure stands.
        entries: Entries of the legend; None for those of the layers.
        shared: Axes that all panels share: ``x``, ``xy`` or none.
    """

    rows: Sequence[Sequence[Panel]]
    title: str = ""
    size: tuple[float, float] = (7.2, 4.0)
    note: str = ""
    legend: Literal["below", "right"] = "below"
    entries: Sequence[LegendEntry] | None = None
    shared: Literal["", "x", "xy"] = ""

    @property
    def panels(self) -> list[Panel]:
        """All panels, row by row."""
        return [panel for row in self.rows for panel in row]


def signal_layers(time: Array, values: Array, stroke: Stroke, name: str = "") -> list[Layer]:
    """Return the layers of a signal: a curve or, if it jumps at every sample, range and mean.

    Args:
        time: Instants [s], (N,).
        values: The signal, (N,); NaN where there is none.
        stroke: Line of the curve.
        name: Its entry in the legend.
    """
    if not jumps(values[np.isfinite(values)]):
        return [Curve(time, values, stroke, name=name)]
    band = envelope(time, values)
    return [
        Band(band.time, band.least, band.largest, stroke.colour),
        Curve(band.time, band.mean, stroke, name=name),
    ]


def level_line(y: float, name: str = "") -> LevelLine:
    """Return the dashed line of a bound across a panel."""
    return LevelLine("y", y, Stroke(INK, 0.9, "dash"), name=name)


# -- texts -----------------------------------------------------------------------------------------


# Letters in a line of a column's name: as many as a cell is wide, less a gap to the next name.
_COLUMN_NAME = 11


def column_name(name: str) -> str:
    """Wrap the name of a column of cells; a word of one letter more stays whole."""
    longest_word = max(map(len, name.split()), default=0)
    return in_lines(name, max(_COLUMN_NAME, min(longest_word, _COLUMN_NAME + 1)))


def in_lines(text: str, letters: int = 44) -> str:
    """Wrap a text into as few lines as possible, of about equal length.

    Args:
        text: The text.
        letters: Largest number of letters in a line.
    """
    lines = textwrap.wrap(text, letters)
    longest_word = max(map(len, text.split()), default=letters)

    # The narrowest lines that are not more of them leave no word alone in the last.
    for width in range(letters - 1, longest_word - 1, -1):
        narrower = textwrap.wrap(text, width)
        if len(narrower) != len(lines):
            break
        lines = narrower
    return "\n".join(lines)


def letters_in(width: float, size: float) -> int:
    """Return how many letters of a size [point] fit into a width [inch]; at least one."""
    return max(1, int(width * 72 / (_LETTER * size)))
