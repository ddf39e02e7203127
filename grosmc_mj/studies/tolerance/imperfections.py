"""Imperfections of a loop: each of a bench's numbers alone, in any amount, and all of them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from grosmc_mj.experiments.file.parts import LOOP_PARTS, PART_KINDS, unit_of
from grosmc_mj.experiments.steps import Member, Steps, with_values
from grosmc_mj.ground.wording import spelled, titled
from grosmc_mj.output.results.tables import number, prefixed
from grosmc_mj.simulation.loop import Loop, Sensor
from grosmc_mj.simulation.loop.timing import TIMES, time_as_run
from grosmc_mj.theory.plants import System

# Name of all imperfections at once, in the bench's proportions.
ALL = "all"
# The smallest and the largest factor on an amount.
LEAST = 2.0**-4
MOST = 2.0**10
# More of these is less of an imperfection.
_LIMITS = ("limit", "rate_limit")
# A factor is 1 where it is ideal, and a phase differs by draws: they have no more or less.
_NO_AMOUNTS = ("scale", "gain", "phase")
# Times are below this [s].
_LONGEST = 1.0
# Largest share of samples that are missed.
_MISSED = 0.99
# Amounts that are shown are about so many times the bench's, but for limits.
_TYPICAL = 100.0


class Amount(NamedTuple):
    """A number of one part of a loop.

    Attributes:
        kind: ``computing``, ``sensor`` or ``actuator``; ``run`` for the control period.
        of: State or input of the part; empty for the computer and the control period.
        quantity: Name of the number.
        value: Value on the bench, in ``unit``.
        unit: Its unit.
        most: The factor on it at which a physical bound is reached.
    """

    kind: str
    of: str
    quantity: str
    value: float
    unit: str
    most: float

    def scaled(self, factor: float) -> float:
        """Return the amount for a factor, within its bound; the ideal for 0."""
        if self.quantity not in _LIMITS:
            return self.value * min(factor, self.most)
        if factor > 0:
            return self.value / factor
        return math.inf

    def as_run(self, factor: float, timestep: float) -> float:
        """Return the amount for a factor as a run has it: times are whole timesteps [s]."""
        value = self.scaled(factor)
        if self.quantity in TIMES:
            return time_as_run(self.quantity, value, timestep)
        return value

    @property
    def steps(self) -> Steps:
        """Steps to it from the loop."""
        if self.kind == "computing":
            return self.kind, self.quantity
        return f"{self.kind}s", Member(LOOP_PARTS[self.kind], self.of), self.quantity


@dataclass(frozen=True)
class Imperfection:
    """Part of a loop that a factor scales, all else ideal.

    Attributes:
        name: Name for people.
        base: The loop without the imperfection.
        full: The loop with it, for every factor above 0, before the amounts are scaled.
        amounts: Numbers that the factor scales; none for an imperfection without a size.
        timestep: Timestep of the physics; times are whole multiples of it [s].
    """

    name: str
    base: Loop
    full: Loop
    amounts: tuple[Amount, ...]
    timestep: float

    @property
    def single(self) -> bool:
        """Whether it has a size, and is not all of them at once."""
        return bool(self.amounts) and self.name != ALL

    @property
    def limits(self) -> bool:
        """Whether less of it is worse."""
        return self.single and self.amounts[0].quantity in _LIMITS

    @property
    def least(self) -> float:
        """Smallest factor that is tried."""
        return LEAST

    @property
    def most(self) -> float:
        """Largest factor; of all at once each amount ends at its own bound."""
        if not self.single:
            return MOST
        return min(MOST, *(amount.most for amount in self.amounts))

    def control_period(self, factor: float) -> float | None:
        """Control period [s] of runs with this factor; None for that of the target."""
        return None

    def at(self, factor: float) -> Loop:
        """Return the loop with this factor on the bench's amounts, times on the timestep's grid."""
        loop = self.full if factor > 0 else self.base
        changes = [(amount.steps, amount.as_run(factor, self.timestep)) for amount in self.amounts]
        return with_values(loop, changes)

    def amount(self, factor: float) -> float:
        """Return the first amount for a factor as it is run, in its unit; else the factor."""
        if not self.single:
            return factor
        return self.amounts[0].as_run(factor, self.timestep)

    @property
    def unit(self) -> tuple[str, float]:
        """The unit in which amounts are shown, and the factor to it; empty for none."""
        if not self.amounts:
            return "", 1.0
        if not self.single:
            return "times the bench", 1.0

        first = self.amounts[0]
        if not first.unit:
            return "%", 100.0
        typical = abs(first.value)
        if not self.limits:
            typical *= _TYPICAL
        return prefixed(first.unit, typical)

    @property
    def heading(self) -> str:
        """Name and unit."""
        unit, _ = self.unit
        if not unit:
            return self.name
        return titled(self.name, unit)

    def text(self, factor: float) -> str:
        """Return the amount for a factor, in the unit that is shown."""
        _, scale = self.unit
        return number(self.amount(factor) * scale)


@dataclass(frozen=True)
class LongerPeriod(Imperfection):
    """A longer control period than the target's in an ideal loop.

    A factor multiplies the period of the target. The result is a whole multiple of the timestep.
    """

    @property
    def least(self) -> float:
        """Smallest factor: the target's own period."""
        return 1.0

    def at(self, factor: float) -> Loop:
        """The ideal loop, with every factor."""
        return self.base

    def amount(self, factor: float) -> float:
        """Control period [s] for a factor; 0 for none."""
        return round(self.amounts[0].scaled(factor) / self.timestep) * self.timestep

    def control_period(self, factor: float) -> float | None:
        """Control period [s] of runs with this factor; None for that of the target."""
        if factor <= self.least:
            return None
        return self.amount(factor)


