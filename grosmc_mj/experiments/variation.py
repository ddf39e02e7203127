"""Values that a user has varied, after a change of the file that they came from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, is_dataclass, replace
from typing import Any, cast

from grosmc_mj.ground.errors import ArgumentError


def different(before: Any, after: Any, names: Iterable[str]) -> dict[str, Any]:
    """Return the attributes of these names that have changed, by name."""
    values = {name: getattr(after, name) for name in names}
    return {name: value for name, value in values.items() if value != getattr(before, name)}


def joined(name: str, before: Any, after: Any, varied: Any) -> Any:
    """Return an attribute after a change of the file, and after what was varied.

    Of tuples, each entry counts for itself; of a loop each of its parts.

    Args:
        name: Name of the attribute.
        before: Owner of the file's value before the change.
        after: Owner of the one after it.
        varied: Owner of the one that was varied.

    Raises:
        ArgumentError: If what was changed is no longer there.
    """
    old = getattr(before, name)
    new = getattr(after, name)
    own = getattr(varied, name)
    if new == old:
        return own
    if own == old:
        return new
    if is_dataclass(own) and type(old) is type(new) is type(own):
        parts = {item.name: joined(item.name, old, new, own) for item in fields(own)}
        return replace(cast(Any, own), **parts)
    if isinstance(own, tuple) and isinstance(old, tuple) and isinstance(new, tuple):
        entries = list(own)
        for entry, instead in zip(old, new, strict=False):
            if entry == instead:
                continue
            if entry not in entries:
                _refuse_lost(name)
            entries[entries.index(entry)] = instead
        return (*entries, *new[len(old) :])
    if own is None or old is None or new is None:
        _refuse_lost(name)
    return new


def _refuse_lost(name: str) -> None:
    """Refuse a change of what was replaced before.

    Raises:
        ArgumentError: Always.
    """
    raise ArgumentError(
        f"{name} was replaced by varied(...), so that a change in the file has no place: change it "
        "first, and vary it then"
    )
