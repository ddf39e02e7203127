"""Tables of a case file with a part: a sensor, a motor, an edit, a disturbance.

A kind of table has one form, or one for each owner that it may name. The form's class has the keys:
a table is checked against them when the file is read, and ``read`` makes the part of it when the
system, on which units depend, is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args

from grosmc_mj.experiments.file.former_keys import written_today
from grosmc_mj.experiments.file.keys import Key, keys_of
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, Mistakes, unknown_name, value_text
from grosmc_mj.ground.refusals import refusal
from grosmc_mj.ground.units import example_in
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.theory.plants import System

Values = dict[str, Any]
ASSUMED = "assumed"


@dataclass(frozen=True)
class Form:
    """A form of a table: the class that it is read as.

    Attributes:
        part: Checked dataclass, whose fields are the keys.
        owner: Key with the name of the state, input, joint or body; empty for the computer.
        further: Checked dataclass of further keys that need no system; None for none.
        choices: Checked dataclasses of which the table has the numbers of one, such as profiles.
        adapt: Function that puts values of further keys into those of the part.
    """

    part: type
    owner: str
    further: type | None = None
    choices: tuple[type, ...] = ()
    adapt: Callable[[Values, System], Values] | None = None

    @cached_property
    def keys(self) -> dict[str, Key]:
        """All keys by their names, those of the part first."""
        keys = dict(keys_of(self.part))
        for kind in self.choices:
            keys.update(keys_of(kind))
        if self.further is not None:
            keys.update(keys_of(self.further))
        return keys

    @cached_property
    def required(self) -> list[str]:
        """Names of the keys that a table must have."""
        return [name for name, key in keys_of(self.part).items() if key.required]

    @property
    def keys_in_words(self) -> str:
        """The required keys, then all others."""
        line = f"required: {', '.join(self.required)}"
        others = [name for name in self.keys if name not in self.required]
        if others:
            line += f"; further keys: {', '.join(others)}"
        return line

    @cached_property
    def numbers(self) -> list[str]:
        """Names of the part's numbers; whole ones are none."""
        return [name for name, key in keys_of(self.part).items() if key.has_unit]


@dataclass(frozen=True)
class PartTable:
    """A table whose keys are checked; its numbers are as they are written.

    Attributes:
        form: Form of the table.
        values: Values by key.
        further: Further keys, as the form's ``further``; None for a form without.
        assumed: Names of the numbers that nobody has published.
    """

    form: Form
    values: Mapping[str, Any]
    further: Any = None
    assumed: tuple[str, ...] = ()

    @property
    def of(self) -> tuple[str, ...]:
        """Names of its states, or of its input, joint or body; empty for the computer."""
        name = self.values.get(self.form.owner, ())
        return (name,) if isinstance(name, str) else tuple(name)

    @property
    def numbers(self) -> list[str]:
        """Names of the numbers of the part that it gives."""
        return [name for name in self.form.numbers if name in self.values]

    def document(self) -> Values:
        """Return the table as it is written."""
        if self.assumed:
            return {**self.values, ASSUMED: list(self.assumed)}
        return dict(self.values)


@dataclass(frozen=True)
class PartKind:
    """A kind of table.

    Attributes:
        name: Name of the tables.
        forms: Forms, of which a table has one.
        assumes: Whether a table may list numbers that nobody has published.
    """

    name: str
    forms: tuple[Form, ...]
    assumes: bool = False

    @cached_property
    def keys(self) -> list[str]:
        """Names of the keys of all forms."""
        keys = dict.fromkeys(name for form in self.forms for name in form.keys)
        if self.assumes:
            keys[ASSUMED] = None
        return list(keys)

    @cached_property
    def owners(self) -> tuple[str, ...]:
        """Keys of which a table has one, with the name of its owner; none of the computer."""
        return tuple(dict.fromkeys(form.owner for form in self.forms if form.owner))

    @property
    def part(self) -> type:
        """Class of a kind with one form."""
        (form,) = self.forms
        return form.part

    def table(self, value: Any) -> PartTable:
        """Check the keys of a table.

        Args:
            value: Value in the file.

        Raises:
            PydanticCustomError: If it is no table.
            ArgumentError: For all keys that are unknown, or missing.
        """
        if not isinstance(value, dict):
            raise refusal("a table")
        self._refuse_unknown(value)
        form = self._form(value)
        missing = [name for name in form.required if name not in value]
        mistakes = Mistakes()
        for name in missing:
            # The keys once, however many are missing.
            keys = f"; {form.keys_in_words}" if name == missing[-1] else ""
            mistakes.note(f"{_missing_words(name, form.keys[name])}{keys}")
        mistakes.refuse()
        _refuse_owner(value, form)

        values = {name: item for name, item in value.items() if name != ASSUMED}
        assumed = tuple(_assumed(value.get(ASSUMED, []), form, values))
        further = None
        if form.further is not None:
            given = keys_of(form.further).keys() & values.keys()
            further = form.further(**{name: values[name] for name in given})
        return PartTable(form, values, further, assumed)

    def _refuse_unknown(self, value: Values) -> None:
        """Refuse unknown keys: each with the nearest one, or with what replaces it."""
        mistakes = Mistakes()
        for key in value:
            if key not in self.keys:
                today = written_today(self.name, key, value[key])
                mistakes.note(today or unknown_name("key", key, self.keys))
        mistakes.refuse()

    def _form(self, value: Values) -> Form:
        """Return the form of a table: that of the owner that it names, with all of its keys."""
        if len(self.forms) == 1:
            return self.forms[0]
        named = [owner for owner in self.owners if owner in value]
        if len(named) != 1:
            raise ArgumentError(f"name one of {', '.join(self.owners)}, not {named or 'none'}")

        owner = named[0]
        forms = [form for form in self.forms if form.owner == owner]
        _refuse_misplaced(value, owner, forms)
        for form in forms:
            if value.keys() <= form.keys.keys():
                return form
        for form in forms:
            lacking = [name for name in form.required if name not in value]
            if lacking:
                others = set[str]().union(*(other.keys for other in forms if other is not form))
                own = sorted(value.keys() & form.keys.keys() - others)
                raise ArgumentError(f"{', '.join(own)} is for {lacking[0]}: give it one")
        raise ArgumentError(
            f"{' and '.join(sorted(value.keys() - {owner}))} are not of one {self.name}: write two "
            f"[[{self.name}]]"
        )


