"""What a command is about: SYSTEM, SYSTEM/CASE or FILE.toml."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.errors import ArgumentError, shown

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment

# In the help of commands that take all three.
TARGET = "SYSTEM|SYSTEM/CASE|FILE.toml"
CASES = "SYSTEM|SYSTEM/CASE"
# Of a system, what a film or a window shows.
_SHOWN = "case1"
_FILE = ".toml"


def result_name(path: Path) -> str:
    """What the results of a case file are called: a case of the package is SYSTEM_CASE."""
    from grosmc_mj.experiments.file.shipped import CASES as PACKAGED

    parts = path.relative_to(PACKAGED).parent.parts if path.is_relative_to(PACKAGED) else ()
    return "_".join((*parts, path.stem))


def recorded_experiments(target: str) -> list[Experiment]:
    """The experiments whose results are recorded: those of SYSTEM, or SYSTEM/CASE.

    Those on a machine are not: what bounces and sticks amplifies rounding, and other processors
    round in other ways.

    Args:
        target: What was asked for.

    Raises:
        ArgumentError: If there is no such case, it is on a machine, or a file.
        ModelError: If there is no such system.
    """
    from grosmc_mj.experiments.catalogue import find_experiment, select_experiments

    if target.endswith(_FILE):
        raise ArgumentError(
            f"{shown(target, str)}: validate compares with results that are recorded for "
            "SYSTEM/CASE, such as arm/case1; what a file requires is judged by grosmc-mj run"
        )
    system, _, name = target.partition("/")
    if not name:
        return [one for one in select_experiments([system], None) if not one.on_machine]
    experiment = find_experiment(system, name)
    if experiment.on_machine:
        raise ArgumentError(
            f"{target}: no results of a machine are recorded: grosmc-mj run judges it, and "
            "grosmc-mj study ladder says where it breaks"
        )
    return [experiment]


def shown_experiment(target: str) -> Experiment:
    """The one experiment that a film or a window shows; of a system its case1, or its first.

    Raises:
        ArgumentError: If there is no such case or file.
    """
    from grosmc_mj.experiments.catalogue import find_experiments

    experiments = find_experiments(target)
    return next((one for one in experiments if one.case.name == _SHOWN), experiments[0])
