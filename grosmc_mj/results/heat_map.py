"""A table of coloured cells with their values written in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm
from matplotlib.image import AxesImage

from grosmc_mj.results.palette import BLACK, FAILED, KEPT

# White is the limit.
_COLOURS = LinearSegmentedColormap.from_list("kept", [KEPT, "#ffffff", FAILED])
# Beyond this part of the scale the colour is too dark for black letters.
_DARK = 0.3
_LETTERS = 11


def heat_map(
    axis: Axes,
    cells: Mapping[tuple[int, int], tuple[float, str]],
    rows: Sequence[str],
    columns: Sequence[str],
    scale: TwoSlopeNorm,
    *,
    larger_is_better: bool = False,
    width: int | None = None,
) -> AxesImage:
    """Draw the cells.

    Args:
        axis: Where.
        cells: By row and column: a value, NaN for grey, and what is written there.
        rows: Names of the rows, the first at the top.
        columns: Names of the columns.
        scale: From the least value over the limit to the largest.
        larger_is_better: Whether the least value is the worst.
        width: Columns that there is room for; as many as there are by default.
    """
    values = np.full((len(rows), max(len(columns), width or 0)), np.nan)
    axis.set_facecolor("#eeeeee")
    axis.grid(visible=False)
    for (i, j), (value, text) in cells.items():
        values[i, j] = value
        dark = abs(float(scale(value)) - 0.5) > _DARK
        axis.text(
            j, i, text, ha="center", va="center", fontsize=_LETTERS,
            color="white" if dark else BLACK,
        )  # fmt: skip
    colours = _COLOURS.reversed() if larger_is_better else _COLOURS
    image = axis.imshow(values, cmap=colours, norm=scale, aspect="auto")
    axis.set_yticks(range(len(rows)), rows, fontsize=_LETTERS)
    axis.set_xticks(range(len(columns)), columns)
    axis.tick_params(length=0)
    for side in axis.spines.values():
        side.set_visible(False)
    for j in range(1, len(columns)):
        axis.axvline(j - 0.5, color="white", lw=2)
    for i in range(1, len(rows)):
        axis.axhline(i - 0.5, color="white", lw=2)
    return image
