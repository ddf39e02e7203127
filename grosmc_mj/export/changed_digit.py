"""An exported law with one number changed, of which a proof must notice one."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from grosmc_mj.export.compiler import CompiledLaw, compile_law, write_law
from grosmc_mj.export.law import LawInC

# Relative change of the number: its seventh digit.
_CHANGE = 1e-6
_DECIMAL = r"(?<![\w.])\d+\.\d+(?:e[+-]?\d+)?"
# Numbers that are changed, one after the other, until a change is noticed: the first ones of a
# robot are indices and axes, some of which no input depends on.
_MOST = 40


def changed_sources(law: LawInC) -> Iterator[str]:
    """Yield the text of NAME.c with one number changed, which is not zero: the next one each time.

    They are the numbers of the law or, of a law without numbers, of its code.
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
            yield source[: begin + match.start()] + changed + source[begin + match.end() :]


def compile_changed(law: LawInC, folder: Path, compiler: str) -> Iterator[CompiledLaw]:
    """Yield the law compiled with one number changed, the next one each time.

    Args:
        law: The law.
        folder: An empty folder for its files.
        compiler: Path of the compiler.

    Raises:
        SetupError: If it does not compile.
    """
    for number, source in enumerate(islice(changed_sources(law), _MOST)):
        own = folder / str(number)
        own.mkdir()
        _, path = write_law(law, own)
        path.write_text(source, encoding="utf-8")
        yield compile_law(law, own, compiler)
