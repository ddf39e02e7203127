"""Generated texts in Markdown pages that people write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.files import write_whole


def replace_marked(page: Path, name: str, make: Callable[[], str]) -> None:
    """Replace the text between the marks ``<!-- name -->`` and ``<!-- /name -->`` of a page.

    Args:
        page: Path of the page.
        name: Name of the text; its marks stay where they are.
        make: Function that returns the text; called once the marks are found.

    Raises:
        SetupError: If the page or a mark is missing.
    """
    begin = f"<!-- {name} -->"
    end = f"<!-- /{name} -->"
    text = page.read_text(encoding="utf-8") if page.is_file() else ""

    before, begin_found, remainder = text.partition(begin)
    _, end_found, after = remainder.partition(end)
    if not (begin_found and end_found):
        raise SetupError(f"{page} has no {begin} ... {end}")

    write_whole(page, f"{before}{begin}\n{make()}\n{end}{after}")
