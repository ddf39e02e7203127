"""Pages that are kept in Markdown, and what is generated within them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from grosmc_mj.errors import SetupError


def replace_marked(page: Path, name: str, make: Callable[[], str]) -> None:
    """Put a text between the two marks of a name in a page that people write.

    Args:
        page: The page.
        name: Of the text; ``<!-- name -->`` and ``<!-- /name -->`` stay where they are.
        make: Makes the text, once the marks are found.

    Raises:
        SetupError: If the page or a mark is missing.
    """
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    text = page.read_text(encoding="utf-8") if page.is_file() else ""
    before, begun, rest = text.partition(begin)
    _, ended, after = rest.partition(end)
    if not (begun and ended):
        raise SetupError(f"{page} has no {begin} ... {end}")
    page.write_text(f"{before}{begin}\n{make()}\n{end}{after}", encoding="utf-8")
