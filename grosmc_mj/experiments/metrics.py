"""Metrics of a run: one accumulator for running and for recorded runs, and sums over the record.

A simulation accumulates them at every timestep, in Python and in compiled code, so that it need not
be recorded. The instants of a recorded run go through the same function. Means, costs and
variations are sums by NumPy over the record; ``Costs`` agrees with them up to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import compile_python
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.matrices import quadratic, row_times
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import System
from grosmc_mj.records import pack, record_dtype
from grosmc_mj.simulation import problem
from grosmc_mj.simulation.trajectory import Trajectory

# The usual 2 % band, a share of the initial error.
SETTLING_BAND = 0.02
# The share of the transient that an error must stay in its band.
DWELL = 0.1

# Relative and absolute tolerances on another machine. A law without switching repeats to rounding,
# which the step of a threshold or a sum over 1e4 samples amplifies.
_SMOOTH = (1e-6, 1e-9)
# Metrics that depend on the chatter of a switching law and have no tolerance of their own.
_OTHER = (0.1, 0.0)


class Metric(NamedTuple):
    """A measured value.

    Attributes:
        value: None where nothing can be measured; ``note`` says why.
        unit: Unit of the value.
        note: ``not reached``, ``no surface`` and the like.
    """

    value: float | None
    unit: str
    note: str = ""


class Definition(NamedTuple):
    """Unit and tolerance of a metric.

    Attributes:
        unit: Unit; ``output``, ``input`` and ``sliding`` stand for those of the law.
        switched: Relative and absolute tolerance under a switching law on another machine.
            Switching amplifies rounding until whole samples differ; bounds, norms, averages and
            envelopes of the chatter still repeat.
        stored: Whether runs that are not recorded have it.
    """

    unit: str
    switched: tuple[float, float]
    stored: bool = False


DEFINITIONS = {
    "deviation": Definition("output", (0.25, 1e-4), stored=True),
    "settling_time": Definition("s", (0.0, 0.02), stored=True),
    "overshoot": Definition("%", (0.2, 0.2)),
    "rms_error": Definition("output", (1e-3, 1e-5)),
    "max_sliding": Definition("sliding", (0.25, 1e-4), stored=True),
    "rms_sliding": Definition("sliding", (0.25, 1e-4)),
    "sliding_start": Definition("sliding", _OTHER, stored=True),
    "cost_continuous": Definition("1", (0.01, 0.0)),
    "cost_whole": Definition("1", (0.1, 0.0)),
    "cost_optimal": Definition("1", (1e-9, 0.0)),
    "total_variation": Definition("input/s", (0.1, 0.0)),
    "max_input": Definition("input", (0.05, 0.0), stored=True),
    "cart_travel": Definition("m", (0.05, 0.0), stored=True),
}
# The metrics that are kept of every run, with their units.
METRICS: Mapping[str, str] = {
    name: definition.unit for name, definition in DEFINITIONS.items() if definition.stored
}


def tolerance_of(metric: str, *, switched: bool) -> tuple[float, float]:
    """Return the relative tolerance of a metric on another machine, and the absolute in its unit.

    Args:
        metric: Name of the metric.
        switched: Whether a switching law made the run.
    """
    if not switched:
        return _SMOOTH
    if metric not in DEFINITIONS:
        return _OTHER
    return DEFINITIONS[metric].switched


class Windows(NamedTuple):
    """Error windows and settling bands that are measured besides the usual metrics.

    Attributes:
        after: Instants from which on the largest and the RMS error are measured [s].
        bands: Widths of further bands to settle in, in the unit of the output.
    """

    after: tuple[float, ...] = ()
    bands: tuple[float, ...] = ()

    def numbers(self) -> tuple[Array, Array]:
        """``after`` and ``widths`` of ``MeterNumbers``; the first band is the usual one."""
        after = np.array(self.after or (0.0,), float)
        widths = np.array((0.0, *self.bands))
        return after, widths


NO_WINDOWS = Windows()


@dataclass
class Costs:
    """The index up to a sample: trapezoid rule for z, held input v.

    Attributes:
        t: Time of the sample [s].
        of_state: ∫ z'Qz dt.
        of_input: ∫ v'Rv dt.
        state_rate: z'Qz at the sample.
        input_rate: v'Rv from the sample on.
    """

    t: float = 0.0
    of_state: float = 0.0
    of_input: float = 0.0
    state_rate: float = 0.0
    input_rate: float = 0.0


@dataclass
class MeterValues:
    """Accumulated values of a run up to some instant.

    Attributes:
        error: Largest error of the outputs from each instant of ``after`` on, (k,).
        squares: Sum of the squares of those errors, (k,).
        count: Number of those errors, (k,).
        band: Half width of each band, (b,).
        last_outside: Last instant of the transient with the error outside a band [s], (b,); or -1.
        optimal: Optimal error state at this instant of a simulation, (size,).
        z: Error state at this instant, (size,).
        next_optimal: Buffer in which the optimal state is computed, (size,).
        zero: Error state without error, (size,).
        start: Error at t = 0.
        late_error: Largest error in the late part of the transient.
        opposite: Largest error of the other sign than the first, in the transient.
        deviation: Largest distance of the outputs from the optimum.
        sliding: Largest entry of |s|.
        sliding_start: Largest entry of |s| at t = 0.
        input: Largest entry of |u| that the plant is given.
        position: Position of a cart at t = 0 [m].
        travel: Largest distance of the cart from there [m].
        costs: The index up to this instant, if it is wanted.
    """

    error: Array
    squares: Array
    count: Array
    band: Array
    last_outside: Array
    optimal: Array
    z: Array
    next_optimal: Array
    zero: Array
    start: float = 0.0
    late_error: float = 0.0
    opposite: float = 0.0
    deviation: float = 0.0
    sliding: float = 0.0
    sliding_start: float = 0.0
    input: float = 0.0
    position: float = 0.0
    travel: float = 0.0
    costs: Costs = field(default_factory=Costs)

    @classmethod
    def of(cls, numbers: MeterNumbers) -> MeterValues:
        """Meters of a new run, with arrays of the sizes that the numbers ask for."""
        windows = len(numbers.after)
        bands = len(numbers.widths)
        size = len(numbers.transition)
        return cls(
            error=np.zeros(windows),
            squares=np.zeros(windows),
            count=np.zeros(windows),
            band=np.zeros(bands),
            last_outside=-np.ones(bands),
            optimal=np.zeros(size),
            z=np.zeros(size),
            next_optimal=np.zeros(size),
            zero=np.zeros(size),
        )


@dataclass(frozen=True)
class MeterNumbers:
    """Constants of the meters.

    Attributes:
        after: Instants from which on largest errors are measured [s], (k,).
        onset: End of the transient [s].
        part: Half width of the first band as a share of the error at the start.
        widths: Half width of each band; the share is added to the first, (b,).
        late: Beginning of the late part of the transient [s].
        transition: exp((A - B K) h), which moves the optimal error state by a timestep,
            (size, size).
        Q: State weight of the index, (size, size).
        R: Input weight, (m, m).
        limits: Least and largest of each input that the plant is given, (2, m).
    """

    after: Array = field(default_factory=lambda: np.zeros(1))
    onset: float = math.inf
    part: float = SETTLING_BAND
    widths: Array = field(default_factory=lambda: np.zeros(1))
    late: float = math.inf
    transition: Array = field(default_factory=lambda: np.zeros((1, 1)))
    Q: Array = field(default_factory=lambda: np.zeros((1, 1)))
    R: Array = field(default_factory=lambda: np.zeros((1, 1)))
    limits: Array = field(default_factory=lambda: np.zeros((2, 1)))


@jitable
def larger(value: float, largest: float) -> float:
    """Return the larger of two; NaN never replaces a number, in Python and in compiled code."""
    return value if value > largest else largest


@jitable
def note(
    t: float,
    error: float,
    deviation: float,
    u: float,
    s: float,
    position: float,
    meters: Any,
    numbers: Any,
) -> None:
    """Accumulate an instant.

    Args:
        t: Time of the instant [s].
        error: Error of a single output with its sign, or the norm of several.
        deviation: Distance of the outputs from the optimum, likewise.
        u: Largest entry of |u| that the plant is given.
        s: Largest entry of |s|.
        position: Position of a cart [m].
        meters: ``MeterValues`` of the run.
        numbers: ``MeterNumbers``.
    """
    if t == 0.0:
        meters.start = error
        meters.sliding_start = s
        meters.position = position
        for i in range(len(numbers.widths)):
            meters.band[i] = numbers.widths[i]
        meters.band[0] += numbers.part * abs(error)

    if t <= numbers.onset * (1 + 1e-12):
        for i in range(len(numbers.widths)):
            if abs(error) > meters.band[i]:
                meters.last_outside[i] = t
        if t >= numbers.late * (1 - 1e-12):
            meters.late_error = larger(abs(error), meters.late_error)
        opposite = error
        if meters.start > 0.0:
            opposite = -error
        meters.opposite = larger(opposite, meters.opposite)

    for i in range(len(numbers.after)):
        if t >= numbers.after[i] * (1 - 1e-12):
            meters.error[i] = larger(abs(error), meters.error[i])
            meters.squares[i] += error * error
            meters.count[i] += 1.0

    meters.deviation = larger(abs(deviation), meters.deviation)
    meters.input = larger(u, meters.input)
    meters.sliding = larger(s, meters.sliding)
    meters.travel = larger(abs(position - meters.position), meters.travel)


@jitable
def note_costs(t: float, state_rate: Any, input_rate: Any, costs: Any) -> None:
    """Add the interval up to t [s], which ends with these rates, to ``Costs``."""
    elapsed = t - costs.t
    costs.of_state += elapsed * (costs.state_rate + state_rate) / 2
    costs.of_input += elapsed * costs.input_rate
    costs.t = t
    costs.state_rate = state_rate
    costs.input_rate = input_rate


@dataclass(frozen=True)
class Recording:
    """Instants and windows of n runs, which turn their meters into metrics.

    Attributes:
        duration: Duration of the runs [s].
        onset: Onset of the first disturbance of each run [s], (n,).
        windows: Further windows and bands that were measured.
        period: Time between two instants, if there is no ``time`` [s].
        time: All instants of one recorded run [s], (N,).
    """

    duration: float
    onset: Array
    windows: Windows = NO_WINDOWS
    period: float = 0.0
    time: Array | None = None

    @classmethod
    def sampled(
        cls, period: float, duration: float, onset: Array, windows: Windows = NO_WINDOWS
    ) -> Recording:
        """Recording of runs that accumulated at instants a period apart [s]."""
        return cls(duration, onset, windows, period)

    @classmethod
    def of_run(
        cls, time: Array, onset: float = math.inf, windows: Windows = NO_WINDOWS
    ) -> Recording:
        """Recording of one run with all its instants [s], (N,)."""
        return cls(float(time[-1]), np.array([onset]), windows, time=time)

    @property
    def transient(self) -> Array:
        """Length of the transient, in which a run settles [s], (n,)."""
        return transient_of(self.onset, self.duration)

    def following(self, instants: Array) -> Array:
        """Return the instants that were accumulated next [s]; infinite after the last one."""
        if self.time is None:
            return instants + self.period
        index = np.searchsorted(self.time, instants, side="right")
        return np.append(self.time, np.inf)[index]


def transient_of(onset: Any, duration: float) -> Any:
    """Return the length of the transient [s].

    Args:
        onset: Onset of the first disturbance [s]; one from the start on is part of the transient.
        duration: Duration of the run [s].
    """
    during_the_run = (onset > 0) & (onset < duration)
    return np.where(during_the_run, onset, duration)


def error_after(after: float) -> str:
    """Return the name of the largest error from an instant on [s]."""
    return f"error after {after!r} s"


def rms_after(after: float) -> str:
    """Return the name of the RMS error from an instant on [s]."""
    return f"rms error after {after!r} s"


def settled_in(band: float | None) -> str:
    """Return the name of the time to settle in a band.

    Args:
        band: Half width in the unit of the output; None for the usual band.
    """
    if band is None:
        return "settled"
    return f"settled in {band!r}"


def metrics_of_meters(meters: Any, recording: Recording) -> dict[str, Array]:
    """Return the metrics of n runs by name, (n,) each.

    ``settled`` is the first instant from which on a run stays in its band, in its transient. It
    is the settling time if it stays for the last tenth of the transient at least, else infinity:
    an error that swings in and out is always inside for a moment before some end. A run that
    starts without error has a band of zero: it has settled if it never leaves its reference.

    Args:
        meters: ``MeterValues`` of each run at its last instant, (n,).
        recording: Instants and windows of the runs.
    """
    # A run that was never outside its band is settled from the start.
    last_outside = meters["last_outside"]
    settled = np.where(last_outside < 0, 0.0, recording.following(last_outside))
    too_late = settled[:, 0] > (1 - DWELL) * recording.transient

    start = np.abs(meters["start"])
    no_error = np.full(len(start), np.inf)
    overshoot = np.divide(meters["opposite"], start, out=no_error, where=start > 0)

    metrics = {
        "deviation": meters["deviation"],
        "settled": settled[:, 0],
        "settling_time": np.where(too_late, np.inf, settled[:, 0]),
        "left": meters["late_error"],
        "overshoot": overshoot,
        "max_sliding": meters["sliding"],
        "sliding_start": meters["sliding_start"],
        "max_input": meters["input"],
        "cart_travel": meters["travel"],
    }
    for i, width in enumerate(recording.windows.bands):
        metrics[settled_in(width)] = settled[:, i + 1]

    # A run that ended before the window begins has no instant in it.
    mean_squares = meters["squares"] / np.maximum(meters["count"], 1.0)
    for i, after in enumerate(recording.windows.after):
        metrics[error_after(after)] = meters["error"][:, i]
        metrics[rms_after(after)] = np.sqrt(mean_squares[:, i])
    return metrics


# -- simulations -----------------------------------------------------------------------------------


def meters_of(
    controller: Controller,
    timestep: float,
    windows: Windows,
    onset: float,
    *,
    costs: bool = False,
    limits: Array | None = None,
    late: float = math.inf,
) -> problem.Meters:
    """Return the meters of a controller's runs, which ``simulate`` updates at every timestep.

    Args:
        controller: Law with error coordinates and an optimum; in a loop the meters take the true
            state and the input that the actuators give.
        timestep: Timestep of the runs [s].
        windows: Windows and bands that are measured besides the usual metrics.
        onset: Onset of the first disturbance; settling is measured up to it, unless it acts from
            the start [s].
        costs: Whether the index is wanted.
        limits: ``Plant.input_limits``, (2, m), to which the input is clipped as the plant clips
            it; None for none.
        late: Beginning of the part of the transient whose largest error is ``left`` [s].

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    design = controller.designed
    error = design.error
    optimum = design.lqr
    if limits is None:
        limits = np.array([[-np.inf], [np.inf]]).repeat(error.inputs, 1)

    after, widths = windows.numbers()
    numbers = MeterNumbers(
        after=after,
        widths=widths,
        onset=_transient_end(onset),
        late=late,
        transition=_transition(optimum.closed_loop.tobytes(), error.size, timestep),
        Q=optimum.Q,
        R=optimum.R,
        limits=limits,
    )
    note_timestep = _noting_timesteps(
        error.state,
        tuple(error.output_rows),
        surface=bool(design.sliding_unit),
        cart=has_cart(error.system),
        costs=costs,
    )
    return problem.Meters(note_timestep, MeterValues.of(numbers), numbers)


