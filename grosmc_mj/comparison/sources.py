"""What two sets of results were made from, where that differs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from grosmc_mj.campaign.manifest import flat
from grosmc_mj.comparison.changes import Conditions
from grosmc_mj.errors import shown
from grosmc_mj.page.documents import StoredProvenance
from grosmc_mj.page.reading import Document
from grosmc_mj.versions import DECISIVE

# Documents and campaigns that can be compared.
_TOLD = {"git_revision", "machine", "seed", "versions", "configuration"}


def conditions(old: Sequence[Document], new: Sequence[Document]) -> Mapping[str, Conditions]:
    """How far results of each kind can be expected to repeat."""
    kinds = {each.kind for each in (*old, *new)}
    found = {}
    for kind in kinds:
        before, after = ([d.provenance for d in side if d.kind == kind] for side in (old, new))
        same = len({_machine(each) for each in (*before, *after)}) == 1
        known = all(each.machine for each in (*before, *after))
        seeds = [{each.seed for each in side} for side in (before, after)]
        chance = kind != "validation" and kind != "claims" and seeds[0] != seeds[1]
        found[kind] = Conditions(same and known, chance and bool(before) and bool(after))
    return found


def _machine(of: StoredProvenance) -> tuple[Any, ...]:
    return (of.machine, *(of.versions.get(name) for name in DECISIVE))


def source_differences(old: Sequence[Document], new: Sequence[Document]) -> list[str]:
    """A line for each thing in revision, versions, machine, seed and configuration that differs."""
    lines: dict[str, None] = {}
    for kind in sorted({each.kind for each in old} & {each.kind for each in new}):
        before, after = (
            dict(flat(next(d for d in side if d.kind == kind).provenance.model_dump(include=_TOLD)))
            for side in (old, new)
        )
        for key in dict.fromkeys([*before, *after]):
            if before.get(key) != after.get(key):
                where = f"{kind}: " if key.startswith("configuration") else ""
                values = " -> ".join(_words(side.get(key)) for side in (before, after))
                lines[f"{where}{key}: {values}"] = None
    return list(lines)


def _words(value: Any) -> str:
    return "nothing" if value is None else shown(value, str)
