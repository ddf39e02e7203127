"""Tables of what was searched for: the worst plants, and how far the uncertainty may grow."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.basis import NO_PROOF
from grosmc_mj.campaign.findings.radius import Radius
from grosmc_mj.campaign.findings.worst import Worst
from grosmc_mj.campaign.report.figures import shown_unit
from grosmc_mj.report.palette import LABELS
from grosmc_mj.report.tables import empty_table, number

_WIDTH = 100


def worst_table(campaign: Campaign, found: Sequence[Worst]) -> Table:
    """The worst plant under each controller, beside samples and as many random plants."""
    table = _table("The worst plant found: least margin in parts of its limit")
    table.add_column("law")
    for header in ("samples", "random", "search"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("the plant nearest to the nominal one that fails", overflow="fold", ratio=1)
    for each in found:
        nearest = "none was found"
        if each.shrunk is not None and each.shrunk_relative is not None:
            nearest = f"{plant_words(campaign, each.shrunk)}: margin {number(each.shrunk_relative)}"
        values = (each.samples, each.random, each.relative)
        table.add_row(LABELS.get(each.controller, each.controller), *map(number, values), nearest)
    runs = found[0].evaluations
    table.caption = escape(
        f"Samples: the worst run of the campaign. Search: differential evolution from the worst "
        f"samples, {runs} runs; random: {runs} random plants. Below zero something is not kept; "
        f"numbers not named are nominal. {NO_PROOF}"
    )
    return table


def radius_table(campaign: Campaign, found: Sequence[Radius]) -> Table:
    """How far the uncertainty may grow under each controller, beside what is promised."""
    table = _table("How far the uncertainty may grow: 1 is as declared")
    table.add_column("law")
    for header in ("no failure up to", "failure at", "promised"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("the failing plant just outside", overflow="fold", ratio=1)
    notes = []
    for each in found:
        outside, promised = each.outside, each.promised
        plant = "none was found" if outside is None else plant_words(campaign, outside.values)
        table.add_row(
            LABELS.get(each.controller, each.controller),
            f"{each.found:.3g}",
            "-" if outside is None else f"{outside.scale:.3g}",
            "-" if promised.scale is None else f"{promised.scale:.3g}",
            plant,
        )
        notes.append(f"{LABELS.get(each.controller, each.controller)}: {promised.note}.")
    table.caption = escape(
        f"{found[0].plants} plants at each scale, up to {max(each.largest for each in found):.3g}. "
        "Promised: scale up to which the premises hold for every extreme plant, so that |s| does "
        "not grow in continuous time; of the requirements they say nothing. "
        f"{' '.join(notes)} {NO_PROOF}"
    )
    return table


def _table(title: str) -> Table:
    """An empty table of the full width."""
    table = empty_table(title)
    table.width = _WIDTH
    table.caption_justify, table.caption_style = "left", "dim"
    return table


def plant_words(campaign: Campaign, values: Array) -> str:
    """The uncertain numbers that are not nominal."""
    parts = []
    for each, value in zip(campaign.family.quantities, values.tolist(), strict=True):
        unit, factor = shown_unit(each.unit)
        if value != each.nominal:
            parts.append(f"{each.name} {value * factor:.4g} {unit}".rstrip())
    return ", ".join(parts) or "the nominal one"
