"""The figure of a case file: output, distance from the optimum, sliding variable, input."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.runs import PlantName, RunResult
from grosmc_mj.report.figure import TITLE_SIZE, labelled_below, shade
from grosmc_mj.report.palette import LINES, PLANTS, REFERENCE, law_styles

SIZE = (7.2, 9.0)
_ALONE: dict[str, Any] = {"lw": 1.6}
# Thin enough to show how dense a signal is that jumps at every sample.
_THIN: dict[str, Any] = {"lw": 0.8}


def draw_experiment(figure: Figure, results: Sequence[RunResult]) -> None:
    """Draw all runs of a case file on an empty figure, over time."""
    sliding = any(result.trajectory.sliding is not None for result in results)
    panels = list(figure.subplots(4 if sliding else 3, 1, sharex=True))
    styles = law_styles(result.controller.name for result in results)
    smooth, switched = panels[:2], panels[2:]
    for result in results:
        law = styles[result.controller.name]
        label = f"{law.label}, {PLANTS[result.plant]}"
        line = LINES[result.plant] if len(_plants(results)) > 1 else _ALONE
        for panel, curve in zip(smooth, _outputs(result), strict=True):
            time = result.trajectory.time
            panel.plot(time, curve, color=law.colour, label=label, rasterized=True, **line)
    for result in _calmest_last(results):
        for panel, curve in zip(switched, _signals(result, sliding=sliding), strict=True):
            held = result.trajectory.time[:-1]
            colour = styles[result.controller.name].colour
            panel.plot(held, curve, color=colour, rasterized=True, **_THIN)
    _reference(panels[0], results[0])
    for panel, label in zip(panels, _labels(results, sliding=sliding), strict=True):
        panel.set_ylabel(label)
        shade_disturbances(panel, results[0].case)
    panels[-1].set_xlabel("time t [s]")
    figure.suptitle(results[0].case.title, fontsize=TITLE_SIZE)
    labelled_below(figure, panels)


def _plants(results: Sequence[RunResult]) -> list[PlantName]:
    """Plants that were run on."""
    return list(dict.fromkeys(result.plant for result in results))


def _calmest_last(results: Sequence[RunResult]) -> list[RunResult]:
    """The runs on the last plant, physics if it is there: what chatters is drawn below the rest."""
    last = [result for result in results if result.plant == _plants(results)[-1]]
    return sorted(last, key=lambda result: -(result.metrics["total_variation"].value or 0.0))


def _outputs(result: RunResult) -> list[Array]:
    """The output, or the size of several outputs' errors; and the distance from the optimum."""
    comparison, error = result.comparison, result.controller.designed.error
    output = comparison.error
    if len(comparison.outputs) == 1:
        output = comparison.reference[:, 0] + error.sign * comparison.error
    return [output, comparison.deviation]


def _signals(result: RunResult, *, sliding: bool) -> list[Array]:
    """s, where a law has a surface, and the input."""
    run = result.trajectory
    s = np.full(len(run.time) - 1, np.nan) if run.sliding is None else _largest(run.sliding)
    return [s, _largest(run.input)] if sliding else [_largest(run.input)]


def _largest(rows: Array) -> Array:
    """A single signal as it is; of several the largest magnitude."""
    return rows if rows.ndim == 1 else np.abs(rows).max(axis=1)


def _labels(results: Sequence[RunResult], *, sliding: bool) -> list[str]:
    """What the panels' axes are called."""
    result = results[0]
    error, system = result.controller.designed.error, result.trajectory.system
    several = len(result.comparison.outputs) > 1
    unit = error.units[result.comparison.outputs[0]]
    output = "|y − yᵣ|" if several else "output y"
    units = [unit for r in results if (unit := r.controller.designed.sliding_unit)]
    s = [f"{'largest |s|' if several else 's'} [{units[0]}]"] if sliding and units else []
    s = s or (["s"] if sliding else [])
    u = system.inputs[0]
    return [
        f"{output} [{unit}]",
        f"distance from y* [{unit}]",
        *s,
        f"{'largest |u|' if len(system.inputs) > 1 else u.name} [{u.unit}]",
    ]


def _reference(axes: Axes, result: RunResult) -> None:
    """Where the output should be."""
    comparison = result.comparison
    several = len(comparison.outputs) > 1
    y = np.zeros(len(comparison.time)) if several else comparison.reference[:, 0]
    axes.plot(comparison.time, y, label="reference", **REFERENCE)


def shade_disturbances(axes: Axes, case: Case) -> None:
    """Shade the time in which each disturbance of a case acts, on axes as long as it."""
    for disturbance in case.disturbances:
        start, stop = disturbance.window
        label = disturbance.label or f"disturbance on {disturbance.body}"
        shade(axes, start, min(stop, case.duration), label)
    axes.set_xlim(0, case.duration)
