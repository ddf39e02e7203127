"""Text of TOML as values, or one line that says where it is wrong and how it is written."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.ground.errors import ArgumentError, value_text

# Number of the line in an error of TOML.
_LINE = re.compile(r"\(at line (\d+), ")
# A number with a unit as the value of a key, without quotes.
_BARE_QUANTITY = re.compile(r"=\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?\s*[A-Za-z%][\w^*/% ]*)")
# A number with a comma in the place of its point.
_DECIMAL_COMMA = re.compile(r"=\s*([-+]?\d+),(\d+)\s*(?:#|$)")
# A text without quotes as the value of a key.
_BARE_TEXT = re.compile(r"=\s*([A-Za-z_][\w.:/-]*)\s*(?:#|$)")
# A text in double quotes, in which a backslash begins an escape.
_BASIC_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_LITERAL_STRING = re.compile(r"'[^']*'")
_KEY = re.compile(r"\s*([\w-]+|\"[^\"]*\"|'[^']*')\s*=")
_COMMENT = re.compile(r"#.*")
_ESCAPED = ": in \"...\" a \\ begins an escape: write / or '...'"


def values_of_text(text: str, path: Path) -> dict[str, Any]:
    """Return the values of a text of TOML.

    Args:
        text: The text.
        path: The file that it is, or was, in.

    Raises:
        ArgumentError: If it is no TOML, or has characters or numbers that no case file has.
    """
    try:
        content = tomllib.loads(text)
        _refuse_odd(content, text)
    except tomllib.TOMLDecodeError as error:
        raise ArgumentError(f"{path}: no valid TOML: {error}{_hint(text, error)}") from error
    except RecursionError:
        raise ArgumentError(f"{path}: no valid TOML: it is nested too deep") from None
    # TOML's own errors, and one about integers of thousands of digits.
    except ValueError as error:
        raise ArgumentError(f"{path}: no valid TOML: {error}") from error
    return content


# -- what to write instead -------------------------------------------------------------------------


def _hint(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Return how the line of an error is written; empty where it does not tell."""
    place = _LINE.search(str(error))
    lines = text.splitlines()
    if place is None or int(place[1]) > len(lines) + 1:
        return ""

    # The end of the text is one line further than its last one.
    index = int(place[1]) - 1
    line = lines[index] if index < len(lines) else ""
    readers: Sequence[Callable[[str], str]] = (_escape, _bare_quantity, _comma, _bare_text)
    for reader in readers:
        hint = reader(line)
        if hint:
            return hint
    return _twice(lines, index) or _unclosed(lines, index)


def _escape(line: str) -> str:
    """Return the hint on a backslash that begins an escape of no character."""
    if any(_decoded(item) is None for item in _BASIC_STRING.findall(line)):
        return _ESCAPED
    return ""


def _bare_quantity(line: str) -> str:
    """Return the correct form of a number with a unit that has no quotes."""
    bare = _BARE_QUANTITY.search(line)
    if bare is None:
        return ""
    return f': a number with a unit is a text: write "{bare[1]}"'


def _comma(line: str) -> str:
    """Return the correct form of a number with a decimal comma."""
    comma = _DECIMAL_COMMA.search(line)
    if comma is None:
        return ""
    return f": a decimal point: write {comma[1]}.{comma[2]}"


def _bare_text(line: str) -> str:
    """Return the correct form of a text without quotes, or of a truth value."""
    bare = _BARE_TEXT.search(line)
    if bare is None:
        return ""
    word = bare[1]
    if word.lower() in ("true", "false"):
        return f": write {word.lower()}"
    return f': a text has quotes: write "{word}"'


def _twice(lines: Sequence[str], index: int) -> str:
    """Return the hint on a key that stands twice in the table of a line."""
    key = _key_in(lines, index)
    if not key:
        return ""
    for earlier in range(index - 1, -1, -1):
        if lines[earlier].lstrip().startswith("["):
            break
        if _key_in(lines, earlier) == key:
            return f": {key} stands in line {earlier + 1} already"
    return ""


def _unclosed(lines: Sequence[str], index: int) -> str:
    """Return the hint on the last bracket before a line that is not closed."""
    for earlier in range(min(index, len(lines) - 1), -1, -1):
        bare = _without_strings(lines[earlier])
        opened = bare.count("[") + bare.count("{")
        closed = bare.count("]") + bare.count("}")
        if opened > closed and _key_in(lines, earlier):
            return f": {_key_in(lines, earlier)} in line {earlier + 1} has a bracket left open"
    return ""


def _key_in(lines: Sequence[str], index: int) -> str:
    """Return the key that a line gives a value; empty for none."""
    key = _KEY.match(lines[index]) if index < len(lines) else None
    return key[1] if key is not None else ""


def _without_strings(line: str) -> str:
    """Return a line without its texts in quotes and its comment."""
    return _COMMENT.sub("", _LITERAL_STRING.sub("", _BASIC_STRING.sub("", line)))


def _decoded(string: str) -> str | None:
    """Return the text that a string of TOML stands for; None if it is none."""
    try:
        return tomllib.loads(f"text = {string}")["text"]
    except ValueError:
        return None


# -- values that no case file has ------------------------------------------------------------------


def _refuse_odd(value: Any, text: str) -> None:
    """Refuse control characters, and integers of more than 64 bits, which TOML does not have."""
    if isinstance(value, str) and not value.isprintable():
        raise ValueError(
            f"{value_text(value)} has characters that cannot be printed{_place_of(value, text)}"
        )
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError(f"{value_text(value)} has more than 64 bits")

    members: list[Any] = []
    if isinstance(value, list):
        members = value
    elif isinstance(value, dict):
        members = [*value, *value.values()]
    for member in members:
        _refuse_odd(member, text)


def _place_of(value: str, text: str) -> str:
    """Return the line of a text with control characters, and the hint on its escapes."""
    for number, line in enumerate(text.splitlines(), start=1):
        for string in _BASIC_STRING.findall(line):
            if _decoded(string) == value:
                hint = _ESCAPED if "\\" in string else ""
                return f" (at line {number}){hint}"
    return ""
