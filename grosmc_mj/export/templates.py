"""Text of C from the templates of this package, with structures for Python's records.

A structure has a record's fields in their order. All members are of one type, so a structure is
also a flat array of the numbers that ``pack`` gives.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from grosmc_mj.export.c_names import c_name
from grosmc_mj.export.c_text import INDENT, calls, comment, literal, mentions, wrapped
from grosmc_mj.theory.plants import Signal

# A field and its text in the part "Attributes" of a docstring.
_ATTRIBUTE = re.compile(r"^    (\w+): ((?:.*\n?)(?:^ {8}.*\n?)*)", re.MULTILINE)


def rendered(template: str, **values: Any) -> str:
    """Return the text of a template.

    Args:
        template: Name of its file.
        values: What its expressions name.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        comment=comment, definition=definition, initial=initial, listed=listed, wrapped=wrapped
    )
    environment.tests.update(calling=calls, mentioning=mentions)
    return environment.get_template(template).render(**values)


def listed(signals: Sequence[Signal], array: str) -> str:
    """Return names and units of the entries of an array."""
    places = [f"{array}[{i}] {signal.name} [{signal.unit}]" for i, signal in enumerate(signals)]
    return ", ".join(places)


def definition(value: Any, name: str, real: str) -> str:
    """Return the definition of a dataclass's structure, after those of its members.

    Args:
        value: The dataclass.
        name: Name of the structure.
        real: ``double`` or ``float``.
    """
    before = ""
    lines = [f"struct {name} {{"]
    texts = _texts(type(value))
    for item in fields(value):
        member: Any = getattr(value, item.name)
        kind = real
        size = ""
        if is_dataclass(member):
            inner = f"{name}_{c_name(item.name)}"
            before += definition(member, inner, real) + "\n"
            kind = f"struct {inner}"
        elif np.ndim(member):
            size = f"[{np.size(member)}]"
        if item.name in texts:
            lines.append(comment(texts[item.name], len(INDENT)))
        lines.append(f"{INDENT}{kind} {c_name(item.name)}{size};")
    if len(lines) == 1:
        # C has no structure without members.
        lines.append(f"{INDENT}{real} nothing;")
    return before + "\n".join([*lines, "};\n"])


def initial(value: Any, real: str, depth: int = 1) -> str:
    """Return the initial values of a dataclass's structure, a line for each member.

    Args:
        value: The dataclass.
        real: ``double`` or ``float``.
        depth: Depth of the lines.
    """
    indent = INDENT * depth
    lines: list[str] = []
    for item in fields(value):
        member = getattr(value, item.name)
        start = f".{c_name(item.name)} = "
        if is_dataclass(member):
            inner = initial(member, real, depth + 1)
            lines.append(f"{indent}{start}{{\n{inner}\n{indent}}},")
            continue
        numbers = [literal(number, real) for number in np.ravel(member).astype(float).tolist()]
        text = ", ".join(numbers)
        if np.ndim(member):
            text = f"{{{text}}}"
        lines += wrapped(f"{start}{text},", len(indent), len(INDENT))
    return "\n".join(lines or [f"{indent}.nothing = {literal(0.0, real)},"])


def _texts(kind: type) -> dict[str, str]:
    """Texts of the fields of a dataclass, with their units, from the docstrings of its classes."""
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        doc = inspect.cleandoc(base.__dict__.get("__doc__") or "")
        _, _, attributes = doc.partition("Attributes:\n")
        texts.update(_ATTRIBUTE.findall(attributes))
    return texts
