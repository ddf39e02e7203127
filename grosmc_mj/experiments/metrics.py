"""Metrics of a run: one accumulator for running and for recorded runs, and sums over the record.

A law's run accumulates them at every timestep, in Python and in compiled code, so that it need not
be recorded; of a recorded run every instant is accumulated by the same function. Means, costs and
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

# The usual 2 % band, of the initial error.
SETTLING_BAND = 0.02
# The part of the time that an error must stay in it.
DWELL = 0.1
# A law without switching repeats to rounding, which the step of a threshold or a sum over 1e4
# samples amplifies; what depends on the chatter of a switched one in ways of its own.
_SMOOTH, _OTHER = (1e-6, 1e-9), (0.1, 0.0)


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


class Definition(NamedTuple):
    """What is known of a metric beforehand.

    Attributes:
        unit: Of it; ``output``, ``input`` and ``sliding`` stand for those of the law.
        switched: How closely it repeats under a switching law on another machine: relative,
            absolute. Switching amplifies rounding until whole samples differ; what then repeats
            are bounds, norms, averages and envelopes of the chatter.
        stored: Whether it is kept of runs that are not recorded.
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
METRICS: Mapping[str, str] = {name: d.unit for name, d in DEFINITIONS.items() if d.stored}


def tolerance_of(metric: str, *, switched: bool) -> tuple[float, float]:
    """How closely a metric repeats on another machine: relative, absolute in its unit.

    Args:
        metric: Its name.
        switched: Whether a switching law made the run.
    """
    if not switched:
        return _SMOOTH
    return DEFINITIONS[metric].switched if metric in DEFINITIONS else _OTHER


class Windows(NamedTuple):
    """Error windows and settling bands that are measured besides the usual metrics.

    Attributes:
        after: From when on largest and RMS errors are wanted [s].
        bands: Widths of further bands to settle in, in the unit of the output.
    """

    after: tuple[float, ...] = ()
    bands: tuple[float, ...] = ()

    def numbers(self) -> tuple[Array, Array]:
        """The same as ``after`` and ``widths`` of ``MeterNumbers``."""
        return np.array(self.after or (0.0,), float), np.array((0.0, *self.bands))


NO_WINDOWS = Windows()


@dataclass
class Costs:
    """The index up to a sample: by the trapezoid rule of z, and with the input v held.

    Attributes:
        t: Time of the sample [s].
        of_state: ∫ z'Qz dt.
        of_input: ∫ v'Rv dt.
        state_rate: z'Qz at the sample.
        input_rate: v'Rv from there on.
    """

    t: float = 0.0
    of_state: float = 0.0
    of_input: float = 0.0
    state_rate: float = 0.0
    input_rate: float = 0.0


@dataclass
class Meters:
    """What has been accumulated of a run up to some instant.

    Attributes:
        error: Largest error of the outputs from each of the wanted times on, (k,).
        squares: Sum of the squares of those errors, (k,).
        count: Of how many instants, (k,).
        band: Errors up to this count as none, for each band, (b,).
        outside: Last time of the transient at which the error was beyond it [s], (b,); or -1.
        start: Error at t = 0.
        left: Largest error in the late part of the transient.
        beyond: Largest error of the other sign than the first, in the transient.
        deviation: Largest distance of the outputs from the optimum.
        sliding: Largest entry of |s|.
        sliding_start: The same at t = 0.
        input: Largest entry of |u| that the plant is given.
        position: Of a cart at t = 0 [m].
        travel: How far it went [m].
        optimal: The optimal error state at this instant of a run that goes on, (size,).
        z: The error state at this instant, (size,).
        after: Where the optimal state is computed, (size,).
        still: No error, (size,).
        costs: The index up to this instant, if it is wanted.
    """

    error: Array
    squares: Array
    count: Array
    band: Array
    outside: Array
    optimal: Array
    z: Array
    after: Array
    still: Array
    start: float = 0.0
    left: float = 0.0
    beyond: float = 0.0
    deviation: float = 0.0
    sliding: float = 0.0
    sliding_start: float = 0.0
    input: float = 0.0
    position: float = 0.0
    travel: float = 0.0
    costs: Costs = field(default_factory=Costs)

    @classmethod
    def of(cls, known: MeterNumbers) -> Meters:
        """Those of a new run, with room for what these numbers ask."""
        k, b, size = len(known.after), len(known.widths), len(known.transition)
        errors: Any = (np.zeros(k), np.zeros(k), np.zeros(k), np.zeros(b), -np.ones(b))
        return cls(*errors, *(np.zeros(size) for _ in range(4)))


