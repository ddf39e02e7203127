"""Metrics of an event of one run, as the kinds of requirements on events measure them."""

from __future__ import annotations

import math

import numpy as np

from grosmc_mj.experiments.requirements.conditions import Conditions, RecordedRun
from grosmc_mj.experiments.requirements.measurement import Windows, signal_units
from grosmc_mj.experiments.requirements.metrics import DWELL, MeasuredSignal, Metric, largest_of
from grosmc_mj.experiments.requirements.optimum import Comparison
from grosmc_mj.experiments.requirements.run_metrics import metrics_of_rows, rows_of
from grosmc_mj.experiments.requirements.swings import LastPeakBelow, ReachesWithin, SwingsBelow
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller

KINDS = {"reached": ReachesWithin, "swings": SwingsBelow, "last_peak": LastPeakBelow}


def event_metrics(
    run: Trajectory,
    controller: Controller,
    comparison: Comparison,
    signal: str,
    band: float,
    *,
    periodic: bool = False,
) -> dict[str, Metric]:
    """Return the metrics of an event by name.

    They are ``reached``, the instant of the event [s]; the number of ``swings`` before it; the
    ``last_peak``, the magnitude of the signal at the last of them; and the ``final_error``, the
    largest error in the last tenth of the run.
    """
    unit = signal_units(controller.designed.error)[signal]
    units = {"reached": "s", "swings": "1", "last_peak": unit}
    metrics = {}
    for name, kind in KINDS.items():
        limit = kind(number=math.inf, signal=signal, band=band, periodic=periodic)
        value = limit.of_record(RecordedRun(run, controller, Conditions([], np.zeros((2, 1)))))
        metrics[name] = Metric(value, units[name])
        if math.isinf(value):
            metrics[name] = Metric(None, units[name], "not reached")
    if metrics["swings"].value == 0:
        metrics["last_peak"] = Metric(None, unit, "no swing")

    late = (1 - DWELL) * float(run.time[-1])
    windows = Windows(after=(late,), signals=(MeasuredSignal(signal, periodic),))
    values = metrics_of_rows(rows_of(run, comparison.z), controller, windows=windows)
    metrics["final_error"] = Metric(values[largest_of(signal, late, periodic=periodic)], unit)
    return metrics
