"""A case file as an experiment: what is run, and whether it keeps what is required."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError, unknown_name
from grosmc_mj.experiments.case import Case, case_of, shipped_files
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.schema import CaseFile
from grosmc_mj.experiments.file.user_code import blamed
from grosmc_mj.experiments.laws import control_period_of, controller_of
from grosmc_mj.experiments.plants import Subject, subject_of
from grosmc_mj.experiments.requirements import Limit, limits
from grosmc_mj.experiments.runs import PlantName, RunResult, Settings, design_variant, run_on
from grosmc_mj.simulation.engines.inputs import require_answer


@dataclass(frozen=True, eq=False)
class Experiment:
    """A case file, ready to run.

    Attributes:
        file: What the file says.
        path: The file.
        subject: The plant.
        case: Start, duration, edits, disturbances.
        settings: How it is run.
        laws: The controllers, by the plant that they run on and by their names.
        limits: What they must keep.
    """

    file: CaseFile
    path: Path
    subject: Subject
    case: Case
    settings: Settings
    laws: Mapping[tuple[PlantName, str], Controller]
    limits: Sequence[Limit]

    @property
    def folder(self) -> Path:
        """Where the file lies, and the user's own Python."""
        return self.path.parent

    def run(self) -> Iterator[RunResult]:
        """Run every controller on every plant, one by one.

        Raises:
            GrosmcError: If a law or a profile of the user's own fails, with its file and line.
        """
        for (plant, _), law in self.laws.items():
            try:
                with blamed(self.folder):
                    yield self._run(plant, law)
            except GrosmcError as error:
                raise ArgumentError(f"{self.path}: {error}") from error

    def _run(self, plant: PlantName, law: Controller) -> RunResult:
        """One controller on one plant."""
        # Compiled code does not say where a law fails, or that it does.
        require_answer(law, np.array(self.case.x0), len(self.subject.system.inputs))
        return run_on(self.case, plant, law, self.subject.plants[plant], self.settings)

    def document(self) -> dict[str, Any]:
        """The resolved file as plain values."""
        return self.file.model_dump(exclude_none=True)


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
    systems = dict.fromkeys(each.split("/")[0] for each in shipped)
    valid = [*systems, *shipped, "or a path that ends in .toml"]
    raise ArgumentError(unknown_name("case", name, valid))


def find_experiments(target: str) -> list[Experiment]:
    """The experiments that a name means: ``SYSTEM``, ``SYSTEM/CASE`` or the path of a case file.

    Args:
        target: ``servo`` for all its cases, the nominal one first; ``servo/case1`` for one; or a
            path.

    Raises:
        ArgumentError: If there is none, or a file is wrong, in one line.
    """
    found = [name for name in shipped_files() if name.split("/")[0] == target]
    if not found:
        return [prepare(find_file(target))]
    found.sort(key=lambda name: (not name.endswith("/nominal"), name))
    return [prepare(find_file(name)) for name in found]


def prepare(path: Path) -> Experiment:
    """Read a case file and design what it asks for.

    Raises:
        ArgumentError: If the file or what it names is wrong, in one line that begins with its path.
    """
    return experiment_of(read_case_file(path), path)


def experiment_of(file: CaseFile, path: Path) -> Experiment:
    """Design what a case file asks for.

    Args:
        file: Its content.
        path: Where it lies: what it names is looked for beside it.

    Raises:
        ArgumentError: If it names what is not there, in one line that begins with its path.
    """
    try:
        return _prepared(file, path)
    except GrosmcError as error:
        raise ArgumentError(f"{path}: {error}") from error


def _prepared(file: CaseFile, path: Path) -> Experiment:
    """The experiment of a file."""
    folder = path.parent
    subject = subject_of(file, folder)
    case = case_of(file, subject.system, folder)
    settings = Settings(
        engine=file.run.engine,
        control_period=control_period_of(file, subject),
        timestep=subject.timestep,
        integrator=subject.integrator,
    )
    laws, made = {}, {}
    for plant in subject.plants:
        for index, table in enumerate(file.controller):
            # Physics and the corrected equations get one and the same controller.
            key = (design_variant(plant), index)
            if key not in made:
                made[key] = controller_of(table, file, subject, plant, folder)
            law = made[key]
            if (plant, law.name) in laws:
                raise ArgumentError(
                    f"two controllers are called {law.name!r}: give one of them another name"
                )
            laws[plant, law.name] = law
    plants = list(subject.plants)
    designed = [law for (plant, _), law in laws.items() if plant == plants[0]]
    found: list[Limit] = []
    for index, table in enumerate(file.requirement):
        where = f"requirement {index + 1}"
        names = [law.name for law in designed]
        for kind, named, valid in (
            ("controller", table.of or (), names),
            ("plant", table.on or (), plants),
        ):
            for name in named:
                if name not in valid:
                    raise ArgumentError(f"{where}: {unknown_name(kind, name, valid)}")
        if 0 < file.run.duration <= table.after:
            raise ArgumentError(f"{where}: after {table.after:g} s the run has ended")
        try:
            found += limits(table, designed, plants)
        except ArgumentError as error:
            raise ArgumentError(f"{where}: {error}") from None
    return Experiment(file, path, subject, case, settings, laws, found)
