"""Tables within the pages of the documentation, written anew.

``python -m grosmc_mj.cli.pages NAME PAGE.md FILE.json ...`` is what ``make results``, ``rivals``,
``tolerance`` and ``ladder`` run.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.chapter.validation import results_markdown
from grosmc_mj.ground.errors import GrosmcError, SetupError
from grosmc_mj.output.results.markdown import replace_marked
from grosmc_mj.studies.ladder.pages import failures_text, few_failures_text, ladders_text
from grosmc_mj.studies.rivals import SYSTEMS, rivals, rivals_table
from grosmc_mj.studies.tolerance.answer import tolerances_text


def _results(documents: Sequence[Any]) -> str:
    """Return the tables of one document of validate."""
    return results_markdown(*documents)


def _rivals(_: Sequence[Any]) -> str:
    """Run the rivals on all their systems, and return the table."""
    return rivals_table(row for system in SYSTEMS for row in rivals(system))


# Functions that make the text between the marks of a name from documents.
TEXTS: Mapping[str, Callable[[Sequence[Any]], str]] = {
    "results": _results,
    "rivals": _rivals,
    "tolerances": tolerances_text,
    "ladders": ladders_text,
    "failures": failures_text,
    "few failures": few_failures_text,
}


def write_text(name: str, page: Path, *files: Path) -> None:
    """Put a text between the marks of its name.

    Args:
        name: A key of ``TEXTS``.
        page: Page with the marks.
        files: Documents that the text is made from.

    Raises:
        SetupError: If a file or a mark is missing.
    """
    for path in files:
        if not path.is_file():
            raise SetupError(f"{path} is missing: run make validate in the checkout first")

    documents = [json.loads(path.read_text(encoding="utf-8")) for path in files]
    replace_marked(page, name, lambda: TEXTS[name](documents))


if __name__ == "__main__":
    try:
        write_text(sys.argv[1], *map(Path, sys.argv[2:]))
    except (GrosmcError, OSError, ValueError, LookupError, TypeError) as error:
        sys.exit(f"NAME PAGE.md FILE.json ...: {error}")
