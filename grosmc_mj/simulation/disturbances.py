"""Disturbances as values: a wrench on a body and its course in time."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from grosmc_mj.arguments import real, reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, shown, unknown_name
from grosmc_mj.simulation.profiles import pulse, sine_from

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
        if disturbance.body not in bodies:
            raise ArgumentError(unknown_name("body", disturbance.body, bodies))
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
