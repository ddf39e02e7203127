"""What the figures of a campaign share: title, footnote, panels, and how each law looks."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from grosmc_mj.errors import ArgumentError
from grosmc_mj.files import written_aside
from grosmc_mj.report.figure import STYLE, save
from grosmc_mj.report.palette import COLOURS, LABELS, colour_of

# More room between the panels than a page of one curve needs.
WIDE_STYLE: dict[Any, Any] = {
    **STYLE,
    "figure.constrained_layout.w_pad": 0.1,
    "figure.constrained_layout.h_pad": 0.07,
}
FAILED_SHADE = "#f3e3d7"
_ENDINGS = (".png", ".svg")
# For those who see no colour.
_LINES = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)))
_TITLE_SIZE, _NOTE_SIZE = 13, 8.5
_NOTE = "#444444"
# Width of a letter over its size, and height of a line over it, on the safe side.
_LETTER, _LINE_HEIGHT = 0.54, 1.45


class LawStyle(NamedTuple):
    """How a law is drawn.

    Attributes:
      label: Its name for people.
      colour: #RRGGBB.
      line: Matplotlib's line style.
    """

    label: str
    colour: str
    line: str | tuple[float, tuple[float, ...]]


def law_styles(laws: Iterable[str]) -> dict[str, LawStyle]:
    """A style for each law; those without a colour of their own take the others in turn."""
    styles: dict[str, LawStyle] = {}
    others = 0
    for number, law in enumerate(laws):
        label, line = LABELS.get(law, law), _LINES[number % len(_LINES)]
        styles[law] = LawStyle(label, colour_of(law, others), line)
        others += law not in COLOURS
    return styles


class Board(NamedTuple):
    """A figure to draw in.

    Attributes:
      figure: The whole, with title and footnote.
      area: The part between them, which has the panels and a legend outside of them.
      panels: Row by row.
    """

    figure: Figure
    area: SubFigure
    panels: list[Axes]


def board(
    panels: int, size: tuple[float, float], title: str, footnote: str, *, columns: int = 2
) -> Board:
    """A figure of panels with a title above and a footnote below them.

    Args:
      panels: How many, at least one.
      size: Width and height of each [inch].
      title: Above all.
      footnote: Below all.
      columns: The most side by side.
    """
    across = min(panels, columns)
    rows = math.ceil(panels / across)
    width = max(across * size[0], 5.8)
    top = _broken(title, width, _TITLE_SIZE)
    note = _broken(footnote, width, _NOTE_SIZE)
    bottom = _height(note, _NOTE_SIZE)
    above = rows * size[1] + _height(top, _TITLE_SIZE)
    height = above + bottom
    figure = Figure(figsize=(width, height))
    # A legend outside of the panels would cover the footnote if both were in one part.
    parts = figure.add_gridspec(2, 1, height_ratios=(above, bottom))
    area = figure.add_subfigure(parts[0])
    area.suptitle(top, fontsize=_TITLE_SIZE)
    figure.text(0.1 / width, 0.06 / height, note, fontsize=_NOTE_SIZE, va="bottom", color=_NOTE)
    axes = [area.add_subplot(rows, across, number + 1) for number in range(panels)]
    return Board(figure, area, axes)


def in_lines(text: str, letters: int = 44) -> str:
    """A text in as few lines as fit, of about one length, so that none has a word alone."""
    lines = textwrap.wrap(text, letters)
    longest = max(map(len, text.split()), default=letters)
    while letters > longest and len(narrower := textwrap.wrap(text, letters - 1)) == len(lines):
        lines, letters = narrower, letters - 1
    return "\n".join(lines)


def write(figure: Figure, files: Sequence[Path]) -> None:
    """Write a figure to each file by its ending, whole or not at all.

    Raises:
      ArgumentError: If a file is neither a PNG nor an SVG.
      SetupError: If a file cannot be written.
    """
    for file in files:
        if file.suffix not in _ENDINGS:
            raise ArgumentError(f"{file.name}: a figure ends in {' or '.join(_ENDINGS)}")
    with mpl.rc_context(WIDE_STYLE):
        for file in files:
            with written_aside(file) as part:
                save(figure, part)


def _broken(text: str, width: float, size: float) -> str:
    """A text in lines that fit into a figure of that width [inch]."""
    return in_lines(text, int((width - 0.3) * 72 / (_LETTER * size)))


def _height(text: str, size: float) -> float:
    """What the lines of a text need [inch]."""
    return (text.count("\n") + 1) * size * _LINE_HEIGHT / 72 + 0.12 if text else 0.0
