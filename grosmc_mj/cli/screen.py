"""What the commands share: exit codes, the console, the progress bar."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

from rich.console import Console

from grosmc_mj.cli.entry import DIFFERS as DIFFERS
from grosmc_mj.cli.entry import DONE as DONE

# Wide enough for the table of results when standard output is no terminal.
_WIDTH = 120


def console() -> Console:
    """Standard output, never narrower than the table of results."""
    return Console(highlight=False, width=max(_WIDTH, Console().width))


@contextlib.contextmanager
def progress(total: int, unit: str = "") -> Iterator[Any]:
    """A progress bar on standard error, where that is a terminal; advance it by calling."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    error_console = Console(stderr=True)
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
        disable=not error_console.is_terminal,
    ) as bar:
        task = bar.add_task("", total=total)
        yield lambda text="", by=1: bar.update(task, advance=by, description=f"{text:<40}")
