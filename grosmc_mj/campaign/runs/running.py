"""Running what is missing of a campaign, wherever its executor does it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.runs.folder import Folder, add
from grosmc_mj.campaign.runs.part import EVERYTHING
from grosmc_mj.campaign.runs.screening import UNSCREENED, screening_of
from grosmc_mj.campaign.runs.work import ShardReport, shards_of
from grosmc_mj.executors import Executor, Notice

# Number of runs done and, by law, the share of these that keeps everything so far.
Advance = Callable[[int, dict[str, float]], object]


def missing(campaign: Campaign, folder: Folder) -> list[int]:
    """Numbers of the parts that are not there."""
    return [index for index in range(campaign.specification.shards) if not folder.done(index)]


def run_missing(
    campaign: Campaign, folder: Folder, executor: Executor, notice: Notice, advance: Advance
) -> int:
    """Run the parts that are missing.

    Args:
        campaign: The campaign.
        folder: Where it is kept, begun.
        executor: What runs them.
        notice: Told of workers that died, and why nothing is screened.
        advance: Told after each part.

    Returns:
        How often a part had to be run again.

    Raises:
        GrosmcError: If a part cannot be run; those that were finished stay.
    """
    parts = missing(campaign, folder)
    screening = screening_of(campaign) if parts else UNSCREENED
    if screening.why_not:
        notice(f"No run is screened by equations: {screening.why_not}.")
    work = shards_of(campaign, folder, executor.threads_per_worker, screening)
    total: dict[str, dict[str, int]] = {}
    again = 0
    with closing(executor.run(work, parts, notice)) as done:
        for finished in done:
            report: ShardReport = finished.report
            again += finished.attempts - 1
            add(total, report.counts)
            rates = {law: each[EVERYTHING] / each["runs"] for law, each in total.items()}
            advance(report.runs * len(campaign.laws), rates)
    return again
