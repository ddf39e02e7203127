"""The inputs of a log on every rung: which plant explains the machine, and how far ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.identify.log import Log
from grosmc_mj.identify.replay import Predictor, ideal, starts_of
from grosmc_mj.loop import Loop
from grosmc_mj.plants import Plant, System
from grosmc_mj.results.result import (
    MEASURED,
    Answer,
    LineChart,
    ReportTable,
    Series,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import names, number, numbers, table

# Shares of the longest horizon at which the error is reported.
_SHARES = (0.1, 0.2, 0.5, 1.0)
# Errors that differ by less than this factor count as equal.
_EQUAL = 1.001


class PredictionError(NamedTuple):
    """Prediction errors of a rung along a log.

    Attributes:
        rung: ``printed``, ``corrected``, ``physics``, ``loop`` or ``machine``.
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


class LogModel(NamedTuple):
    """A machine that a log may be of.

    Attributes:
        plant: Its plant.
        loop: What lies between log and plant, of which delays and biases count.
    """

    plant: Plant
    loop: Loop = Loop()

    @property
    def delay(self) -> float:
        """Delay of the inputs [s]; of several actuators, the fastest one's."""
        delays = [actuator.delay for actuator in self.loop.actuators]
        return self.loop.computing.delay + min(delays, default=0.0)

    def sensor(self, state: str, quantity: str) -> float:
        """The ``scale``, ``delay`` or ``bias`` of the sensor of a state."""
        for sensor in self.loop.sensors:
            if sensor.of == state:
                return float(getattr(sensor, quantity))
        return ideal(state, quantity)


def models_of(experiment: Experiment) -> Mapping[str, LogModel]:
    """The plants of a case, the truest one behind its loop, and the machine of its system."""
    rungs = {name: LogModel(experiment.plant(name)) for name in experiment.plant_names}
    truest = experiment.plant(experiment.nominal.truest)
    if experiment.loop is not None:
        rungs["loop"] = LogModel(truest, experiment.loop)
    if experiment.nominal.shipped and not experiment.on_machine:
        try:
            machine = find_experiment(experiment.system, "machine")
        except GrosmcError:
            return rungs
        rungs["machine"] = LogModel(machine.plant(machine.nominal.truest))
    return rungs


def prediction_errors(
    rungs: Mapping[str, LogModel], log: Log, horizon: float, timestep: float
) -> tuple[list[PredictionError], list[str]]:
    """The errors of every plant along the windows of a log, and which rungs cannot follow it.

    Args:
        rungs: By name.
        log: The log.
        horizon: Of a prediction [s].
        timestep: Of plants given as equations [s].

    Raises:
        ArgumentError: If none of them can follow it.
    """
    rows = []
    notes = []
    for name, rung in rungs.items():
        system = rung.plant.system
        predictor = Predictor.of(log, horizon, rung.plant.step_length or timestep)
        starts = starts_of(log, predictor.windows, system)
        try:
            (states,) = predictor.states([rung.plant], [starts], [rung.delay])
        except GrosmcError as error:
            notes.append(f"{name} cannot follow the log: {error}")
            continue
        errors = predictor.errors(states, system, rung.sensor)
        rows += _rung_errors(name, predictor, errors, system, horizon)

    if not rows:
        raise ArgumentError("; ".join(notes))
    return rows, notes


def _rung_errors(
    rung: str,
    predictor: Predictor,
    errors: Mapping[str, Sequence[Array]],
    system: System,
    horizon: float,
) -> list[PredictionError]:
    """The errors of one rung, by measured state."""
    log = predictor.log
    ages = [log.time[window.samples] - window.start for window in predictor.windows]
    longest = min(horizon, max(float(age[-1]) for age in ages))
    horizons = [share * longest for share in _SHARES]

    rows = []
    for state in system.states:
        if state.name in errors:
            by_window = errors[state.name]
            rms = [_rms_at(time, ages, by_window, log.period) for time in horizons]
            rows.append(PredictionError(rung, state.name, state.unit, horizons, rms))
    return rows


def _rms_at(
    time: float,
    ages: Sequence[Array],
    errors: Sequence[Array],
    period: float,
) -> float:
    """RMS error so long [s] after the start, over the windows that last so long.

    Args:
        time: Time since the start of a window [s].
        ages: The same of the samples of each window [s].
        errors: Of the samples of each window.
        period: Between two samples [s].
    """
    squares = [
        error[np.abs(age - time).argmin()] ** 2
        for age, error in zip(ages, errors, strict=True)
        if time <= age[-1] + 0.5 * period
    ]
    return float(np.sqrt(np.mean(squares)))


def best_model(rows: Sequence[PredictionError]) -> dict[str, str]:
    """By measured state the rung with the least error at the longest horizon, or several."""
    by_state: dict[str, dict[str, float]] = {}
    for row in rows:
        # A prediction that diverged is never the best.
        last = float(np.nan_to_num(row.rms[-1], nan=np.inf))
        by_state.setdefault(row.state, {})[row.rung] = last

    best = {}
    for state, errors in by_state.items():
        bound = _EQUAL * min(errors.values())
        best[state] = " and ".join(rung for rung, rms in errors.items() if rms <= bound)
    return best


def comparison_result(
    rows: Sequence[PredictionError],
    notes: Sequence[str],
    log: Log,
    case: str,
    horizon: float,
) -> dict[str, Any]:
    """The content of the result's JSON file."""
    best = best_model(rows)
    words = ", ".join(f"{state}: {rung}" for state, rung in best.items())
    answer = Answer(
        question=f"Which rung explains {log.name}",
        verdict=MEASURED,
        words=f"Least error after {rows[0].horizons[-1]:.3g} s: {words}",
        more="; ".join(notes),
    )

    values = []
    errors = []
    for row in rows:
        rms = list(map(finite, row.rms))
        errors.append({**row._asdict(), "rms": rms})
        for age, value in zip(row.horizons, rms, strict=True):
            name = f"{row.rung} {row.state} at {age:g} s"
            values.append(Value(name=name, value=value, unit=row.unit, better=-1))
    return result(
        "compare",
        {"case": case, "log": log.name, "horizon": horizon},
        answers=[answer],
        sheets=[_state_sheet(state, rows, log) for state in best],
        values=values,
        errors=errors,
    )


def _state_sheet(state: str, rows: Sequence[PredictionError], log: Log) -> ReportTable:
    """Table and chart of the errors of one measured state."""
    rows = [row for row in rows if row.state == state]
    unit = rows[0].unit
    ages = [f"{age:.3g} s" for age in rows[0].horizons]
    errors = table(
        f"Prediction error of {state} [{unit}] by time since the start of the prediction",
        [*names("rung"), *numbers(*ages)],
        [(row.rung, *map(number, row.rms)) for row in rows],
        legend="RMS over all windows; the sensor's own noise is "
        f"{number(log.noise(state))} {unit}.",
    )

    lines = []
    for row in rows:
        y = list(map(finite, row.rms))
        lines.append(Series(name=row.rung, x=list(row.horizons), y=y))
    titles = ("time since start [s]", f"RMS error [{unit}]")
    return ReportTable(table=errors, charts=[LineChart(name=state, titles=titles, lines=lines)])
