"""What is generated within a page that people write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from grosmc_mj.errors import SetupError


def replace_marked(page: Path, begin: str, end: str, make: Callable[[], str]) -> None:
    """Put a text between two marks of a page, which stay where they are.

    Args:
        page: The page.
        begin: The mark before the text.
        end: The mark after it.
        make: Makes the text, once the marks are found.

    Raises:
        SetupError: If the page or a mark is missing.
    """
    text = page.read_text(encoding="utf-8") if page.is_file() else ""
    before, begun, rest = text.partition(begin)
    _, ended, after = rest.partition(end)
    if not (begun and ended):
        raise SetupError(f"{page} has no {begin} ... {end}")
    page.write_text(f"{before}{begin}\n{make()}\n{end}{after}", encoding="utf-8")
