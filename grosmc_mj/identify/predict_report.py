"""The result of a prediction: its document, tables and figure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from grosmc_mj.ground.wording import counted, titled, unit_after
from grosmc_mj.identify.predict import PredictedQuantity, Prediction, PredictionQuestion
from grosmc_mj.output.charts.chart import Chart, ChartAxis, Curve, Layer, Panel
from grosmc_mj.output.charts.figure import write_chart
from grosmc_mj.output.palette import BLACK, BLUE, Stroke
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    Result,
    Value,
    finite,
    report_tables,
    result,
)
from grosmc_mj.output.results.tables import Table, number, numbers, phrases, table

# Medians over noisy runs repeat within this share on another machine.
_NOISE = 0.05
# Digits of a number, and of one that must be told from an end of its spread, at most.
_LEAST_DIGITS = 3
_MOST_DIGITS = 7


def prediction_result(
    question: PredictionQuestion,
    complete: Prediction,
    configuration: Mapping[str, Any],
) -> Result:
    """Return the result of a prediction: of the law on the log, then of the machine.

    Args:
        question: The law, the machine and the log.
        complete: Its prediction.
        configuration: Arguments of the command.
    """
    required = [item for item in complete.quantities if item.required]
    outside = [item.label for item in required if not item.contains(item.measured)]
    # A spread without width tells nothing of the noise.
    wide = [item for item in required if _has_width(item)]
    words = f"Predicted: {_headline([*wide, *required][0])}"
    if outside:
        words += f"; outside the spread: {', '.join(outside)}"
    answer = Answer(
        question=f"Is {question.log.name} what {question.law} does on this machine",
        verdict=NOT_KEPT if outside else KEPT,
        words=words,
        more=_distance_words(question, complete),
        notes=question.notes,
    )
    values = []
    # Many predictions may lie in one folder: of other cases, logs and laws.
    subject = f"{question.experiment.target} {question.law} on {question.log.name}"
    for item in complete.quantities:
        name = f"{subject}: predicted {item.name}"
        values.append(Value(name=name, value=finite(item.median), unit=item.unit, relative=_NOISE))

    finding = question.law_on_log
    loop = question.experiment.loop
    return result(
        "predict",
        configuration,
        seed=None if loop is None else loop.seed,
        answers=[_law_answer(question), answer],
        sheets=report_tables([quantities_table(complete)], 2),
        values=values,
        law=None if finding is None else finding._asdict(),
        complete_machine=_document(complete),
    )


def _document(prediction: Prediction) -> dict[str, Any]:
    """Return a prediction as plain values."""
    quantities = [
        {
            "name": item.name,
            "unit": item.unit,
            "required": item.required,
            "measured": finite(item.measured),
            "predicted": list(map(finite, item.predicted.tolist())),
        }
        for item in prediction.quantities
    ]
    misfits = list(map(finite, prediction.misfits.tolist()))
    return {"quantities": quantities, "misfits": misfits}


# -- words and tables ------------------------------------------------------------------------------


def _law_answer(question: PredictionQuestion) -> Answer:
    """Return whether the law is that of the log."""
    finding = question.law_on_log
    words = f"Law: {question.law} is not compared with the logged commands"
    verdict = OPEN
    if finding is not None:
        words = f"Law: {finding.words}"
        if finding.first is None:
            verdict = KEPT
    return Answer(question=f"Is {question.law} the law of the log", verdict=verdict, words=words)


def _has_width(item: PredictedQuantity) -> bool:
    """Return True if both ends of the spread are written differently."""
    low, high = item.spread
    return _written(low, _LEAST_DIGITS) != _written(high, _LEAST_DIGITS)


def _headline(item: PredictedQuantity) -> str:
    """Return a quantity in words: median, spread, measured."""
    measured, median, low, high = _shown(item)
    unit = unit_after(item.unit)
    return f"{item.name}: {median}{unit} ({low} to {high}); measured {measured}{unit}"


def _shown(item: PredictedQuantity) -> tuple[str, str, str, str]:
    """Return measured value, median and both ends of the spread; infinity is never.

    A value that lies outside has as many digits as are needed to see it.
    """
    low, high = item.spread
    values = (item.measured, item.median, low, high)
    texts = [_written(value, _LEAST_DIGITS) for value in values]
    inside = item.contains(item.measured)
    for digits in range(_LEAST_DIGITS + 1, _MOST_DIGITS + 1):
        if inside or texts[0] not in texts[2:]:
            break
        texts = [_written(value, digits) for value in values]
    measured, median, least, largest = texts
    return measured, median, least, largest


def _written(value: float, digits: int) -> str:
    """Write a number with some digits."""
    if math.isinf(value):
        return "never"
    if digits == _LEAST_DIGITS:
        return number(value)
    return f"{value:.{digits}g}"


def _headed(item: PredictedQuantity) -> str:
    """Return the header of a quantity, with its unit."""
    return titled(item.label, item.unit)


def _distance_words(question: PredictionQuestion, complete: Prediction) -> str:
    """Return how far the nearest run is from the log."""
    system = question.experiment.nominal.system
    unit = system.states[system.controlled[0]].unit
    distance = number(float(complete.misfits.min()))
    return f"The nearest run is {distance} {unit} (RMS) from the log."


def quantities_table(complete: Prediction) -> Table:
    """Return the measured numbers beside the predicted ones."""
    rows = []
    styles = []
    for item in complete.quantities:
        measured, median, low, high = _shown(item)
        inside = item.contains(item.measured)
        styles.append("red" if item.required and not inside else "")
        rows.append(
            (
                _headed(item),
                measured,
                median,
                f"{low} to {high}",
                "" if inside else "outside",
                "" if item.required else "not required",
            )
        )
    return table(
        f"Measured and predicted, {counted(len(complete.runs), 'seed')}",
        [*phrases(""), *numbers("measured", "predicted", "spread"), *phrases("", "")],
        rows,
        styles=styles,
    )


# -- figure ----------------------------------------------------------------------------------------


def draw_prediction(question: PredictionQuestion, complete: Prediction, path: Path) -> Path:
    """Draw each measured state and input over those of all seeds; returns the picture's path.

    Args:
        question: The law, the machine and the log.
        complete: Its prediction.
        path: The picture.
    """
    system = question.experiment.nominal.system
    log = question.log
    curves = []
    for state in system.states:
        if state.name in log.states:
            predicted = [simulated.states[state.name] for simulated in complete.logs]
            curves.append((state, log.states[state.name], predicted))
    for index, signal in enumerate(system.inputs):
        predicted = [simulated.inputs[:, index] for simulated in complete.logs]
        curves.append((signal, log.inputs[:, index], predicted))

    rows = []
    for signal, measured, predicted in curves:
        layers: list[Layer] = [
            Curve(
                log.time,
                curve,
                Stroke(BLUE, 0.6, "solid", 0.3),
                name=f"predicted, {counted(len(predicted), 'seed')}",
            )
            for curve in predicted
        ]
        nearest = predicted[complete.nearest]
        layers.append(
            Curve(log.time, nearest, Stroke(BLUE, 1.4), name="predicted, the nearest seed")
        )
        layers.append(Curve(log.time, measured, Stroke(BLACK, 1.2), name="measured"))
        rows.append([Panel(layers, y=ChartAxis(titled(signal.name, signal.unit)))])
    (lowest,) = rows[-1]
    rows[-1] = [replace(lowest, x=ChartAxis("time [s]"))]
    size = (9.0, 2.3 * len(rows) + 0.9)
    title = f"{question.law} on {log.name}"
    return write_chart(Chart(rows, title=title, size=size, shared="x"), path, [".png"])
