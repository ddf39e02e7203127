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


# Quantities of an [[uncertain]] by the owner that it named; those of parts have their own names.
_UNCERTAIN: Mapping[str, str | None] = {
    "body": "edit",
    "joint": "edit",
    "parameter": "edit",
    "disturbance": "disturbance",
    "start": "run.start",
    "computing": "computing",
    **dict.fromkeys(
        (
            "sensor",
            "estimator",
            "actuator",
            "transmission",
            "lugre",
            "drive_friction",
            "stop",
            "motor",
            "wall",
        )
    ),
}
_KEPT = ("at", "name", "nominal")


def uncertain_number_today(table: Any) -> tuple[str, str] | None:
    """Return the path of an ``[[uncertain]]`` of a former version, and the key of its values.

    Args:
        table: The table; None is returned for one of today.
    """
    if not isinstance(table, Mapping) or "number" in table:
        return None
    owners = [key for key in table if key in _UNCERTAIN]
    keys = [key for key in table if key not in (*owners, *_KEPT)]
    if len(owners) != 1 or len(keys) != 1:
        return None

    (owner,) = owners
    (key,) = keys
    start = _UNCERTAIN[owner] or owner
    if owner == "computing":
        return f"{start}.{key}", key
    if owner == "start":
        return f"{start}.{table[owner]}", key
    field = "scale" if (owner, key) == ("disturbance", "amplitude") else key
    return f"{start}.{table[owner]}.{field}", key


def uncertain_today(table: Any) -> str | None:
    """Return the line that tells how an ``[[uncertain]]`` of a former version is written."""
    today = uncertain_number_today(table)
    if today is None:
        return None
    path, key = today
    line = f'write number = "{path}", and values in the place of {key}'
    if key == "amplitude" and "nominal" not in table:
        # Without the table there was no disturbance; today there is the file's.
        line += ", with nominal = 0 for no disturbance without it"
    return line