@dataclass(frozen=True)
class MeterNumbers:
    """What meters need to know.

    Attributes:
        after: From when on largest errors are wanted [s], (k,).
        onset: End of the transient [s].
        part: Part of the error at the start that counts as no error in the first band.
        widths: What else counts as none, for each band, (b,).
        late: When the late part of the transient begins [s].
        transition: The optimal error state from one timestep to the next, (size, size).
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
def larger(value: float, known: float) -> float:
    """The larger of two; not a number is none, in Python and in compiled code."""
    return value if value > known else known


@jitable
def note(
    t: float, error: float, deviation: float, u: float, s: float, position: float,
    meters: Any, known: Any,
) -> None:  # fmt: skip
    """Accumulate an instant.

    Args:
        t: Its time [s].
        error: Of a single output with its sign, or the norm of several.
        deviation: The same from the optimum.
        u: Largest entry of |u| that the plant is given.
        s: Largest entry of |s|.
        position: Of a cart [m].
        meters: ``Meters`` of the run.
        known: ``MeterNumbers``.
    """
    if t == 0.0:
        meters.start, meters.sliding_start, meters.position = error, s, position
        for i in range(len(known.widths)):
            meters.band[i] = known.widths[i]
        meters.band[0] += known.part * abs(error)
    if t <= known.onset * (1 + 1e-12):
        for i in range(len(known.widths)):
            if abs(error) > meters.band[i]:
                meters.outside[i] = t
        if t >= known.late * (1 - 1e-12):
            meters.left = larger(abs(error), meters.left)
        meters.beyond = larger(-error if meters.start > 0.0 else error, meters.beyond)
    for i in range(len(known.after)):
        if t >= known.after[i] * (1 - 1e-12):
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
    costs.t, costs.state_rate, costs.input_rate = t, state_rate, input_rate


@dataclass(frozen=True)
class Recording:
    """What is needed, besides its meters, to say what n runs did.

    Attributes:
        duration: [s].
        onset: When the first disturbance of each run begins [s], (n,).
        following: From instants to those that were accumulated next [s].
        windows: What else was measured.
    """

    duration: float
    onset: Array
    following: Callable[[Array], Array]
    windows: Windows = NO_WINDOWS

    @classmethod
    def sampled(
        cls, period: float, duration: float, onset: Array, windows: Windows = NO_WINDOWS
    ) -> Recording:
        """Of runs that accumulated at instants a period apart [s]."""
        return cls(duration, onset, lambda instants: instants + period, windows)

    @property
    def transient(self) -> Array:
        """How long the transient lasts, in which a run settles [s], (n,)."""
        return transient_of(self.onset, self.duration)


def transient_of(onset: Any, duration: float) -> Any:
    """How long a run of this duration is a transient whose first disturbance begins then [s]."""
    return np.where((onset > 0) & (onset < duration), onset, duration)


def error_after(after: float) -> str:
    """Name of the largest error from then on [s]."""
    return f"error after {after!r} s"


def rms_after(after: float) -> str:
    """Name of the root mean square of the error from then on [s]."""
    return f"rms error after {after!r} s"


def settled_in(band: float | None) -> str:
    """Name of the time to settle in a band, in the unit of the output; None for the usual one."""
    return "settled" if band is None else f"settled in {band!r}"


def folded(meters: Any, recording: Recording) -> dict[str, Array]:
    """Metrics from the meters of n runs, by name, (n,) each.

    ``settled`` is the first instant from which on a run stays in its band, in its transient. It
    is its settling time if it stays for the last tenth of the transient at least, else infinity:
    an error that swings in and out is always inside for a moment before some end. A run that
    starts without error has a band of zero: it has settled if it never leaves its reference.
    """
    outside = meters["outside"]
    settled = np.where(outside < 0, 0.0, recording.following(outside))
    late = settled[:, 0] > (1 - DWELL) * recording.transient
    windows, start = recording.windows, np.abs(meters["start"])
    # A run that ended before the window begins has no instant in it.
    mean = meters["squares"] / np.maximum(meters["count"], 1.0)
    return {
        "deviation": meters["deviation"],
        "settled": settled[:, 0],
        "settling_time": np.where(late, np.inf, settled[:, 0]),
        "left": meters["left"],
        "overshoot": np.divide(
            meters["beyond"], start, out=np.full(len(start), np.inf), where=start > 0
        ),
        "max_sliding": meters["sliding"],
        "sliding_start": meters["sliding_start"],
        "max_input": meters["input"],
        "cart_travel": meters["travel"],
        **{settled_in(width): settled[:, i + 1] for i, width in enumerate(windows.bands)},
        **{error_after(t): meters["error"][:, i] for i, t in enumerate(windows.after)},
        **{rms_after(t): np.sqrt(mean[:, i]) for i, t in enumerate(windows.after)},
    }


# -- of runs that go on ----------------------------------------------------------------------------


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
    """Meters of runs of a controller, for ``simulate``: they accumulate every timestep.

    Args:
        controller: A law with error coordinates and an optimum; around one in a loop they take the
            true state and the input that the actuators give.
        timestep: Of the runs [s].
        windows: Measured besides the usual metrics.
        onset: When the first disturbance begins; settling is measured up to it, unless it acts
            from the start [s].
        costs: Whether the index is wanted.
        limits: ``Plant.input_limits``, (2, m), which the input is taken within, as the plant is
            given it; None for none.
        late: From when on the error that is left is taken, up to the end of the transient [s].

    Raises:
        ArgumentError: If the controller follows no optimum.
    """
    design = controller.designed
    error, optimum = design.error, design.lqr
    after, widths = windows.numbers()
    unlimited = np.array([[-np.inf], [np.inf]]).repeat(error.inputs, 1)
    numbers = MeterNumbers(
        after=after,
        widths=widths,
        onset=_transient_end(onset),
        late=late,
        transition=_transition(optimum.closed_loop.tobytes(), error.size, timestep),
        Q=optimum.Q,
        R=optimum.R,
        limits=unlimited if limits is None else limits,
    )
    surface, cart = bool(design.sliding_unit), has_cart(error.system)
    noting = _noting_timesteps(error.state, tuple(error.output_rows), surface, cart, costs)
    return problem.Meters(noting, Meters.of(numbers), numbers)


def _transient_end(onset: float) -> float:
    """When the transient ends; a disturbance that acts from the start is part of it [s]."""
    return onset if onset > 0 else math.inf


@cache
def _transition(closed_loop: bytes, size: int, timestep: float) -> Array:
    """exp((A - B K) h)."""
    return scipy.linalg.expm(np.frombuffer(closed_loop).reshape(size, size) * timestep)


@cache
def _noting_timesteps(
    error_state: Any, outputs: tuple[int, ...], surface: bool, cart: bool, costs: bool
) -> Any:
    """``problem.Meters.note``."""
    difference = _difference(outputs)

    @jitable
    def note_timestep(
        t: float, x: Any, u: Any, memory: Any, p: Any, meters: Any, known: Any
    ) -> None:  # fmt: skip
        z, s, position = meters.z, 0.0, 0.0
        error_state(t, x, p, z)
        _follow(t, z, meters, known.transition)
        if surface:
            s = _largest_entry(memory.s)
        if cart:
            position = x[0]
        error, deviation = difference(z, meters.still), difference(z, meters.optimal)
        note(t, error, deviation, _largest_input(u, known.limits), s, position, meters, known)
        if costs:
            note_costs(t, quadratic(z, known.Q), quadratic(memory.v, known.R), meters.costs)

    return note_timestep


@jitable
def _largest_entry(values: Any) -> float:
    """The largest magnitude of several numbers."""
    largest = 0.0
    for value in values:
        largest = larger(abs(value), largest)
    return largest


@jitable
def _largest_input(values: Any, limits: Any) -> float:
    """The largest magnitude of several inputs within the plant's limits."""
    largest = 0.0
    for i in range(len(values)):
        largest = larger(abs(min(max(values[i], limits[0, i]), limits[1, i])), largest)
    return largest


