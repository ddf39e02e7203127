"""Moments of a log that no model explains: a push by hand, a stray sample, a stop that was hit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.model import LogModel
from grosmc_mj.identify.replay import Predictor
from grosmc_mj.identify.starts import fitted_starts

# Error of a moment over the usual one, from which it is not explained.
_UNUSUAL = 6.0


def unexplained_moments(
    models: Sequence[LogModel], log: Log, horizon: float, timestep: float
) -> list[str]:
    """A line for each moment of a log that none of some machines can follow.

    Moments are as short as the part that a start is fitted to; its start is fitted to the moment.

    Args:
        models: The machines.
        log: The log.
        horizon: Length of a prediction [s].
        timestep: Of plants given as equations [s].
    """
    windows = Predictor.moments(log, horizon, timestep).windows
    unexplained = np.ones(len(windows), bool)
    for model in models:
        predictor = Predictor.moments(log, horizon, model.plant.step_length or timestep)
        unexplained &= _unusual(predictor, model)

    spans: list[list[float]] = []
    for index in np.flatnonzero(unexplained).tolist():
        window = windows[index]
        end = float(log.time[window.samples.stop - 1])
        # Moments that follow each other are one.
        if spans and window.start - spans[-1][1] < 2 * log.sampling:
            spans[-1][1] = end
        else:
            spans.append([window.start, end])
    return [f"{a:.3g} to {b:.3g} s: a push that no model explains" for a, b in spans]


def _unusual(predictor: Predictor, model: LogModel) -> NDArray[np.bool_]:
    """Which windows a machine follows far worse than the others, (windows,)."""
    log = predictor.log
    errors = predictor.errors_from(model, fitted_starts(predictor, model))
    unusual = np.zeros(len(predictor.windows), bool)
    for name, parts in errors.items():
        rms = np.array([_rms(part) for part in parts])
        usual = max(float(np.median(rms)), log.deviation(name))
        unusual |= ~(rms < _UNUSUAL * usual)
    return unusual


def _rms(errors: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(errors**2)))
