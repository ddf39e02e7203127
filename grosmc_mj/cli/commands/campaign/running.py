"""Missing runs of a campaign and its searches, with progress bars."""

from __future__ import annotations

import time
from functools import partial

from grosmc_mj.cli import screen
from grosmc_mj.executors import Executor
from grosmc_mj.sweep import store
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.findings import Findings
from grosmc_mj.sweep.radius import Radius, radius
from grosmc_mj.sweep.store import Folder
from grosmc_mj.sweep.worst import Worst, worst


def notices(campaign: Campaign) -> list[str]:
    """Lines on requirements that are not judged, loads that do not act, and another integrator."""
    lines: list[str] = []
    if campaign.plant.restepped:
        lines.append(
            f"Steps by {campaign.experiment.settings.integrator} instead of the model's own "
            "integrator, which may judge some plants otherwise."
        )
    lines += campaign.not_judged
    late = f"never acts: runs end at {campaign.duration:g} s, before it begins."
    lines += [f"{name} {late}" for name in campaign.idle]
    return lines


def run_parts(campaign: Campaign, folder: Folder, executor: Executor) -> list[str]:
    """Run the missing parts, with a progress bar; returns a line each about them.

    Raises:
        KeyboardInterrupt: If it is interrupted, with the number of parts that are done.
    """
    specification, parts = campaign.specification, folder.missing(campaign)
    shards, lines = specification.shards, []
    left = sum(len(specification.ids(index)) for index in parts) * len(campaign.laws)
    if len(parts) < shards:
        lines.append(f"{shards - len(parts)} of {shards} parts are there already.")
    if not parts:
        return lines
    began, done = time.perf_counter(), 0
    try:
        with screen.progress(left, "runs") as advance:

            def finished(runs: int, rates: dict[str, float]) -> None:
                nonlocal done
                done += runs
                speed = done / (time.perf_counter() - began)
                shares = ", ".join(f"{law} {100 * rate:.1f} %" for law, rate in rates.items())
                advance(f"{speed:.3g} runs/s; kept so far: {shares}", runs)

            advance("designed; the first part takes a while", 0)
            again = store.run_missing(campaign, folder, executor, screen.notice, finished)
    except KeyboardInterrupt:
        there = shards - len(folder.missing(campaign))
        raise KeyboardInterrupt(
            f"interrupted: {there} of {shards} parts are done; the same command with --resume "
            "runs the others"
        ) from None
    seconds = time.perf_counter() - began
    steps = left * campaign.duration / campaign.experiment.settings.timestep
    repeated = f"; {again} parts were run again" if again else ""
    lines.append(
        f"{left} runs of {campaign.duration:g} s in {seconds:.1f} s: {left / seconds:.3g} runs and "
        f"{steps / seconds:.3g} timesteps a second{repeated}."
    )
    return lines


def search_worst(campaign: Campaign, result: Findings, evaluations: int) -> list[Worst]:
    """Search for the worst plant under each law.

    Args:
        campaign: The campaign.
        result: Findings of its runs, of which the worst ones begin the search.
        evaluations: Runs that the search may take for a law; as many random plants are tried.
    """
    plants = []
    with screen.progress(2 * evaluations * len(campaign.judged), "runs") as advance:
        for law in campaign.judged:
            done = partial(advance, f"worst under {law}")
            plants.append(worst(campaign, law, result.worst[law], evaluations, done))
    return plants


def search_radii(campaign: Campaign) -> list[Radius]:
    """Search how far the uncertainty may grow under each law."""
    reached = []
    with screen.progress(len(campaign.judged), "controllers") as advance:
        for law in campaign.judged:
            words = f"radius under {law}"
            advance(words, 0)
            reached.append(radius(campaign, law, lambda _, words=words: advance(words, 0)))
            advance(words)
    return reached
