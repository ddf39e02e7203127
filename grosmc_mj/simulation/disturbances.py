"""Disturbances as values: where they act, how large they are, and their course in time.

They enter a control loop at three places: at an input of the plant, at a measured output, at the
plant itself. The plant is disturbed by a wrench on a body or, where it is given as equations, at
the rate of a state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError, unknown_name, value_text
from grosmc_mj.ground.fields import (
    Flag,
    Is,
    KeyName,
    Name,
    Numbers,
    Range,
    Reals,
    checked,
    range_of,
)
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.simulation.loop.timing import steps_in
from grosmc_mj.theory.plants import System
from grosmc_mj.theory.plants.owner_units import INPUT, STATE, STATE_RATE

# Kinds of courses in time: one of the formulas below, values at all timesteps, or a table.
CONSTANT = 0.0
PULSE = 1.0
SINE = 2.0
VALUES = 3.0
TABLE = 4.0
PERIODIC_TABLE = 5.0
# Numbers of a disturbance: first signal, number of signals, course, a, b, c, amplitudes (6).
NUMBERS = 12
_COURSE = 2
_AMPLITUDES = 6

# Timesteps in a period of a sine, at least: held over a quarter of it, a sine keeps 90 % of its
# amplitude; with fewer than two it is another, slower one.
_STEPS_A_PERIOD = 4
# An instant counts as reached when it is this close [s]: k times h is not exact in binary.
_INSTANT = 1e-9


@jitable
def course(
    kind: float,
    t: float,
    a: float,
    b: float,
    c: float,
    h: float,
) -> float:
    """Value of the formula of this kind with its numbers, held from t to t + h [s].

    An edge between the two counts with its share of the time, so that a pulse has its area; with
    h = 0 it is the value at t.
    """
    if kind == PULSE:
        return _share(t, h, a) - _share(t, h, b)
    if kind == SINE:
        # It begins with its value at the onset.
        return _share(t, h, b) * math.sin(a * max(t, b - _INSTANT) + c)
    return 1.0


@jitable
def _share(t: float, h: float, edge: float) -> float:
    """Share of the time from t to t + h [s] that comes after an edge; all of it from t on."""
    if edge - _INSTANT <= t:
        return 1.0
    if edge + _INSTANT >= t + h:
        return 0.0
    return (t + h - edge) / h


@jitable
def tabulated(kind: float, values: Array, step: int, a: float, b: float, c: float) -> float:
    """Value of a course without a formula in a timestep.

    Args:
        kind: ``VALUES``, ``TABLE`` or ``PERIODIC_TABLE``.
        values: Values of all such courses, one after the other.
        step: Number of the timestep.
        a: Index of the first value; of ``VALUES`` that of timestep 0, which may lie before it.
        b: Timesteps for which a value of a table is held.
        c: Number of values of a table.
    """
    first = int(a)
    if kind == VALUES:
        return values[first + step]
    index = step // int(b)
    count = int(c)
    if kind == PERIODIC_TABLE:
        index %= count
    if index >= count:
        return 0.0
    return values[first + index]


@jitable
def disturb(
    disturbances: Array,
    values: Array,
    step: int,
    t: float,
    h: float,
    signals: Array,
) -> None:
    """Write the sums of the disturbances that are held through a timestep.

    Args:
        disturbances: Numbers of the disturbances, (count, NUMBERS), see ``packed``.
        values: Values of courses without a formula, one after the other.
        step: Number of the timestep.
        t: Its begin [s].
        h: Its length [s].
        signals: Disturbance of each signal, in the order of ``widths``.
    """
    for i in range(len(signals)):
        signals[i] = 0.0
    for k in range(len(disturbances)):
        kind = disturbances[k, 2]
        a = disturbances[k, 3]
        b = disturbances[k, 4]
        c = disturbances[k, 5]
        if kind >= VALUES:
            value = tabulated(kind, values, step, a, b, c)
        else:
            value = course(kind, t, a, b, c, h)
        first = int(disturbances[k, 0])
        for i in range(int(disturbances[k, 1])):
            signals[first + i] += value * disturbances[k, 6 + i]


Profile = Callable[[float], float]


class _Formula:
    """A profile that compiled code computes by ``course``."""

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Kind of the formula, and its a, b and c."""
        return CONSTANT, 0.0, 0.0, 0.0

    def __call__(self, t: float) -> float:
        """Value at t [s]."""
        kind, a, b, c = self.numbers
        return course(kind, t, a, b, c, 0.0)


