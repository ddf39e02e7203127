"""What two sets of results were made from, where that differs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from grosmc_mj.comparison.changes import Conditions
from grosmc_mj.errors import shown
from grosmc_mj.report.page.documents import StoredProvenance
from grosmc_mj.report.page.reading import Document
from grosmc_mj.versions import DECISIVE


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
        before, after = (next(d for d in side if d.kind == kind) for side in (old, new))
        mine, theirs = (dict(_flat(_told(each.provenance))) for each in (before, after))
        for key in [*mine, *(key for key in theirs if key not in mine)]:
            if mine.get(key) != theirs.get(key):
                where = f"{kind}: " if key.startswith("configuration") else ""
                values = f"{_said(mine.get(key))} -> {_said(theirs.get(key))}"
                lines[f"{where}{key}: {values}"] = None
    return list(lines)


def _told(of: StoredProvenance) -> dict[str, Any]:
    return {
        "revision": of.git_revision,
        "machine": of.machine,
        "seed": of.seed,
        "versions": of.versions,
        "configuration": of.configuration,
    }


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Each number and word with where it stands."""
    if isinstance(value, Mapping):
        for key, each in value.items():
            yield from _flat(each, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from _flat(each, f"{name}[{index}]")
    else:
        yield name, value


def _said(value: Any) -> str:
    return "nothing" if value is None else shown(value, str)
