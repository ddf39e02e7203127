"""The result of an identification: its document, tables and figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted, unit_after
from grosmc_mj.identify.compare import PredictionError
from grosmc_mj.identify.fit import Fit
from grosmc_mj.identify.quality import Quality
from grosmc_mj.output.charts.chart import Chart, ChartAxis, Curve, Layer, Panel
from grosmc_mj.output.charts.figure import write_chart
from grosmc_mj.output.palette import BLUE, GREY, VERMILION, Stroke
from grosmc_mj.output.results.result import (
    MEASURED,
    OPEN,
    Answer,
    Result,
    Value,
    finite,
    report_tables,
    result,
)
from grosmc_mj.output.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.sweep.quantities import Quantity
from grosmc_mj.theory.plants import System

_MEASURED = Stroke(GREY, 2.4, "solid", 0.6)
# Words for the residual.
_WHITENESS = {True: "white", False: "correlated in time", None: "too short to tell"}
# A value this near to an end of its range, as a share of its half width, is at the end.
_NEAR = 0.1
# Or this near as a share of the range: the search ends there.
_AT_END = 1e-9


def values_table(fit: Fit) -> Table:
    """The parameters with their intervals."""
    columns = [
        *names("parameter"),
        *numbers("value", "95 % interval"),
        *words("unit"),
        *numbers("in the case"),
        *text(),
    ]
    rows = [_values_row(*estimate) for estimate in fit.estimates]
    return table("Parameters", columns, rows)


def _values_row(quantity: Quantity, value: float, half: float | None) -> tuple[str, ...]:
    """A row of ``values_table``."""
    if half is None:
        interval = "-"
        note = "held: not visible in this log"
    else:
        interval = f"{value - half:.4g} to {value + half:.4g}"
        note = ""
        low, high = quantity.distribution.support
        distance = min(abs(low - value), abs(high - value))
        if distance <= max(_NEAR * half, _AT_END * (high - low)):
            note = "at the end of its range: widen it, or check the log"
    nominal = f"{quantity.nominal:.4g}"
    return quantity.name, f"{value:.4g}", interval, quantity.unit, nominal, note


def quality_table(rows: Sequence[Quality]) -> Table:
    """Accuracy of the prediction of the held-out part."""
    columns = [
        *names("state"),
        *numbers("RMS", "fit %", "RMS in steps"),
        *words("residual"),
    ]
    cells = []
    for row in rows:
        rms = f"{number(row.rms)}{unit_after(row.unit)}"
        residual = _WHITENESS[row.white]
        share = number(100 * row.fit) if row.moves else "stands still"
        steps = number(row.rms / row.step)
        cells.append((row.state, rms, share, steps, residual))
    return table(
        "Prediction of the held-out part",
        columns,
        cells,
        legend="Fit: 1 - |residual| / |deviation from the mean|. In steps of the sensor, or in "
        "standard deviations of its noise. A residual that is correlated in time means that the "
        "model lacks something; the intervals count that, but not a bias by it.",
    )


def identification(
    fit: Fit,
    rows: Sequence[Quality],
    predicted: Sequence[PredictionError],
    log: str,
    horizon: float,
    hold_out: float,
    notes: Sequence[str] = (),
) -> Result:
    """Return the result of an identification.

    Args:
        fit: The fit.
        rows: Its accuracy along the held-out part.
        predicted: Errors of its predictions of that part.
        log: Name of the log.
        horizon: Length of a prediction [s].
        hold_out: Share of the log that was held out.
        notes: What may be wrong.
    """
    path = fit.parameters.experiment.path
    white = all(row.white for row in rows)
    answer = Answer(
        question=f"Parameters of {path.stem} from {log}",
        verdict=MEASURED if white else OPEN,
        words=f"{int(fit.fitted.sum())} of {counted(len(fit.fitted), 'parameter')} fitted; "
        + _prediction_words(rows, predicted),
        notes=[
            *notes,
            *fit.doubts,
            *(f"{row.words}." for row in fit.unseen),
        ],
    )

    parameters = []
    values = []
    for quantity, value, half in fit.estimates:
        name = quantity.name
        unit = quantity.unit
        parameters.append(
            {
                "name": name,
                "value": value,
                "unit": unit,
                "in_the_case": quantity.nominal,
                "half_width": half,
            }
        )
        name = f"{fit.parameters.experiment.target} {log}: {name}"
        values.append(Value(name=name, value=value, unit=unit, relative=1e-3))
    return result(
        "identify",
        {"case": str(path), "log": log, "horizon": horizon, "hold_out": hold_out},
        answers=[answer],
        sheets=report_tables([values_table(fit), quality_table(rows)], 2),
        values=values,
        parameters=parameters,
        covariance=fit.covariance.tolist(),
        timesteps=fit.timesteps,
        by_timestep=fit.shift.tolist(),
        unseen=[row._asdict() for row in fit.unseen],
        held_out=[row._asdict() for row in rows],
        predicted=[{**row._asdict(), "rms": list(map(finite, row.rms))} for row in predicted],
    )


def _prediction_words(rows: Sequence[Quality], predicted: Sequence[PredictionError]) -> str:
    """Words on the state that is predicted worst, in steps of its sensor."""
    steps = {row.state: row.step for row in rows}
    diverging = [row.state for row in rows if row.diverges]
    diverging += [row.state for row in predicted if row.diverges]
    if diverging:
        return f"the prediction of {diverging[0]} diverges in the held-out part"

    worst = max(predicted, key=lambda row: row.rms[-1] / steps[row.state])
    step = steps[worst.state]
    soon = f"{number(worst.rms[0])}{unit_after(worst.unit)} after {worst.horizons[0]:.2g} s"
    late = f"{number(worst.rms[-1])}{unit_after(worst.unit)} after {worst.horizons[-1]:.2g} s"
    in_steps = f"{number(worst.rms[0] / step)} and {number(worst.rms[-1] / step)}"
    return (
        f"{worst.state} of the held-out part predicted to {soon} and {late} ({in_steps} steps of "
        "its sensor)"
    )


def draw_residuals(
    parts: Mapping[str, Sequence[tuple[slice, Array]]],
    log: Log,
    system: System,
    path: Path,
) -> None:
    """Draw measured and fitted states of a log, and their difference.

    Args:
        parts: The result of ``quality.residuals``.
        log: The log.
        system: Units of the states.
        path: The picture.
    """
    units = {state.name: state.unit for state in system.states}
    rows = []
    for name, pieces in parts.items():
        above, below = _state_layers(log, name, pieces)
        rows.append([Panel(above, y=ChartAxis(f"{name} [{units[name]}]"))])
        rows.append([Panel(below, y=ChartAxis(f"residual [{units[name]}]"))])
    (lowest,) = rows[-1]
    rows[-1] = [replace(lowest, x=ChartAxis("time [s]"))]
    write_chart(Chart(rows, size=(9.0, 2.2 * len(rows) + 0.9), shared="x"), path, [".png"])


def _state_layers(
    log: Log,
    state: str,
    pieces: Sequence[tuple[slice, Array]],
) -> tuple[list[Layer], list[Layer]]:
    """Return a state and its residual, window by window."""
    above: list[Layer] = []
    below: list[Layer] = []
    for samples, error in pieces:
        time = log.time[samples]
        measured = log.states[state][samples]
        above.append(Curve(time, measured, _MEASURED, name="measured"))
        above.append(Curve(time, measured - error, Stroke(BLUE, 1.0), name="fitted"))
        below.append(Curve(time, error, Stroke(VERMILION, 0.8), name="residual"))
    return above, below