@checked()
class Constant(_Formula):
    """1 at all times."""


@checked(label="pulse")
class Pulse(_Formula):
    """1 for start <= t < stop, else 0.

    Attributes:
        start: Begin of the pulse [s].
        stop: End of the pulse [s]; infinite for none.
    """

    start: Annotated[float, Range(unit="s", infinite=True)] = 0.0
    stop: Annotated[float, Range(unit="s", infinite=True)] = math.inf

    def __post_init__(self) -> None:
        if not self.start < self.stop:
            raise ArgumentError(
                f"pulse from {value_text(self.start)} to {value_text(self.stop)} s never acts"
            )

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Kind, start, stop."""
        return PULSE, self.start, self.stop, 0.0


@checked(label="sine")
class SineFrom(_Formula):
    """sin(frequency t + phase) from ``onset`` on, 0 before; t counts from the run's start.

    Attributes:
        frequency: Frequency of the sine [rad/s]; 1 Hz is a turn a second.
        onset: Instant from which on it acts [s].
        phase: Phase of the sine [rad].
    """

    frequency: Annotated[float, Range(unit="rad/s")]
    onset: Annotated[float, Range(unit="s")] = 0.0
    phase: Annotated[float, Range(unit="rad")] = 0.0

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Kind, frequency, onset, phase."""
        return SINE, self.frequency, self.onset, self.phase


class _Values(Reals):
    """Numbers in a list, kept as a tuple, which can be compared and hashed."""

    def __call__(self, value: Any) -> Any:
        """Return the numbers as floats."""
        numbers = super().__call__(value)
        if not len(numbers):
            raise refusal("at least one number")
        return tuple(numbers.tolist())


@checked(label="table")
class Table:
    """Values that are held for the same time each, from t = 0 on; 0 after the last one.

    Attributes:
        values: Values, one after the other.
        hold: Time for which each is held [s]; a multiple of the timestep.
        periodic: Whether they begin again after the last one.
    """

    values: Annotated[tuple[float, ...], _Values((None,))]
    hold: Annotated[float, Range(0, unit="s", above=True)]
    periodic: Flag = False

    def __call__(self, t: float) -> float:
        """Value at t [s]."""
        index = math.floor((t + _INSTANT) / self.hold)
        count = len(self.values)
        if self.periodic:
            return self.values[index % count]
        return self.values[index] if 0 <= index < count else 0.0

    @property
    def window(self) -> tuple[float, float]:
        """Begin of the first value that is not zero and end of the last value [s]."""
        acting = [index for index, value in enumerate(self.values) if value != 0.0]
        start = self.hold * min(acting, default=0)
        if self.periodic:
            return start, math.inf
        return start, self.hold * len(self.values)


class AnyDisturbance:
    """A disturbance of some signals: amplitudes times a profile of t.

    It is sampled at the start of each timestep and held through it. A pulse that begins or ends
    between two timesteps counts with its share of the one around that instant.

    Attributes:
        part: Signals of which it disturbs some: a key of ``widths``.
        noun: What is disturbed: ``body``, ``input`` or ``state``; the field of its name.
        words: Beginning of its title.
        profile: Function of t [s].
        label: Name in figures.
        scale: Factor on its amplitudes.
    """

    part: ClassVar[str]
    noun: ClassVar[str]
    words: ClassVar[str]
    profile: Profile
    label: str
    scale: float

    @property
    def of(self) -> str:
        """Name of the body, the input or the state."""
        return getattr(self, self.noun)

    @property
    def title(self) -> str:
        """Its label, or where it acts in words."""
        return self.label or f"{self.words} {self.of}"

    @property
    def amplitudes(self) -> tuple[float, ...]:
        """Values for a profile of 1: one, or the six of a wrench."""
        of_one_signal: Any = self
        return (self.scale * of_one_signal.amplitude,)

    def scaled(self, factor: float) -> Self:
        """Copy with its amplitudes times a factor."""
        of_one_signal: Any = self
        return replace(of_one_signal, amplitude=factor * of_one_signal.amplitude)

    def unit(self, system: System) -> str:
        """Unit of the amplitude of a signal; "" of a wrench, which has two."""
        bounds = range_of(type(self), "amplitude")
        return bounds.unit_in(system, self.of) if bounds else ""

    def place(self, system: System) -> int:
        """Index of its first signal among those of its part.

        Raises:
            ArgumentError: If the system has no such body, input or state.
        """
        names: Mapping[str, Sequence[str]] = {
            "body": system.bodies,
            "input": [signal.name for signal in system.inputs],
            "state": [state.name for state in system.states],
        }
        valid = names[self.noun]
        if self.of not in valid:
            raise ArgumentError(unknown_name(self.noun, self.of, valid))
        return valid.index(self.of)

    @property
    def window(self) -> tuple[float, float]:
        """First and last instant at which it may act [s]; the last one may be infinite."""
        if isinstance(self.profile, Pulse):
            return (self.profile.start, self.profile.stop)
        if isinstance(self.profile, Table):
            return self.profile.window
        return (getattr(self.profile, "onset", 0.0), math.inf)


