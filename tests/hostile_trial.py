"""Commands on hostile input: each one ends as it may, in bounded time and memory."""

from __future__ import annotations

import re
import shutil
import signal
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from commands import run

from grosmc_mj import cli
from grosmc_mj.ground.errors import MISTAKE_SEPARATOR

_PROGRESS = re.compile(r"^\d+ of \d+ in [^\n]*\n", re.M)
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_SLIP = re.compile(r" is implausible; usual: | is beyond the joint's range of ")
# Seconds of this process's work, and of the clock, which child processes and pipes take as well.
_MOST_WORK = 20
_MOST_TIME = 120
# Most memory of this process [kB]: a log has 1 GB of numbers at most.
_MOST_MEMORY = 3 << 20


class Answer(NamedTuple):
    """Exit code and output of a command."""

    code: int
    output: str


def without_notes(error: str) -> str:
    """An error without what may stand before it.

    A busy machine is slow enough for lines of progress. Numbers that are allowed and probably a
    slip have a line each.
    """
    lines = _PROGRESS.sub("", error).splitlines(keepends=True)
    return "".join(line for line in lines if not _SLIP.search(line))


def is_one_line(error: str) -> bool:
    """Whether it is one clear line, or one for each of several mistakes and their number."""
    if not error.endswith("\n") or "unforeseen" in error:
        return False

    first, *mistakes = error.removesuffix("\n").split(MISTAKE_SEPARATOR)
    if not first.startswith("grosmc-mj: "):
        return False
    if mistakes and not first.endswith(f"{len(mistakes)} mistakes:"):
        return False
    return all("\n" not in line and len(line) <= 1100 for line in (first, *mistakes))


def forget_peak_memory() -> None:
    """Begin to measure the peak of this process's memory anew (proc(5), VmHWM)."""
    Path("/proc/self/clear_refs").write_text("5")


def peak_memory() -> int:
    """Most memory of this process since then [kB]."""
    (line,) = re.findall(r"^VmHWM:\s+(\d+) kB$", Path("/proc/self/status").read_text(), re.M)
    return int(line)


@contextmanager
def ended_after(seconds: int, name: str) -> Iterator[None]:
    """Fail where the block has not ended by then."""

    def fail(*_: Any) -> None:
        pytest.fail(f"{name} has not ended after {seconds} s")

    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


class Trial:
    """Runs commands in a hostile folder, each of which must end as it may, and counts the ends.

    ``canary`` exists once something was executed.
    """

    def __init__(self, capture: pytest.CaptureFixture[str], folder: Path) -> None:
        self._capture = capture
        self._folder = folder
        self.canary = folder.parent / "canary-was-executed"
        self.ends = Counter[int]()
        for name in ("canary", "json", "numpy", "module"):
            (folder / f"{name}.py").write_text(f"open({str(self.canary)!r}, 'w').close()\n")
        self._files = set(folder.iterdir())

    def run(self, name: str, *arguments: Any, leaves: bool = False) -> Answer:
        """Run a command, named in words, that may leave files in the working folder or not."""
        self._capture.readouterr()
        forget_peak_memory()
        began = time.process_time()
        with ended_after(_MOST_TIME, name):
            code = run(*arguments)
        seconds = time.process_time() - began
        output = self._capture.readouterr()
        new = self._remove_new()
        assert not self.canary.exists(), f"{name} was executed"
        assert leaves or not new, f"{name} left {new} behind"
        assert seconds <= _MOST_WORK, name
        assert peak_memory() <= _MOST_MEMORY, name
        assert not _CONTROL.search(output.out + output.err), name
        error = without_notes(output.err)
        if code == cli.WRONG:
            assert is_one_line(error), f"{name}: {error[-300:]!r}"
        else:
            assert code in (cli.DONE, cli.DIFFERS), name
            assert error == "", name
        self.ends[code] += 1
        return Answer(code, output.out)

    def _remove_new(self) -> set[Path]:
        """Remove what a command has left in the working folder, and return it."""
        new = set(self._folder.iterdir()) - self._files
        for path in new:
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()
        return new
