"""The parts of a loop as built, as values: sensors, a computer, estimators, actuators.

Numbers have the units of what they are of; times are in seconds. A part that is left out is ideal.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from grosmc_mj.arguments import real, require, require_known
from grosmc_mj.errors import ArgumentError, shown

EstimatorLaw = Literal["difference", "filtered", "levant", "high-gain", "eso", "kalman"]
# The number that an estimator is tuned by.
TUNED_BY: dict[str, str] = {
    "filtered": "time_constant",
    "levant": "slope",
    "high-gain": "bandwidth",
    "eso": "bandwidth",
    "kalman": "load",
}


def _require(what: str, value: Any, *, positive: bool = False, signed: bool = False) -> None:
    """Refuse what is no finite number of this sign."""
    number = real(value)
    fine = math.isfinite(number) and (signed or number > 0 or (number == 0 and not positive))
    if not fine:
        must = "" if signed else " and positive" if positive else " and not negative"
        raise ArgumentError(f"{what} = {shown(value)} must be finite{must}")


def _require_name(value: Any) -> None:
    """Refuse what is no name."""
    if not (isinstance(value, str) and value):
        raise ArgumentError(f"of = {shown(value)} must be the name of a state or an input")


def _require_limit(what: str, value: Any) -> None:
    """Refuse what is no positive number; infinite for none."""
    if not real(value) > 0:
        raise ArgumentError(f"{what} = {shown(value)} must be positive")


@dataclass(frozen=True)
class Computing:
    """The computer between sensors and actuators.

    Attributes:
        delay: From a sample to its output [s]; a multiple of the timestep. Until the first
            output arrives the actuators are at rest.
        jitter: A sample is late by a whole number of timesteps, evenly from none up to this [s];
            a multiple of the timestep, shorter than the control period.
        missed: Share of the samples whose output comes too late and is thrown away: the last one
            is held. The law has been run all the same.
    """

    delay: float = 0.0
    jitter: float = 0.0
    missed: float = 0.0

    def __post_init__(self) -> None:
        _require("delay", self.delay)
        _require("jitter", self.jitter)
        if not 0 <= real(self.missed) < 1:
            raise ArgumentError(
                f"missed = {shown(self.missed)} must be a share of the samples, from 0 to below 1"
            )


@dataclass(frozen=True)
class Sensor:
    """What a state is measured by: y = q round((x + bias + drift t + noise) / q).

    Attributes:
        of: Name of the state.
        resolution: q, of an encoder; 0 for none.
        noise: Standard deviation of a sample.
        bias: Constant error.
        drift: Error that grows with time, per second.
        delay: Age of what is measured [s]; a multiple of the timestep.
        period: Time between two of its own samples, held in between [s], a multiple of the
            timestep; 0 for one at each sample of the law.
    """

    of: str
    resolution: float = 0.0
    noise: float = 0.0
    bias: float = 0.0
    drift: float = 0.0
    delay: float = 0.0
    period: float = 0.0

    def __post_init__(self) -> None:
        _require_name(self.of)
        for name in ("resolution", "noise", "delay", "period"):
            _require(name, getattr(self, name))
        for name in ("bias", "drift"):
            _require(name, getattr(self, name), signed=True)


@dataclass(frozen=True)
class Estimator:
    """What gives the law a state that is not measured.

    Attributes:
        of: Names of the states. Any for ``kalman``; for the others a rate, which they estimate
            from what the law sees of its position.
        law: ``difference`` of two samples; ``filtered``, the same through a lag; ``levant``, the
            robust exact differentiator in its implicit discretization; ``high-gain``, a critically
            damped observer of two integrators; ``eso``, the same of the design model with a
            constant disturbance; ``kalman``, the steady-state filter of the design model.
        time_constant: Of ``filtered`` [s].
        slope: Of ``levant``: bound of the rate's derivative, per second.
        bandwidth: Of ``high-gain`` and ``eso``: where all their poles are [rad/s].
        load: Of ``kalman``: standard deviation of an unknown input, constant in a sample, in the
            unit of the inputs.
        settled: Whether it has run long before the law is switched on, and so begins with the true
            value; else it begins with a rate of zero, and the law with what that is off by.
    """

    of: tuple[str, ...]
    law: EstimatorLaw = "difference"
    time_constant: float | None = None
    slope: float | None = None
    bandwidth: float | None = None
    load: float | None = None
    settled: bool = True

    def __post_init__(self) -> None:
        require("settled", self.settled, bool, "True or False")
        names = (self.of,) if isinstance(self.of, str) else self.of
        if not (isinstance(names, Sequence) and len(names)):
            raise ArgumentError(f"of = {shown(self.of)} must be names of states, at least one")
        for name in names:
            _require_name(name)
        if len(set(names)) < len(names):
            raise ArgumentError(f"of = {shown(self.of)} must name each state once")
        object.__setattr__(self, "of", tuple(names))
        require_known("estimator", self.law, get_args(EstimatorLaw))
        needed = TUNED_BY.get(self.law)
        for name in dict.fromkeys(TUNED_BY.values()):
            value = getattr(self, name)
            if name == needed and value is None:
                raise ArgumentError(f"{self.law} needs {name}")
            if name != needed and value is not None:
                has = f"it has {needed}" if needed else "it has no number"
                raise ArgumentError(f"{self.law} has no {name}: {has}")
            if value is not None:
                _require(name, value, positive=True)

    @property
    def number(self) -> float:
        """What it is tuned by; 0 for ``difference``."""
        return float(getattr(self, TUNED_BY[self.law])) if self.law in TUNED_BY else 0.0


@dataclass(frozen=True)
class Actuator:
    """What makes an input of what is asked for, in this order.

    Attributes:
        of: Name of the input.
        delay: [s]; a multiple of the timestep.
        resolution: Of what it is told; 0 for none.
        limit: Largest |u|.
        rate_limit: Largest change per second.
        lag: Time constant [s], discretized exactly: the plant gets the mean over each timestep.
        order: 1, or 2 for two equal lags in a row.
        dead_zone: |u| up to which nothing comes out; what is beyond it, less it.
    """

    of: str
    delay: float = 0.0
    resolution: float = 0.0
    limit: float = math.inf
    rate_limit: float = math.inf
    lag: float = 0.0
    order: int = 1
    dead_zone: float = 0.0

    def __post_init__(self) -> None:
        _require_name(self.of)
        for name in ("delay", "resolution", "lag", "dead_zone"):
            _require(name, getattr(self, name))
        for name in ("limit", "rate_limit"):
            _require_limit(name, getattr(self, name))
        if real(self.order) not in (1, 2):
            raise ArgumentError(f"order = {shown(self.order)} must be 1 or 2")