def _refuse_misplaced(value: Values, owner: str, forms: Sequence[Form]) -> None:
    """Refuse keys of other owners."""
    valid = list(dict.fromkeys(name for form in forms for name in form.keys if name != owner))
    misplaced = sorted(value.keys() - {owner, *valid})
    if misplaced:
        article = "an" if owner[0] in "ae" else "a"
        raise ArgumentError(
            f"{article} {owner} has no {', '.join(misplaced)}; valid: {', '.join(valid)}"
        )


def _missing_words(name: str, key: Key) -> str:
    """Return the words on a missing key: how a number with a unit is written."""
    line = f"{name} is missing"
    unit = "" if key.bounds is None else key.bounds.unit
    if unit and isinstance(unit, str):
        line += f': write it as in {name} = "{example_in(unit)}"'
    return line


def _refuse_owner(value: Values, form: Form) -> None:
    """Refuse an owner that is no name; an estimator may have several."""
    if not form.owner:
        return
    owner = value[form.owner]
    hint = form.keys[form.owner].hint
    if isinstance(owner, str) or (isinstance(owner, list) and get_args(hint)[0] is not str):
        return
    raise ArgumentError(f"{form.owner} = {value_text(owner)} must be a text in quotes")


def _assumed(names: Any, form: Form, values: Values) -> list[str]:
    """Return the numbers that nobody has published; each must be in the table."""
    if not isinstance(names, list):
        raise ArgumentError(f"{ASSUMED} = {value_text(names)} must be a list")
    for name in names:
        require_known("number", name, form.numbers, f"{ASSUMED}: ")
        if name not in values:
            raise ArgumentError(f"{ASSUMED}: the table gives no {name}")
    return names


def values_of(table: PartTable, system: System) -> Values:
    """Return the values of a table in the units of a system, by key.

    Args:
        table: The table.
        system: System of the plant.

    Raises:
        ArgumentError: For all numbers that do not fit.
    """
    of = next(iter(table.of), "")
    values = {}
    mistakes = Mistakes()
    for name, value in table.values.items():
        key = table.form.keys[name]
        with mistakes.gathered():
            if key.bounds is not None:
                # An owner that the system does not have is one mistake, whatever its numbers.
                key.bounds.unit_in(system, of)
            with mistakes.gathered(f"{name}: "):
                values[name] = key.in_si(value, system, of)
    mistakes.refuse()
    return values


def read(table: PartTable, system: System) -> Any:
    """Return the part of a table, its numbers in the units of a system.

    Args:
        table: The table.
        system: System of the plant.

    Raises:
        GrosmcError: For all values that do not fit.
    """
    form = table.form
    values = values_of(table, system)
    if form.adapt is not None:
        values = form.adapt(values, system)
    if issubclass(form.part, Edit):
        values[form.owner] = in_model(values[form.owner], form.owner, system)
    return part_from(form.part, values)


def part_from(kind: type, values: Values) -> Any:
    """Make a part of the values of its keys; other ones are left out."""
    keys = keys_of(kind)
    return kind(**{key.field: values[name] for name, key in keys.items() if name in values})


def in_model(name: str, owner: str, system: System) -> str:
    """Return the name of an actuator for an input; joints and bodies keep their names.

    Args:
        name: Name in a case file.
        owner: ``input``, ``joint`` or ``body``.
        system: The system of the file.

    Raises:
        ArgumentError: If the system has no such input.
    """
    if owner != "input":
        return name
    inputs = [signal.name for signal in system.inputs]
    require_known("input", name, inputs)
    return system.actuators[inputs.index(name)]
