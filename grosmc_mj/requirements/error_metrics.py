"""Settling time and overshoot of an error alone, such as that of an optimum."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.requirements.accumulator import ERROR, Constants, Rows, replay
from grosmc_mj.requirements.metrics import DWELL, SETTLING_BAND, Metric, settling
from grosmc_mj.requirements.run_metrics import settled_from


def settling_time(time: Array, error: Array, width: float | None = None) -> Metric:
    """Return when |error| enters a band for good; ``not reached`` if never.

    Args:
        time: Equally spaced instants from 0 on [s], (N,).
        error: Error at the instants, (N,).
        width: Half width of the band; 2 % of |error(0)| by default.
    """
    values = _values_of_error(time, error, width)
    duration = float(time[-1])
    step = float(time[1]) if len(time) > 1 else 1.0
    settled = settled_from(values["last_outside"], step, np.array([duration]))[0, 0]
    if settled > (1 - DWELL) * duration:
        settled = math.inf
    return settling(float(settled))


def overshoot(error: Array) -> Metric:
    """Return the largest error beyond zero, in percent of the initial error."""
    values = _values_of_error(np.arange(float(len(error))), error, None)
    start = abs(float(values["start"][0]))
    if start == 0:
        return Metric(None, "%", "no initial error")
    share = float(values["opposite"][0]) / start
    return Metric(100 * share, "%")


def _values_of_error(time: Array, error: Array, width: float | None) -> Any:
    """Return what is accumulated of an error alone."""
    share = SETTLING_BAND
    if width is not None:
        share = 0.0
    nothing = np.zeros((1, 1))
    constants = Constants(
        after=np.zeros(1),
        signals=np.array([ERROR]),
        turns=np.zeros(1),
        event_errors=np.array([ERROR]),
        event_turns=np.zeros(1),
        event_bands=np.array([math.inf]),
        event_values=np.array([ERROR]),
        outputs=np.zeros(1),
        onset=math.inf,
        late=math.inf,
        share=share,
        widths=np.array([width or 0.0]),
        transition=nothing,
        Q=nothing,
        R=nothing,
        K=nothing,
        limits=np.zeros((2, 1)),
    )
    return replay(Rows(time, error[:, None]), constants)
