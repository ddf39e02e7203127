"""Tables of what campaigns cost."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from grosmc_mj.bench.campaigns import Cost, Scaling
from grosmc_mj.bench.films import FilmRate
from grosmc_mj.bench.loops import Throughput
from grosmc_mj.report.tables import empty_table


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


def throughput_table(rows: Sequence[Throughput], what: str) -> Table:
    """What the benchmark measured of a system."""
    table = empty_table(f"{what}, a sample of the law at every timestep")
    table.add_column("loop", no_wrap=True)
    for header in ("simulations", "steps/s", "ratio"):
        table.add_column(escape(header), justify="right", no_wrap=True)
    table.add_column("to", no_wrap=True)
    for row in rows:
        table.add_row(
            row.loop, str(row.simulations), f"{row.rate:.3g}", f"{row.ratio:.3f}", row.baseline
        )
    return table


def film_rates_table(rows: Sequence[FilmRate], title: str) -> Table:
    """What the benchmark of films measured."""
    table = empty_table(title)
    table.add_column("frames", no_wrap=True)
    table.add_column("per second", justify="right", no_wrap=True)
    table.add_column("film's rate over it", justify="right", no_wrap=True)
    for row in rows:
        table.add_row(row.what, f"{row.rate:.1f}", f"{row.ratio:.2f}")
    return table
