"""What is measured on a recorded run, with units.

Largest values, settling and the like are the folds that running laws use, too. Means, costs and
variations are sums by NumPy, whose last digits are on record; what a running law adds up one
sample after the other, ``definitions.Costs``, agrees with them up to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.metrics.definitions import (
    NO_WINDOWS,
    MeterNumbers,
    Recording,
    Windows,
    folded,
    note_all,
    transient_end,
)
from grosmc_mj.plants import System
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
    reference = error.reference_along(run.time, p.reference)
    z = error.beside(reference, run.state, p)
    optimal = design.lqr.optimal_trajectory(z[0], run.time)
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
    time = comparison.time
    if len(time) < 2:
        return {name: Metric(None, "", "ended at the start") for name in METRICS}
    output, u = controller.designed.error.units[comparison.outputs[0]], run.system.input.unit
    meters, recording = noted(run, comparison, onset)
    value = {name: float(found[0]) for name, found in folded(meters, recording).items()}
    metrics = {
        "deviation": Metric(value["deviation"], output),
        "settling_time": settling(value["settling_time"]),
        "overshoot": _overshoot(meters)
        if len(comparison.outputs) == 1
        else Metric(None, "%", "several outputs"),
        "rms_error": Metric(root_mean_square(comparison.error), output),
        **_surface_metrics(run, controller.designed.sliding_unit, value["max_sliding"]),
        **_costs(run, controller, comparison),
        "total_variation": Metric(variation_rate(run.input, float(time[-1])), f"{u}/s"),
        "max_input": Metric(value["max_input"], u),
    }
    if has_cart(run.system):
        metrics["cart_travel"] = Metric(value["cart_travel"], "m")
    return metrics


def noted(
    run: Trajectory,
    comparison: Comparison,
    onset: float = math.inf,
    windows: Windows = NO_WINDOWS,
) -> tuple[Any, Recording]:
    """The meters of a recorded run, (1,), noted at every instant, and what they are of.

    Args:
        run: One run on any plant.
        comparison: The run beside its optimum.
        onset: When the first disturbance begins [s].
        windows: What else is measured.
    """
    rows = np.zeros((len(run.time), 5))
    rows[:, 0], rows[:, 1] = comparison.error, comparison.deviation
    # Input and s are held up to the next instant: at the last one there are none.
    for column, held in ((2, run.input), (3, run.sliding)):
        if held is not None:
            rows[: len(held), column] = _largest_entries(held)
    if has_cart(run.system):
        rows[:, 4] = run.state[:, 0]
    after, widths = windows.numbers()
    known = MeterNumbers(after, transient_end(onset), widths=widths)
    return note_all(run.time, rows, known), Recording.recorded(run.time, onset, windows)


def has_cart(system: System) -> bool:
    """Whether the first state of a system is a cart's position."""
    return system.name == "cart_pendulum"


def settling_time(time: Array, error: Array, width: float | None = None) -> Metric:
    """When |error| enters a band for good; ``not reached`` if never.

    Args:
        time: Instants from 0 on [s], (N,).
        error: (N,).
        width: Of the band; 2 % of |error(0)| unless told.
    """
    known = MeterNumbers() if width is None else MeterNumbers(part=0.0, widths=np.array([width]))
    found = folded(*_error_alone(time, error, known))
    return settling(float(found["settling_time"][0]))


def overshoot(error: Array) -> Metric:
    """Largest error beyond zero, in percent of the initial error."""
    return _overshoot(_error_alone(np.arange(float(len(error))), error, MeterNumbers())[0])


def _error_alone(time: Array, error: Array, known: MeterNumbers) -> tuple[Any, Recording]:
    """The meters of an error, and what they are of."""
    rows = np.column_stack([error, np.zeros((len(time), 4))])
    return note_all(time, rows, known), Recording.recorded(time, math.inf)


def settling(settled: float) -> Metric:
    """A settling time [s]; infinite stands for never."""
    return Metric(settled, "s") if settled < math.inf else Metric(None, "s", "not reached")


def _overshoot(meters: Any) -> Metric:
    start, beyond = float(meters["start"][0]), float(meters["beyond"][0])
    if start == 0:
        return Metric(None, "%", "no initial error")
    return Metric(beyond / abs(start) * 100, "%")


def root_mean_square(values: Array) -> float:
    """The root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


def variation_rate(values: Array, seconds: float) -> float:
    """How much held values change, of several the sum of theirs, per second."""
    return float(np.abs(np.diff(values, axis=0)).sum() / seconds)


def crossings(values: Array) -> int:
    """How often values change their sign; a zero in between counts once."""
    return int(np.count_nonzero(np.diff(np.sign(values[values != 0.0]))))


def _largest_entries(rows: Array) -> Array:
    """The largest magnitude in each row of one or more numbers, (N,)."""
    return np.abs(rows.reshape(len(rows), -1)).max(axis=1)


def _surface_metrics(run: Trajectory, unit: str, largest: float) -> dict[str, Metric]:
    """Maximum and RMS of |s| at the samples; of several, of its largest entry."""
    if run.sliding is None:
        return {
            "max_sliding": Metric(None, "", "no surface"),
            "rms_sliding": Metric(None, "", "no surface"),
        }
    return {
        "max_sliding": Metric(largest, unit),
        "rms_sliding": Metric(root_mean_square(_largest_entries(run.sliding)), unit),
    }


def cost_shares(metrics: Mapping[str, Metric], duration: float) -> tuple[Metric, Metric]:
    """What a run costs, in numbers that do not grow with a run that has settled.

    Args:
        metrics: Of the run.
        duration: Of the run [s].

    Returns:
        J with the continuous part of the input over J*, and what the rest of the input costs a
        second over J* [1/s].
    """
    continuous, whole, least = (
        metrics[name].value for name in ("cost_continuous", "cost_whole", "cost_optimal")
    )
    if not (continuous is not None and whole is not None and least and duration > 0):
        return Metric(None, "1", "no J*"), Metric(None, "1/s", "no J*")
    rate = (whole - continuous) / (least * duration)
    return Metric(continuous / least, "1"), Metric(rate, "1/s")


def _costs(run: Trajectory, controller: Controller, comparison: Comparison) -> dict[str, Metric]:
    """J over the run with the continuous part of the input, with the whole, and the least J*."""
    design = controller.designed.lqr
    time, z = comparison.time, comparison.z
    of_state = np.trapezoid(np.einsum("ti,ij,tj->t", z, design.Q, z), time)
    continuous = -(z @ design.K.T)
    of_continuous = np.trapezoid(np.einsum("ti,ij,tj->t", continuous, design.R, continuous), time)
    # The whole input is held between samples: its integral is a sum.
    whole = run.weighed.reshape(len(run.weighed), -1)
    of_whole = float(np.einsum("ti,ij,tj->t", whole, design.R, whole) @ np.diff(time))
    return {
        "cost_continuous": Metric(float(0.5 * (of_state + of_continuous)), "1"),
        "cost_whole": Metric(float(0.5 * (of_state + of_whole)), "1"),
        "cost_optimal": Metric(design.optimal_cost(z[0]), "1"),
    }
