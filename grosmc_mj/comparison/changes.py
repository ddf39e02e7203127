"""What changed between the values of two sets of results, and which of it is more than noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from grosmc_mj.page.reading import Document
from grosmc_mj.results.result import Result, Value
from grosmc_mj.versions import DECISIVE

# Note on a value that the new results do not have.
GONE = "gone"
# What rounding changes on one machine: relative, absolute.
_ROUNDING = (1e-6, 1e-9)
# Words that are better than others, best first; between others there is no order.
_RANK = (("kept", "not kept"), ("completed", "diverged"), ("as recorded", "not as recorded"),
         ("as expected", "not as expected"), ("agree", "disagree"), ("holds", "fails"))  # fmt: skip
# Kinds of results whose seeds do not matter.
_SEEDLESS = ("validation", "claims")


class Effect(Enum):
    """What a change is.

    A value that is gone is ``WORSE``. ``UNJUDGED`` is of a single run whose chance had another
    seed: it has no spread to judge by.
    """

    WORSE = "worse"
    BETTER = "better"
    CHANGED = "changed"
    UNJUDGED = "not judged"
    NOISE = "noise"
    NEW = "new"


class Change(NamedTuple):
    """A value that is not what it was.

    Attributes:
        kind: Of result.
        name: Of the value.
        before: The old value, None for none.
        after: The new one.
        effect: What the change is.
        unit: Of both.
        note: What it was judged by.
    """

    kind: str
    name: str
    before: float | str | None
    after: float | str | None
    effect: Effect
    unit: str = ""
    note: str = ""

    @property
    def relative(self) -> float:
        """Size of the change over that of the old value; inf where there is none."""
        before, after = self.before, self.after
        if isinstance(before, str) or isinstance(after, str) or not before or after is None:
            return math.inf
        return abs(after / before - 1)


class _Conditions(NamedTuple):
    """How far both sides can be expected to repeat.

    Attributes:
        same: Whether machine and decisive versions are the same: then a run repeats to rounding.
        chance: Whether runs drew other numbers: then single ones cannot be told apart.
    """

    same: bool
    chance: bool


def changes(old: Sequence[Document], new: Sequence[Document]) -> tuple[list[Change], int]:
    """The values that are not as they were, the worst first, and how many both sides have."""
    before, after = _values(old), _values(new)
    conditions = {kind: _conditions(kind, old, new) for kind, _ in {*before, *after}}
    shared = before.keys() & after.keys()
    found = [
        change
        for key in shared
        if (change := _change(key, before[key], after[key], conditions[key[0]])) is not None
    ]
    for key in before.keys() - shared:
        old_value = before[key]
        found.append(Change(*key, old_value.value, None, Effect.WORSE, old_value.unit, GONE))
    added = after.keys() - shared
    found += [Change(*key, None, after[key].value, Effect.NEW, after[key].unit) for key in added]
    order = list(Effect)
    found.sort(key=lambda each: (order.index(each.effect), -each.relative, each.kind, each.name))
    return found, len(shared)


def _values(documents: Sequence[Document]) -> dict[tuple[str, str], Value]:
    """Values by kind of result and name; of two of one name the newer one."""
    return {
        (document.kind, value.name): value
        for document in documents
        if isinstance(document.content, Result)
        for value in document.content.values
    }


def _conditions(kind: str, old: Sequence[Document], new: Sequence[Document]) -> _Conditions:
    sides = [[each.content for each in side if each.kind == kind] for side in (old, new)]
    machines = {
        (each.machine, *(each.versions.get(name) for name in DECISIVE))
        for side in sides
        for each in side
    }
    known = all(each.machine for side in sides for each in side)
    seeds = [{each.seed for each in side} for side in sides]
    chance = all(sides) and kind not in _SEEDLESS and seeds[0] != seeds[1]
    return _Conditions(len(machines) == 1 and known, chance)


def _change(key: tuple[str, str], old: Value, new: Value, conditions: _Conditions) -> Change | None:
    """One value's change; None for none."""
    before, after = old.value, new.value
    if before == after:
        return None
    change = Change(*key, before, after, Effect.CHANGED, new.unit)
    if after is None:
        return change._replace(effect=Effect.WORSE, note=GONE)
    if conditions.chance:
        return change._replace(effect=Effect.UNJUDGED, note="single runs of other seeds")
    if isinstance(before, str) and isinstance(after, str):
        return change._replace(effect=effect_of(_direction(before, after)))
    if before is None or isinstance(before, str) or isinstance(after, str):
        return change
    relative, absolute = _ROUNDING if conditions.same else (new.relative, new.absolute)
    sizes = [x if y is None else y for x, y in ((before, old.size), (after, new.size))]
    if abs(after - before) <= max(absolute, relative * max(map(abs, sizes))):
        return change._replace(effect=Effect.NOISE, note=f"within {relative:g}, {absolute:g}")
    return change._replace(effect=effect_of(new.better * (1 if after > before else -1)))


def _direction(old: str, new: str) -> int:
    """Whether a word is better (1) or worse (-1) than the one before, or just another one (0)."""
    for good, bad in _RANK:
        if old == good or new == bad:
            return -1
        if new == good or old == bad:
            return 1
    return 0


def effect_of(better: int) -> Effect:
    """The effect of a change for the better (1), for the worse (-1) or of neither (0)."""
    return {1: Effect.BETTER, -1: Effect.WORSE}.get(better, Effect.CHANGED)
