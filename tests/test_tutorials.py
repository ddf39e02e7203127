"""A reader who follows a tutorial gets the output that it shows."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
from commands import Patch, Screen, run

pytestmark = pytest.mark.slow

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
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
    # Exit code 1 is a requirement that is not kept.
    failed = re.match(r"\d+ of \d+ requirements are not kept", output.out)
    assert code == int(failed is not None), output.err
    require_shown(output.out, shown)


# Half a minute: it trains an agent.
TRAINS = pytest.param(TUTORIALS / "your_agent.md", marks=pytest.mark.apart)
PAGES = [TRAINS if page.stem == "your_agent" else page for page in sorted(TUTORIALS.glob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_shows_what_comes_out(
    page: Path, tmp_path: Path, monkeypatch: Patch, capsys: Screen
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for language, file, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        if file:
            with Path(file).open("a", encoding="utf-8") as open_file:
                open_file.write(text)
        elif language == "python":
            capsys.readouterr()
            exec(compile(text, page.name, "exec"), names)
        elif language == "text":
            require_shown(capsys.readouterr().out, text)
        elif language == "console":
            require_command(text, capsys)
