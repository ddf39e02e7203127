"""What the commands share: exit codes, the console, brief tables, the progress bar."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from grosmc_mj.cli.exit_codes import DIFFERS as DIFFERS
from grosmc_mj.cli.exit_codes import DONE as DONE
from grosmc_mj.cli.exit_codes import WRONG as WRONG
from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from grosmc_mj.results.tables import Table

# An answer fits in a screen: forty lines of so many columns.
WIDTH = 100
# The tables of --verbose may be as wide.
_FULL_WIDTH = 200
# Seconds between two lines of progress where there is no bar.
LINE_EVERY = 10.0
# Of one kind, such as results that differ; and rows of a table.
_MOST_LINES, _MOST_ROWS = 5, 16


def console() -> Console:
    """Standard output, as wide as an answer."""
    from rich.console import Console

    return Console(highlight=False, width=WIDTH)


def wide_console() -> Console:
    """Standard output, never narrower than the widest table."""
    from rich.console import Console

    return Console(highlight=False, width=max(_FULL_WIDTH, Console().width))


def say_verdict(to: Console, words: str, *, good: bool) -> None:
    """Print the line that an answer begins with."""
    to.print(words, style=f"bold {'green' if good else 'red'}", markup=False)


def say_lines(to: Console, lines: Sequence[str], style: str = "red", *, all: bool) -> None:
    """Print lines of one kind: all of them, or the first ones and how many there are more."""
    shown = lines if all else lines[:_MOST_LINES]
    for line in shown:
        to.print(line, style=style, markup=False, soft_wrap=all)
    if left := len(lines) - len(shown):
        to.print(f"... and {left} more: --verbose has them", style=style)


def say_files(to: Console, *files: Path) -> None:
    """Print where everything is, in a line or a line each; paths are not folded."""
    words = ", ".join(map(str, files))
    for line in [words] if len(words) <= WIDTH else map(str, files):
        to.print(line, soft_wrap=True, markup=False)


def notice(line: str) -> None:
    """Say what is no result, beside the results."""
    print(line, file=sys.stderr)


@contextlib.contextmanager
def partial_results_kept(write: Callable[[], Sequence[Path]], advice: str = "") -> Iterator[None]:
    """Write what is there and say where, if what is done within is interrupted or fails.

    Args:
        write: Writes it, and returns where it is.
        advice: What to do after an interrupt; to start over by default.
    """
    try:
        yield
    except (Exception, KeyboardInterrupt) as end:
        with contextlib.suppress(SetupError):  # the first error is the one to tell
            if files := write():
                say_files(console(), *files)
        if advice and isinstance(end, KeyboardInterrupt):
            raise KeyboardInterrupt(advice) from None
        raise


def brief_table(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    words: int = 1,
    most: int = 12,
    styles: Sequence[str] = (),
) -> Table:
    """A table of at most so many rows for an answer; words wrap, and numbers never do.

    Args:
        title: Above it.
        columns: Their headers.
        rows: A text for each column, the worst first.
        words: So many columns hold words; those after them hold numbers.
        most: Rows that are shown; the caption says how many there are more.
        styles: Of the rows; none for plain ones.
    """
    from grosmc_mj.results.tables import numbers, phrases, table

    headers = [*phrases(*columns[:words]), *numbers(*columns[words:])]
    return _cut(table(title, headers, rows, styles=styles), most)


def _cut(table: Table, most: int) -> Table:
    """The first rows of a table; the caption says how many there are more."""
    if (left := len(table.rows) - most) <= 0:
        return table
    more = f"... and {left} more: --verbose has them"
    return table.model_copy(update={"rows": table.rows[:most], "legend": more})


def say_result(
    content: Mapping[str, Any],
    path: Path,
    lines: Sequence[str] = (),
    *,
    full: bool,
    brief: int = 1,
    tables: Sequence[Table] = (),
) -> None:
    """Write a result and print its answer, what is wrong, its tables, and where it is.

    One that cannot be written is printed all the same.

    Args:
        content: A result's document.
        path: Its JSON file.
        lines: What is wrong, a line each.
        full: Whether to print all lines, and all tables of the document.
        brief: How many of them are printed otherwise, cut to a screen.
        tables: To print in their place.
    """
    from grosmc_mj.results.document import write_json
    from grosmc_mj.results.result import KEPT, MEASURED

    answer = content["answers"][0]
    try:
        write_json(path, content)
    finally:
        say_verdict(
            console(), f"{answer['words'].rstrip('.')}.", good=answer["verdict"] in (KEPT, MEASURED)
        )
        say_lines(console(), lines, all=full)
        if tables:
            console().print(*tables)
        else:
            say_tables(content, None if full else brief)
    say_files(console(), path)


def say_tables(content: Mapping[str, Any], brief: int | None = None) -> None:
    """Print the tables of a result's document: all, or the first ones, cut to a screen."""
    from grosmc_mj.results.result import Sheet

    tables = [Sheet.model_validate(sheet).table for sheet in content["sheets"][:brief]]
    for table in (table for table in tables if table.rows):
        if brief is None:
            wide_console().print(table, "")
        else:
            console().print(_cut(table, _MOST_ROWS))


class _Lines:
    """Progress as lines on standard error, one every ten seconds at most."""

    def __init__(self, console: Console, total: int, unit: str) -> None:
        self._console, self._total, self._unit, self._done = console, total, unit, 0
        self._began = self._said = time.monotonic()

    def __call__(self, text: str = "", by: int = 1) -> None:
        """Note what has been done."""
        self._done += by
        now = time.monotonic()
        if now - self._said < LINE_EVERY:
            return
        self._said = now
        words = f"{self._done} of {self._total} {self._unit}".rstrip()
        text = f": {' '.join(text.split())}" if text.strip() else ""
        line = f"{words} in {now - self._began:.0f} s{text}"
        self._console.print(line, soft_wrap=True, markup=False, highlight=False)


@contextlib.contextmanager
def progress(total: int, unit: str = "") -> Iterator[Any]:
    """A progress bar on standard error; advance it by calling.

    Where that is no terminal, a line now and then.
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
        task = bar.add_task("", total=total)
        yield lambda text="", by=1: bar.update(task, advance=by, description=f"{text:<40}")
