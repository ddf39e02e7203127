"""The package's own files: cases, the base files that they share, and starters for users."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from grosmc_mj.ground.errors import (
    ArgumentError,
    did_you_mean,
    first_names,
    unknown_name,
    value_text,
)

_PACKAGE = Path(__file__).resolve().parents[2]
# It has a folder for each system.
CASES = _PACKAGE / "experiments" / "cases"
# Name of the file that the cases of a system share.
_BASE = "base.toml"
# Name of the starter with a plant in Python.
_OWN = "own_plant"
# Files of a folder that a message names.
_LISTED = 6
# Characters of a pattern of names, which a shell leaves as it is where no file fits.
_PATTERN = frozenset("*?[]")


def shipped_files() -> Mapping[str, Path]:
    """Return the case files of the package by name, ``system/case``, without base files."""
    return _files_in(CASES)


# Claims ask for cases by name a thousand times.
@cache
def _files_in(folder: Path) -> Mapping[str, Path]:
    """Return the case files of a folder by name."""
    files = {}
    for path in sorted(folder.glob("*/*.toml")):
        if path.name != _BASE:
            files[f"{path.parent.name}/{path.stem}"] = path
    return files


def campaign_files() -> dict[str, Path]:
    """Return the campaigns of the package by the names of their systems."""
    files = sorted((_PACKAGE / "studies" / "campaign" / "shipped").glob("*.toml"))
    return {path.stem: path for path in files}


def case_order(name: str) -> tuple[bool, bool, str]:
    """Return a key for sorting: the nominal case first; bench and machine last."""
    is_nominal = name.endswith("/nominal")
    is_built = name.endswith(("/bench", "/machine"))
    return not is_nominal, is_built, name


def content(path: Path) -> dict[str, Any]:
    """Return the values of a file of the package, without those of the files that it extends."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def find_file(name: str) -> Path:
    """Return a case file by its path or, for the package's own, by ``system/case``.

    Raises:
        ArgumentError: If there is none.
    """
    shipped = shipped_files()
    if name in shipped:
        return shipped[name]
    path = Path(name)
    if path.is_file():
        return path
    if path.is_dir():
        raise ArgumentError(f"{name} is a folder, must be a case file")
    if path.is_symlink():
        raise ArgumentError(f"{name} is a link that leads to no file: name the file itself")
    beside = [str(path.with_name(file.name)) for file in sorted(path.parent.glob("*.toml"))]
    if path.suffix == ".toml":
        raise ArgumentError(_missing_file(path, beside))
    if f"{name}.toml" in beside:
        raise ArgumentError(f"unknown case {value_text(name)}: did you mean '{name}.toml'?")
    systems = [case.split("/")[0] for case in shipped]
    unknown = unknown_name("case", name, list(dict.fromkeys([*systems, *shipped])))
    raise ArgumentError(f"{unknown}, or a path that ends in .toml")


def _missing_file(path: Path, beside: Sequence[str]) -> str:
    """Return the refusal of a case file that is not there, with what is and how to get a new one.

    Args:
        path: Path of the file.
        beside: Paths of the case files in its folder.
    """
    line = f"{path}: there is no such file"
    commands = "grosmc-mj list names the cases of the package"
    if _PATTERN.isdisjoint(path.name):
        commands += f", grosmc-mj new {path.stem} writes a new file"
    nearest = did_you_mean(path, [*beside, *shipped_files()])
    if nearest:
        return f"{line}:{nearest} {commands}"

    if beside:
        line += f": its folder has {first_names(beside, _LISTED)}"
    return f"{line}; {commands}"


def written_beside(case: Path, out: Path, name: str) -> Path:
    """Return the path of a case file that a command writes: beside its case, whose files it names.

    Nothing is written beside a case of the package.

    Args:
        case: The case file.
        out: Folder of the command's results, for a case of the package.
        name: Name of the new file.
    """
    folder = out if case.resolve().is_relative_to(CASES) else case.parent
    return folder / name


def base_file(system: str) -> Path | None:
    """Return the file that the cases of a system share, with the numbers of its laws."""
    for path in CASES.glob(f"*/{_BASE}"):
        if path.parent.name == system:
            return path
    return None


def name_in_package(path: Path) -> str:
    """Return ``package:path`` of a file of the package, by which case files anywhere name it."""
    return f"{_PACKAGE.name}:{path.relative_to(_PACKAGE).as_posix()}"


def name_for_people(path: Path) -> str:
    """Return SYSTEM/CASE of a case file of the package, and the name of any other file."""
    if path.is_relative_to(CASES):
        return path.relative_to(CASES).with_suffix("").as_posix()
    return path.name


def starter() -> str:
    """Return a case file with every key explained."""
    return (CASES / "starter.toml").read_text(encoding="utf-8")


def own_plant(name: str) -> dict[str, str]:
    """Return a case file with a plant and laws in Python, and that Python, by file name."""
    texts = {}
    for suffix in (".toml", ".py"):
        text = (CASES / f"{_OWN}{suffix}").read_text(encoding="utf-8")
        texts[f"{name}{suffix}"] = text.replace(_OWN, name)
    return texts
