"""A case file as an experiment: what is run, and whether it keeps what is required."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.casefile.reading import read_case_file
from grosmc_mj.casefile.schema import CaseFile
from grosmc_mj.casefile.user_code import blamed
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError, unknown_name
from grosmc_mj.validation.case_laws import controller_of
from grosmc_mj.validation.cases import Case, case_of, shipped_files
from grosmc_mj.validation.requirements import Limit, limits
from grosmc_mj.validation.runs import PlantName, RunResult, Settings, run_on
from grosmc_mj.validation.subject import Subject, subject_of

_RK4 = "RK4"


@dataclass(frozen=True, eq=False)
class Experiment:
    """A case file, ready to run.

    Attributes:
        file: What the file says.
        folder: Where it lies.
        subject: The plant.
        case: Start, duration, edits, disturbances.
        settings: How it is run.
        laws: The controllers, by the plant that they run on and by their names.
        limits: What they must keep.
    """

    file: CaseFile
    folder: Path
    subject: Subject
    case: Case
    settings: Settings
    laws: Mapping[tuple[PlantName, str], Controller]
    limits: Sequence[Limit]

    def run(self) -> Iterator[RunResult]:
        """Run every controller on every plant, one by one.

        Raises:
            GrosmcError: If a law or a profile of the user's own fails, with its file and line.
        """
        for (plant, _), law in self.laws.items():
            with blamed(self.folder):
                self._try(law)
                result = run_on(self.case, plant, law, self.subject.plants[plant], self.settings)
            yield result

    def _try(self, law: Controller) -> None:
        """Ask a law once in Python: compiled code does not say where it fails, or that it does."""
        memory, _kept_alive = law.begin()
        law.law(0.0, np.array(self.case.x0), memory, law.parameters)

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
    if path.suffix == ".toml":
        raise ArgumentError(f"{name}: there is no such file; grosmc-mj new {path.stem} writes one")
    raise ArgumentError(unknown_name("case", name, [*shipped, "or a path that ends in .toml"]))


def prepare(path: Path) -> Experiment:
    """Read a case file and design what it asks for.

    Raises:
        ArgumentError: If the file or what it names is wrong, in one line that begins with its path.
    """
    file, folder = read_case_file(path), path.parent
    try:
        return _prepared(file, folder)
    except GrosmcError as error:
        raise ArgumentError(f"{path}: {error}") from error


def _prepared(file: CaseFile, folder: Path) -> Experiment:
    """The experiment of a file."""
    subject = subject_of(file, folder)
    case = case_of(file, subject.system, folder)
    settings = Settings(
        engine=file.run.engine,
        control_period=file.run.control_period,
        timestep=subject.timestep,
        integrator=file.run.integrator or _RK4,
    )
    laws = {}
    for plant in subject.plants:
        for table in file.controller:
            law = controller_of(table, file, subject, plant, folder)
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
        for kind, named, valid in (("controller", table.of, names), ("plant", table.on, plants)):
            for name in named:
                if name not in valid:
                    raise ArgumentError(f"{where}: {unknown_name(kind, name, valid)}")
        try:
            found += limits(table, designed, plants)
        except ArgumentError as error:
            raise ArgumentError(f"{where}: {error}") from None
    return Experiment(file, folder, subject, case, settings, laws, found)
