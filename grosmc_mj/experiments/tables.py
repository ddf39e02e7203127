"""Tables of runs, of their requirements, and of gains."""

from __future__ import annotations

from collections.abc import Sequence

from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.weights import gains_in_words, weights_in_words
from grosmc_mj.requirements.judging import Judgement
from grosmc_mj.requirements.metrics import Metric, largest_of
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


def metric_cell(metric: Metric | None, factor: float = 1.0) -> str:
    """Return the cell of a metric, in another unit by a factor."""
    if metric is None:
        return ""
    if metric.value is not None:
        return number(factor * metric.value)
    if metric.note == "not reached":
        return "never"
    return "-"


def results_table(results: Sequence[RunResult]) -> Table:
    """Return the table of the runs of one system."""
    system = results[0].trajectory.system
    error = results[0].controller.designed.error
    output_unit = error.units[error.output_rows[0]]
    columns = list(_COLUMNS)
    for position in system.internal_positions:
        header = f"max |{position.name}|\n[{position.unit}]"
        columns.append((header, largest_of(position.name)))

    rows = []
    styles = []
    for result in results:
        law = result.controller.name
        style = "bold" if law == "grosmc" else ""
        if result.status is not Status.COMPLETED:
            law += " (!)"
            style = "red"
        metrics = {**result.metrics, "": result.cost_shares[1]}
        cells = [metric_cell(metrics.get(name)) for _, name in columns]
        rows.append((result.case.name, result.plant, law, *cells))
        styles.append(style)
    return table(
        f"{system.title}: x1 in {output_unit}, u in {system.input.unit}",
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
    """Return the table of requirements, with measured value, margin and verdict."""
    columns = [
        *names("law"),
        *words("plant"),
        *text("requirement"),
        *numbers("measured", "margin"),
        *text(),
    ]
    rows = []
    for item in judgements:
        measured = "-"
        if item.measured is not None:
            unit = item.requirement.unit if item.requirement.unit != "1" else ""
            measured = f"{number(item.measured)} {unit}".strip()
        verdict = "kept" if item.kept else "FAILED"
        if item.note:
            verdict += f": {item.note}"
        margin = number(item.margin)
        words_of_it = item.requirement.words
        rows.append((item.controller, item.plant, words_of_it, measured, margin, verdict))
    styles = ["" if item.kept else "red" for item in judgements]
    return table("Requirements", columns, rows, styles=styles)


def endings(results: Sequence[RunResult]) -> list[str]:
    """Return one line for each run that ended early."""
    return [f"(!) {result.key}: {result.ended}" for result in results if result.ended]


def gains_table(results: Sequence[RunResult]) -> Table:
    """Return the table of weights and gains of each controller, with its equations."""
    columns = [*words("system", "designed on", "law", "equations"), *text("weights and gains")]
    rows = {}
    for result in results:
        key = (result.case.system, _designed_on(result), result.controller.name)
        if key not in rows:
            rows[key] = (*key, result.controller.designed.source, _gains_in_words(result))
    return table("", columns, list(rows.values()))


def _designed_on(result: RunResult) -> str:
    """Return the equations that the controller of a run was designed on."""
    if result.plant == "printed":
        return "printed"
    if result.plant == "physics" and result.trajectory.system.read_parameters is None:
        return "MuJoCo"
    return "corrected"


def _gains_in_words(result: RunResult) -> str:
    """Return weights and gains of a run's controller by name."""
    design = result.controller.designed
    parts = [weights_in_words(design), gains_in_words(design)]
    if design.declared:
        parts.append(f"computed for {design.declared}")
    return "; ".join(filter(None, parts))
