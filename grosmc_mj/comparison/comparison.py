"""The comparison of two places with results."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.comparison.campaigns import (
    campaign_changes,
    campaign_folders,
    campaign_rows,
    gone_or_new,
)
from grosmc_mj.comparison.changes import Change, Effect, changes
from grosmc_mj.comparison.figures import figures_of
from grosmc_mj.comparison.sources import conditions, source_differences
from grosmc_mj.errors import ArgumentError
from grosmc_mj.page.reading import read_results
from grosmc_mj.results.document import origin


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
        """Figures that are worse beyond noise, or gone."""
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
    found, compared = changes(
        (figure for each in before.documents for figure in figures_of(each)),
        (figure for each in after.documents for figure in figures_of(each)),
        conditions(before.documents, after.documents),
    )
    notices = [*before.notices, *after.notices]
    mine, theirs = ({_key(each, place): each for each in campaign_folders(place)}
                    for place in (old, new))  # fmt: skip
    for key in mine.keys() & theirs.keys():
        more, tests = campaign_changes(campaign_rows(mine[key]), campaign_rows(theirs[key]))
        found += more
        compared += tests
    for key in sorted(mine.keys() ^ theirs.keys()):
        found.append(gone_or_new(key, gone=key in mine))
    if not compared:
        for place, found_there in ((old, before), (new, after)):
            if not found_there.documents and found_there.notices:
                raise ArgumentError(f"no results in {place}: {found_there.notices[0]}")
        raise ArgumentError(
            f"{old} and {new} have no results in common: name two files or folders with results "
            "of the same command and target"
        )
    order = list(Effect)
    found.sort(key=lambda each: order.index(each.effect))
    sources = source_differences(before.documents, after.documents)
    return ResultComparison(old, new, found, compared, sources, notices)


def _key(folder: Path, place: Path) -> str:
    """Where a campaign lies in its place; one that is the place itself is compared with any."""
    return str(folder.relative_to(place))


def comparison_document(comparison: ResultComparison) -> dict[str, Any]:
    """The content of diff.json."""
    return {
        **origin(None),
        "old": str(comparison.old),
        "new": str(comparison.new),
        "compared": comparison.compared,
        "counts": {effect.value: comparison.counts[effect] for effect in Effect},
        "changes": [{**each._asdict(), "effect": each.effect.value} for each in comparison.changes],
        "sources": comparison.sources,
        "notices": comparison.notices,
    }
