"""Keys that case files of former versions had, with what is written in their place today."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_OWN_MODEL = "describe it in an MJCF of your own, [plant] model = ..."
# By table and key; a key at the top of a file has no table. {value} stands for the value.
_TODAY: Mapping[tuple[str, str], str] = {
    ("", "swinging_load"): f"[[swinging_load]] is no part any more: {_OWN_MODEL}",
    ("", "sliding_load"): f"[[sliding_load]] is no part any more: {_OWN_MODEL}",
    ("edit", "tilt"): f"tilt of a joint is no edit any more: {_OWN_MODEL}",
    ("requirement", "cart_travel_below"): (
        'cart_travel_below is now written state = "cart position", stays_within = "{value}"'
    ),
}


def written_today(table: str, key: str, value: Any) -> str | None:
    """Return the line that tells what replaces a key of a former version.

    Args:
        table: Name of the table; empty at the top of a file.
        key: The key.
        value: Its value.

    Returns:
        The line; None for any other key.
    """
    line = _TODAY.get((table, key))
    return None if line is None else line.format(value=value)
