"""Hostile inputs: seeded mutations of text, and whether a command ends as it may."""

from __future__ import annotations

import os
import random
import re
import shutil
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from grosmc_mj import cli
from grosmc_mj.cli import screen
from grosmc_mj.errors import NEXT

# So many times as many mutations; `make hostile` asks for more.
TIMES = int(os.environ.get("HOSTILE", "1"))
KEPT, LINE, VERDICT = "kept", "one line", "a verdict"
# Of the processor [s], and of the line.
_LONGEST_TIME, _LONGEST_LINE = 20.0, 1100
_PROGRESS = re.compile(r"^\d+ of \d+ in [^\n]*\n", re.M)
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")

# In place of a number, or no number that anything should be.
NUMBERS = (
    "0", "-0.0", "-1", "nan", "-inf", "1e308", "1e-320", "1e400", "9" * 19, "9" * 5000, "0x10",
    "true", '""', "[]", "{}", "1979-05-27", '"nan"', "[" * 3000 + "]" * 3000,
)  # fmt: skip
# In place of a text. CANARY becomes code that would leave a file behind.
TEXTS = (
    "", ".", "../../up", "/etc/passwd", "/dev/zero", "a/" * 999, "\\u0000", "\\u001b[31mred",
    "\\n\\ngrosmc-mj: all is well", "\\u202egnp", "\\uD7FF", "x" * 100_000, "[bold]x[/]", "[/]",
    "{}", "%s%n", "nan", "-1 s", "0 s", "1e-300 s", "1e300 s", "nan s", "1e400 rad", "1 parsec",
    "1 m**9**9", "1 s s s", "10 ** 10", "os:system", "json:dumps", "canary:law", ":law", "a:b:c",
    "..canary:x", "sin(t", "9**9**9", "((9!)!)!", "(" * 900 + "t" + ")" * 900, "1/(t-t)",
    "sqrt(-1)", "lambda: t", "t.__class__", "CANARY", 'sin(\\"CANARY\\")', "sin('CANARY')",
    "__import__('os')", "servo", "physics", "lqr", "grosmc", "pulse",
)  # fmt: skip
_LETTERS = "\0\x1b\r\n\t\"'[]{}=.,#\\é\u202e\U0001f600"
_NAMES = ("law", "name", "model", "plant", "x" * 5000, '"\\u001b"', "k", "Q", "reference", '"a.b"')
_HEADERS = ("[plant]", "[[plant]]", "[run]", "[[edit]]", "[task]", "[[uncertain]]", "[x]",
            "[[[x]]]")  # fmt: skip
_TEXT = r'"[^"\n]*"'
# Places of a case file, and their replacements.
_PLACES = {
    "key": (r"(?m)^[A-Za-z_]+(?= *=)", _NAMES),
    "header": (r"(?m)^\[+[A-Za-z_]+\]+$", _HEADERS),
    "number": (r"(?<![\w\"'])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?", NUMBERS),
    "text": (_TEXT, tuple(f'"{text}"' for text in TEXTS)),
    "text as number": (_TEXT, NUMBERS),
    "quantity": (r'(?<=")-?\d+(?:\.\d+)?(?= )', tuple(n for n in NUMBERS if n[0].isalnum())),
}


def code(canary: str) -> str:
    """Python that would touch a file, in octal, which hides it from a filter of words."""
    program = f"__import__('pathlib').Path({canary!r}).touch()"
    return "".join(f"\\\\{ord(letter):o}" for letter in program)


def replaced(pattern: str, text: str, rng: random.Random, new: str) -> str:
    """One of the places that a pattern matches, replaced; \\g<0> in the new text is the old one."""
    places = list(re.finditer(pattern, text))
    if not places:
        return new
    place = rng.choice(places)
    return text[: place.start()] + new.replace(r"\g<0>", place[0]) + text[place.end() :]


def _of_lines(text: str, rng: random.Random, how: str) -> str:
    """A line left out, twice, or in another one's place."""
    lines = text.splitlines(keepends=True)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    if how == "swap":
        lines[i], lines[j] = lines[j], lines[i]
    lines[i : i + 1] = {"cut": [], "double": [lines[i]] * 2}.get(how, [lines[i]])
    return "".join(lines)


def _noise(text: str, rng: random.Random) -> str:
    letters = list(text)
    for _ in range(rng.randint(1, 5)):
        letters[rng.randrange(len(letters))] = rng.choice(_LETTERS)
    return "".join(letters)