@cache
def _difference(outputs: tuple[int, ...]) -> Callable[[Any, Any], float]:
    """Jitable (a, b) -> a - b of the one output, or the norm of that of several."""
    only, several = outputs[0], len(outputs) > 1

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
        meters.after[i] = z[i] if t == 0.0 else row_times(i, transition, meters.optimal)
    for i in range(len(z)):
        meters.optimal[i] = meters.after[i]


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
    """Metrics from the meters of n runs, by name, (n,) each.

    Args:
        controller: Theirs.
        meters: ``Meters`` of each at its last instant, (n,).
        recording: What the runs were.
        starts: States at t = 0, (n, states).
        last: Their last states, (n, states).
        completed: Which runs reached their end, (n,).
        costs: Whether the index is wanted, as of ``meters_of``.
    """
    metrics = folded(meters, recording)
    if costs:
        # What a run ended early at may be out of all bounds.
        ends = np.where(completed[:, None], last, starts)
        metrics["cost_ratio"] = cost_ratios(
            controller, meters["costs"], starts, ends, recording.duration
        )
    return metrics


def cost_ratios(
    controller: Controller, costs: Any, starts: Array, ends: Array, duration: float
) -> Array:
    """J with the whole input over the least, J*, of n runs, (n,); infinite where J* is zero.

    Args:
        controller: Their controller.
        costs: ``Costs`` of each at its last instant, (n,).
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
    cost = 0.5 * (ended.of_state + ended.of_input)
    return np.divide(cost, least, out=np.full(len(least), np.inf), where=least != 0)


# -- of recorded runs ------------------------------------------------------------------------------


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
    def optimal_error(self) -> Array:
        """The same of the optimal trajectory, (N + 1,)."""
        return _size(self.optimal[:, self.outputs])

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
) -> dict[str, Metric]:
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
    names = [name for name in DEFINITIONS if name != "sliding_start"]
    if len(time) < 2:
        return {name: Metric(None, "", "ended at the start") for name in names}
    units, u = controller.designed.error.units, run.system.input.unit
    shown = {
        "output": units[comparison.outputs[0]], "input": u, "input/s": f"{u}/s",
        "sliding": controller.designed.sliding_unit,
    }  # fmt: skip
    values = {k: float(v[0]) for k, v in folded(*noted(run, comparison, onset)).items()}
    values["overshoot"] *= 100
    values["rms_error"] = root_mean_square(comparison.error)
    values["total_variation"] = variation_rate(run.input, float(time[-1]))
    values |= _costs(run, controller, comparison)
    absent: dict[str, Metric] = {}
    if run.sliding is None:
        absent |= dict.fromkeys(("max_sliding", "rms_sliding"), Metric(None, "", "no surface"))
    else:
        values["rms_sliding"] = root_mean_square(_largest_entries(run.sliding))
    if len(comparison.outputs) > 1:
        absent["overshoot"] = Metric(None, "%", "several outputs")
    elif math.isinf(values["overshoot"]):
        absent["overshoot"] = Metric(None, "%", "no initial error")
    absent["settling_time"] = settling(values["settling_time"])
    if not has_cart(run.system):
        names.remove("cart_travel")
    kinds = {name: DEFINITIONS[name].unit for name in names}
    return {
        name: absent.get(name) or Metric(values[name], shown.get(kind, kind))
        for name, kind in kinds.items()
    }


def noted(
    run: Trajectory,
    comparison: Comparison,
    onset: float = math.inf,
    windows: Windows = NO_WINDOWS,
) -> tuple[Any, Recording]:
    """The meters of a recorded run, (1,), that have taken every instant, and what they are of.

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
    known = MeterNumbers(after, _transient_end(onset), widths=widths)
    return note_all(run.time, rows, known), _recorded(run.time, onset, windows)