def imperfections(
    bench: Loop,
    system: System,
    timestep: float,
    control_period: float,
    *,
    longer_period: bool = False,
) -> list[Imperfection]:
    """Return each number of a bench's loop alone, rates that are estimated, and everything.

    Args:
        bench: The loop whose numbers are the units.
        system: System of the loop.
        timestep: Timestep of the physics [s].
        control_period: Control period of the target [s].
        longer_period: Whether a longer control period is one of them.
    """
    everything = list(_amounts(bench, system, timestep, control_period))
    # The bench's loop with ideal numbers: only its rates are estimated.
    estimated: Loop = with_values(
        bench, [(amount.steps, amount.scaled(0.0)) for amount in everything]
    )
    groups: dict[str, list[Amount]] = {}
    for amount in everything:
        title = spelled(f"{amount.kind} {amount.quantity}")
        groups.setdefault(title, []).append(amount)
    ideal = replace(estimated, estimators=(), sensors=_with_exact_rates(bench, estimated))

    kinds = [
        Imperfection(title, ideal, ideal, tuple(amounts), timestep)
        for title, amounts in groups.items()
    ]
    if longer_period:
        most = (_LONGEST - timestep) / control_period
        period = Amount("run", "", "control_period", control_period, "s", most)
        kinds.append(LongerPeriod("control period", ideal, ideal, (period,), timestep))

    if bench.estimators:
        rates = "estimated rates"
        kinds.append(Imperfection(rates, ideal, estimated, (), timestep))
        for title, amounts in groups.items():
            if title in ("sensor resolution", "sensor noise"):
                name = f"{title}, {rates}"
                kind = Imperfection(name, estimated, estimated, tuple(amounts), timestep)
                kinds.append(kind)
    kinds.append(Imperfection(ALL, estimated, estimated, tuple(everything), timestep))
    return kinds


def _with_exact_rates(bench: Loop, estimated: Loop) -> tuple[Sensor, ...]:
    """Sensors of a loop, and exact ones of the states that a bench estimates."""
    measured = {sensor.of for sensor in estimated.sensors}
    exact: list[Sensor] = []
    for part in bench.estimators:
        exact += [Sensor(name, exact=True) for name in part.of if name not in measured]
    return (*estimated.sensors, *exact)


def _amounts(
    bench: Loop, system: System, timestep: float, control_period: float
) -> Iterator[Amount]:
    """Yield every number of a bench that is an imperfection, with its physical bound."""
    for kind, part in bench.parts:
        if kind == "estimator":
            continue
        of: Any = getattr(part, "of", "")
        for item in fields(part):
            quantity = item.name
            if quantity not in PART_KINDS[kind].forms[0].numbers or quantity in _NO_AMOUNTS:
                continue
            value: Any = getattr(part, quantity)
            if value != 0 and math.isfinite(value):
                unit = unit_of(kind, of, quantity, system)
                bound = _bound(quantity, unit, timestep, control_period)
                yield Amount(kind, of, quantity, value, unit, bound / abs(value))


def _bound(
    quantity: str,
    unit: str,
    timestep: float,
    control_period: float,
) -> float:
    """The largest value that a number of a loop can have."""
    if quantity == "missed":
        return _MISSED
    if quantity == "jitter":
        return control_period - timestep
    if unit == "s":
        return _LONGEST - timestep
    return math.inf
