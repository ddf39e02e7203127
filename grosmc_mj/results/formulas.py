"""Formulas in LaTeX as a line of text, for the terminal and the page."""

from __future__ import annotations

import re

# What stands in a fraction: without brackets, or with one level of them.
_GROUP = r"\{((?:[^{}]|\{[^{}]*\})*)\}"
_FRACTION = re.compile(r"\\t?frac\s*(?:" + _GROUP + r"|(\d))\s*(?:" + _GROUP + r"|(\w))")
_FUNCTION = re.compile(r"\\(cos|sin|tan|max|min)(?![a-z])")


def in_text(formula: str) -> str:
    r"""A formula such as ``\tfrac12 \dot q^2`` as ``1/2 q̇^2``."""
    from pylatexenc.latex2text import LatexNodes2Text

    plain = _FUNCTION.sub(r" \1 ", _FRACTION.sub(_fraction, formula))
    plain = re.sub(r"\\ne(?![a-z])", r"\\neq", plain)
    plain = re.sub(r"\\(neq|approx|le|ge|Rightarrow|sum|int|rho|theta)(?![a-z])", r"\\\1{} ", plain)
    text = LatexNodes2Text(math_mode="text").latex_to_text(plain)
    text = re.sub(r"\s+([,.)\]])", r"\1", " ".join(text.split()))
    return re.sub(r"([(\[])\s+|\s+(?=[_^])", r"\1", text)


def _fraction(match: re.Match[str]) -> str:
    """A fraction in a line, its parts in brackets if they are more than one sign."""
    above, below = match[1] or match[2], match[3] or match[4]
    return f"{_bracketed(above)}/{_bracketed(below)} "


def _bracketed(part: str) -> str:
    single = re.fullmatch(r"\\?\w+(?:_(?:\w|\\text\{\w+\}))?(?:\([^()]*\))?", part)
    return part if single else f"({part})"