def _transient_end(onset: float) -> float:
    """Return the end of the transient [s]; a disturbance from the start on is part of it."""
    if onset > 0:
        return onset
    return math.inf


# The runs of a campaign ask for the same one whenever their disturbances begin at other instants.
@cache
def _transition(closed_loop: bytes, size: int, timestep: float) -> Array:
    """Return exp((A - B K) h), (size, size)."""
    matrix = np.frombuffer(closed_loop).reshape(size, size)
    return scipy.linalg.expm(matrix * timestep)


# A new function would be compiled anew.
@cache
def _noting_timesteps(
    error_state: Any,
    outputs: tuple[int, ...],
    *,
    surface: bool,
    cart: bool,
    costs: bool,
) -> Any:
    """Return ``problem.Meters.note``: numba compiles a closure with only the branches it needs."""
    difference = _difference(outputs)

    @jitable
    def note_timestep(
        t: float, x: Any, u: Any, memory: Any, p: Any, meters: Any, numbers: Any
    ) -> None:
        error_state(t, x, p, meters.z)
        _follow(t, meters.z, meters, numbers.transition)
        error = difference(meters.z, meters.zero)
        deviation = difference(meters.z, meters.optimal)

        s = 0.0
        if surface:
            s = _largest_entry(memory.s)
        position = 0.0
        if cart:
            position = x[0]
        largest_input = _largest_input(u, numbers.limits)
        note(t, error, deviation, largest_input, s, position, meters, numbers)

        if costs:
            state_rate = quadratic(meters.z, numbers.Q)
            input_rate = quadratic(memory.v, numbers.R)
            note_costs(t, state_rate, input_rate, meters.costs)

    return note_timestep


