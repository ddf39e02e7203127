"""The inputs of a log on every rung: which plant explains the machine, and how far ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, SetupError, name_list
from grosmc_mj.ground.wording import titled, unit_after
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import fitted_starts
from grosmc_mj.output.results.result import (
    MEASURED,
    Answer,
    LineChart,
    ReportTable,
    Result,
    Series,
    Value,
    finite,
    result,
)
from grosmc_mj.output.results.tables import names, number, numbers, table
from grosmc_mj.theory.plants import System

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

    @property
    def diverges(self) -> bool:
        """Whether a prediction diverged."""
        return not np.all(np.isfinite(self.rms))


def prediction_errors(
    rungs: Mapping[str, LogModel], log: Log, horizon: float, timestep: float
) -> tuple[list[PredictionError], list[str]]:
    """The errors of every plant along the windows of a log, and notes on rungs.

    A start is fitted to the samples before its prediction by the rung's own motion.

    Args:
        rungs: By name.
        log: The log.
        horizon: Of a prediction [s].
        timestep: Of plants given as equations [s].

    Raises:
        ArgumentError: If none of them can follow it.
    """
    rows = []
    # Rungs by what follows their names in a note.
    noted: dict[str, list[str]] = {}
    for name, rung in rungs.items():
        system = rung.plant.system
        predictor = Predictor.leading(log, horizon, rung.plant.step_length or timestep)
        try:
            rung.require_speeds(log)
            starts = fitted_starts(predictor.leads, rung)
            (states,) = predictor.states([rung], [starts])
        except SetupError:
            # No rung would run here.
            raise
        except GrosmcError as error:
            noted.setdefault(f" cannot follow the log: {error}", []).append(name)
            continue
        if rung.disturbances and _move_nothing(predictor, rung, starts, states):
            idle = ": no disturbance of the case moves anything along this log"
            noted.setdefault(idle, []).append(name)
        errors = predictor.errors(states, rung)
        of_rung = _rung_errors(name, predictor, errors, system, horizon)
        rows += of_rung
        diverging = [row.state for row in of_rung if row.diverges]
        if diverging:
            diverges = f": the prediction of {', '.join(diverging)} diverges"
            noted.setdefault(diverges, []).append(name)

    notes = [f"{name_list(names)}{words}" for words, names in noted.items()]
    if not rows:
        raise ArgumentError("; ".join(notes))
    return rows, notes


def _move_nothing(
    predictor: Predictor, rung: LogModel, starts: Array, states: Sequence[Array]
) -> bool:
    """Whether a rung has the same states, (steps + 1, n) of each window, undisturbed."""
    (undisturbed,) = predictor.states([replace(rung, disturbances=())], [starts])
    return bool(np.allclose(undisturbed, states, rtol=1e-9, atol=1e-12, equal_nan=True))


def _rung_errors(
    rung: str,
    predictor: Predictor,
    errors: Mapping[str, Sequence[Array]],
    system: System,
    horizon: float,
) -> list[PredictionError]:
    """The errors of one rung, by measured state."""
    log = predictor.log
    ages = [log.time[window.samples] - window.begin for window in predictor.windows]
    longest = min(horizon, max(float(age[-1]) for age in ages))
    horizons = [share * longest for share in _SHARES]

    rows = []
    for state in system.states:
        if state.name in errors:
            by_window = errors[state.name]
            rms = [_rms_at(time, ages, by_window, log.sampling) for time in horizons]
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
    experiment: Experiment,
    horizon: float,
) -> Result:
    """Return the result of a comparison."""
    best = best_model(rows)
    words = ", ".join(f"{state}: {rung}" for state, rung in best.items())
    answer = Answer(
        question=f"Which rung explains {log.name}",
        verdict=MEASURED,
        words=f"Least error after {rows[0].horizons[-1]:.3g} s: {words}",
        notes=notes,
    )

    values = []
    errors = []
    for row in rows:
        rms = list(map(finite, row.rms))
        errors.append({**row._asdict(), "rms": rms})
        for age, value in zip(row.horizons, rms, strict=True):
            name = f"{experiment.target} {log.name}: {row.rung} {row.state} at {age:g} s"
            values.append(Value(name=name, value=value, unit=row.unit, better=-1))
    return result(
        "compare",
        {"case": str(experiment.path), "log": log.name, "horizon": horizon},
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
        f"Prediction error of {titled(state, unit)} by time since the start of the prediction",
        [*names("rung"), *numbers(*ages)],
        [(row.rung, *map(number, row.rms)) for row in rows],
        legend="RMS over all windows; the sensor's own noise is "
        f"{number(log.noise(state))}{unit_after(unit)}.",
    )

    lines = []
    for row in rows:
        y = list(map(finite, row.rms))
        lines.append(Series(name=row.rung, x=list(row.horizons), y=y))
    titles = ("time since start [s]", titled("RMS error", unit))
    chart = LineChart(name=state, titles=titles, lines=lines)
    return ReportTable(table=errors, charts=[chart], brief=True)
