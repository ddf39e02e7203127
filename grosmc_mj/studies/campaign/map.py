"""Scatter of kept and failed plants over two uncertain numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted, titled
from grosmc_mj.output.charts.chart import Chart, ChartAxis, Layer, Marks, Panel, Symbol
from grosmc_mj.output.charts.figure import LEGEND_BESIDE, write_chart
from grosmc_mj.output.charts.of_results import panels_chart
from grosmc_mj.output.palette import BLACK, SKY, VERMILION
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.findings import Findings
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.radius import Radius, chart
from grosmc_mj.studies.sweep.quantities import Quantity

# Inches: a panel, and the texts above and below the panels.
_PANEL = (4.4, 4.1)
_TEXTS = 1.0
# Plants that a map shows.
_MOST_PLANTS = 4096


class Mark(NamedTuple):
    """Colour and symbol of an outcome, and its size as a share of a circle's."""

    colour: str
    symbol: Symbol
    size: float


# The later ones lie above.
_MARKS: Mapping[str, Mark] = {
    "kept": Mark(SKY, "circle", 1.0),
    # Crosses and triangles look smaller than circles.
    "failed": Mark(VERMILION, "x", 1.2),
    "did not complete": Mark(BLACK, "triangle-up", 1.2),
}


class PassMap(NamedTuple):
    """Kept and failed plants over two uncertain numbers, as they are run.

    Attributes:
        titles: Of both axes, with units.
        runs: Of each law: both numbers in the units of the titles and the signed margin, (n,) each.
    """

    titles: tuple[str, str]
    runs: Mapping[str, tuple[Array, Array, Array]]


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
    title = campaign.experiment.title
    files = list[Path]()

    numbers = map_axes(campaign, findings, axes)
    if numbers is not None:
        shown = pass_map_of(campaign, folder, numbers)
        plants = len(next(iter(shown.runs.values()))[0])
        sampled = findings.sampled._replace(runs=plants)
        words = f"{title}: all requirements ({sampled.words})"
        path = folder.path / "map.png"
        files.append(write_chart(pass_map_chart(shown, words, findings.sampled.footnote), path))

    if reached:
        plants = max(search.plants for search in reached)
        words = f"{title}: scale of the uncertainty ({counted(plants, 'plant')} at each)"
        charts = [chart(search) for search in reached]
        files.append(write_chart(panels_chart(words, [charts]), folder.path / "radius.png"))
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
    if names:
        first, second = names
        return by_name[first], by_name[second]

    # The largest share of a margin that a number explains under any law.
    shares = dict.fromkeys(by_name, 0.0)
    for drivers in findings.sensitivities.values():
        for driver in drivers:
            shares[driver.parameter] = max(shares[driver.parameter], driver.share or 0.0)
    strongest = sorted(by_name, key=lambda name: -shares[name])[:2]
    # In the order of the file.
    first, second = (number for name, number in by_name.items() if name in strongest)
    return first, second


def pass_map_of(campaign: Campaign, folder: Folder, axes: tuple[Quantity, Quantity]) -> PassMap:
    """The map of a campaign's first plants."""
    specification = campaign.specification
    shards = range(min(specification.shards, -(-_MOST_PLANTS // specification.shard)))
    first, second = axes
    columns = folder.columns(campaign, [first.name, second.name, "relative"], shards)
    runs = {}
    for law in campaign.judged:
        x = _in_shown_unit(campaign, first, columns[law])
        y = _in_shown_unit(campaign, second, columns[law])
        runs[law] = (x, y, columns[law]["relative"])
    return PassMap((_title(first), _title(second)), runs)


def _in_shown_unit(campaign: Campaign, axis: Quantity, columns: Mapping[str, Array]) -> Array:
    """A number of each plant as it is run, in the unit that people read, (n,)."""
    _, factor = axis.shown_unit
    return campaign.as_run(axis, columns[axis.name]) * factor


def _title(axis: Quantity) -> str:
    """Name and unit of a number; a factor has none."""
    unit, _ = axis.shown_unit
    return titled(axis.name, unit)


def pass_map_chart(shown: PassMap, title: str, footnote: str) -> Chart:
    """Return a panel for each law, with a mark for each plant."""
    across, up = shown.titles
    panels = []
    for law, (x, y, margins) in shown.runs.items():
        kept = np.count_nonzero(margins >= 0)
        panels.append(
            Panel(
                _plants(x, y, margins),
                ChartAxis(across),
                ChartAxis(up if not panels else ""),
                name=f"{law}: {kept} of {len(margins)} kept",
            )
        )
    size = (_PANEL[0] * len(panels) + LEGEND_BESIDE, _PANEL[1] + _TEXTS)
    return Chart([panels], title=title, size=size, note=footnote, legend="right", shared="xy")


def _outcomes(margins: Array) -> dict[str, NDArray[np.bool_]]:
    """Plants of each outcome, (n,); a run that did not complete has a margin of -inf."""
    ended_early = margins == -np.inf
    return {
        "kept": margins >= 0,
        "failed": (margins < 0) & ~ended_early,
        "did not complete": ended_early,
    }


def _plants(x: Array, y: Array, margins: Array) -> list[Layer]:
    """Return a mark for each plant, smaller the more there are; failures lie above."""
    size = float(np.sqrt(np.clip(16000 / len(margins), 3, 40)))
    layers: list[Layer] = []
    for outcome, plants in _outcomes(margins).items():
        if plants.any():
            colour, symbol, share = _MARKS[outcome]
            layers.append(Marks(x[plants], y[plants], colour, symbol, share * size, name=outcome))
    return layers
