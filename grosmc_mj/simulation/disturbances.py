"""Disturbances as values: a wrench on a body and its course in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from grosmc_mj.arguments import real, reals, require, require_known
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.jitable import jitable

# Which course in time: by one of the formulas below, or by its values at all timesteps.
CONSTANT, PULSE, SINE, VALUES = 0.0, 1.0, 2.0, 3.0
# A disturbance as numbers is [body, course, a, b, c, force, torque].
PUSH = 11

# An instant counts as reached when it is this close [s]: k times h is not exact in binary.
_INSTANT = 1e-9


@jitable
def pulse(t: float, start: float, stop: float) -> float:
    """1 for start <= t < stop [s], else 0."""
    return 1.0 if start - _INSTANT <= t < stop - _INSTANT else 0.0


@jitable
def sine_from(t: float, frequency: float, onset: float, phase: float) -> float:
    """sin(frequency t + phase) for t >= onset, else 0; in rad/s, s and rad."""
    if t < onset - _INSTANT:
        return 0.0
    return math.sin(frequency * t + phase)


@jitable
def course(kind: float, t: float, a: float, b: float, c: float) -> float:
    """The value at t [s] of the formula of this kind with its numbers, in their order above."""
    if kind == PULSE:
        return pulse(t, a, b)
    if kind == SINE:
        return sine_from(t, a, b, c)
    return 1.0


@jitable
def push(pushes: Array, values: Array, step: int, t: float, wrenches: Array) -> None:
    """Write the wrenches of disturbances at t [s].

    Args:
        pushes: The disturbances as numbers, (count, PUSH), see ``packed``.
        values: Courses that are known by their values, (count, steps).
        step: The timestep that begins at t.
        t: [s].
        wrenches: Of each body, flat, (6 * bodies,).
    """
    for i in range(len(wrenches)):
        wrenches[i] = 0.0
    for k in range(len(pushes)):
        kind, a, b, c = pushes[k, 1], pushes[k, 2], pushes[k, 3], pushes[k, 4]
        value = values[int(a), step] if kind == VALUES else course(kind, t, a, b, c)
        at = 6 * int(pushes[k, 0])
        for i in range(6):
            wrenches[at + i] += value * pushes[k, 5 + i]


Profile = Callable[[float], float]


@dataclass(frozen=True)
class Constant:
    """1 at all times."""

    def __call__(self, t: float) -> float:
        """The value at t [s]."""
        return 1.0


@dataclass(frozen=True)
class Pulse:
    """1 for start <= t < stop [s], else 0."""

    start: float
    stop: float

    def __post_init__(self) -> None:
        if not real(self.start) < real(self.stop):
            raise ArgumentError(
                f"pulse from {shown(self.start)} to {shown(self.stop)} s never acts"
            )

    def __call__(self, t: float) -> float:
        """The value at t [s]."""
        return pulse(t, self.start, self.stop)


@dataclass(frozen=True)
class SineFrom:
    """sin(frequency t + phase) from ``onset`` on, 0 before; t counts from the run's start.

    Attributes:
        frequency: [rad/s].
        onset: [s].
        phase: [rad].
    """

    frequency: float
    onset: float = 0.0
    phase: float = 0.0

    def __post_init__(self) -> None:
        if not all(math.isfinite(real(x)) for x in (self.frequency, self.onset, self.phase)):
            raise ArgumentError(f"{shown(self)} must have finite frequency, onset and phase")

    def __call__(self, t: float) -> float:
        """The value at t [s]."""
        return sine_from(t, self.frequency, self.onset, self.phase)


@dataclass(frozen=True)
class Disturbance:
    """A wrench on a body, times a profile of t.

    It reaches physics through ``xfrc_applied``: at the body's centre of mass, in world axes,
    sampled at the start of each timestep and held through it.

    Attributes:
        body: Name of the body.
        wrench: [force, torque] in N and N m, (6,).
        profile: Any function of t [s]; 1 by default.
        label: What it is called in figures.
    """

    body: str
    wrench: tuple[float, float, float, float, float, float]
    profile: Profile = field(default_factory=Constant)
    label: str = ""

    def __post_init__(self) -> None:
        require("body", self.body, str, "the name of a body")
        wrench = reals(self.wrench)
        if wrench.shape != (6,) or not np.all(np.isfinite(wrench)):
            raise ArgumentError(
                f"wrench on {self.body!r} is {shown(self.wrench)}, must be six finite numbers "
                "[force, torque]"
            )

        if not callable(self.profile):
            raise ArgumentError(
                f"profile of the disturbance on {self.body!r} must take t [s] and return a number, "
                f"is {shown(self.profile)}"
            )

    @property
    def window(self) -> tuple[float, float]:
        """First and last instant at which it may act [s]; the last one may be infinite."""
        if isinstance(self.profile, Pulse):
            return (self.profile.start, self.profile.stop)
        return (getattr(self.profile, "onset", 0.0), math.inf)


def packed(
    disturbances: Sequence[Disturbance], bodies: Sequence[str], steps: range, timestep: float
) -> tuple[Array, Array]:
    """Disturbances as numbers, and their courses that no formula gives, as ``push`` takes them.

    A profile of another kind than the classes above is asked once for each timestep, in order.

    Args:
        disturbances: On these bodies.
        bodies: The system's.
        steps: Which timesteps.
        timestep: [s].

    Returns:
        (count, PUSH) and (count, steps).

    Raises:
        ArgumentError: If a body is not among ``bodies``, or a profile gives a value that is not
            a finite number.
    """
    pushes, values = np.zeros((len(disturbances), PUSH)), list[Array]()
    for row, each in zip(pushes, disturbances, strict=True):
        profile = each.profile
        # A subclass may compute something else.
        formula = type(profile) in (Constant, Pulse, SineFrom)
        if formula and isinstance(profile, Pulse):
            numbers = PULSE, profile.start, profile.stop, 0.0
        elif formula and isinstance(profile, SineFrom):
            numbers = SINE, profile.frequency, profile.onset, profile.phase
        else:
            numbers = (CONSTANT if formula else VALUES), len(values), 0.0, 0.0
        # A formula that is finite at both ends is so between them.
        asked = (steps[0], steps[-1]) if formula else steps
        found = _course(each, bodies, np.array(asked) * timestep)
        if not formula:
            values.append(found)
        row[:] = bodies.index(each.body), *numbers, *each.wrench
    return pushes, np.array(values).reshape(len(values), len(steps))


def _course(disturbance: Disturbance, bodies: Sequence[str], time: Array) -> Array:
    """The values of a profile, all finite, on one of the bodies."""
    if not bodies:
        raise ArgumentError("the plant has no bodies that a disturbance could act on")
    require_known("body", disturbance.body, bodies)
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
