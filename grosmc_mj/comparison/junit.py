"""A comparison as JUnit XML, which continuous integration shows."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from grosmc_mj.comparison.changes import Change, Effect
from grosmc_mj.comparison.comparison import ResultComparison
from grosmc_mj.files import written_aside


def write_junit(path: Path, comparison: ResultComparison) -> None:
    """Write a test case for each change, failed where it got worse, and one for what repeats.

    Raises:
        SetupError: If it cannot be written.
    """
    failed = [each for each in comparison.changes if each.effect is Effect.WORSE]
    suite = ElementTree.Element(
        "testsuite",
        name="grosmc-mj diff",
        tests=str(len(comparison.changes) + 1),
        failures=str(len(failed)),
        errors="0",
    )
    ElementTree.SubElement(
        suite, "testcase", classname="diff", name=f"{comparison.compared} figures are in both"
    )
    for change in comparison.changes:
        case = ElementTree.SubElement(
            suite, "testcase", classname=f"diff.{change.kind}", name=_plain(change.name)
        )
        if change.effect is Effect.WORSE:
            ElementTree.SubElement(case, "failure", message=_plain(words(change)))
    with written_aside(path) as aside:
        ElementTree.ElementTree(suite).write(aside, encoding="utf-8", xml_declaration=True)


def words(change: Change) -> str:
    """A change in words."""
    values = " -> ".join(_value(each) for each in (change.before, change.after))
    note = f" ({change.note})" if change.note else ""
    return f"{values} {change.unit}".rstrip() + note


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else f"{value:.6g}"


def _plain(text: str) -> str:
    """Without the characters that XML has no room for."""
    return "".join(letter for letter in text if letter.isprintable())
