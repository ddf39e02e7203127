"""The maps of one system as a figure: plants below each other, laws side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MaxNLocator

from grosmc_mj.results.figure import figure_written, in_lines
from grosmc_mj.results.palette import BLACK, BLUE, ORANGE, PURPLE, YELLOW, label_of
from grosmc_mj.studies.region.axes import Axis
from grosmc_mj.studies.region.measure import Region
from grosmc_mj.studies.region.outcome import Outcome
from grosmc_mj.studies.region.region_map import RegionMap

# They differ in lightness too.
OUTCOME_COLOURS: Mapping[Outcome, str] = {
    Outcome.CONVERGED: BLUE,
    Outcome.LEFT: ORANGE,
    Outcome.SINGULAR: PURPLE,
    Outcome.NOT_CONVERGED: YELLOW,
    Outcome.DIVERGED: BLACK,
}
# White on a dark rim, which shows on every outcome.
_OUTLINE: list[AbstractPathEffect] = [withStroke(linewidth=3.2, foreground=BLACK)]


def write_region_figure(region: Region, maps: Sequence[RegionMap], path: Path) -> None:
    """Draw the maps, as PNG and SVG.

    Args:
        region: What the maps are of.
        maps: All of them.
        path: The PNG; the SVG lies beside it.

    Raises:
        SetupError: If a file cannot be written.
    """
    size = (1.2 + 3.3 * len(region.controllers), 1.5 + 3.1 * len(region.cases))
    with figure_written(path, size) as figure:
        _draw(figure, region, maps)


def _draw(figure: Figure, region: Region, maps: Sequence[RegionMap]) -> None:
    """The maps with their title and legend."""
    rows, columns = len(region.cases), len(region.controllers)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    by_name = {(each.case.name, each.controller): each for each in maps}
    nominal = region.cases[0]
    outlined = False
    for row, case in zip(panels, region.cases, strict=True):
        for panel, name in zip(row, region.controllers, strict=True):
            _panel(panel, by_name[case.name, name], region.axes)
            if case is not nominal:
                outlined |= _outline(panel, by_name[nominal.name, name], region.axes)
        plant = "Nominal plant" if case is nominal else f"{case.name}: {case.title}"
        row[0].set_ylabel(region.axes[1].label)
        row[-1].yaxis.set_label_position("right")
        row[-1].set_ylabel(in_lines(plant, 34), rotation=270, va="bottom", fontsize=12)
    for panel in panels[-1]:
        panel.set_xlabel(region.axes[0].label)
    how = f"{region.question.settings.switching} switching"
    title = f"{region.system.title}: from where each law converges ({how})"
    figure.suptitle(title, fontsize=14)
    figure.legend(
        handles=_entries(maps, outlined=outlined),
        loc="outside lower center",
        ncols=4 if columns > 2 else 2,
    )


def _panel(panel: Axes, each: RegionMap, axes: tuple[Axis, Axis]) -> None:
    """One map, a coloured cell for each start."""
    order = list(OUTCOME_COLOURS)
    index = np.zeros(each.grid.shape)
    for number, outcome in enumerate(order):
        index[each.grid == outcome.value] = number
    edges = [np.linspace(-1, 1, len(each.grid) + 1) * axis.shown(axis.limit) for axis in axes]
    panel.pcolormesh(
        *edges,
        index,
        cmap=ListedColormap([OUTCOME_COLOURS[outcome] for outcome in order]),
        vmin=-0.5,
        vmax=len(order) - 0.5,
        rasterized=True,
    )
    part = each.fractions()[Outcome.CONVERGED]
    panel.set_title(f"{label_of(each.controller)}: {100 * part:.1f} % converge")
    if axes[0].unit == "rad":
        panel.xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 3, 4.5, 9, 10]))


def _outline(panel: Axes, nominal: RegionMap, axes: tuple[Axis, Axis]) -> bool:
    """The edge of what converges on the nominal plant, if it has one inside the map."""
    good = nominal.grid == Outcome.CONVERGED.value
    if good.all() or not good.any():
        return False
    centres = [axis.cells(len(good)) * axis.shown(1.0) for axis in axes]
    line = panel.contour(*centres, good.astype(float), levels=[0.5], colors="white", linewidths=1.6)
    line.set_path_effects(_OUTLINE)
    return True


def _entries(maps: Sequence[RegionMap], *, outlined: bool) -> list[Artist]:
    """The legend's entries: the outcomes that occur."""
    entries: list[Artist] = [
        Patch(facecolor=colour, edgecolor="#444444", label=outcome.title)
        for outcome, colour in OUTCOME_COLOURS.items()
        if any(each.counts()[outcome] for each in maps)
    ]
    if outlined:
        label = "edge of what converges on the nominal plant"
        entries.append(Line2D([], [], color="white", lw=1.6, label=label, path_effects=_OUTLINE))
    return entries
