"""Tables of runs, of what was required of them, and of gains."""

from __future__ import annotations

from collections.abc import Sequence

from grosmc_mj.experiments.metrics import Metric
from grosmc_mj.experiments.requirements import Judgement
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
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
    ("\nJ*", "cost_optimal"),
    ("J of u_d\n/J* [1/s]", ""),
    ("var. of\nu per s", "total_variation"),
    ("max\n|u|", "max_input"),
)
# Names of its entries are as long: K11, K110.
_MATRIX = 3
_CART = ("cart\n[m]", "cart_travel")


def metric_cell(metric: Metric | None, factor: float = 1.0) -> str:
    """A metric in a table, in other units by a factor."""
    if metric is None:
        return ""
    if metric.value is None:
        return "never" if metric.note == "not reached" else "-"
    return number(factor * metric.value)


def results_table(results: Sequence[RunResult]) -> Table:
    """The runs of one system."""
    system, error = results[0].trajectory.system, results[0].controller.designed.error
    output = error.units[error.output_rows[0]]
    columns = [*_COLUMNS, _CART] if system.name == "cart_pendulum" else _COLUMNS
    rows, styles = [], []
    for result in results:
        law, ended = result.controller.name, result.status is not Status.COMPLETED
        metrics = {**result.metrics, "": result.cost_shares[1]}
        cells = [metric_cell(metrics.get(name)) for _, name in columns]
        rows.append((result.case.name, result.plant, law + (" (!)" if ended else ""), *cells))
        styles.append("red" if ended else "bold" if law == "grosmc" else "")
    return table(
        f"{system.title}: x1 in {output}, u in {system.input.unit}",
        [*words("case", "plant", "law"), *numbers(*(header for header, _ in columns))],
        rows,
        styles=styles,
        grouped=True,
    )


LEGEND = (
    "x1*: nominal optimum of each law. settled: for good within 2 % of the initial error (never: "
    "not within the run); it and the overshoot count up to the onset of a later disturbance. J: "
    "index of each law over the run (of u for lqr on the servo and the pendulum, of v after "
    "linearization) with the continuous part of the input alone; J* its least value; what the "
    "rest of the input, u_d, costs is told per second. On physics the laws use the corrected "
    "equations; those of the printed ones run on the printed plant only."
)


def requirements_table(judgements: Sequence[Judgement]) -> Table:
    """What was required, and whether it was kept."""
    rows = []
    for item in judgements:
        unit = item.limit.unit if item.limit.unit != "1" else ""
        measured = "-" if item.measured is None else f"{number(item.measured)} {unit}".strip()
        verdict = "kept" if item.kept else "FAILED" + (f": {item.note}" if item.note else "")
        margin = number(item.margin)
        rows.append((item.controller, item.plant, item.limit.words, measured, margin, verdict))
    return table(
        "Requirements",
        [
            *names("law"), *words("plant"), *text("requirement"),
            *numbers("measured", "margin"), *text(),
        ],
        rows,
        styles=["" if item.kept else "red" for item in judgements],
    )  # fmt: skip


def endings(results: Sequence[RunResult]) -> list[str]:
    """One line for each run that ended early."""
    return [f"(!) {result.key}: {result.ended}" for result in results if result.ended]


def gains_table(results: Sequence[RunResult]) -> Table:
    """The gains of each controller, and where its law stands in the chapter."""
    rows = {}
    for result in results:
        equations = "printed" if result.plant == "printed" else "corrected"
        if result.trajectory.system.read_parameters is None and result.plant == "physics":
            equations = "MuJoCo"
        # Of a matrix for many joints most entries are zero.
        design = result.controller.designed
        shown = [(n, v) for n, v in design.gains.items() if v or len(n) < _MATRIX]
        gains = ", ".join(f"{n} = {v:.4g}" for n, v in shown)
        if design.declared:
            gains += f"; computed for {design.declared}"
        key = (result.case.system, equations, result.controller.name)
        rows.setdefault(key, (*key, design.source, gains))
    columns = [*words("system", "designed on", "law", "equations"), *text("gains")]
    return table("", columns, list(rows.values()))
