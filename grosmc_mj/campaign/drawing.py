"""What the figures of a campaign share: title, footnote, panels, and how each law looks."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.errors import ArgumentError
from grosmc_mj.files import written_aside
from grosmc_mj.rendering.figure import STYLE, save
from grosmc_mj.rendering.palette import COLOURS, LABELS, colour_of

FAILED_SHADE = "#f3e3d7"
_ENDINGS = (".png", ".svg")
# For those who see no colour.
_LINES = ("-", (0, (5, 2)), (0, (1, 1.2)), (0, (6, 2, 1, 2)))
_TITLE_SIZE, _NOTE_SIZE = 13, 8.5
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


def panelled(
    panels: int, size: tuple[float, float], title: str, footnote: str, *, columns: int = 3
) -> tuple[Figure, list[Axes]]:
    """A figure of panels with a title above and a footnote below them.

    Args:
      panels: How many, at least one.
      size: Width and height of each [inch].
      title: Above all.
      footnote: Below all.
      columns: The most side by side.

    Returns:
      The figure and its axes, row by row.
    """
    across = min(panels, columns)
    rows = math.ceil(panels / across)
    width = max(across * size[0], 5.8)
    top = _broken(title, width, _TITLE_SIZE)
    note = _broken(footnote, width, _NOTE_SIZE)
    bottom = _height(note, _NOTE_SIZE)
    height = rows * size[1] + _height(top, _TITLE_SIZE) + bottom
    figure = Figure(figsize=(width, height))
    figure.suptitle(top, fontsize=_TITLE_SIZE)
    figure.text(0.1 / width, 0.06 / height, note, fontsize=_NOTE_SIZE, va="bottom", color="#444444")
    engine = figure.get_layout_engine()
    assert engine is not None
    engine.set(rect=(0, bottom / height, 1, 1 - bottom / height))  # pyright: ignore
    axes = [figure.add_subplot(rows, across, number + 1) for number in range(panels)]
    return figure, axes


def legend_entries(axes: Axes) -> list[str]:
    """The texts of a panel's legend."""
    legend = axes.get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


def checked_files(files: Sequence[Path]) -> None:
    """Require endings that can be written.

    Raises:
      ArgumentError: If a file is neither a PNG nor an SVG.
    """
    for file in files:
        if file.suffix not in _ENDINGS:
            raise ArgumentError(f"{file.name}: a figure ends in {' or '.join(_ENDINGS)}")


def write(figure: Figure, files: Sequence[Path]) -> None:
    """Write a figure to each file by its ending, whole or not at all.

    Raises:
      ArgumentError: If a file is neither a PNG nor an SVG.
      SetupError: If a file cannot be written.
    """
    checked_files(files)
    with mpl.rc_context(STYLE):
        for file in files:
            with written_aside(file) as part:
                save(figure, part)


def _broken(text: str, width: float, size: float) -> str:
    """A text in lines that fit into a figure of that width [inch]."""
    return "\n".join(textwrap.wrap(text, max(int((width - 0.3) * 72 / (_LETTER * size)), 20)))


def _height(text: str, size: float) -> float:
    """What the lines of a text need [inch]."""
    return (text.count("\n") + 1) * size * _LINE_HEIGHT / 72 + 0.12 if text else 0.0
