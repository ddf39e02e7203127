"""grosmc-mj campaign."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.campaign_commands import Campaign as CampaignCommand
from grosmc_mj.errors import ArgumentError, unknown_name

if TYPE_CHECKING:
    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.findings.findings import Findings
    from grosmc_mj.campaign.findings.radius import Radius
    from grosmc_mj.campaign.runs.executors import Executor
    from grosmc_mj.campaign.runs.folder import Folder

FOLDER = Path("renders") / "campaigns"
_MOST_EVALUATIONS = 10**7


def campaign(command: CampaignCommand) -> int:
    """Run what is missing, say what is there, search where that is asked for."""
    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.family.specification import specification_of
    from grosmc_mj.campaign.findings.findings import findings
    from grosmc_mj.campaign.report.document import RADIUS, RESULTS, results_document
    from grosmc_mj.campaign.runs.executors import make_executor
    from grosmc_mj.campaign.runs.folder import Folder
    from grosmc_mj.campaign.runs.manifest import read_manifest, refuse_other_code
    from grosmc_mj.report.document import write_json

    _check(command)
    specification = specification_of(
        command.target,
        runs=command.runs,
        shard=command.shard,
        seed=command.seed,
        sampler=command.sampler,
        controllers=command.controllers or None,
        control_period=command.control_period,
        duration=command.duration,
        integrator=command.integrator,
    )
    folder = Folder(command.out or FOLDER / specification.name)
    if folder.begun:
        refuse_other_code(folder.path, read_manifest(folder.path), specification)
    asked = Campaign.of(specification)
    _check_axes(command, asked)
    executor = make_executor(command.executor, workers=command.workers, scheduler=command.scheduler)
    console = screen.console()
    with folder.held():
        for line in folder.begin(asked, resume=command.resume):
            _notice(line)
        _say_integrator(asked)
        for name in asked.idle:
            _notice(f"{name} never acts: runs end at {asked.duration:g} s, before it begins.")
        done = _run(asked, folder, executor)
    found = findings(asked, folder, command.confidence)
    files = [folder.path / RESULTS]
    write_json(files[0], results_document(asked, found))
    for line in done:
        console.print(line, style="dim")
    _say(console, asked, found)
    if command.worst:
        files.append(_search(console, command, asked, folder, found))
    reached = _grow(console, asked, folder) if command.radius else []
    if reached:
        files.append(folder.path / RADIUS)
    code = _verdict(console, command, found)
    if command.figures:
        files += _draw(command, asked, folder, found, reached)
    console.print(", ".join(map(str, files)), soft_wrap=True)
    return code


def _check(command: CampaignCommand) -> None:
    """Refuse shares that are none, and too short a search, before anything is run."""
    from grosmc_mj.campaign.findings.worst import LEAST

    for name, value in (("confidence", command.confidence), ("at-least", command.at_least)):
        if value is not None and not 0 < value < 1:
            raise ArgumentError(f"--{name} {value:g} must lie between 0 and 1")
    if command.worst and not LEAST <= command.evaluations <= _MOST_EVALUATIONS:
        raise ArgumentError(
            f"--evaluations {command.evaluations} must be {LEAST} or more, up to "
            f"{_MOST_EVALUATIONS}"
        )


def _check_axes(command: CampaignCommand, asked: Campaign) -> None:
    """Refuse axes that are no uncertain numbers."""
    if command.axes and len(command.axes) != 2:
        raise ArgumentError(f"--axes names {len(command.axes)}: name two uncertain numbers")
    for name in command.axes:
        if name not in asked.family.names:
            raise ArgumentError(unknown_name("uncertain number", name, asked.family.names))
    if command.axes and command.axes[0] == command.axes[1]:
        raise ArgumentError(f"--axes {command.axes[0]!r} twice: name two different numbers")


def _say_integrator(asked: Campaign) -> None:
    """One line if the physics steps otherwise than its model says."""
    if asked.plant.restepped:
        _notice(
            f"Steps by {asked.experiment.settings.integrator} instead of the model's own "
            "integrator, which may judge some plants otherwise."
        )


def _run(asked: Campaign, folder: Folder, executor: Executor) -> list[str]:
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
            again = run_missing(asked, folder, executor, _notice, told)
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
        f"{steps / seconds:.3g} physics steps a second{repeated}."
    )
    return lines


def _notice(line: str) -> None:
    """Say what is no result, beside the results."""
    print(line, file=sys.stderr)


def _say(console: Console, asked: Campaign, found: Findings) -> None:
    """Print what the runs say."""
    from grosmc_mj.campaign.findings.findings import ALL
    from grosmc_mj.campaign.report import tables

    console.print()
    console.print(tables.pass_rates_table(found.rates, found.cut_short, found.sampled))
    console.print()
    console.print(tables.margins_table(found.summaries, found.units, found.looked_at))
    if found.differences:
        console.print()
        console.print(tables.paired_table(found.differences, found.units, found.looked_at))
    for law in asked.laws:
        console.print()
        console.print(tables.sensitivity_table(found.sensitivities[law], ALL, law, found.looked_at))
    console.print()


def _search(
    console: Console, command: CampaignCommand, asked: Campaign, folder: Folder, found: Findings
) -> Path:
    """Search for the worst plants."""
    from grosmc_mj.campaign.findings.worst import worst
    from grosmc_mj.campaign.report.document import WORST, worst_document
    from grosmc_mj.campaign.report.search_tables import worst_table
    from grosmc_mj.report.document import write_json

    searched = []
    with screen.progress(2 * command.evaluations * len(asked.laws), "runs") as advance:
        for law in asked.laws:
            advance(f"worst plant under {law}", 0)
            searched.append(
                worst(
                    asked,
                    law,
                    found.worst[law],
                    command.evaluations,
                    lambda runs: advance(f"worst plant under {law}", runs),  # noqa: B023
                )
            )
    write_json(folder.path / WORST, worst_document(asked, searched))
    console.print(worst_table(asked, searched))
    console.print()
    return folder.path / WORST


def _grow(console: Console, asked: Campaign, folder: Folder) -> list[Radius]:
    """Look how far the uncertainty may grow."""
    from grosmc_mj.campaign.findings.radius import radius
    from grosmc_mj.campaign.report.document import RADIUS, radius_document
    from grosmc_mj.campaign.report.search_tables import radius_table
    from grosmc_mj.report.document import write_json

    reached = []
    with screen.progress(len(asked.laws), "controllers") as advance:
        for law in asked.laws:
            advance(f"radius under {law}", 0)
            reached.append(
                radius(asked, law, lambda runs: advance(f"radius under {law}: {runs} runs", 0))  # noqa: B023
            )
            advance(f"radius under {law}")
    write_json(folder.path / RADIUS, radius_document(asked, reached))
    console.print(radius_table(asked, reached))
    console.print()
    return reached


def _draw(
    command: CampaignCommand,
    asked: Campaign,
    folder: Folder,
    found: Findings,
    reached: Sequence[Radius],
) -> list[Path]:
    """Draw the figures; returns one file of each."""
    from grosmc_mj.campaign.report.figures import (
        both,
        draw_map,
        draw_margins,
        draw_radius,
        map_axes,
    )

    margins, plane, grown = (both(folder.path / name) for name in ("margins", "map", "radius"))
    draw_margins(asked, found, margins)
    files = [margins[0]]
    axes = map_axes(asked, found, command.axes)
    if axes is not None:
        draw_map(asked, folder, found, axes, plane)
        files.append(plane[0])
    if reached:
        draw_radius(asked, reached, grown)
        files.append(grown[0])
    return files


def _verdict(console: Console, command: CampaignCommand, found: Findings) -> int:
    """The exit code, and why."""
    from grosmc_mj.campaign.findings.findings import ALL

    if command.at_least is None:
        return screen.DONE
    missed = {
        law: rate.low
        for (asked, law), rate in found.rates.items()
        if asked == ALL and rate.low < command.at_least
    }
    for law, low in missed.items():
        console.print(
            f"{law}: at least {100 * low:.4g} % of the distribution keep everything "
            f"(confidence {command.confidence:g}), {100 * command.at_least:g} % are asked for.",
            style="bold red",
        )
    return screen.DIFFERS if missed else screen.DONE
