"""Numbers of a case file by path: OWNER.NAME.FIELD, such as ``edit.pole.mass``.

OWNER is a table of the file. NAME is the body, joint, input, state, law or label by which one of
several tables is known; two tables of one name need an index, ``edit.pole[2].mass``, and tables
without a name have the index alone, ``requirement[1].settles_within``. Tables that a file has once
need no name: ``run.duration``, ``run.start.pole angle``, ``laws.grosmc.k``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.parts import MACHINE_PARTS
from grosmc_mj.experiments.file.schema import EDITED, CaseFile
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, name_list, unknown_name, value_text

# Keys that name a table among several of a kind.
_NAMED_BY: Mapping[str, tuple[str, ...]] = {
    "edit": tuple(EDITED),
    "disturbance": ("label", "body", "input", "measured", "state"),
    "sensor": ("of",),
    "estimator": ("of",),
    "actuator": ("of",),
    "controller": ("name", "law"),
    "requirement": (),
    "claim": (),
    "uncertain": ("name",),
    "correlation": (),
    **{kind: (part.owner,) for kind, part in MACHINE_PARTS.items()},
}
# A path into one of several tables.
_TABLE = re.compile(r"(\w+)(?:\[(\d+)\])?(?:\.(.+?)(?:\[(\d+)\])?)?\.([^.\[\]]+)")
# Owners of numbers that stand in another table.
_ELSEWHERE = {
    "body": "edit.NAME.FIELD",
    "joint": "edit.NAME.FIELD",
    "input": "edit.NAME.FIELD",
    "parameter": "edit.NAME.scale",
    "start": "run.start.STATE",
}
FORM = (
    "a path OWNER.NAME.FIELD of a case file, such as edit.pole.mass, sensor.pole angle.delay, "
    "laws.grosmc.k or run.duration"
)


@dataclass(frozen=True)
class Place:
    """Place of a number in one of several tables of a kind.

    Attributes:
        owner: Name of the tables.
        name: Name of the table; empty for one that has an index alone.
        index: Index among the tables of this name, from 1; None for the only one.
        field: Key in the table.
    """

    owner: str
    name: str
    index: int | None
    field: str

    def __str__(self) -> str:
        """Path of the number."""
        table = f"{self.owner}.{self.name}" if self.name else self.owner
        index = "" if self.index is None else f"[{self.index}]"
        return f"{table}{index}.{self.field}"


def set_number(content: Content, path: str, value: Any) -> None:
    """Give a case file another number.

    Args:
        content: Values of the file, which are changed.
        path: Path of the number.
        value: Number in the unit of the file's key, or a text with a unit.

    Raises:
        ArgumentError: If there is no such table, or several of the name.
    """
    owner = re.split(r"[.\[]", path)[0]
    if owner in _ELSEWHERE:
        raise ArgumentError(f"{path!r}: a case file has it as {_ELSEWHERE[owner]}")
    require_known("owner", owner, CaseFile.model_fields, f"{path!r}: ")
    if owner not in _NAMED_BY:
        _set_in_table(content, path, value)
        return

    set_in_tables(content, place_of(path), value)


def set_in_tables(content: Content, place: Place, value: Any, *, add: bool = False) -> None:
    """Give one of several tables of a case file another number.

    Args:
        content: Values of the file, which are changed.
        place: Place of the number.
        value: The number.
        add: Whether a table that the file does not have is added; an edit always is.

    Raises:
        ArgumentError: If there is no such table, or several of the name.
    """
    rows = content.setdefault(place.owner, [])
    named = _named(rows, place)
    if named:
        table = _only(named, place)
    elif place.owner == "edit" and place.index is None:
        table = {edited_by(place): place.name}
        rows.append(table)
    elif add:
        table = {_NAMED_BY[place.owner][0]: place.name}
        rows.append(table)
    else:
        names = [name for row in rows for name in _names(row, place.owner)]
        there = name_list(dict.fromkeys(names)) if names else "none"
        raise ArgumentError(
            f"{str(place)!r}: the case file has no [[{place.owner}]] of {place.name!r}; it has "
            f"{there}"
        )

    table[place.field] = value
    if place.field == "resolution":
        # Counts of an encoder are the same number.
        table.pop("counts", None)


def place_of(path: str) -> Place:
    """Return the place in one of several tables.

    Raises:
        ArgumentError: If the path has another form.
    """
    match = _TABLE.fullmatch(path)
    if match is None:
        raise ArgumentError(f"{value_text(path)} must be {FORM}")
    owner, index_of_owner, name, index_of_name, field = match.groups()
    index = index_of_name or index_of_owner
    return Place(owner, name or "", int(index) if index else None, field)


def edited_by(place: Place) -> str:
    """Return the kind of thing that an edit changes: body, joint, input or parameter.

    Raises:
        ArgumentError: If no edit has such a key.
    """
    for kind, keys in EDITED.items():
        if place.field in keys:
            return kind
    valid = [key for keys in EDITED.values() for key in keys]
    raise ArgumentError(f"{str(place)!r}: {unknown_name('key', place.field, valid)}")


def _set_in_table(content: Content, path: str, value: Any) -> None:
    """Set a value in a table that a file has once, in tables inside it too."""
    *tables, field = path.split(".")
    if not tables:
        raise ArgumentError(f"{value_text(path)} must be {FORM}")
    table = content
    if tables[0] == "laws" and len(tables) > 1:
        require_known("law", tables[1], content.get("laws", {}), f"{path!r}: ")
    for key in tables:
        table = table.setdefault(key, {})
        if not isinstance(table, dict):
            raise ArgumentError(f"{path!r}: {key} is {value_text(table)}, which has no {field}")
    table[field] = value


def _named(rows: list[Content], place: Place) -> list[Content]:
    """Return the tables of a name.

    Without an index, edits that laws know are none of them, and a mass that is added is an edit of
    its own.
    """
    named = [row for row in rows if not place.name or place.name in _names(row, place.owner)]
    if place.owner == "edit" and place.index is None:
        adds = place.field in ("added_mass", "at")
        named = [row for row in named if not row.get("known") and ("added_mass" in row) == adds]
    return named


def _only(named: list[Content], place: Place) -> Content:
    """Return the table of a name, by its index if there are several.

    Raises:
        ArgumentError: If there are several and no index, or none of the index.
    """
    index = place.index
    if index is None and len(named) == 1:
        index = 1
    if index is None:
        paths = " or ".join(str(replace(place, index=i + 1)) for i in range(len(named)))
        raise ArgumentError(f"{str(place)!r}: there are {len(named)} such tables: write {paths}")
    if not 0 < index <= len(named):
        raise ArgumentError(f"{str(place)!r}: there are {len(named)} such tables, counted from 1")
    return named[index - 1]


def _names(row: Content, owner: str) -> list[str]:
    """Return the names by which a table is known."""
    names: list[str] = []
    for key in _NAMED_BY[owner]:
        value = row.get(key)
        if isinstance(value, list):
            names += value
        elif value:
            names.append(value)
    return names
