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

# Which formula: a number, so that it can lie beside the others in mjData.userdata.
CONSTANT, PULSE, SINE = 0.0, 1.0, 2.0

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


def is_known(profile: Profile) -> bool:
    """Whether compiled code knows a profile; a subclass may compute something else."""
    return type(profile) in (Constant, Pulse, SineFrom)


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


def wrench_table(
    disturbances: Sequence[Disturbance], bodies: Sequence[str], time: Array
) -> Array | None:
    """All wrenches at the given instants, (N, 6 * len(bodies)); None without disturbances.

    Raises:
        ArgumentError: If a body is not among ``bodies``, or a profile gives a value that is not
            a finite number.
    """
    if not disturbances:
        return None
    table = np.zeros((len(time), len(bodies), 6))
    for disturbance in disturbances:
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
        table[:, bodies.index(disturbance.body)] += values[:, None] * np.array(disturbance.wrench)
    return table.reshape(len(time), -1)
