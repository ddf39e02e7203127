"""A disturbance within a bound: on a body, an input or the measurement of a state."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.units import number_in, rate_unit, typed_number
from grosmc_mj.simulation.disturbances import (
    AnyDisturbance,
    Constant,
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    SineFrom,
    Table,
)
from grosmc_mj.theory.plants import System

# Values in a piece of a signal with a bounded rate.
_LEVELS = 20
_AXES = "xyz"
# Rounding of an instant k h.
_LATER = 1 + 1e-12
# A value that moves nothing, and with which a table acts.
_NEARLY_NOTHING = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class BoundedDisturbance:
    """A disturbance of which only its bound is known.

    Attributes:
        experiment: The case without a disturbance at this place.
        unit_disturbance: The disturbance at its bound.
        unit: Unit of the bound.
        bound: The bound, in its unit.
        slew: Bound of its rate, in the unit a second; infinite for none.
        starts: Bound of the deviation of each state at the start, by index.
        replaced: The case's own disturbance at this place; None if there is none.
        replaced_index: Its place among the case's disturbances; -1 if there is none.
        end: Instant after which it does not act [s]; infinite for the end of the run.
    """

    experiment: Experiment
    unit_disturbance: AnyDisturbance
    unit: str
    bound: float
    slew: float = math.inf
    starts: Mapping[int, float] = field(default_factory=dict)
    replaced: AnyDisturbance | None = None
    replaced_index: int = -1
    end: float = math.inf

    @property
    def place(self) -> str:
        """Name of the body, the input or the state."""
        return self.unit_disturbance.of

    @property
    def timestep(self) -> float:
        """Timestep of the runs [s]."""
        return self.experiment.settings.timestep

    @property
    def levels(self) -> int:
        """Number of values of a piece."""
        return 1 if math.isinf(self.slew) else _LEVELS

    @property
    def acting_time(self) -> float:
        """Time from the start for which it may act [s]."""
        return min(self.end, self.experiment.duration)

    def hold(self, pieces: int) -> float:
        """Time for which a value is held: whole timesteps, so that all pieces fill its time [s]."""
        seconds = self.acting_time / pieces / self.levels
        return math.ceil(seconds / self.timestep - 1e-9) * self.timestep

    def profile(self, pieces: Array) -> Table:
        """Return the course in time of pieces, (N,).

        With a bounded rate a piece is the slope, and the signal stays within its bound.
        """
        hold = self.hold(len(pieces))
        if math.isfinite(self.end):
            # Whole timesteps are longer than the pieces: the last ones begin after the end.
            pieces = pieces[: math.floor(self.end / hold * _LATER)]
        if math.isinf(self.slew):
            return Table(tuple(pieces.tolist()), hold)

        values = [0.0]
        for slope in pieces * self.slew / self.bound:
            rise = slope * hold * np.arange(1, self.levels + 1)
            values += np.clip(values[-1] + rise, -1.0, 1.0).tolist()
        return Table(tuple(values[1:]), hold)

    def case_with(self, profile: Any, deviations: Sequence[float] = ()) -> Experiment:
        """Return the case with the disturbance of a profile.

        Args:
            profile: Function of t, in parts of the bound.
            deviations: Deviations of the start in parts of their bounds; none by default.
        """
        x0 = list(self.experiment.x0)
        for (index, bound), part in zip(self.starts.items(), deviations, strict=False):
            x0[index] += part * bound
        unit_disturbance: Any = self.unit_disturbance
        disturbance = replace(unit_disturbance, profile=profile, label=f"worst on {self.place}")
        disturbances = list(self.experiment.disturbances)
        place = len(disturbances) if self.replaced is None else self.replaced_index
        disturbances.insert(place, disturbance)
        return self.experiment.changed(x0=tuple(x0), disturbances=tuple(disturbances))

    def applied_in(self, case: Experiment) -> AnyDisturbance:
        """Return the disturbance in one of its cases: at the replaced one's place, or the last."""
        return case.disturbances[self.replaced_index]

    def case_of(self, signal: Array) -> Experiment:
        """Return the case with a signal of the search: pieces, then deviations of the start."""
        count = len(signal) - len(self.starts)
        return self.case_with(self.profile(signal[:count]), signal[count:].tolist())

    def scaled(self, factor: float) -> BoundedDisturbance:
        """Return a copy with the bounds of value and rate times a factor."""
        return replace(
            self,
            unit_disturbance=self.unit_disturbance.scaled(factor),
            bound=factor * self.bound,
            slew=factor * self.slew,
        )

    @property
    def compared(self) -> str:
        """Name of the disturbance that it is compared with: the case's own, or a constant one."""
        if self.replaced is None:
            return "a constant one"
        profile = self.replaced.profile
        if isinstance(profile, Pulse):
            return f"a {profile.stop - profile.start:g} s pulse"
        if isinstance(profile, SineFrom):
            return f"a sine of {profile.frequency / 2 / math.pi:.3g} Hz"
        return "the file's own course"

    @property
    def compared_case(self) -> Experiment:
        """Case with that disturbance, at the bound.

        Like the one that is searched it counts as acting from the start, so that both are asked
        the same: else the transient ends at the onset of a pulse, and begins anew there.
        """
        steps = math.floor(self.acting_time / self.timestep * _LATER)
        if self.replaced is None:
            ends = math.isfinite(self.end)
            return self.case_with(Table((1.0,), steps * self.timestep) if ends else Constant())
        profile = self.replaced.profile
        values = [float(profile(step * self.timestep)) for step in range(steps)]
        values[0] = values[0] or _NEARLY_NOTHING
        return self.case_with(Table(tuple(values), self.timestep))


