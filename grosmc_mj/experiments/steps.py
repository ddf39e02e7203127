"""Values inside an experiment: read, and replaced in a copy, by the steps that lead to them.

An experiment is a tree of values that do not change: dataclasses, tuples of parts, tables of its
file. A copy with other values makes each part on the way to them anew, once, and checks what is
new in it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, NamedTuple

from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import range_of
from grosmc_mj.ground.units import Table
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.simulation.disturbances import Pulse


class Member(NamedTuple):
    """Step to one of several parts.

    Attributes:
        kind: Class of the part.
        name: Name of its state, input, joint or body, or its label.
        nth: Number of such parts before it.
        new: Fields of a part that is made where there is none; None where none may be made.
    """

    kind: type
    name: str
    nth: int = 0
    new: tuple[tuple[str, Any], ...] | None = None

    def place_in(self, parts: Sequence[Any]) -> int | None:
        """Return its index among parts; None if it is not there."""
        before = self.nth
        for index, part in enumerate(parts):
            if isinstance(part, self.kind) and self.name in _names(part):
                if before == 0:
                    return index
                before -= 1
        return None


class Entry(NamedTuple):
    """Step to an entry on the diagonal of a weight.

    A weight is a number for all entries, a list of them, the rows of a matrix, or entries by name.

    Attributes:
        row: Number of the entry, from 0.
        names: Names of all entries; none where they have none.
    """

    row: int
    names: tuple[str, ...]

    def read(self, weight: Any) -> float | None:
        """Return the entry of a weight; None where there is no weight."""
        if isinstance(weight, dict):
            return weight.get(self.names[self.row], 0.0)
        if not isinstance(weight, list):
            return weight
        entry = weight[self.row]
        return entry[self.row] if isinstance(entry, list) else entry

    def write(self, weight: Any, value: float) -> Any:
        """Return the weight with another entry."""
        if isinstance(weight, dict):
            return {**weight, self.names[self.row]: value}
        entries = weight if isinstance(weight, list) else [weight] * len(self.names)
        instead: Any = value
        if isinstance(entries[self.row], list):
            instead = _with_item(entries[self.row], self.row, value)
        return _with_item(entries, self.row, instead)


class Onset(NamedTuple):
    """Step to the begin of a pulse, which keeps its length."""

    def read(self, pulse: Pulse) -> float:
        """Return the begin [s]."""
        return pulse.start

    def write(self, pulse: Pulse, value: float) -> Pulse:
        """Return the pulse that begins at another instant [s]."""
        return Pulse(value, value + (pulse.stop - pulse.start))


# Name of a field or key, an index, one of several parts, an entry of a weight, a pulse's onset.
Step = str | int | Member | Entry | Onset
Steps = tuple[Step, ...]
# Steps to a value, and the value.
Change = tuple[Steps, Any]


def value_at(whole: Any, steps: Iterable[Step]) -> Any:
    """Return the value at some steps inside an object; None where a part is not there."""
    value: Any = whole
    for step in steps:
        if value is None:
            return None
        if isinstance(step, str):
            value = value.get(step) if isinstance(value, dict) else getattr(value, step, None)
        elif isinstance(step, Member):
            index = step.place_in(value)
            value = None if index is None else value[index]
        elif isinstance(step, int):
            value = value[step]
        else:
            reader: Any = step
            value = reader.read(value)
    return value


def with_values(whole: Any, changes: Sequence[Change]) -> Any:
    """Return a copy of an object with other values inside it; each part is made once.

    Args:
        whole: A dataclass, a tuple, or tables of a case file.
        changes: Steps to the values, and the values.

    Raises:
        GrosmcError: If a part is not there, or cannot have a value.
    """
    inner: dict[str | int | Member, list[Change]] = {}
    for steps, value in changes:
        if not steps:
            whole = value
        elif isinstance(steps[0], (Entry, Onset)):
            whole = steps[0].write(whole, value)
        else:
            inner.setdefault(steps[0], []).append((steps[1:], value))
    if not inner:
        return whole

    if isinstance(whole, (tuple, list)):
        return type(whole)(_with_members(whole, inner))
    if isinstance(whole, dict):
        return {**whole, **{step: _below(whole, step, deeper) for step, deeper in inner.items()}}

    values = {}
    for step, deeper in inner.items():
        before = getattr(whole, str(step), None)
        if before is None and deeper[0][0]:
            raise ArgumentError(f"there is no {step} that could be changed")
        values[str(step)] = with_values(before, deeper)
    if isinstance(whole, Table):
        return _with_keys(whole, values, changes)
    return with_fields(whole, values)


def with_fields(part: Any, values: Mapping[str, Any]) -> Any:
    """Return a copy of a dataclass with other fields, of which only the new ones are checked.

    A part has many fields: checking one takes a fifth of the time that all take.

    Raises:
        GrosmcError: If the part cannot have a value, or not together with its other fields.
    """
    kind = type(part)
    if not all(_is_checked(kind, name, value) for name, value in values.items()):
        return replace(part, **values)

    copy = object.__new__(kind)
    for item in fields(part):
        vars(copy)[item.name] = values.get(item.name, getattr(part, item.name))
    if hasattr(kind, "__post_init__"):
        copy.__post_init__()
    return copy


def differences(before: Any, after: Any) -> Iterator[Change]:
    """Yield the steps to each value that is another one after a change, with that value."""
    if before is after or before == after:
        return
    if type(before) is type(after) and is_dataclass(before):
        for item in fields(before):
            inner = differences(getattr(before, item.name), getattr(after, item.name))
            yield from (((item.name, *steps), value) for steps, value in inner)
    elif _has_parts(before) and _has_parts(after):
        yield from _differences_of_parts(before, after)
    elif isinstance(before, tuple) and isinstance(after, tuple) and len(before) == len(after):
        for index, (old, new) in enumerate(zip(before, after, strict=True)):
            yield from (((index, *steps), value) for steps, value in differences(old, new))
    else:
        yield (), after


def _differences_of_parts(before: Sequence[Any], after: Sequence[Any]) -> Iterator[Change]:
    """Yield the differences of parts that keep their order, and the parts that are added."""
    members = _members(before)
    if len(before) == len(after):
        pairs = list(zip(members, before, after, strict=True))
    else:
        pairs = [
            (step, value_at(before, [step]), part)
            for step, part in zip(_members(after), after, strict=True)
        ]
    for step, old, new in pairs:
        yield from (((step, *steps), value) for steps, value in differences(old, new))


def _members(parts: Sequence[Any]) -> list[Member]:
    """Return the step to each of several parts."""
    seen = Counter[tuple[type, str]]()
    members = []
    for part in parts:
        key = type(part), part.of
        members.append(Member(*key, seen[key]))
        seen[key] += 1
    return members


def _has_parts(value: object) -> bool:
    """Whether a value is a tuple of parts of one owner each."""
    return isinstance(value, tuple) and all(
        isinstance(getattr(part, "of", None), str) for part in value
    )


def _names(part: Any) -> tuple[str, ...]:
    """Return the names by which a part is known."""
    names = part.of if isinstance(part.of, tuple) else (part.of,)
    return (*names, getattr(part, "label", ""))


def _is_checked(kind: type, name: str, value: Any) -> bool:
    """Whether a value of a field needs no further check: a number in its range, or a part."""
    if isinstance(value, float):
        bounds = range_of(kind, name)
        return bounds is not None and bounds.holds(value)
    members = value if isinstance(value, tuple) else (value,)
    return all(map(is_dataclass, members))


def _below(whole: dict[Any, Any], key: Any, changes: Sequence[Change]) -> Any:
    """Return the value of a key of a file with changes inside it; a table is made if need be."""
    before = whole.get(key)
    if before is None and changes[0][0]:
        before = {}
    return with_values(before, changes)


def _with_keys(table: Table, values: Mapping[str, Any], changes: Sequence[Change]) -> Table:
    """Return a table of a case file with other keys; of the whole file its content has them too."""
    copy = table.model_copy(update=values)
    if isinstance(copy, CaseFile):
        copy._content = with_values(copy.content, changes)
    return copy


def _with_members(parts: Sequence[Any], inner: Mapping[Any, list[Change]]) -> list[Any]:
    """Return parts of which some have other values."""
    changed = list(parts)
    for step, changes in inner.items():
        index = step
        if isinstance(step, Member):
            index = step.place_in(changed)
        if isinstance(index, int):
            changed[index] = with_values(changed[index], changes)
            continue

        assert isinstance(step, Member)
        part = _made(step, changes)
        # Edits of the model stand before the parts of the machine, as in a file.
        last = len(changed)
        if not isinstance(part, MachinePart):
            last = sum(not isinstance(other, MachinePart) for other in changed)
        changed.insert(last, part)
    return changed


def _made(step: Member, changes: Sequence[Change]) -> Any:
    """Return a part that is not there yet.

    Raises:
        ArgumentError: If none may be made.
    """
    if not changes[0][0]:
        return changes[-1][1]
    if step.new is None:
        kind = getattr(step.kind, "kind", step.kind.__name__.lower())
        raise ArgumentError(f"there is no {kind} of {step.name!r} that could be changed")
    values = {str(name): value for (name,), value in changes}
    return step.kind(step.name, **dict(step.new), **values)


def _with_item(items: Sequence[Any], index: int, value: Any) -> list[Any]:
    """Return a list with another item."""
    return [*items[:index], value, *items[index + 1 :]]
