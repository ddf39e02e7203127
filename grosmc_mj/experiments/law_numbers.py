"""Numbers of laws, tasks and requirements, which are made from the tables of the case file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from grosmc_mj.experiments.file.numbers import UNITS
from grosmc_mj.experiments.file.paths import Place
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.experiments.laws.packaged import kinds_of, numbers_of
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.steps import Entry, Steps, value_at
from grosmc_mj.ground.errors import ArgumentError, unknown_name
from grosmc_mj.ground.fields import Range
from grosmc_mj.ground.units import is_number
from grosmc_mj.theory.control.kinds.kind import WEIGHTS
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.switching import SWITCHINGS, SwitchingNumbers

# Owners whose tables laws and requirements are made from when they are asked for.
OF_FILE = ("task", "laws", "controller", "requirement", "claim")
# Numbers of a law that the task may have for all of them.
_OF_TASK = {*WEIGHTS, "slope"}
# Keys of a requirement that are times.
_TIMES = {"after", "from", "to", *(kind.key for kind in KINDS if kind.quantity == "s")}
# A number that is written as a text, with its unit.
_WITH_UNIT = re.compile(r"\s*[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(\D.*)", re.DOTALL)


class TableNumber(NamedTuple):
    """A number of a table, with the fields of a ``Number``."""

    unit: str
    bounds: Range
    steps: Steps
    inherited: tuple[Steps, ...] = ()
    default: float | None = None


def number_of_table(case: Any, path: str, place: Place) -> TableNumber | None:
    """Return the number at a place in the file's tables; None for a text, a list or a switch.

    Args:
        case: The experiment.
        path: Path of the number, for messages.
        place: Its place.

    Raises:
        ArgumentError: If a law has no such number, or a weight no such entry.
    """
    tables = _tables(case, place)
    law = None
    keys: Sequence[str | int] = place.keys
    if place.owner == "laws":
        law = str(place.keys[0])
        keys = place.keys[1:]
    if place.owner == "controller":
        law = place.name
    if not keys:
        return None

    default = None
    bounds = None
    if law is not None:
        key = str(keys[0])
        _refuse_unknown(case, path, law, key)
        declared = {**numbers_of_law(case, law), **WEIGHTS}
        if key in declared and (len(keys) == 1 or key in WEIGHTS):
            bounds = declared[key]
            default = _default_of(case, law, key)

    inner = _inner_steps(case, path, law or "", tables, keys)
    first, *others = [(*table, *inner) for table in tables]
    value = first_value(case, [first, *others])
    unit = _unit(str(keys[-1]), value)
    if bounds is not None and bounds.unit and isinstance(bounds.unit, str):
        unit = bounds.unit
    is_known = value is None and bounds is not None
    if is_number(value) or (unit and isinstance(value, str)) or is_known:
        bounds = replace(bounds or Range(), unit=unit)
        return TableNumber(unit, bounds, first, tuple(others), default)
    return None


def first_value(case: Any, alternatives: Sequence[Steps]) -> Any:
    """Return the first value that is there at some steps; None if none is."""
    for steps in alternatives:
        value = value_at(case, steps)
        if value is not None:
            return value
    return None


def _tables(case: Any, place: Place) -> list[Steps]:
    """Return the steps to the table of a place, then to those whose numbers count without its own.

    A controller has the numbers of the law that it names, a law the weights and the slope of the
    task.
    """
    if place.owner == "laws":
        tables: list[Steps] = [("file", "laws", place.keys[0])]
    elif place.row is not None:
        tables = [("file", place.owner, place.row)]
    else:
        return [("file", place.owner)]

    if place.owner == "controller":
        base = value_at(case, (*tables[0], "law"))
        if base in case.file.laws:
            tables.append(("file", "laws", base))
    if _OF_TASK & {*place.keys}:
        tables.append(("file", "task"))
    return tables


def numbers_of_law(case: Any, name: str) -> Mapping[str, LawNumber]:
    """Return the numbers of a law of the package by their keys; none of a law of the user's own.

    Args:
        case: The experiment.
        name: Name of a controller of the file, or of a law.
    """
    table = case.file.law(name)
    kind = kinds_of(case.nominal).get(table.law)
    if kind is None:
        return {}
    return numbers_of(kind, table.switching)


def tunable_numbers(case: Any, name: str) -> Mapping[str, LawNumber]:
    """Return what a search may change of a law of the package, by the keys in its table.

    Each key has its bounds, the range of a search and its scale. Of numbers that exclude each
    other those of the file's way are there. ``Q`` and ``R`` stand for all their entries, which
    ``named_weights`` lists.

    Args:
        case: The experiment.
        name: Name of a controller of the file, or of a law.
    """
    table = case.file.law(name)
    kind = kinds_of(case.nominal).get(table.law)
    if kind is None:
        return {}
    numbers = dict(kind.tunable(kind.way_of(table.numbers)))
    if kind.switches:
        numbers.update(SWITCHINGS[table.switching].numbers)
    return numbers


def _refuse_unknown(case: Any, path: str, law: str, key: str) -> None:
    """Refuse a key that a law of the package does not have.

    Raises:
        ArgumentError: With the nearest one.
    """
    kind = kinds_of(case.nominal).get(case.file.law(law).law)
    if kind is None:
        return
    keys = [*kind.field_names(), *numbers_of_law(case, law), *kind.weights]
    if keys and key not in (*keys, *WEIGHTS, *ControllerTable.model_fields):
        raise ArgumentError(f"{path!r}: {unknown_name('number', key, dict.fromkeys(keys))}")


def _default_of(case: Any, name: str, key: str) -> float | None:
    """Return the value of a number of a law that its table does not give; None if it must."""
    table = case.file.law(name)
    kind = kinds_of(case.nominal).get(table.law)
    if kind is None:
        return None
    if kind.switches and key in SWITCHINGS[table.switching].numbers:
        return getattr(SwitchingNumbers(), key)
    return kind.defaults().get(key)


def _unit(key: str, value: Any) -> str:
    """Return the unit of a number: that of the law's numbers, or else as it is written."""
    if key in UNITS:
        return UNITS[key]
    if key in _TIMES:
        return "s"
    match = _WITH_UNIT.fullmatch(value) if isinstance(value, str) else None
    return match[1] if match else ""


def _inner_steps(
    case: Any, path: str, law: str, tables: Sequence[Steps], keys: Sequence[str | int]
) -> Steps:
    """Return the steps from a table to a number, which may be an entry of a weight.

    Raises:
        ArgumentError: If there is no such entry.
    """
    key, *inner = keys
    if key not in WEIGHTS or len(inner) != 1:
        return tuple(keys)

    (entry,) = inner
    weight = first_value(case, [(*table, key) for table in tables])
    names: tuple[str, ...] = ()
    if isinstance(weight, dict) and entry in weight:
        names = (str(entry),)
    elif isinstance(entry, str) or not isinstance(weight, list):
        names = tuple(_names_of_entries(case, law or case.controllers[0], str(key)))
    if isinstance(entry, int):
        count = len(names or weight)
        if entry >= count:
            raise ArgumentError(f"{path!r}: {key} has {count} entries, counted from 1")
        return key, Entry(entry, names)
    if entry not in names:
        raise ArgumentError(f"{path!r}: {unknown_name('entry', entry, names)}")
    return key, Entry(names.index(entry), names)


def _names_of_entries(case: Any, law: str, key: str) -> Sequence[str]:
    """Return the names of what a weight of a law weighs: error state or inputs."""
    design = case.law(case.plant_names[0], law).designed
    if key == "Q":
        return design.error.names
    return design.error.input_names(linearizing=design.linearizing)
