"""The inputs of a log on every rung: which plant explains the machine, and how far ahead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.identify.log import Log
from grosmc_mj.identify.replay import Predictor, ideal, starts_of
from grosmc_mj.loop import Loop
from grosmc_mj.plants import Plant
from grosmc_mj.results.result import (
    MEASURED,
    Answer,
    LineChart,
    Series,
    Sheet,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import names, number, numbers, table

# Shares of the longest horizon at which the error is told.
_SHARES = (0.1, 0.2, 0.5, 1.0)
# Errors that differ by less than this factor are one.
_EQUAL = 1.001


class RungError(NamedTuple):
    """How far a rung is from a log.

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


class Rung(NamedTuple):
    """A machine that a log may be of.

    Attributes:
        plant: Its plant.
        loop: What lies between log and plant, of which delays and biases count.
    """

    plant: Plant
    loop: Loop = Loop()

    @property
    def delay(self) -> float:
        """How late inputs arrive [s]; of several actuators, the fastest one's."""
        late = [actuator.delay for actuator in self.loop.actuators]
        return self.loop.computing.delay + min(late, default=0.0)

    def sensor(self, state: str, quantity: str) -> float:
        """The ``scale``, ``delay`` or ``bias`` of the sensor of a state."""
        own = (float(getattr(part, quantity)) for part in self.loop.sensors if part.of == state)
        return next(own, ideal(state, quantity))


def rungs_of(experiment: Experiment) -> Mapping[str, Rung]:
    """The plants of a case, the truest one behind its loop, and the machine of its system."""
    rungs = {name: Rung(experiment.plant(name)) for name in experiment.plant_names}
    truest = experiment.plant(experiment.nominal.truest)
    if experiment.case.loop is not None:
        rungs["loop"] = Rung(truest, experiment.case.loop)
    if experiment.nominal.shipped and not experiment.on_machine:
        try:
            machine = find_experiment(experiment.case.system, "machine")
        except GrosmcError:
            return rungs
        rungs["machine"] = Rung(machine.plant(machine.nominal.truest))
    return rungs


def compared(
    rungs: Mapping[str, Rung], log: Log, horizon: float, timestep: float
) -> tuple[list[RungError], list[str]]:
    """The errors of every plant along the windows of a log, and which rungs cannot follow it.

    Args:
        rungs: By name.
        log: The log.
        horizon: Of a prediction [s].
        timestep: Of plants given as equations [s].

    Raises:
        ArgumentError: If none of them can follow it.
    """
    rows, notes = [], []
    for name, rung in rungs.items():
        plant = rung.plant
        own = plant.step_length or timestep
        predictor = Predictor.of(log, horizon, own)
        starts = starts_of(log, predictor.windows, plant.system)
        try:
            (runs,) = predictor.states([plant], [starts], [rung.delay])
        except GrosmcError as error:
            notes.append(f"{name} cannot follow the log: {error}")
            continue
        ages = [log.time[window.samples] - window.start for window in predictor.windows]
        longest = min(horizon, max(float(age[-1]) for age in ages))
        horizons = [share * longest for share in _SHARES]
        units = {state.name: state.unit for state in plant.system.states}
        for state, errors in predictor.errors(runs, plant.system, rung.sensor).items():
            rms = [
                float(np.sqrt(np.mean([
                    error[np.abs(age - h).argmin()] ** 2
                    for age, error in zip(ages, errors, strict=True)
                    if h <= age[-1] + 0.5 * log.period
                ])))
                for h in horizons
            ]  # fmt: skip
            rows.append(RungError(name, state, units[state], horizons, rms))
    if not rows:
        raise ArgumentError("; ".join(notes))
    return rows, notes


def best_rung(rows: Sequence[RungError]) -> dict[str, str]:
    """By measured state the rung with the least error at the longest horizon, or several."""
    best = {}
    for state in dict.fromkeys(row.state for row in rows):
        last = {row.rung: np.nan_to_num(row.rms[-1], nan=np.inf) for row in rows
                if row.state == state}  # fmt: skip
        least = min(last.values())
        best[state] = " and ".join(rung for rung, rms in last.items() if rms <= _EQUAL * least)
    return best


def comparison_result(
    rows: Sequence[RungError], notes: Sequence[str], log: Log, case: str, horizon: float
) -> dict[str, Any]:
    """The content of the result's JSON file."""
    best = best_rung(rows)
    sheets = []
    for state in best:
        own = [row for row in rows if row.state == state]
        noise, unit = log.noise(state), own[0].unit
        cells = [(row.rung, *(number(rms) for rms in row.rms)) for row in own]
        shown = table(
            f"Prediction error of {state} [{unit}] by time since the start of the prediction",
            [*names("rung"), *numbers(*(f"{age:.3g} s" for age in own[0].horizons))],
            cells,
            legend=f"RMS over all windows; the sensor's own noise is {number(noise)} {unit}.",
        )
        lines = [
            Series(name=row.rung, x=list(row.horizons),
                   y=[*map(finite, row.rms)])
            for row in own
        ]  # fmt: skip
        chart = LineChart(
            name=state, titles=("time since start [s]", f"RMS error [{unit}]"), lines=lines
        )
        sheets.append(Sheet(table=shown, charts=[chart]))
    words = ", ".join(f"{state}: {rung}" for state, rung in best.items())
    return result(
        "compare",
        {"case": case, "log": log.name, "horizon": horizon},
        answers=[
            Answer(
                question=f"Which rung explains {log.name}",
                verdict=MEASURED,
                words=f"Least error after {rows[0].horizons[-1]:.3g} s: {words}",
                more="; ".join(notes),
            )
        ],
        sheets=sheets,
        values=[
            Value(name=f"{row.rung} {row.state} at {age:g} s", value=finite(rms),
                  unit=row.unit, better=-1)
            for row in rows
            for age, rms in zip(row.horizons, row.rms, strict=True)
        ],
        errors=[{**row._asdict(), "rms": [*map(finite, row.rms)]}
                for row in rows],
    )  # fmt: skip
