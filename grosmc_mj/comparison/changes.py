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
# Words that are better, or worse, than any other.
_GOOD = ("kept", "completed", "as recorded", "as expected", "agree", "holds")
_BAD = ("not kept", "diverged", "not as recorded", "not as expected", "disagree", "fails")
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
    def order(self) -> tuple[int, float, str, str]:
        """The worst effects and, of these, the largest relative changes come first."""
        before, after, relative = self.before, self.after, math.inf
        if isinstance(before, float | int) and isinstance(after, float | int) and before:
            relative = abs(after / before - 1)
        return list(Effect).index(self.effect), -relative, self.kind, self.name


def changes(old: Sequence[Document], new: Sequence[Document]) -> tuple[list[Change], int]:
    """The values that are not as they were, and how many both sides have."""
    before, after = _values(old), _values(new)
    shared = before.keys() & after.keys()
    repeats = {kind: _repeats(kind, old, new) for kind, _ in shared}
    compared = [
        Change(*key, before[key].value, after[key].value, effect, after[key].unit, note)
        for key in shared
        if before[key].value != after[key].value
        for effect, note in [_judged(before[key], after[key], *repeats[key[0]])]
    ]
    gone = [
        Change(*key, before[key].value, None, Effect.WORSE, before[key].unit, GONE)
        for key in before.keys() - shared
    ]
    added = [
        Change(*key, None, after[key].value, Effect.NEW, after[key].unit)
        for key in after.keys() - shared
    ]
    return compared + gone + added, len(shared)


def _values(documents: Sequence[Document]) -> dict[tuple[str, str], Value]:
    """Values by kind of result and name; of two of one name the newer one."""
    return {
        (document.kind, value.name): value
        for document in documents
        if isinstance(document.content, Result)
        for value in document.content.values
    }


def _repeats(kind: str, old: Sequence[Document], new: Sequence[Document]) -> tuple[bool, bool]:
    """Whether machine and decisive versions are one, and whether runs drew other numbers.

    On one machine a run repeats to rounding; single runs of other seeds cannot be told apart.
    """
    sides = [
        [document.content for document in side if document.kind == kind] for side in (old, new)
    ]
    machines = {
        (content.machine, *(content.versions.get(name) for name in DECISIVE))
        for content in (*sides[0], *sides[1])
    }
    seeds = [{content.seed for content in side} for side in sides]
    same = len(machines) == 1 and all(machine for machine, *_ in machines)
    return same, kind not in _SEEDLESS and seeds[0] != seeds[1]


def _judged(old: Value, new: Value, same: bool, chance: bool) -> tuple[Effect, str]:
    """The effect of a change, and what it was judged by."""
    before, after = old.value, new.value
    if after is None:
        return Effect.WORSE, GONE
    if chance:
        return Effect.UNJUDGED, "single runs of other seeds"
    if before is None or isinstance(before, str) or isinstance(after, str):
        ranks = [(word in _GOOD) - (word in _BAD) for word in (before, after)]
        words = isinstance(before, str) and isinstance(after, str)
        return effect_of(ranks[1] - ranks[0] if words else 0), ""
    relative, absolute = _ROUNDING if same else (new.relative, new.absolute)
    sizes = [x if y is None else y for x, y in ((before, old.size), (after, new.size))]
    if abs(after - before) <= max(absolute, relative * max(map(abs, sizes))):
        return Effect.NOISE, f"within {relative:g}, {absolute:g}"
    return effect_of(new.better * (after - before)), ""


def effect_of(better: float) -> Effect:
    """The effect of a change for the better (> 0), for the worse (< 0) or of neither (0)."""
    return Effect.BETTER if better > 0 else Effect.WORSE if better < 0 else Effect.CHANGED
