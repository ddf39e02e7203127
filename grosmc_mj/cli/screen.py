"""Output that commands share: consoles, verdicts, brief tables, progress."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console
    from rich.progress import Progress, TaskID

    from grosmc_mj.output.results.result import Result

# An answer fits on a screen: forty lines of so many columns.
WIDTH = 100
# The tables of --verbose may be as wide.
_FULL_WIDTH = 200
# Seconds between two lines of progress where there is no bar.
LINE_EVERY = 10.0
# Lines of one kind that an answer shows, such as results that differ; remarks; rows of its tables.
_MOST_LINES = 5
_MOST_REMARKS = 14
_MOST_ROWS = 18
_LEAST_ROWS = 8
# Advice after an interrupt: where nothing is kept, and where finished pieces are.
AGAIN = "interrupted; run the same command again to start over"
RESUME = "interrupted; the same command with --resume runs what is missing"


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
    most: int = _MOST_LINES,
) -> None:
    """Print lines of one kind: all of them, or the first ones and how many there are more."""
    printed = lines if full else lines[:most]
    for line in printed:
        to.print(line, style=style, markup=False, soft_wrap=full)

    more = len(lines) - len(printed)
    if more:
        to.print(f"... and {more} more: --verbose has them", style=style)


def say_files(to: Console, *files: Path) -> None:
    """Print paths of files, in one line or in a line each; paths are not folded."""
    if not files:
        return
    paths = [str(file) for file in files]
    line = ", ".join(paths)
    lines = [line] if len(line) <= WIDTH else paths
    for line in lines:
        to.print(line, soft_wrap=True, markup=False)


def notice(line: str) -> None:
    """Print a line that is no result on standard error."""
    print(line, file=sys.stderr)


def say_result(
    result: Result,
    path: Path,
    draw: Callable[[], Sequence[Path]] = tuple,
    *,
    full: bool,
    among: bool = False,
) -> None:
    """Write a result, print it, draw its figures, and print the paths of all files.

    A result that cannot be written is printed all the same.

    Args:
        result: The result.
        path: Its JSON file.
        draw: Draws the figures and writes other files; returns their paths.
        full: True to print all tables and lines; else those of a brief answer.
        among: True if several results follow each other: each begins with its name, and only a
            table of one that is not good is printed.
    """
    from grosmc_mj.output.results.document import write_json

    try:
        write_json(path, result)
    finally:
        to = console()
        for answer in result.answers:
            words = answer.words.rstrip(".")
            if among:
                words = f"{path.stem}: {words}"
            say_verdict(to, f"{words}.", good=answer.good)
            say_lines(to, answer.faults, full=full)
            say_lines(to, answer.notes, "yellow", full=full)

        _say_tables(result, full=full, among=among)
        if full or not among:
            more = [answer.more for answer in result.answers if answer.more]
            say_lines(to, [*more, *result.remarks], "dim", full=full, most=_MOST_REMARKS)
    say_files(to, path, *draw())


def _say_tables(result: Result, *, full: bool, among: bool) -> None:
    """Print the tables of a result: all of them, or those of a brief answer, cut to a screen."""
    tables = [sheet.table for sheet in result.sheets if sheet.table.rows and (full or sheet.brief)]
    if full:
        for table in tables:
            wide_console().print(table, "")
        return

    if among:
        for table in [] if result.kept else tables[:1]:
            console().print(table.brief(_LEAST_ROWS).model_copy(update={"title": ""}))
        return
    # Long tables have the rows that short ones leave.
    share = max(_LEAST_ROWS, _MOST_ROWS // max(1, len(tables)))
    most = share + sum(max(0, share - len(table.rows)) for table in tables)
    for table in tables:
        # The verdict above stands for the title of a single table.
        shown = table.brief(most)
        title = "" if len(tables) == 1 else shown.title
        console().print(shown.model_copy(update={"title": title, "legend": ""}))
        # Below its table a legend would be as narrow.
        if shown.legend:
            console().print(shown.legend, style="dim", markup=False)


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
        elapsed = now - self._start
        line = f"{count} in {elapsed:.0f} s"
        if elapsed >= 1 and 0 < self._done < self._total:
            left = elapsed * (self._total - self._done) / self._done
            line += f", about {_duration(left)} left"
        if text.strip():
            line += f": {' '.join(text.split())}"
        self._console.print(line, soft_wrap=True, markup=False, highlight=False)


def _duration(seconds: float) -> str:
    """A rough duration in words."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    if seconds < 6000:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.0f} h"


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
