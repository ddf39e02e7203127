"""Structures in C for Python's records, with the members that the code of a law has.

Members stand in the order of the record's fields. All are of one type, so a structure is also a
flat array: some of the numbers that ``pack`` gives, in their order.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.export.c_names import c_name
from grosmc_mj.export.c_text import INDENT, comment, literal, wrapped

# A field and its text in the part "Attributes" of a docstring.
_ATTRIBUTE = re.compile(r"^    (\w+): ((?:.*\n?)(?:^ {8}.*\n?)*)", re.MULTILINE)


class Member(NamedTuple):
    """A member of a structure.

    Attributes:
        name: Its name in C.
        text: Its meaning, with its unit; empty if the record does not say it.
        value: A number, an array, or the structure of a record.
        first: Place of its first number in the flat record.
    """

    name: str
    text: str
    value: Any
    first: int


@dataclass(frozen=True, eq=False)
class Structure:
    """A structure of numbers in C.

    Attributes:
        name: Its name.
        record: The dataclass of numbers, arrays and such dataclasses.
        path: Code before the names of its members, such as ``p->``.
        code: Code of the law: members that it does not have are left out.
        real: ``double`` or ``float``.
        first: Place of its first number in the flat record that it is part of.
    """

    name: str
    record: Any
    path: str
    code: str
    real: str
    first: int = 0

    @property
    def members(self) -> list[Member]:
        """Members that the code has."""
        return list(self._members())

    def _members(self) -> Iterator[Member]:
        """Yield the members that the code has."""
        texts = _texts(type(self.record))
        place = self.first
        for item in fields(self.record):
            value = getattr(self.record, item.name)
            name = c_name(item.name)
            path = f"{self.path}{name}"
            first = place
            place += _size(value)
            if is_dataclass(value):
                part = Structure(
                    f"{self.name}_{name}", value, f"{path}.", self.code, self.real, first
                )
                if part.members:
                    yield Member(name, texts.get(item.name, ""), part, first)
            elif re.search(rf"{re.escape(path)}\b", self.code):
                yield Member(name, texts.get(item.name, ""), value, first)

    @property
    def places(self) -> list[int]:
        """Places of its numbers in the flat record."""
        places: list[int] = []
        for member in self.members:
            if isinstance(member.value, Structure):
                places += member.value.places
            else:
                places += range(member.first, member.first + np.size(member.value))
        return places

    @property
    def definition(self) -> str:
        """Its definition, after those of its members."""
        before = ""
        lines = [f"struct {self.name} {{"]
        for member in self.members:
            kind = self.real
            size = ""
            if isinstance(member.value, Structure):
                before += member.value.definition + "\n"
                kind = f"struct {member.value.name}"
            elif np.ndim(member.value):
                size = f"[{np.size(member.value)}]"
            if member.text:
                lines.append(comment(member.text, len(INDENT)))
            lines.append(f"{INDENT}{kind} {member.name}{size};")
        return before + "\n".join([*lines, "};\n"])

    def initial(self, depth: int = 1) -> str:
        """Return its initial values, a line for each member.

        Args:
            depth: Depth of the lines.
        """
        indent = INDENT * depth
        lines: list[str] = []
        for member in self.members:
            start = f".{member.name} = "
            if isinstance(member.value, Structure):
                inner = member.value.initial(depth + 1)
                lines.append(f"{indent}{start}{{\n{inner}\n{indent}}},")
                continue
            entries = np.ravel(member.value).astype(float).tolist()
            text = ", ".join(literal(number, self.real) for number in entries)
            if np.ndim(member.value):
                text = f"{{{text}}}"
            lines += wrapped(f"{start}{text},", len(indent), len(INDENT))
        return "\n".join(lines)


def _size(value: Any) -> int:
    """Count of the numbers of a field, as ``pack`` counts them."""
    if not is_dataclass(value):
        return int(np.size(value))
    # A record without fields has one number that means nothing.
    return max(1, sum(_size(getattr(value, item.name)) for item in fields(value)))


def _texts(kind: type) -> dict[str, str]:
    """Texts of the fields of a dataclass, with their units, from the docstrings of its classes."""
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        doc = inspect.cleandoc(base.__dict__.get("__doc__") or "")
        _, _, attributes = doc.partition("Attributes:\n")
        texts.update(_ATTRIBUTE.findall(attributes))
    return texts
