"""The package's own experiments, by the names that users give them."""

from __future__ import annotations

import contextlib
from functools import cache
from pathlib import Path

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import read_content
from grosmc_mj.experiments.file.reading import case_file_of, read_case_file
from grosmc_mj.experiments.file.shipped import case_order, find_file, shipped_files
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import GrosmcError, placed
from grosmc_mj.ground.fields import Name, checked_call
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import realized
from grosmc_mj.theory.control.task import AS_PRINTED, Analytic, Realization
from grosmc_mj.theory.plants import find_system

# Of a file that has none.
_SOME_RUN = {"duration": "1000 s"}
_SOME_LAW = [{"law": "lqr"}]


def find_experiments(target: str) -> list[Experiment]:
    """Return the experiments of ``SYSTEM``, ``SYSTEM/CASE`` or the path of a case file.

    Args:
        target: ``servo`` for all its cases, the nominal one first; ``servo/case1`` for one; or a
            path.

    Raises:
        ArgumentError: If there is none, or a file is wrong, in one line.
    """
    files = shipped_files()
    cases = [name for name in files if target in (name, name.split("/")[0])]
    if not cases:
        return [Experiment.load(target)]
    return [_shipped(files[name]) for name in sorted(cases, key=case_order)]


def find_plants(target: str) -> list[tuple[Experiment, list[str]]]:
    """Return experiments with the laws that they run, as ``find_experiments``; no law is designed.

    A case file needs no more than its [plant] here.

    Raises:
        ArgumentError: As ``find_experiments``.
    """
    shipped = shipped_files()
    if target in shipped or target in [name.split("/")[0] for name in shipped]:
        return [(experiment, experiment.controllers) for experiment in find_experiments(target)]

    path = find_file(target)
    content = read_content(path)
    has_laws = "controller" in content
    if isinstance(content.get("run", {}), dict):
        content["run"] = {**_SOME_RUN, **content.get("run", {})}
    content.setdefault("controller", _SOME_LAW)
    file = case_file_of(content, path)
    with placed(f"{path}: "):
        experiment = Experiment.of_file(file, path)
    # It designs the laws; one that cannot be is told by whoever asks for it.
    with contextlib.suppress(GrosmcError):
        experiment.warn_of_implausible()
    return [(experiment, experiment.controllers if has_laws else [])]


def find_experiment(system: str, case: str) -> Experiment:
    """Return one experiment of a system of the package.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If it has no such case.
    """
    experiments = find_experiments(find_system(system).name)
    by_name = {experiment.name: experiment for experiment in experiments}
    require_known(f"case of {system}", case, by_name)
    return by_name[case]


# Claims ask for cases by name a thousand times.
@cache
def _shipped(path: Path) -> Experiment:
    """Return an experiment of the package."""
    return Experiment.of_file(read_case_file(path), path)


@checked_call
def chapter_controller(
    name: Name,
    nominal: Analytic,
    realization: Realization = AS_PRINTED,
    case: Name = "nominal",
) -> Controller:
    """Design a law of a case of the package for a nominal plant.

    Args:
        name: ``lqr``, ``fl-lqr``, ``grosmc``, or another law of the system.
        nominal: The nominal plant, such as ``MujocoPlant.load("arm").analytic()``.
        realization: Switching law and surface of a sliding mode law; as printed by default.
        case: The case, since a system may have laws for several tasks.

    Raises:
        GrosmcError: If there is no such case or law, or the design fails for these numbers.
    """
    experiment = find_experiment(nominal.system.name, case)
    return realized(experiment.law_for(nominal, name), realization)
