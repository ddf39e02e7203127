"""The closed loop that a case file of an identified machine takes from another case."""

from __future__ import annotations

from pathlib import Path

from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content, read_content
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.ground.errors import ArgumentError, placed

# What is taken over whole.
TAKEN = ("run", "task", "laws", "controller", "requirement")
# What the written file has of its own, or has no use for: logs and claims are of other runs.
_OWN = ("title", "source", "plant", "claim", "uncertain", "correlation", "log", "measured")


def closed_loop(target: str, machine: Experiment, path: Path) -> Experiment:
    """Return the case whose run, task, laws, controllers and requirements a machine is given.

    Args:
        target: SYSTEM/CASE or the path of a case file.
        machine: The case that is identified.
        path: The case file that will be written.

    Raises:
        ArgumentError: If its states or inputs are others, if it has tables of the machine that are
            not those of the identified case, or if both together are no case.
    """
    loop = find_experiments(target)[0]
    system = machine.nominal.system
    other = loop.nominal.system
    for kind, ours, theirs in (
        ("states", system.states, other.states),
        ("inputs", system.inputs, other.inputs),
    ):
        names = ", ".join(variable.name for variable in ours)
        others = ", ".join(variable.name for variable in theirs)
        if names != others:
            raise ArgumentError(
                f"--case {target} has the {kind} {others}, must have those of "
                f"{machine.path.name}: {names}"
            )

    content = read_content(machine.path)
    taken = read_content(loop.path)
    foreign = [
        key for key in taken if key not in {*TAKEN, *_OWN} and not _same(key, content, taken)
    ]
    if foreign:
        tables = ", ".join(f"[{key}]" for key in foreign)
        raise ArgumentError(
            f"--case {target} has {tables} that {machine.path.name} does not have so: only run, "
            f"task, laws, controllers and requirements are taken; write {tables} into "
            f"{machine.path.name}"
        )
    # A mistake is told before the work.
    with placed(f"--case {target} on {machine.path.name}: "):
        together = with_closed_loop(content, loop)
        together["uncertain"] = uncertain_of_machine(content)
        together.pop("correlation", None)
        Experiment.of_file(case_file_of(together, path), machine.path).checked()
    return loop


def _same(key: str, content: Content, other: Content) -> bool:
    """Whether two files have the same values of a key."""
    return key in content and content[key] == other[key]


def with_closed_loop(content: Content, loop: Experiment) -> Content:
    """Return the values of a machine's case with run, laws and requirements of another one."""
    theirs = read_content(loop.path)
    left_out = {*TAKEN, "source", "claim", "measured"}
    kept = {key: value for key, value in content.items() if key not in left_out}
    return {**kept, **{key: theirs[key] for key in TAKEN if key in theirs}}


def uncertain_of_machine(content: Content) -> list[Content]:
    """Return the [[uncertain]] tables whose numbers are not of what is taken over."""
    tables = content.get("uncertain", [])
    return [table for table in tables if not is_of_loop(table["number"])]


def is_of_loop(path: str) -> bool:
    """Whether the path of a number leads into what is taken over."""
    return path.partition(".")[0].partition("[")[0] in TAKEN
