"""Metrics that the kernel accumulates at each timestep of a run, which so need not be recorded.

At the end they are what ``experiments.metrics`` measures on the recorded rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.metrics.definitions import (
    Costs,
    MeterNumbers,
    Recording,
    Windows,
    folded,
    larger,
    note,
    note_costs,
    transient_end,
)
from grosmc_mj.experiments.metrics.definitions import (
    Meters as RunMeters,
)
from grosmc_mj.experiments.metrics.recorded import has_cart
from grosmc_mj.jitable import jitable
from grosmc_mj.simulation.problem import Meters
from grosmc_mj.vectors import each, quadratic, row_times

# The metrics that are kept of every run, with their units: "output", "input" and "sliding" stand
# for those of the law.
METRICS: Mapping[str, str] = {
    "deviation": "output",
    "settling_time": "s",
    "max_sliding": "sliding",
    "sliding_start": "sliding",
    "max_input": "input",
    "cart_travel": "m",
}


@dataclass
class LawMeters(RunMeters):
    """Meters of a run that goes on.

    Attributes:
        optimal: The optimal error state at this sample, (size,).
        costs: The index up to this sample, if it is wanted.
    """

    optimal: Array = field(default_factory=lambda: np.zeros(0))
    costs: Costs = field(default_factory=Costs)


@dataclass(frozen=True)
class LawMeterNumbers(MeterNumbers):
    """What they need to know.

    Attributes:
        transition: The optimal error state from one sample to the next, (size, size).
        Q: State weight of the index, (size, size).
        R: Input weight, (m, m).
        limits: Least and largest of each input that the plant is given, (2, m).
    """

    transition: Array = field(default_factory=lambda: np.zeros((0, 0)))
    Q: Array = field(default_factory=lambda: np.zeros((0, 0)))
    R: Array = field(default_factory=lambda: np.zeros((0, 0)))
    limits: Array = field(default_factory=lambda: np.zeros((2, 0)))


def meters_of(
    controller: Controller,
    timestep: float,
    windows: Windows,
    onset: float,
    *,
    costs: bool = False,
    limits: Array | None = None,
    late: float = math.inf,
) -> Meters:
    """Meters of runs of a controller, for ``simulate``: they note every timestep.

    Args:
        controller: A law with error coordinates and an optimum; around one in a loop they note the
            true state and the input that the actuators give.
        timestep: Of the runs [s].
        windows: Measured besides the usual metrics.
        onset: When the first disturbance begins; settling is measured up to it, unless it acts
            from the start [s].
        costs: Whether the index is wanted.
        limits: ``Plant.input_limits``, (2, m), which the input is noted within, as the plant is
            given it; None for none.
        late: From when on the error that is left is noted, up to the end of the transient [s].

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    design = controller.designed
    error, optimum = design.error, design.lqr
    after, widths = windows.numbers()
    unlimited = np.array([[-np.inf], [np.inf]]).repeat(error.inputs, 1)
    numbers = LawMeterNumbers(
        after=after,
        widths=widths,
        onset=transient_end(onset),
        late=late,
        transition=_transition(optimum.closed_loop.tobytes(), error.size, timestep),
        Q=optimum.Q,
        R=optimum.R,
        limits=unlimited if limits is None else limits,
    )
    note = _noting(
        error.state,
        error.size,
        tuple(error.output_rows),
        bool(design.sliding_unit),
        has_cart(error.system),
        (_one if np.ndim(controller.memory().v) == 0 else _all) if costs else None,
    )
    return Meters(note, LawMeters.of(numbers, optimal=np.zeros(error.size)), numbers)


@cache
def _transition(closed_loop: bytes, size: int, control_period: float) -> Array:
    """exp((A - B K) T)."""
    return scipy.linalg.expm(np.frombuffer(closed_loop).reshape(size, size) * control_period)


