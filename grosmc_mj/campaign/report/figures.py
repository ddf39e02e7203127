"""The figures of a campaign: margins, the map of two numbers, the radius."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.family import Quantity
from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.findings import ALL, Findings
from grosmc_mj.campaign.findings.promise import premise_grid, speaks_of
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.campaign.report.margin_figure import MarginPanel, save_margins
from grosmc_mj.campaign.report.pass_map_figure import (
    AxisOf,
    Boundary,
    PassMap,
    Points,
    save_pass_map,
)
from grosmc_mj.campaign.report.radius_figure import RadiusCurve, save_radius
from grosmc_mj.campaign.runs.folder import Folder

# Runs that a map shows, and points of the premise's margin along each axis.
_MOST_POINTS, _GRID = 4096, 7
# Units for people.
_SHOWN = {"rad": ("°", 180 / math.pi), "rad/s": ("°/s", 180 / math.pi)}


def draw_margins(campaign: Campaign, found: Findings, files: Sequence[Path]) -> None:
    """The distribution of each requirement's margin."""
    requirements = list(dict.fromkeys(each.words for each in campaign.requirements)) or [ALL]
    panels = [
        MarginPanel(
            words,
            found.units[words],
            {
                law: each
                for (requirement, law), each in found.margins.items()
                if requirement == words
            },
        )
        for words in requirements
    ]
    title = f"{_title(campaign)}: margins ({found.looked_at.words})"
    save_margins(panels, title, found.sampled.footnote, files)


def draw_map(
    campaign: Campaign,
    folder: Folder,
    found: Findings,
    axes: tuple[Quantity, Quantity],
    files: Sequence[Path],
) -> None:
    """Which runs kept everything, over two of the uncertain numbers, and what premises promise."""
    shards = range(
        min(campaign.specification.shards, -(-_MOST_POINTS // campaign.specification.shard))
    )
    (_, first), (_, second) = (shown_unit(each.unit) for each in axes)
    laws, boundaries = {}, {}
    names = [each.name for each in axes]
    for law, columns in folder.columns(campaign, [*names, "relative"], shards).items():
        x, y = columns[names[0]] * first, columns[names[1]] * second
        laws[law] = Points(x, y, columns["relative"])
        grid = premise_grid(campaign, law, axes, _GRID) if all(map(speaks_of, axes)) else None
        if grid is not None:
            boundaries[law] = Boundary(grid[0] * first, grid[1] * second, grid[2])
    shown = PassMap(
        AxisOf(axes[0].name, shown_unit(axes[0].unit)[0]),
        AxisOf(axes[1].name, shown_unit(axes[1].unit)[0]),
        laws,
        boundaries,
    )
    drawn = found.looked_at._replace(runs=len(next(iter(laws.values())).x))
    title = f"{_title(campaign)}: all requirements ({drawn.words})"
    save_pass_map(shown, title, found.sampled.footnote, files)


def map_axes(
    campaign: Campaign, found: Findings, names: Sequence[str] = ()
) -> tuple[Quantity, Quantity] | None:
    """The two numbers of the map: the named ones, or those that drive margins most.

    Of the latter, those that premises speak of come first, since their boundary can be drawn over
    these. None where only one number is uncertain.
    """
    by_name = {each.name: each for each in campaign.family.quantities}
    if names:
        return by_name[names[0]], by_name[names[1]]
    shares: dict[str, float] = {}
    for several in found.sensitivities.values():
        for each in several:
            shares[each.parameter] = max(shares.get(each.parameter, 0.0), each.share or 0.0)
    ordered = sorted(by_name, key=lambda name: (not speaks_of(by_name[name]), -shares[name]))
    if len(ordered) < 2:
        return None
    first, second = sorted(ordered[:2], key=list(by_name).index)
    return by_name[first], by_name[second]


def draw_radius(campaign: Campaign, found: Sequence[Radius], files: Sequence[Path]) -> None:
    """The least margin over the scale of the uncertainty."""
    curves = [
        RadiusCurve(
            each.controller,
            np.array([look.scale for look in each.looks]),
            np.array([look.least for look in each.looks]),
            each.found or None,
            each.promised.scale,
            each.promised.note,
        )
        for each in found
    ]
    plants = max(each.plants for each in found)
    title = f"{_title(campaign)}: scale of the uncertainty ({plants} plants at each)"
    save_radius(curves, title, NO_PROOF, files)


def shown_unit(unit: str) -> tuple[str, float]:
    """The unit that people read, and the factor to it."""
    return _SHOWN.get(unit, (unit, 1.0))


def _title(campaign: Campaign) -> str:
    """What the campaign is about."""
    return campaign.experiment.case.title


def both(path: Path) -> list[Path]:
    """PNG and SVG of a figure."""
    return [path.with_suffix(".png"), path.with_suffix(".svg")]
