"""The imperfections of a loop, one at a time and together: what there is, by which factor."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from grosmc_mj.studies.tolerance.search import MOST

from grosmc_mj.experiments.file.parts import LOOP_UNITS, unit_of
from grosmc_mj.loop import Loop
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.plants import System

# Called that: all of them at once, in the bench's proportions.
WHOLE = "all"
# More of these is less of an imperfection.
_LIMITS = ("limit", "rate_limit")
# Times are below this [s], and so many samples come through at least.
_LONGEST, _MISSED = 1.0, 0.99


class Amount(NamedTuple):
    """A number of one part of a loop.

    Attributes:
        kind: ``computing``, ``sensor`` or ``actuator``.
        of: The state or input that it is of; empty of the computer.
        quantity: Which number.
        value: What the bench has, in ``unit``.
        unit: Its unit.
        most: The factor on it at which a physical bound is reached.
    """

    kind: str
    of: str
    quantity: str
    value: float
    unit: str
    most: float

    @property
    def limits(self) -> bool:
        """Whether less of it is worse."""
        return self.quantity in _LIMITS

    def scaled(self, factor: float) -> float:
        """What a factor makes of it, within its bound; 0 for the ideal."""
        if self.limits:
            return self.value / factor if factor > 0 else math.inf
        return self.value * min(factor, self.most)


@dataclass(frozen=True)
class Imperfection:
    """Something of a loop that a factor scales, all else ideal.

    Attributes:
        name: For people.
        base: The loop without it.
        full: The loop with what is there or not, but without what the factor scales.
        amounts: What the factor scales; none for what is there or not.
        timestep: Of the physics; times are whole multiples of it [s].
        whole: Whether it is all of them at once.
    """

    name: str
    base: Loop
    full: Loop
    amounts: tuple[Amount, ...]
    timestep: float
    whole: bool = False

    @property
    def graded(self) -> bool:
        """Whether there is more or less of it."""
        return bool(self.amounts)

    @property
    def most(self) -> float:
        """The factor where it ends; of all at once each ends where it must."""
        bounds = () if self.whole else (each.most for each in self.amounts)
        return min([MOST, *bounds])

    @property
    def unit(self) -> str:
        """Of what is shown of it: that of its first part; empty for a mere factor or a share."""
        return "" if self.whole or not self.graded else self.amounts[0].unit

    def at(self, factor: float) -> Loop:
        """The loop with so much of it, its times on the timestep's grid.

        Args:
            factor: On what the bench has; 0 for none of it.
        """
        found = self.full if factor > 0 else self.base
        for each in self.amounts:
            scaled = {each.quantity: each.scaled(factor)}
            found = found.changed(each.kind, each.of, **scaled)
        return found.rounded(self.timestep)

    def shown(self, factor: float) -> float:
        """What is shown of a factor, in ``unit``: as much of its first part as is run."""
        if self.whole or not self.graded:
            return factor
        first = self.amounts[0]
        value = first.scaled(factor)
        if first.quantity in TIMES:
            return time_as_run(first.quantity, value, self.timestep)
        return value


def imperfections(
    bench: Loop, system: System, timestep: float, control_period: float
) -> list[Imperfection]:
    """All that a bench has: each number alone, rates that are estimated, everything.

    Args:
        bench: The loop whose numbers are the units.
        system: Whose.
        timestep: [s].
        control_period: [s].
    """
    everything = list(_amounts(bench, system, timestep, control_period))
    estimated = bench
    for each in everything:
        nothing = {each.quantity: each.scaled(0.0)}
        estimated = estimated.changed(each.kind, each.of, **nothing)
    ideal = replace(estimated, estimators=())
    groups: dict[tuple[str, str], list[Amount]] = {}
    for each in everything:
        groups.setdefault((each.kind, each.quantity), []).append(each)

    def made(
        name: str, full: Loop, amounts: Sequence[Amount], *, whole: bool = False
    ) -> Imperfection:
        base = full if amounts else ideal
        return Imperfection(name.replace("_", " "), base, full, tuple(amounts), timestep, whole)

    found = [made(" ".join(key), ideal, amounts) for key, amounts in groups.items()]
    if bench.estimators:
        found.append(made("estimated rates", estimated, []))
        found += [
            made(f"{' '.join(key)}, estimated rates", estimated, amounts)
            for key, amounts in groups.items()
            if key in (("sensor", "resolution"), ("sensor", "noise"))
        ]
    return [*found, made(WHOLE, estimated, everything, whole=True)]


def _amounts(
    bench: Loop, system: System, timestep: float, control_period: float
) -> Iterator[Amount]:
    """Every number of a bench that is an imperfection."""
    for kind, part in bench.parts:
        if kind == "estimator":
            continue
        of: Any = getattr(part, "of", "")
        for item in fields(part):
            value: Any = getattr(part, item.name)
            if item.name in LOOP_UNITS[kind] and value != 0 and math.isfinite(value):
                unit = unit_of(kind, of, item.name, system)
                most = _most(item.name, unit, timestep, control_period) / abs(value)
                yield Amount(kind, of, item.name, value, unit, most)


def _most(quantity: str, unit: str, timestep: float, control_period: float) -> float:
    """The physical bound of a number."""
    if quantity == "missed":
        return _MISSED
    if quantity == "jitter":
        return control_period - timestep
    return _LONGEST - timestep if unit == "s" else math.inf