_Profile = Annotated[Profile, Is(Callable, "a function of t [s] that returns a number")]


@checked(label="disturbance")
class Disturbance(AnyDisturbance):
    """A wrench on a body, times a profile of t.

    It reaches physics through ``xfrc_applied``: at the body's centre of mass, in world axes.

    Attributes:
        body: Name of the body.
        wrench: [force, torque] in N and N m, (6,).
        profile: Function of t [s]; 1 by default.
        label: Name in figures.
        scale: Factor on amplitude or wrench.
    """

    part: ClassVar[str] = "w"
    noun: ClassVar[str] = "body"
    words: ClassVar[str] = "disturbance on"

    body: Annotated[str, Is(str, "the name of a body")]
    wrench: Annotated[tuple[float, float, float, float, float, float], Numbers(6), KeyName("")]
    profile: _Profile = Constant()
    label: str = ""
    scale: Annotated[float, Range()] = 1.0

    @property
    def amplitudes(self) -> tuple[float, ...]:
        """The wrench, scaled."""
        return tuple(self.scale * part for part in self.wrench)

    def scaled(self, factor: float) -> Self:
        """Copy with its wrench times a factor."""
        return replace(self, wrench=tuple(factor * part for part in self.wrench))

    def place(self, system: System) -> int:
        """Index of the first of six components."""
        return 6 * super().place(system)


@checked(label="disturbance")
class InputDisturbance(AnyDisturbance):
    """A value added to an input that reaches the plant, after the actuators of a loop.

    A model in MuJoCo keeps the sum within the range of its own actuator. The input that
    trajectories record and requirements measure is without it.

    Attributes:
        input: Name of the input.
        amplitude: Amplitude, in the unit of the input.
        profile: Function of t [s]; 1 by default.
        label: Name in figures.
        scale: Factor on amplitude or wrench.
    """

    part: ClassVar[str] = "input_disturbance"
    noun: ClassVar[str] = "input"
    words: ClassVar[str] = "disturbance of"

    input: Name
    amplitude: Annotated[float, Range(unit=INPUT)]
    profile: _Profile = Constant()
    label: str = ""
    scale: Annotated[float, Range()] = 1.0


@checked(label="disturbance")
class OutputDisturbance(AnyDisturbance):
    """A value added to a state as it is measured: sensors measure x + d in place of x.

    A sensor that is late has the disturbance of the instant at which it measured; its scale, bias,
    noise and resolution come after it. Without a loop the law gets x + d. The plant and the
    metrics have the true state, and so have estimators that start settled. It has no effect on a
    state that an estimator gives and no sensor measures.

    Attributes:
        state: Name of the state.
        amplitude: Amplitude, in the unit of the state.
        profile: Function of t [s]; 1 by default.
        label: Name in figures.
        scale: Factor on amplitude or wrench.
    """

    part: ClassVar[str] = "output_disturbance"
    noun: ClassVar[str] = "state"
    words: ClassVar[str] = "disturbance of measured"

    state: Annotated[Name, KeyName("measured")]
    amplitude: Annotated[float, Range(unit=STATE)]
    profile: _Profile = Constant()
    label: str = ""
    scale: Annotated[float, Range()] = 1.0


@checked(label="disturbance")
class RateDisturbance(AnyDisturbance):
    """A value added to the rate of a state, x' = f + g u + d; of plants given as equations only.

    Attributes:
        state: Name of the state.
        amplitude: Amplitude, in the unit of the state per second.
        profile: Function of t [s]; 1 by default.
        label: Name in figures.
        scale: Factor on amplitude or wrench.
    """

    part: ClassVar[str] = "rate_disturbance"
    noun: ClassVar[str] = "state"
    words: ClassVar[str] = "disturbance of the rate of"

    state: Name
    amplitude: Annotated[float, Range(unit=STATE_RATE)]
    profile: _Profile = Constant()
    label: str = ""
    scale: Annotated[float, Range()] = 1.0


