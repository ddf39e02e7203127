"""The work of one part, wherever it is done: all it needs is the campaign's folder."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from grosmc_mj.campaign.campaign import Campaign
from grosmc_mj.campaign.folder import Counts, Folder, counts_of
from grosmc_mj.campaign.manifest import differences, manifest_of, outdated, read_manifest
from grosmc_mj.campaign.question import Question
from grosmc_mj.campaign.shard import evaluate_all
from grosmc_mj.errors import ArgumentError


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


def run_shard(folder: str, index: int, threads: int = 0) -> ShardReport:
    """Run a part and write it.

    Args:
        folder: Of the campaign, under the same path for all that work at it.
        index: Number of the part.
        threads: 0 for all cores.

    Raises:
        GrosmcError: If the folder is not that of a campaign, or cannot be written.
    """
    began, kept = time.perf_counter(), Folder(Path(folder))
    campaign = open_campaign(folder)
    ids = campaign.question.ids(index)
    values = campaign.values(ids)
    found = evaluate_all(campaign, campaign.laws, values, threads)
    kept.write(index, ids, campaign, found)
    seconds = time.perf_counter() - began
    return ShardReport(index, ids.start, len(ids), counts_of(found), seconds, os.getpid())


def open_campaign(folder: str) -> Campaign:
    """The campaign of a folder, designed once in a process, to add parts to it.

    Raises:
        GrosmcError: If there is none, or it would not be computed here as it was there.
    """
    campaign, others = read_campaign(folder)
    if others:
        raise ArgumentError(f"{folder} was begun with other versions: {'; '.join(others)}")
    return campaign


def read_campaign(folder: str) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign of a folder, and the packages that have other versions now, a line each.

    Raises:
        GrosmcError: If there is none, or its configuration cannot be had here.
    """
    # A worker may outlive a folder and meet another campaign under its name.
    return _opened(folder, read_manifest(Path(folder))["hash"])


@lru_cache(maxsize=4)
def _opened(folder: str, _hash: str) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign of a folder whose manifest has this hash."""
    manifest = read_manifest(Path(folder))
    campaign = Campaign.of(Question.of_document(manifest["question"]))
    now = manifest_of(campaign)
    if changed := differences(manifest, now):
        raise ArgumentError(f"{folder} was begun with something else: {'; '.join(changed)}")
    return campaign, tuple(outdated(manifest, now))
