"""The figure of a claim: its values beside the threshold, and the curves that show it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from grosmc_mj.chapter.claims.claim import ClaimFinding, ClaimValue
from grosmc_mj.chapter.figures import case_panel, claim_runs, over_time
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.wording import titled
from grosmc_mj.output.charts.chart import Chart, ChartAxis, Layer, LevelLine, Marks, Panel
from grosmc_mj.output.charts.figure import write_chart
from grosmc_mj.output.palette import FAILED, INK, KEPT, VERDICT_COLOURS, Stroke

# Beyond this ratio of the largest to the smallest value the axis is logarithmic.
_WIDE = 30.0
# Width of a figure, height of its curves and of the row of one value of a choice [inch].
_WIDTH = 7.2
_CURVES = 4.0
_ROW = 0.22


def write_picture(finding: ClaimFinding, lab: RunCache, path: Path) -> Path:
    """Write the figure of a claim as PNG.

    Raises:
        SetupError: If it cannot be written.
    """
    return write_chart(_picture(finding, lab), path, (".png",))


def _picture(finding: ClaimFinding, lab: RunCache) -> Chart:
    """Return the values of a claim, and below them the curves that show it."""
    claim = finding.claim
    title = f"{claim.id}: {finding.verdict.value}"
    values = _values_panel(finding)
    if claim.drawing is None:
        return Chart([[values]], title=title, size=(_WIDTH, values.height + 0.6))

    laws = claim.drawing.get("laws", ("lqr", "grosmc"))
    results = claim_runs(lab, claim.system, claim.drawing["case"], laws)
    curves = over_time(case_panel(results, claim.drawing["quantity"]))
    curves = replace(curves, height=_CURVES)
    return Chart([[values], [curves]], title=title, size=(_WIDTH, values.height + _CURVES))


def _values_panel(finding: ClaimFinding) -> Panel:
    """Return one row for each plant: filled at T, hollow at T/2, and the threshold.

    A row for each value of the choices that the claim is meant for follows, on the plant that
    decides.
    """
    claim = finding.claim
    rows = list(dict.fromkeys([*finding.plants, *finding.trials]))
    layers: list[Layer] = []
    for name, on_plant in finding.plants.items():
        colour = VERDICT_COLOURS[on_plant.verdict.value]
        layers += _point(rows.index(name), on_plant.measured, colour)
        if on_plant.refined is not None:
            layers += _point(rows.index(name), on_plant.refined, colour, hollow=True)
    for name, trial in finding.trials.items():
        colour = KEPT if claim.holds(trial) else FAILED
        layers += _point(rows.index(name), trial, colour)
    layers.append(LevelLine("x", claim.threshold, Stroke(INK, 1.2, "dash")))

    shown = [claim.threshold, *_values(finding)]
    far = min(shown) > 0 and max(shown) > _WIDE * min(shown)
    found = titled("found", claim.unit)
    title = f"{found}; filled at T, hollow at T/2; dashed: {claim.sense} {claim.threshold:g}"
    names = {float(place): name for place, name in enumerate(rows)}
    return Panel(
        layers,
        ChartAxis(title, "log" if far else "linear"),
        # The first row is at the top.
        ChartAxis(ticks=names, low=len(rows) - 0.5, high=-0.5),
        height=1.6 + _ROW * len(finding.trials),
    )


def _point(
    row: int,
    measured: ClaimValue,
    colour: str,
    *,
    hollow: bool = False,
) -> list[Layer]:
    """Return the mark of a measurement, if it has a value."""
    if measured.value is None:
        return []
    return [Marks([measured.value], [float(row)], colour, size=7.0, hollow=hollow)]


def _values(finding: ClaimFinding) -> list[float]:
    """All values of a finding."""
    measured = list(finding.trials.values())
    for on_plant in finding.plants.values():
        measured.append(on_plant.measured)
        if on_plant.refined is not None:
            measured.append(on_plant.refined)
    return [point.value for point in measured if point.value is not None]
