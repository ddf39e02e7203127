"""grosmc-mj diff."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Out, command
from grosmc_mj.cli.exit_codes import DIFFERS, DONE


@command
class DiffCommand(Command):
    """Compare two results: what changed, by how much, and which of it is noise.

    Each side is a file or a folder with what run, validate, claims, study and campaign have
    written. On the same machine with the same versions a run repeats to the bit, so that any
    change beyond rounding is real; on another one, what switching amplifies is noise. Campaigns
    are compared by the plants that were lost and won, with an interval of the change. diff.json
    goes to --out, and grosmc-mj report shows it.

    Exit code: 0 if nothing got worse beyond noise, 1 if something did or is gone, 2 if the results
    cannot be compared.

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

    def execute(self) -> int:
        """Compare the results, write and print the comparison."""
        from grosmc_mj.studies.comparison.comparison import compare, comparison_result

        comparison = compare(self.old, self.new)
        screen.say_result(comparison_result(comparison), self.out / "diff.json", full=self.verbose)
        self._say_list("Made from", comparison.sources)
        self._say_list("Not read", comparison.notices)
        return DIFFERS if comparison.worse else DONE

    def _say_list(self, title: str, lines: Sequence[str]) -> None:
        """Print lines below their title, if there are any."""
        if lines:
            console = screen.console()
            console.print(f"{title}:", style="bold")
            screen.say_lines(console, lines, "", full=self.verbose)
