"""Output that commands share: consoles, verdicts, brief tables, progress."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console
    from rich.progress import Progress, TaskID

    from grosmc_mj.results.tables import Table

# An answer fits on a screen: forty lines of so many columns.
WIDTH = 100
# The tables of --verbose may be as wide.
_FULL_WIDTH = 200
# Seconds between two lines of progress where there is no bar.
LINE_EVERY = 10.0
# Lines of one kind that an answer shows, such as results that differ; and rows of a table.
_MOST_LINES = 5
_MOST_ROWS = 16


def console() -> Console:
    """Return standard output, as wide as an answer."""
    from rich.console import Console

    return Console(highlight=False, width=WIDTH)


def wide_console() -> Console:
    """Return standard output, never narrower than the widest table."""
    from rich.console import Console

    return Console(highlight=False, width=max(_FULL_WIDTH, Console().width))


def say_verdict(to: Console, words: str, *, good: bool) -> None:
    """Print the line that an answer begins with, green if it is good, else red."""
    color = "green" if good else "red"
    to.print(words, style=f"bold {color}", markup=False)


def say_lines(
    to: Console,
    lines: Sequence[str],
    style: str = "red",
    *,
    full: bool,
) -> None:
    """Print lines of one kind: all of them, or the first ones and how many there are more."""
    printed = lines if full else lines[:_MOST_LINES]
    for line in printed:
        to.print(line, style=style, markup=False, soft_wrap=full)

    more = len(lines) - len(printed)
    if more:
        to.print(f"... and {more} more: --verbose has them", style=style)


def say_files(to: Console, *files: Path) -> None:
    """Print paths of files, in one line or in a line each; paths are not folded."""
    paths = [str(file) for file in files]
    line = ", ".join(paths)
    lines = [line] if len(line) <= WIDTH else paths
    for line in lines:
        to.print(line, soft_wrap=True, markup=False)


def notice(line: str) -> None:
    """Print a line that is no result on standard error."""
    print(line, file=sys.stderr)


@contextlib.contextmanager
def partial_results_kept(write: Callable[[], Sequence[Path]], advice: str = "") -> Iterator[None]:
    """Write partial results and print their paths if this block is interrupted or fails.

    Args:
        write: Writes them, and returns their paths.
        advice: What to do after an interrupt; to start over by default.
    """
    try:
        yield
    except (Exception, KeyboardInterrupt) as end:
        # The error that ended the block is the one to report, not a second one here.
        with contextlib.suppress(SetupError):
            files = write()
            if files:
                say_files(console(), *files)

        if advice and isinstance(end, KeyboardInterrupt):
            raise KeyboardInterrupt(advice) from None
        raise


def say_result(
    content: Mapping[str, Any],
    path: Path,
    lines: Sequence[str] = (),
    *,
    full: bool,
    brief: int = 1,
    tables: Sequence[Table] = (),
) -> None:
    """Write a result's document, then print its answer, mistakes, tables and path.

    A result that cannot be written is printed all the same.

    Args:
        content: The document.
        path: Its JSON file.
        lines: Mistakes, a line each.
        full: True to print all lines, and all tables of the document.
        brief: How many of them are printed otherwise, cut to a screen.
        tables: Tables to print in place of the document's.
    """
    from grosmc_mj.results.document import write_json
    from grosmc_mj.results.result import KEPT, MEASURED

    try:
        write_json(path, content)
    finally:
        answer = content["answers"][0]
        words = answer["words"].rstrip(".")
        say_verdict(console(), f"{words}.", good=answer["verdict"] in (KEPT, MEASURED))
        say_lines(console(), lines, full=full)

        if tables:
            console().print(*tables)
        elif full:
            say_tables(content)
        else:
            say_tables(content, brief)
    say_files(console(), path)


def say_tables(content: Mapping[str, Any], brief: int | None = None) -> None:
    """Print the tables of a result's document: all, or the first ones, cut to a screen."""
    from grosmc_mj.results.result import ReportTable

    for sheet in content["sheets"][:brief]:
        table = ReportTable.model_validate(sheet).table
        if not table.rows:
            continue
        if brief is None:
            wide_console().print(table, "")
        else:
            console().print(table.brief(_MOST_ROWS))


class _Lines:
    """Progress as lines on standard error, one every ten seconds at most."""

    def __init__(self, console: Console, total: int, unit: str) -> None:
        self._console = console
        self._total = total
        self._unit = unit
        self._done = 0
        self._start = time.monotonic()
        self._last_line = self._start

    def __call__(self, text: str = "", by: int = 1) -> None:
        """Count so many more as done, and print a line if the last one is old enough."""
        self._done += by
        now = time.monotonic()
        if now - self._last_line < LINE_EVERY:
            return
        self._last_line = now

        count = f"{self._done} of {self._total} {self._unit}".rstrip()
        line = f"{count} in {now - self._start:.0f} s"
        if text.strip():
            line += f": {' '.join(text.split())}"
        self._console.print(line, soft_wrap=True, markup=False, highlight=False)


class _Bar:
    """Progress as a bar of rich."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar = bar
        self._task = task

    def __call__(self, text: str = "", by: int = 1) -> None:
        """Count so many more as done, and put a text before the bar."""
        self._bar.update(self._task, advance=by, description=f"{text:<40}")


@contextlib.contextmanager
def progress(total: int, unit: str = "") -> Iterator[Any]:
    """Show progress on standard error: a bar, or lines now and then where that is no terminal.

    Args:
        total: Steps of the work.
        unit: Name of a step, in the plural.

    Yields:
        A function ``advance(text="", by=1)``, to be called when a step is done.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    error_console = Console(stderr=True)
    if not error_console.is_terminal:
        yield _Lines(error_console, total, unit)
        return

    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=error_console,
        transient=True,
    ) as bar:
        yield _Bar(bar, bar.add_task("", total=total))
