"""The figure of a claim: its values beside the threshold, and the curves that show it."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from grosmc_mj.chapter.claims.claim import Finding
from grosmc_mj.chapter.figures import claim_panel
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.results.figure import TITLE_SIZE, figure_written
from grosmc_mj.results.palette import FAILED, KEPT, OPTIMUM, VERDICT_COLOURS

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
    above, below = 1.6 + _ROW * len(finding.trials), 3.6 if claim.drawing else 0.6
    with figure_written(path, (7.2, above + below), (".png",)) as figure:
        if claim.drawing is None:
            values = figure.subplots()
        else:
            values, curves = figure.subplots(2, 1, height_ratios=(above, below))
            panel, runs = claim_panel(lab, claim.system, **claim.drawing)
            panel.draw(curves, runs)
            curves.set_xlabel("time t [s]")
            curves.legend(loc="best")
        _draw_values(values, finding)
        figure.suptitle(f"{claim.id}: {finding.verdict.value}", fontsize=TITLE_SIZE)
    return path


def _draw_values(axes: Axes, finding: Finding) -> None:
    """One row for each plant: filled at T, hollow at T/2, and the threshold.

    Then one for each value of the choices that the claim is meant for, on the plant that decides.
    """
    claim, points, drawn = finding.claim, [], [finding.claim.threshold]
    for name, on_plant in finding.plants.items():
        colour = VERDICT_COLOURS[on_plant.verdict.value]
        points += [
            (name, on_plant.measured, colour, colour),
            (name, on_plant.refined, colour, "none"),
        ]
    for name, trial in finding.trials.items():
        colour = KEPT if claim.holds(trial) else FAILED
        points.append((name, trial, colour, colour))
    rows = list(dict.fromkeys(name for name, *_ in points))
    for name, at, edge, face in points:
        if at is not None and at.value is not None:
            row = rows.index(name)
            axes.plot(at.value, row, "o", ms=7, mec=edge, mfc=face, mew=1.6, clip_on=False)
            drawn.append(at.value)
    axes.axvline(claim.threshold, color=OPTIMUM, ls="--", lw=1.2)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    if min(drawn) > 0 and max(drawn) > _WIDE * min(drawn):
        axes.set_xscale("log")
    unit = f" [{claim.unit}]" if claim.unit != "1" else ""
    words = f"found{unit}; filled at T, hollow at T/2; dashed: {claim.sense} {claim.threshold:g}"
    axes.set_xlabel(words)
