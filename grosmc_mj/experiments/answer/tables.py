"""Tables of runs, of their requirements, and of gains."""

from __future__ import annotations

from collections.abc import Sequence

from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.experiments.requirements.metrics import Metric, largest_of
from grosmc_mj.experiments.requirements.run_metrics import OF_WEIGHTS
from grosmc_mj.experiments.weights import gains_in_words, weights_in_words
from grosmc_mj.ground.wording import counted, titled, unit_after
from grosmc_mj.output.results.tables import (
    Table,
    details,
    number,
    numbers,
    phrases,
    table,
    text,
    words,
)
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.plants.system import Signal

# Header and metric of each column of numbers; then those that a brief answer leaves out.
_COLUMNS = (
    ("max|y\n-y*|", "deviation"),
    ("settled\n[s]", "settling_time"),
    ("J of u_c\n/J*", "continuous"),
    ("J of u_d\n/J* [1/s]", "switching"),
    ("max\n|u|", "max_input"),
)
_DETAILS = (
    ("over-\nshoot %", "overshoot"),
    ("RMS\nerror", "rms_error"),
    ("max\n|s|", "max_sliding"),
    ("RMS\ns", "rms_sliding"),
    ("\nJ*", "cost_optimal"),
    ("var. of\nu per s", "total_variation"),
)
# Metrics beside the optimum of a law's weights.
_OF_WEIGHTS = (*OF_WEIGHTS, "continuous", "switching")


# Signals that a title names.
_FEW = 3


def metric_cell(metric: Metric | None, factor: float = 1.0) -> str:
    """Return the cell of a metric, in another unit by a factor."""
    if metric is None:
        return ""
    if metric.value is not None:
        return number(factor * metric.value)
    if metric.note == "not reached":
        return "never"
    return "-"


def results_table(results: Sequence[RunResult], draws: int = 1) -> Table:
    """Return the table of the runs of one system.

    Args:
        results: The runs.
        draws: Draws of the loop, of which these runs are the first one.
    """
    system = results[0].trajectory.system
    error = results[0].controller.designed.error
    # Without weights there is no optimum that a column could be about.
    weighed = any(result.controller.designed.weighed for result in results)
    main = [column for column in _COLUMNS if weighed or column[1] not in _OF_WEIGHTS]
    further = [column for column in _DETAILS if weighed or column[1] not in _OF_WEIGHTS]
    for position in system.internal_positions:
        header = titled(f"max |{position.name}|", position.unit).replace(" [", "\n[")
        further.append((header, largest_of(position.name)))

    rows = []
    styles = []
    for result in sorted(results, key=_order):
        law = result.controller.name
        style = "bold" if law == "grosmc" else ""
        if result.status is not Status.COMPLETED:
            law += " (!)"
            style = "red"
        continuous, switching = result.cost_shares
        metrics = {**result.metrics, "continuous": continuous, "switching": switching}
        cells = [metric_cell(metrics.get(name)) for _, name in (*main, *further)]
        rows.append((result.case.name, result.plant, law, *cells))
        styles.append(style)

    columns = [
        *details(words("case")),
        *words("plant"),
        *phrases("law"),
        *numbers(*(header for header, _ in main)),
        *details(numbers(*(header for header, _ in further))),
    ]
    outputs = [Signal(error.names[row], "y", error.units[row]) for row in error.output_rows]
    which = f", draw 0 of {draws}" if draws > 1 else ""
    title = f"{system.title}{which}: y = {_signals(outputs)}; u = {_signals(system.inputs)}"
    if weighed:
        title += "; y*, J*: nominal optimum"
    return table(title, columns, rows, styles=styles)


def _signals(signals: Sequence[Signal]) -> str:
    """Return names and units of a few signals; of many, how many they are and their unit."""
    if len(signals) > _FEW:
        return titled(counted(len(signals), "signal"), signals[0].unit)
    return ", ".join(titled(signal.name, signal.unit) for signal in signals)


def _order(result: RunResult) -> bool:
    """Return a key that sorts runs in MuJoCo before those of equations."""
    return result.plant != "physics"


LEGEND = (
    "y*: nominal optimum of each law. settled: for good within 2 % of the initial error (never: "
    "not within the run); it and the overshoot count up to the onset of a later disturbance. J: "
    "index of each law over the run (of u for lqr on the servo and the pendulum, of v after "
    "linearization) with u_c alone, the optimal feedback -K z at the states of the run; J* the "
    "least value of J with the whole input and without an end: J of u_c is below it where other "
    "inputs move the states, as those of a PID do, or where the run ends before it settles; what "
    "the rest of the input, u_d, costs is told per second. On physics the laws use the corrected "
    "equations; those of the printed ones run on the printed plant only."
)


def requirements_table(judgements: Sequence[Judgement], draws: int = 1) -> Table:
    """Return the table of requirements, those that are not kept first.

    Args:
        judgements: Judgements of the runs.
        draws: Draws of the loop, by the worst of which the runs are judged.
    """
    columns = [*phrases("", "requirement", "law", "plant"), *numbers("measured", "margin")]
    rows = []
    styles = []
    for item in sorted(judgements, key=lambda item: item.kept):
        requirement = item.requirement
        verdict = "kept" if item.kept else "FAILED"
        if item.note:
            verdict += f": {item.note}"
        measured = _quantity(item.measured, requirement.unit)
        margin = _quantity(item.margin, requirement.unit)
        rows.append((verdict, requirement.words, item.controller, item.plant, measured, margin))
        styles.append("" if item.kept else "red")
    which = f", the worst of {draws} draws" if draws > 1 else ""
    return table(f"Requirements{which}", columns, rows, styles=styles)


def _quantity(value: float | None, unit: str) -> str:
    """Return a value with its unit, or a dash."""
    return number(value) if value is None else f"{number(value)}{unit_after(unit)}"


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
