"""The figure of a case file: output, distance from the optimum, sliding variable, input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.rendering.palette import DISTURBANCE, LABELS, OPTIMUM, colour_of
from grosmc_mj.validation.chapter_pictures import LINES, PLANTS
from grosmc_mj.validation.picture import labelled_below
from grosmc_mj.validation.runs import RunResult

SIZE = (7.2, 9.0)


def draw_experiment(figure: Figure, results: Sequence[RunResult]) -> None:
    """Draw all runs of a case file on an empty figure, over time."""
    sliding = any(result.trajectory.sliding is not None for result in results)
    panels = list(figure.subplots(4 if sliding else 3, 1, sharex=True))
    names = list(dict.fromkeys(result.controller.name for result in results))
    for result in results:
        colour = colour_of(result.controller.name, names.index(result.controller.name))
        for panel, (time, curve) in zip(panels, _curves(result, sliding=sliding), strict=True):
            name = LABELS.get(result.controller.name, result.controller.name)
            panel.plot(
                time, curve, color=colour, rasterized=True,
                label=f"{name}, {PLANTS[result.plant]}", **LINES[result.plant],
            )  # fmt: skip
    _reference(panels[0], results[0])
    for panel, label in zip(panels, _labels(results, sliding=sliding), strict=True):
        panel.set_ylabel(label)
        _shade(panel, results[0])
    panels[-1].set_xlabel("time t [s]")
    figure.suptitle(results[0].case.title, fontsize=11.5)
    labelled_below(figure, panels)


def _curves(result: RunResult, *, sliding: bool) -> list[tuple[Array, Array]]:
    """What each panel shows of a run; nothing where a law has no surface."""
    run, comparison = result.trajectory, result.comparison
    held = run.time[:-1]
    output = comparison.error
    if len(comparison.outputs) == 1 and result.controller.error is not None:
        output = comparison.reference[:, 0] + result.controller.error.sign * comparison.error
    found = [(run.time, output), (run.time, comparison.deviation)]
    if sliding:
        s = np.full(len(held), np.nan) if run.sliding is None else _largest(run.sliding)
        found.append((held, s))
    return [*found, (held, _largest(run.input))]


def _largest(rows: Array) -> Array:
    """A single signal as it is; of several the largest magnitude."""
    return rows if rows.ndim == 1 else np.abs(rows).max(axis=1)


def _labels(results: Sequence[RunResult], *, sliding: bool) -> list[str]:
    """What the panels' axes are called."""
    result = results[0]
    error, system = result.controller.error, result.trajectory.system
    assert error is not None
    several = len(result.comparison.outputs) > 1
    unit = error.units[result.comparison.outputs[0]]
    output = "|y − yᵣ|" if several else "output y"
    units = [r.controller.sliding_unit for r in results if r.controller.sliding_unit]
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
    axes.plot(comparison.time, y, color=OPTIMUM, lw=1, ls=(0, (1, 2)), label="reference", zorder=5)


def _shade(axes: Axes, result: RunResult) -> None:
    """Shade the time in which a disturbance acts."""
    end = result.case.duration
    for disturbance in result.case.disturbances:
        start, stop = disturbance.window
        label = disturbance.label or f"disturbance on {disturbance.body}"
        axes.axvspan(start, min(stop, end), color=DISTURBANCE, alpha=0.13, lw=0, label=label)
    axes.set_xlim(0, end)
