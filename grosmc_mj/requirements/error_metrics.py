"""Settling time and overshoot of an error alone, such as that of an optimum."""

from __future__ import annotations

import math

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.requirements.metrics import DWELL, SETTLING_BAND, Metric, settling
from grosmc_mj.requirements.run_metrics import settled_from


def settling_time(time: Array, error: Array, width: float | None = None) -> Metric:
    """Return when |error| enters a band for good; ``not reached`` if never.

    Args:
        time: Equally spaced instants from 0 on [s], (N,).
        error: Error at the instants, (N,).
        width: Half width of the band; 2 % of |error(0)| by default.
    """
    if width is None:
        width = SETTLING_BAND * abs(error[0])
    outside = time[np.abs(error) > width]
    last_outside = np.max(outside, initial=-1.0).reshape(1, 1)

    duration = float(time[-1])
    step = float(time[1]) if len(time) > 1 else 1.0
    settled = float(settled_from(last_outside, step, np.array([duration]))[0, 0])
    if settled > (1 - DWELL) * duration:
        settled = math.inf
    return settling(settled)


def overshoot(error: Array) -> Metric:
    """Return the largest error beyond zero, in percent of the initial error."""
    start = float(error[0])
    if start == 0:
        return Metric(None, "%", "no initial error")
    beyond = float(np.max(-error * math.copysign(1.0, start), initial=0.0))
    return Metric(100 * (beyond / abs(start)), "%")
