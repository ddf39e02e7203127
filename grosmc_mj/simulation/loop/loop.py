"""The loop as a value: sensors, computer, estimators and actuators between law and plant."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import field, replace
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, Mistakes, unknown_name
from grosmc_mj.ground.fields import Items, Range, checked, range_of
from grosmc_mj.ground.wording import spelled, unit_after
from grosmc_mj.simulation.loop.actuators import Actuator
from grosmc_mj.simulation.loop.computer import Computing
from grosmc_mj.simulation.loop.counter import uniform
from grosmc_mj.simulation.loop.estimators import TUNED_BY, Estimator
from grosmc_mj.simulation.loop.sensors import Sensor
from grosmc_mj.simulation.loop.timing import MOST_STEPS, TIMES, steps_in
from grosmc_mj.theory.plants import Plant, System

LARGEST_SEED = 2**53

Part = Computing | Sensor | Estimator | Actuator
# Numbers of parts by which runs draw random numbers.
RANDOM = ("noise", "jitter", "missed")
# First of the random signals that set the phases of encoders; noise and timing have those below.
_PHASES = 128
# Kinds of parts of which a loop may have several, in ``sensors`` and so on.
_LISTS = ("sensor", "estimator", "actuator")


@checked()
class Loop:
    """Sensors, computer, estimators and actuators between a law and its plant.

    Attributes:
        computing: Computer.
        sensors: Sensors, at most one of a state; a state without one is known exactly, but for the
            rate of a measured position.
        estimators: Estimators, at most one of a state; a rate without sensor and estimator whose
            position has a sensor is differenced.
        actuators: Actuators, at most one of an input.
        seed: Seed of noise, jitter and missed samples.
    """

    computing: Computing = field(default_factory=Computing)
    sensors: Annotated[tuple[Sensor, ...], Items(Sensor, "a tuple of Sensors")] = ()
    estimators: Annotated[tuple[Estimator, ...], Items(Estimator, "a tuple of Estimators")] = ()
    actuators: Annotated[tuple[Actuator, ...], Items(Actuator, "a tuple of Actuators")] = ()
    seed: Annotated[int, Range(0, LARGEST_SEED, below=True, whole=True)] = 0

    @property
    def parts(self) -> list[tuple[str, Part]]:
        """Every part, with its kind."""
        parts: list[tuple[str, Part]] = [("computing", self.computing)]
        for kind in _LISTS:
            parts += [(kind, part) for part in getattr(self, f"{kind}s")]
        return parts

    @property
    def random(self) -> bool:
        """Whether anything in it is drawn at random."""
        return any(getattr(part, name, 0.0) for _, part in self.parts for name in RANDOM)

    @property
    def drawn(self) -> bool:
        """Whether its runs differ by draws: something is random, or an encoder has steps."""
        return self.random or any(sensor.resolution for sensor in self.sensors)

    def draw(self, number: int) -> Loop:
        """Return the loop of a draw: draw 0 is the loop itself, another one has other phases.

        Args:
            number: Number of the draw; it is also the number of the run for what is random.
        """
        if number == 0:
            return self
        sensors = []
        for index, sensor in enumerate(self.sensors):
            if sensor.resolution:
                phase = uniform(self.seed, number, _PHASES + index, 0) - 0.5
                sensor = replace(sensor, phase=phase)
            sensors.append(sensor)
        return replace(self, sensors=tuple(sensors))

    @property
    def not_known_exactly(self) -> set[str]:
        """Names of the states that are estimated, or measured otherwise than they are."""
        measured = {sensor.of for sensor in self.sensors if not sensor.ideal}
        return measured.union(*(part.of for part in self.estimators))

    def completed(self, system: System) -> Loop:
        """Copy in which every rate of a measured position is measured or estimated.

        A computer with a position sensor alone has its differences: what is neither measured nor
        estimated is the difference of two samples. A ``Sensor(rate, exact=True)`` asks for the rate
        itself.

        Args:
            system: System of the plant.
        """
        measured = {sensor.of for sensor in self.sensors if not sensor.exact}
        given = {sensor.of for sensor in self.sensors}.union(*(part.of for part in self.estimators))
        names = [state.name for state in system.states]
        differenced = [
            names[rate]
            for rate, position in system.rate_positions.items()
            if names[position] in measured and names[rate] not in given
        ]
        if not differenced:
            return self
        return replace(self, estimators=(*self.estimators, Estimator(tuple(differenced))))

    def input_limits(self, plant: Plant) -> Array:
        """Least and largest of each input that actuators and plant give, (2, m).

        Args:
            plant: Plant, with limits of its own.
        """
        limits = np.array(plant.input_limits, float)
        for column, actuator in self.actuated(plant.system):
            limits[:, column] = np.clip(limits[:, column], -actuator.limit, actuator.limit)
        return limits

    def command_limits(self, plant: Plant) -> Array:
        """Least and largest of each command that is not cut off, (2, m).

        An actuator limits the command times its gain, so the command's limits are those of the
        input over the gain; they are infinite for a gain of 0.

        Args:
            plant: Plant, with limits of its own.
        """
        limits = self.input_limits(plant)
        for column, actuator in self.actuated(plant.system):
            if actuator.gain == 0:
                limits[:, column] = -math.inf, math.inf
            else:
                limits[:, column] = np.sort(limits[:, column] / actuator.gain)
        return limits

    def actuated(self, system: System) -> Iterator[tuple[int, Actuator]]:
        """Yield the actuators of a system's inputs, each with the number of its input."""
        names = [signal.name for signal in system.inputs]
        for actuator in self.actuators:
            # Another name is refused with the rest of the loop, by ``require_fits``.
            if actuator.of in names:
                yield names.index(actuator.of), actuator

    def exact_rates(self, system: System) -> list[str]:
        """Names of the rates that are known exactly beside a measured position."""
        if not self.sensors:
            return []
        names = [state.name for state in system.states]
        exact = set(names) - self.not_known_exactly
        return [names[rate] for rate in system.rate_positions if names[rate] in exact]

    def part(self, kind: str, of: str) -> Any:
        """Return one of the parts.

        Args:
            kind: ``computing``, ``sensor``, ``estimator`` or ``actuator``.
            of: Name of its state or input; ignored for ``computing``.

        Raises:
            ArgumentError: If there is no such part.
        """
        if kind == "computing":
            return self.computing
        parts = self._named(kind)
        if not parts:
            raise ArgumentError(f"there is no [[{kind}]]")
        if of not in parts:
            raise ArgumentError(unknown_name(kind, of, parts))
        return parts[of]

    def _named(self, kind: str) -> dict[str, Part]:
        """Parts of a kind by the names of their states or inputs."""
        parts = {}
        for part in getattr(self, f"{kind}s"):
            parts.update(dict.fromkeys(_names(part), part))
        return parts

    def changed(
        self,
        kind: str,
        of: str,
        **numbers: Any,
    ) -> Loop:
        """Copy with other numbers of one of the parts.

        Args:
            kind: Kind of the part, see ``part``.
            of: Name of its state or input, see ``part``.
            numbers: New numbers by their names.

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
        """Refuse unknown states and inputs, two parts of one, and times off the timestep's grid.

        Args:
            system: System of the plant.
            timestep: Timestep of the physics [s].
            control_period: Control period of the law [s].

        Raises:
            ArgumentError: With all mistakes.
        """
        mistakes = Mistakes()
        for kind in _LISTS:
            self._note_names(kind, system, mistakes)

        for kind, part in self.parts:
            names = ", ".join(_names(part))
            label = f"{kind} of {names}" if names else kind
            for name in TIMES:
                with mistakes.gathered(f"{label}: "):
                    steps_in(name, getattr(part, name, 0.0), timestep)

        for part in self.actuators:
            if part.lag * part.order > MOST_STEPS * timestep:
                mistakes.note(
                    f"actuator of {part.of}: lag = {part.lag:g} s is more than {MOST_STEPS} "
                    f"timesteps of {timestep:g} s"
                )

        jitter = self.computing.jitter
        if jitter and not jitter < control_period * (1 - 1e-9):
            mistakes.note(
                f"computing: jitter = {jitter:g} s must be shorter than the control period "
                f"{control_period:g} s"
            )
        mistakes.refuse()

    def _note_names(self, kind: str, system: System, mistakes: Mistakes) -> None:
        """Note parts of a kind whose state or input is unknown, or has two of them."""
        noun = "input" if kind == "actuator" else "state"
        valid = [signal.name for signal in getattr(system, f"{noun}s")]
        counts = Counter[str]()
        for part in getattr(self, f"{kind}s"):
            counts.update(_names(part))
        for name, count in counts.items():
            if name not in valid:
                mistakes.note(f"{kind}: {unknown_name(noun, name, valid)}")
            elif count > 1:
                mistakes.note(f"{count} {kind}s of {name!r}: give one")

    def words(self, system: System) -> list[str]:
        """Description of each part that is not ideal, a line each.

        Args:
            system: System of the plant, with the units of its states and inputs.
        """
        lines = []
        for _, part in self.parts:
            names = _names(part)
            words = ", ".join(_words(part, system, names[0] if names else ""))
            if words:
                lines.append(f"{', '.join(names) or 'computer'}: {words}")
        return lines


def _names(part: Part) -> tuple[str, ...]:
    """Names of the states or inputs of a part; none of the computer."""
    names = getattr(part, "of", ())
    if isinstance(names, str):
        return (names,)
    return names


def _words(part: Part, system: System, of: str) -> Iterator[str]:
    """Description of each number that is not ideal, by the text in its annotation."""
    if isinstance(part, Estimator):
        words = f"estimated by {part.law}"
        if part.law in TUNED_BY:
            tuned_by = TUNED_BY[part.law]
            bounds = range_of(type(part), tuned_by)
            unit = unit_after(bounds.unit_in(system, of)) if bounds else ""
            words += f" with {spelled(tuned_by)} {part.number:.4g}{unit}"
        if not part.settled:
            words += ", from rest"
        yield words

    lags = "two lags" if getattr(part, "order", 1) == 2 else "a lag"
    for name, hint in get_type_hints(type(part), include_extras=True).items():
        texts = [note for note in get_args(hint)[1:] if isinstance(note, str)]
        value = getattr(part, name)
        if not texts or value == getattr(type(part), name) or not math.isfinite(value):
            continue
        bounds = range_of(type(part), name)
        yield texts[0].format(
            value=value,
            unit=bounds.unit_in(system, of) if bounds else "",
            ms=1e3 * value,
            percent=100 * value,
            lags=lags,
        )
