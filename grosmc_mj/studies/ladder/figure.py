"""One figure of a ladder: laws by rungs, climbing and each rung alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, TwoSlopeNorm

from grosmc_mj.report.figure import figure_written
from grosmc_mj.report.palette import BLACK, BLUE, VERMILION
from grosmc_mj.studies.ladder.answers import share_text
from grosmc_mj.studies.ladder.measure import Condition, Ladder, Standing
from grosmc_mj.studies.ladder.rungs import Rung

# What is kept is blue; what is not is the redder the further it is beyond, up to a hundred times.
_COLOURS = LinearSegmentedColormap.from_list("ladder", [BLUE, "#ffffff", VERMILION])
_KEPT, _MOST = -0.3, 2.0
_SCALE = TwoSlopeNorm(0.0, -1.0, _MOST)
_DARK = 0.6
_CELL, _ROW, _NAMES = 0.98, 0.36, 2.6
_NOTE = (
    "How much of the tightest limit is used. Blue: all is kept; the redder, the further beyond. "
    "ended: the run ended early; never: it does not settle; -: there is no such law."
)


def write_ladder_figure(studied: Ladder, rows: Sequence[Standing], path: Path) -> Path:
    """Draw a heat map of the shares used for each condition, climbing and alone.

    Args:
        studied: The target.
        rows: What has been found.
        path: The PNG; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    laws = list(dict.fromkeys(row.law.name for row in rows)) or [""]
    several = len(studied.conditions) > 1
    panels: list[tuple[str, Condition, bool, Sequence[Rung]]] = []
    for condition in studied.conditions:
        where = f" ({condition.name}: {condition.title})" if several else ""
        climbing = f"Each rung on top of the others{where}"
        panels.append((climbing, condition, True, studied.climbing))
        alone = f"Each alone on the sampled plant{where}"
        panels.append((alone, condition, False, studied.alone))
    widest = max(len(rungs) for *_, rungs in panels)
    size = (_NAMES + _CELL * widest + 1.2, (_ROW * len(laws) + 0.95) * len(panels) + 1.3)
    with figure_written(path, size) as figure:
        case = studied.machine.case
        figure.suptitle(f"{case.system}/{case.name}: where each law breaks", fontsize=14)
        axes = figure.subplots(len(panels), 1, squeeze=False)[:, 0]
        for (title, condition, together, rungs), axis in zip(panels, axes, strict=True):
            own = [r for r in rows if r.condition is condition and r.together is together]
            _panel(axis, own, laws, rungs, widest)
            axis.set_title(title, loc="left", fontsize=11.5, fontweight="bold")
        figure.supxlabel(_NOTE, fontsize=9, x=0.01, ha="left", color="#444444")
    return path


def _panel(
    axis: Axes, rows: Sequence[Standing], laws: Sequence[str], rungs: Sequence[Rung], widest: int
) -> None:
    """A cell for each law and rung."""
    values = np.full((len(laws), widest), np.nan)
    axis.set_facecolor("#eeeeee")
    axis.grid(visible=False)
    places = {rung.name: j for j, rung in enumerate(rungs)}
    for row in rows:
        i, j = laws.index(row.law.name), places[row.rung.name]
        values[i, j] = _KEPT if row.kept else 0.15 + min(math.log10(max(row.used, 1.0)), _MOST)
        if row.impossible:
            values[i, j] = np.nan
        dark = abs(float(_SCALE(values[i, j])) - 0.5) > _DARK / 2
        axis.text(
            j, i, share_text(row), ha="center", va="center", fontsize=11,
            color="white" if dark else BLACK,
        )  # fmt: skip
    axis.imshow(values, cmap=_COLOURS, norm=_SCALE, aspect="auto")
    axis.set_yticks(range(len(laws)), laws, fontsize=11)
    axis.set_xticks(range(len(rungs)), [rung.name for rung in rungs], fontsize=11)
    axis.set_xlim(-0.5, len(rungs) - 0.5)
    axis.tick_params(length=0)
    for side in axis.spines.values():
        side.set_visible(False)
    for j in range(1, len(rungs)):
        axis.axvline(j - 0.5, color="white", lw=2)
    for i in range(1, len(laws)):
        axis.axhline(i - 0.5, color="white", lw=2)
