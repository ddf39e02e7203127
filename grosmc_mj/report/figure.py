"""The still figures' one style, and how they are written: PNG and SVG, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.files import written_aside
from grosmc_mj.report.palette import GRID

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
    "legend.fontsize": 8.5,
    "legend.framealpha": 0.9,
    "savefig.dpi": 150,
    "svg.hashsalt": "grosmc_mj",
    "figure.constrained_layout.use": True,
}


@contextmanager
def figure_written(
    path: Path, size: tuple[float, float], suffixes: tuple[str, ...] = (".png", ".svg")
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
        for suffix in suffixes:
            with written_aside(path.with_suffix(suffix)) as part:
                save(figure, part)


def save(figure: Figure, file: Path) -> None:
    """Write a PNG or SVG without a date: the same data give the same bytes."""
    metadata = {"Date": None} if file.suffix == ".svg" else {"Software": None}
    figure.savefig(file, format=file.suffix[1:], metadata=metadata)


def labelled_below(figure: Figure, axes: Sequence[Axes], columns: int = 3) -> None:
    """One legend for all panels, below them, where it hides nothing."""
    entries = {}
    for panel in axes:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=columns,
        markerscale=8,
    )  # fmt: skip