@jitable
def _largest_entry(values: Any) -> float:
    """Return the largest magnitude of several numbers."""
    largest = 0.0
    for value in values:
        largest = larger(abs(value), largest)
    return largest


@jitable
def _largest_input(values: Any, limits: Any) -> float:
    """Return the largest magnitude of several inputs within the plant's limits."""
    largest = 0.0
    for i in range(len(values)):
        limited = min(max(values[i], limits[0, i]), limits[1, i])
        largest = larger(abs(limited), largest)
    return largest


def _difference(outputs: tuple[int, ...]) -> Callable[[Any, Any], float]:
    """Return jitable (a, b) -> a - b of a single output, or the norm of that of several.

    A closure, since numba compiles the choice and the indices as constants.
    """
    only = outputs[0]
    several = len(outputs) > 1

    @jitable
    def difference(a: Any, b: Any) -> float:
        if not several:
            return a[only] - b[only]
        total = 0.0
        for i in outputs:
            total += (a[i] - b[i]) * (a[i] - b[i])
        return math.sqrt(total)

    return difference


@jitable
def _follow(t: float, z: Any, meters: Any, transition: Any) -> None:
    """Bring the optimum to this instant; it starts at z."""
    for i in range(len(z)):
        if t == 0.0:
            meters.next_optimal[i] = z[i]
        else:
            meters.next_optimal[i] = row_times(i, transition, meters.optimal)
    for i in range(len(z)):
        meters.optimal[i] = meters.next_optimal[i]


