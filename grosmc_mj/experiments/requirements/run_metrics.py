"""Metrics of runs, of the values that a simulation has accumulated or a record gives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.requirements.accumulator import Rows, replay
from grosmc_mj.experiments.requirements.measurement import NO_WINDOWS, Measurement, Windows
from grosmc_mj.experiments.requirements.metrics import (
    DEFINITIONS,
    Metric,
    largest_of,
    rms_of,
    settled_in,
    settling,
    stays,
)
from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller

# Metrics of a run beside the optimum of its law's weights.
OF_WEIGHTS = ("deviation", "cost_continuous", "cost_whole", "cost_optimal", "cost_ratio")


def metrics_of(measurements: Sequence[Measurement], values: Any) -> dict[str, Array]:
    """Return the metrics of n runs of one law by name, (n,) each; infinite where undefined.

    Args:
        measurements: Measurement of each run; they differ in onset, duration, limits and design.
        values: ``Accumulated`` of each run after its last instant, (n,).
    """
    first = measurements[0]
    duration = np.array([item.duration for item in measurements])
    samples = np.maximum(values["samples"], 1.0)
    metrics = {
        "deviation": values["deviation"],
        "max_sliding": values["sliding"],
        "rms_sliding": np.sqrt(values["sliding_squares"] / samples),
        "sliding_start": values["sliding_start"],
        "max_input": values["input"],
        "total_variation": values["variation"] / duration,
    }
    metrics |= _transient_metrics(measurements, values)
    metrics |= _costs(measurements, values)
    if not first.controller.designed.weighed:
        metrics |= {name: np.full(len(values), np.inf) for name in OF_WEIGHTS}
    return metrics | _signal_metrics(first, values)


def _transient_metrics(measurements: Sequence[Measurement], values: Any) -> dict[str, Array]:
    """Return settling and overshoot.

    ``settled`` is the first instant from which on a run stays in its band, in its transient, and
    the end of a run that is outside at its end. It is the settling time if the run ``stays`` in
    it, else infinity. A run that starts without error has a band of zero: it has settled if it
    never leaves its reference. ``left`` is the largest error in the last tenth of the transient.
    The overshoot is a share of the error at the start.
    """
    first = measurements[0]
    transient = np.array([item.transient for item in measurements])
    duration = np.array([item.duration for item in measurements])
    settled = _settled_from(values["last_outside"], first.timestep, duration)
    usual = settled[:, 0]

    metrics = {
        "settling_time": np.where(stays(usual, transient), usual, np.inf),
        "left": values["late_error"],
        "overshoot": _ratio(values["opposite"], np.abs(values["start"])),
    }
    for i, band in enumerate((None, *first.windows.bands)):
        metrics[settled_in(band)] = settled[:, i]
    return metrics


def _settled_from(last_outside: Array, timestep: float, duration: Array) -> Array:
    """Return the instants after the last ones outside [s], (n, b); the end where it is the last.

    Args:
        last_outside: Last instants outside a band [s], (n, b); -1 for none.
        timestep: Time between two instants [s].
        duration: Duration of each run [s], (n,).
    """
    # A run that was never outside its band is settled from the start.
    following = np.where(last_outside < 0, 0.0, np.rint(last_outside / timestep) + 1)
    return np.minimum(following * timestep, duration[:, None])


def _ratio(value: Array, over: Array) -> Array:
    """Return a quotient, (n,); infinite where the divisor is zero."""
    infinite = np.full(len(over), np.inf)
    return np.divide(value, over, out=infinite, where=over != 0)


def _costs(measurements: Sequence[Measurement], values: Any) -> dict[str, Array]:
    """Return index (13) with the continuous part of the input, with the whole, J*, their ratio."""
    whole = 0.5 * (values["state_cost"] + values["input_cost"])
    optimal = np.zeros(len(values))
    for i, (measurement, z) in enumerate(zip(measurements, values["first_z"], strict=True)):
        # BLAS rounds a copy as it rounds any start, but not a part of a structure.
        optimal[i] = measurement.controller.designed.lqr.optimal_cost(z.copy())
    return {
        "cost_continuous": 0.5 * (values["state_cost"] + values["continuous_cost"]),
        "cost_whole": whole,
        "cost_optimal": optimal,
        "cost_ratio": _ratio(whole, optimal),
    }


def _signal_metrics(measurement: Measurement, values: Any) -> dict[str, Array]:
    """Return largest and RMS values of each signal from each instant on."""
    metrics = {}
    # A run that ended before the window begins has no instant in it.
    mean_squares = values["squares"] / np.maximum(values["count"], 1.0)[:, :, None]
    for i, after in enumerate(measurement.after):
        for j, signal in enumerate(measurement.signals):
            largest = largest_of(signal.name, after, periodic=signal.periodic)
            rms = rms_of(signal.name, after, periodic=signal.periodic)
            metrics[largest] = values["largest"][:, i, j]
            metrics[rms] = np.sqrt(mean_squares[:, i, j])
    metrics["rms_error"] = metrics[rms_of("")]
    return metrics


def metrics_of_simulations(
    measurements: Sequence[Measurement],
    accumulated: Any,
    last: Array,
    completed: NDArray[np.bool_],
) -> dict[str, Array]:
    """Return the metrics of n simulations of one law by name, (n,) each.

    Runs may be of several designs of the law: each is measured by its own optimum.

    Args:
        measurements: Measurement of each run.
        accumulated: ``Trajectory.accumulated``, (n,), which has all instants but the last.
        last: Last states, (n, states).
        completed: Whether each run reached its end, (n,); the others have no meaningful metrics.
    """
    values = accumulated.copy()
    for i in np.flatnonzero(completed).tolist():
        controller = measurements[i].controller
        end = np.array([measurements[i].duration])
        x = last[i : i + 1]
        z = controller.designed.error.along(end, x, controller.parameters)
        replay(Rows(end, z, x), measurements[i].constants, values[i : i + 1])
    return metrics_of(measurements, values)


# -- of recorded rows ------------------------------------------------------------------------------


def rows_of(run: Trajectory, z: Array) -> Rows:
    """Return the rows of a recorded run.

    Args:
        run: One run on any plant.
        z: Its error states, (N + 1, n).
    """
    intervals = len(run.time) - 1
    s = np.zeros((intervals, 0))
    if run.sliding is not None:
        s = as_rows(run.sliding)
    return Rows(
        time=run.time,
        z=z,
        x=run.state,
        u=as_rows(run.input),
        v=as_rows(run.weighed),
        s=s,
    )


def metrics_of_rows(
    rows: Rows,
    controller: Controller,
    onset: float = math.inf,
    windows: Windows = NO_WINDOWS,
) -> dict[str, float]:
    """Return the metrics of recorded rows by name; infinite where undefined, see ``metrics_of``.

    They pass through the accumulation of a simulation, so a run has the same metrics to the bit
    whether it was recorded or not.

    Args:
        rows: Rows of two instants at least.
        controller: Controller whose optimum they are compared with.
        onset: Onset of the first disturbance [s].
        windows: Further windows, bands and signals.
    """
    # The input of a record is limited already.
    timestep = float(rows.time[1])
    duration = float(rows.time[-1])
    measurement = Measurement(controller, timestep, duration, onset, windows)
    columns = metrics_of([measurement], replay(rows, measurement.constants))
    return {name: float(column[0]) for name, column in columns.items()}


def usual_metrics(
    run: Trajectory, controller: Controller, values: Mapping[str, float]
) -> dict[str, Metric]:
    """Return the usual metrics of one run by name, with units and notes.

    Settling time and overshoot are of the transient: up to the first disturbance, unless it acts
    from the start. The costs are of the index that the law was designed for, over the run.

    Args:
        run: One run on any plant.
        controller: Controller of the run.
        values: Its metrics, see ``metrics_of_rows``; nothing of a run that ended at its start.
    """
    units = _metric_units(run, controller)
    if not values:
        return {name: Metric(None, "", "ended at the start") for name in units}

    metrics = {name: Metric(values[name], unit) for name, unit in units.items()}
    metrics["settling_time"] = settling(values["settling_time"])
    overshoot = values["overshoot"]
    metrics["overshoot"] = Metric(100 * overshoot, "%")
    if run.sliding is None:
        metrics["max_sliding"] = Metric(None, "", "no surface")
        metrics["rms_sliding"] = Metric(None, "", "no surface")
    if len(controller.designed.error.output_rows) > 1:
        metrics["overshoot"] = Metric(None, "%", "several outputs")
    elif math.isinf(overshoot):
        metrics["overshoot"] = Metric(None, "%", "no initial error")
    if not controller.designed.weighed:
        of_weights = [name for name in metrics if name in OF_WEIGHTS]
        metrics |= {name: Metric(None, units[name], "no weights") for name in of_weights}
    return metrics


def _metric_units(run: Trajectory, controller: Controller) -> dict[str, str]:
    """Return the unit of each usual metric of a run by name."""
    design = controller.designed
    input_unit = run.system.input.unit
    units_of_law = {
        "output": design.error.units[design.error.output_rows[0]],
        "input": input_unit,
        "input/s": f"{input_unit}/s",
        "sliding": design.sliding_unit,
    }
    units = {}
    for name, definition in DEFINITIONS.items():
        # It is zero of an integral surface; a requirement asks for it.
        if name != "sliding_start":
            units[name] = units_of_law.get(definition.unit, definition.unit)
    for position in design.error.system.internal_positions:
        units[largest_of(position.name)] = position.unit
    return units


def cost_shares(metrics: Mapping[str, Metric], duration: float) -> tuple[Metric, Metric]:
    """Return costs of a run that do not grow with its length once it has settled.

    Args:
        metrics: Metrics of the run.
        duration: Duration of the run [s].

    Returns:
        J with the continuous part of the input over J*, and the cost of the rest of the input a
        second over J* [1/s].
    """
    continuous = metrics["cost_continuous"].value
    whole = metrics["cost_whole"].value
    optimal = metrics["cost_optimal"].value
    if continuous is None or whole is None or not optimal or not duration > 0:
        return Metric(None, "1", "no J*"), Metric(None, "1/s", "no J*")
    rate = (whole - continuous) / (optimal * duration)
    return Metric(continuous / optimal, "1"), Metric(rate, "1/s")
