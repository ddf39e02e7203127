"""What is measured on a run, with units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
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
_DWELL = 0.1


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
        z: Error state of the run, (N + 1, 2).
        optimal: x* or z* of eqs. (7), (30) and (50) from the same start, (N + 1, 2).
        reference: y_r in the output's own coordinate, (N + 1,).
        optimum: The output on the optimal trajectory, (N + 1,).
    """

    time: Array
    z: Array
    optimal: Array
    reference: Array
    optimum: Array


def compare_with_optimum(run: Trajectory, controller: Controller) -> Comparison:
    """The error state of a run and its nominal optimal trajectory, exact by matrix exponential.

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    if controller.error is None or controller.lqr is None:
        raise ArgumentError(f"{controller.name} has no error coordinates or no optimum")
    z = controller.error.along(run.time, run.state, controller.parameters.reference)
    optimal = controller.lqr.optimal_trajectory(z[0], run.time)
    sign = controller.error.sign
    reference = run.state[:, run.system.output] - sign * z[:, 0]
    return Comparison(run.time, z, optimal, reference, reference + sign * optimal[:, 0])


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
    time, z = comparison.time, comparison.z
    if len(time) < 2:
        return {name: Metric(None, "", "ended at the start") for name in METRICS}
    transient = slice(None)
    if 0 < onset < time[-1]:
        transient = slice(0, int(np.searchsorted(time, onset)) + 1)
    output, u = run.system.positions[run.system.output].unit, run.system.input.unit
    metrics = {
        "deviation": Metric(float(np.abs(z[:, 0] - comparison.optimal[:, 0]).max()), output),
        "settling_time": settling_time(time[transient], z[transient, 0]),
        "overshoot": overshoot(z[transient, 0]),
        "rms_error": Metric(float(np.sqrt(np.mean(z[:, 0] ** 2))), output),
        **_surface_metrics(run, controller.sliding_unit),
        **_costs(run, controller, comparison),
        "total_variation": Metric(float(np.abs(np.diff(run.input)).sum() / time[-1]), f"{u}/s"),
        "max_input": Metric(float(np.abs(run.input).max()), u),
    }
    if run.system.name == "cart_pendulum":
        travel = float(np.abs(run.state[:, 0] - run.state[0, 0]).max())
        metrics["cart_travel"] = Metric(travel, "m")
    return metrics


def settling_time(time: Array, error: Array) -> Metric:
    """When |error| enters the 2 % band of |error(0)| for good; ``not reached`` if never.

    To count, it must stay inside for the last tenth of the time at least: an error that swings
    in and out is always inside for a moment before some end.
    """
    outside = np.flatnonzero(np.abs(error) > SETTLING_BAND * abs(error[0]))
    last = int(outside[-1]) if len(outside) else -1
    if last + 1 >= len(time) or time[last + 1] > (1 - _DWELL) * time[-1]:
        return Metric(None, "s", "not reached")
    return Metric(float(time[last + 1]), "s")


def overshoot(error: Array) -> Metric:
    """Largest error beyond zero, in percent of the initial error."""
    if error[0] == 0:
        return Metric(None, "%", "no initial error")
    return Metric(float(max(0.0, (-error / error[0]).max()) * 100), "%")


def _surface_metrics(run: Trajectory, unit: str) -> dict[str, Metric]:
    """Maximum and RMS of |s| at the samples."""
    if run.sliding is None:
        return {
            "max_sliding": Metric(None, "", "no surface"),
            "rms_sliding": Metric(None, "", "no surface"),
        }
    return {
        "max_sliding": Metric(float(np.abs(run.sliding).max()), unit),
        "rms_sliding": Metric(float(np.sqrt(np.mean(run.sliding**2))), unit),
    }


def _costs(run: Trajectory, controller: Controller, comparison: Comparison) -> dict[str, Metric]:
    """J over the run with the continuous part of the input, with the whole, and the least J*."""
    design = controller.lqr
    assert design is not None
    time, z = comparison.time, comparison.z
    of_state = trapezoid(np.einsum("ti,ij,tj->t", z, design.Q, z), time)
    continuous = -(z @ design.K.T)
    of_continuous = trapezoid(np.einsum("ti,ij,tj->t", continuous, design.R, continuous), time)
    # The whole input is held between samples: its integral is a sum.
    of_whole = float(design.R[0, 0] * np.sum(run.weighed**2 * np.diff(time)))
    return {
        "cost_continuous": Metric(float(0.5 * (of_state + of_continuous)), "1"),
        "cost_whole": Metric(float(0.5 * (of_state + of_whole)), "1"),
        "cost_optimal": Metric(design.optimal_cost(z[0]), "1"),
    }