def metrics_of_simulations(
    controller: Controller,
    meters: Any,
    recording: Recording,
    starts: Array,
    last: Array,
    completed: NDArray[np.bool_],
    *,
    costs: bool,
) -> dict[str, Array]:
    """Return the metrics of n simulations by name, (n,) each.

    Args:
        controller: Controller of the runs.
        meters: ``MeterValues`` of each run at its last instant, (n,).
        recording: Instants and windows of the runs.
        starts: States at t = 0, (n, states).
        last: Last states, (n, states).
        completed: Whether each run reached its end, (n,).
        costs: Whether the index is wanted, as in ``meters_of``.
    """
    metrics = metrics_of_meters(meters, recording)
    if costs:
        # The last state of a run that ended early may be out of all bounds.
        ends = np.where(completed[:, None], last, starts)
        metrics["cost_ratio"] = cost_ratios(
            controller, meters["costs"], starts, ends, recording.duration
        )
    return metrics


def cost_ratios(
    controller: Controller, costs: Any, starts: Array, ends: Array, duration: float
) -> Array:
    """Return J with the whole input over J* of n runs, (n,); infinite where J* is zero.

    Args:
        controller: Controller of the runs.
        costs: ``Costs`` of each run at its last instant, (n,).
        starts: States at t = 0, (n, states).
        ends: States at the end, (n, states).
        duration: Duration of the runs [s].
    """
    error = controller.designed.error
    design = controller.designed.lqr
    first_z = error.along(np.full(len(starts), 0.0), starts, controller.parameters)
    last_z = error.along(np.full(len(ends), duration), ends, controller.parameters)

    # The last interval ends at the last state, which no timestep has accumulated.
    costs = costs.copy().view(np.recarray)
    last_rates = np.array([quadratic(z, design.Q) for z in last_z])
    note_costs(duration, last_rates, 0.0, costs)
    cost = 0.5 * (costs.of_state + costs.of_input)

    optimal_cost = np.array([design.optimal_cost(z) for z in first_z])
    no_optimum = np.full(len(optimal_cost), np.inf)
    return np.divide(cost, optimal_cost, out=no_optimum, where=optimal_cost != 0)


