"""A campaign's runs: those that are missing, with a progress bar."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen

if TYPE_CHECKING:
    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.runs.folder import Folder
    from grosmc_mj.executors import Executor


def say_integrator(asked: Campaign) -> None:
    """One line if the physics steps otherwise than its model says."""
    if asked.plant.restepped:
        screen.notice(
            f"Steps by {asked.experiment.settings.integrator} instead of the model's own "
            "integrator, which may judge some plants otherwise."
        )


def run_parts(asked: Campaign, folder: Folder, executor: Executor) -> list[str]:
    """Run what is missing, with a progress bar; what to say of that, a line each.

    Raises:
        KeyboardInterrupt: If it is interrupted, with what is done.
    """
    from grosmc_mj.campaign.runs.running import missing, run_missing

    parts, shards = missing(asked, folder), asked.specification.shards
    left = sum(len(asked.specification.ids(index)) for index in parts) * len(asked.laws)
    lines = []
    if len(parts) < shards:
        lines.append(f"{shards - len(parts)} of {shards} parts are there already.")
    if not parts:
        return lines
    began, done = time.perf_counter(), 0
    try:
        with screen.progress(left, "runs") as advance:

            def told(runs: int, rates: dict[str, float]) -> None:
                nonlocal done
                done += runs
                speed = done / (time.perf_counter() - began)
                shares = ", ".join(f"{law} {100 * rate:.1f} %" for law, rate in rates.items())
                advance(f"{speed:.3g} runs/s; kept so far: {shares}", runs)

            advance("designed; the first part takes a while", 0)
            again = run_missing(asked, folder, executor, screen.notice, told)
    except KeyboardInterrupt:
        there = shards - len(missing(asked, folder))
        raise KeyboardInterrupt(
            f"interrupted: {there} of {shards} parts are done; the same command with --resume "
            "runs the others"
        ) from None
    seconds = time.perf_counter() - began
    steps = left * asked.duration / asked.experiment.settings.timestep
    repeated = f"; {again} parts were run again" if again else ""
    lines.append(
        f"{left} runs of {asked.duration:g} s in {seconds:.1f} s: {left / seconds:.3g} runs and "
        f"{steps / seconds:.3g} timesteps a second{repeated}."
    )
    return lines
