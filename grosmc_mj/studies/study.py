"""A study is a set of cells; each is measured alone and stored, so that a killed study goes on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from pydantic import BaseModel

from grosmc_mj.experiments.case_document import case_document
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.ground.executors import Notice
from grosmc_mj.ground.versions import source_digest, versions
from grosmc_mj.output.results.document import json_text
from grosmc_mj.studies.pieces import Piece, PieceStore, Rows
from grosmc_mj.studies.target import Condition

AnyRow = TypeVar("AnyRow", bound=BaseModel)
# Function that is told how far the measurement of a cell is.
Advance = Callable[[str], object]


class Progress(Protocol):
    """Progress of a study."""

    def __call__(self, text: str = "", by: int = 1) -> object:
        """Count so many more cells as done, and show a text."""
        ...


@dataclass(frozen=True)
class StudyCell(Generic[AnyRow]):
    """Cell of a study: a law, at a step, under conditions.

    Attributes:
        name: Name for the progress.
        key: Key among the cells of the study.
        depends_on: Everything else that its row depends on, see ``dependencies``.
        measure: Function that returns its row.
    """

    name: str
    key: tuple[str | bool, ...]
    depends_on: str
    measure: Callable[[Advance], AnyRow]

    @property
    def piece(self) -> Piece:
        """The cell among stored pieces."""
        return Piece.named_by([self.depends_on, self.key], f"{self.name} of this study")


def dependencies(configuration: Any, conditions: Sequence[Condition]) -> str:
    """Return all that the rows of a study depend on, as JSON: cases, models, versions and code.

    Args:
        configuration: Configuration of the study.
        conditions: Its conditions: their loads stand in files of other cases.
    """
    cases = []
    for condition in conditions:
        experiment = condition.experiment
        code = sources(named_in(experiment.file), experiment.path.parent)
        plant = experiment.nominal.plant.digest
        cases.append([case_document(experiment), experiment.document(), code, plant])
    return json_text([configuration, cases, versions(), source_digest()])


def _show_nothing(text: str = "", by: int = 1) -> None:
    """Progress that nobody sees."""


@dataclass(frozen=True)
class CellRunner(Generic[AnyRow]):
    """Reads the rows of finished cells, measures the others, stores them and shows progress.

    Attributes:
        folder: Folder of the rows.
        kind: Class of the rows.
        resume: Whether rows that lie there are read; else all are measured.
        progress: Called for each cell that is done, and with the course of a measurement.
        notice: Called with a line about a worker process that died.
    """

    folder: Path
    kind: type[AnyRow]
    resume: bool = True
    progress: Progress = _show_nothing
    notice: Notice = _show_nothing

    def row(self, cell: StudyCell[AnyRow]) -> AnyRow:
        """Return the row of a cell: read it, or measure and write it.

        Raises:
            GrosmcError: If it cannot be measured or written.
        """
        row = self.read(cell)
        if row is None:
            self.progress(cell.name, 0)
            row = cell.measure(lambda text: self.progress(text, 0))
            self.write(cell, row)
        return row

    def read(self, cell: StudyCell[AnyRow]) -> AnyRow | None:
        """Return the stored row of a cell; None if it is missing, or no row is to be read.

        Raises:
            SetupError: If its file is damaged.
        """
        if not self.resume:
            return None
        return self._store.read(cell.piece)

    def write(self, cell: StudyCell[AnyRow], row: AnyRow) -> None:
        """Store the row of a cell.

        Raises:
            SetupError: If it cannot be written.
        """
        self._store.write(cell.piece, row)

    @property
    def _store(self) -> PieceStore[AnyRow]:
        return PieceStore(self.folder, Rows(self.kind))


class Study(ABC, Generic[AnyRow]):
    """A target, ready to be studied.

    Attributes:
        kind: Kind of its result, and first word of the names of its files.
        row: Class of its rows.
        unit: Name of the steps of its progress, in the plural.
    """

    kind: ClassVar[str]
    row: ClassVar[type[BaseModel]]
    unit: ClassVar[str] = "laws"

    @property
    @abstractmethod
    def case(self) -> Experiment:
        """Experiment whose name the results have."""

    @abstractmethod
    def cells(self) -> list[StudyCell[AnyRow]]:
        """Return all cells, in the order in which they are measured."""

    def steps(self, cells: Sequence[StudyCell[AnyRow]]) -> int:
        """Return the number of steps of the progress: a step for each cell."""
        return len(cells)

    def missing(self, rows: Sequence[AnyRow]) -> list[str]:
        """Return the names of the cells that are not finished, each once.

        Args:
            rows: The rows that are there, in the order of the cells.
        """
        return list(dict.fromkeys(cell.name for cell in self.cells()[len(rows) :]))

    def rows(
        self, cells: Sequence[StudyCell[AnyRow]], runner: CellRunner[AnyRow]
    ) -> Iterator[AnyRow]:
        """Yield the row of each cell.

        Args:
            cells: The cells.
            runner: Reads or measures them.

        Raises:
            GrosmcError: If a cell cannot be measured or its row cannot be written.
        """
        for cell in cells:
            row = runner.row(cell)
            runner.progress(cell.name)
            yield row