# -- recorded runs ---------------------------------------------------------------------------------


class Comparison(NamedTuple):
    """A run beside the optimum that its law was designed for.

    Attributes:
        time: Instants [s], (N + 1,).
        z: Error state of the run, (N + 1, n).
        optimal: x* or z* of eqs. (7), (30) and (50) from the same start, (N + 1, n).
        outputs: Columns of z that are errors of outputs; the others are their derivatives.
        reference: y_r in the outputs' own coordinates, (N + 1, m).
        optimum: Outputs on the optimal trajectory, (N + 1, m).
    """

    time: Array
    z: Array
    optimal: Array
    outputs: tuple[int, ...]
    reference: Array
    optimum: Array

    @property
    def error(self) -> Array:
        """Error of a single output, or the norm of several, (N + 1,)."""
        return _size(self.z[:, self.outputs])

    @property
    def optimal_error(self) -> Array:
        """Error of the optimal trajectory, or its norm, (N + 1,)."""
        return _size(self.optimal[:, self.outputs])

    @property
    def deviation(self) -> Array:
        """Distance of the outputs from the optimal trajectory, (N + 1,)."""
        return _size((self.z - self.optimal)[:, self.outputs])


def _size(rows: Array) -> Array:
    """Return a single column as it is, else the norms of the rows."""
    if rows.shape[1] == 1:
        return rows[:, 0]
    return np.linalg.norm(rows, axis=1)


