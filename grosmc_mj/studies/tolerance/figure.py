"""One figure of what each law stands: laws by imperfections, a panel for each condition."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from grosmc_mj.results.figure import figure_written, in_lines, letters_in
from grosmc_mj.results.heat_map import heat_map
from grosmc_mj.results.tables import number
from grosmc_mj.studies.tolerance.answers import (
    by_weakness,
    cell_text,
    none_of_it,
    stands_ideally,
    unit_and_scale,
    weakness,
)
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.measure import Tolerance
from grosmc_mj.studies.tolerance.search import LEAST, MOST
from grosmc_mj.studies.tolerance.setting import Setting

_SCALE = TwoSlopeNorm(0.0, math.log2(LEAST), math.log2(MOST))
_CELL, _ROW, _NAMES = 1.12, 0.36, 2.6
_NOTE = (
    "Amounts up to which all is kept, of the first part; no: not kept without it; none: only "
    "without it; ≥ and ≤: kept up to\nthe last that was tried; *: kept again beyond; "
    "!: physics said something else than the equations, and counts."
)


def write_tolerance_figure(studied: Setting, rows: Sequence[Tolerance], path: Path) -> Path:
    """Draw a heat map of log2 of the factor for each condition, amounts written in.

    Args:
        studied: The target.
        rows: What has been found.
        path: The PNG; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    columns = by_weakness([row for row in rows if row.ideally])
    panels = [
        (condition, laws)
        for condition in studied.conditions
        if (laws := _standing(rows, condition.name))
    ]
    heights = [len(laws) + 1.2 for _, laws in panels] or [1.0]
    size = (_NAMES + _CELL * max(4, len(columns)) + 0.9, _ROW * sum(heights) + 2.5)
    with figure_written(path, size) as figure:
        figure.suptitle(f"{studied.target}: what of the loop each law stands", fontsize=14)
        axes = figure.subplots(max(1, len(panels)), 1, squeeze=False, height_ratios=heights)
        image = None
        for panel, ((condition, laws), axis) in enumerate(zip(panels, axes[:, 0], strict=True)):
            own = [row for row in rows if row.condition == condition.name]
            others = dict.fromkeys(row.law for row in own if row.law not in laws)
            image = _panel(axis, own, laws, columns, last=panel == len(panels) - 1)
            title = f"{condition.name}: {condition.title}"
            axis.set_title(title, loc="left", fontsize=11.5, fontweight="bold")
            if others:
                said = f"not kept even ideally: {', '.join(others)}"
                axis.annotate(
                    said, (1, 1), (0, 5), "axes fraction", "offset points", ha="right",
                    fontsize=8, color="#555555",
                )  # fmt: skip
        figure.supxlabel(_NOTE, fontsize=9, x=0.01, ha="left", color="#444444")
        if image is not None:
            _bar(figure, image, list(axes[:, 0]), _ROW * sum(heights))
        else:
            axes[0, 0].axis("off")
            axes[0, 0].text(0.5, 0.5, "No law keeps everything even ideally", ha="center")
    return path


def _standing(rows: Sequence[Tolerance], condition: str) -> list[str]:
    """The laws that keep everything ideally, the strongest first."""
    own = [row for row in rows if row.condition == condition]
    laws = dict.fromkeys(row.law for row in own)
    found = [law for law in laws if stands_ideally(own, law, condition)]

    def least(law: str) -> float:
        return min(weakness(row) for row in own if row.law == law)

    return sorted(found, key=least, reverse=True)


def _panel(
    axis: Axes,
    rows: Sequence[Tolerance],
    laws: Sequence[str],
    columns: Sequence[Imperfection],
    *,
    last: bool,
) -> AxesImage:
    """One condition: a cell for each law and imperfection."""
    cells = {
        (laws.index(row.law), columns.index(row.imperfection)): (_value(row), cell_text(row))
        for row in rows
        if row.law in laws and row.imperfection in columns
    }
    names = [_label(each) for each in columns]
    image = heat_map(axis, cells, laws, names, _SCALE, larger_is_better=True)
    if not last:
        axis.set_xticks(range(len(columns)), [""] * len(columns))
    return image


def _value(row: Tolerance) -> float:
    """log2 of the factor that is stood; the worst of all where there is none."""
    if row.impossible:
        return math.nan
    if not row.imperfection.graded:
        return math.log2(MOST) if row.unbroken else math.log2(LEAST)
    if not row.ideally or none_of_it(row):
        return math.log2(LEAST)
    return math.log2(MOST) if row.failed is None else math.log2(row.largest)


def _label(imperfection: Imperfection) -> str:
    """What a column is of, with its unit and what the bench has."""
    unit, scale = unit_and_scale(imperfection)
    name = imperfection.name.replace(", ", "\n+ ").replace(" ", "\n", 1)
    if not imperfection.graded:
        return name
    if imperfection.whole:
        return "all,\ntimes\nthe bench"
    return f"{name}\n[{unit}]\nbench {number(imperfection.shown(1.0) * scale)}"


def _bar(figure: Figure, image: object, axes: Sequence[Axes], height: float) -> None:
    """The legend of the colours, beside axes of that height [inch]."""
    ticks = [-4, -2, 0, 2, 4, 6, 8, 10]
    bar = figure.colorbar(image, ax=list(axes), fraction=0.03, pad=0.01, aspect=40)  # pyright: ignore[reportArgumentType]
    labels = [f"{2.0**tick:g}" if tick < 0 else f"{2**tick}" for tick in ticks]
    bar.set_ticks(ticks, labels=labels)
    bar.set_label(in_lines("kept up to so many times the bench's amount", letters_in(height, 10)))
    bar.outline.set_visible(False)
