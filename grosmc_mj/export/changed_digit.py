"""An exported law with one number changed, which a proof must notice."""

from __future__ import annotations

import re
from pathlib import Path

from grosmc_mj.export.compiler import CompiledLaw, compile_law, write_law
from grosmc_mj.export.law import LawInC

# Relative change of the number: its seventh digit.
_CHANGE = 1e-6
_DECIMAL = r"(?<![\w.])\d+\.\d+(?:e[+-]?\d+)?"


def changed_source(law: LawInC) -> str | None:
    """Return the text of NAME.c with one number changed; None if it has no number to change.

    It is the first number of the law that is not zero or, of a law without numbers, of its code.
    """
    source = law.source
    if law.numbers.members:
        begin = source.index(f"{law.numbers.name} = {{")
    else:
        begin = source.index(law.written.functions)
    for match in re.finditer(_DECIMAL, source[begin:]):
        number = float(match[0])
        if number != 0.0:
            changed = repr(number * (1.0 + _CHANGE))
            return source[: begin + match.start()] + changed + source[begin + match.end() :]
    return None


def compile_changed(law: LawInC, folder: Path, compiler: str) -> CompiledLaw | None:
    """Compile the law with one number changed; None if it has no number to change.

    Args:
        law: The law.
        folder: An empty folder for its files.
        compiler: Path of the compiler.

    Raises:
        SetupError: If it does not compile.
    """
    source = changed_source(law)
    if source is None:
        return None
    _, path = write_law(law, folder)
    path.write_text(source, encoding="utf-8")
    return compile_law(law, folder, compiler)
