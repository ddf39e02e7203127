"""The values of a case file, with those of the files that it takes from.

A file takes from another one by ``extends = "base.toml"``, a file beside it, or by ``extends =
"servo/machine"``, a case of the package, and on a system of the package from the base file of that
system, so that its laws have their numbers everywhere. Tables are merged key by key, and the file's
own values count; everything else, arrays of tables too, is the file's own or, if it has none, the
base's. Files that an extended file names lie beside that file.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.file.shipped import CASES, base_file, name_in_package, shipped_files
from grosmc_mj.ground.errors import ArgumentError, unknown_name, value_text
from grosmc_mj.ground.files import require_regular

Content = dict[str, Any]
EXTENDS = "extends"
# Number of the line in an error of TOML.
_LINE = re.compile(r"\(at line (\d+), ")
# A number with a unit as the value of a key, without quotes.
_BARE_QUANTITY = re.compile(r"=\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?\s*[A-Za-z%][\w^*/% ]*)")


def read_content(path: Path) -> Content:
    """Return the values of a case file with all that it takes from other files.

    Raises:
        ArgumentError: If one of the files cannot be read, is no TOML, lies elsewhere, or extends
            itself.
    """
    return _merged_layers(layers_of(path))


def content_of_text(text: str, path: Path) -> Content:
    """Return the values of the text of a case file, with those of its system's base file.

    Args:
        text: Text of a file that extends no other one.
        path: The file that the text is, or was, in.

    Raises:
        ArgumentError: If it is no TOML.
    """
    return _merged_layers(_with_system_base({path: _values(text, path)}))


def layers_of(path: Path) -> dict[Path, Content]:
    """Return the values of a case file, of each file that it extends, and of its system's base.

    Raises:
        ArgumentError: As for ``read_content``.
    """
    if path.suffix in (".xml", ".mjcf"):
        raise ArgumentError(
            f"{path} is a model: write a case file beside it that names it, with [plant] model = "
            f'"{path.name}"; grosmc-mj new NAME writes one to begin with'
        )
    files: dict[Path, Content] = {}
    next_path: Path | None = path
    while next_path is not None:
        file = next_path
        content = _values(read_text(file), file)
        next_path = None
        if EXTENDS in content:
            next_path = _extended_file(content.pop(EXTENDS), file, [*files, file])
        if file.parent != path.parent and file.is_relative_to(CASES):
            _name_files_in_package(content, file)
        files[file] = content
    return _with_system_base(files)


def _extended_file(name: Any, path: Path, above: list[Path]) -> Path:
    """Return the file that a case file extends.

    Args:
        name: Value of ``extends``.
        path: The case file.
        above: The files that extend it, and itself.
    """
    if isinstance(name, str) and not name.endswith(".toml"):
        return _case_of_package(name, path)
    if not isinstance(name, str) or Path(name).name != name:
        raise ArgumentError(
            f'{path}: extends = {value_text(name)} must be a file beside it, such as "base.toml", '
            'or a case of the package, such as "servo/machine"'
        )
    base = path.parent / name
    if base in above:
        raise ArgumentError(f"{path}: extends: {base.name} extends this file in turn")
    return base


def _case_of_package(name: str, path: Path) -> Path:
    """Return the case of the package that a case file extends; of a system its base file.

    A folder beside the file that is called so is no case of the package, and is not looked into.

    Raises:
        ArgumentError: If there is no such case.
    """
    base = base_file(name)
    if base is not None:
        return base
    cases = shipped_files()
    if name in cases:
        return cases[name]
    raise ArgumentError(
        f"{path}: extends: {unknown_name('case', name, cases)}; or a file beside it, whose name "
        "ends in .toml"
    )


def _name_files_in_package(content: Content, path: Path) -> None:
    """Name the files beside a case of the package so that they are found from elsewhere, too."""
    plant = content.get("plant")
    if isinstance(plant, dict) and ":" not in plant.get("model", ":"):
        plant["model"] = name_in_package(path.with_name(plant["model"]))
    for table in content.get("measured", []):
        table["log"] = str(path.parent / table["log"])


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


def merged(base: Content, content: Content) -> Content:
    """Merge tables key by key; any other value of the base is replaced."""
    result = {**base, **content}
    for key in base.keys() & content.keys():
        if isinstance(base[key], dict) and isinstance(content[key], dict):
            result[key] = merged(base[key], content[key])
    return result


def _with_system_base(files: dict[Path, Content]) -> dict[Path, Content]:
    """Return files, of which each extends the next, with the base file of their system."""
    plant = _merged_layers(files).get("plant")
    system = plant.get("system") if isinstance(plant, dict) else None
    base = base_file(system) if isinstance(system, str) else None
    if base is None or base in files:
        return files
    return {**files, base: _values(read_text(base), base)}


def _merged_layers(layers: dict[Path, Content]) -> Content:
    """Return the values of files, of which the first counts the most."""
    content: Content = {}
    for own in reversed(layers.values()):
        # A name is never taken over: results are kept under it.
        content.pop("name", None)
        content = merged(content, own)
    return content


def _values(text: str, path: Path) -> Content:
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
    """Return the correct form of a number with a unit that has no quotes; else an empty text."""
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
