"""Map of passed and failed runs over two uncertain numbers, with the premises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from grosmc_mj.arrays import Array
from grosmc_mj.results.charts import write_panels
from grosmc_mj.results.figure import figure_written, in_lines
from grosmc_mj.results.palette import BLACK, SKY, VERMILION, law_styles
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.family import Quantity
from grosmc_mj.sweep.findings import Findings
from grosmc_mj.sweep.promise import premise_grid
from grosmc_mj.sweep.radius import Radius, chart
from grosmc_mj.sweep.store import Folder

# Inches: a panel, and beside the panels the legend.
_MAP_SIZE, _LEGEND = (4.4, 4.1), 2.4


# Runs that a map shows, and points of the premise's margin along each axis.
_MOST_POINTS, _GRID = 4096, 7


_EDGE, _HATCH = "#117733", "//"


# A colour and a marker for what became of a run; the later lie above.
_MARKS: Mapping[str, tuple[str, str]] = {
    "passed": (SKY, "o"),
    "failed": (VERMILION, "X"),
    "did not complete": (BLACK, "^"),
}


class PassMap(NamedTuple):
    """Passed and failed runs over two uncertain numbers, as they are run, in people's units.

    Attributes:
      titles: Of both axes, with units.
      runs: Of each law: both numbers and the signed margin, (n,) each.
      premises: Of the laws that have some: their signed margin over a grid: both numbers, (nx,) and
        (ny,), and the margin, (ny, nx); below zero a premise does not hold.
    """

    titles: tuple[str, str]
    runs: Mapping[str, tuple[Array, Array, Array]]
    premises: Mapping[str, tuple[Array, Array, Array]]


def write_figures(
    campaign: Campaign,
    folder: Folder,
    findings: Findings,
    reached: Sequence[Radius],
    axes: Sequence[str] = (),
) -> list[Path]:
    """Write each figure that there is something for, as PNG and SVG; returns the PNGs.

    Args:
        campaign: The campaign.
        folder: Where it is kept.
        findings: What its runs say.
        reached: How far the uncertainty may grow; empty if nobody looked.
        axes: Names of the two numbers of the map; empty for those that drive margins most.
    """
    title, files = campaign.experiment.case.title, list[Path]()
    if (pair := map_axes(campaign, findings, axes)) is not None:
        shown = pass_map_of(campaign, folder, pair)
        count = len(next(iter(shown.runs.values()))[0])
        words = f"{title}: all requirements ({findings.sampled._replace(runs=count).words})"
        path = folder.path / "map.png"
        files.append(write_pass_map(path, shown, words, findings.sampled.footnote))
    if reached:
        plants = max(search.plants for search in reached)
        words = f"{title}: scale of the uncertainty ({plants} plants at each)"
        charts = [chart(search) for search in reached]
        files.append(write_panels(folder.path / "radius.png", words, [charts]))
    return files


def map_axes(
    campaign: Campaign, findings: Findings, names: Sequence[str] = ()
) -> tuple[Quantity, Quantity] | None:
    """The two numbers of the map: the named ones, or those that drive margins most.

    None where only one number is uncertain, or nothing is required of any law.
    """
    by_name = {number.name: number for number in campaign.family.quantities}
    if not campaign.judged or len(by_name) < 2:
        return None
    shares = dict.fromkeys(by_name, 0.0)
    for driver in (driver for drivers in findings.sensitivities.values() for driver in drivers):
        shares[driver.parameter] = max(shares[driver.parameter], driver.share or 0.0)
    strongest = sorted(by_name, key=lambda name: -shares[name])[:2]
    first, second = names or sorted(strongest, key=list(by_name).index)
    return by_name[first], by_name[second]


def pass_map_of(campaign: Campaign, folder: Folder, axes: tuple[Quantity, Quantity]) -> PassMap:
    """The map of a campaign's first runs."""
    specification = campaign.specification
    shards = range(min(specification.shards, -(-_MOST_POINTS // specification.shard)))
    names, factors = [axis.name for axis in axes], [axis.shown_unit[1] for axis in axes]
    columns, runs, premises = folder.columns(campaign, [*names, "relative"], shards), {}, {}
    spoken = all(axis.in_premises for axis in axes)
    for law in campaign.judged:
        x, y = (campaign.as_run(axis, columns[law][axis.name]) for axis in axes)
        runs[law] = (x * factors[0], y * factors[1], columns[law]["relative"])
        grid = premise_grid(campaign, law, axes, _GRID) if spoken else None
        if grid is not None:
            premises[law] = (grid[0] * factors[0], grid[1] * factors[1], grid[2])
    first, second = (f"{axis.name} [{axis.shown_unit[0]}]".removesuffix(" []") for axis in axes)
    return PassMap((first, second), runs, premises)


def write_pass_map(path: Path, shown: PassMap, title: str, footnote: str) -> Path:
    """Draw a panel a law, a mark a run; hatched where a premise does not hold."""
    styles, entries = law_styles(shown.runs), dict[str, Artist]()
    width, height = _MAP_SIZE[0] * len(shown.runs), _MAP_SIZE[1]
    with figure_written(path, (width + _LEGEND, height + 1.0)) as figure:
        figure.suptitle(in_lines(title, round(9 * width)), fontsize=13)
        figure.supxlabel(in_lines(footnote, round(16 * width)), fontsize=8.5)
        panels = figure.subplots(1, len(shown.runs), squeeze=False)[0]
        for axes, (law, (x, y, margins)) in zip(panels, shown.runs.items(), strict=True):
            diverged, size = margins == -np.inf, float(np.clip(16000 / len(margins), 3, 40))
            masks = (margins >= 0, (margins < 0) & ~diverged, diverged)
            for above, (outcome, mask) in enumerate(zip(_MARKS, masks, strict=True)):
                colour, marker = _MARKS[outcome]
                if mask.any():
                    style: dict[str, Any] = {"marker": marker, "label": outcome}
                    axes.scatter(
                        x[mask], y[mask], s=size * (1.4 if above else 1), c=colour, linewidths=0,
                        zorder=2 + 0.1 * above, rasterized=True, **style,
                    )  # fmt: skip
                    entries[outcome] = Line2D([], [], ls="", color=colour, mew=0, ms=6, **style)
            if law in shown.premises:
                entries |= _draw_premises(axes, *shown.premises[law])
            kept = f"{np.count_nonzero(margins >= 0)} of {len(margins)} passed"
            axes.set(xlabel=shown.titles[0], ylabel=shown.titles[1])
            axes.set_title(in_lines(f"{styles[law].label}: {kept}"))
            axes.margins(0.02)
        figure.legend(handles=list(entries.values()), loc="outside right upper", frameon=False)
    return path


def _draw_premises(axes: Axes, x: Array, y: Array, margin: Array) -> dict[str, Artist]:
    """The line on which the premises begin to fail, and hatching where they do; its legend."""
    # A contour needs finite numbers; beyond the largest, only the sign matters.
    cap = float(np.abs(margin[np.isfinite(margin)]).max(initial=0.0)) or 1.0
    capped, entries = np.clip(margin, -cap, cap), dict[str, Artist]()
    if not (capped < 0).any():
        return {"hold": Line2D([], [], ls="", label="the premises hold\nall over the map")}
    areas = axes.contourf(
        x, y, capped, levels=[-2 * cap, 0.0], colors="none", hatches=[_HATCH], zorder=3
    )
    areas.set(edgecolor=_EDGE, linewidth=0)
    fails = "a premise does not hold\n(other parameters at their worst)"
    entries["fail"] = Patch(fc="none", ec=_EDGE, hatch=_HATCH, lw=0, label=fails)
    if (capped >= 0).any():
        axes.contour(x, y, capped, levels=[0.0], colors=_EDGE, linewidths=2, zorder=4)
        entries["boundary"] = Line2D([], [], color=_EDGE, lw=2, label="premise's boundary")
    return entries
