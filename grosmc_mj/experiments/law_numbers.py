"""Numbers of laws, tasks and requirements, which are made from the tables of the case file."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any, NamedTuple, get_args, get_type_hints

from grosmc_mj.experiments.file.numbers import UNITS
from grosmc_mj.experiments.file.paths import Place
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.experiments.laws import laws_of
from grosmc_mj.experiments.requirements import KINDS
from grosmc_mj.experiments.steps import Entry, Steps, value_at
from grosmc_mj.ground.errors import ArgumentError, unknown_name
from grosmc_mj.ground.fields import Range
from grosmc_mj.ground.units import is_number

# Owners whose tables laws and requirements are made from when they are asked for.
OF_FILE = ("task", "laws", "controller", "requirement", "claim")
_WEIGHTS = ("Q", "R")
# Arguments of a law that are no numbers.
_NO_NUMBERS = ("name", "linearizing")
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
    if law is not None and keys[0] not in _WEIGHTS:
        maker = laws_of(case.nominal).get(case.file.law(law).law)
        numbers = {} if maker is None else _numbers_of(maker)
        if numbers and keys[0] not in (*numbers, *ControllerTable.model_fields):
            line = unknown_name("number", keys[0], [*numbers, *_WEIGHTS])
            raise ArgumentError(f"{path!r}: {line}")
        if len(keys) == 1:
            default, bounds = numbers.get(str(keys[0]), (None, None))

    inner = _inner_steps(case, path, law or "", tables, keys)
    first, *others = [(*table, *inner) for table in tables]
    value = first_value(case, [first, *others])
    unit = _unit(str(keys[-1]), value)
    is_known = value is None and bounds is not None
    if is_number(value) or unit or is_known:
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

    A controller has the numbers of the law that it names, a law the weights of the task.
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
    if set(_WEIGHTS) & {*place.keys}:
        tables.append(("file", "task"))
    return tables


# Signatures are slow to read, and each number of a law is asked for often.
@cache
def _numbers_of(maker: Any) -> Mapping[str, tuple[float | None, Range]]:
    """Return the numbers of a law of the package: defaults and ranges.

    A number without default must be given, or is computed from others.
    """
    function = maker.func if isinstance(maker, partial) else maker
    hints = get_type_hints(function, include_extras=True)
    _, *parameters = inspect.signature(maker).parameters.values()
    numbers = {}
    for item in parameters:
        if item.name not in _NO_NUMBERS:
            default = float(item.default) if is_number(item.default) else None
            numbers[item.name] = (default, _range_in(hints[item.name]))
    return numbers


def _range_in(hint: Any) -> Range:
    """Return the range in a type, which may be optional; without bounds if it has none."""
    for part in (hint, *get_args(hint)):
        for note in getattr(part, "__metadata__", ()):
            if isinstance(note, Range):
                return note
    return Range()


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
    if key not in _WEIGHTS or len(inner) != 1:
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
