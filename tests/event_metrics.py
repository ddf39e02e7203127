"""Metrics of an event of one run, whether a requirement limits them or not."""

from __future__ import annotations

import math

from grosmc_mj.control.controller import Controller
from grosmc_mj.requirements.measurement import Windows, signal_units
from grosmc_mj.requirements.metrics import (
    DWELL,
    Event,
    MeasuredSignal,
    Metric,
    largest_of,
    last_peak_of,
    reached_of,
    swings_of,
)
from grosmc_mj.requirements.optimum import Comparison
from grosmc_mj.requirements.run_metrics import metrics_of_record
from grosmc_mj.simulation.trajectory import Trajectory


def event_metrics(
    run: Trajectory, controller: Controller, comparison: Comparison, event: Event
) -> dict[str, Metric]:
    """Return the metrics of an event by name.

    They are ``reached``, the instant of the event [s]; the number of ``swings`` before it; the
    ``last_peak``, the magnitude of the signal at the last of them; and the ``final_error``, the
    largest error in the last tenth of the run.

    Args:
        run: One run on any plant, or a log, of two instants at least.
        controller: Controller of the run.
        comparison: The run beside its optimum.
        event: Signal and band.
    """
    late = (1 - DWELL) * float(run.time[-1])
    signal = MeasuredSignal(event.signal, event.periodic)
    windows = Windows(after=(late,), signals=(signal,), events=(event,))
    values = metrics_of_record(run, controller, comparison, windows=windows)

    error = controller.designed.error
    unit = signal_units(error)[event.signal or error.names[error.output_rows[0]]]
    metrics = {
        "reached": Metric(None, "s", "not reached"),
        "swings": Metric(None, "1", "not reached"),
        "last_peak": Metric(None, unit, "not reached"),
    }
    reached = values[reached_of(event)]
    if math.isfinite(reached):
        swings = values[swings_of(event)]
        metrics["reached"] = Metric(reached, "s")
        metrics["swings"] = Metric(swings, "1")
        metrics["last_peak"] = Metric(None, unit, "no swing")
        if swings > 0:
            metrics["last_peak"] = Metric(values[last_peak_of(event)], unit)

    final_error = values[largest_of(event.signal, late, periodic=event.periodic)]
    metrics["final_error"] = Metric(final_error, unit)
    return metrics
