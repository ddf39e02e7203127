"""The work of one part, wherever it is done: it needs the specification and the folder."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.family.specification import Specification
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.campaign.runs.manifest import (
    differences,
    manifest_of,
    outdated,
    read_manifest,
    refuse_other_code,
)
from grosmc_mj.campaign.runs.part import Counts, counts_of, part_table
from grosmc_mj.campaign.runs.screened import screened_all
from grosmc_mj.campaign.runs.screening import UNSCREENED, Screening
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.file.reading import read_text, resolved_text
from grosmc_mj.experiments.file.user_code import named_in

# What this process has imported of the users' own Python for campaigns: of each module, which.
_imported: dict[str, tuple[str, str]] = {}


@dataclass(frozen=True)
class ShardReport:
    """What is told of a part; its rows are in the folder.

    Attributes:
        index: Number of the part.
        first: First run.
        runs: Number of plants.
        counts: By controller: runs, and those that keep each requirement.
        seconds: Wall time.
        process: Who did it.
    """

    index: int
    first: int
    runs: int
    counts: Counts
    seconds: float
    process: int


def shards_of(
    campaign: Campaign, folder: Folder, threads: int, screening: Screening = UNSCREENED
) -> partial[ShardReport]:
    """The work of each part of a campaign that was begun in a folder, by its number.

    Args:
        campaign: The campaign.
        folder: Where it was begun.
        threads: Of each worker; 0 for all cores.
        screening: How far equations may judge its runs.
    """
    bound_to = read_manifest(folder.path)["hash"]
    path = str(folder.path.resolve())
    return partial(
        run_shard,
        path,
        campaign.specification,
        bound_to,
        threads=threads,
        screening=screening,
    )


def run_shard(
    folder: str,
    specification: Specification,
    bound_to: str,
    index: int,
    threads: int = 0,
    screening: Screening = UNSCREENED,
) -> ShardReport:
    """Run a part and write it.

    Args:
        folder: Of the campaign, under the same path for all that work at it.
        specification: What the campaign was begun with: nothing is built from what the folder says.
        bound_to: Hash of its manifest, which the folder's must have.
        index: Number of the part.
        threads: 0 for all cores.
        screening: How far equations may judge its runs.

    Raises:
        GrosmcError: If the folder is not that of the campaign, or cannot be written.
    """
    began = time.perf_counter()
    campaign = open_campaign(folder, specification, bound_to)
    ids = specification.ids(index)
    found = screened_all(campaign, screening, campaign.laws, campaign.values(ids), threads, ids)
    table = part_table(campaign, bound_to, index, found)
    Folder(Path(folder)).write(index, table)
    seconds = time.perf_counter() - began
    counts = counts_of(campaign, table)
    return ShardReport(index, ids.start, len(ids), counts, seconds, os.getpid())


def open_campaign(folder: str, specification: Specification, bound_to: str) -> Campaign:
    """The campaign of a specification, designed once in a process, to add parts to its folder.

    Raises:
        GrosmcError: If the folder is of another one, or it would not be computed here as it was
            there.
    """
    # A worker may outlive a folder and meet another campaign under its name.
    if read_manifest(Path(folder))["hash"] != bound_to:
        raise ArgumentError(f"{folder} has another campaign than the one that was begun in it")
    return _opened(folder, specification, bound_to)


@lru_cache(maxsize=4)
def _opened(folder: str, specification: Specification, _bound_to: str) -> Campaign:
    """The campaign of a specification, if it is that of a folder whose manifest has this hash."""
    campaign, others = _built(Path(folder), read_manifest(Path(folder)), specification)
    if others:
        raise ArgumentError(f"{folder} was begun with other versions: {'; '.join(others)}")
    return campaign


def read_campaign(folder: Path, case_file: Path | None = None) -> tuple[Campaign, list[str]]:
    """The campaign that a folder describes, to read what it has.

    The folder is data: no Python is imported but what lies beside the case file that the user
    names, and that only if it is what the folder has recorded.

    Args:
        folder: Of the campaign.
        case_file: Where its case file is now, with what it names.

    Returns:
        The campaign, and what to know of one of other versions, a line each.

    Raises:
        GrosmcError: If there is none, or its configuration cannot be had here.
    """
    manifest = read_manifest(folder)
    specification = Specification.of_document(manifest["question"])
    if case_file is not None:
        if specification.text not in (resolved_text(case_file), read_text(case_file)):
            raise ArgumentError(
                f"{case_file} is not the case file of {folder}: its text is another"
            )
        specification = replace(specification, folder=str(case_file.parent.resolve()))
    elif named := named_in(specification.file):
        raise ArgumentError(
            f"{folder}: its case file names Python, {', '.join(named)}, and a folder's is not "
            "imported: give a case file of your own with the same text, beside which that lies, "
            "by --case-file"
        )
    campaign, others = _built(folder, manifest, specification)
    return campaign, [f"{line}: bits may differ" for line in others]


def _built(
    folder: Path, manifest: Mapping[str, Any], specification: Specification
) -> tuple[Campaign, list[str]]:
    """The campaign of a specification, if it is the manifest's, and what has other versions now."""
    refuse_other_code(folder, manifest, specification)
    _forget_others(manifest["sources"], specification.folder)
    campaign = Campaign.of(specification)
    now = manifest_of(campaign)
    if changed := differences(manifest, now):
        raise ArgumentError(f"{folder} was begun with something else: {'; '.join(changed)}")
    return campaign, outdated(manifest, now)


def _forget_others(sources: Mapping[str, str], folder: str) -> None:
    """Have modules imported anew that a worker has kept from another campaign of its life."""
    for file, content in sources.items():
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        if _imported.setdefault(name, (folder, content)) != (folder, content):
            sys.modules.pop(name, None)
            _imported[name] = folder, content
