"""The inputs of a log on every rung: which plant explains the machine, and how far ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.errors import GrosmcError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.identify.log import Log, noise_of
from grosmc_mj.identify.replay import Predictor, starts_of
from grosmc_mj.plants import Plant
from grosmc_mj.results.result import MEASURED, Answer, LineChart, Series, Sheet, Value, result
from grosmc_mj.results.tables import names, number, numbers, table

# Shares of the longest horizon at which the error is told.
_SHARES = (0.1, 0.2, 0.5, 1.0)


class RungError(NamedTuple):
    """How far a rung is from a log.

    Attributes:
        rung: ``printed``, ``corrected``, ``physics`` or ``machine``.
        state: A measured state.
        unit: Its unit.
        horizons: Time since the start of a prediction [s].
        rms: Of the error there, over all windows; NaN after a prediction diverged.
    """

    rung: str
    state: str
    unit: str
    horizons: Sequence[float]
    rms: Sequence[float]


def rungs_of(experiment: Experiment) -> Mapping[str, Plant]:
    """The plants of a case, and the machine of its system."""
    plants: dict[str, Plant] = {name: experiment.plant(name) for name in experiment.plant_names}
    if experiment.nominal.shipped and not experiment.on_machine:
        try:
            machine = find_experiment(experiment.case.system, "machine")
        except GrosmcError:
            return plants
        plants["machine"] = machine.plant(machine.nominal.truest)
    return plants


def compared(
    plants: Mapping[str, Plant], log: Log, horizon: float, timestep: float
) -> tuple[list[RungError], list[str]]:
    """The errors of every plant along the windows of a log, and which rungs cannot follow it.

    Args:
        plants: By rung.
        log: The log.
        horizon: Of a prediction [s].
        timestep: Of plants given as equations [s].
    """
    rows, notes = [], []
    horizons = [share * horizon for share in _SHARES]
    for rung, plant in plants.items():
        own = plant.step_length or timestep
        predictor = Predictor.of(log, horizon, own)
        starts = starts_of(log, predictor.windows, plant.system)
        try:
            (runs,) = predictor.states([plant], [starts], [0.0])
        except GrosmcError as error:
            notes.append(f"{rung} cannot follow the log: {error}")
            continue
        for j, state in enumerate(plant.system.states):
            if state.name not in log.outputs:
                continue
            squares: list[list[float]] = [[] for _ in horizons]
            for w, (window, states) in enumerate(zip(predictor.windows, runs, strict=True)):
                error = log.outputs[state.name][window.samples] - predictor.at_samples(
                    w, states[:, j]
                )
                ages = log.time[window.samples] - window.start
                for square, age in zip(squares, horizons, strict=True):
                    if age <= ages[-1] + 0.5 * log.period:
                        square.append(float(error[np.abs(ages - age).argmin()]) ** 2)
            rms = [float(np.sqrt(np.mean(square))) if square else np.nan for square in squares]
            rows.append(RungError(rung, state.name, state.unit, horizons, rms))
    return rows, notes


def best_rung(rows: Sequence[RungError]) -> dict[str, str]:
    """By measured state the rung with the least error at the longest horizon that all reach."""
    best = {}
    for state in dict.fromkeys(row.state for row in rows):
        own = [row for row in rows if row.state == state]
        best[state] = min(own, key=lambda row: np.nan_to_num(row.rms[-1], nan=np.inf)).rung
    return best


def comparison_result(
    rows: Sequence[RungError], notes: Sequence[str], log: Log, case: str, horizon: float
) -> dict[str, Any]:
    """The content of the result's JSON file."""
    best = best_rung(rows)
    sheets = []
    for state in best:
        own = [row for row in rows if row.state == state]
        noise, unit = noise_of(log.outputs[state]), own[0].unit
        cells = [(row.rung, *(number(rms) for rms in row.rms)) for row in own]
        shown = table(
            f"Prediction error of {state} [{unit}] by time since the start of the prediction",
            [*names("rung"), *numbers(*(f"{age:.3g} s" for age in own[0].horizons))],
            cells,
            legend=f"RMS over all windows; the sensor's own noise is {number(noise)} {unit}.",
        )
        lines = [
            Series(name=row.rung, x=list(row.horizons),
                   y=[None if np.isnan(rms) else rms for rms in row.rms])
            for row in own
        ]  # fmt: skip
        chart = LineChart(
            name=state, titles=("time since start [s]", f"RMS error [{unit}]"), lines=lines
        )
        sheets.append(Sheet(table=shown, charts=[chart]))
    said = ", ".join(f"{state}: {rung}" for state, rung in best.items())
    return result(
        "compare",
        {"case": case, "log": log.name, "horizon": horizon},
        answers=[
            Answer(
                question=f"Which rung explains {log.name}",
                verdict=MEASURED,
                words=f"{said} has the least error after {horizon:g} s",
                more="; ".join(notes),
            )
        ],
        sheets=sheets,
        values=[
            Value(name=f"{row.rung} {row.state} at {age:g} s", value=None if np.isnan(rms) else rms,
                  unit=row.unit, better=-1)
            for row in rows
            for age, rms in zip(row.horizons, row.rms, strict=True)
        ],
        errors=[{**row._asdict(), "rms": [None if np.isnan(x) else x for x in row.rms]}
                for row in rows],
    )  # fmt: skip
