"""Seeded mutations of text, as an enemy, a bad disk or a tired user would make them."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

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


def _replaced(pattern: re.Pattern[str], text: str, rng: random.Random, new: str) -> str:
    """One of the places that a pattern finds, replaced."""
    found = list(pattern.finditer(text))
    if not found:
        return new
    place = rng.choice(found)
    return text[: place.start()] + new + text[place.end() :]


def _cut(text: str, rng: random.Random) -> str:
    return text[: rng.randrange(len(text))]


def _without_line(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    del lines[rng.randrange(len(lines))]
    return "".join(lines)


def _with_line_twice(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    index = rng.randrange(len(lines))
    return "".join([*lines[: index + 1], lines[index], *lines[index + 1 :]])


def _with_lines_swapped(text: str, rng: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return "".join(lines)


def _noise(text: str, rng: random.Random) -> str:
    letters = list(text)
    for _ in range(rng.randint(1, 5)):
        letters[rng.randrange(len(letters))] = rng.choice(_LETTERS)
    return "".join(letters)


def _key(text: str, rng: random.Random) -> str:
    names = (
        "law",
        "name",
        "model",
        "plant",
        "x" * 5000,
        '"\\u001b"',
        "k",
        "Q",
        "reference",
        '"a.b"',
    )
    return _replaced(_KEY, text, rng, rng.choice(names))


def _header(text: str, rng: random.Random) -> str:
    headers = (
        "[plant]",
        "[[plant]]",
        "[run]",
        "[[edit]]",
        "[task]",
        "[[uncertain]]",
        "[x]",
        "[[[x]]]",
    )
    return _replaced(_HEADER, text, rng, rng.choice(headers))


MUTATIONS: dict[str, Callable[[str, random.Random], str]] = {
    "cut": _cut,
    "line left out": _without_line,
    "line twice": _with_line_twice,
    "lines swapped": _with_lines_swapped,
    "noise": _noise,
    "key": _key,
    "header": _header,
    "number": lambda text, rng: _replaced(_NUMBER, text, rng, rng.choice(NUMBERS)),
    "text": lambda text, rng: _replaced(_TEXT, text, rng, f'"{rng.choice(TEXTS)}"'),
    "text as number": lambda text, rng: _replaced(_TEXT, text, rng, rng.choice(NUMBERS)),
    "quantity": lambda text, rng: _replaced(
        _QUANTITY, text, rng, rng.choice([each for each in NUMBERS if each[0].isalnum()])
    ),
}
