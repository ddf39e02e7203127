"""Style of the figures, and their files: PNG and SVG, written whole or not at all."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.files import atomic_write
from grosmc_mj.output.palette import DISTURBANCE, GRID

# Sizes of letters [point].
TITLE_SIZE = 11.5
_LEGEND_SIZE = 8.5
# Width of a letter over its size, rounded up.
_LETTER = 0.54
# Width of a legend's line and of the space around its label, in letters.
_HANDLE = 7
_ENDINGS = (".png", ".svg")
# matplotlib's own settings: without them a matplotlibrc, such as one in the working folder, counts.
DEFAULTS: dict[Any, Any] = {
    name: value for name, value in mpl.rcParamsDefault.items() if not name.startswith("backend")
}
STYLE: dict[Any, Any] = {
    **DEFAULTS,
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "legend.fontsize": _LEGEND_SIZE,
    "legend.framealpha": 0.9,
    "savefig.dpi": 150,
    "svg.hashsalt": "grosmc_mj",
    "figure.constrained_layout.use": True,
}


@contextlib.contextmanager
def figure_written(
    path: Path,
    size: tuple[float, float],
    suffixes: Sequence[str] = _ENDINGS,
) -> Iterator[Figure]:
    """Yield a figure to draw in; it is written when the block ends.

    Args:
        path: Path of the PNG; the SVG lies beside it.
        size: Width and height [inch].
        suffixes: Kinds of files to write, of ``.png`` and ``.svg``.

    Raises:
        SetupError: If a file cannot be written.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size)
        yield figure
        write_figure(figure, [path.with_suffix(suffix) for suffix in suffixes])


def write_figure(figure: Figure, files: Sequence[Path]) -> None:
    """Write a figure to PNG and SVG files, to all of them or to none.

    The files have no date in them: the same data give the same bytes.

    Raises:
        ArgumentError: If a file is neither a PNG nor an SVG.
        SetupError: If a file cannot be written.
    """
    for file in files:
        if file.suffix not in _ENDINGS:
            raise ArgumentError(f"{file.name}: a figure ends in {' or '.join(_ENDINGS)}")

    with mpl.rc_context(STYLE), contextlib.ExitStack() as stack:
        parts = [stack.enter_context(atomic_write(file)) for file in files]
        for part in parts:
            dated_by = "Date" if part.suffix == ".svg" else "Software"
            figure.savefig(part, format=part.suffix[1:], metadata={dated_by: None})
            # All files have the layout of the first.
            figure.set_layout_engine("none")


def draw_legend_below(figure: Figure, axes: Sequence[Axes], columns: int = 3) -> None:
    """Draw one legend for all panels below them, no wider than the figure.

    Args:
        figure: The figure.
        axes: Its panels.
        columns: Largest number of columns of the legend.
    """
    entries = {}
    for panel in axes:
        handles, labels = panel.get_legend_handles_labels()
        for handle, label in zip(handles, labels, strict=True):
            entries.setdefault(label, handle)

    letters = letters_in(figure.get_figwidth(), _LEGEND_SIZE)
    figure.legend(
        list(entries.values()),
        list(entries),
        loc="outside lower center",
        markerscale=8,
        ncols=_columns_in(list(entries), letters, columns),
    )


def _columns_in(labels: Sequence[str], letters: int, most: int) -> int:
    """Return the number of columns, filled one after the other, that fit into so many letters."""
    widths = [len(label) + _HANDLE for label in labels]
    for count in range(most, 1, -1):
        columns = np.array_split(widths, count)
        if sum(int(column.max(initial=0)) for column in columns) <= letters:
            return count
    return 1


def shade(
    axes: Axes,
    start: float,
    stop: float,
    label: str = "",
) -> None:
    """Shade the time in which a disturbance acts.

    Args:
        axes: The panel.
        start: Start of the disturbance [s].
        stop: End of the disturbance [s].
        label: Label in the legend; empty for none.
    """
    axes.axvspan(start, stop, color=DISTURBANCE, alpha=0.13, lw=0, label=label)


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
