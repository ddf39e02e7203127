"""Words around numbers: nouns of a count, units of a value."""

from __future__ import annotations

# Units of a pure number, which nobody writes.
_PURE = frozenset({"", "1"})


def plural(count: int, one: str, many: str = "") -> str:
    """Return the form of a noun or verb that belongs to a count.

    Args:
        count: The count.
        one: Form for exactly one: ``run``, or the verb ``keeps``.
        many: Form for all other counts; left out for a noun that takes an s.
    """
    if count == 1:
        return one
    return many or f"{one}s"


def counted(count: int, one: str, many: str = "") -> str:
    """Return a count with its noun: ``1 run``, ``0 runs``; see ``plural``."""
    return f"{count} {plural(count, one, many)}"


def counted_of(part: int, whole: int, one: str, singular: str = "", several: str = "") -> str:
    """Return a part of a count with its noun, and the verb that agrees: ``1 of 2 laws keeps``.

    Args:
        part: The part.
        whole: The count.
        one: The noun for exactly one.
        singular: The verb for one, and for a part of one; empty for none.
        several: The verb for several, and for none of several.
    """
    words = f"{part} of {counted(whole, one)}"
    if not singular:
        return words
    verb = singular if whole == 1 else plural(part, singular, several)
    return f"{words} {verb}"


def spelled(name: str) -> str:
    """Return a key of a file or the name of a requirement in words: ``final error below``."""
    return name.replace("_", " ")


def unit_after(unit: str) -> str:
    """Return what follows a written number: a blank and the unit, or nothing of a pure number."""
    return "" if unit in _PURE else f" {unit}"


def titled(quantity: str, unit: str) -> str:
    """Return the title of an axis or a column: ``angle [rad]``, or ``share`` of a pure number."""
    return quantity if unit in _PURE else f"{quantity} [{unit}]"


def quantity_and_unit(title: str) -> tuple[str, str]:
    """Return the two parts of a title that ``titled`` made; the unit is empty of a pure number."""
    quantity, bracket, unit = title.rpartition(" [")
    if not bracket:
        return title, ""
    return quantity, unit.removesuffix("]")
