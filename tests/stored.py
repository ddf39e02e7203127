"""Folders, and commands that have run, which the tests of a session make once."""

from __future__ import annotations

import contextlib
import fcntl
import io
import json
import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from commands import run


class Stored(NamedTuple):
    """A command that has run: its exit code, its words, and the folder of its results."""

    code: int
    said: str
    folder: Path

    def read(self, name: str) -> Any:
        """A JSON document of its folder."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Store:
    """Folders that are filled once a session, for all of its worker processes."""

    root: Path

    def folder(self, name: str, fill: Callable[[Path], object]) -> Path:
        """The folder of this name; the first process that needs it fills it, others wait."""
        folder, done = self.root / name, self.root / f"{name}.done"
        self.root.mkdir(exist_ok=True)
        with (self.root / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                fill(folder)
                done.touch()
        return folder

    def command(self, *arguments: str) -> Stored:
        """A command of the package with its ``--out``; tests only read its folder.

        CI has run ``validate`` before, and names its folder in ``VALIDATED``.
        """
        made = os.environ.get("VALIDATED") if arguments == ("validate",) else None
        name = "_".join(arguments).replace("/", "-")
        folder = Path(made) if made else self.folder(name, partial(_command, arguments))
        said = (folder / "said.txt").read_text(encoding="utf-8")
        return Stored(int((folder / "code.txt").read_text()), said, folder)


def _command(arguments: tuple[str, ...], folder: Path) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = run(*arguments, "--out", folder)
    (folder / "said.txt").write_text(said.getvalue(), encoding="utf-8")
    (folder / "code.txt").write_text(str(code))
