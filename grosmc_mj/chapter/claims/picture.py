"""The figure of a claim: its values beside the threshold, and the curves that show it."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from grosmc_mj.chapter.claims.claim import Finding, Measured
from grosmc_mj.chapter.figures import claim_runs, draw_quantity
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.output.charts.figure import TITLE_SIZE, draw_legend_below, figure_written
from grosmc_mj.output.palette import FAILED, KEPT, OPTIMUM, VERDICT_COLOURS

# Beyond this ratio of the largest to the smallest value the axis is logarithmic.
_WIDE = 30.0
# Height of the row of one value of a choice [inch].
_ROW = 0.22


def write_picture(finding: Finding, lab: RunCache, path: Path) -> Path:
    """Write the figure of a claim as PNG.

    Raises:
        SetupError: If it cannot be written.
    """
    claim = finding.claim
    above = 1.6 + _ROW * len(finding.trials)
    below = 4.0 if claim.drawing else 0.6
    with figure_written(path, (7.2, above + below), (".png",)) as figure:
        if claim.drawing is None:
            values = figure.subplots()
        else:
            values, curves = figure.subplots(2, 1, height_ratios=(above, below))
            case = claim.drawing["case"]
            laws = claim.drawing.get("laws", ("lqr", "grosmc"))
            results = claim_runs(lab, claim.system, case, laws)
            draw_quantity(curves, results, claim.drawing["quantity"])
            curves.set_xlabel("time t [s]")
            draw_legend_below(figure, (curves,))
        _draw_values(values, finding)
        figure.suptitle(f"{claim.id}: {finding.verdict.value}", fontsize=TITLE_SIZE)
    return path


def _draw_values(axes: Axes, finding: Finding) -> None:
    """Draw one row for each plant: filled at T, hollow at T/2, and the threshold.

    A row for each value of the choices that the claim is meant for follows, on the plant that
    decides.
    """
    claim = finding.claim
    rows = list(dict.fromkeys([*finding.plants, *finding.trials]))
    for name, on_plant in finding.plants.items():
        colour = VERDICT_COLOURS[on_plant.verdict.value]
        _draw_point(axes, rows.index(name), on_plant.measured, colour, colour)
        if on_plant.refined is not None:
            _draw_point(axes, rows.index(name), on_plant.refined, colour, "none")
    for name, trial in finding.trials.items():
        colour = KEPT if claim.holds(trial) else FAILED
        _draw_point(axes, rows.index(name), trial, colour, colour)

    axes.axvline(claim.threshold, color=OPTIMUM, ls="--", lw=1.2)
    axes.set_yticks(range(len(rows)), rows)
    axes.set_ylim(len(rows) - 0.5, -0.5)

    drawn = [claim.threshold, *_values(finding)]
    if min(drawn) > 0 and max(drawn) > _WIDE * min(drawn):
        axes.set_xscale("log")
    unit = ""
    if claim.unit != "1":
        unit = f" [{claim.unit}]"
    axes.set_xlabel(
        f"found{unit}; filled at T, hollow at T/2; dashed: {claim.sense} {claim.threshold:g}"
    )


def _draw_point(
    axes: Axes,
    row: int,
    measured: Measured,
    edge: str,
    face: str,
) -> None:
    """Draw a measurement, if it has a value."""
    if measured.value is not None:
        axes.plot(measured.value, row, "o", ms=7, mec=edge, mfc=face, mew=1.6, clip_on=False)


def _values(finding: Finding) -> list[float]:
    """All values of a finding."""
    measured = list(finding.trials.values())
    for on_plant in finding.plants.values():
        measured.append(on_plant.measured)
        if on_plant.refined is not None:
            measured.append(on_plant.refined)
    return [point.value for point in measured if point.value is not None]
