"""Changes between the values of two sets of results, and which of them are more than noise."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from typing import NamedTuple

from grosmc_mj.ground.versions import DECISIVE
from grosmc_mj.ground.wording import counted
from grosmc_mj.output.page.reading import Document
from grosmc_mj.output.results.result import Result, Value

# Note on a number that runs of the new results no longer have.
GONE = "gone"
# Changes by rounding on one machine: relative, and absolute in the unit of the value.
_ROUNDING = (1e-6, 1e-9)
# Words that are better, or worse, than any other.
_GOOD = ("kept", "completed", "as recorded", "as expected", "agree", "holds")
_BAD = ("not kept", "diverged", "not as recorded", "not as expected", "disagree", "fails")
# Kinds of results that no seed changes.
_SEEDLESS = ("validation", "claims")


class Effect(Enum):
    """Effect of a change.

    A number that a run no longer has, because it ends early, is ``WORSE``; a value of which the new
    results say nothing is ``NOT_MEASURED``. ``UNJUDGED`` is a change between single runs with other
    seeds: they do not show how much such runs scatter.
    """

    WORSE = "worse"
    NOT_MEASURED = "not measured"
    BETTER = "better"
    CHANGED = "changed"
    UNJUDGED = "not judged"
    NOISE = "noise"
    NEW = "new"


class Change(NamedTuple):
    """A value that has changed.

    Attributes:
        kind: Kind of result.
        name: Name of the value.
        before: Old value; None for none.
        after: New value; None for none.
        effect: Effect of the change.
        unit: Unit of both.
        note: What the effect was judged by.
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
        """Key to sort by: the worst effects first and, of these, the largest relative changes."""
        before, after = self.before, self.after
        relative = math.inf
        if isinstance(before, float | int) and isinstance(after, float | int) and before != 0:
            relative = abs(after / before - 1)
        return list(Effect).index(self.effect), -relative, self.kind, self.name


class _Conditions(NamedTuple):
    """Conditions that two sets of results of one kind were made under.

    Attributes:
        one_machine: Whether machine and decisive versions are the same: runs repeat to rounding.
        other_seeds: Whether the runs drew other random numbers: single runs cannot be compared.
    """

    one_machine: bool
    other_seeds: bool


def changes(old: Sequence[Document], new: Sequence[Document]) -> tuple[list[Change], int]:
    """Return the changed values, and the number of values that both sides have."""
    before = _values(old)
    after = _values(new)
    before = _renamed(before, after)
    shared = before.keys() & after.keys()

    changed = []
    for kind, name in shared:
        old_value = before[kind, name]
        new_value = after[kind, name]
        if old_value.value != new_value.value:
            conditions = _conditions(kind, old, new)
            changed.append(_judged(kind, old_value, new_value, conditions))
    changed += one_sided(before, after, gone=True)
    changed += one_sided(after, before, gone=False)
    return changed, len(shared)


def one_sided(
    values: Mapping[tuple[str, str], Value],
    others: Mapping[tuple[str, str], Value],
    *,
    gone: bool,
) -> list[Change]:
    """Return the changes of values that one side has alone.

    Several values of an owner that the other side does not know, such as a law that was not run,
    are one change. A value without a number is none.

    Args:
        values: Values of the one side.
        others: Those of the other one.
        gone: Whether the one side is the old one.
    """
    known = {(kind, _owner(name)) for kind, name in others}
    by_owner: dict[tuple[str, str], list[Value]] = {}
    for (kind, name), value in values.items():
        if (kind, name) not in others and value.value is not None:
            owner = _owner(name)
            group = name if (kind, owner) in known else owner
            by_owner.setdefault((kind, group), []).append(value)

    changed = []
    for (kind, group), (first, *others_of_it) in by_owner.items():
        if others_of_it:
            number = counted(1 + len(others_of_it), "value")
            changed.append(one_sided_change(kind, group, number, gone=gone))
        else:
            changed.append(one_sided_change(kind, first.name, first.value, first.unit, gone=gone))
    return changed


def one_sided_change(
    kind: str, name: str, value: float | str | None, unit: str = "", *, gone: bool
) -> Change:
    """Return the change of what one side has alone: the old one, if it is gone, or the new one."""
    if gone:
        return Change(kind, name, value, None, Effect.NOT_MEASURED, unit)
    return Change(kind, name, None, value, Effect.NEW, unit)


