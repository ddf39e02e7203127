"""What the tolerances of a target say together, in words and amounts that people read."""

from __future__ import annotations

import math
from collections.abc import Sequence

from grosmc_mj.results.tables import number, prefixed
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.measure import Tolerance

# Amounts that are shown are about so many times the bench's, but for limits.
_TYPICAL = 100.0


def weakness(row: Tolerance) -> float:
    """By which tolerances are compared: the factor that fails, infinite if none does."""
    if not row.ideally or row.impossible:
        return 0.0
    return math.inf if row.failed is None else row.failed


def unit_and_scale(imperfection: Imperfection) -> tuple[str, float]:
    """The unit in which amounts of an imperfection are shown, and the factor to it."""
    if imperfection.whole or not imperfection.graded:
        return "", 1.0
    first, unit = imperfection.amounts[0], imperfection.unit
    value = abs(first.value) * (1.0 if first.limits else _TYPICAL)
    if not unit:
        return "%", 100.0
    return prefixed(unit, value)


def amount_text(imperfection: Imperfection, factor: float) -> str:
    """An amount with its unit; of all at once, how many times the bench's."""
    unit, scale = unit_and_scale(imperfection)
    shown = number(imperfection.shown(factor) * scale)
    return f"{shown} {unit}" if unit else f"{shown} times the bench"


def heading(imperfection: Imperfection) -> str:
    """What a column is of, on one line with the unit of its cells."""
    if imperfection.whole:
        return f"{imperfection.name} [times the bench]"
    unit, _ = unit_and_scale(imperfection)
    return f"{imperfection.name} [{unit}]" if unit else imperfection.name


def cell_text(row: Tolerance) -> str:
    """A tolerance in a cell of a table, without its unit."""
    return f"{_plain(row)}{'*' if row.again else ''}{'!' if row.agreed is False else ''}"


def none_of_it(row: Tolerance) -> bool:
    """Whether all is kept only without it: with at most less than half a timestep of it."""
    return row.largest == 0 or row.imperfection.shown(row.largest) == 0


def _plain(row: Tolerance) -> str:
    if row.impossible:
        return "-"
    if not row.imperfection.graded:
        return "yes" if row.unbroken else "no"
    if not row.ideally:
        return "no"
    if none_of_it(row):
        return "none"
    scale = unit_and_scale(row.imperfection)[1]
    shown = number(row.imperfection.shown(row.largest) * scale)
    at_limit = row.imperfection.amounts[0].limits and not row.imperfection.whole
    sign = "≤" if at_limit else "≥"
    return f"{sign} {shown}" if row.failed is None else shown


def stands_ideally(rows: Sequence[Tolerance], law: str, condition: str) -> bool:
    """Whether a law keeps everything without any imperfection under a condition."""
    return any(
        row.ideally
        for row in rows
        if row.law == law and row.condition == condition and row.imperfection.graded
    )


def verdict(rows: Sequence[Tolerance]) -> str:
    """Which law breaks first, at how much of what."""
    broken = [
        row
        for row in rows
        if row.ideally and row.failed is not None and row.imperfection.graded
        and not row.imperfection.whole
    ]  # fmt: skip
    if not broken:
        return "No single imperfection that was tried breaks what a law keeps without it."
    worst = min(broken, key=weakness)
    assert worst.failed is not None
    kept = f"up to {_amount_and_factor(worst.imperfection, worst.largest)}"
    if none_of_it(worst):
        kept = "only without it"
    at = _amount_and_factor(worst.imperfection, worst.failed)
    where = "" if worst.condition == "nominal" else f" under {worst.condition}"
    return (
        f"{worst.law} breaks first, by {worst.imperfection.name}{where}: all is kept {kept}, and "
        f"no longer at {at}: {reason(worst)}."
    )


def _amount_and_factor(imperfection: Imperfection, factor: float) -> str:
    """An amount, and how many times the bench's."""
    return f"{amount_text(imperfection, factor)} ({number(factor)} times the bench's)"


def reason(row: Tolerance) -> str:
    """What is not kept any more, in words."""
    return row.breaks.replace("_", " ")


def whole_bench(rows: Sequence[Tolerance]) -> list[str]:
    """Under each condition, which laws keep everything on the bench as it is."""
    found = []
    for name in dict.fromkeys(row.condition for row in rows):
        own = [row for row in rows if row.imperfection.whole and row.condition == name]
        kept = [row.law for row in own if row.ideally and on_bench(row)]
        found.append(f"The whole bench, {name}: {'; '.join(kept) or 'no law'}.")
    return found


def on_bench(row: Tolerance) -> bool:
    """Whether all is kept up to what the bench has."""
    return not row.impossible and row.largest >= 1.0


def disagreements(rows: Sequence[Tolerance]) -> tuple[int, int]:
    """How many answers physics was asked about, and of how many it said something else."""
    asked = [row for row in rows if row.agreed is not None]
    return len(asked), sum(row.agreed is False for row in asked)


def never_kept(rows: Sequence[Tolerance], condition: str) -> list[str]:
    """The laws that do not keep everything under a condition even without any imperfection."""
    laws = dict.fromkeys(row.law for row in rows if row.condition == condition)
    return [law for law in laws if not stands_ideally(rows, law, condition)]


def least(rows: Sequence[Tolerance]) -> list[Tolerance]:
    """Of each law and imperfection the least over the conditions that the law stands ideally."""
    found: dict[tuple[str, Imperfection], Tolerance] = {}
    for row in rows:
        if not stands_ideally(rows, row.law, row.condition):
            continue
        key = (row.law, row.imperfection)
        found[key] = min(found.get(key, row), row, key=lambda each: (weakness(each), each.largest))
    return list(found.values())


def by_weakness(rows: Sequence[Tolerance]) -> list[Imperfection]:
    """The imperfections, the one of which the least is stood first."""
    found = dict.fromkeys(row.imperfection for row in rows)

    def smallest(each: Imperfection) -> float:
        own = [row for row in rows if row.imperfection is each and row.ideally]
        return min((weakness(row) for row in own), default=0.0)

    return sorted(found, key=smallest)
