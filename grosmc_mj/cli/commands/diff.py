"""grosmc-mj diff."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import Out, command

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.studies.comparison.comparison import ResultComparison


@command
class DiffCommand(AnsweringCommand):
    """Compare two results: what changed, by how much, and which of it is noise.

    Each side is a file or a folder with what run, validate, claims, study and campaign have
    written. On the same machine with the same versions a run repeats to the bit, so that any
    change beyond rounding is real; on another one, what switching amplifies is noise. Campaigns
    are compared by the plants that were lost and won, with an interval of the change. diff.json
    goes to --out, and grosmc-mj report shows it.

    Exit code: 0 if nothing got worse beyond noise, 1 if something did, 2 if the results cannot be
    compared. What the new results did not measure is listed, and is not worse.

    Attributes:
        old: Results before.
        new: Results after.
        out: Folder for diff.json.
    """

    old: Path
    new: Path
    _: KW_ONLY
    out: Out = Path("renders")

    @property
    def simulates(self) -> bool:
        """False: the command reads results."""
        return False

    def questions(self) -> Sequence[Question]:
        """Return the one question."""
        return [_DiffQuestion(self)]


class _DiffQuestion(Question):
    """Changes between two results, and which of them are for the worse."""

    def __init__(self, command: DiffCommand) -> None:
        self.path = command.out / "diff.json"
        self._command = command
        self._comparison: ResultComparison | None = None

    def measure(self) -> None:
        """Compare the results."""
        from grosmc_mj.studies.comparison.comparison import compare

        self._comparison = compare(self._command.old, self._command.new)

    def result(self, *, complete: bool) -> Result | None:
        """Return the comparison."""
        from grosmc_mj.studies.comparison.comparison import comparison_result

        if self._comparison is None:
            return None
        return comparison_result(self._comparison)

    def close(self) -> None:
        """Print the results that were compared, and those that were not."""
        if self._comparison is not None:
            self._say_list("Made from", self._comparison.sources)
            self._say_list("Not read", self._comparison.notices)

    def _say_list(self, title: str, lines: Sequence[str]) -> None:
        """Print lines below their title, if there are any."""
        if lines:
            console = screen.console()
            console.print(f"{title}:", style="bold")
            screen.say_lines(console, lines, "", full=self._command.verbose)

    @property
    def kept(self) -> bool:
        """Whether nothing got worse beyond noise."""
        return self._comparison is not None and not self._comparison.worse