def _recorded(time: Array, onset: float = math.inf, windows: Windows = NO_WINDOWS) -> Recording:
    """Of one run whose instants were recorded [s], (N,); after the last comes none."""

    def following(instants: Array) -> Array:
        return np.append(time, np.inf)[np.searchsorted(time, instants, side="right")]

    return Recording(float(time[-1]), np.array([onset]), following, windows)


def note_all(time: Array, rows: Array, known: MeterNumbers) -> Any:
    """Meters, (1,), of error, deviation, |u|, |s| and position in rows, (N, 5)."""
    kept = [
        np.frombuffer(pack(record), record_dtype(record)) for record in (Meters.of(known), known)
    ]
    _noting_rows()(time, rows, *kept)
    return kept[0]


@cache
def _noting_rows() -> Any:
    """The compiled loop over the instants of a recorded run."""

    def note_rows(time: Any, rows: Any, meters: Any, known: Any) -> None:
        for i in range(len(time)):
            row = rows[i]
            note(time[i], row[0], row[1], row[2], row[3], row[4], meters[0], known[0])

    return compile_python(note_rows)


def has_cart(system: System) -> bool:
    """Whether the first state of a system is a cart's position."""
    return system.name == "cart_pendulum"


def settling_time(time: Array, error: Array, width: float | None = None) -> Metric:
    """When |error| enters a band for good; ``not reached`` if never.

    Args:
        time: Instants from 0 on [s], (N,).
        error: (N,).
        width: Of the band; 2 % of |error(0)| by default.
    """
    known = MeterNumbers() if width is None else MeterNumbers(part=0.0, widths=np.array([width]))
    return settling(_of_error(time, error, known)["settling_time"])


