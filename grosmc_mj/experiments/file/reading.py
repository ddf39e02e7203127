"""Reading a case file, or one line about what is wrong with it."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from grosmc_mj.errors import ArgumentError, shown, together, unknown_name
from grosmc_mj.experiments.file.base import resolved, with_system_base
from grosmc_mj.experiments.file.schema import CaseFile

# Characters of a file, and how deep its tables and lists are nested.
_LONGEST, _DEEPEST = 10**6, 10
# What pydantic calls a wrong type, and what people do.
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
# How it begins what it says of bounds.
_SHOULD = "Input should be "


def read_case_file(path: Path) -> CaseFile:
    """The content of a case file.

    Raises:
        ArgumentError: If it cannot be read, is no TOML, or says what a case file may not say.
    """
    return parse_case_file(resolved_text(path), path)


def resolved_text(path: Path) -> str:
    """The text of a case file with all that it takes from the files that it extends.

    Raises:
        ArgumentError: If one of them cannot be read or is no TOML.
    """
    return resolved(_checked_text(path), path, _checked_text, ())


def _checked_text(path: Path) -> str:
    """The text of a file that is TOML."""
    if path.suffix in (".xml", ".mjcf"):
        raise ArgumentError(
            f"{path} is a model: write a case file beside it that names it, with [plant] model = "
            f'"{path.name}"; grosmc-mj new NAME writes one to begin with'
        )
    text = read_text(path)
    _content(text, path)
    return text


def read_text(path: Path) -> str:
    """The text of a case file.

    Raises:
        ArgumentError: If it cannot be read.
    """
    try:
        with path.open(encoding="utf-8") as file:
            text = file.read(_LONGEST + 1)
    except (OSError, UnicodeDecodeError) as error:
        said = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise ArgumentError(f"{path}: cannot be read: {said}") from error
    if len(text) > _LONGEST:
        raise ArgumentError(f"{path}: a case file has {_LONGEST} characters at most")
    return text


def parse_case_file(text: str, path: Path) -> CaseFile:
    """The content of a text that is, or was, a case file's with all that it extends.

    Raises:
        ArgumentError: If it is no TOML, or says what a case file may not say.
    """
    content = _content(text, path)
    content = _content(with_system_base(text, content), path)
    try:
        found = CaseFile.model_validate(content)
    except ValidationError as error:
        raise ArgumentError(f"{path}: {together(_in_words(error))}") from None
    return found if found.name else found.model_copy(update={"name": path.stem})


def _content(text: str, path: Path) -> dict[str, Any]:
    """What a text of TOML says."""
    try:
        content = tomllib.loads(text)
        _refuse_odd(content, 0)
    except RecursionError:
        raise ArgumentError(f"{path}: no valid TOML: it is nested too deep") from None
    # TOML's own errors, and one about integers of thousands of digits.
    except ValueError as error:
        raise ArgumentError(f"{path}: no valid TOML: {error}") from error
    return content


def _refuse_odd(content: Any, depth: int) -> None:
    """Refuse what no case file needs, and no reader of one expects.

    Raises:
        ValueError: If there are control characters, integers of more than 64 bits (which TOML does
            not have), or tables in tables without end.
    """
    if depth > _DEEPEST:
        raise ValueError(f"tables and lists are nested more than {_DEEPEST} deep")
    if isinstance(content, str) and not content.isprintable():
        raise ValueError(f"{shown(content)} has characters that cannot be printed")
    if isinstance(content, int) and not -(2**63) <= content < 2**63:
        raise ValueError(f"{shown(content)} has more than 64 bits")
    if isinstance(content, dict):
        for key, value in content.items():
            _refuse_odd(key, depth)
            _refuse_odd(value, depth + 1)
    elif isinstance(content, list):
        for value in content:
            _refuse_odd(value, depth + 1)


def _in_words(error: ValidationError) -> list[str]:
    """Every mistake."""
    found = error.errors(include_url=False)
    # A misspelt key is also a missing one: the first says more.
    misspelt = [each["loc"][:-1] for each in found if each["type"] == "extra_forbidden"]
    return [
        _mistake(each)
        for each in found
        if each["type"] != "missing" or each["loc"][:-1] not in misspelt
    ]


def _mistake(found: Any) -> str:
    """One of them, in one line."""
    kind, value = found["type"], found["input"]
    path, keys = _place(found["loc"])
    *tables, key = path or [""]
    where = f"{' '.join(tables)}: " if tables else ""
    if kind == "extra_forbidden":
        return where + unknown_name("key", key, keys)
    if kind == "missing":
        return f"{where}{key} is missing; it may have the keys {', '.join(keys)}"
    if kind == "literal_error":
        return f"{where}{unknown_name(key, value, _alternatives(found))}"
    if kind == "list_type" and isinstance(value, dict):
        return f"[{key}] is one of possibly several: write [[{key}]]"
    if kind in {"too_short", "too_long"}:
        return f"{where}{key}: {found['msg'].removeprefix('List should have').strip()}"
    # A number with a point is not shown as a whole one.
    given = repr(value) if kind == "int_type" and isinstance(value, float) else shown(value)
    if kind in _TYPES:
        return f"{where}{key} = {given} must be {_TYPES[kind]}"
    said = found["msg"].removeprefix("Value error, ")
    if said.startswith(_SHOULD):
        return f"{where}{key} = {given} must be {said.removeprefix(_SHOULD)}"
    return f"{where}{key}: {said}"


def _alternatives(found: Any) -> list[str]:
    """The values that a key may have."""
    return [part.strip("' ") for part in found["ctx"]["expected"].replace(" or ", ", ").split(",")]


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
        inner = _model_in(field.annotation) if field is not None else None
        if inner is not None and part is not loc[-1]:
            model = inner
    keys = list(model.model_fields)
    return words, keys


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The table that a field is, or that its list has."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for each in get_args(annotation) if (found := _model_in(each))), None)
