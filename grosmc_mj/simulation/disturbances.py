"""Disturbances as values: a wrench on a body and its course in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, unknown_name, value_text
from grosmc_mj.fields import Finite, Is, Numbers, Range, checked
from grosmc_mj.jitable import jitable

# Kinds of courses in time: one of the formulas below, or values at all timesteps.
CONSTANT = 0.0
PULSE = 1.0
SINE = 2.0
VALUES = 3.0
# Numbers of a disturbance: body, course, a, b, c, force (3), torque (3).
PUSH = 11

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
def push(
    pushes: Array,
    values: Array,
    step: int,
    t: float,
    h: float,
    wrenches: Array,
) -> None:
    """Write the wrenches of disturbances that are held through a timestep.

    Args:
        pushes: Numbers of the disturbances, (count, PUSH), see ``packed``.
        values: Values of courses without a formula, (count, steps).
        step: Number of the timestep.
        t: Its begin [s].
        h: Its length [s].
        wrenches: Wrench on each body, flat, (6 * bodies,).
    """
    for i in range(len(wrenches)):
        wrenches[i] = 0.0
    for k in range(len(pushes)):
        kind = pushes[k, 1]
        a = pushes[k, 2]
        if kind == VALUES:
            value = values[int(a), step]
        else:
            value = course(kind, t, a, pushes[k, 3], pushes[k, 4], h)
        first = 6 * int(pushes[k, 0])
        for i in range(6):
            wrenches[first + i] += value * pushes[k, 5 + i]


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
    """1 for start <= t < stop [s], else 0."""

    start: Annotated[float, Range(unit="s", infinite=True)]
    stop: Annotated[float, Range(unit="s", infinite=True)]

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
        frequency: [rad/s].
        onset: [s].
        phase: [rad].
    """

    frequency: Finite
    onset: Finite = 0.0
    phase: Finite = 0.0

    @property
    def numbers(self) -> tuple[float, float, float, float]:
        """Kind, frequency, onset, phase."""
        return SINE, self.frequency, self.onset, self.phase


@checked(label="disturbance")
class Disturbance:
    """A wrench on a body, times a profile of t.

    It reaches physics through ``xfrc_applied``: at the body's centre of mass, in world axes,
    sampled at the start of each timestep and held through it. A pulse that begins or ends between
    two timesteps counts with its share of the one around that instant.

    Attributes:
        body: Name of the body.
        wrench: [force, torque] in N and N m, (6,).
        profile: Function of t [s]; 1 by default.
        label: Name in figures.
    """

    body: Annotated[str, Is(str, "the name of a body")]
    wrench: Annotated[tuple[float, float, float, float, float, float], Numbers(6)]
    profile: Annotated[Profile, Is(Callable, "a function of t [s] that returns a number")] = (
        Constant()
    )
    label: str = ""

    @property
    def window(self) -> tuple[float, float]:
        """First and last instant at which it may act [s]; the last one may be infinite."""
        if isinstance(self.profile, Pulse):
            return (self.profile.start, self.profile.stop)
        return (getattr(self.profile, "onset", 0.0), math.inf)


def packed(
    disturbances: Sequence[Disturbance],
    bodies: Sequence[str],
    steps: range,
    timestep: float,
) -> tuple[Array, Array]:
    """Numbers of disturbances for ``push``, and the values of courses without a formula.

    A profile of another kind than the classes above is called once for each timestep, in order.

    Args:
        disturbances: Disturbances.
        bodies: Names of the system's bodies.
        steps: Numbers of the timesteps.
        timestep: [s].

    Returns:
        Numbers, (count, PUSH), and values, (count, steps).

    Raises:
        ArgumentError: If a body is not among ``bodies``, a profile gives a value that is not a
            finite number, or a sine is too fast for the timestep.
    """
    pushes = np.zeros((len(disturbances), PUSH))
    values: list[Array] = []
    for row, disturbance in zip(pushes, disturbances, strict=True):
        body = disturbance.body
        profile = disturbance.profile
        if body not in bodies:
            raise ArgumentError(unknown_name("body", body, bodies))
        # A subclass may compute something else.
        if isinstance(profile, _Formula) and type(profile) in (Constant, Pulse, SineFrom):
            # A formula that is finite at both ends is so between them.
            _values(disturbance, np.array([steps[0], steps[-1]]) * timestep)
            _refuse_fast(disturbance, timestep)
            numbers = profile.numbers
        else:
            numbers = VALUES, len(values), 0.0, 0.0
            values.append(_values(disturbance, np.array(steps) * timestep))
        row[:] = bodies.index(body), *numbers, *disturbance.wrench
    return pushes, np.array(values).reshape(len(values), len(steps))


def _refuse_fast(disturbance: Disturbance, timestep: float) -> None:
    """Refuse a sine with too few timesteps a period."""
    profile = disturbance.profile
    if not isinstance(profile, SineFrom) or profile.frequency == 0:
        return

    frequency = abs(profile.frequency)
    longest = 2 * math.pi / frequency / _STEPS_A_PERIOD
    if timestep > longest * (1 + 1e-9):
        raise ArgumentError(
            f"sine of the disturbance on {disturbance.body!r}: {frequency:.4g} rad/s has fewer "
            f"than {_STEPS_A_PERIOD} timesteps of {timestep:g} s a period: take a timestep of "
            f"{longest:.3g} s or less"
        )


def _values(disturbance: Disturbance, time: Array) -> Array:
    """Values of a profile at these instants [s], all finite."""
    try:
        values = np.array([float(disturbance.profile(t)) for t in time.tolist()])
    except (TypeError, ValueError) as error:
        raise ArgumentError(
            f"profile of the disturbance on {disturbance.body!r} must take t [s] and return "
            f"a number: {error}"
        ) from error
    if not np.all(np.isfinite(values)):
        bad = time[~np.isfinite(values)][0]
        raise ArgumentError(
            f"profile of the disturbance on {disturbance.body!r} is not finite at t = {bad:g} s"
        )
    return values
