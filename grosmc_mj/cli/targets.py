"""Targets of commands: SYSTEM, SYSTEM/CASE or FILE.toml."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.ground.errors import ArgumentError, value_text

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment

# Metavariables in the help: of commands that take all three, and of those that take no file.
TARGET = "SYSTEM|SYSTEM/CASE|FILE.toml"
CASES = "SYSTEM|SYSTEM/CASE"
# The case of a system that a film or a window shows.
_SHOWN_CASE = "case1"
_FILE = ".toml"
# A figure of the chapter, as a reader may name it: fig3, "Fig. 3", fig3_pendulum_variation.
_FIGURE = re.compile(r"fig(?:ure)?[. ]*(\d+)", re.IGNORECASE)


def require_target(target: str) -> None:
    """Refuse a target that is no case, or a file that cannot be read.

    It imports no library that simulates: a misspelt name is refused at once.

    Raises:
        ArgumentError: If there is no such case or file, or the file, or one that it extends, is
            no TOML.
    """
    from grosmc_mj.experiments.file.content import layers_of
    from grosmc_mj.experiments.file.shipped import find_file, shipped_files

    systems = {name.split("/")[0] for name in shipped_files()}
    if target not in systems:
        layers_of(find_file(target))


def result_name(path: Path) -> str:
    """Return the name of a case file's results; of a case of the package it is SYSTEM_CASE."""
    from grosmc_mj.experiments.file.shipped import CASES as PACKAGED

    if not path.is_relative_to(PACKAGED):
        return path.stem
    folders = path.relative_to(PACKAGED).parent.parts
    return "_".join((*folders, path.stem))


def recorded_experiments(target: str) -> list[Experiment]:
    """Return the experiments of SYSTEM, or of SYSTEM/CASE, whose results are recorded.

    Results on a machine are not recorded: its impacts and dry friction amplify rounding, and
    other processors round in other ways.

    Args:
        target: Argument of the command line.

    Raises:
        ArgumentError: If there is no such case, it is on a machine, a file, or a figure.
        ModelError: If there is no such system.
    """
    from grosmc_mj.experiments.catalogue import find_experiment, find_experiments
    from grosmc_mj.theory.plants import find_system

    if target.endswith(_FILE):
        raise ArgumentError(
            f"{value_text(target, str)}: validate compares with results that are recorded for "
            "SYSTEM/CASE, such as arm/case1; what a file requires is judged by grosmc-mj run"
        )

    _refuse_figure(target)
    system, _, name = target.partition("/")
    if not name:
        experiments = find_experiments(find_system(system).name)
        return [experiment for experiment in experiments if not experiment.on_machine]

    experiment = find_experiment(system, name)
    if experiment.on_machine:
        raise ArgumentError(
            f"{target}: no results of a machine are recorded: grosmc-mj run judges it, and "
            "grosmc-mj study ladder says where it breaks"
        )
    return [experiment]


def _refuse_figure(target: str) -> None:
    """Refuse the name of a figure: say which case it is of."""
    number = _FIGURE.match(target)
    if number is None:
        return

    from grosmc_mj.chapter.figures import PICTURES

    for picture in PICTURES:
        if picture.name.startswith(f"fig{int(number[1])}_"):
            case = f"{picture.system}/{picture.case}"
            raise ArgumentError(
                f"{target} is a figure, must be SYSTEM or SYSTEM/CASE: "
                f"grosmc-mj validate {case} writes {picture.name}.png"
            )


def shown_experiment(target: str) -> Experiment:
    """Return the one experiment that a film or a window shows; of a system its case1, or its first.

    Raises:
        ArgumentError: If there is no such case or file.
    """
    from grosmc_mj.experiments.catalogue import find_experiments

    experiments = find_experiments(target)
    for experiment in experiments:
        if experiment.name == _SHOWN_CASE:
            return experiment
    return experiments[0]