def _owner(name: str) -> str:
    """Return the owner of a value, such as ``servo/case1 physics lqr``, by its name."""
    return name.partition(": ")[0]


def _values(documents: Sequence[Document]) -> dict[tuple[str, str], Value]:
    """Return values by kind of result and name; a newer value replaces an older one."""
    values: dict[tuple[str, str], Value] = {}
    for document in documents:
        if isinstance(document.content, Result):
            for value in document.content.values:
                values[document.kind, value.name] = value
    return values


def _renamed(
    before: dict[tuple[str, str], Value], after: dict[tuple[str, str], Value]
) -> dict[tuple[str, str], Value]:
    """Return the old values under the new name of their subject, where it is the only other one.

    A subject, such as ``servo/case1``, is the first word of a value's name. A case that is copied
    to another file, or a campaign to another folder, is still the same; one of another system is
    not.
    """
    old_subjects = _subjects(before)
    new_subjects = _subjects(after)
    renamed: dict[tuple[str, str], Value] = {}
    for (kind, name), value in before.items():
        subject, space, rest = name.partition(" ")
        gone = old_subjects[kind] - new_subjects.get(kind, set())
        added = new_subjects.get(kind, set()) - old_subjects[kind]
        if gone == {subject} and len(added) == 1:
            (other,) = added
            if _one_system(subject, other):
                subject = other
        renamed[kind, subject + space + rest] = value
    return renamed


def _one_system(subject: str, other: str) -> bool:
    """Return whether two subjects are of one system, which is the part before the slash."""
    if "/" not in subject or "/" not in other:
        return True
    return subject.partition("/")[0] == other.partition("/")[0]


def _subjects(values: Iterable[tuple[str, str]]) -> dict[str, set[str]]:
    """Return the subjects of values by the kind of their results."""
    subjects: dict[str, set[str]] = {}
    for kind, name in values:
        subjects.setdefault(kind, set()).add(name.partition(" ")[0])
    return subjects


def _conditions(kind: str, old: Sequence[Document], new: Sequence[Document]) -> _Conditions:
    """Return the conditions that the results of a kind were made under."""
    before = [document.content for document in old if document.kind == kind]
    after = [document.content for document in new if document.kind == kind]

    machines = {content.machine for content in before + after}
    versions = {tuple(map(content.versions.get, DECISIVE)) for content in before + after}
    # A result without a machine may come from any.
    one_machine = len(machines) == 1 and all(machines) and len(versions) == 1

    old_seeds = {content.seed for content in before}
    new_seeds = {content.seed for content in after}
    other_seeds = kind not in _SEEDLESS and old_seeds != new_seeds
    return _Conditions(one_machine, other_seeds)


def _judged(
    kind: str,
    old: Value,
    new: Value,
    conditions: _Conditions,
) -> Change:
    """Return the change of a value with its effect."""
    effect, note = _effect(old, new, conditions)
    return Change(kind, new.name, old.value, new.value, effect, new.unit, note)


def _effect(old: Value, new: Value, conditions: _Conditions) -> tuple[Effect, str]:
    """Return the effect of a change, and what it was judged by."""
    before = old.value
    after = new.value
    if after is None:
        return Effect.WORSE, GONE
    if conditions.other_seeds:
        return Effect.UNJUDGED, "single runs of other seeds"
    if isinstance(before, str) and isinstance(after, str):
        return effect_of(_rank(after) - _rank(before)), ""
    if before is None or isinstance(before, str) or isinstance(after, str):
        return Effect.CHANGED, ""

    relative, absolute = new.relative, new.absolute
    if conditions.one_machine:
        relative, absolute = _ROUNDING
    old_size = before if old.size is None else old.size
    new_size = after if new.size is None else new.size
    tolerance = max(absolute, relative * max(abs(old_size), abs(new_size)))
    if abs(after - before) <= tolerance:
        return Effect.NOISE, f"within {relative:g}, {absolute:g}"
    return effect_of(new.better * (after - before)), ""


def _rank(word: str) -> int:
    """Return 1 for a word that is good, -1 for one that is bad, else 0."""
    if word in _GOOD:
        return 1
    if word in _BAD:
        return -1
    return 0


def effect_of(better: float) -> Effect:
    """Return the effect of a change for the better (> 0), the worse (< 0) or neither (0)."""
    if better > 0:
        return Effect.BETTER
    if better < 0:
        return Effect.WORSE
    return Effect.CHANGED
