"""The figure of a case: outputs, distance from the optimum, limits, s, input, what is unseen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.curves.panels import Curve, Panel, judged_in, levels_of, panels_of
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.results.envelope import envelope, jumps
from grosmc_mj.results.figure import TITLE_SIZE, labelled_below, shade
from grosmc_mj.results.palette import (
    BLACK,
    FAILED,
    LINES,
    ORANGE,
    PLANTS,
    REFERENCE,
    LawStyle,
    label_of,
    law_styles,
)
from grosmc_mj.simulation.trajectory import Status

# Of a panel [inch], and what stands around them all.
_WIDTH, _HEIGHT, _AROUND = 7.2, 1.9, 1.3
_ALONE: dict[str, Any] = {"lw": 1.6}
_LIMIT: dict[str, Any] = {"color": BLACK, "lw": 1.0, "ls": (0, (4, 2)), "zorder": 4}
# A rate as it is, and as a law sees it on top.
_TRUE: dict[str, Any] = {"color": BLACK, "lw": 3.2, "alpha": 0.45}
_SEEN: dict[str, Any] = {"color": ORANGE, "lw": 1.3}
_PLAY: dict[str, Any] = {"color": BLACK, "alpha": 0.13, "lw": 0}
_MARK_SIZE = 8
# More outputs than this are drawn side by side in pairs.
_ONE_BELOW_THE_OTHER = 3


def figure_size(results: Sequence[RunResult]) -> tuple[float, float]:
    """Width and height of the figure of these runs [inch]."""
    columns, rows = _grid(len(panels_of(results)), results)
    return columns * _WIDTH * (0.75 if columns > 1 else 1.0), rows * _HEIGHT + _AROUND


def draw_experiment(figure: Figure, results: Sequence[RunResult]) -> None:
    """Draw all runs of a case file on an empty figure, over time.

    A panel whose requirement is not kept has a frame and says which.
    """
    panels = panels_of(results)
    columns, rows = _grid(len(panels), results)
    axes = np.ravel(figure.subplots(rows, columns, sharex=True, squeeze=False))
    for empty in axes[len(panels) :]:
        empty.set_visible(False)
    styles, below = law_styles(result.controller.name for result in results), []
    for where, panel in zip(axes, panels, strict=False):
        several = len({curve.run.plant for curve in panel.curves}) > 1
        for curve in panel.curves:
            _draw(where, curve, styles, several=several)
        if panel.curves[0].name:
            # Above, where it hides nothing.
            corner: Any = {"loc": "lower right", "bbox_to_anchor": (1, 1), "borderaxespad": 0}
            where.legend(ncols=2, frameon=False, **corner)
        else:
            below.append(where)
        if panel.reference is not None:
            time = results[0].comparison.time
            where.plot(time, panel.reference, label="reference", **REFERENCE)
        if panel.play:
            where.axhspan(-panel.play / 2, panel.play / 2, label="backlash", **_PLAY)
        where.set_ylabel(panel.label)
        shade_disturbances(where, results[0].case)
        _mark(where, panel, results)
    for where in axes[max(0, len(panels) - columns) : len(panels)]:
        where.set_xlabel("time t [s]")
        where.tick_params(labelbottom=True)
    figure.suptitle(results[0].case.title, fontsize=TITLE_SIZE)
    labelled_below(figure, below)


def _grid(panels: int, results: Sequence[RunResult]) -> tuple[int, int]:
    """Columns and rows."""
    columns = 2 if len(results[0].comparison.outputs) > _ONE_BELOW_THE_OTHER else 1
    return columns, -(-panels // columns)


def _draw(axes: Axes, curve: Curve, styles: dict[str, LawStyle], *, several: bool) -> None:
    """A run's curve; of one that jumps at every sample its range and its mean."""
    run, time, values = curve.run, curve.time, curve.values
    law = styles[run.controller.name]
    style: dict[str, Any] = {
        "": {
            "color": law.colour,
            "label": f"{law.label}, {PLANTS[run.plant]}",
            **(LINES[run.plant] if several else _ALONE),
        },
        "true": {"label": "true", **_TRUE},
        "seen": {"label": f"seen by {label_of(run.controller.name)}", **_SEEN},
    }[curve.name]
    if not curve.name and run.status is not Status.COMPLETED and len(time):
        axes.plot(time[-1], values[-1], "X", color=law.colour, mec="white", ms=9)
        axes.annotate(
            "ended", (time[-1], values[-1]), (5, 3), textcoords="offset points",
            fontsize=_MARK_SIZE, color=law.colour, rotation=40,
        )  # fmt: skip
    if jumps(values[np.isfinite(values)]):
        found = envelope(time, values)
        ends = (found.time, found.least, found.largest)
        axes.fill_between(*ends, color=style["color"], alpha=0.25, lw=0)
        time, values = found.time, found.mean
    axes.plot(time, values, rasterized=True, **style)


def _mark(axes: Axes, panel: Panel, results: Sequence[RunResult]) -> None:
    """The limits of what a panel shows, and a frame with words where one is not kept."""
    judged = judged_in(panel, results)
    failed = [item for item in judged if not item.kept]
    for limit in dict.fromkeys(item.limit for item in judged):
        broken = any(item.limit == limit for item in failed)
        style = {"lw": 2.0, "label": "limit, not kept"} if broken else {"label": "limit"}
        for level in levels_of(limit, panel):
            axes.plot(*level, **{**_LIMIT, **style})
    if not failed:
        return
    for side in axes.spines.values():
        side.set(visible=True, color=FAILED, linewidth=1.6)
    laws = dict.fromkeys((each.limit.words, each.controller) for each in failed)
    title = "\n".join(f"not kept by {law}: {words}" for words, law in laws)
    axes.set_title(title, loc="right", fontsize=_MARK_SIZE, color=FAILED, pad=3)


def shade_disturbances(axes: Axes, case: Case) -> None:
    """Shade the time in which each disturbance of a case acts, on axes as long as it."""
    for disturbance in case.disturbances:
        start, stop = disturbance.window
        label = disturbance.label or f"disturbance on {disturbance.body}"
        shade(axes, start, min(stop, case.duration), label)
    axes.set_xlim(0, case.duration)