MUTATIONS: dict[str, Callable[[str, random.Random], str]] = {
    "end": lambda text, rng: text[: rng.randrange(len(text))],
    "noise": _noise,
    **{how: partial(_of_lines, how=how) for how in ("cut", "double", "swap")},
    **{
        kind: lambda text, rng, pattern=place, new=new: replaced(
            pattern, text, rng, rng.choice(new)
        )
        for kind, (place, new) in _PLACES.items()
    },
}


def mutant(text: str, rng: random.Random, canary: str) -> tuple[str, str]:
    """A mutated text and the kind of its mutation."""
    kind = rng.choice(list(MUTATIONS))
    return kind, MUTATIONS[kind](text, rng).replace("CANARY", code(canary))


class Trial:
    """Runs commands in a hostile folder, counts their ends and notes those not allowed.

    ``canary`` exists once something was executed.
    """

    def __init__(self, capture: pytest.CaptureFixture[str], folder: Path) -> None:
        self._capture, self._folder = capture, folder
        self.canary = folder.parent / "canary-was-executed"
        self.ends, self.wrong = Counter[str](), list[str]()
        for name in ("canary", "json", "numpy", "module"):
            (folder / f"{name}.py").write_text(f"open({str(self.canary)!r}, 'w').close()\n")
        self._files = set(folder.iterdir())

    def run(self, name: str, *arguments: Any, leaves: bool = False) -> str:
        """Run a command, named in words, that may leave files in the working folder or not."""
        self._capture.readouterr()
        began, code = time.process_time(), None
        try:
            cli.main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = stop.code
        except BaseException as error:
            return self.expect(f"{name}: {type(error).__name__}: {error}", holds=False)
        output, seconds = self._capture.readouterr(), time.process_time() - began
        executed, new = self.canary.exists(), set(self._folder.iterdir()) - self._files
        self.canary.unlink(missing_ok=True)
        for path in new:
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        for holds, reason in (
            (not executed, "it was executed"),
            (leaves or not new, f"it left {new} behind"),
            (seconds <= _LONGEST_TIME, f"it took {seconds:.0f} s"),
            (not _CONTROL.search(output.out + output.err), "a control character was printed"),
        ):
            if not holds:
                return self.expect(f"{name}: {reason}", holds=False)
        # A busy machine is slow enough for lines of progress.
        end, error = "", _PROGRESS.sub("", output.err)
        if code in (cli.DONE, cli.DIFFERS) and not error:
            end = KEPT if code == cli.DONE else VERDICT
        elif code == cli.WRONG and _one_line(error):
            end = LINE
        return self.expect(f"{name}: code {code}: {output.err[-300:]!r}", holds=bool(end), end=end)

    def expect(self, words: str, *, holds: bool, end: str = "") -> str:
        """Note an allowed end, or an end that is not."""
        if not holds:
            self.wrong.append(words)
        if end or not holds:
            self.ends[end if holds else "wrong"] += 1
        return end if holds else "wrong"


def _one_line(error: str) -> bool:
    """Whether it is one clear line, or one for each of several mistakes and their number."""
    # Numbers that are allowed and probably a slip have a line of their own before it.
    lines = error.splitlines(keepends=True)
    error = "".join(line for line in lines if " is implausible; usual: " not in line)
    first, *mistakes = error.removesuffix("\n").split(NEXT)
    if not error.endswith("\n") or not first.startswith("grosmc-mj: "):
        return False
    counted = first.endswith(f"{len(mistakes)} mistakes:") if mistakes else True
    short = all("\n" not in line and len(line) <= _LONGEST_LINE for line in (first, *mistakes))
    return counted and short and "unforeseen" not in error


@contextmanager
def trial(capture: pytest.CaptureFixture[str], tmp_path: Path, least: int) -> Iterator[Trial]:
    """A trial in a folder of its own: so many commands are tried, and none ends badly."""
    folder = tmp_path / "working"
    folder.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        # No line of progress, however slow the machine is.
        patch.setattr(screen, "LINE_EVERY", float("inf"))
        hostile = Trial(capture, folder)
        yield hostile
    ends = hostile.ends
    assert hostile.wrong == [], f"{hostile.wrong} of {dict(ends)}"
    assert sum(ends.values()) >= least
    # An oracle that calls everything an error would see nothing.
    assert ends[LINE] > 0
    assert ends[KEPT] + ends[VERDICT] > 0
