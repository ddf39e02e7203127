"""What a command is about: SYSTEM, SYSTEM/CASE or FILE.toml."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.errors import ArgumentError, shown

if TYPE_CHECKING:
    from grosmc_mj.experiments.case import Case

# In the help of commands that take all three.
TARGET = "SYSTEM|SYSTEM/CASE|FILE.toml"
CASES = "SYSTEM|SYSTEM/CASE"
# Of a system, what a film or a window shows.
_SHOWN = "case1"
_FILE = ".toml"


def result_name(path: Path) -> str:
    """What the results of a case file are called: a case of the package is SYSTEM_CASE."""
    from grosmc_mj.experiments.case import CASES as PACKAGED

    parts = path.relative_to(PACKAGED).parent.parts if path.is_relative_to(PACKAGED) else ()
    return "_".join((*parts, path.stem))


def system_cases(target: str, command: str) -> list[Case]:
    """The cases that SYSTEM or SYSTEM/CASE names.

    Args:
        target: What was asked for.
        command: That takes no file, for the message.

    Raises:
        ArgumentError: If there is no such case, or it is a file.
        ModelError: If there is no such system.
    """
    from grosmc_mj.experiments.case import cases, find_case

    if target.endswith(_FILE):
        raise ArgumentError(
            f"{shown(target, str)}: {command} takes SYSTEM or SYSTEM/CASE, such as arm/case1; "
            "grosmc-mj run, campaign, film and view take files"
        )
    system, _, name = target.partition("/")
    return [find_case(system, name)] if name else cases(system)


def shown_case(target: str) -> Case | Path:
    """The one case of a system, or the case file, that a film or a window shows.

    Raises:
        ArgumentError: If there is no such case or file.
        ModelError: If there is no such system.
    """
    from grosmc_mj.experiments.case import find_case
    from grosmc_mj.experiments.experiment import find_file
    from grosmc_mj.plants import SYSTEMS

    system, _, name = target.partition("/")
    if target.endswith(_FILE) or (name and system not in SYSTEMS):
        return find_file(target)
    return find_case(system, name or _SHOWN)
