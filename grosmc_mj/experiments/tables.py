"""Tables for people."""

from __future__ import annotations

from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from grosmc_mj.experiments.metrics import Metric
from grosmc_mj.experiments.requirements import Judgement
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.report.tables import empty_table, number
from grosmc_mj.simulation.trajectory import Status

# Header and metric of each column of numbers.
_COLUMNS = (
    ("max|x1\n-x1*|", "deviation"),
    ("settled\n[s]", "settling_time"),
    ("over-\nshoot %", "overshoot"),
    ("RMS\nx1", "rms_error"),
    ("max\n|s|", "max_sliding"),
    ("RMS\ns", "rms_sliding"),
    ("J of\nu_c", "cost_continuous"),
    ("J of\nall u", "cost_whole"),
    ("\nJ*", "cost_optimal"),
    ("var. of\nu per s", "total_variation"),
    ("max\n|u|", "max_input"),
)
# Names of its entries are as long: K11, K110.
_MATRIX = 3
_CART = ("cart\n[m]", "cart_travel")


def metric_cell(metric: Metric | None) -> str:
    """A metric in a table."""
    if metric is None:
        return ""
    if metric.value is None:
        return "never" if metric.note == "not reached" else "-"
    return number(metric.value)


def results_table(results: Sequence[RunResult]) -> Table:
    """The runs of one system."""
    system, error = results[0].trajectory.system, results[0].controller.error
    assert error is not None
    output = error.units[error.output_rows[0]]
    table = empty_table(f"{system.title}: x1 in {output}, u in {system.input.unit}")
    columns = [*_COLUMNS, _CART] if system.name == "cart_pendulum" else _COLUMNS
    for header in ("case", "plant", "law"):
        table.add_column(header, no_wrap=True)
    for header, _ in columns:
        table.add_column(escape(header), justify="right", no_wrap=True)
    shown = ""
    for result in results:
        if shown and shown != result.case.name:
            table.add_section()
        label = "" if shown == result.case.name else result.case.name
        shown, law = result.case.name, result.controller.name
        style = "bold" if law == "grosmc" else ""
        if result.status is not Status.COMPLETED:
            law, style = law + " (!)", "red"
        cells = [metric_cell(result.metrics.get(name)) for _, name in columns]
        table.add_row(label, result.plant, law, *cells, style=style)
    return table


def results_tables(results: Sequence[RunResult]) -> list[Table]:
    """All runs, a table for each system."""
    systems = dict.fromkeys(result.case.system for result in results)
    return [results_table([r for r in results if r.case.system == name]) for name in systems]


LEGEND = (
    "x1*: nominal optimum of each law. settled: for good within 2 % of the initial error (never: "
    "not within the run); it and the overshoot count up to the onset of a later disturbance. J: "
    "index of each law over the run (of u for lqr on the servo and the pendulum, of v after "
    "linearization), with the continuous part of the input alone and with all of it; J* its "
    "least value. On physics the laws use the corrected equations; those of the printed ones run "
    "on the printed plant only."
)


def requirements_table(judgements: Sequence[Judgement]) -> Table:
    """What was required, and whether it was kept."""
    table = empty_table("Requirements")
    for header in ("law", "plant", "requirement"):
        table.add_column(header, no_wrap=True)
    for header in ("measured", "margin"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("")
    for each in judgements:
        unit = each.limit.unit if each.limit.unit != "1" else ""
        measured = "-" if each.measured is None else f"{number(each.measured)} {unit}".strip()
        margin = "-" if each.margin is None else number(each.margin)
        said = "kept" if each.kept else "FAILED" + (f": {each.note}" if each.note else "")
        style = "" if each.kept else "red"
        table.add_row(
            each.controller, each.plant, each.limit.words, measured, margin, said, style=style
        )
    return table


def endings(results: Sequence[RunResult]) -> list[str]:
    """One line for each run that ended early."""
    return [f"(!) {result.key}: {result.ended}" for result in results if result.ended]


def gains_table(results: Sequence[RunResult]) -> Table:
    """The gains of each controller, and where its law stands in the chapter."""
    table = empty_table()
    for header in ("system", "designed on", "law", "equations", "gains"):
        table.add_column(header, no_wrap=header != "gains")
    seen = set()
    for result in results:
        equations = "printed" if result.plant == "printed" else "corrected"
        if result.trajectory.system.read_parameters is None and result.plant == "physics":
            equations = "MuJoCo"
        key = (result.case.system, equations, result.controller.name)
        if key in seen:
            continue
        seen.add(key)
        # Of a matrix for many joints most entries are zero.
        shown = [(n, v) for n, v in result.controller.gains.items() if v or len(n) < _MATRIX]
        gains = ", ".join(f"{n} = {v:.4g}" for n, v in shown)
        if result.controller.declared:
            gains += f"; computed for {result.controller.declared}"
        table.add_row(*key, result.controller.source, gains)
    return table
