"""A whole campaign in one call: run what is missing, and say what the runs say."""

from __future__ import annotations

from pathlib import Path

from grosmc_mj.campaign.family.campaign import Campaign
from grosmc_mj.campaign.findings.findings import Findings, findings
from grosmc_mj.campaign.runs.folder import Folder
from grosmc_mj.campaign.runs.running import run_missing
from grosmc_mj.executors import make_executor


def run_campaign(
    campaign: Campaign, folder: str | Path, *, resume: bool = False, confidence: float = 0.95
) -> Findings:
    """Run a campaign in this process, on all cores.

    Args:
        campaign: What is run.
        folder: Where it is kept, as ``grosmc-mj campaign`` keeps it.
        resume: Whether to go on with what is in the folder.
        confidence: Of the intervals.

    Raises:
        ArgumentError: If the folder has another campaign, or this one and ``resume`` is not wanted.
        SetupError: If it cannot be written.
    """
    kept = Folder(Path(folder))
    with kept.held():
        kept.begin(campaign, resume=resume)
        executor = make_executor("batch")
        run_missing(campaign, kept, executor, lambda line: None, lambda runs, rates: None)
    return findings(campaign, kept, confidence)