def widths(disturbances: Iterable[AnyDisturbance], system: System) -> dict[str, int]:
    """Number of signals of each part, in the order of ``disturb``; 0 if nothing disturbs it.

    ``w`` are the wrenches on the bodies.
    """
    n = len(system.states)
    m = len(system.inputs)
    sizes = {
        Disturbance.part: 6 * len(system.bodies),
        InputDisturbance.part: m,
        OutputDisturbance.part: n,
        RateDisturbance.part: n,
    }
    disturbed = {disturbance.part for disturbance in disturbances}
    return {part: size if part in disturbed else 0 for part, size in sizes.items()}


def packed(
    disturbances: Sequence[AnyDisturbance],
    system: System,
    sizes: Mapping[str, int],
    steps: range,
    timestep: float,
) -> tuple[Array, Array]:
    """Numbers of disturbances for ``disturb``, and the values of courses without a formula.

    A profile of another kind than the classes above is called once for each timestep, in order.

    Args:
        disturbances: Disturbances.
        system: System with the names of bodies, inputs and states.
        sizes: Number of signals of each part, see ``widths``.
        steps: Numbers of the timesteps.
        timestep: [s].

    Returns:
        Numbers, (count, NUMBERS), and values, flat.

    Raises:
        ArgumentError: If a name is not among the system's, a profile gives a value that is not a
            finite number, a sine is too fast for the timestep, or a table does not fit to it.
    """
    starts = {}
    start = 0
    for part, size in sizes.items():
        starts[part] = start
        start += size

    numbers = np.zeros((len(disturbances), NUMBERS))
    values: list[float] = []
    for row, disturbance in zip(numbers, disturbances, strict=True):
        amplitudes = disturbance.amplitudes
        row[0] = starts[disturbance.part] + disturbance.place(system)
        row[1] = len(amplitudes)
        row[_COURSE:_AMPLITUDES] = _course_numbers(disturbance, steps, timestep, values)
        row[_AMPLITUDES : _AMPLITUDES + len(amplitudes)] = amplitudes
    return numbers, np.array(values)


def _course_numbers(
    disturbance: AnyDisturbance, steps: range, timestep: float, values: list[float]
) -> tuple[float, float, float, float]:
    """Kind of a disturbance's course, and its a, b and c; ``values`` grows by values it needs."""
    profile = disturbance.profile
    first = len(values)
    if isinstance(profile, Table):
        values += profile.values
        kind = PERIODIC_TABLE if profile.periodic else TABLE
        hold = steps_in(f"{disturbance.title}: hold", profile.hold, timestep)
        return kind, first, hold, len(profile.values)

    # A subclass may compute something else.
    if isinstance(profile, _Formula) and type(profile) in (Constant, Pulse, SineFrom):
        # A formula that is finite at both ends is so between them.
        _values(disturbance, np.array([steps[0], steps[-1]]) * timestep)
        _refuse_fast(disturbance, timestep)
        return profile.numbers

    values += _values(disturbance, np.array(steps) * timestep).tolist()
    return VALUES, first - steps.start, 0.0, 0.0


def _refuse_fast(disturbance: AnyDisturbance, timestep: float) -> None:
    """Refuse a sine with too few timesteps a period."""
    profile = disturbance.profile
    if not isinstance(profile, SineFrom) or profile.frequency == 0:
        return

    frequency = abs(profile.frequency)
    longest = 2 * math.pi / frequency / _STEPS_A_PERIOD
    if timestep > longest * (1 + 1e-9):
        raise ArgumentError(
            f"sine of the disturbance on {disturbance.of!r}: {frequency:.4g} rad/s has fewer "
            f"than {_STEPS_A_PERIOD} timesteps of {timestep:g} s a period: take a timestep of "
            f"{longest:.3g} s or less"
        )


def _values(disturbance: AnyDisturbance, time: Array) -> Array:
    """Values of a profile at these instants [s], all finite."""
    try:
        values = np.array([float(disturbance.profile(t)) for t in time.tolist()])
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            f"profile of the disturbance on {disturbance.of!r} must take t [s] and return "
            f"a number: {error}"
        ) from error
    if not np.all(np.isfinite(values)):
        bad = time[~np.isfinite(values)][0]
        raise ArgumentError(
            f"profile of the disturbance on {disturbance.of!r} is not finite at t = {bad:g} s"
        )
    return values
