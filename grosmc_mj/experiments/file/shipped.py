"""The package's own files: its cases, what they share, and what a user begins with."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError, unknown_name

# A folder for each system.
_PACKAGE = Path(__file__).resolve().parents[2]
CASES = _PACKAGE / "cases"
_BASE, _OWN = "base.toml", "own_plant"


def shipped_files() -> Mapping[str, Path]:
    """The case files of the package by their names, ``system/case``; bases are none."""
    return _files_in(CASES)


@cache
def _files_in(folder: Path) -> Mapping[str, Path]:
    """Found once: claims ask for cases by name a thousand times."""
    return {
        "/".join(path.relative_to(folder).with_suffix("").parts): path
        for path in sorted(folder.glob("*/*.toml"))
        if path.name != _BASE
    }


def campaign_files() -> dict[str, Path]:
    """The campaigns of the package by the names of their systems."""
    return {path.stem: path for path in sorted((_PACKAGE / "campaigns").glob("*.toml"))}


def case_order(name: str) -> tuple[bool, bool, str]:
    """The nominal case first; bench and machine last."""
    built = ("/bench", "/machine")
    return not name.endswith("/nominal"), name.endswith(built), name


def content(path: Path) -> dict[str, Any]:
    """What a file of the package says, without what it extends."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def find_file(name: str) -> Path:
    """A case file by its path or, for the package's own, by ``system/case``.

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
    if path.suffix == ".toml":
        raise ArgumentError(f"{name}: there is no such file; grosmc-mj new {path.stem} writes one")
    systems = dict.fromkeys(case.split("/")[0] for case in shipped)
    unknown = unknown_name("case", name, [*systems, *shipped])
    raise ArgumentError(f"{unknown}, or a path that ends in .toml")


def base_file(system: str) -> Path | None:
    """What the cases of a system of the package share: its laws with their numbers."""
    return next((path for path in CASES.glob(f"*/{_BASE}") if path.parent.name == system), None)


def starter() -> str:
    """A case file with every key explained."""
    return (CASES / "starter.toml").read_text(encoding="utf-8")


def own_plant(name: str) -> dict[str, str]:
    """A case file with a plant and laws in Python, and that Python, by their file names."""
    sources = [Path(f"{_OWN}{suffix}") for suffix in (".toml", ".py")]
    return {
        f"{name}{source.suffix}": (CASES / source).read_text(encoding="utf-8").replace(_OWN, name)
        for source in sources
    }
