"""Starts of predictions: a parabola through a few samples, and what the plant makes of a few more.

A parabola is a guess: it knows neither the plant nor its inputs. The start of a prediction is
fitted to the samples of a short time before it by the plant's own motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor, ReplayWindow

# Samples before and after the start of a window through which the parabola goes.
_AROUND = 15
# Steps of Gauss and Newton: a start is near its guess.
_STEPS = 6
# Step of the differences for derivatives, as a share of a state's size.
_DIFFERENCE = 1e-4


def first_guess(log: Log, windows: Sequence[ReplayWindow], model: LogModel) -> Array:
    """States at the start of each window, (windows, n), from a parabola through samples around it.

    A rate that is not measured is the slope of its position; any other state is 0.

    Args:
        log: The log.
        windows: Its parts.
        model: Names of the states, all positions, then their rates; and the sensors of them.
    """
    system = model.plant.system
    names = [state.name for state in system.states]
    positions = system.degrees_of_freedom
    starts = np.zeros((len(windows), len(names)))
    for row, window in zip(starts, windows, strict=True):
        samples = _samples_around(log, window.samples.start)
        t = log.time[samples] - window.start
        degree = min(2, len(t) - 1)
        for j, name in enumerate(names):
            is_rate = positions and j >= positions
            if name in log.states:
                parabola = np.polyfit(t, _true_values(log, name, model)[samples], degree)
                row[j] = np.polyval(parabola, 0.0)
            elif is_rate and names[j - positions] in log.states:
                values = _true_values(log, names[j - positions], model)
                row[j] = np.polyfit(t, values[samples], degree)[-2]
    return starts


def _true_values(log: Log, state: str, model: LogModel) -> Array:
    """A measured state without the bias and the scale of its sensor."""
    sensor = model.sensor(state)
    return (log.states[state] - sensor.bias) / (sensor.scale or 1.0)


def _samples_around(log: Log, sample: int) -> slice:
    """The samples near one, within its piece."""
    piece = next(piece for piece in log.pieces if piece.start <= sample < piece.stop)
    return slice(max(sample - _AROUND, piece.start), min(sample + _AROUND, piece.stop))


def state_sizes(log: Log, names: Sequence[str]) -> Array:
    """A size of each state, (n,): its span in the log, or the largest span of another one."""
    spans = {name: max(log.span(name), 1e-9) for name in log.states}
    largest = max(spans.values())
    return np.array([spans.get(name, largest) for name in names])


def fitted_starts(predictor: Predictor, model: LogModel) -> Array:
    """States at the start of each window, (windows, n), by the plant's motion in it.

    Least squares of each window alone, by Gauss and Newton: a state that its samples do not show
    stays at the first guess.

    Args:
        predictor: Windows that the starts are fitted to, see ``Predictor.leads``.
        model: The machine.
    """
    log = predictor.log
    names = [state.name for state in model.plant.system.states]
    sizes = state_sizes(log, names)

    starts = first_guess(log, predictor.windows, model)
    best = starts
    least = np.full(len(starts), np.inf)
    for _ in range(_STEPS):
        errors, slopes = _linearized(predictor, model, starts, sizes)
        costs = np.array([float(error @ error) for error in errors])
        is_better = costs < least
        best = np.where(is_better[:, None], starts, best)
        least = np.minimum(costs, least)

        steps = np.array([_step(error, slope) for error, slope in zip(errors, slopes, strict=True)])
        # A window that got worse is tried again halfway.
        starts = np.where(is_better[:, None], starts - steps * sizes, (starts + best) / 2)
    return best


def _linearized(
    predictor: Predictor, model: LogModel, starts: Array, sizes: Array
) -> tuple[list[Array], list[Array]]:
    """The weighted errors of each window, (K,), and their derivatives by its start, (K, n)."""
    n = len(sizes)
    moves = np.vstack([np.zeros(n), np.eye(n), -np.eye(n)]) * _DIFFERENCE
    trials = [starts + move * sizes for move in moves]
    runs = predictor.states([model] * len(trials), trials)
    weighted = [_weighted(predictor, states, model) for states in runs]

    errors = weighted[0]
    slopes = []
    for window in range(len(starts)):
        columns = []
        for j in range(n):
            up = weighted[1 + j][window]
            down = weighted[1 + n + j][window]
            columns.append((up - down) / (2 * _DIFFERENCE))
        slopes.append(np.column_stack(columns))
    return errors, slopes


def _weighted(predictor: Predictor, states: Sequence[Array], model: LogModel) -> list[Array]:
    """The errors of each window in deviations of the sensors, state by state, (K,)."""
    log = predictor.log
    errors = predictor.errors(states, model)
    # A deviation takes the whole log, of which there may be many windows.
    deviations = {name: log.deviation(name) for name in errors}
    by_window = []
    for k, window in enumerate(predictor.windows):
        parts = []
        for name, of_state in errors.items():
            # A late sensor shows first what was before the window.
            age = log.time[window.samples] - window.start
            is_shown = age >= model.sensor(name).delay
            parts.append(np.where(is_shown, of_state[k], 0.0) / deviations[name])
        by_window.append(np.concatenate(parts))
    return by_window


def _step(errors: Array, slopes: Array) -> Array:
    """The change of a start, in sizes, that cancels the errors of its window; (n,)."""
    n = slopes.shape[1]
    if not (np.isfinite(errors).all() and np.isfinite(slopes).all()):
        return np.zeros(n)
    # A change of a size is as unlikely as an error of one deviation.
    rows = np.vstack([slopes, np.eye(n)])
    return np.linalg.lstsq(rows, np.append(errors, np.zeros(n)), rcond=None)[0]
