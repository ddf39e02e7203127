"""Reading a case file, with all that it extends, or one line about each mistake in it.

A file takes from another one by ``extends = "base.toml"``, and on a system of the package from the
base file of that system, so that its laws have their numbers everywhere. Tables are merged key by
key, and the file's own values count; everything else, arrays of tables too, is the file's own or,
if it has none, the base's.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from grosmc_mj.errors import ArgumentError, shown, together, unknown_name
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.shipped import base_file

Content = dict[str, Any]
_EXTENDS = "extends"
# Keys that need no quotes.
_BARE = re.compile(r"[A-Za-z0-9_-]+")
# Wrong types as pydantic and as people call them.
_TYPES = {
    "float_type": "a number",
    "int_type": "a whole number, such as 1",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
}
# How pydantic begins a sentence about bounds.
_SHOULD = "Input should be "


def read_case_file(path: Path) -> CaseFile:
    """The content of a case file.

    Raises:
        ArgumentError: If it cannot be read, is no TOML, or says what a case file may not say.
    """
    return parse_case_file(resolved_text(path), path)


def resolved_text(path: Path, above: tuple[Path, ...] = ()) -> str:
    """The text of a case file with all that it takes from others, and without ``extends``.

    Comments stay where no table is merged.

    Args:
        path: The file.
        above: The files that extend this one.

    Raises:
        ArgumentError: If one of them cannot be read, is no TOML, lies elsewhere, or extends itself.
    """
    if path.suffix in (".xml", ".mjcf"):
        raise ArgumentError(
            f"{path} is a model: write a case file beside it that names it, with [plant] model = "
            f'"{path.name}"; grosmc-mj new NAME writes one to begin with'
        )
    text = read_text(path)
    content = _content(text, path)
    if _EXTENDS in content:
        name = content.pop(_EXTENDS)
        if not isinstance(name, str) or Path(name).name != name or not name.endswith(".toml"):
            raise ArgumentError(
                f'{path}: extends = {shown(name)} must be a file beside it, such as "base.toml"'
            )
        base = path.parent / name
        if base in (path, *above):
            raise ArgumentError(f"{path}: extends: {base.name} extends this file in turn")
        text = _joined(text, content, resolved_text(base, (path, *above)))
        content = tomllib.loads(text)
    return _with_system_base(text, content)


def read_text(path: Path) -> str:
    """The text of a case file.

    Raises:
        ArgumentError: If it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise ArgumentError(f"{path}: cannot be read: {why}") from error


def parse_case_file(text: str, path: Path) -> CaseFile:
    """The content of a text that is, or was, a case file's with all that it extends.

    Raises:
        ArgumentError: If it is no TOML, or says what a case file may not say.
    """
    content = _content(_with_system_base(text, _content(text, path)), path)
    try:
        file = CaseFile.model_validate(content)
    except ValidationError as error:
        raise ArgumentError(f"{path}: {together(_in_words(error))}") from None
    return file if file.name else file.model_copy(update={"name": path.stem})


def _content(text: str, path: Path) -> Content:
    """The values of a text of TOML."""
    try:
        content = tomllib.loads(text)
        _refuse_odd(content)
    except RecursionError:
        raise ArgumentError(f"{path}: no valid TOML: it is nested too deep") from None
    # TOML's own errors, and one about integers of thousands of digits.
    except ValueError as error:
        raise ArgumentError(f"{path}: no valid TOML: {error}") from error
    return content


def _refuse_odd(content: Any) -> None:
    """Refuse control characters, and integers of more than 64 bits, which TOML does not have."""
    if isinstance(content, str) and not content.isprintable():
        raise ValueError(f"{shown(content)} has characters that cannot be printed")
    if isinstance(content, int) and not -(2**63) <= content < 2**63:
        raise ValueError(f"{shown(content)} has more than 64 bits")
    if isinstance(content, dict):
        content = [*content, *content.values()]
    for value in content if isinstance(content, list) else ():
        _refuse_odd(value)


def _with_system_base(text: str, content: Content) -> str:
    """The text with what it does not say from the base file of its system, if there is one."""
    plant = content.get("plant")
    system = plant.get("system") if isinstance(plant, dict) else None
    base = base_file(system) if isinstance(system, str) else None
    return text if base is None else _joined(text, content, read_text(base))


def _merged(base: Content, own: Content) -> Content:
    """Tables key by key; what is no table as the file itself has it."""
    both = {**base, **own}
    for key in base.keys() & own.keys():
        if isinstance(base[key], dict) and isinstance(own[key], dict):
            both[key] = _merged(base[key], own[key])
    return both


