"""The accumulation of metrics: one source for simulations, recorded runs and logs.

``note_instant`` takes the state at an instant, ``note_sliding`` and ``note_held`` take what is held
from it on. A simulation calls them at each timestep, in Python or in compiled code; ``replay``
calls them for each row of a record. So a run has the same metrics to the bit either way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.compiler import compile_python
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.records import pack, record_dtype
from grosmc_mj.theory.control.coordinates.base import StateMap
from grosmc_mj.theory.control.matrices import quadratic, row_times

# Number of the error among the signals, see ``Constants.signals``.
ERROR = -1.0
# Rounding of an instant k h.
_EARLIER = 1 - 1e-12
_LATER = 1 + 1e-12


@dataclass(frozen=True)
class Constants:
    """Constants of the accumulation.

    Attributes:
        after: Instants from which on signals are measured [s], (k,).
        signals: Number of each measured signal, see ``_signal_value``, (c,).
        turns: A turn of each signal that is measured modulo one, else 0, (c,).
        outputs: Entries of z that are errors of outputs.
        onset: End of the transient [s].
        late: Beginning of the late part of the transient [s].
        share: Half width of the first band as a share of the error at the start.
        widths: Half width of each band; the share is added to the first, (b,).
        transition: exp((A - B K) h), which moves the optimal error state by a timestep, (n, n).
        Q: State weight of the index, (n, n).
        R: Input weight, (m, m).
        K: Gain of the continuous part of the input, (m, n).
        limits: Least and largest of each input that the plant is given, (2, m).
    """

    after: Array
    signals: Array
    turns: Array
    outputs: Array
    onset: float
    late: float
    share: float
    widths: Array
    transition: Array
    Q: Array
    R: Array
    K: Array
    limits: Array


@dataclass
class Accumulated:
    """Values that are accumulated of a run up to some instant.

    Attributes:
        largest: Largest magnitude of each signal from each instant of ``after`` on, (k, c).
        squares: Sum of its squares, (k, c).
        count: Number of instants in these sums, (k,).
        band: Half width of each band, (b,).
        last_outside: Last instant of the transient with the error outside a band [s], (b,); or -1.
        start: Error at t = 0.
        late_error: Largest error in the late part of the transient.
        opposite: Largest error of the other sign than the first, in the transient.
        deviation: Largest distance of the outputs from the optimum.
        samples: Number of timesteps so far.
        input: Largest entry of |u| that the plant is given.
        variation: Sum of |u(k) - u(k - 1)| over all inputs and timesteps.
        sliding: Largest entry of |s|.
        sliding_start: Largest entry of |s| at t = 0.
        sliding_squares: Sum of the squares of the largest entry of |s|.
        state_cost: ∫ z'Qz dt by the trapezoid rule.
        continuous_cost: ∫ (K z)'R(K z) dt by the trapezoid rule.
        input_cost: ∫ v'Rv dt of the held v.
        t: This instant [s].
        state_rate: z'Qz at this instant.
        continuous_rate: (K z)'R(K z) at this instant.
        input_rate: v'Rv from this instant on.
        first_z: Error state at t = 0, (n,).
        optimal: Optimal error state at this instant, (n,).
        last_u: Input from this instant on, (m,).
        z: Room for the error state, (n,).
        away: Room for the distance from the optimum, (n,).
        next_optimal: Room for the next optimal state, (n,).
        continuous: Room for K z, (m,).
    """

    largest: Array
    squares: Array
    count: Array
    band: Array
    last_outside: Array
    first_z: Array
    optimal: Array
    z: Array
    away: Array
    next_optimal: Array
    last_u: Array
    continuous: Array
    start: float = 0.0
    late_error: float = 0.0
    opposite: float = 0.0
    deviation: float = 0.0
    samples: float = 0.0
    input: float = 0.0
    variation: float = 0.0
    sliding: float = 0.0
    sliding_start: float = 0.0
    sliding_squares: float = 0.0
    state_cost: float = 0.0
    continuous_cost: float = 0.0
    input_cost: float = 0.0
    t: float = 0.0
    state_rate: float = 0.0
    continuous_rate: float = 0.0
    input_rate: float = 0.0

    @classmethod
    def nothing(cls, constants: Constants) -> Accumulated:
        """Values as a run begins, with arrays of the sizes that the constants ask for."""
        windows = len(constants.after)
        signals = len(constants.signals)
        bands = len(constants.widths)
        inputs, size = constants.K.shape
        return cls(
            largest=np.zeros((windows, signals)),
            squares=np.zeros((windows, signals)),
            count=np.zeros(windows),
            band=np.zeros(bands),
            last_outside=-np.ones(bands),
            first_z=np.zeros(size),
            optimal=np.zeros(size),
            z=np.zeros(size),
            away=np.zeros(size),
            next_optimal=np.zeros(size),
            last_u=np.zeros(constants.limits.shape[1]),
            continuous=np.zeros(inputs),
        )


# -- at an instant ---------------------------------------------------------------------------------


@jitable
def note_instant(t: float, z: Any, x: Any, values: Any, constants: Any) -> None:
    """Accumulate an instant.

    Args:
        t: Time of the instant [s]; 0 at the first.
        z: Error state, (n,).
        x: State of the plant, (states,).
        values: ``Accumulated`` of the run.
        constants: ``Constants``.
    """
    _follow_optimum(t, z, values, constants.transition)
    for i in range(len(z)):
        values.away[i] = z[i] - values.optimal[i]
    deviation = _size(values.away, constants.outputs)
    values.deviation = _larger(abs(deviation), values.deviation)

    error = _size(z, constants.outputs)
    _note_transient(t, error, values, constants)
    _note_windows(t, error, z, x, values, constants)
    _note_costs(t, z, values, constants)


@jitable
def _larger(value: float, largest: float) -> float:
    """Return the larger of two; NaN never replaces a number, in Python and in compiled code."""
    return value if value > largest else largest


@jitable
def _size(z: Any, outputs: Any) -> float:
    """Return the error of a single output with its sign, or the norm of several."""
    if len(outputs) == 1:
        return z[int(outputs[0])]
    total = 0.0
    for row in outputs:
        error = z[int(row)]
        total += error * error
    return math.sqrt(total)


@jitable
def wrapped(angle: float, turn: float) -> float:
    """Return an angle between minus and plus half a turn, or itself if the turn is 0."""
    if turn == 0.0:
        return angle
    return angle - turn * math.floor(angle / turn + 0.5)


@jitable
def _follow_optimum(t: float, z: Any, values: Any, transition: Any) -> None:
    """Bring the optimum to this instant; it starts at z."""
    for i in range(len(z)):
        if t == 0.0:
            values.first_z[i] = z[i]
            values.next_optimal[i] = z[i]
        else:
            values.next_optimal[i] = row_times(i, transition, values.optimal)
    for i in range(len(z)):
        values.optimal[i] = values.next_optimal[i]


@jitable
def _note_transient(t: float, error: float, values: Any, constants: Any) -> None:
    """Accumulate settling and overshoot."""
    if t == 0.0:
        values.start = error
        for i in range(len(constants.widths)):
            values.band[i] = constants.widths[i]
        values.band[0] += constants.share * abs(error)
    if t > constants.onset * _LATER:
        return

    for i in range(len(constants.widths)):
        if abs(error) > values.band[i]:
            values.last_outside[i] = t
    if t >= constants.late * _EARLIER:
        values.late_error = _larger(abs(error), values.late_error)
    opposite = error
    if values.start > 0.0:
        opposite = -error
    values.opposite = _larger(opposite, values.opposite)


@jitable
def _note_windows(t: float, error: float, z: Any, x: Any, values: Any, constants: Any) -> None:
    """Accumulate the largest magnitude and the squares of each signal."""
    for j in range(len(constants.signals)):
        value = _signal_value(int(constants.signals[j]), error, z, x)
        value = wrapped(value, constants.turns[j])
        for i in range(len(constants.after)):
            if t >= constants.after[i] * _EARLIER:
                values.largest[i, j] = _larger(abs(value), values.largest[i, j])
                values.squares[i, j] += value * value
    for i in range(len(constants.after)):
        if t >= constants.after[i] * _EARLIER:
            values.count[i] += 1.0


@jitable
def _signal_value(number: int, error: float, z: Any, x: Any) -> float:
    """Return a signal by its number: -1 for the error, then the entries of x, then those of z."""
    if number < 0:
        return error
    if number < len(x):
        return x[number]
    return z[number - len(x)]


@jitable
def _note_costs(t: float, z: Any, values: Any, constants: Any) -> None:
    """Add the interval that ends at t [s] to the index."""
    for i in range(len(values.continuous)):
        values.continuous[i] = row_times(i, constants.K, z)
    state_rate = quadratic(z, constants.Q)
    continuous_rate = quadratic(values.continuous, constants.R)

    elapsed = t - values.t
    values.state_cost += elapsed * (values.state_rate + state_rate) / 2
    values.continuous_cost += elapsed * (values.continuous_rate + continuous_rate) / 2
    values.input_cost += elapsed * values.input_rate

    values.t = t
    values.state_rate = state_rate
    values.continuous_rate = continuous_rate


# -- from an instant on ----------------------------------------------------------------------------


@jitable
def note_sliding(s: Any, values: Any) -> None:
    """Accumulate s (m,) from an instant on, before ``note_held``."""
    largest = 0.0
    for value in s:
        largest = _larger(abs(value), largest)
    if values.samples == 0.0:
        values.sliding_start = largest
    values.sliding = _larger(largest, values.sliding)
    values.sliding_squares += largest * largest


@jitable
def note_held(u: Any, v: Any, values: Any, constants: Any) -> None:
    """Accumulate the input from an instant on.

    Args:
        u: Input of the actuators, (m,), which the plant limits.
        v: The input that the index weighs, (m,).
        values: ``Accumulated`` of the run.
        constants: ``Constants``.
    """
    for i in range(len(u)):
        limited = min(max(u[i], constants.limits[0, i]), constants.limits[1, i])
        values.input = _larger(abs(limited), values.input)
        if values.samples > 0.0:
            values.variation += abs(limited - values.last_u[i])
        values.last_u[i] = limited
    values.samples += 1.0
    values.input_rate = quadratic(v, constants.R)


# A new function would be compiled anew: there is one for all laws with the same coordinates.
@cache
def noting_timesteps(error_state: StateMap, *, surface: bool) -> Any:
    """Return ``Accumulator.note`` of laws with these error coordinates.

    Args:
        error_state: Jitable (t, x, p, z).
        surface: Whether the laws have a sliding variable.
    """

    @jitable
    def note_timestep(
        t: float, x: Any, u: Any, memory: Any, p: Any, values: Any, constants: Any
    ) -> None:
        error_state(t, x, p, values.z)
        note_instant(t, values.z, x, values, constants)
        if surface:
            note_sliding(memory.s, values)
        note_held(u, memory.v, values, constants)

    return note_timestep


# -- over recorded rows ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Rows:
    """Recorded rows of one run.

    Attributes:
        time: Instants from 0 on [s], (N + 1,).
        z: Error states, (N + 1, n).
        x: States of the plant, (N + 1, states).
        u: Inputs that are held from each instant but the last on, (N, m); none by default.
        v: Inputs that the index weighs, likewise.
        s: Sliding variable, likewise; (N, 0) of a law without one.
    """

    time: Array
    z: Array
    x: Array
    u: Array = field(default_factory=lambda: np.zeros((0, 1)))
    v: Array = field(default_factory=lambda: np.zeros((0, 1)))
    s: Array = field(default_factory=lambda: np.zeros((0, 0)))


def replay(rows: Rows, constants: Constants, values: Any = None) -> Any:
    """Return the values accumulated over recorded rows, a structured array, (1,).

    Args:
        rows: The rows.
        constants: Constants of the accumulation.
        values: Values up to the first row, (1,), which are changed; those of a new run by default.
    """
    if values is None:
        values = _structure(Accumulated.nothing(constants))
    columns = (rows.z, rows.x, rows.u, rows.v, rows.s)
    note_rows = _noting_rows()
    note_rows(rows.time, *map(np.ascontiguousarray, columns), values, _structure(constants))
    return values


def _structure(value: Any) -> Any:
    """Return a dataclass of numbers as a structured array, (1,)."""
    return pack(value).view(record_dtype(value))


# Compiled once for all laws.
@cache
def _noting_rows() -> Any:
    """Return the compiled loop over the rows of a run."""

    def note_rows(
        time: Any, z: Any, x: Any, u: Any, v: Any, s: Any, values: Any, constants: Any
    ) -> None:
        for i in range(len(time)):
            note_instant(time[i], z[i], x[i], values[0], constants[0])
            if i < len(u):
                note_sliding(s[i], values[0])
                note_held(u[i], v[i], values[0], constants[0])

    return compile_python(note_rows)
