"""Comparison of the results in two files or folders, as a result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.ground.errors import ArgumentError, one_line, value_text
from grosmc_mj.ground.wording import counted, unit_after
from grosmc_mj.output.page.reading import Document, read_results
from grosmc_mj.output.results.result import KEPT, NOT_KEPT, Answer, ReportTable, Result, result
from grosmc_mj.output.results.tables import numbers, phrases, table, words
from grosmc_mj.studies.campaign.manifest import leaves
from grosmc_mj.studies.comparison.campaigns import (
    KIND,
    campaign_changes,
    campaign_folders,
    campaign_rows,
    is_one_family,
)
from grosmc_mj.studies.comparison.changes import Change, Effect, changes, one_sided_change

# Fields of a document that say what it was made from.
_SOURCES = {"git_revision", "machine", "seed", "versions", "configuration"}
# Options of a campaign stand in its copy of the case file, too.
_IN_FILE = "configuration.file.run."
_UNJUDGED = (
    "cannot be judged: single runs with another random seed do not show the scatter. Compare "
    "campaigns of both, or runs with one seed."
)


class _Side(NamedTuple):
    """Documents of one side.

    Attributes:
        path: The side: a file or a folder.
        documents: Its documents, the newest last.
    """

    path: Path
    documents: Sequence[Document]

    def sources(self, several: Set[str]) -> dict[tuple[str, str], Any]:
        """Return what the documents were made from, by origin and key.

        Args:
            several: Kinds of which there are several: their origin has the name of the file, too.
        """
        sources: dict[tuple[str, str], Any] = {}
        for document in self.documents:
            origin = document.kind
            if document.kind in several:
                origin = f"{document.kind} of {self._name(document.path)}"
            for key, value in leaves(document.content.model_dump(include=_SOURCES)):
                if value is not None:
                    sources[origin, key] = value
        return sources

    def _name(self, file: Path) -> str:
        """Return the name of a file within the side."""
        if file == self.path:
            return file.name
        return file.relative_to(self.path).as_posix()


class ResultComparison(NamedTuple):
    """Changes between the results in two files or folders.

    Attributes:
        old: Path of the old results.
        new: Path of the new results.
        changes: Changes, the worst first.
        compared: Number of values that both have.
        sources: A line for each difference of what they were made from.
        notices: A line for each file that could not be read.
    """

    old: Path
    new: Path
    changes: list[Change]
    compared: int
    sources: list[str]
    notices: list[str]

    @property
    def counts(self) -> Counter[Effect]:
        """Number of changes of each effect."""
        return Counter(change.effect for change in self.changes)

    @property
    def worse(self) -> list[Change]:
        """Changes for the worse beyond noise."""
        return [change for change in self.changes if change.effect is Effect.WORSE]


def compare(old: Path, new: Path) -> ResultComparison:
    """Compare the results in two files or folders.

    Args:
        old: A document, a campaign's folder, or a folder with any of these.
        new: Another one.

    Raises:
        ArgumentError: If a path does not exist, or the two have nothing in common.
    """
    before = read_results([old])
    after = read_results([new])
    listed, compared = changes(before.documents, after.documents)

    of_campaigns, compared_in_campaigns = _changes_of_campaigns(old, new)
    listed += of_campaigns
    compared += compared_in_campaigns

    if compared == 0:
        for side in (before, after):
            if side.notices and not side.documents:
                raise ArgumentError(f"no results: {side.notices[0]}")
        line = (
            f"{old} and {new} have no results in common: name two files or folders with "
            "results of the same command, target and laws"
        )
        if is_one_family(old, new):
            line += (
                "; one campaign of both laws compares them (--laws lqr grosmc): its answer has "
                "lines 'same plants'"
            )
        raise ArgumentError(line)
    return ResultComparison(
        old=old,
        new=new,
        changes=sorted(listed, key=lambda change: change.order),
        compared=compared,
        sources=_source_differences(_Side(old, before.documents), _Side(new, after.documents)),
        notices=[*before.notices, *after.notices],
    )


def _changes_of_campaigns(old: Path, new: Path) -> tuple[list[Change], int]:
    """Return the changes between the campaigns of two folders, and the number of compared values.

    Campaigns of two systems are not the same one under another name.
    """
    old_folders = campaign_folders(old)
    new_folders = campaign_folders(new)
    listed: list[Change] = []
    compared = 0
    pairs: dict[str, str] = {}
    for old_key, new_key in _pairs(old_folders.keys(), new_folders.keys()).items():
        before = campaign_rows(old_folders[old_key])
        after = campaign_rows(new_folders[new_key])
        if before.system != after.system:
            continue
        pairs[old_key] = new_key
        changed, values = campaign_changes(before, after)
        listed += changed
        compared += values

    gone = old_folders.keys() - pairs.keys()
    added = new_folders.keys() - set(pairs.values())
    listed += [one_sided_change(KIND, key, "there", gone=True) for key in gone]
    listed += [one_sided_change(KIND, key, "there", gone=False) for key in added]
    return listed, compared


def _pairs(old: Set[str], new: Set[str]) -> dict[str, str]:
    """Return which campaign is compared with which: those of one name, and the only other two."""
    pairs = {key: key for key in old & new}
    only_old = list(old - new)
    only_new = list(new - old)
    if len(only_old) == len(only_new) == 1:
        pairs[only_old[0]] = only_new[0]
    return pairs


def _source_differences(old: _Side, new: _Side) -> list[str]:
    """Write a line for each difference of revision, versions, machine, seed and configuration."""
    kinds = Counter(document.kind for document in old.documents)
    kinds |= Counter(document.kind for document in new.documents)
    several = {kind for kind, count in kinds.items() if count > 1}
    before = old.sources(several)
    after = new.sources(several)
    shared = {origin for origin, _ in before} & {origin for origin, _ in after}

    changed = {
        (origin, key): (before.get((origin, key)), after.get((origin, key)))
        for origin, key in before | after
        if origin in shared and before.get((origin, key)) != after.get((origin, key))
    }
    # Several results may have one difference, such as the machine: it is written once.
    lines: dict[str, None] = {}
    for (origin, key), values in changed.items():
        if changed.get((origin, _shorter(key))) == values:
            continue
        of_one = key.startswith("configuration") or (key == "seed" and origin not in kinds)
        name = f"{origin}: {key}" if of_one else key
        lines[one_line(f"{name}: {_source(values[0])} -> {_source(values[1])}")] = None
    return list(lines)


def _shorter(key: str) -> str:
    """Return the other key under which a campaign's manifest has a number, if it has it twice."""
    if key.startswith(_IN_FILE):
        return f"configuration.{key.removeprefix(_IN_FILE)}"
    return key.removeprefix("configuration.") if key.startswith("configuration.") else ""


