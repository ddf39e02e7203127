"""The comparison of two places with results, as a result of its own and as JUnit XML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

from grosmc_mj.comparison.campaigns import (
    campaign_changes,
    campaign_folders,
    campaign_rows,
    gone_or_new,
)
from grosmc_mj.comparison.changes import Change, Effect, changes
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.files import written_aside
from grosmc_mj.page.reading import Document, read_results
from grosmc_mj.results.result import KEPT, NOT_KEPT, Answer, Sheet, result
from grosmc_mj.results.tables import names, numbers, table, text, words
from grosmc_mj.sweep.store import flat

_SOURCES = {"git_revision", "machine", "seed", "versions", "configuration"}
# Effects of what may be chance.
_NO_CHANGE = (Effect.NOISE, Effect.UNJUDGED)


class ResultComparison(NamedTuple):
    """What changed between two places with results.

    Attributes:
        old: The first place.
        new: The second.
        changes: What is not as it was, the worst first.
        compared: How many numbers, words and tests both have.
        sources: What they were made from, where that differs.
        notices: What could not be read.
    """

    old: Path
    new: Path
    changes: list[Change]
    compared: int
    sources: list[str]
    notices: list[str]

    @property
    def counts(self) -> Counter[Effect]:
        """How many changes are of which effect."""
        return Counter(change.effect for change in self.changes)

    @property
    def worse(self) -> list[Change]:
        """Values that are worse beyond noise, or gone."""
        return [change for change in self.changes if change.effect is Effect.WORSE]


def compare(old: Path, new: Path) -> ResultComparison:
    """Compare the results in two files or folders.

    Args:
        old: A document, a campaign's folder, or a folder with any of these.
        new: Another one.

    Raises:
        ArgumentError: If one is not there, or they have nothing in common.
    """
    before, after = read_results([old]), read_results([new])
    found, compared = changes(before.documents, after.documents)
    folders = [
        {str(folder.relative_to(place)): folder for folder in campaign_folders(place)}
        for place in (old, new)
    ]
    for key in folders[0].keys() & folders[1].keys():
        more, tests = campaign_changes(*(campaign_rows(side[key]) for side in folders))
        found += more
        compared += tests
    for key in sorted(folders[0].keys() ^ folders[1].keys()):
        found.append(gone_or_new(key, gone=key in folders[0]))
    if not compared:
        for place, side in ((old, before), (new, after)):
            if not side.documents and side.notices:
                raise ArgumentError(f"no results in {place}: {side.notices[0]}")
        raise ArgumentError(
            f"{old} and {new} have no results in common: name two files or folders with results "
            "of the same command and target"
        )
    found.sort(key=lambda each: list(Effect).index(each.effect))
    notices = [*before.notices, *after.notices]
    sources = source_differences(before.documents, after.documents)
    return ResultComparison(old, new, found, compared, sources, notices)


def source_differences(old: Sequence[Document], new: Sequence[Document]) -> list[str]:
    """A line for each thing in revision, versions, machine, seed and configuration that differs."""
    lines: dict[str, None] = {}
    for kind in sorted({each.kind for each in old} & {each.kind for each in new}):
        before, after = (
            dict(flat(next(d for d in side if d.kind == kind).content.model_dump(include=_SOURCES)))
            for side in (old, new)
        )
        for key in dict.fromkeys([*before, *after]):
            if before.get(key) != after.get(key):
                where = f"{kind}: " if key.startswith("configuration") else ""
                values = " -> ".join(
                    "nothing" if side.get(key) is None else shown(side[key], str)
                    for side in (before, after)
                )
                lines[f"{where}{key}: {values}"] = None
    return list(lines)


def comparison_document(comparison: ResultComparison) -> dict[str, Any]:
    """The content of diff.json."""
    worse = comparison.worse
    rows = [
        (each.name, each.effect.value, _value(each.before), _value(each.after), each.unit)
        for each in comparison.changes
        if each.effect not in _NO_CHANGE
    ]
    columns = [*text("of"), *words("change"), *numbers("before", "after"), *names("unit")]
    answer = Answer(
        question=f"What changed from {comparison.old} to {comparison.new}",
        verdict=NOT_KEPT if worse else KEPT,
        words=f"{len(worse)} of {comparison.compared} compared got worse beyond noise",
        more=worse[0].name if worse else "",
    )
    return result(
        "diff",
        None,
        answers=[answer],
        sheets=[Sheet(table=table("What changed", columns, rows))],
        old=str(comparison.old),
        new=str(comparison.new),
        compared=comparison.compared,
        counts={effect.value: comparison.counts[effect] for effect in Effect},
        changes=[{**each._asdict(), "effect": each.effect.value} for each in comparison.changes],
        sources=comparison.sources,
        notices=comparison.notices,
    )


def write_junit(path: Path, comparison: ResultComparison) -> None:
    """Write a test case for each change, failed where it got worse, and one for what repeats.

    Raises:
        SetupError: If it cannot be written.
    """
    counts = {"tests": len(comparison.changes) + 1, "failures": len(comparison.worse), "errors": 0}
    suite = ElementTree.Element(
        "testsuite", {"name": "grosmc-mj diff"} | {name: str(n) for name, n in counts.items()}
    )
    repeats = f"{comparison.compared} values are in both"
    ElementTree.SubElement(suite, "testcase", classname="diff", name=repeats)
    for change in comparison.changes:
        case = ElementTree.SubElement(
            suite, "testcase", classname=f"diff.{change.kind}", name=_printable(change.name)
        )
        if change.effect is Effect.WORSE:
            note = f" ({change.note})" if change.note else ""
            values = f"{_value(change.before)} -> {_value(change.after)} {change.unit}".rstrip()
            ElementTree.SubElement(case, "failure", message=_printable(values + note))
    with written_aside(path) as aside:
        ElementTree.ElementTree(suite).write(aside, encoding="utf-8", xml_declaration=True)


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else f"{value:.6g}"


def _printable(text: str) -> str:
    """Without the characters that XML has no room for."""
    return "".join(letter for letter in text if letter.isprintable())
