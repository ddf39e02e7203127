"""LaTeX formulas as one line of text, for the terminal and the page."""

from __future__ import annotations

import re

# A group in braces, with at most one further level of braces in it.
_GROUP = r"\{((?:[^{}]|\{[^{}]*\})*)\}"
_FRACTION = re.compile(r"\\t?frac\s*(?:" + _GROUP + r"|(\d))\s*(?:" + _GROUP + r"|(\w))")
_FUNCTION = re.compile(r"\\(cos|sin|tan|max|min)(?![a-z])")
_SIGN = re.compile(r"\\(neq|approx|le|ge|Rightarrow|sum|int|rho|theta)(?![a-z])")


def in_text(formula: str) -> str:
    r"""Write a formula such as ``\tfrac12 \dot q^2`` as ``1/2 q̇^2``."""
    # Imported here because it loads slowly and few commands write formulas.
    from pylatexenc.latex2text import LatexNodes2Text

    # pylatexenc has neither fractions in a line nor spaces around functions and signs.
    latex = _FRACTION.sub(_fraction, formula)
    latex = _FUNCTION.sub(r" \1 ", latex)
    latex = re.sub(r"\\ne(?![a-z])", r"\\neq", latex)
    latex = _SIGN.sub(r"\\\1{} ", latex)
    text = LatexNodes2Text(math_mode="text").latex_to_text(latex)

    # No space before a closing bracket, after an opening one, before an index or an exponent.
    text = " ".join(text.split())
    text = re.sub(r"\s+([,.)\]])", r"\1", text)
    return re.sub(r"([(\[])\s+|\s+(?=[_^])", r"\1", text)


def _fraction(match: re.Match[str]) -> str:
    """Write a fraction in a line."""
    numerator = match[1] or match[2]
    denominator = match[3] or match[4]
    return f"{_bracketed(numerator)}/{_bracketed(denominator)} "


def _bracketed(part: str) -> str:
    """Put part of a fraction in brackets unless it is a single symbol or function."""
    if re.fullmatch(r"\\?\w+(?:_(?:\w|\\text\{\w+\}))?(?:\([^()]*\))?", part):
        return part
    return f"({part})"
