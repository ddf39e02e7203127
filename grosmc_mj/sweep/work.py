"""Running a campaign: the work of one part, wherever it is done, and what is missing of a whole."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors import Executor, Notice
from grosmc_mj.experiments.file.reading import read_text, resolved_text
from grosmc_mj.experiments.file.user_code import named_in
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.folder import EVERYTHING, Counts, Folder, add, counts_of, part_table
from grosmc_mj.sweep.manifest import (
    differences,
    manifest_of,
    outdated,
    read_manifest,
    refuse_other_code,
)
from grosmc_mj.sweep.screening import UNSCREENED, Screening, screened_all, screening_of
from grosmc_mj.sweep.specification import Specification

# Number of runs done and, by law, the share of these that keeps everything so far.
Advance = Callable[[int, dict[str, float]], object]
# What this process has imported of the users' own Python for campaigns: of each module, which.
_imported: dict[str, tuple[str, str]] = {}


def run_missing(
    campaign: Campaign, folder: Folder, executor: Executor, notice: Notice, advance: Advance
) -> int:
    """Run the parts that are missing.

    Args:
        campaign: The campaign.
        folder: Where it is kept, begun.
        executor: What runs them.
        notice: Called with a line about each worker that died, and why nothing is screened.
        advance: Called after each part.

    Returns:
        How often a part had to be run again.

    Raises:
        GrosmcError: If a part cannot be run; those that were finished stay.
    """
    parts, total, again = folder.missing(campaign), dict[str, dict[str, int]](), 0
    screening = screening_of(campaign) if parts else UNSCREENED
    if screening.why_not:
        notice(f"No run is screened by equations: {screening.why_not}.")
    work = shards_of(campaign, folder, executor.threads_per_worker, screening)
    with closing(executor.run(work, parts, notice)) as done:
        for finished in done:
            again += finished.attempts - 1
            add(total, finished.report)
            rates = {law: counts[EVERYTHING] / counts["runs"] for law, counts in total.items()}
            runs = len(campaign.specification.ids(finished.index))
            advance(runs * len(campaign.laws), rates)
    return again


def shards_of(
    campaign: Campaign, folder: Folder, threads: int, screening: Screening = UNSCREENED
) -> partial[Counts]:
    """The work of each part of a campaign that was begun in a folder, by its number.

    Args:
        campaign: The campaign.
        folder: Where it was begun.
        threads: Of each worker; 0 for all cores.
        screening: How far equations may judge its runs.
    """
    bound_to, path = read_manifest(folder.path)["hash"], str(folder.path.resolve())
    shard = partial(run_shard, path, campaign.specification, bound_to)
    return partial(shard, threads=threads, screening=screening)


def run_shard(
    folder: str,
    specification: Specification,
    bound_to: str,
    index: int,
    threads: int = 0,
    screening: Screening = UNSCREENED,
) -> Counts:
    """Run a part and write it.

    Args:
        folder: Of the campaign, under the same path for all that work at it.
        specification: What the campaign was begun with: nothing is built from what the folder says.
        bound_to: Hash of its manifest, which the folder's must have.
        index: Number of the part.
        threads: 0 for all cores.
        screening: How far equations may judge its runs.

    Returns:
        By controller: runs, and those that keep each requirement.

    Raises:
        GrosmcError: If the folder is not that of the campaign, or cannot be written.
    """
    campaign = open_campaign(folder, specification, bound_to)
    runs = screened_all(campaign, screening, campaign.laws, specification.ids(index), threads)
    table = part_table(campaign, bound_to, index, runs)
    Folder(Path(folder)).write(index, table)
    return counts_of(campaign, table)


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
    campaign, others = _built(Path(folder), read_manifest(Path(folder)), specification)
    if others:
        raise ArgumentError(f"{folder} was begun with other versions: {'; '.join(others)}")
    return campaign


def read_campaign(folder: Path, case_file: Path | None = None) -> tuple[Campaign, list[str]]:
    """The campaign that a folder describes, to read its runs.

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
    # A worker may have kept modules of these names from another campaign of its life.
    for file, content in manifest["sources"].items():
        name = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        source = (specification.folder, content)
        if _imported.setdefault(name, source) != source:
            sys.modules.pop(name, None)
            _imported[name] = source
    campaign = Campaign.of(specification)
    now = manifest_of(campaign)
    if changed := differences(manifest, now):
        raise ArgumentError(f"{folder} was begun with something else: {'; '.join(changed)}")
    return campaign, outdated(manifest, now)
