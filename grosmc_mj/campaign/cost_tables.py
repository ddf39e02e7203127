"""Tables of what campaigns cost."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from grosmc_mj.campaign.benchmark import Cost, Scaling
from grosmc_mj.validation.tables import empty_table


def costs_table(found: Sequence[Cost]) -> Table:
    """Time and memory of whole campaigns."""
    table = empty_table("Whole campaigns of the pendulum under GROSMC, each a process of its own")
    for header in (
        "plants",
        "each [s]",
        "integrator",
        "physics steps",
        "time [s]",
        "largest memory [MB]",
    ):
        table.add_column(header, justify="right")
    for each in found:
        steps = each.runs * each.duration / 1e-3
        cells = (f"{steps:.3g}", f"{each.seconds:.1f}", f"{each.megabytes:.0f}")
        table.add_row(str(each.runs), f"{each.duration:g}", each.integrator, *cells)
    return table


def scalings_table(found: Sequence[Scaling]) -> Table:
    """Rate and efficiency of worker processes."""
    table = empty_table("Worker processes of one thread each")
    for header in ("workers", "runs a second", "efficiency"):
        table.add_column(header, justify="right")
    for each in found:
        table.add_row(str(each.workers), f"{each.rate:.1f}", f"{each.efficiency:.2f}")
    return table