def bounded_disturbance(
    experiment: Experiment,
    on: str,
    bound: str,
    *,
    axis: str = "",
    slew: str = "",
    starts: Sequence[str] = (),
) -> BoundedDisturbance:
    """Read what is known of a disturbance.

    Args:
        experiment: The case.
        on: A body, an input, or a state whose measurement is disturbed.
        bound: Its largest magnitude with its unit; on a body a force or a torque.
        axis: x, y or z of a force or torque; by default as in the case's own disturbance on the
            body, else x of a force and y of a torque.
        slew: Largest magnitude of its rate with its unit; unlimited by default.
        starts: ``STATE=BOUND`` each, by which the start may deviate.

    Raises:
        ArgumentError: If there is no such place, or a unit does not fit.
    """
    system = experiment.nominal.system
    inputs = {signal.name: signal.unit for signal in system.inputs}
    states = {state.name: state.unit for state in system.states}
    require_known("body, input or state", on, [*system.bodies, *inputs, *states])
    unit = inputs.get(on) or states.get(on) or ""
    if on in system.bodies:
        unit = _unit_on_body(bound)
    size = _magnitude("--bound", bound, unit)

    kind = _kind_of(on, system)
    replaced = None
    replaced_index = -1
    kept = list(experiment.disturbances)
    for index, disturbance in enumerate(experiment.disturbances):
        if type(disturbance) is kind and disturbance.of == on:
            replaced = kept.pop(index)
            replaced_index = index
            break

    if kind is Disturbance:
        unit_disturbance = Disturbance(on, _wrench(replaced, unit, size, axis))
    else:
        unit_disturbance = kind(on, size)
        if axis:
            raise ArgumentError(f"--axis {axis}: {on} is no body")
    return BoundedDisturbance(
        experiment=experiment.changed(disturbances=tuple(kept)),
        unit_disturbance=unit_disturbance,
        unit=unit,
        bound=size,
        slew=_magnitude("--slew", slew, rate_unit(unit)) if slew else math.inf,
        starts=_start_bounds(starts, system),
        replaced=replaced,
        replaced_index=replaced_index,
    )


def _kind_of(on: str, system: System) -> Any:
    """Return the class of disturbances at a place."""
    if on in system.bodies:
        return Disturbance
    if on in [signal.name for signal in system.inputs]:
        return InputDisturbance
    return OutputDisturbance


def _unit_on_body(bound: str) -> str:
    """Return N or N m, whichever a bound has."""
    for unit in ("N", "N m"):
        try:
            number_in(bound, unit)
        except ArgumentError:
            continue
        return unit
    raise ArgumentError(
        f"--bound {value_text(bound)}: on a body it is a force or a torque, such as 2 N or 1 N m"
    )


def _magnitude(option: str, text: str, unit: str) -> float:
    """Return a positive number with its unit."""
    try:
        number = typed_number(text, unit)
    except ArgumentError as error:
        raise ArgumentError(f"{option}: {error}") from None
    if number <= 0:
        raise ArgumentError(f"{option} {value_text(text)} must be positive")
    return number


def _wrench(replaced: AnyDisturbance | None, unit: str, bound: float, axis: str) -> Any:
    """Return the wrench of a force or torque at its bound, (6,)."""
    first = 0 if unit == "N" else 3
    direction = np.zeros(3)
    if axis:
        require_known("axis", axis, tuple(_AXES))
        direction[_AXES.index(axis)] = 1.0
    elif replaced is not None and any(replaced.amplitudes[first : first + 3]):
        direction = np.array(replaced.amplitudes[first : first + 3])
        direction = direction / np.linalg.norm(direction)
    else:
        direction[0 if unit == "N" else 1] = 1.0
    wrench = np.zeros(6)
    wrench[first : first + 3] = bound * direction
    return tuple(wrench.tolist())


def _start_bounds(starts: Sequence[str], system: System) -> dict[int, float]:
    """Return the bounds of the deviations of the start by index of the state."""
    units = {state.name: state.unit for state in system.states}
    bounds = {}
    for text in starts:
        name, equals, bound = [part.strip() for part in text.partition("=")]
        if not equals:
            raise ArgumentError(f'--start {value_text(text)}: write "STATE=BOUND"')
        require_known("state", name, units)
        bounds[list(units).index(name)] = _magnitude(f"--start: {name}:", bound, units[name])
    return bounds
