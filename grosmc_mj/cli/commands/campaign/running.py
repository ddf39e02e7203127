"""A campaign's runs: those that are missing, with a progress bar."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from grosmc_mj import sweep as campaigns
from grosmc_mj.cli import screen

if TYPE_CHECKING:
    from grosmc_mj.executors import Executor
    from grosmc_mj.sweep.campaign import Campaign
    from grosmc_mj.sweep.store import Folder


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
            again = campaigns.store.run_missing(campaign, folder, executor, screen.notice, finished)
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