def _source(value: Any) -> str:
    return value_text("nothing" if value is None else value, str)


def comparison_result(comparison: ResultComparison) -> Result:
    """Return the comparison as a result."""
    sides = _sides(comparison.old, comparison.new)
    columns = [*words("change"), *phrases("of"), *numbers(*sides), *words("unit")]
    rows = [
        (
            change.effect.value,
            change.name,
            _value(change.before),
            _value(change.after),
            unit_after(change.unit).lstrip(),
        )
        for change in comparison.changes
        if change.effect not in (Effect.NOISE, Effect.UNJUDGED)
    ]
    return result(
        "diff",
        None,
        answers=[_answer(comparison)],
        sheets=[ReportTable(table=table("What changed", columns, rows), brief=True)],
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


def _sides(old: Path, new: Path) -> tuple[str, str]:
    """Return the names of both sides: of their files or folders, or their paths if these agree."""
    if old.name and new.name and old.name != new.name:
        return old.name, new.name
    return str(old), str(new)


def _answer(comparison: ResultComparison) -> Answer:
    """Return the answer: how much got worse, and the number of other changes."""
    counts = comparison.counts
    worse = counts[Effect.WORSE]

    subject = str(worse) if worse else "Nothing"
    sentence = f"{subject} got worse beyond noise, of {comparison.compared} compared"
    other_effects = [effect for effect in Effect if effect is not Effect.WORSE and counts[effect]]
    if other_effects:
        other_changes = [f"{counts[effect]} {effect.value}" for effect in other_effects]
        sentence += f"; {', '.join(other_changes)}"

    unjudged = counts[Effect.UNJUDGED]
    return Answer(
        question=f"What changed from {comparison.old} to {comparison.new}",
        verdict=NOT_KEPT if worse else KEPT,
        words=sentence,
        more=f"{counted(unjudged, 'difference')} {_UNJUDGED}" if unjudged else "",
    )


def _value(value: float | str | None) -> str:
    if value is None:
        return "none"
    if isinstance(value, str):
        return value
    return f"{value:.6g}"
