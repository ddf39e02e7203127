"""Tables of throughput and of what campaigns and films cost, on a screen and in a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from benchmarks.campaigns import Cost, Scaling
from benchmarks.growth import Growth
from benchmarks.timing import Ratio, Throughput
from benchmarks.tuning import Tuning
from grosmc_mj.ground.versions import DECISIVE, versions
from grosmc_mj.output.results.document import origin
from grosmc_mj.output.results.tables import Table, numbers, table, words


def tables_text(tables: Iterable[Table]) -> str:
    """All tables in Markdown, below the machine and the versions that they were measured with."""
    decisive = versions(("python", *DECISIVE)).items()
    measured_on = [origin(None)["machine"], *(f"{name} {version}" for name, version in decisive)]
    lines = [f"Measured on {', '.join(measured_on)}."]
    for item in tables:
        lines += ["", f"### {item.title}", "", *item.markdown()]
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
                str(cost.runs),
                f"{cost.duration:g}",
                cost.integrator,
                f"{cost.runs * cost.duration / 1e-3:.3g}",
                f"{cost.seconds:.1f}",
                f"{cost.megabytes:.0f}",
            )
            for cost in found
        ],
    )


def scalings_table(found: Sequence[Scaling]) -> Table:
    """Rate and efficiency of worker processes."""
    return table(
        "Worker processes of one thread each",
        numbers("workers", "runs a second", "efficiency"),
        [(str(row.workers), f"{row.rate:.1f}", f"{row.efficiency:.2f}") for row in found],
    )


def tuning_table(found: Tuning) -> Table:
    """Cost of a search for numbers."""
    return table(
        "Tuning LQR on servo/machine, four draws of a design",
        numbers("runs", "runs a second", "beside a plain batch", "runs with racing, over all"),
        [(str(found.runs), f"{found.rate:.1f}", f"{found.beside_batch:.2f}", f"{found.raced:.2f}")],
    )


def growth_table(found: Sequence[Growth]) -> Table:
    """Cost of batches over their runs and timesteps."""
    return table(
        "A batch in one thread: fixed cost + runs x (cost of a run + steps x cost of a step)",
        [
            *words("case"),
            *numbers("states", "inputs"),
            *words("integrator"),
            *numbers("fixed [ms]", "run [us]", "step [us]", "MuJoCo's step as shipped [us]"),
        ],
        [
            (
                row.case,
                str(row.states),
                str(row.inputs),
                row.integrator,
                f"{row.fixed:.2f}",
                f"{row.run:.0f}",
                f"{row.step:.2f}",
                f"{row.shipped_step:.2f}",
            )
            for row in found
        ],
    )


def throughput_table(rows: Sequence[Throughput], system: str) -> Table:
    """Rates of loops, and their ratios to MuJoCo's open loop as shipped and without its clock."""
    return table(
        f"{system}, a sample of the law at every timestep",
        [
            *words("loop"),
            *numbers("runs", "steps/s"),
            *numbers("to shipped", "middle half", "to no clock", "middle half"),
        ],
        [
            (row.loop, str(row.simulations), f"{row.rate:.3g}", *_cells(row.shipped, row.untimed))
            for row in rows
        ],
    )


def _cells(*ratios: Ratio) -> list[str]:
    """Median and middle half of each ratio."""
    cells = []
    for ratio in ratios:
        cells += [f"{ratio.median:.2f}", f"{ratio.low:.2f}-{ratio.high:.2f}"]
    return cells
