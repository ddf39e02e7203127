"""Which runs kept their requirements, over two parameters, beside what the premises promise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.family import Quantity
from grosmc_mj.campaign.findings.findings import Findings
from grosmc_mj.campaign.findings.promise import premise_grid, speaks_of
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.results.figure import board, in_lines, write_figure
from grosmc_mj.results.palette import BLACK, SKY, VERMILION, law_styles

_SIZE = (4.4, 4.1)
# Runs that a map shows, and points of the premise's margin along each axis.
_MOST_POINTS, _GRID = 4096, 7
_EDGE, _HATCH = "#117733", "//"
BOUNDARY = "premise's boundary (other parameters at their worst)"


# A colour and a marker for what became of a run; the later lie above.
_MARKS: Mapping[str, tuple[str, str]] = {
    "passed": (SKY, "o"),
    "failed": (VERMILION, "X"),
    "did not complete": (BLACK, "^"),
}


class Points(NamedTuple):
    """The runs of one law: both parameters, (n,), and the signed margin, (n,)."""

    x: Array
    y: Array
    margins: Array


class Boundary(NamedTuple):
    """The signed margin of the premises over a grid.

    Attributes:
      x: First parameter, (nx,), rising.
      y: Second, (ny,), rising.
      margin: (ny, nx); below zero a premise does not hold.
    """

    x: Array
    y: Array
    margin: Array


class PassMap(NamedTuple):
    """What is drawn.

    Attributes:
      x: The first parameter, with its unit.
      y: The second.
      laws: The runs of each law.
      boundary: Of the laws whose premises were asked.
    """

    x: str
    y: str
    laws: Mapping[str, Points]
    boundary: Mapping[str, Boundary]


def _outcomes(margins: Array) -> dict[str, NDArray[np.bool_]]:
    """Which runs came out how, a mask each: kept at 0 or more, -inf is a run not completed."""
    diverged = margins == -np.inf
    masks = margins >= 0, (margins < 0) & ~diverged, diverged
    return {outcome: mask for outcome, mask in zip(_MARKS, masks, strict=True) if mask.any()}


def write_pass_map(
    campaign: Campaign,
    folder: Folder,
    found: Findings,
    axes: tuple[Quantity, Quantity],
    files: Sequence[Path],
) -> None:
    """Draw which runs kept everything, over two uncertain numbers, into each file."""
    shown = pass_map_of(campaign, folder, axes)
    drawn = found.looked_at._replace(runs=len(next(iter(shown.laws.values())).x))
    title = f"{campaign.experiment.case.title}: all requirements ({drawn.words})"
    write_figure(draw_pass_map(shown, title, found.sampled.footnote), files)


def pass_map_of(campaign: Campaign, folder: Folder, axes: tuple[Quantity, Quantity]) -> PassMap:
    """What a map of a campaign's runs shows: the two numbers as they are run, in people's units."""
    shards = range(
        min(campaign.specification.shards, -(-_MOST_POINTS // campaign.specification.shard))
    )
    (first_unit, first), (second_unit, second) = (each.shown_unit for each in axes)
    laws, boundaries = {}, {}
    names = [each.name for each in axes]
    runs = folder.columns(campaign, [*names, "relative"], shards)
    for law in campaign.judged:
        columns = runs[law]
        x, y = (campaign.as_run(each, columns[each.name]) for each in axes)
        x, y = x * first, y * second
        laws[law] = Points(x, y, columns["relative"])
        grid = premise_grid(campaign, law, axes, _GRID) if all(map(speaks_of, axes)) else None
        if grid is not None:
            boundaries[law] = Boundary(grid[0] * first, grid[1] * second, grid[2])
    x_label, y_label = (
        f"{name} [{unit}]" if unit else name
        for name, unit in zip(names, (first_unit, second_unit), strict=True)
    )
    return PassMap(x_label, y_label, laws, boundaries)


def map_axes(
    campaign: Campaign, found: Findings, names: Sequence[str] = ()
) -> tuple[Quantity, Quantity] | None:
    """The two numbers of the map: the named ones, or those that drive margins most.

    None where only one number is uncertain, or nothing is required of any law.
    """
    if not campaign.judged:
        return None
    by_name = {each.name: each for each in campaign.family.quantities}
    if names:
        return by_name[names[0]], by_name[names[1]]
    shares: dict[str, float] = {}
    for several in found.sensitivities.values():
        for each in several:
            shares[each.parameter] = max(shares.get(each.parameter, 0.0), each.share or 0.0)
    ordered = sorted(by_name, key=lambda name: -shares.get(name, 0.0))
    if len(ordered) < 2:
        return None
    first, second = sorted(ordered[:2], key=list(by_name).index)
    return by_name[first], by_name[second]


def draw_pass_map(shown: PassMap, title: str, footnote: str) -> Figure:
    """A panel a law, a mark a run.

    Args:
        shown: What to draw.
        title: Of the figure: of what, and what was sampled.
        footnote: What it does not prove.
    """
    styles = law_styles(shown.laws)
    seen: set[str] = set()
    with board(len(shown.laws), _SIZE, title, footnote) as found:
        for axes, (law, points) in zip(found.panels, shown.laws.items(), strict=True):
            seen |= _draw(axes, points)
            if law in shown.boundary:
                _draw_boundary(axes, shown.boundary[law])
            rate = f"{np.count_nonzero(points.margins >= 0)} of {len(points.x)} passed"
            axes.set_title(in_lines(f"{styles[law].label}: {rate}"))
            axes.set_xlabel(shown.x)
            axes.set_ylabel(shown.y)
            axes.set_xlim(*_ends(shown, 0))
            axes.set_ylim(*_ends(shown, 1))
        found.area.legend(
            handles=_entries(seen, [each.margin for each in shown.boundary.values()]),
            loc="outside lower center",
            ncols=min(len(shown.laws), 2),
            frameon=False,
            handleheight=1.2,
        )
    return found.figure


def _ends(shown: PassMap, axis: int) -> tuple[float, float]:
    """The ends of an axis, the same for all laws: every run and every boundary is inside."""
    values = np.concatenate(
        [each[axis] for each in (*shown.laws.values(), *shown.boundary.values())]
    )
    low, high = float(values.min()), float(values.max())
    room = 0.02 * (high - low) or 0.5
    return (low - room, high + room)


def _draw(axes: Axes, points: Points) -> set[str]:
    """The runs of one law, and which outcomes there are."""
    masks = _outcomes(points.margins)
    area = float(np.clip(16000 / len(points.margins), 3, 40))
    for outcome, mask in masks.items():
        colour, marker = _MARKS[outcome]
        axes.scatter(
            points.x[mask], points.y[mask], s=area * (1 if outcome == "passed" else 1.4), c=colour,
            marker=marker, linewidths=0, zorder=2 + 0.1 * list(_MARKS).index(outcome),
            rasterized=True, label=outcome,
        )  # fmt: skip
    return set(masks)


def _draw_boundary(axes: Axes, boundary: Boundary) -> None:
    """The line on which the premises begin to fail, and hatching where they do."""
    x, y, margin = boundary
    # A contour needs finite numbers; beyond the largest, only the sign matters.
    finite = np.abs(margin[np.isfinite(margin)])
    cap = float(finite.max(initial=0.0)) or 1.0
    capped = np.clip(margin, -cap, cap)
    if (capped < 0).any():
        axes.contourf(
            x, y, capped, levels=[-2 * cap, 0.0], colors="none", hatches=[_HATCH], zorder=3,
        ).set(edgecolor=_EDGE, linewidth=0)  # fmt: skip
    if (capped < 0).any() and (capped >= 0).any():
        axes.contour(x, y, capped, levels=[0.0], colors=_EDGE, linewidths=2, zorder=4)


def _entries(seen: set[str], premises: Sequence[Array]) -> list[Artist]:
    """The legend's entries: the outcomes that occur, and what is drawn of the premises."""
    entries: list[Artist] = [
        Line2D([], [], ls="", marker=marker, color=colour, mew=0, ms=6, label=outcome)
        for outcome, (colour, marker) in _MARKS.items()
        if outcome in seen
    ]
    broken = [margin < 0 for margin in premises]
    if any(each.any() and not each.all() for each in broken):
        entries.append(Line2D([], [], color=_EDGE, lw=2, label=BOUNDARY))
    if any(each.any() for each in broken):
        entries.append(
            Patch(fc="none", ec=_EDGE, hatch=_HATCH, lw=0, label="a premise does not hold")
        )
    elif broken:
        entries.append(Line2D([], [], ls="", label="the premises hold all over the map"))
    return entries