def _joined(text: str, content: Content, base: str) -> str:
    """One text of a file and its base, with their comments if no table is in both."""
    # A name is nobody else's: results are kept under it.
    shared = {key: value for key, value in tomllib.loads(base).items() if key != "name"}
    both = _merged(shared, content)
    if both == tomllib.loads(text):
        return text
    (head, *own), (_, *others) = _sections(text), _sections(base)
    kept = "\n".join(line for line in head[1].splitlines() if not line.startswith(_EXTENDS))
    more = [section for name, section in others if name not in dict(own)]
    parts = (part.strip() for part in (kept, *more, *(section for _, section in own)))
    joined = "\n\n".join(filter(None, parts)) + "\n"
    try:
        same = tomllib.loads(joined) == both
    except ValueError:
        same = False
    return joined if same else toml_text(both)


def _sections(text: str) -> list[tuple[str, str]]:
    """A text's tables by their headers, each with the comments above it; first what has none."""
    sections: list[tuple[str, list[str]]] = [("", [])]
    for line in text.splitlines():
        if line.startswith("["):
            last, above = sections[-1][1], []
            while last and last[-1].startswith("#"):
                above.insert(0, last.pop())
            sections.append((line.split("#")[0].strip(), above))
        sections[-1][1].append(line)
    return [(name, "\n".join(lines)) for name, lines in sections]


def toml_text(content: Content) -> str:
    """Return plain values as TOML: first the values, then the tables in their order."""
    tables = {key: [value] for key, value in content.items() if isinstance(value, dict)}
    arrays = {
        key: value
        for key, value in content.items()
        if isinstance(value, list) and value and all(isinstance(row, dict) for row in value)
    }
    plain = {k: v for k, v in content.items() if k not in tables and k not in arrays}
    texts = ["\n".join(_lines(plain))]
    for key in content:
        header = f"[{_key(key)}]" if key in tables else f"[[{_key(key)}]]"
        rows = tables.get(key) or arrays.get(key) or ()
        texts += ["\n".join([header, *_lines(row)]) for row in rows]
    return "\n\n".join(filter(None, texts)) + "\n"


def _lines(table: Content) -> Iterator[str]:
    return (f"{_key(key)} = {_value(value)}" for key, value in table.items())


def _key(name: str) -> str:
    """A key of TOML, in quotes where it needs them."""
    return name if _BARE.fullmatch(name) else _value(name)


def _value(value: Any) -> str:
    """One value of TOML."""
    if isinstance(value, (str, bool)):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        return f"{{ {', '.join(_lines(value))} }}" if value else "{}"
    return f"[{', '.join(map(_value, value))}]" if isinstance(value, list) else str(value)


def _in_words(error: ValidationError) -> list[str]:
    """Every mistake, in one line each."""
    mistakes = error.errors(include_url=False)
    # A misspelt key is also a missing one: the first says more.
    misspelt = [item["loc"][:-1] for item in mistakes if item["type"] == "extra_forbidden"]
    return [
        _line(item)
        for item in mistakes
        if item["type"] != "missing" or item["loc"][:-1] not in misspelt
    ]


def _line(mistake: Any) -> str:
    """Where a mistake is, the value and the values allowed."""
    kind, value, message = mistake["type"], mistake["input"], mistake["msg"]
    path, keys = _place(mistake["loc"])
    *tables, key = path or [""]
    where = f"{' '.join(tables)}: " if tables else ""
    # A number with a point is not shown as a whole one.
    written = repr(value) if kind == "int_type" and isinstance(value, float) else shown(value)
    match kind:
        case "extra_forbidden":
            return where + unknown_name("key", key, keys)
        case "missing":
            return f"{where}{key} is missing; it may have the keys {', '.join(keys)}"
        case "literal_error":
            choices = mistake["ctx"]["expected"].replace(" or ", ", ").split(",")
            return where + unknown_name(key, value, [choice.strip("' ") for choice in choices])
        case "list_type" if isinstance(value, dict):
            return f"[{key}] is one of possibly several: write [[{key}]]"
        case "too_short" | "too_long":
            return f"{where}{key}: {message.removeprefix('List should have').strip()}"
    if kind in _TYPES or message.startswith(_SHOULD):
        allowed = _TYPES.get(kind) or message.removeprefix(_SHOULD)
        return f"{where}{key} = {written} must be {allowed}"
    return f"{where}{key}: {message.removeprefix('Value error, ')}"


def _place(loc: Sequence[Any]) -> tuple[list[str], list[str]]:
    """Tables and key on the way to a mistake, and the keys valid where it is."""
    words: list[str] = []
    model: type[BaseModel] = CaseFile
    for part in loc:
        if isinstance(part, int):
            words[-1] = f"{words[-1]} {part + 1}"
            continue
        field = model.model_fields.get(part)
        words.append(part)
        if field is not None and part is not loc[-1]:
            model = _model_in(field.annotation) or model
    return words, list(model.model_fields)


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The table that a field is, or that its list has."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((table for part in get_args(annotation) if (table := _model_in(part))), None)