@cache
def _noting(
    error_state: Any,
    size: int,
    outputs: tuple[int, ...],
    surface: bool,
    cart: bool,
    weighed: Callable[[Any], Any] | None,
) -> Any:
    """``Meters.note``; it notes costs if it knows how v is a vector."""
    costs, vector = weighed is not None, weighed or _all
    difference, follow, nothing = _difference(outputs), _follower(size), (0.0,) * size

    @jitable
    def note_timestep(
        t: float, x: Any, u: Any, memory: Any, p: Any, meters: Any, known: Any
    ) -> None:  # fmt: skip
        z = error_state(t, x, p)
        follow(t, z, meters.optimal, known.transition)
        s, position = 0.0, 0.0
        if surface:
            s = _largest_entry(memory.s)
        if cart:
            position = x[0]
        error, deviation = difference(z, nothing), difference(z, meters.optimal)
        given = _largest_given(u, known.limits)
        note(t, error, deviation, given, s, position, meters, known)
        if costs:
            v = vector(memory.v)
            note_costs(t, quadratic(z, known.Q), quadratic(v, known.R), meters.costs)

    return note_timestep


@jitable
def _one(value: float) -> Any:
    """The entries of a number."""
    return (value,)


@jitable
def _all(values: Any) -> Any:
    return values


@jitable
def _largest_entry(values: Any) -> float:
    """The largest magnitude of several numbers."""
    found = 0.0
    for value in values:
        found = larger(abs(value), found)
    return found


@jitable
def _largest_given(values: Any, limits: Any) -> float:
    """The largest magnitude of several inputs within the plant's limits."""
    found = 0.0
    for i in range(len(values)):
        found = larger(abs(min(max(values[i], limits[0, i]), limits[1, i])), found)
    return found


@cache
def _difference(outputs: tuple[int, ...]) -> Callable[[Any, Any], float]:
    """Jitable (a, b) -> a - b of the one output, or the norm of that of several."""
    if len(outputs) == 1:
        only = outputs[0]

        @jitable
        def single(a: Any, b: Any) -> float:
            return a[only] - b[only]

        return single

    @jitable
    def several(a: Any, b: Any) -> float:
        total = 0.0
        for i in outputs:
            total += (a[i] - b[i]) * (a[i] - b[i])
        return math.sqrt(total)

    return several


@cache
def _follower(size: int) -> Callable[[float, Any, Any, Any], None]:
    """Jitable (t, z, optimal, transition): bring the optimum to this sample; it starts at z."""
    moved = each(size, row_times)

    @jitable
    def follow(t: float, z: Any, optimal: Any, transition: Any) -> None:
        if t == 0.0:
            for i in range(size):
                optimal[i] = z[i]
        else:
            after = moved(transition, optimal)
            for i in range(size):
                optimal[i] = after[i]

    return follow


def said_by(
    controller: Controller,
    meters: Any,
    recording: Recording,
    starts: Array,
    last: Array,
    completed: NDArray[np.bool_],
    *,
    costs: bool,
) -> dict[str, Array]:
    """What the meters of n runs say, by metric, (n,) each.

    Args:
        controller: Theirs.
        meters: ``LawMeters`` of each at its last sample, (n,).
        recording: What the runs were.
        starts: States at t = 0, (n, states).
        last: Their last states, (n, states).
        completed: Which runs reached their end, (n,).
        costs: Whether the index is wanted, as the meters were told.
    """
    found = folded(meters, recording)
    if costs:
        # What a run ended early at may be out of all bounds.
        ends = np.where(completed[:, None], last, starts)
        found["cost_ratio"] = cost_ratios(
            controller, meters["costs"], starts, ends, recording.duration
        )
    return found


def cost_ratios(
    controller: Controller, costs: Any, starts: Array, ends: Array, duration: float
) -> Array:
    """J with the whole input over the least, J*, of n runs, (n,); infinite where J* is zero.

    Args:
        controller: Their controller.
        costs: ``Costs`` of each at its last sample, (n,).
        starts: States at t = 0, (n, states).
        ends: States at the end, (n, states).
        duration: [s].
    """
    error, design = controller.designed.error, controller.designed.lqr
    first, last = (
        error.along(np.full(len(states), t), states, controller.parameters)
        for t, states in ((0.0, starts), (duration, ends))
    )
    ended = costs.copy().view(np.recarray)
    note_costs(duration, np.array([quadratic(z, design.Q) for z in last]), 0.0, ended)
    least = np.array([design.optimal_cost(z) for z in first])
    whole = 0.5 * (ended.of_state + ended.of_input)
    return np.divide(whole, least, out=np.full(len(least), np.inf), where=least != 0)