def compare_with_optimum(run: Trajectory, controller: Controller) -> Comparison:
    """Return the error state of a run beside the nominal optimum, by matrix exponential.

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    error = controller.designed.error
    p = controller.parameters
    reference = error.reference_along(run.time, p.reference)
    z = error.beside(reference, run.state, p)
    optimal = controller.designed.lqr.optimal_trajectory(z[0], run.time)
    optimum = reference + error.sign * optimal

    outputs = error.output_rows
    return Comparison(run.time, z, optimal, outputs, reference[:, outputs], optimum[:, outputs])


def measure(
    run: Trajectory, controller: Controller, comparison: Comparison, onset: float = math.inf
) -> dict[str, Metric]:
    """Return all metrics of one run by name.

    Settling time and overshoot are of the transient: up to ``onset``, unless a disturbance
    acts from the start. The costs are of the index that the law was designed for, over the run.

    Args:
        run: One run on any plant.
        controller: Controller of the run.
        comparison: The run beside its optimum.
        onset: Onset of the first disturbance [s].
    """
    names = [name for name in DEFINITIONS if name != "sliding_start"]
    if len(comparison.time) < 2:
        return {name: Metric(None, "", "ended at the start") for name in names}
    if not has_cart(run.system):
        names.remove("cart_travel")

    output_unit = controller.designed.error.units[comparison.outputs[0]]
    input_unit = run.system.input.unit
    units = {
        "output": output_unit,
        "input": input_unit,
        "input/s": f"{input_unit}/s",
        "sliding": controller.designed.sliding_unit,
    }

    values = _values(run, controller, comparison, onset)
    metrics = _metrics_that_may_be_absent(run, comparison, values)
    for name in names:
        if name not in metrics:
            unit = DEFINITIONS[name].unit
            metrics[name] = Metric(values[name], units.get(unit, unit))
    return {name: metrics[name] for name in names}


def _values(
    run: Trajectory, controller: Controller, comparison: Comparison, onset: float
) -> dict[str, float]:
    """Return the value of each metric; infinite where it is not defined."""
    meters, recording = accumulate_run(run, comparison, onset)
    columns = metrics_of_meters(meters, recording)
    values = {name: float(column[0]) for name, column in columns.items()}
    values["overshoot"] *= 100
    values["rms_error"] = root_mean_square(comparison.error)
    values["total_variation"] = variation_rate(run.input, float(comparison.time[-1]))
    if run.sliding is not None:
        values["rms_sliding"] = root_mean_square(_largest_entries(run.sliding))
    values.update(_costs(run, controller, comparison))
    return values


def _metrics_that_may_be_absent(
    run: Trajectory, comparison: Comparison, values: Mapping[str, float]
) -> dict[str, Metric]:
    """Return the settling time, and each metric that the run does not have."""
    metrics = {"settling_time": settling(values["settling_time"])}
    if run.sliding is None:
        metrics["max_sliding"] = Metric(None, "", "no surface")
        metrics["rms_sliding"] = Metric(None, "", "no surface")
    if len(comparison.outputs) > 1:
        metrics["overshoot"] = Metric(None, "%", "several outputs")
    elif math.isinf(values["overshoot"]):
        metrics["overshoot"] = Metric(None, "%", "no initial error")
    return metrics


def accumulate_run(
    run: Trajectory,
    comparison: Comparison,
    onset: float = math.inf,
    windows: Windows = NO_WINDOWS,
) -> tuple[Any, Recording]:
    """Return the meters of a recorded run after every instant, (1,), and its recording.

    Args:
        run: One run on any plant.
        comparison: The run beside its optimum.
        onset: Onset of the first disturbance [s].
        windows: Further windows and bands.
    """
    rows = np.zeros((len(run.time), 5))
    rows[:, 0] = comparison.error
    rows[:, 1] = comparison.deviation
    # Input and s are held up to the next instant: at the last one there are none.
    rows[: len(run.input), 2] = _largest_entries(run.input)
    if run.sliding is not None:
        rows[: len(run.sliding), 3] = _largest_entries(run.sliding)
    if has_cart(run.system):
        rows[:, 4] = run.state[:, 0]

    after, widths = windows.numbers()
    numbers = MeterNumbers(after, _transient_end(onset), widths=widths)
    return accumulate(run.time, rows, numbers), Recording.of_run(run.time, onset, windows)


def accumulate(time: Array, rows: Array, numbers: MeterNumbers) -> Any:
    """Return the meters of one run, (1,).

    Args:
        time: Instants [s], (N,).
        rows: Error, deviation, |u|, |s| and position at each instant, (N, 5).
        numbers: Constants of the meters.
    """
    meters = _record(MeterValues.of(numbers))
    _noting_rows()(time, rows, meters, _record(numbers))
    return meters


def _record(value: Any) -> Any:
    """Return a dataclass of numbers as a structured array, (1,)."""
    return np.frombuffer(pack(value), record_dtype(value))


# Compiled once.
@cache
def _noting_rows() -> Any:
    """Return the compiled loop over the instants of a recorded run."""

    def note_rows(
        time: Any,
        rows: Any,
        meters: Any,
        numbers: Any,
    ) -> None:
        for i in range(len(time)):
            row = rows[i]
            note(time[i], row[0], row[1], row[2], row[3], row[4], meters[0], numbers[0])

    return compile_python(note_rows)


def has_cart(system: System) -> bool:
    """Whether the first state of a system is a cart's position."""
    return system.name == "cart_pendulum"


