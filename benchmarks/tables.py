"""Tables of throughput and of what campaigns and films cost, on a screen and in a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmarks.campaigns import Cost, Scaling
from benchmarks.timing import Throughput
from grosmc_mj.report.document import origin
from grosmc_mj.report.markdown import markdown_table
from grosmc_mj.report.tables import TableData, numbers, words
from grosmc_mj.versions import DECISIVE, versions


def tables_text(tables: Iterable[TableData]) -> str:
    """All tables in Markdown, below what they were measured on."""
    decisive = versions(("python", *DECISIVE)).items()
    on = [origin(None)["machine"], *(f"{name} {version}" for name, version in decisive)]
    lines = [f"Measured on {', '.join(on)}."]
    for title, columns, rows in tables:
        lines += ["", f"### {title}", "", *markdown_table(columns, rows)]
    return "\n".join(lines)


def costs_table(found: Sequence[Cost]) -> TableData:
    """Time and memory of whole campaigns."""
    return TableData(
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


def scalings_table(found: Sequence[Scaling]) -> TableData:
    """Rate and efficiency of worker processes."""
    return TableData(
        "Worker processes of one thread each",
        numbers("workers", "runs a second", "efficiency"),
        [(str(each.workers), f"{each.rate:.1f}", f"{each.efficiency:.2f}") for each in found],
    )


def throughput_table(rows: Sequence[Throughput], what: str) -> TableData:
    """What the benchmark measured of a system."""
    return TableData(
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
