"""Keys of a table of a case file that is read as a checked dataclass: its fields.

The annotations of a field say all that is known of its key: bounds and unit of a number, its name
where it is another one. A new field is a new key.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from functools import cache
from typing import Any, get_type_hints

from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.fields import KeyName, Numbers, OwnerUnit, Range, notes_on
from grosmc_mj.ground.units import number_in, si_number
from grosmc_mj.theory.plants import System


@dataclass(frozen=True)
class Key:
    """A key of a table.

    Attributes:
        name: Name of the key.
        field: Name of the field.
        hint: Type of the field.
        bounds: Bounds and unit of a number; None for anything else.
        vector: Count and unit of several numbers; None for anything else.
        required: Whether a table must have it.
        default: Value of a table that does not have it.
    """

    name: str
    field: str
    hint: Any
    bounds: Range | None
    vector: Numbers | None
    required: bool
    default: Any

    @property
    def has_unit(self) -> bool:
        """Whether it is a number that is written with its unit or is a pure one; no whole one."""
        return self.bounds is not None and not self.bounds.whole

    def in_si(self, value: Any, system: System, of: str) -> Any:
        """Return a value of a file as the field has it.

        Args:
            value: Value in the file.
            system: System of the plant.
            of: Name of the owner of the table, on which a unit may depend.

        Raises:
            ArgumentError: If a unit is missing, unknown or does not fit.
        """
        if self.vector is not None:
            return _entries(value, self.vector)
        if self.bounds is not None and not self.bounds.whole:
            return _number(value, self.bounds, system, of)
        if isinstance(value, list):
            return tuple(value)
        return value


def _entries(value: Any, vector: Numbers) -> tuple[float, ...]:
    """Return the numbers of a list in their unit."""
    if not isinstance(value, list) or len(value) != vector.count:
        raise ArgumentError(f"{value_text(value)} must be a list of {vector.count} numbers")
    return tuple(number_in(entry, vector.unit) for entry in value)


def _number(value: Any, bounds: Range, system: System, of: str) -> float:
    """Return a number in the unit of its bounds; of several units that may be meant, the first."""
    read = si_number if bounds.bare else number_in
    if not isinstance(bounds.unit, OwnerUnit):
        return read(value, bounds.unit)
    first, *others = bounds.unit.choices(system, of)
    for unit in others:
        try:
            return read(value, unit)
        except ArgumentError:
            continue
    return read(value, first)


# Asked for each table that is read; it reads type hints.
@cache
def keys_of(kind: type) -> dict[str, Key]:
    """Return the keys of a checked dataclass by their names, in the order of its fields."""
    hints = get_type_hints(kind, include_extras=True)
    keys = {}
    for item in fields(kind):
        key = _key(item.name, hints[item.name], item.default)
        if key.name:
            keys[key.name] = key
    return keys


def _key(field: str, hint: Any, default: Any) -> Key:
    """Return the key of a field."""
    name = field
    bounds = None
    vector = None
    for note in notes_on(hint):
        if isinstance(note, KeyName):
            name = note.name
        elif isinstance(note, Range):
            bounds = note
        elif isinstance(note, Numbers):
            vector = note
    required = default is MISSING
    return Key(name, field, hint, bounds, vector, required, None if required else default)


def key_name(kind: type, field: str) -> str:
    """Return the name of the key of a field."""
    return next(name for name, key in keys_of(kind).items() if key.field == field)
