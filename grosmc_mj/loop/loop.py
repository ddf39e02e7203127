"""All that lies between a law and its plant, as one value."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import field, replace
from typing import Annotated, Any, get_args, get_type_hints

from grosmc_mj.errors import ArgumentError, Mistakes, unknown_name
from grosmc_mj.fields import Items, Range, checked
from grosmc_mj.loop.actuators import Actuator
from grosmc_mj.loop.delay import Computing
from grosmc_mj.loop.estimators import TUNED_BY, Estimator
from grosmc_mj.loop.sensors import Sensor
from grosmc_mj.loop.timing import MOST_STEPS, TIMES, steps_in, time_as_run
from grosmc_mj.plants import System

LARGEST_SEED = 2**53

Part = Computing | Sensor | Estimator | Actuator
# Kinds of parts of which a loop may have several, in ``sensors`` and so on.
_LISTS = ("sensor", "estimator", "actuator")


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
    def parts(self) -> list[tuple[str, Part]]:
        """Every part, with its kind."""
        lists = ((kind, part) for kind in _LISTS for part in getattr(self, f"{kind}s"))
        return [("computing", self.computing), *lists]

    @property
    def random(self) -> bool:
        """Whether anything in it is drawn at random."""
        drawn = self.computing.jitter or self.computing.missed
        return bool(drawn or any(sensor.noise for sensor in self.sensors))

    @property
    def not_known_exactly(self) -> set[str]:
        """Names of the states that are estimated, or measured otherwise than they are."""
        measured = {sensor.of for sensor in self.sensors if sensor != Sensor(sensor.of)}
        return measured.union(*(part.of for part in self.estimators))

    def part(self, kind: str, of: str) -> Any:
        """One of its parts.

        Args:
            kind: ``computing``, ``sensor``, ``estimator`` or ``actuator``.
            of: Of which state or input; of ``computing`` anything.

        Raises:
            ArgumentError: If there is no such part.
        """
        if kind == "computing":
            return self.computing
        parts = {name: part for own, part in self.parts if own == kind for name in _names(part)}
        if of not in parts:
            none = f"there is no [[{kind}]]"
            raise ArgumentError(unknown_name(kind, of, parts) if parts else none)
        return parts[of]

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
        new = replace(old, **numbers)
        if kind == "computing":
            return replace(self, computing=new)
        parts = [new if part is old else part for part in getattr(self, f"{kind}s")]
        return replace(self, **{f"{kind}s": parts})

    def require_fits(self, system: System, timestep: float, control_period: float) -> None:
        """Refuse parts of what the system has not, twice of one thing, or off the timestep's grid.

        Args:
            system: The plant's.
            timestep: Of the physics [s].
            control_period: Of the law [s].

        Raises:
            ArgumentError: All that is wrong.
        """
        mistakes, jitter = Mistakes(), self.computing.jitter
        for kind in _LISTS:
            noun = "input" if kind == "actuator" else "state"
            valid = [signal.name for signal in getattr(system, f"{noun}s")]
            parts = (part for own, part in self.parts if own == kind)
            for name, count in Counter(name for part in parts for name in _names(part)).items():
                if name not in valid:
                    mistakes.note(f"{kind}: {unknown_name(noun, name, valid)}")
                elif count > 1:
                    mistakes.note(f"{count} {kind}s of {name!r}: give one")
        for kind, part in self.parts:
            label = " of ".join(filter(None, (kind, ", ".join(_names(part)))))
            for name in TIMES:
                with mistakes.gathered(f"{label}: "):
                    steps_in(name, getattr(part, name, 0.0), timestep)
        mistakes.note(
            *(
                f"actuator of {part.of}: lag = {part.lag:g} s is more than {MOST_STEPS} timesteps "
                f"of {timestep:g} s"
                for part in self.actuators
                if part.lag * part.order > MOST_STEPS * timestep
            )
        )
        if jitter and not jitter < control_period * (1 - 1e-9):
            mistakes.note(
                f"computing: jitter = {jitter:g} s must be shorter than the control period "
                f"{control_period:g} s"
            )
        mistakes.refuse()

    def rounded(self, timestep: float, control_period: float = math.inf) -> Loop:
        """The same with all times on the timestep's grid, the nearest; jitter within a period."""
        rounded = self
        for kind, part in self.parts:
            times = {name: getattr(part, name) for name in TIMES if hasattr(part, name)}
            near = {
                name: time_as_run(name, time, timestep, control_period)
                for name, time in times.items()
            }
            rounded = rounded.changed(kind, next(iter(_names(part)), ""), **near)
        return rounded

    def words(self, system: System) -> list[str]:
        """What is between a law and its plant, a line for each part that is not ideal.

        Args:
            system: Whose states and inputs give the units.
        """
        states, inputs = ({s.name: s.unit for s in g} for g in (system.states, system.inputs))
        lines = []
        for kind, part in self.parts:
            units = inputs if kind == "actuator" else states
            unit = "".join(units[name] for name in _names(part)[:1])
            lines.append((", ".join(_names(part)) or "computer", ", ".join(_words(part, unit))))
        return [f"{name}: {words}" for name, words in lines if words]


def _names(part: Part) -> tuple[str, ...]:
    """States or inputs that a part is of; none of the computer."""
    of = getattr(part, "of", ())
    return (of,) if isinstance(of, str) else of


def _words(part: Part, unit: str) -> Iterator[str]:
    """The words of each number that is not ideal, which stand beside its bounds."""
    if isinstance(part, Estimator):
        by = TUNED_BY.get(part.law, "").replace("_", " ")
        tuned = f" with {by} {part.number:.4g}" if by else ""
        yield f"estimated by {part.law}{tuned}" + ("" if part.settled else ", from rest")
    lags = "two lags" if getattr(part, "order", 1) == 2 else "a lag"
    for name, hint in get_type_hints(type(part), include_extras=True).items():
        words = next((note for note in get_args(hint)[1:] if isinstance(note, str)), "")
        value = getattr(part, name)
        if words and value != getattr(type(part), name) and math.isfinite(value):
            yield words.format(
                value=value, unit=unit, ms=1e3 * value, percent=100 * value, lags=lags
            )
