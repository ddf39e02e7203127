"""One figure of a ladder: laws by rungs, climbing and each rung alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm

from grosmc_mj.results.figure import figure_written
from grosmc_mj.results.heat_map import heat_map
from grosmc_mj.studies.ladder.answers import share_text
from grosmc_mj.studies.ladder.measure import Condition, Ladder, Standing
from grosmc_mj.studies.ladder.rungs import Rung

# What is kept is blue; what is not is the redder the further it is beyond, up to a hundred times.
_KEPT, _BROKEN, _MOST = -0.3, 0.15, 2.0
_SCALE = TwoSlopeNorm(0.0, -1.0, _MOST)
_CELL, _ROW, _NAMES = 0.98, 0.36, 2.6
_NOTE = (
    "How much of the tightest limit is used. Blue: all is kept; the redder, the further beyond. "
    "ended: the run ended early; never: it does not settle; -: there is no such law. "
    "*: rests on numbers that are assumed."
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
        if condition is studied.conditions[0]:
            panels.append(("Each alone on the sampled plant", condition, False, studied.alone))
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
    names = [rung.name for rung in rungs]
    cells = {
        (laws.index(row.law.name), names.index(row.rung.name)): (_value(row), share_text(row))
        for row in rows
    }
    heat_map(axis, cells, laws, [rung.title for rung in rungs], _SCALE, width=widest)
    axis.set_xlim(-0.5, len(rungs) - 0.5)


def _value(row: Standing) -> float:
    """What the colour stands for."""
    if row.impossible:
        return math.nan
    return _KEPT if row.kept else _BROKEN + min(math.log10(max(row.used, 1.0)), _MOST)
