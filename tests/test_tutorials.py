"""A reader who follows a tutorial sees what it shows: files, commands and Python in their order."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from grosmc_mj import cli

pytestmark = pytest.mark.slow

TUTORIALS = Path(__file__).parents[1] / "docs" / "tutorials"
# Machines part under sign switching, so numbers are those shown to within this share.
CLOSE = 0.1

# Language, the file that a block belongs to if any, and text.
_BLOCK = re.compile(r"^```(\w+)(?: title=\"([\w.]+)\")?\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")


def says(line: str, shown: str) -> bool:
    """Whether a line has the words shown, and numbers close to those shown."""
    if _NUMBER.sub("#", line).split() != _NUMBER.sub("#", shown).split():
        return False
    found, told = (list(map(float, _NUMBER.findall(each))) for each in (line, shown))
    return found == pytest.approx(told, rel=CLOSE)


def require_shown(printed: str, shown: str) -> None:
    """All lines shown were printed, in their order."""
    lines = iter(printed.splitlines())
    for wanted in shown.splitlines():
        assert any(says(line, wanted) for line in lines), f"{wanted!r} is not in\n{printed}"


@pytest.mark.parametrize("page", sorted(TUTORIALS.glob("*.md")), ids=lambda page: page.stem)
def test_a_tutorial_shows_what_comes_out(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for language, file, text in _BLOCK.findall(page.read_text(encoding="utf-8")):
        if file:
            with Path(file).open("a", encoding="utf-8") as open_file:
                open_file.write(text)
        elif language == "python":
            capsys.readouterr()
            exec(compile(text, page.name, "exec"), names)
        elif language == "text":
            require_shown(capsys.readouterr().out, text)
        elif language == "console":
            command, _, shown = text.partition("\n")
            program, *arguments = shlex.split(command.removeprefix("$ "))
            assert program == "grosmc-mj"
            with pytest.raises(SystemExit) as stop:
                cli.main(arguments)
            output = capsys.readouterr()
            printed = output.out
            assert shown
            # Exit code 1 is a requirement that is not kept.
            failed = re.match(r"\d+ of \d+ requirements are not kept", printed)
            assert stop.value.code == int(bool(failed)), output.err
            require_shown(printed, shown)
