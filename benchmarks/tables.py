"""Tables of throughput and of what campaigns and films cost, on a screen and in a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmarks.campaigns import Cost, Scaling
from benchmarks.timing import Throughput
from grosmc_mj.results.document import origin
from grosmc_mj.results.tables import Table, numbers, table, words
from grosmc_mj.versions import DECISIVE, versions


def tables_text(tables: Iterable[Table]) -> str:
    """All tables in Markdown, below what they were measured on."""
    decisive = versions(("python", *DECISIVE)).items()
    on = [origin(None)["machine"], *(f"{name} {version}" for name, version in decisive)]
    lines = [f"Measured on {', '.join(on)}."]
    for each in tables:
        lines += ["", f"### {each.title}", "", *each.markdown()]
    return "\n".join(lines)


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
        [*words("loop"), *numbers("runs", "steps/s", "ratio", "middle half"), *words("to")],
        [
            (
                row.loop,
                str(row.simulations),
                f"{row.rate:.3g}",
                f"{row.ratio:.2f}",
                f"{row.low:.2f}-{row.high:.2f}",
                row.baseline,
            )
            for row in rows
        ],
    )