def settling_time(time: Array, error: Array, width: float | None = None) -> Metric:
    """Return when |error| enters a band for good; ``not reached`` if never.

    Args:
        time: Instants from 0 on [s], (N,).
        error: Error at the instants, (N,).
        width: Half width of the band; 2 % of |error(0)| by default.
    """
    numbers = MeterNumbers()
    if width is not None:
        numbers = MeterNumbers(part=0.0, widths=np.array([width]))
    metrics = _metrics_of_error(time, error, numbers)
    return settling(metrics["settling_time"])


def overshoot(error: Array) -> Metric:
    """Return the largest error beyond zero, in percent of the initial error."""
    instants = np.arange(float(len(error)))
    share = _metrics_of_error(instants, error, MeterNumbers())["overshoot"]
    if math.isinf(share):
        return Metric(None, "%", "no initial error")
    return Metric(100 * share, "%")


def _metrics_of_error(time: Array, error: Array, numbers: MeterNumbers) -> dict[str, float]:
    """Return the metrics of an error alone."""
    rows = np.zeros((len(time), 5))
    rows[:, 0] = error
    meters = accumulate(time, rows, numbers)
    metrics = metrics_of_meters(meters, Recording.of_run(time))
    return {name: float(value[0]) for name, value in metrics.items()}


