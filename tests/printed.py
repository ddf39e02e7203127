"""What a command prints, stored as a file that a person reviews: its words, and its numbers nearly.

A snapshot holds the command, its exit code and both of its outputs. Words are compared to the
letter. Numbers may differ in their last printed digit, since machines differ by theirs: oracles of
the numbers are tests of what computes them. After a deliberate change:

    python -m pytest tests/cli --snapshot-update
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from commands import run
from syrupy.extensions.single_file import SingleFileSnapshotExtension, WriteMode

# Two numbers of three digits that differ by one in the last.
CLOSE = 0.01
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class Printed(SingleFileSnapshotExtension):
    """Text files in a folder of their test file."""

    _write_mode = WriteMode.TEXT
    file_extension = "txt"

    @classmethod
    def get_snapshot_name(cls, **where: Any) -> str:
        """Return the name of a file; that of a parameter may be a path."""
        return super().get_snapshot_name(**where).replace("/", "-")

    def serialize(self, data: Any, **_: Any) -> str:
        """Return what is stored: the text as it is."""
        return data

    def matches(self, *, serialized_data: Any, snapshot_data: Any) -> bool:
        """Return True for the same words and lines, with numbers that are close."""
        lines, stored = serialized_data.splitlines(), snapshot_data.splitlines()
        if [NUMBER.sub("#", line).split() for line in lines] != [
            NUMBER.sub("#", line).split() for line in stored
        ]:
            return False
        numbers = [float(number) for number in NUMBER.findall(serialized_data)]
        return numbers == pytest.approx(
            [float(number) for number in NUMBER.findall(snapshot_data)], rel=CLOSE
        )


def answer(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: object) -> str:
    """Run a command; return it as in a terminal, with its exit code and without the folder."""
    words = [str(argument) for argument in arguments]
    capsys.readouterr()
    code = run(*words)
    said = capsys.readouterr()
    text = f"$ grosmc-mj {shlex.join(words)}\n{said.out}{said.err}exit code {code}\n"
    # Trailing spaces of tables are nothing that a person sees.
    lines = [line.rstrip() for line in text.replace(str(folder), "FOLDER").splitlines()]
    return "\n".join(lines) + "\n"
