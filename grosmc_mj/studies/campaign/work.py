"""Work of a campaign: the parts that are missing, run by an executor."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

from grosmc_mj.ground.executors import Executor, Notice
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.manifest import read_manifest
from grosmc_mj.studies.campaign.opening import open_campaign
from grosmc_mj.studies.campaign.parts import part_rows
from grosmc_mj.studies.campaign.screening import UNSCREENED, Screening, screened_all, screening_of
from grosmc_mj.studies.campaign.specification import Specification

# Number of runs done and, by law, the share of these that keeps everything so far.
Advance = Callable[[int, dict[str, float]], object]


def run_missing(
    campaign: Campaign, folder: Folder, executor: Executor, notice: Notice, advance: Advance
) -> int:
    """Run the parts that are missing.

    Args:
        campaign: The campaign.
        folder: Where it is kept, begun.
        executor: Runs the parts.
        notice: Called with a line about each worker that died, and why nothing is screened.
        advance: Called after each part.

    Returns:
        How often a part was run again.

    Raises:
        GrosmcError: If a part cannot be run; those that were finished stay.
    """
    parts = folder.missing(campaign)
    screening = UNSCREENED
    if parts:
        screening = screening_of(campaign)
    if screening.why_not:
        notice(f"No run is screened by equations: {screening.why_not}.")

    passed = Counter[str]()
    finished_plants = 0
    repeated = 0
    work = part_runner(campaign, folder, executor.threads_per_worker, screening)
    with contextlib.closing(executor.run(work, parts, notice)) as finished_parts:
        for part in finished_parts:
            plants = len(campaign.specification.ids(part.index))
            passed.update(part.report)
            finished_plants += plants
            repeated += part.attempts - 1

            shares = {law: passed[law] / finished_plants for law in campaign.laws}
            advance(plants * len(campaign.laws), shares)
    return repeated


def part_runner(
    campaign: Campaign, folder: Folder, threads: int, screening: Screening = UNSCREENED
) -> partial[dict[str, int]]:
    """Return the function that runs a part of a campaign, by its number.

    Args:
        campaign: The campaign.
        folder: Where it was begun.
        threads: Threads of each worker; 0 for all cores.
        screening: Screening of its runs by the equations.
    """
    bound_to = read_manifest(folder.path)["hash"]
    path = str(folder.path.resolve())
    return partial(
        run_part, path, campaign.specification, bound_to, threads=threads, screening=screening
    )


def run_part(
    folder: str,
    specification: Specification,
    bound_to: str,
    index: int,
    threads: int = 0,
    screening: Screening = UNSCREENED,
) -> dict[str, int]:
    """Run a part and write it.

    Args:
        folder: Folder of the campaign, under the same path for all workers.
        specification: Its specification: nothing is built from the folder's content.
        bound_to: Hash of its manifest, which the folder's must have.
        index: Number of the part.
        threads: Number of threads; 0 for all cores.
        screening: Screening of its runs by the equations.

    Returns:
        Number of runs that keep everything, by controller.

    Raises:
        GrosmcError: If the folder is not that of the campaign, or cannot be written.
    """
    campaign = open_campaign(folder, specification, bound_to)
    runs = screened_all(campaign, screening, campaign.laws, specification.ids(index), threads)
    rows = part_rows(campaign, index, runs)
    Folder(Path(folder)).write(campaign, bound_to, index, rows)

    passed: dict[str, int] = {}
    for law, outcomes in zip(campaign.laws, runs, strict=True):
        passed[law] = int((outcomes["relative"] >= 0).sum())
    return passed
