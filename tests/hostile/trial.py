"""One hostile input at a time: what became of it, and whether that is one of the allowed ends."""

from __future__ import annotations

import os
import re
import shutil
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from grosmc_mj import cli
from grosmc_mj.errors import NEXT

# So many times as many mutations; `make hostile` asks for more.
TIMES = int(os.environ.get("HOSTILE", "1"))
KEPT, LINE, VERDICT = "kept", "one line", "a verdict"
# Of the processor [s], and of the line.
_LONGEST_TIME, _LONGEST_LINE = 20.0, 1100
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_PROGRESS = re.compile(r"^\d+ of \d+ in [^\n]*\n", re.M)


@dataclass
class Trial:
    """Runs commands in a hostile folder and counts how they end.

    Attributes:
        capture: pytest's, of the file descriptors.
        folder: Where the commands run; modules lie there that must not be imported.
        ends: How many commands came to which end.
        wrong: What came to none of the allowed ends, in words.
    """

    capture: pytest.CaptureFixture[str]
    folder: Path
    ends: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name in ("canary", "json", "numpy", "module"):
            (self.folder / f"{name}.py").write_text(f"open({str(self.canary)!r}, 'w').close()\n")
        self._files = set(self.folder.iterdir())

    @property
    def canary(self) -> Path:
        """Exists once something was executed."""
        return self.folder.parent / "canary-was-executed"

    def run(self, what: str, *arguments: Any, leaves: bool = False) -> str:
        """Run a command; ``what`` names it where it ends badly.

        Args:
            what: Words for it.
            arguments: Of the command line.
            leaves: Whether it may leave files in the working folder, which then are removed.
        """
        self.capture.readouterr()
        began, code = time.process_time(), None
        try:
            cli.main([str(each) for each in arguments])
        except SystemExit as stop:
            code = stop.code
        except BaseException as error:
            return self._bad(what, f"{type(error).__name__}: {error}")
        said = self.capture.readouterr()
        seconds = time.process_time() - began
        if self.canary.exists():
            self.canary.unlink()
            return self._bad(what, "it was executed")
        if new := set(self.folder.iterdir()) - self._files:
            for path in new:
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            if not leaves:
                return self._bad(what, f"it left {new} behind")
        if seconds > _LONGEST_TIME:
            return self._bad(what, f"it took {seconds:.0f} s")
        if _CONTROL.search(said.out + said.err):
            return self._bad(what, "a control character was printed")
        # A busy machine is slow enough for lines of progress.
        error = _PROGRESS.sub("", said.err)
        if code in (cli.DONE, cli.DIFFERS) and not error:
            return self._end(KEPT if code == cli.DONE else VERDICT)
        if code == cli.WRONG and self._one_line(error):
            return self._end(LINE)
        return self._bad(what, f"code {code}: {said.err[-300:]!r}")

    def expect(self, what: str, holds: bool, why: str) -> None:
        """Note what came to an allowed end and is wrong all the same."""
        if not holds:
            self._bad(what, why)

    def _one_line(self, said: str) -> bool:
        """Whether it is one clear line, or one for each of several mistakes and their number."""
        # Numbers that are allowed and probably a slip have a line of their own before it.
        lines = said.splitlines(keepends=True)
        said = "".join(line for line in lines if " is implausible; usual: " not in line)
        first, *mistakes = said.removesuffix("\n").split(NEXT)
        if not said.endswith("\n") or not first.startswith("grosmc-mj: "):
            return False
        counted = first.endswith(f"{len(mistakes)} mistakes:") if mistakes else True
        lines = [first, *mistakes]
        whole = all("\n" not in line and len(line) <= _LONGEST_LINE for line in lines)
        return counted and whole and "unforeseen" not in said

    def _end(self, end: str) -> str:
        self.ends[end] += 1
        return end

    def _bad(self, what: str, why: str) -> str:
        self.wrong.append(f"{what}: {why}")
        return self._end("wrong")

    def finish(self, least: int) -> None:
        """All were tried, and none ended badly."""
        assert self.wrong == [], f"{self.wrong} of {dict(self.ends)}"
        assert sum(self.ends.values()) >= least
        # An oracle that calls everything an error would see nothing.
        assert self.ends[LINE] > 0
        assert self.ends[KEPT] + self.ends[VERDICT] > 0


@contextmanager
def trial(capture: pytest.CaptureFixture[str], tmp_path: Path) -> Iterator[Trial]:
    """A trial in a folder of its own."""
    folder = tmp_path / "working"
    folder.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield Trial(capture, folder)
