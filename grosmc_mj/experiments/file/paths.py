"""Places in a case file by path: OWNER.NAME.FIELD, such as ``edit.pole.mass``.

OWNER is a table of the file. NAME is the body, joint, input, state, law or label by which one of
several tables is known; two tables of one name need an index, ``edit.pole[2].mass``, and tables
without a name have the index alone, ``requirement[1].settles_within``. Tables that a file has once
need no name: ``run.duration``, ``run.start.pole angle``, ``laws.grosmc.k``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.parts import PART_KINDS
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, unknown_name, value_text

# Keys that name a table among several of a kind.
_NAMED_BY: Mapping[str, tuple[str, ...]] = {
    "controller": ("name", "law"),
    "requirement": (),
    "claim": (),
    "uncertain": ("name",),
    "correlation": (),
    **{kind.name: kind.owners for kind in PART_KINDS.values() if kind.owners},
    "disturbance": ("label", *PART_KINDS["disturbance"].owners),
}
# Tables that a file need not have: the numbers of the nominal model, and estimators of rates.
_ADDED = ("edit", "estimator")
# A path into one of several tables.
_TABLE = re.compile(r"(\w+)(?:\[(\d+)\])?(?:\.(.+?)(?:\[(\d+)\])?)?\.([^.\[\]]+)")
# A key of a table that a file has once, with the indices of a list.
_KEY = re.compile(r"([^\[\]]+)((?:\[\d+\])*)")
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
    """Place of a value in the content of a case file.

    Attributes:
        owner: Name of the table, or of the tables if there may be several.
        keys: Keys, and indices from 0, from there to the value.
        name: Name of one of several tables; empty where the file has the table once.
        row: Index of that table among all of its owner; None if the file does not have it.
        nth: Number of tables before it that are read as the same kind of part, with the same name.
        new: Keys of a table that is added if the file does not have it.
    """

    owner: str
    keys: tuple[str | int, ...]
    name: str = ""
    row: int | None = None
    nth: int = 0
    new: Mapping[str, Any] | None = None

    @property
    def field(self) -> str:
        """Key of the value; of an item of a list that of the list."""
        return [key for key in self.keys if isinstance(key, str)][-1]

    @property
    def in_weight(self) -> bool:
        """Whether it is an entry of Q or R, which a table may inherit as a whole."""
        return len(self.keys) > 1 and self.keys[-2] in ("Q", "R")

    def table(self, content: Content) -> Content:
        """Return the table in a content, which is added if it is not there."""
        if self.row is not None:
            return content[self.owner][self.row]
        if self.new is None:
            return content.setdefault(self.owner, {})

        rows = content.setdefault(self.owner, [])
        for row in rows:
            # A mass that is added is an edit of its own.
            apart = "added_mass" in self.keys or "added_mass" in row
            if self.new.items() <= row.items() and not row.get("known") and not apart:
                return row
        rows.append(dict(self.new))
        return rows[-1]

    def write(self, content: Content, value: Any) -> None:
        """Give the content another value at this place.

        Raises:
            ArgumentError: If a table on the way there is none, or a list too short.
        """
        table: Any = self.table(content)
        *outer, last = self.keys
        for key in outer:
            inner: Any = table.setdefault(key, {}) if isinstance(table, dict) else table[key]
            if not isinstance(inner, (dict, list)):
                raise ArgumentError(f"{self.owner}: {key} is {value_text(inner)}, no table")
            table = inner
        table[last] = value
        if last == "resolution":
            # Counts of an encoder are the same number.
            table.pop("counts", None)


def place_of(content: Content, path: str) -> Place:
    """Return the place of a path in the content of a case file.

    Args:
        content: Values of the file.
        path: Path OWNER.NAME.FIELD.

    Raises:
        ArgumentError: If there is no such table, or several of the name.
    """
    owner = re.split(r"[.\[]", path)[0]
    if owner in _ELSEWHERE:
        raise ArgumentError(f"{path!r}: a case file has it as {_ELSEWHERE[owner]}")
    require_known("owner", owner, CaseFile.model_fields, f"{path!r}: ")
    if owner in _NAMED_BY:
        return _place_in_tables(content, path)

    _, *words = path.split(".")
    if not words:
        raise ArgumentError(f"{value_text(path)} must be {FORM}")
    keys = [key for word in words for key in _keys(word, path)]
    if owner == "laws" and len(keys) > 1:
        return _place_in_law(content, path, keys)
    return Place(owner, tuple(keys))


def _keys(word: str, path: str) -> list[str | int]:
    """Return a key with the indices after it, which count from 1 in a path.

    Raises:
        ArgumentError: If the word has another form.
    """
    match = _KEY.fullmatch(word)
    indices = [] if match is None else [int(text) - 1 for text in re.findall(r"\d+", match[2])]
    if match is None or -1 in indices:
        raise ArgumentError(f"{value_text(path)} must be {FORM}")
    return [match[1], *indices]


def _place_in_law(content: Content, path: str, keys: list[str | int]) -> Place:
    """Return the place of a number of a law: in its [laws.NAME], or in its [[controller]].

    Raises:
        ArgumentError: If there is no such law.
    """
    laws = content.get("laws", {})
    name, *inner = keys
    rows = content.get("controller", [])
    controllers = [_names(row, "controller")[0] for row in rows]
    if name not in laws and name in controllers:
        row = controllers.index(name)
        return Place("controller", tuple(inner), str(name), row)
    require_known("law", name, dict.fromkeys([*laws, *controllers]), f"{path!r}: ")
    return Place("laws", tuple(keys))


def _place_in_tables(content: Content, path: str) -> Place:
    """Return the place in one of several tables.

    Raises:
        ArgumentError: As ``place_of``.
    """
    match = _TABLE.fullmatch(path)
    if match is None:
        raise ArgumentError(f"{value_text(path)} must be {FORM}")
    owner, index_of_owner, name, index_of_name, field = match.groups()
    name = name or ""
    index = index_of_name or index_of_owner

    rows = content.get(owner, [])
    named = [i for i, row in enumerate(rows) if not name or _is_of(row, owner, name, field)]
    if index is None:
        named = [i for i in named if not rows[i].get("known")]
    if named:
        table = path.removesuffix(f".{field}")
        row = _only(named, int(index) if index else None, path, f"{table}[{{}}].{field}")
        name = name or "".join(_names(rows[row], owner)[:1])
        before = [other for other in rows[:row] if _is_of(other, owner, name, field)]
        nth = len([other for other in before if not other.get("known")])
        return Place(owner, (field,), name, row, nth)
    return _place_of_new_table(content, path, owner, name, field, index)


def _place_of_new_table(
    content: Content,
    path: str,
    owner: str,
    name: str,
    field: str,
    index: str | None,
) -> Place:
    """Return the place in a table that the file does not have yet.

    Raises:
        ArgumentError: If a file must have such a table.
    """
    kind = edited_by(path, field) if owner == "edit" else ""
    rows = content.get(owner, [])
    if owner in _ADDED and name and index is None:
        return Place(owner, (field,), name, new={kind or _NAMED_BY[owner][0]: name})

    names = [name for row in rows for name in _names(row, owner)]
    if not rows:
        raise ArgumentError(f"{path!r}: the case file has no [[{owner}]]: write one")
    if not names:
        raise ArgumentError(
            f"{path!r}: no [[{owner}]] has a name: count them, as in {owner}[1].{field}"
        )
    if name in names:
        raise ArgumentError(f"{path!r}: there is no such [[{owner}]] of {name!r}")
    raise ArgumentError(f"{path!r}: {unknown_name(owner, name, dict.fromkeys(names))}")


def _is_of(row: Content, owner: str, name: str, field: str) -> bool:
    """Whether a table has a name and, of an edit, is of the kind that has a field.

    One body may have two edits: of itself, and of a mass that is added to it.
    """
    if name not in _names(row, owner):
        return False
    if owner != "edit":
        return True
    adds = field in ("added_mass", "at")
    return edited_by(field, field) in row and ("added_mass" in row) == adds


def edited_by(path: str, field: str) -> str:
    """Return the kind of thing that an edit changes: body, joint, input or parameter.

    Raises:
        ArgumentError: If no edit has such a key.
    """
    edit = PART_KINDS["edit"]
    for form in edit.forms:
        if field in form.keys:
            return form.owner
    valid = [key for key in edit.keys if key not in edit.owners]
    raise ArgumentError(f"{path!r}: {unknown_name('key', field, valid)}")


def _only(rows: list[int], index: int | None, path: str, with_index: str) -> int:
    """Return the row of a path, by its index if there are several.

    Raises:
        ArgumentError: If there are several and no index, or none of the index.
    """
    if index is None and len(rows) == 1:
        index = 1
    if index is None:
        paths = " or ".join(with_index.format(i + 1) for i in range(len(rows)))
        raise ArgumentError(f"{path!r}: there are {len(rows)} such tables: write {paths}")
    if not 0 < index <= len(rows):
        raise ArgumentError(f"{path!r}: there are {len(rows)} such tables, counted from 1")
    return rows[index - 1]


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
