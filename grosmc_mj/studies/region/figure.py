"""The maps of one system as a figure: plants below each other, laws side by side."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MaxNLocator

from grosmc_mj.report.figure import STYLE, save
from grosmc_mj.report.palette import LABELS
from grosmc_mj.studies.region.axes import Axis
from grosmc_mj.studies.region.measure import Region, RegionMap
from grosmc_mj.studies.region.outcome import Outcome

# Okabe and Ito's colours, which differ in lightness too.
OUTCOME_COLOURS: Mapping[Outcome, str] = {
    Outcome.CONVERGED: "#0072B2",
    Outcome.LEFT: "#E69F00",
    Outcome.SINGULAR: "#CC79A7",
    Outcome.NOT_CONVERGED: "#F0E442",
    Outcome.DIVERGED: "#222222",
}
# White on a dark rim, which shows on every outcome.
_OUTLINE: list[AbstractPathEffect] = [withStroke(linewidth=3.2, foreground="#222222")]


def save_figure(region: Region, maps: Sequence[RegionMap], files: Sequence[Path]) -> None:
    """Draw the maps and write them to each file, by its ending.

    Args:
        region: What the maps are of.
        maps: All of them.
        files: PNG or SVG.
    """
    with mpl.rc_context(STYLE):
        figure = _draw(region, maps)
        for file in files:
            save(figure, file)


def _draw(region: Region, maps: Sequence[RegionMap]) -> Figure:
    """The figure with its title and legend."""
    rows, columns = len(region.cases), len(region.controllers)
    figure = Figure(figsize=(1.2 + 3.3 * columns, 1.5 + 3.1 * rows))
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
        row[-1].set_ylabel(_broken(plant), rotation=270, va="bottom", fontsize=12)
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
    return figure


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
    law = LABELS.get(each.controller, each.controller)
    panel.set_title(f"{law}: {100 * part:.1f} % converge")
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


def _broken(title: str) -> str:
    """A title in lines that fit beside a panel."""
    return "\n".join(textwrap.wrap(title, 34))
