"""The values of a case file, with those of the files that it takes from.

A file takes from another one by ``extends = "base.toml"``, a file beside it, or by ``extends =
"servo/machine"``, a case of the package, and on a system of the package from the base file of that
system, so that its laws have their numbers everywhere. Tables are merged key by key, and the file's
own values count; everything else, arrays of tables too, is the file's own or, if it has none, the
base's. Files that an extended file names lie beside that file.
"""

from __future__ import annotations

from pathlib import Path, PureWindowsPath
from typing import Any

from grosmc_mj.experiments.file.shipped import (
    CASES,
    base_file,
    name_for_people,
    name_in_package,
    shipped_files,
)
from grosmc_mj.experiments.file.toml_text import values_of_text
from grosmc_mj.ground.errors import ArgumentError, unknown_name, value_text
from grosmc_mj.ground.files import is_there, require_regular

Content = dict[str, Any]
EXTENDS = "extends"


def read_content(path: Path) -> Content:
    """Return the values of a case file with all that it takes from other files.

    Raises:
        ArgumentError: If one of the files cannot be read, is no TOML, lies elsewhere, or extends
            itself.
    """
    return merged_layers(layers_of(path))


def content_of_text(text: str, path: Path) -> Content:
    """Return the values of the text of a case file, with those of its system's base file.

    Args:
        text: Text of a file that extends no other one.
        path: The file that the text is, or was, in.

    Raises:
        ArgumentError: If it is no TOML.
    """
    return merged_layers(_with_system_base({path: values_of_text(text, path)}))


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
        content = values_of_text(read_text(file), file)
        next_path = None
        if EXTENDS in content:
            next_path = _extended_file(content.pop(EXTENDS), file, [*files, file])
        if file.parent != path.parent and file.is_relative_to(CASES):
            _name_files_in_package(content, file)
        files[file] = content
    return _with_system_base(files)


def merged_layers(layers: dict[Path, Content]) -> Content:
    """Return the values of files, of which the first counts the most."""
    content: Content = {}
    for own in reversed(layers.values()):
        # A name is never taken over: results are kept under it.
        content.pop("name", None)
        content = merged(content, own)
    return content


def taken_over(layers: dict[Path, Content]) -> dict[str, str]:
    """Return the files from which a case file takes whole values, such as arrays of tables.

    Args:
        layers: Values of the case file and of those that it extends, see ``layers_of``.

    Returns:
        Names of the files by key: SYSTEM/CASE of the package, or the name of a file.
    """
    own, *bases = layers
    taken: dict[str, str] = {}
    for path in bases:
        for key, value in layers[path].items():
            if key not in layers[own] and not isinstance(value, dict):
                taken.setdefault(key, name_for_people(path))
    return taken


def _extended_file(name: Any, path: Path, above: list[Path]) -> Path:
    """Return the file that a case file extends.

    Args:
        name: Value of ``extends``.
        path: The case file.
        above: The files that extend it, and itself.
    """
    if isinstance(name, str) and not name.endswith(".toml"):
        return _case_of_package(name, path)
    # With the separators and drives of all systems.
    if not isinstance(name, str) or PureWindowsPath(name).name != name:
        raise ArgumentError(
            f'{path}: extends = {value_text(name)} must be a file beside it, such as "base.toml", '
            'or a case of the package, such as "servo/machine"'
        )
    base = path.parent / name
    if base in above:
        raise ArgumentError(f"{path}: extends: {base.name} extends this file in turn")
    if not is_there(base):
        raise ArgumentError(f"{path}: extends: there is no {value_text(name, str)} beside it")
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
        # Editors on Windows write a mark of the byte order first.
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise ArgumentError(f"{path} cannot be read: {reason}") from error


def merged(base: Content, content: Content) -> Content:
    """Merge tables key by key; any other value of the base is replaced."""
    result = {**base, **content}
    for key in base.keys() & content.keys():
        if isinstance(base[key], dict) and isinstance(content[key], dict):
            result[key] = merged(base[key], content[key])
    return result


def _with_system_base(files: dict[Path, Content]) -> dict[Path, Content]:
    """Return files, of which each extends the next, with the base file of their system."""
    plant = merged_layers(files).get("plant")
    system = plant.get("system") if isinstance(plant, dict) else None
    base = base_file(system) if isinstance(system, str) else None
    if base is None or base in files:
        return files
    return {**files, base: values_of_text(read_text(base), base)}
