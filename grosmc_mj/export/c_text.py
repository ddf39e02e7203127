"""Text of C: numbers, comments and lines, and the removal of lines that nothing needs."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

WIDTH = 100
INDENT = "    "
_WORD = re.compile(r"\w+")
# A function that is called.
_CALLED = re.compile(r"\b(\w+)\(")


def suffix_of(real: str) -> str:
    """Return the suffix of numbers and of library functions for ``double`` or ``float``."""
    return "f" if real == "float" else ""


def literal(value: float, real: str) -> str:
    """Return a float as a number of type ``real`` in C, which reads it back to the bit."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value)) + suffix_of(real)


def wrapped(text: str, indent: int, further: int = 8) -> list[str]:
    """Return a long line as several.

    Args:
        text: The line.
        indent: Spaces before the first line.
        further: Further spaces before the other lines.
    """
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + further),
        break_long_words=False,
        break_on_hyphens=False,
    )


def comment(text: str, indent: int = 0) -> str:
    """Return a text as a comment; empty for an empty text."""
    words = " ".join(text.split()).replace("``", "").replace("*/", "* /").replace("/*", "/ *")
    return "\n".join(wrapped(f"/* {words} */", indent, 3)) if words else ""


def mentions(text: str, name: str) -> bool:
    """Whether a text of C has a name in it."""
    return re.search(rf"\b{re.escape(name)}\b", text) is not None


def calls(text: str, name: str) -> bool:
    """Whether a text of C calls a function."""
    return re.search(rf"\b{re.escape(name)}\(", text) is not None


@dataclass(frozen=True)
class Line:
    """A line of a C function.

    Attributes:
        depth: Depth of its block.
        text: The line.
        defines: Name of the variable that it gives a value, if it does nothing else.
        effect: The part of it that is needed even if nothing reads the variable.
    """

    depth: int
    text: str
    defines: str = ""
    effect: str = ""

    def written(self) -> list[str]:
        """Return it with its indentation, in several lines if it is long."""
        return wrapped(self.text, len(INDENT) * (self.depth + 1))


def without_unused(lines: Sequence[Line]) -> list[Line]:
    """Return the lines without variables that nothing reads.

    A function that is specialised for its arguments may leave an argument unused; compilers warn
    of what was computed for it.
    """
    kept = list(lines)
    while True:
        unused = {line.defines for line in kept} - {""}
        for line in kept:
            unused -= set(_WORD.findall(line.text)) - {line.defines}
        if not unused:
            return kept

        needed: list[Line] = []
        for line in kept:
            if line.defines not in unused:
                needed.append(line)
            elif line.effect:
                needed.append(Line(line.depth, line.effect))
        kept = needed


def without_hidden_functions(lines: Sequence[Line]) -> list[Line]:
    """Return the lines with other names for variables that would hide a function they call."""
    text = "\n".join(line.text for line in lines)
    renamed = list(lines)
    called = set(_CALLED.findall(text))
    for name in {line.defines for line in lines} & called:
        variable = re.compile(rf"\b{name}\b(?!\()")
        renamed = [replace(line, text=variable.sub(f"{name}_v", line.text)) for line in renamed]
    return renamed
