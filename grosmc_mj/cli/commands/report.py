"""grosmc-mj report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import OUTPUT, Command, command
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.ground.errors import ArgumentError, together
from grosmc_mj.ground.wording import counted

if TYPE_CHECKING:
    from rich.console import Console

# Name of the page in the folder of the results.
REPORT = "report.html"


@command
class ReportCommand(Command):
    """Write one HTML page of results, which opens offline and begins with the answer.

    It has what lies in files and folders of results: answers, where each law breaks, curves beside
    their film, claims, campaigns, ladders, tolerances, and where each comes from. What cannot be
    read is named on the page, and stops nothing.

    Attributes:
        paths: Files and folders of results.
        output: The page; by default report.html in the first folder.
    """

    paths: Annotated[tuple[Path, ...], Parameter(show_default="renders")] = ()
    _: KW_ONLY
    output: Annotated[
        Path | None,
        Parameter(alias="-o", metavar="FILE.html", group=OUTPUT),
    ] = None

    def execute(self) -> int:
        """Read the results and write the page."""
        paths = self.paths or (Path("renders"),)
        page = self.output
        if page is None:
            folder = paths[0] if paths[0].is_dir() else paths[0].parent
            page = folder / REPORT
        if page.suffix.lower() not in (".html", ".htm"):
            raise ArgumentError(f"-o {page} must end in .html")

        report_on(screen.console(), paths, page, full=self.verbose)
        return DONE


def report_on(
    console: Console,
    paths: Sequence[Path],
    path: Path,
    *,
    full: bool = False,
) -> None:
    """Write the page of results, and print its size and path.

    Args:
        console: Where they are printed.
        paths: Files and folders of results.
        path: The page.
        full: True to print the whole list of what was left out.

    Raises:
        ArgumentError: If there are no results that can be read.
    """
    from grosmc_mj.output.page.reading import read_results
    from grosmc_mj.output.page.write import write_page

    reading = read_results(paths)
    if not reading.documents:
        mistakes = [f"no results in {', '.join(map(str, paths))}"]
        mistakes.extend(f"unreadable: {line}" for line in reading.notices)
        raise ArgumentError(together(mistakes))

    written = write_page(reading, paths, path)
    console.print(f"{counted(len(reading.documents), 'document')} in {written.size / 1e6:.1f} MB")
    omitted = [f"left out: {line}" for line in written.notices]
    screen.say_lines(console, omitted, "dim", full=full)
    screen.say_files(console, path)
