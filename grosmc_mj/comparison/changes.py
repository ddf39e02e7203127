"""What changed between two sets of figures, and which of it is more than noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from enum import Enum
from typing import NamedTuple

from grosmc_mj.comparison.figures import Figure, direction
from grosmc_mj.experiments.metrics import tolerance_of

# Note on a figure that the new results do not have.
GONE = "gone"


class Effect(Enum):
    """What a change is.

    A figure that is gone is ``WORSE``. ``UNJUDGED`` is of a single run whose chance had another
    seed: it has no spread to judge by.
    """

    WORSE = "worse"
    BETTER = "better"
    CHANGED = "changed"
    UNJUDGED = "not judged"
    NOISE = "noise"
    NEW = "new"


class Change(NamedTuple):
    """A figure that is not what it was.

    Attributes:
        kind: Of document.
        name: Of the figure.
        before: Its old value, None for none.
        after: Its new value.
        effect: What that is.
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
        numbers = isinstance(self.before, float | int) and isinstance(self.after, float | int)
        if not numbers or not self.before:
            return math.inf
        return abs(self.after / self.before - 1)  # pyright: ignore


class Conditions(NamedTuple):
    """Under which both sides were computed.

    Attributes:
        same: Whether machine and decisive versions are the same: then a run repeats to the bit.
        chance: Whether runs drew other numbers: then single ones cannot be told apart.
    """

    same: bool
    chance: bool = False


def changes(
    old: Iterable[Figure], new: Iterable[Figure], conditions: Mapping[str, Conditions]
) -> tuple[list[Change], int]:
    """What is not as it was, and how many figures both sides have.

    Args:
        old: Figures before.
        new: Figures after.
        conditions: By kind of document.
    """
    before = {(figure.kind, figure.name): figure for figure in old}
    after = {(figure.kind, figure.name): figure for figure in new}
    found = [
        change
        for key in before.keys() & after.keys()
        if (change := _change(before[key], after[key], conditions[key[0]])) is not None
    ]
    for key, figure in before.items():
        if key not in after:
            found.append(Change(*key, figure.value, None, Effect.WORSE, figure.unit, GONE))
    for key, figure in after.items():
        if key not in before:
            found.append(Change(*key, None, figure.value, Effect.NEW, figure.unit))
    order = list(Effect)
    found.sort(key=lambda each: (order.index(each.effect), -each.relative, each.kind, each.name))
    return found, len(before.keys() & after.keys())


def _change(old: Figure, new: Figure, under: Conditions) -> Change | None:
    """One figure's change; None for none."""
    before, after = old.value, new.value
    if before == after:
        return None
    change = Change(old.kind, old.name, before, after, Effect.CHANGED, new.unit)
    if after is None:
        return change._replace(effect=Effect.WORSE, note=GONE)
    if under.chance:
        return change._replace(effect=Effect.UNJUDGED, note="single runs of other seeds")
    if isinstance(before, str) and isinstance(after, str):
        return change._replace(effect=effect_of(direction(before, after)))
    if before is None or isinstance(before, str) or isinstance(after, str):
        return change
    relative, absolute = tolerance_of(
        new.metric, switched=(old.switched or new.switched) and not under.same
    )
    sizes = (before if old.size is None else old.size, after if new.size is None else new.size)
    if abs(after - before) <= max(absolute, relative * max(map(abs, sizes))):
        return change._replace(effect=Effect.NOISE, note=f"within {relative:g}, {absolute:g}")
    return change._replace(effect=effect_of(new.better * (1 if after > before else -1)))


def effect_of(better: int) -> Effect:
    """The effect of a change for the better (1), for the worse (-1) or of neither (0)."""
    return {1: Effect.BETTER, -1: Effect.WORSE}.get(better, Effect.CHANGED)
