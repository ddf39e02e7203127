"""Reading a case file, with the files that it extends, or one line about each mistake in it.

A file takes from another one by ``extends = "base.toml"``, and on a system of the package from the
base file of that system, so that its laws have their numbers everywhere. Tables are merged key by
key, and the file's own values count; everything else, arrays of tables too, is the file's own or,
if it has none, the base's.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from grosmc_mj.errors import ArgumentError, together, unknown_name, value_text
from grosmc_mj.experiments.file.schema import CaseFile, file_name
from grosmc_mj.experiments.file.shipped import base_file
from grosmc_mj.files import require_regular

Content = dict[str, Any]
_EXTENDS = "extends"
# Keys that need no quotes.
_BARE = re.compile(r"[A-Za-z0-9_-]+")
# Words for types, by pydantic's names of errors.
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
# Beginning of pydantic's sentences about bounds.
_SHOULD = "Input should be "
# Number of the line in an error of TOML.
_LINE = re.compile(r"\(at line (\d+), ")
# A number with a unit as the value of a key, without quotes.
_BARE_QUANTITY = re.compile(r"=\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?\s*[A-Za-z%][\w^*/% ]*)")


def read_case_file(path: Path) -> CaseFile:
    """Read a case file.

    Raises:
        ArgumentError: If it cannot be read, is no TOML, or does not fit the tables.
    """
    return parse_case_file(resolved_text(path), path)


def resolved_text(path: Path, above: tuple[Path, ...] = ()) -> str:
    """Return the text of a case file with all that it extends, and without ``extends``.

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
        base = _extended_file(content.pop(_EXTENDS), path, above)
        text = _joined(text, content, resolved_text(base, (path, *above)))
        content = tomllib.loads(text)
    return _with_system_base(text, content)


def _extended_file(name: Any, path: Path, above: tuple[Path, ...]) -> Path:
    """Return the file that a case file extends."""
    if not isinstance(name, str) or Path(name).name != name or not name.endswith(".toml"):
        raise ArgumentError(
            f'{path}: extends = {value_text(name)} must be a file beside it, such as "base.toml"'
        )
    base = path.parent / name
    if base in (path, *above):
        raise ArgumentError(f"{path}: extends: {base.name} extends this file in turn")
    return base


def read_text(path: Path) -> str:
    """Return the text of a case file.

    Raises:
        ArgumentError: If it cannot be read.
    """
    require_regular(path)
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise ArgumentError(f"{path}: cannot be read: {reason}") from error


def parse_case_file(text: str, path: Path) -> CaseFile:
    """Parse the text of a case file.

    Args:
        text: Text of the file with all that it extends.
        path: The file that the text is, or was, in.

    Raises:
        ArgumentError: If it is no TOML, or does not fit the tables.
    """
    text = _with_system_base(text, _content(text, path))
    content = _content(text, path)
    try:
        file = CaseFile.model_validate(content)
    except ValidationError as error:
        raise ArgumentError(f"{path}: {together(_in_words(error))}") from None
    if file.name:
        return file
    try:
        name = file_name(path.stem)
    except ValueError as error:
        raise ArgumentError(f"{path}: the file's name: {error}, or give name = ...") from None
    return file.model_copy(update={"name": name})


def _content(text: str, path: Path) -> Content:
    """Return the values of a text of TOML."""
    try:
        content = tomllib.loads(text)
        _refuse_odd(content)
    except tomllib.TOMLDecodeError as error:
        raise ArgumentError(f"{path}: no valid TOML: {error}{_hint(text, error)}") from error
    except RecursionError:
        raise ArgumentError(f"{path}: no valid TOML: it is nested too deep") from None
    # TOML's own errors, and one about integers of thousands of digits.
    except ValueError as error:
        raise ArgumentError(f"{path}: no valid TOML: {error}") from error
    return content


