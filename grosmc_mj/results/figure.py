"""The still figures' one style, and how they are written: PNG and SVG, whole or not at all."""

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

from grosmc_mj.errors import ArgumentError
from grosmc_mj.files import written_aside
from grosmc_mj.results.palette import DISTURBANCE, GRID

_LEGEND_SIZE = 8.5
# What a legend's line and the space around its label take, in letters.
_HANDLE = 7
# matplotlib's own settings, whatever a matplotlibrc says: one in the working folder comes first.
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
TITLE_SIZE = 11.5
_ENDINGS = (".png", ".svg")
# Width of a letter over its size, on the safe side.
_LETTER = 0.54


@contextlib.contextmanager
def figure_written(
    path: Path, size: tuple[float, float], suffixes: Sequence[str] = _ENDINGS
) -> Iterator[Figure]:
    """A figure to draw in, written when the block ends.

    Args:
        path: The PNG; the SVG lies beside it.
        size: Width and height [inch].
        suffixes: Which of the two.

    Raises:
        SetupError: If a file cannot be written.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size)
        yield figure
        write_figure(figure, [path.with_suffix(suffix) for suffix in suffixes])


def write_figure(figure: Figure, files: Sequence[Path]) -> None:
    """Write a figure to each file by its ending, all of them or none.

    Without a date in it: the same data give the same bytes.

    Raises:
        ArgumentError: If a file is neither a PNG nor an SVG.
        SetupError: If a file cannot be written.
    """
    for file in files:
        if file.suffix not in _ENDINGS:
            raise ArgumentError(f"{file.name}: a figure ends in {' or '.join(_ENDINGS)}")
    with mpl.rc_context(STYLE), contextlib.ExitStack() as parts:
        for part in [parts.enter_context(written_aside(file)) for file in files]:
            metadata = {"Date": None} if part.suffix == ".svg" else {"Software": None}
            figure.savefig(part, format=part.suffix[1:], metadata=metadata)
            # The layout of the first file is that of all.
            figure.set_layout_engine("none")


def labelled_below(figure: Figure, axes: Sequence[Axes], columns: int = 3) -> None:
    """One legend for all panels, below them, where it hides nothing, no wider than the figure.

    Args:
        figure: The whole.
        axes: The panels.
        columns: Of the legend, at most.
    """
    entries = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    labels = list(entries)
    figure.legend(
        list(entries.values()), labels, loc="outside lower center", markerscale=8,
        ncols=_columns_in(labels, letters_in(figure.get_figwidth(), _LEGEND_SIZE), columns),
    )  # fmt: skip


def _columns_in(labels: Sequence[str], letters: int, most: int) -> int:
    """In how many columns, filled one after the other, labels fit into so many letters."""
    for count in range(most, 1, -1):
        columns = np.array_split([len(label) + _HANDLE for label in labels], count)
        if sum(int(column.max(initial=0)) for column in columns) <= letters:
            return count
    return 1


def shade(axes: Axes, start: float, stop: float, label: str = "") -> None:
    """Shade the time in which a disturbance acts [s]."""
    axes.axvspan(start, stop, color=DISTURBANCE, alpha=0.13, lw=0, label=label)


def in_lines(text: str, letters: int = 44) -> str:
    """A text in as few lines as fit, of about one length, so that none has a word alone."""
    lines = textwrap.wrap(text, letters)
    longest = max(map(len, text.split()), default=letters)
    while letters > longest and len(narrower := textwrap.wrap(text, letters - 1)) == len(lines):
        lines, letters = narrower, letters - 1
    return "\n".join(lines)


def letters_in(width: float, size: float) -> int:
    """How many letters of a size [point] fit into a width [inch]; at least one."""
    return max(1, int(width * 72 / (_LETTER * size)))
