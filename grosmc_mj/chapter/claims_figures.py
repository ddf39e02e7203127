"""The figure of a claim: what was found beside what it needs, and the curves that show it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes

from grosmc_mj.chapter.claims.claim import Claim, Drawing, Finding, Verdict
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.results.envelope import jumps
from grosmc_mj.results.figure import TITLE_SIZE, figure_written
from grosmc_mj.results.palette import COLOURS, FAILED, KEPT, OPTIMUM, VERDICT_COLOURS

_DOTS = {
    Verdict.SUPPORTED: "o",
    Verdict.REFUTED: "X",
    Verdict.UNDETERMINED: "D",
    Verdict.PREMISE_NOT_MET: "P",
    Verdict.INCONCLUSIVE: "s",
}
# Beyond this ratio of the largest to the smallest value the axis is logarithmic.
_WIDE = 30.0
# Of the height of a figure, for a value of a choice [inch].
_ROW = 0.22


def write_picture(finding: Finding, lab: Laboratory, path: Path) -> Path:
    """Write the figure of a claim as PNG.

    Raises:
        SetupError: If it cannot be written.
    """
    claim = finding.claim
    drawing = claim.drawing(lab) if claim.drawing is not None else None
    above = 1.6 + _ROW * len(finding.trials)
    with figure_written(path, (7.2, above + (3.6 if drawing else 0.6)), (".png",)) as figure:
        if drawing is None:
            values = figure.subplots()
        else:
            values, curves = figure.subplots(2, 1, height_ratios=(above, 3.6))
            _draw_curves(curves, drawing)
        _draw_values(values, finding)
        figure.suptitle(f"{claim.id}: {finding.verdict.value}", fontsize=TITLE_SIZE)
    return path


def _draw_values(axes: Axes, finding: Finding) -> None:
    """One row for each plant: filled at T, hollow at T/2, and the threshold.

    Then one for each value of the choices that the claim is meant for, on the plant that decides.
    """
    claim, trials = finding.claim, finding.trials
    rows = [*finding.plants, *trials]
    for row, tried in enumerate(trials.values(), start=len(finding.plants)):
        if tried.value is not None:
            colour, marker = (KEPT, "o") if claim.holds(tried) else (FAILED, "X")
            axes.plot(tried.value, row, marker, ms=6, color=colour, clip_on=False)
    for row, plant in enumerate(finding.plants):
        found = finding.plants[plant]
        colour, marker = VERDICT_COLOURS[found.verdict.value], _DOTS[found.verdict]
        for measured, face in ((found.measured, colour), (found.refined, "none")):
            if measured is not None and measured.value is not None:
                axes.plot(
                    measured.value, row, marker, ms=8, mec=colour, mfc=face, mew=1.6, clip_on=False
                )
    axes.axvline(claim.threshold, color=OPTIMUM, ls="--", lw=1.2)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    if _is_wide(claim, finding):
        axes.set_xscale("log")
    sense = "at most" if claim.sense == "at most" else "at least"
    unit = f" [{claim.unit}]" if claim.unit != "1" else ""
    axes.set_xlabel(f"found{unit}; filled at T, hollow at T/2; dashed: {sense} {claim.threshold:g}")


def _is_wide(claim: Claim, finding: Finding) -> bool:
    """Whether values and threshold differ by orders of magnitude."""
    values = [each.measured.value for each in finding.plants.values()]
    values += [each.value for each in finding.trials.values()]
    there = [abs(value) for value in (*values, claim.threshold) if value]
    everything_positive = all(value is None or value > 0 for value in (*values, claim.threshold))
    return everything_positive and bool(there) and max(there) > _WIDE * min(there)


def _draw_curves(axes: Axes, drawing: Drawing) -> None:
    """The curves; one that jumps at every sample is drawn thin."""
    for curve in drawing.curves:
        colour = COLOURS.get(curve.controller, OPTIMUM)
        chatters = jumps(curve.y)
        style: dict[str, Any] = {"lw": 0.7 if chatters else 1.6}
        if not curve.controller and not chatters:
            style = {"lw": 1.0, "ls": (0, (3, 2))}
        axes.plot(
            curve.x, curve.y, color=colour, label=curve.label, zorder=2 + (not curve.controller),
            rasterized=True, **style,
        )  # fmt: skip
    axes.set_xlabel(drawing.x_label)
    axes.set_ylabel(drawing.y_label)
    axes.legend(loc="best")
