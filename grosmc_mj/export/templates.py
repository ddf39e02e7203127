"""Text of C from the templates of this package."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from grosmc_mj.export.c_text import calls, comment, mentions, wrapped
from grosmc_mj.ground.wording import titled
from grosmc_mj.theory.plants import Signal


def rendered(template: str, **values: Any) -> str:
    """Return the text of a template.

    Args:
        template: Name of its file.
        values: What its expressions name.
    """
    return _environment().get_template(template).render(**values)


# Jinja compiles a template for each environment: of an export that took a third of the time.
@cache
def _environment() -> jinja2.Environment:
    """The templates, with the filters and tests that they use."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).with_name("templates")),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(comment=comment, listed=listed, wrapped=wrapped)
    environment.tests.update(calling=calls, mentioning=mentions)
    return environment


def listed(signals: Sequence[Signal], array: str) -> str:
    """Return names and units of the entries of an array."""
    places = [
        titled(f"{array}[{i}] {signal.name}", signal.unit) for i, signal in enumerate(signals)
    ]
    return ", ".join(places)
