"""Tables of throughput and of what campaigns and films cost."""

from __future__ import annotations

from collections.abc import Sequence

from rich.table import Table

from grosmc_mj.bench.campaigns import Cost, Scaling
from grosmc_mj.bench.films import FilmRate
from grosmc_mj.bench.timing import Throughput
from grosmc_mj.report.tables import numbers, table, words


def costs_table(found: Sequence[Cost]) -> Table:
    """Time and memory of whole campaigns."""
    return table(
        "Whole campaigns of the pendulum under GROSMC, each a process of its own",
        numbers(
            "plants", "each [s]", "integrator", "physics steps", "time [s]", "largest memory [MB]"
        ),
        [
            (
                str(each.runs), f"{each.duration:g}", each.integrator,
                f"{each.runs * each.duration / 1e-3:.3g}", f"{each.seconds:.1f}",
                f"{each.megabytes:.0f}",
            )
            for each in found
        ],
    )  # fmt: skip


def scalings_table(found: Sequence[Scaling]) -> Table:
    """Rate and efficiency of worker processes."""
    return table(
        "Worker processes of one thread each",
        numbers("workers", "runs a second", "efficiency"),
        [(str(each.workers), f"{each.rate:.1f}", f"{each.efficiency:.2f}") for each in found],
    )


def throughput_table(rows: Sequence[Throughput], what: str) -> Table:
    """What the benchmark measured of a system."""
    return table(
        f"{what}, a sample of the law at every timestep",
        [*words("loop"), *numbers("simulations", "steps/s", "ratio"), *words("to")],
        [
            (row.loop, str(row.simulations), f"{row.rate:.3g}", f"{row.ratio:.3f}", row.baseline)
            for row in rows
        ],
    )


def film_rates_table(rows: Sequence[FilmRate], title: str) -> Table:
    """What the benchmark of films measured."""
    return table(
        title,
        [*words("frames"), *numbers("per second", "film's rate over it")],
        [(row.what, f"{row.rate:.1f}", f"{row.ratio:.2f}") for row in rows],
    )
