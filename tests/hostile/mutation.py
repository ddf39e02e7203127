"""Seeded mutations of text, as an enemy, a bad disk or a tired user would make them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from functools import partial

# What stands where a number should, or is no number that anything should be.
NUMBERS = (
    "0", "-0.0", "-1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e400", "9" * 19,
    "9" * 400, "9" * 5000, "0x10", "1_0", "true", '""', "[]", "{}", "[1, [2]]", "1979-05-27",
    "12:00:00", '"1"', '"nan"', "[" * 3000 + "]" * 3000,
)  # fmt: skip
# What stands where a text should. CANARY becomes code that would leave a file behind.
TEXTS = (
    "", " ", ".", "..", "../../up", "/etc/passwd", "/dev/zero", "a/" * 999, "\\u0000",
    "\\u001b[31mred", "\\n\\ngrosmc-mj: all is well", "\\u202egnp", "\\uD7FF", "x" * 100_000,
    "é" * 3000, "[bold]x[/]", "[/]", "{}", "%s%n", "nan", "inf s", "-1 s", "0 s", "1e-300 s",
    "1e300 s", "nan s", "1e400 rad", "1 parsec", "1 m**9**9", "1 s s s", "1 %", "10 ** 10",
    "module:name", "os:system", "json:dumps", "canary:law", "canary:", ":law", "a:b:c",
    "..canary:x",
    "sin(t", "9**9**9", "sin(10**10**10)", "((9!)!)!", "(" * 900 + "t" + ")" * 900, "t" * 900,
    "1/(t-t)", "0/0", "sqrt(-1)", "t**1e9", "lambda: t", "t.__class__", "CANARY",
    'sin(\\"CANARY\\")',
    "sin('CANARY')", "__import__('os')", "servo", "physics", "lqr", "grosmc", "sine", "pulse",
)  # fmt: skip
_LETTERS = "\0\x1b\r\n\t\"'[]{}=.,#\\é\u202e\U0001f600"
_NUMBER = re.compile(r"(?<![\w\"'])-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_TEXT = re.compile(r'"[^"\n]*"')
_QUANTITY = re.compile(r'(?<=")-?\d+(?:\.\d+)?(?= )')
_KEY = re.compile(r"^[A-Za-z_]+(?= *=)", re.MULTILINE)
_HEADER = re.compile(r"^\[+[A-Za-z_]+\]+$", re.MULTILINE)


def code(canary: str) -> str:
    """Python that would touch a file, in octal, which hides it from a filter of words."""
    program = f"__import__('pathlib').Path({canary!r}).touch()"
    return "".join(f"\\\\{ord(each):o}" for each in program)


def mutant(text: str, rng: random.Random, canary: str) -> tuple[str, str]:
    """A mutated text and the kind of its mutation."""
    kind = rng.choice(list(MUTATIONS))
    changed = MUTATIONS[kind](text, rng).replace("CANARY", code(canary))
    return kind, changed


def replaced(pattern: re.Pattern[str], text: str, rng: random.Random, new: str) -> str:
    """One of the places that a pattern finds, replaced."""
    found = list(pattern.finditer(text))
    if not found:
        return new
    place = rng.choice(found)
    return text[: place.start()] + new + text[place.end() :]


def of_lines(text: str, rng: random.Random, how: str) -> str:
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


_NAMES = ("law", "name", "model", "plant", "x" * 5000, '"\\u001b"', "k", "Q", "reference", '"a.b"')
_HEADERS = (
    "[plant]",
    "[[plant]]",
    "[run]",
    "[[edit]]",
    "[task]",
    "[[uncertain]]",
    "[x]",
    "[[[x]]]",
)
_PLACES = {
    "key": (_KEY, _NAMES),
    "header": (_HEADER, _HEADERS),
    "number": (_NUMBER, NUMBERS),
    "text": (_TEXT, tuple(f'"{text}"' for text in TEXTS)),
    "text as number": (_TEXT, NUMBERS),
    "quantity": (_QUANTITY, tuple(number for number in NUMBERS if number[0].isalnum())),
}
MUTATIONS: dict[str, Callable[[str, random.Random], str]] = {
    "end": lambda text, rng: text[: rng.randrange(len(text))],
    "noise": _noise,
    **{how: partial(of_lines, how=how) for how in ("cut", "double", "swap")},
    **{
        kind: lambda text, rng, pattern=pattern, new=new: replaced(
            pattern, text, rng, rng.choice(new)
        )
        for kind, (pattern, new) in _PLACES.items()
    },
}
