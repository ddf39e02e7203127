"""Case files as checked tables, or one line about each mistake in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from grosmc_mj.experiments.file.content import (
    Content,
    content_of_text,
    layers_of,
    merged_layers,
    taken_over,
)
from grosmc_mj.experiments.file.former_keys import written_today
from grosmc_mj.experiments.file.schema import CaseFile, file_name
from grosmc_mj.ground.errors import ArgumentError, MistakesError, together, unknown_name
from grosmc_mj.ground.refusals import RefusedPlace, line_of


def read_case_file(path: Path) -> CaseFile:
    """Read a case file.

    Raises:
        ArgumentError: If it cannot be read, is no TOML, or does not fit the tables.
    """
    layers = layers_of(path)
    file = case_file_of(merged_layers(layers), path)
    file._taken_over = taken_over(layers)
    return file


def parse_case_file(text: str, path: Path) -> CaseFile:
    """Parse the text of a case file that extends no other one.

    Args:
        text: Text of the file.
        path: The file that the text is, or was, in.

    Raises:
        ArgumentError: If it is no TOML, or does not fit the tables.
    """
    return case_file_of(content_of_text(text, path), path)


def case_file_of(content: Content, path: Path) -> CaseFile:
    """Check the values of a case file.

    Args:
        content: All values, those of the files that it extends too.
        path: The file.

    Raises:
        ArgumentError: If they do not fit the tables.
    """
    try:
        file = CaseFile.model_validate(content)
        file._content = content
    except ValidationError as error:
        raise ArgumentError(f"{path}: {together(_lines(error))}") from None
    if file.name:
        return file
    try:
        name = file_name(path.stem)
    except ValueError as error:
        raise ArgumentError(f"{path}: the file's name: {error}, or give name = ...") from None
    return file.model_copy(update={"name": name})


def _lines(refused: ValidationError) -> list[str]:
    """Return one line for each mistake."""
    mistakes: list[Any] = refused.errors(include_url=False)
    tables_with_unknown_key = [
        mistake["loc"][:-1] for mistake in mistakes if mistake["type"] == "extra_forbidden"
    ]
    lines = []
    for mistake in mistakes:
        location = mistake["loc"]
        # A misspelt key is also a missing one: the message about its spelling says more.
        if mistake["type"] == "missing" and location[:-1] in tables_with_unknown_key:
            continue
        path, keys = _path(location)
        *tables, key = path or [""]
        where = f"{' '.join(tables)}: " if tables else ""
        error = mistake.get("ctx", {}).get("error")
        if isinstance(error, MistakesError):
            # Of a table with a part, which checks its keys itself.
            lines += [f"{' '.join(path)}: {line}" for line in error.mistakes]
        elif mistake["type"] == "missing":
            lines.append(where + _missing(key, location, keys))
        elif mistake["type"] == "extra_forbidden":
            lines.append(where + _unknown(location, key, keys, mistake["input"]))
        elif mistake["type"] == "list_type" and isinstance(mistake["input"], dict):
            lines.append(f"[{key}] is one of possibly several: write [[{key}]]")
        elif mistake["type"] == "too_short" and mistake["ctx"]["min_length"] == 1:
            lines.append(where + _empty(key, location))
        else:
            lines.append(line_of(mistake, RefusedPlace(key, "key", keys, where)))
    return lines


def _unknown(location: Sequence[Any], key: str, keys: Sequence[str], value: Any) -> str:
    """Return the words on an unknown key: what replaces one of a former version, or valid keys."""
    table = "" if len(location) == 1 else str(location[0])
    return written_today(table, key, value) or unknown_name("key", key, keys)


def _missing(key: str, loc: Sequence[Any], keys: Sequence[str]) -> str:
    """Return the words on a missing key: how a table is written, or which keys there may be."""
    field = CaseFile.model_fields.get(key)
    table = None
    if len(loc) == 1 and field is not None:
        table = _model_in(field.annotation)
    if field is None or table is None:
        fields = _table_at(loc).model_fields
        required = [name for name in keys if fields[name].is_required()]
        others = ", ".join(name for name in keys if name not in required)
        return f"{key} is missing; required: {', '.join(required)}; further keys: {others}"

    header = f"[{key}]"
    if get_origin(field.annotation) is list:
        header = f"[[{key}]]"
    return f"there is no {header}: it has the keys {', '.join(table.model_fields)}"


def _empty(key: str, location: Sequence[Any]) -> str:
    """Return the words on an empty list: of tables that must be there, or of a key's values."""
    line = f"{key} = [] must have 1 entry at least"
    table = _model_in(CaseFile.model_fields[key].annotation) if len(location) == 1 else None
    if table is not None:
        known = ", ".join(table.model_fields)
        return f"{line}: write a table [[{key}]] in its place, with some of the keys {known}"
    return f"{line}: name one, or leave {key} out"


def _path(loc: Sequence[Any]) -> tuple[list[str], list[str]]:
    """Return tables and key on the way to a mistake, and the keys valid where it is."""
    words: list[str] = []
    for part in loc:
        if isinstance(part, int):
            words[-1] = f"{words[-1]} {part + 1}"
        else:
            words.append(part)
    return words, list(_table_at(loc).model_fields)


def _table_at(loc: Sequence[Any]) -> type[BaseModel]:
    """Return the table that has the key at the end of the way to a mistake."""
    model: type[BaseModel] = CaseFile
    for part in loc[:-1]:
        field = model.model_fields.get(part)
        if field is not None:
            model = _model_in(field.annotation) or model
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the table that a field is, or that its list has."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in get_args(annotation):
        table = _model_in(argument)
        if table is not None:
            return table
    return None