def overshoot(error: Array) -> Metric:
    """Largest error beyond zero, in percent of the initial error."""
    share = _of_error(np.arange(float(len(error))), error, MeterNumbers())["overshoot"]
    return Metric(100 * share, "%") if share < math.inf else Metric(None, "%", "no initial error")


def _of_error(time: Array, error: Array, known: MeterNumbers) -> dict[str, float]:
    """Metrics of an error alone."""
    rows = np.column_stack([error, np.zeros((len(time), 4))])
    metrics = folded(note_all(time, rows, known), _recorded(time))
    return {name: float(value[0]) for name, value in metrics.items()}


def settling(settled: float) -> Metric:
    """A settling time [s]; infinite stands for never."""
    return Metric(settled, "s") if settled < math.inf else Metric(None, "s", "not reached")


def root_mean_square(values: Array) -> float:
    """The root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


def variation_rate(values: Array, seconds: float) -> float:
    """How much held values change, of several the sum of theirs, per second."""
    return float(np.abs(np.diff(values, axis=0)).sum() / seconds)


def _largest_entries(rows: Array) -> Array:
    """The largest magnitude in each row of one or more numbers, (N,)."""
    return np.abs(rows.reshape(len(rows), -1)).max(axis=1)


def cost_shares(metrics: Mapping[str, Metric], duration: float) -> tuple[Metric, Metric]:
    """Costs of a run in numbers that do not grow with a run that has settled.

    Args:
        metrics: Of the run.
        duration: Of the run [s].

    Returns:
        J with the continuous part of the input over J*, and the cost of the rest of the input a
        second over J* [1/s].
    """
    names = ("cost_continuous", "cost_whole", "cost_optimal")
    continuous, total, least = (metrics[name].value for name in names)
    if not (continuous is not None and total is not None and least and duration > 0):
        return Metric(None, "1", "no J*"), Metric(None, "1/s", "no J*")
    rate = (total - continuous) / (least * duration)
    return Metric(continuous / least, "1"), Metric(rate, "1/s")


def _costs(run: Trajectory, controller: Controller, comparison: Comparison) -> dict[str, float]:
    """J over the run, index (13) with the continuous part of the input, with the whole, and J*."""
    design = controller.designed.lqr
    time, z = comparison.time, comparison.z
    of_state = np.trapezoid(np.einsum("ti,ij,tj->t", z, design.Q, z), time)
    continuous = -(z @ design.K.T)
    of_continuous = np.trapezoid(np.einsum("ti,ij,tj->t", continuous, design.R, continuous), time)
    # The whole input is held between samples: its integral is a sum.
    v = run.weighed.reshape(len(run.weighed), -1)
    of_whole = float(np.einsum("ti,ij,tj->t", v, design.R, v) @ np.diff(time))
    return {
        "cost_continuous": float(0.5 * (of_state + of_continuous)),
        "cost_whole": float(0.5 * (of_state + of_whole)),
        "cost_optimal": design.optimal_cost(z[0]),
    }
