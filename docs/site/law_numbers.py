"""The table of the laws' numbers in the guide, as the classes of the laws declare them.

``python docs/site/law_numbers.py`` writes it anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from grosmc_mj.output.results import tables
from grosmc_mj.output.results.markdown import replace_marked
from grosmc_mj.theory.control.kinds import KINDS
from grosmc_mj.theory.control.kinds.kind import LawKind
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.switching import SWITCHINGS, SwitchingNumbers

PAGE = Path(__file__).resolve().parents[1] / "guide.md"


def table() -> str:
    """Return the table of all numbers of laws and of switching laws in Markdown."""
    rows = [*_numbers_of_laws(), *_numbers_of_switching_laws()]
    titles = ("key", "of", "meaning", "unit", "without it", "must be", "a search takes")
    return "\n".join(tables.table("", tables.words(*titles), rows).markdown())


def _numbers_of_laws() -> Iterable[list[str]]:
    """Yield a row for each number, with all laws that declare it alike."""
    owners: dict[tuple[str, LawNumber, str], list[str]] = {}
    for kind in KINDS:
        for key, number in kind.numbers().items():
            owners.setdefault((key, number, _without(kind, key)), []).append(kind.key)
    for (key, number, without), laws_of_number in owners.items():
        yield _row(key, list(dict.fromkeys(laws_of_number)), number, without)


def _numbers_of_switching_laws() -> Iterable[list[str]]:
    """Yield a row for each number of switching laws."""
    default = SwitchingNumbers()
    for key in vars(default):
        readers = [name for name, law in SWITCHINGS.items() if key in law.numbers]
        if len(readers) == len(SWITCHINGS):
            readers = ["every `switching`"]
        number = next(law.numbers[key] for law in SWITCHINGS.values() if key in law.numbers)
        yield _row(key, readers, number, f"{getattr(default, key):g}")


def _row(key: str, laws_of_number: list[str], number: LawNumber, without: str) -> list[str]:
    """Return the row of a number."""
    search = ""
    if number.search is not None:
        low, high = number.search
        search = f"{low:g} to {high:g}, {'log' if number.log else 'linear'}"
    bounds = number.wanted
    if number.each:
        bounds = f"{bounds}, or one for each {number.each}"
    names = ", ".join(name if "`" in name else f"`{name}`" for name in laws_of_number)
    return [f"`{key}`", names, number.meaning, str(number.unit), without, bounds, search]


def _without(kind: type[LawKind], key: str) -> str:
    """Return the value of a number that a file does not give, in words."""
    if key in kind.required():
        return "must be given"
    default = kind.defaults().get(key)
    if default is None:
        others = [f"`{way[0]}`" for way in kind.ways if way[0] != key]
        is_way = len(others) < len(kind.ways)
        return " or ".join(others) if is_way else "by the machine"
    return "none" if math.isinf(default) else f"{default:g}"


def main() -> None:
    """Write the table."""
    replace_marked(PAGE, "law numbers", table)


if __name__ == "__main__":
    main()
