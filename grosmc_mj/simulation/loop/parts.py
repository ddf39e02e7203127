"""The parts of a loop as built, as values: sensors, a computer, estimators, actuators.

Numbers have the units of what they are of; times are in seconds. A part that is left out is ideal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, get_args

from grosmc_mj.arguments import real, require, require_each
from grosmc_mj.errors import ArgumentError, Mistakes, shown, unknown_name
from grosmc_mj.plants import System

EstimatorLaw = Literal["difference", "filtered", "levant", "high-gain", "eso", "kalman"]
# The number that an estimator is tuned by, with what is appended to the unit of the rate.
TUNED_BY: dict[str, str] = {
    "filtered": "time_constant",
    "levant": "slope",
    "high-gain": "bandwidth",
    "eso": "bandwidth",
    "kalman": "load",
}
# Beyond this many timesteps a delay is a slip of the unit.
MOST_STEPS = 100_000
LARGEST_SEED = 2**53


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
        if not (isinstance(names, Sequence) and names):
            raise ArgumentError(f"of = {shown(self.of)} must be names of states, at least one")
        for name in names:
            _require_name(name)
        object.__setattr__(self, "of", tuple(names))
        if self.law not in get_args(EstimatorLaw):
            raise ArgumentError(unknown_name("estimator", self.law, get_args(EstimatorLaw)))
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
        if self.order not in (1, 2) or isinstance(self.order, bool):
            raise ArgumentError(f"order = {shown(self.order)} must be 1 or 2")


Part = Computing | Sensor | Estimator | Actuator


@dataclass(frozen=True)
class Loop:
    """All that lies between a law and its plant.

    Attributes:
        computing: The computer.
        sensors: At most one of a state; a state without one is known exactly.
        estimators: At most one of a state.
        actuators: At most one of an input.
        seed: Of noise, jitter and missed samples.
    """

    computing: Computing = field(default_factory=Computing)
    sensors: tuple[Sensor, ...] = ()
    estimators: tuple[Estimator, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    seed: int = 0

    def __post_init__(self) -> None:
        for name, kind in (
            ("sensors", Sensor),
            ("estimators", Estimator),
            ("actuators", Actuator),
        ):
            require_each(name, getattr(self, name), kind, f"a tuple of {kind.__name__}s")
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not isinstance(self.computing, Computing):
            raise ArgumentError(f"computing = {shown(self.computing)} must be a Computing")
        whole = isinstance(self.seed, int) and not isinstance(self.seed, bool)
        if not (whole and 0 <= self.seed < LARGEST_SEED):
            raise ArgumentError(
                f"seed = {shown(self.seed)} must be a whole number from 0 to below 2^53"
            )

    @property
    def parts(self) -> Iterator[tuple[str, Part]]:
        """Every part, with what it is in words."""
        yield "computing", self.computing
        for kind, parts in (
            ("sensor", self.sensors),
            ("estimator", self.estimators),
            ("actuator", self.actuators),
        ):
            for part in parts:
                named = part.of if isinstance(part.of, str) else ", ".join(part.of)
                yield f"{kind} of {named}", part

    @property
    def random(self) -> bool:
        """Whether anything in it is drawn at random."""
        drawn = self.computing.jitter or self.computing.missed
        return bool(drawn or any(sensor.noise for sensor in self.sensors))

    def changed(self, kind: str, of: str, **numbers: Any) -> Loop:
        """The same loop with other numbers of one of its parts.

        Args:
            kind: ``computing``, ``sensor``, ``estimator`` or ``actuator``.
            of: Of which state or input; of ``computing`` anything.
            numbers: What is different.

        Raises:
            ArgumentError: If there is no such part, or a number does not fit.
        """
        kinds: dict[str, type] = {
            "computing": Computing,
            "sensor": Sensor,
            "estimator": Estimator,
            "actuator": Actuator,
        }
        if kind not in kinds:
            raise ArgumentError(unknown_name("part", kind, kinds))
        valid = [each.name for each in fields(kinds[kind]) if each.name != "of"]
        for name in numbers:
            if name not in valid:
                raise ArgumentError(unknown_name(f"number of a {kind} part", name, valid))
        if kind == "computing":
            return replace(self, computing=replace(self.computing, **numbers))
        found, known = False, []
        changed: list[Any] = []
        parts: Sequence[Any] = getattr(self, f"{kind}s")
        for part in parts:
            known += [part.of] if isinstance(part.of, str) else part.of
            own = of == part.of or (not isinstance(part.of, str) and of in part.of)
            found = found or own
            changed.append(replace(part, **numbers) if own else part)
        if not found:
            said = unknown_name(kind, of, known) if known else f"there is no [[{kind}]]"
            raise ArgumentError(said)
        return replace(self, **{f"{kind}s": tuple(changed)})

    def require_fits(self, system: System, timestep: float, control_period: float) -> None:
        """Refuse parts of what the system has not, twice of one thing, or off the timestep's grid.

        Args:
            system: The plant's.
            timestep: Of the physics [s].
            control_period: Of the law [s].

        Raises:
            ArgumentError: All that is wrong.
        """
        mistakes = Mistakes()
        states, inputs = ([each.name for each in group] for group in (system.states, system.inputs))
        for kind, valid in (("sensor", states), ("estimator", states), ("actuator", inputs)):
            parts: Sequence[Any] = getattr(self, f"{kind}s")
            names = [
                name
                for part in parts
                for name in ((part.of,) if isinstance(part.of, str) else part.of)
            ]
            what = "input" if kind == "actuator" else "state"
            for name in dict.fromkeys(names):
                if name not in valid:
                    mistakes.note(f"{kind}: {unknown_name(what, name, valid)}")
                elif names.count(name) > 1:
                    article = "an" if what == "input" else "a"
                    mistakes.note(f"two {kind}s of {name!r}: {article} {what} has one")
        for said, part in self.parts:
            for item in fields(part):
                if item.name in ("delay", "jitter", "period"):
                    with mistakes.gathered(f"{said}: "):
                        steps_in(item.name, getattr(part, item.name), timestep)
        for actuator in self.actuators:
            if actuator.lag * actuator.order > MOST_STEPS * timestep:
                mistakes.note(
                    f"actuator of {actuator.of}: lag = {actuator.lag:g} s is more than "
                    f"{MOST_STEPS} timesteps of {timestep:g} s"
                )
        if self.computing.jitter and not self.computing.jitter < control_period * (1 - 1e-9):
            mistakes.note(
                f"computing: jitter = {self.computing.jitter:g} s must be shorter than the control "
                f"period {control_period:g} s"
            )
        mistakes.refuse()

    def rounded(self, timestep: float) -> Loop:
        """The same with all times on the timestep's grid, the nearest."""
        found = self
        for kind, parts in (
            ("computing", (self.computing,)),
            ("sensor", self.sensors),
            ("actuator", self.actuators),
        ):
            for part in parts:
                times = [each.name for each in fields(part)]
                times = [name for name in times if name in ("delay", "jitter", "period")]
                near = {name: round(getattr(part, name) / timestep) * timestep for name in times}
                found = found.changed(kind, getattr(part, "of", ""), **near)
        return found


def steps_in(what: str, seconds: float, timestep: float) -> int:
    """A time as a number of timesteps.

    Raises:
        ArgumentError: If it is none.
    """
    steps = round(seconds / timestep)
    if not math.isclose(steps * timestep, seconds, rel_tol=1e-9, abs_tol=1e-15):
        near = f"{steps * timestep:g} s" if steps else f"{timestep:g} s"
        raise ArgumentError(
            f"{what} = {seconds:g} s is no multiple of the timestep {timestep:g} s: take {near}, "
            "or a shorter timestep"
        )
    if steps > MOST_STEPS:
        raise ArgumentError(
            f"{what} = {seconds:g} s is {steps} timesteps of {timestep:g} s: at most {MOST_STEPS}"
        )
    return steps
