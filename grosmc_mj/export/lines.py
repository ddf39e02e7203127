"""Lines of a C function, and the removal of those that nothing needs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from grosmc_mj.export.c_text import INDENT, wrapped

_WORD = re.compile(r"\w+")
# A function that is called.
_CALLED = re.compile(r"\b(\w+)\(")


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
