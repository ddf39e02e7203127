"""Pages of the documentation, followed as a reader does: files, commands and what they print."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from commands import Screen, run

# Tolerance of numbers: under sign switching the trajectories of two machines part.
CLOSE = 0.1

# Language, name of the file that a block belongs to if any, and text.
BLOCK = re.compile(r"^```(\w+)(?: title=\"([\w.]+)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


def agrees(printed: str, shown: str) -> bool:
    """Return True if a line has the words of another one, and numbers close to those of it."""
    if NUMBER.sub("#", printed).split() != NUMBER.sub("#", shown).split():
        return False
    numbers = [float(number) for number in NUMBER.findall(printed)]
    expected = [float(number) for number in NUMBER.findall(shown)]
    return numbers == pytest.approx(expected, rel=CLOSE)


def require_shown(printed: str, shown: str) -> None:
    """Require that all lines shown were printed, in their order."""
    lines = iter(printed.splitlines())
    for line_shown in shown.splitlines():
        was_printed = any(agrees(line, line_shown) for line in lines)
        assert was_printed, f"{line_shown!r} is not in\n{printed}"


def require_command(block: str, capsys: Screen) -> None:
    """Run the command of a block, and require the lines below it."""
    command, _, shown = block.partition("\n")
    assert shown
    program, *arguments = shlex.split(command.removeprefix("$ "))
    assert program == "grosmc-mj"
    code = run(*arguments)

    output = capsys.readouterr()
    # Exit code 1 is a requirement that is not kept, or a measured number outside its spread.
    failed = re.search(
        r"\A\d+ of \d+ requirements? (?:is|are) not kept|^outside the spread:",
        output.out,
        re.MULTILINE,
    )
    assert code == int(failed is not None), output.err
    require_shown(output.out, shown)


def follow(page: str, name: str, capsys: Screen) -> None:
    """Write the files of a page into the working directory, and run its programs and commands.

    Args:
        page: Text in Markdown. A block with a title is the file of that name, or goes on with it.
        name: Name of the page in a traceback.
        capsys: The output.
    """
    names: dict[str, Any] = {}
    for language, file, text in BLOCK.findall(page):
        if file:
            with Path(file).open("a", encoding="utf-8") as open_file:
                open_file.write(text)
        elif language == "python":
            capsys.readouterr()
            exec(compile(text, name, "exec"), names)
        elif language == "text":
            require_shown(capsys.readouterr().out, text)
        elif language == "console":
            require_command(text, capsys)
