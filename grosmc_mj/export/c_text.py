"""Words of C: names, numbers, comments and functions."""

from __future__ import annotations

import math
import re
import textwrap
from typing import Any

import numpy as np

from grosmc_mj.export.reserved import is_function, is_taken

WIDTH = 100
INDENT = "    "
# Pointer to what the law remembers.
MEMORY = "memory"

# Names in C of functions of math, numpy and Python; those with an underscore at their end are in
# ``templates/helpers.c``.
_SAME_NAME = re.findall(
    r"\w+",
    "sqrt sin cos tan asin acos atan atan2 sinh cosh tanh asinh acosh atanh exp expm1 log log1p "
    "log10 log2 fmod copysign fabs isfinite isnan isinf",
)
_OTHER_NAME = {
    "pow": "pow_",
    "arcsin": "asin",
    "arccos": "acos",
    "arctan": "atan",
    "arctan2": "atan2",
    "absolute": "fabs",
    "sign": "sign_",
}
LIBRARY: dict[Any, str] = {abs: "fabs"}
for _module in (math, np):
    for _name, _in_c in {**{name: name for name in _SAME_NAME}, **_OTHER_NAME}.items():
        if hasattr(_module, _name):
            LIBRARY[getattr(_module, _name)] = _in_c

# A variable would hide a function that is called.
_CALLED = {*LIBRARY.values(), "floor", "ceil"}
_CALLED |= {f"{name}f" for name in _CALLED}


def c_name(name: str) -> str:
    """Return a name of Python's as a name of C's; different ones stay different.

    A name that C or this package takes gets ``_v`` at its end, and one that ends so another one.
    """
    letters = [letter if letter.isascii() else f"u{ord(letter):x}" for letter in name]
    ascii_name = "".join(letters)
    taken = is_taken(ascii_name) or ascii_name in _CALLED
    return f"{ascii_name}_v" if taken or ascii_name != name else ascii_name


def c_function_name(name: str) -> str:
    """Return the name of a function of Python's as the name of one in C."""
    stripped = name.strip("_") if name != "<lambda>" else "value"
    if not stripped or stripped[0].isdigit():
        stripped = f"function_{stripped}".strip("_")
    return f"{stripped}_v" if is_function(stripped) else c_name(stripped)


def c_prefix(text: str) -> str:
    """Return a text as the begin of names in C, and of files."""
    letters = [letter if letter.isascii() and letter.isalnum() else "_" for letter in text]
    prefix = "".join(letters)
    return prefix if prefix[:1].isalpha() else f"law_{prefix.lstrip('_')}"


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
