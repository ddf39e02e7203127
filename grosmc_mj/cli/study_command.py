"""Base classes of the commands that measure the cells of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import OUTPUT, SEARCH, Figures, Flag, Out, WholeNumber
from grosmc_mj.cli.films import write_with_progress
from grosmc_mj.cli.targets import result_name

if TYPE_CHECKING:
    from grosmc_mj.output.films.film import Film
    from grosmc_mj.output.results.result import Result

SearchNumber = Annotated[WholeNumber, Parameter(group=SEARCH)]

AnyStudy = TypeVar("AnyStudy", bound=Any)
AnyRow = TypeVar("AnyRow")


@dataclass(frozen=True, kw_only=True)
class StudyCommand(AnsweringCommand, Generic[AnyStudy, AnyRow]):
    """Command that measures the cells of a study, and writes, draws and prints its answer.

    Attributes:
        resume: Measure only what is missing in the folder of the finished parts in --out, of the
            same file and versions.
        out: Folder for all that is written.
        figures: Draw the figures.
    """

    resume: Annotated[Flag, Parameter(group=OUTPUT)] = False
    out: Out = Path("renders")
    figures: Figures = True

    def study(self) -> AnyStudy:
        """Return the study that the options describe.

        Raises:
            ArgumentError: If something does not fit.
        """
        raise NotImplementedError

    def name_of(self, study: AnyStudy) -> str:
        """Return the name of the result, after the kind of the study."""
        return result_name(study.case.path)

    def result(self, study: AnyStudy, rows: Sequence[AnyRow], *, complete: bool) -> Result:
        """Return the result of finished rows; ``complete`` if nothing was interrupted."""
        raise NotImplementedError

    def draw(self, study: AnyStudy, rows: Sequence[AnyRow], path: Path) -> Sequence[Path]:
        """Draw the figures beside the result; returns their paths."""
        raise NotImplementedError

    def write_cases(self, study: AnyStudy, rows: Sequence[AnyRow], path: Path) -> Sequence[Path]:
        """Write case files of what was found; returns their paths."""
        return ()

    def keeps(self, study: AnyStudy, rows: Sequence[AnyRow]) -> bool:
        """Whether the laws keep enough for exit code 0."""
        raise NotImplementedError

    def film_law(self, study: AnyStudy, rows: Sequence[AnyRow], path: Path) -> None:
        """Write the film that is asked for, if any."""

    def questions(self) -> Sequence[Question]:
        """Return the one question of the study."""
        return [_StudyQuestion(self, self.study())]

    def measure(self, study: AnyStudy, rows: list[AnyRow], folder: Path) -> None:
        """Measure the cells of a study; with --resume read those that are finished.

        Args:
            study: The study.
            rows: List to which each row is added.
            folder: Folder of the finished rows.
        """
        from grosmc_mj.studies.pieces import held
        from grosmc_mj.studies.study import CellRunner

        cells = study.cells()
        with held(folder), screen.progress(study.steps(cells), study.unit) as progress:
            runner = CellRunner(folder, study.row, self.resume, progress, screen.notice)
            # One by one: an interrupt leaves the first ones.
            rows.extend(study.rows(cells, runner))


class _StudyQuestion(Question):
    """Question of a study: its rows, one of each cell."""

    def __init__(self, command: StudyCommand[AnyStudy, AnyRow], study: AnyStudy) -> None:
        self.path = command.out / f"{study.kind}_{command.name_of(study)}.json"
        self._command = command
        self._study = study
        self._rows: list[Any] = []

    def measure(self) -> None:
        """Measure all cells, or read them."""
        self._command.measure(self._study, self._rows, self.path.with_suffix(""))

    def result(self, *, complete: bool) -> Result | None:
        """Return the result of the finished rows."""
        if not self._rows:
            return None
        return self._command.result(self._study, self._rows, complete=complete)

    @property
    def missing(self) -> Sequence[str]:
        """Names of the cells that are not finished."""
        return self._study.missing(self._rows)

    def draw(self) -> Sequence[Path]:
        """Draw the figures, and write the case files."""
        command = self._command
        files: list[Path] = []
        if command.figures:
            files += command.draw(self._study, self._rows, self.path)
        files += command.write_cases(self._study, self._rows, self.path)
        return files

    def close(self) -> None:
        """Write the film that is asked for, if any."""
        path = self.path.with_name(f"{self.path.stem}_film.mp4")
        self._command.film_law(self._study, self._rows, path)

    @property
    def kept(self) -> bool:
        """Whether the laws keep enough."""
        return self._command.keeps(self._study, self._rows)

    @property
    def advice(self) -> str:
        """How to go on after an interrupt."""
        return screen.RESUME


@dataclass(frozen=True, kw_only=True)
class FilmedStudyCommand(StudyCommand[AnyStudy, AnyRow]):
    """Command of a study that films one of its laws.

    Attributes:
        film: A law to film.
        gif: Write the film as a GIF, too.
    """

    film: Annotated[str, Parameter(metavar="NAME", show_default="none", group=OUTPUT)] = ""
    gif: Annotated[Flag, Parameter(group=OUTPUT)] = False

    def film_of(self, study: AnyStudy, rows: Sequence[AnyRow]) -> Film:
        """Return the film of the law.

        Raises:
            ArgumentError: If there can be none.
        """
        raise NotImplementedError

    def film_law(self, study: AnyStudy, rows: Sequence[AnyRow], path: Path) -> None:
        """Write the film that is asked for, if any."""
        if self.film:
            film = self.film_of(study, rows)
            write_with_progress(screen.console(), study.case, film, path, gif=self.gif)


@dataclass(frozen=True, kw_only=True)
class SearchStudyCommand(StudyCommand[AnyStudy, AnyRow]):
    """Command of a study that searches numbers of laws.

    Attributes:
        conditions: Conditions that all is asked under.
        runs: Runs of each law's search at most.
        draws: Draws of what is random in the loop that designs are tuned on.
        held_out: Other draws that the numbers found are judged on.
        plants: Random plants of [[uncertain]] that designs must keep, too; --held-out others judge.
        seed: Seed of the search and of the plants.
    """

    conditions: Annotated[
        tuple[str, ...], Parameter(metavar="NAME...", show_default="all", group=SEARCH)
    ] = ()
    runs: SearchNumber = 3000
    draws: SearchNumber = 4
    held_out: SearchNumber = 20
    plants: SearchNumber = 0
    seed: SearchNumber = 0

    def search_options(self) -> dict[str, Any]:
        """Return the options of the search by their names.

        Raises:
            ArgumentError: If a number of draws is out of bounds.
        """
        from grosmc_mj.studies.sweep.draws import require_draws

        require_draws(self.draws)
        require_draws(self.held_out, "--held-out")
        return {
            "conditions": self.conditions,
            "runs": self.runs,
            "draws": self.draws,
            "held_out": self.held_out,
            "plants": self.plants,
            "seed": self.seed,
        }
