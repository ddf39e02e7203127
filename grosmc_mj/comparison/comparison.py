"""The comparison of two places with results, as a result of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.comparison.campaigns import (
    campaign_changes,
    campaign_folders,
    campaign_rows,
    gone_or_new,
)
from grosmc_mj.comparison.changes import Change, Effect, changes
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.page.reading import Document, read_results
from grosmc_mj.results.result import KEPT, NOT_KEPT, Answer, Sheet, result
from grosmc_mj.results.tables import numbers, phrases, table, words
from grosmc_mj.sweep.store import flat

_SOURCES = {"git_revision", "machine", "seed", "versions", "configuration"}


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
    listed, compared = changes(before.documents, after.documents)
    there, now = campaign_folders(old), campaign_folders(new)
    for key in there.keys() & now.keys():
        more, tests = campaign_changes(campaign_rows(there[key]), campaign_rows(now[key]))
        listed += more
        compared += tests
    listed += [gone_or_new(key, gone=key in there) for key in there.keys() ^ now.keys()]
    notices = [*before.notices, *after.notices]
    if not compared:
        unread = [
            side.notices[0] for side in (before, after) if not side.documents and side.notices
        ]
        raise ArgumentError(
            f"no results: {unread[0]}"
            if unread
            else f"{old} and {new} have no results in common: name two files or folders with "
            "results of the same command and target"
        )
    listed.sort(key=lambda change: change.order)
    sources = _source_differences(before.documents, after.documents)
    return ResultComparison(old, new, listed, compared, sources, notices)


def _source_differences(old: Sequence[Document], new: Sequence[Document]) -> list[str]:
    """A line for each difference of revision, versions, machine, seed and configuration."""
    before, after = _sources(old), _sources(new)
    lines = [
        f"{name}: " + " -> ".join(shown(side.get(key, "nothing"), str) for side in (before, after))
        for key in dict.fromkeys([*before, *after])
        if key[0] in {kind for kind, _ in before} & {kind for kind, _ in after}
        and before.get(key) != after.get(key)
        for name in [": ".join(key) if key[1].startswith("configuration") else key[1]]
    ]
    return list(dict.fromkeys(lines))


def _sources(documents: Sequence[Document]) -> dict[tuple[str, str], Any]:
    """By kind of result and key, of the oldest document of each kind."""
    return {
        (document.kind, key): value
        for document in reversed(documents)
        for key, value in flat(document.content.model_dump(include=_SOURCES))
        if value is not None
    }


def comparison_document(comparison: ResultComparison) -> dict[str, Any]:
    """The content of diff.json."""
    counts, worse = comparison.counts, comparison.worse
    rows = [
        (change.effect.value, change.name, _value(change.before), _value(change.after), change.unit)
        for change in comparison.changes
        if change.effect not in (Effect.NOISE, Effect.UNJUDGED)
    ]
    columns = [*words("change"), *phrases("of"), *numbers("before", "after"), *words("unit")]
    verdict = f"{len(worse)} got worse beyond noise" if worse else "Nothing got worse beyond noise"
    others = ", ".join(
        f"{counts[effect]} {effect.value}"
        for effect in Effect
        if effect is not Effect.WORSE and counts[effect]
    )
    unjudged = (
        f"{counts[Effect.UNJUDGED]} differences cannot be judged: they are of single runs with "
        "another random seed, which do not show the scatter. Compare campaigns of both, or runs "
        "with one seed."
    )
    answer = Answer(
        question=f"What changed from {comparison.old} to {comparison.new}",
        verdict=NOT_KEPT if worse else KEPT,
        words=f"{verdict}, of {comparison.compared} compared" + (others and f"; {others}"),
        more=unjudged if counts[Effect.UNJUDGED] else "",
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
        changes=[
            {**change._asdict(), "effect": change.effect.value} for change in comparison.changes
        ],
        sources=comparison.sources,
        notices=comparison.notices,
    )


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    return value if isinstance(value, str) else f"{value:.6g}"
