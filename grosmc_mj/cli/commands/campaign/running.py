"""Missing runs of a campaign and its searches, with progress bars."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

from grosmc_mj.cli import screen
from grosmc_mj.ground.executors import Executor
from grosmc_mj.studies.campaign import work
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.campaign.findings import Findings
from grosmc_mj.studies.campaign.folder import Folder
from grosmc_mj.studies.campaign.radius import Radius, radius
from grosmc_mj.studies.campaign.worst import WorstPlant, worst


def notices(campaign: Campaign) -> list[str]:
    """Return the notes on a campaign, and a line on another integrator."""
    lines: list[str] = []
    if campaign.plant.restepped:
        lines.append(
            f"Steps by {campaign.experiment.settings.integrator} instead of the model's own "
            "integrator, which may judge some plants otherwise."
        )
    lines.extend(campaign.notes)
    return lines


def run_parts(campaign: Campaign, folder: Folder, executor: Executor) -> list[str]:
    """Run the missing parts with a progress bar.

    Args:
        campaign: The campaign.
        folder: Its folder, held.
        executor: Executor of the parts.

    Returns:
        Lines on the parts that were there already and on the speed of the others.

    Raises:
        KeyboardInterrupt: If it is interrupted, with the number of parts that are done.
    """
    specification = campaign.specification
    parts = folder.missing(campaign)
    lines: list[str] = []
    present = specification.shards - len(parts)
    if present > 0:
        lines.append(f"{present} of {specification.shards} parts are there already.")
    if not parts:
        return lines

    plants = sum(len(specification.ids(index)) for index in parts)
    runs = plants * len(campaign.laws)
    start = time.perf_counter()
    try:
        with screen.progress(runs, "runs") as advance:
            advance("designed; the first part takes a while", 0)
            finished = _FinishedRuns(advance, start)
            repeated = work.run_missing(campaign, folder, executor, screen.notice, finished)
    except KeyboardInterrupt:
        done = specification.shards - len(folder.missing(campaign))
        raise KeyboardInterrupt(
            f"interrupted: {done} of {specification.shards} parts are done; the same command with "
            "--resume runs the others"
        ) from None

    seconds = time.perf_counter() - start
    lines.append(_speed_line(campaign, runs, seconds, repeated))
    return lines


class _FinishedRuns:
    """Progress of runs: how fast they are, and what share of them keeps everything."""

    def __init__(self, advance: Callable[[str, int], object], start: float) -> None:
        self._advance = advance
        self._start = start
        self._runs = 0

    def __call__(self, runs: int, rates: Mapping[str, float]) -> None:
        """Count runs of a part that is finished.

        Args:
            runs: Number of them.
            rates: Share of all finished runs that keeps everything, by law.
        """
        self._runs += runs
        speed = self._runs / (time.perf_counter() - self._start)
        shares = ", ".join(f"{law} {100 * rate:.1f} %" for law, rate in rates.items())
        self._advance(f"{speed:.3g} runs/s; kept so far: {shares}", runs)


def _speed_line(
    campaign: Campaign,
    runs: int,
    seconds: float,
    repeated: int,
) -> str:
    """Return a line on how many runs and timesteps a second were made."""
    steps = runs * campaign.duration / campaign.experiment.settings.timestep
    line = (
        f"{runs} runs of {campaign.duration:g} s in {seconds:.1f} s: {runs / seconds:.3g} runs and "
        f"{steps / seconds:.3g} timesteps a second"
    )
    if repeated:
        line += f"; {repeated} parts were run again"
    return f"{line}."


def search_worst(campaign: Campaign, result: Findings, evaluations: int) -> list[WorstPlant]:
    """Search for the worst plant under each law.

    Args:
        campaign: The campaign.
        result: Findings of its runs, of which the worst ones begin the search.
        evaluations: Runs that the search may take for a law; as many random plants are tried.
    """
    plants = []
    with screen.progress(2 * evaluations * len(campaign.judged), "runs") as advance:
        for law in campaign.judged:
            advance_law = partial(advance, f"worst under {law}")
            plants.append(worst(campaign, law, result.worst[law], evaluations, advance_law))
    return plants


def search_radii(campaign: Campaign) -> list[Radius]:
    """Search how far the uncertainty may grow under each law."""
    radii = []
    with screen.progress(len(campaign.judged), "controllers") as advance:
        for law in campaign.judged:
            words = f"radius under {law}"
            advance(words, 0)
            # The search says how many plants it has tried; the bar counts laws.
            radii.append(radius(campaign, law, lambda _, words=words: advance(words, 0)))
            advance(words)
    return radii