def _hint(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Return what to write for a number with a unit that has no quotes; empty for other errors."""
    place = _LINE.search(str(error))
    if place is None:
        return ""
    line = text.splitlines()[int(place[1]) - 1]
    bare = _BARE_QUANTITY.search(line)
    if bare is None:
        return ""
    return f': a number with a unit is a text: write "{bare[1]}"'


def _refuse_odd(value: Any) -> None:
    """Refuse control characters, and integers of more than 64 bits, which TOML does not have."""
    if isinstance(value, str) and not value.isprintable():
        raise ValueError(f"{value_text(value)} has characters that cannot be printed")
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError(f"{value_text(value)} has more than 64 bits")

    members: list[Any] = []
    if isinstance(value, list):
        members = value
    elif isinstance(value, dict):
        members = [*value, *value.values()]
    for member in members:
        _refuse_odd(member)


def _with_system_base(text: str, content: Content) -> str:
    """Return the text joined with the base file of its system, if there is one."""
    plant = content.get("plant")
    if not isinstance(plant, dict) or not isinstance(plant.get("system"), str):
        return text
    base = base_file(plant["system"])
    if base is None:
        return text
    return _joined(text, content, read_text(base))


def _merged(base: Content, content: Content) -> Content:
    """Merge tables key by key; any other value of the base is replaced."""
    merged = {**base, **content}
    for key in base.keys() & content.keys():
        if isinstance(base[key], dict) and isinstance(content[key], dict):
            merged[key] = _merged(base[key], content[key])
    return merged


def _joined(text: str, content: Content, base: str) -> str:
    """Return one text of a file and its base, with their comments if no table is in both."""
    base_content = tomllib.loads(base)
    # A name is never taken over: results are kept under it.
    base_content.pop("name", None)
    merged = _merged(base_content, content)
    if merged == tomllib.loads(text):
        return text

    joined = _joined_sections(text, base)
    try:
        if tomllib.loads(joined) == merged:
            return joined
    # A table that is in both texts is no valid TOML.
    except ValueError:
        pass
    return toml_text(merged)


def _joined_sections(text: str, base: str) -> str:
    """Return the text with the tables of the base that it does not have."""
    (_, top), *sections = _sections(text)
    headers = [header for header, _ in sections]
    top_lines = [line for line in top.splitlines() if not line.startswith(_EXTENDS)]

    parts = ["\n".join(top_lines)]
    parts += [section for header, section in _sections(base)[1:] if header not in headers]
    parts += [section for _, section in sections]
    parts = [part.strip() for part in parts]
    return "\n\n".join(filter(None, parts)) + "\n"


def _sections(text: str) -> list[tuple[str, str]]:
    """Split a text into headers and tables with the comments above; the first has no header."""
    sections: list[tuple[str, list[str]]] = [("", [])]
    for line in text.splitlines():
        if line.startswith("["):
            previous = sections[-1][1]
            comments: list[str] = []
            while previous and previous[-1].startswith("#"):
                comments.insert(0, previous.pop())
            header = line.split("#")[0].strip()
            sections.append((header, comments))
        sections[-1][1].append(line)
    return [(header, "\n".join(lines)) for header, lines in sections]


def toml_text(content: Content) -> str:
    """Return values as TOML: plain values, then tables and arrays of tables in their order."""
    plain: Content = {}
    tables: list[tuple[str, Content]] = []
    for key, value in content.items():
        if isinstance(value, dict):
            tables.append((f"[{_key(key)}]", value))
        elif _is_array_of_tables(value):
            tables += [(f"[[{_key(key)}]]", row) for row in value]
        else:
            plain[key] = value

    texts = ["\n".join(_lines(plain))]
    texts += ["\n".join([header, *_lines(table)]) for header, table in tables]
    return "\n\n".join(filter(None, texts)) + "\n"


def _is_array_of_tables(value: Any) -> bool:
    """Whether a value is a list with tables only."""
    return isinstance(value, list) and bool(value) and all(isinstance(row, dict) for row in value)


def _lines(table: Content) -> list[str]:
    """Return one line of TOML for each key of a table."""
    return [f"{_key(key)} = {_value(value)}" for key, value in table.items()]


def _key(name: str) -> str:
    """Return a key of TOML, in quotes where it needs them."""
    if _BARE.fullmatch(name):
        return name
    return _value(name)


def _value(value: Any) -> str:
    """Return one value of TOML."""
    if isinstance(value, (str, bool)):
        return json.dumps(value, ensure_ascii=False)
    if value == {}:
        return "{}"
    if isinstance(value, dict):
        return f"{{ {', '.join(_lines(value))} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return str(value)


def _in_words(error: ValidationError) -> list[str]:
    """Return every mistake, in one line each."""
    mistakes = error.errors(include_url=False)
    tables_with_unknown_key = [
        mistake["loc"][:-1] for mistake in mistakes if mistake["type"] == "extra_forbidden"
    ]
    lines = []
    for mistake in mistakes:
        # A misspelt key is also a missing one: the message about its spelling says more.
        if mistake["type"] == "missing" and mistake["loc"][:-1] in tables_with_unknown_key:
            continue
        lines.append(_line(mistake))
    return lines


def _line(mistake: Any) -> str:
    """Return the place of a mistake, its value and the values allowed."""
    kind = mistake["type"]
    value = mistake["input"]
    message = mistake["msg"]
    path, keys = _place(mistake["loc"])
    *tables, key = path or [""]
    where = f"{' '.join(tables)}: " if tables else ""

    match kind:
        case "extra_forbidden":
            return where + unknown_name("key", key, keys)
        case "missing":
            return where + _missing(key, mistake["loc"], keys)
        case "literal_error":
            choices = mistake["ctx"]["expected"].replace(" or ", ", ").split(",")
            return where + unknown_name(key, value, [choice.strip("' ") for choice in choices])
        case "list_type" if isinstance(value, dict):
            return f"[{key}] is one of possibly several: write [[{key}]]"
        case "too_short" | "too_long":
            return f"{where}{key}: {message.removeprefix('List should have').strip()}"

    if kind not in _TYPES and not message.startswith(_SHOULD):
        return f"{where}{key}: {message.removeprefix('Value error, ')}"
    written = value_text(value)
    if kind == "int_type" and isinstance(value, float):
        # 2.0 would be shown as 2.
        written = repr(value)
    allowed = _TYPES.get(kind) or message.removeprefix(_SHOULD)
    return f"{where}{key} = {written} must be {allowed}"


def _missing(key: str, loc: Sequence[Any], keys: Sequence[str]) -> str:
    """Return the words on a missing key: how a table is written, or which keys there may be."""
    field = CaseFile.model_fields.get(key)
    table = None
    if len(loc) == 1 and field is not None:
        table = _model_in(field.annotation)
    if field is None or table is None:
        return f"{key} is missing; it may have the keys {', '.join(keys)}"

    header = f"[{key}]"
    if get_origin(field.annotation) is list:
        header = f"[[{key}]]"
    return f"there is no {header}: it has the keys {', '.join(table.model_fields)}"


def _place(loc: Sequence[Any]) -> tuple[list[str], list[str]]:
    """Return tables and key on the way to a mistake, and the keys valid where it is."""
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
    """Return the table that a field is, or that its list has."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        table = _model_in(argument)
        if table is not None:
            return table
    return None
