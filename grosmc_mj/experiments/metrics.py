"""What is measured on a run, with units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.simulation.trajectory import Trajectory

METRICS = (
    "deviation",
    "settling_time",
    "overshoot",
    "rms_error",
    "max_sliding",
    "rms_sliding",
    "cost_continuous",
    "cost_whole",
    "cost_optimal",
    "total_variation",
    "max_input",
    "cart_travel",
)

# The usual 2 % band, of the initial error.
SETTLING_BAND = 0.02
# The part of the time that an error must stay in it.
DWELL = 0.1


class Metric(NamedTuple):
    """A measured value.

    Attributes:
        value: None if there is none to give; ``note`` says why.
        unit: Its unit.
        note: ``not reached``, ``no surface`` and the like.
    """

    value: float | None
    unit: str
    note: str = ""


class Comparison(NamedTuple):
    """A run beside the optimum that its law was designed for.

    Attributes:
        time: Instants [s], (N + 1,).
        z: Error state of the run, (N + 1, n).
        optimal: x* or z* of eqs. (7), (30) and (50) from the same start, (N + 1, n).
        outputs: Columns of z that are outputs' errors; the others are their derivatives.
        reference: y_r in the outputs' own coordinates, (N + 1, m).
        optimum: The outputs on the optimal trajectory, (N + 1, m).
    """

    time: Array
    z: Array
    optimal: Array
    outputs: tuple[int, ...]
    reference: Array
    optimum: Array

    @property
    def error(self) -> Array:
        """The output's error or, of several outputs, the norm of their errors, (N + 1,)."""
        return _size(self.z[:, self.outputs])

    @property
    def deviation(self) -> Array:
        """The same of the distance from the optimal trajectory, (N + 1,)."""
        return _size((self.z - self.optimal)[:, self.outputs])


def _size(rows: Array) -> Array:
    """A single column as it is, or the norms of the rows."""
    return rows[:, 0] if rows.shape[1] == 1 else np.linalg.norm(rows, axis=1)


def compare_with_optimum(run: Trajectory, controller: Controller) -> Comparison:
    """The error state of a run and its nominal optimal trajectory, exact by matrix exponential.

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    design, p = controller.designed, controller.parameters
    error = design.error
    z = error.along(run.time, run.state, p)
    optimal = design.lqr.optimal_trajectory(z[0], run.time)
    reference = error.reference_along(run.time, p.reference)
    outputs = error.output_rows
    optimum = reference + error.sign * optimal
    return Comparison(run.time, z, optimal, outputs, reference[:, outputs], optimum[:, outputs])


def measure(
    run: Trajectory, controller: Controller, comparison: Comparison, onset: float = math.inf
) -> Mapping[str, Metric]:
    """All metrics of one run.

    Settling time and overshoot are of the transient: up to ``onset``, unless a disturbance
    acts from the start. The costs are of the index that the law was designed for, over the run.

    Args:
        run: One run on any plant.
        controller: Its controller.
        comparison: The run beside its optimum.
        onset: When the first disturbance begins [s].
    """
    time, error = comparison.time, comparison.error
    if len(time) < 2:
        return {name: Metric(None, "", "ended at the start") for name in METRICS}
    transient = slice(None)
    if 0 < onset < time[-1]:
        transient = slice(0, int(np.searchsorted(time, onset)) + 1)
    output, u = controller.designed.error.units[comparison.outputs[0]], run.system.input.unit
    single = len(comparison.outputs) == 1
    changed = np.abs(np.diff(run.input, axis=0))
    metrics = {
        "deviation": Metric(float(np.abs(comparison.deviation).max()), output),
        "settling_time": settling_time(time[transient], error[transient]),
        "overshoot": overshoot(error[transient])
        if single
        else Metric(None, "%", "several outputs"),
        "rms_error": Metric(float(np.sqrt(np.mean(error**2))), output),
        **_surface_metrics(run, controller.designed.sliding_unit),
        **_costs(run, controller, comparison),
        "total_variation": Metric(float(changed.sum() / time[-1]), f"{u}/s"),
        "max_input": Metric(float(np.abs(run.input).max()), u),
    }
    if run.system.name == "cart_pendulum":
        travel = float(np.abs(run.state[:, 0] - run.state[0, 0]).max())
        metrics["cart_travel"] = Metric(travel, "m")
    return metrics


def settling_time(time: Array, error: Array) -> Metric:
    """When |error| enters the 2 % band of |error(0)| for good; ``not reached`` if never."""
    return settled(time, error, SETTLING_BAND * abs(error[0]))


def settled(time: Array, error: Array, band: float) -> Metric:
    """When |error| enters a band for good; ``not reached`` if never.

    To count, it must stay inside for the last tenth of the time at least: an error that swings
    in and out is always inside for a moment before some end.
    """
    outside = np.flatnonzero(np.abs(error) > band)
    last = int(outside[-1]) if len(outside) else -1
    if last + 1 >= len(time) or time[last + 1] > (1 - DWELL) * time[-1]:
        return Metric(None, "s", "not reached")
    return Metric(float(time[last + 1]), "s")


def overshoot(error: Array) -> Metric:
    """Largest error beyond zero, in percent of the initial error."""
    if error[0] == 0:
        return Metric(None, "%", "no initial error")
    return Metric(float(max(0.0, (-error / error[0]).max()) * 100), "%")


def _surface_metrics(run: Trajectory, unit: str) -> dict[str, Metric]:
    """Maximum and RMS of |s| at the samples; of several, of its largest entry."""
    if run.sliding is None:
        return {
            "max_sliding": Metric(None, "", "no surface"),
            "rms_sliding": Metric(None, "", "no surface"),
        }
    largest = np.abs(run.sliding.reshape(len(run.sliding), -1)).max(axis=1)
    return {
        "max_sliding": Metric(float(largest.max()), unit),
        "rms_sliding": Metric(float(np.sqrt(np.mean(largest**2))), unit),
    }


def _costs(run: Trajectory, controller: Controller, comparison: Comparison) -> dict[str, Metric]:
    """J over the run with the continuous part of the input, with the whole, and the least J*."""
    design = controller.designed.lqr
    time, z = comparison.time, comparison.z
    of_state = trapezoid(np.einsum("ti,ij,tj->t", z, design.Q, z), time)
    continuous = -(z @ design.K.T)
    of_continuous = trapezoid(np.einsum("ti,ij,tj->t", continuous, design.R, continuous), time)
    # The whole input is held between samples: its integral is a sum.
    whole = run.weighed.reshape(len(run.weighed), -1)
    of_whole = float(np.einsum("ti,ij,tj->t", whole, design.R, whole) @ np.diff(time))
    return {
        "cost_continuous": Metric(float(0.5 * (of_state + of_continuous)), "1"),
        "cost_whole": Metric(float(0.5 * (of_state + of_whole)), "1"),
        "cost_optimal": Metric(design.optimal_cost(z[0]), "1"),
    }