def settling(settled: float) -> Metric:
    """Return a settling time as a metric [s]; infinite stands for never."""
    if settled < math.inf:
        return Metric(settled, "s")
    return Metric(None, "s", "not reached")


def root_mean_square(values: Array) -> float:
    """Return the root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


def variation_rate(values: Array, seconds: float) -> float:
    """Return the total variation of held values per second, summed over the columns."""
    return float(np.abs(np.diff(values, axis=0)).sum() / seconds)


def _largest_entries(rows: Array) -> Array:
    """Return the largest magnitude in each row of one or more numbers, (N,)."""
    return np.abs(rows.reshape(len(rows), -1)).max(axis=1)


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


def _costs(run: Trajectory, controller: Controller, comparison: Comparison) -> dict[str, float]:
    """Return index (13) with the continuous part of the input, with the whole, and J*."""
    design = controller.designed.lqr
    time = comparison.time
    z = comparison.z

    state_cost = np.trapezoid(_quadratic_rows(z, design.Q), time)
    continuous = -(z @ design.K.T)
    continuous_cost = np.trapezoid(_quadratic_rows(continuous, design.R), time)
    # The whole input is held between samples: its integral is a sum.
    v = run.weighed.reshape(len(run.weighed), -1)
    whole_cost = float(_quadratic_rows(v, design.R) @ np.diff(time))
    return {
        "cost_continuous": float(0.5 * (state_cost + continuous_cost)),
        "cost_whole": float(0.5 * (state_cost + whole_cost)),
        "cost_optimal": design.optimal_cost(z[0]),
    }


def _quadratic_rows(rows: Array, weight: Array) -> Array:
    """Return x' W x of each row x, (N,)."""
    return np.einsum("ti,ij,tj->t", rows, weight, rows)
