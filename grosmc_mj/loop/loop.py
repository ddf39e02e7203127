"""All that lies between a law and its plant, as one value."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, fields, replace
from typing import Annotated, Any

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError, Mistakes, unknown_name
from grosmc_mj.fields import Items, Range, checked
from grosmc_mj.loop.actuators import Actuator
from grosmc_mj.loop.delay import Computing
from grosmc_mj.loop.estimators import Estimator
from grosmc_mj.loop.sensors import Sensor
from grosmc_mj.loop.timing import MOST_STEPS, TIMES, steps_in, time_as_run
from grosmc_mj.plants import System

LARGEST_SEED = 2**53

Part = Computing | Sensor | Estimator | Actuator
# What it may have several of.
_LISTS: Mapping[str, type[Any]] = {"sensor": Sensor, "estimator": Estimator, "actuator": Actuator}
_KINDS = ("computing", *_LISTS)


@checked()
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
    sensors: Annotated[tuple[Sensor, ...], Items(Sensor, "a tuple of Sensors")] = ()
    estimators: Annotated[tuple[Estimator, ...], Items(Estimator, "a tuple of Estimators")] = ()
    actuators: Annotated[tuple[Actuator, ...], Items(Actuator, "a tuple of Actuators")] = ()
    seed: Annotated[int, Range(0, LARGEST_SEED, below=True, whole=True)] = 0

    @property
    def parts(self) -> Iterator[tuple[str, Part]]:
        """Every part, with its kind."""
        yield "computing", self.computing
        for kind in _LISTS:
            for part in getattr(self, f"{kind}s"):
                yield kind, part

    @property
    def random(self) -> bool:
        """Whether anything in it is drawn at random."""
        drawn = self.computing.jitter or self.computing.missed
        return bool(drawn or any(sensor.noise for sensor in self.sensors))

    @property
    def not_known_exactly(self) -> set[str]:
        """Names of the states that are estimated, or measured otherwise than they are."""
        measured = {each.of for each in self.sensors if each != Sensor(each.of)}
        return measured | {name for each in self.estimators for name in each.of}

    def part(self, kind: str, of: str) -> Any:
        """One of its parts.

        Args:
            kind: ``computing``, ``sensor``, ``estimator`` or ``actuator``.
            of: Of which state or input; of ``computing`` anything.

        Raises:
            ArgumentError: If there is no such part.
        """
        require_known("part", kind, _KINDS)
        if kind == "computing":
            return self.computing
        parts: Sequence[Any] = getattr(self, f"{kind}s")
        for part in parts:
            if of in _names(part):
                return part
        known = [name for part in parts for name in _names(part)]
        raise ArgumentError(unknown_name(kind, of, known) if known else f"there is no [[{kind}]]")

    def changed(self, kind: str, of: str, **numbers: Any) -> Loop:
        """The same loop with other numbers of one of its parts.

        Args:
            kind: As of ``part``.
            of: As of ``part``.
            numbers: What is different.

        Raises:
            ArgumentError: If there is no such part, or a number does not fit.
        """
        old = self.part(kind, of)
        valid = [each.name for each in fields(old) if each.name != "of"]
        for name in numbers:
            require_known(f"number of a {kind} part", name, valid)
        new = replace(old, **numbers)
        if kind == "computing":
            return replace(self, computing=new)
        parts: Sequence[Any] = getattr(self, f"{kind}s")
        made = tuple(new if part is old else part for part in parts)
        return replace(self, **{f"{kind}s": made})

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
            names = [name for part in parts for name in _names(part)]
            what = "input" if kind == "actuator" else "state"
            for name in dict.fromkeys(names):
                if name not in valid:
                    mistakes.note(f"{kind}: {unknown_name(what, name, valid)}")
                elif names.count(name) > 1:
                    article = "an" if what == "input" else "a"
                    mistakes.note(f"two {kind}s of {name!r}: {article} {what} has one")
        for kind, part in self.parts:
            said = f"{kind} of {', '.join(_names(part))}" if kind in _LISTS else kind
            for item in fields(part):
                if item.name in TIMES:
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

    def rounded(self, timestep: float, control_period: float = math.inf) -> Loop:
        """The same with all times on the timestep's grid, the nearest; jitter within a period."""
        found = self
        for kind, part in self.parts:
            near = {
                each.name: time_as_run(
                    each.name, getattr(part, each.name), timestep, control_period
                )
                for each in fields(part)
                if each.name in TIMES
            }
            if near:
                found = found.changed(kind, getattr(part, "of", ""), **near)
        return found


def _names(part: Any) -> tuple[str, ...]:
    """What a part is of."""
    return (part.of,) if isinstance(part.of, str) else part.of
