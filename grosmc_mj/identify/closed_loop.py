"""The closed loop that a case file of an identified machine takes from another case."""

from __future__ import annotations

from pathlib import Path

from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content, read_content
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.ground.errors import ArgumentError, placed
from grosmc_mj.ground.wording import titled

# Tables that are taken over whole.
_TAKEN = ("run", "task", "laws", "controller", "requirement")
# Logs and claims are of other runs than those of the written file.
_OF_OTHER_RUNS = ("source", "claim", "measured")
# Keys that the written file has of its own. Edits make the machine, and that one is identified.
_OWN = ("name", "title", "plant", "edit", "disturbance", "uncertain", "correlation", "log")


def closed_loop(target: str, machine: Experiment, path: Path) -> Experiment:
    """Return the case whose run, task, laws, controllers and requirements a machine is given.

    Args:
        target: SYSTEM, SYSTEM/CASE or the path of a case file.
        machine: The case that is identified.
        path: The case file that will be written.

    Raises:
        ArgumentError: If its states or inputs are others, if it has parts of a loop or a machine
            that the identified case has not, if its Python lies elsewhere, or if both together are
            no case.
    """
    loop = find_experiments(target)[0]
    _refuse_other_signals(target, machine, loop)
    content = read_content(machine.path)
    _refuse_other_parts(target, machine, content, read_content(loop.path))

    # A mistake is told before the work.
    with placed(f"--case {target} with the machine of {machine.path.name}: "):
        together = with_closed_loop(content, machine, loop)
        together.pop("uncertain", None)
        together.pop("correlation", None)
        file = case_file_of(together, path)
        _refuse_python_elsewhere(file, loop, path)
        Experiment.of_file(file, machine.path).checked()
    return loop


def _refuse_other_signals(target: str, machine: Experiment, loop: Experiment) -> None:
    """Refuse a case with other states or inputs than the machine's.

    Raises:
        ArgumentError: For the first kind that differs.
    """
    for kind in ("states", "inputs"):
        names = _signals(machine, kind)
        others = _signals(loop, kind)
        if names != others:
            raise ArgumentError(
                f"--case {target} has the {kind} {others}, must have those of "
                f"{machine.path.name}: {names}"
            )


def _refuse_other_parts(target: str, machine: Experiment, content: Content, other: Content) -> None:
    """Refuse a case with parts of a loop or a machine that the identified case has not.

    Raises:
        ArgumentError: For all of them.
    """
    allowed = {*_TAKEN, *_OF_OTHER_RUNS, *_OWN}
    foreign = [key for key in other if key not in allowed and other[key] != content.get(key)]
    if foreign:
        tables = ", ".join(f"[{key}]" for key in foreign)
        raise ArgumentError(
            f"--case {target}: loop and machine are those of {machine.path.name}, which does not "
            f"have these tables as this case has them: {tables}; write them into "
            f"{machine.path.name}"
        )


def _refuse_python_elsewhere(file: CaseFile, loop: Experiment, path: Path) -> None:
    """Refuse Python beside the other case that is not beside the file that will be written.

    Raises:
        ArgumentError: For all such files.
    """
    named = named_in(file)
    found = sources(named, path.parent)
    theirs = sources(named, loop.path.parent)
    elsewhere = [name for name, content in theirs.items() if found.get(name) != content]
    if elsewhere:
        raise ArgumentError(
            f"{', '.join(elsewhere)} must be beside {path}, which will be written: put it there"
        )


def _signals(experiment: Experiment, kind: str) -> str:
    """Return names and units of the states or the inputs of a case, for people."""
    signals = getattr(experiment.nominal.system, kind)
    return ", ".join(titled(signal.name, signal.unit) for signal in signals)


def with_closed_loop(content: Content, machine: Experiment, loop: Experiment) -> Content:
    """Return the values of a machine's case with run, laws and requirements of another one.

    Args:
        content: Values of the machine's case.
        machine: The machine's case.
        loop: The other case.
    """
    theirs = read_content(loop.path)
    together = {key: content[key] for key in content if key not in (*_TAKEN, *_OF_OTHER_RUNS)}
    together |= {key: theirs[key] for key in _TAKEN if key in theirs}

    # The log's disturbances are of the machine, such as an offset of its input; those of the other
    # case are of its requirements.
    ours = content.get("disturbance", [])
    added = [table for table in theirs.get("disturbance", []) if table not in ours]
    if added:
        together["disturbance"] = [*ours, *added]

    plant = dict(content.get("plant", {"system": machine.system}))
    compared = [name for name in machine.nominal.names if name in loop.plant_names]
    if compared:
        plant["compare"] = compared
    together["plant"] = plant
    return together


def is_of_loop(path: str) -> bool:
    """Return whether the path of a number leads into what is taken over."""
    return path.partition(".")[0].partition("[")[0] in _TAKEN
