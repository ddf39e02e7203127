"""grosmc-mj campaign: the runs that are missing, the answer, the searches."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grosmc_mj.arguments import require_known
from grosmc_mj.cli import screen
from grosmc_mj.cli.commands.campaign import answer
from grosmc_mj.errors import ArgumentError
from grosmc_mj.executors import Executor, make_executor
from grosmc_mj.results.document import write_json
from grosmc_mj.sweep import map as maps
from grosmc_mj.sweep import store
from grosmc_mj.sweep.campaign import Campaign, specification_of
from grosmc_mj.sweep.findings import RESULTS, findings, results_document
from grosmc_mj.sweep.radius import RADIUS, Radius, radius, radius_document
from grosmc_mj.sweep.store import Folder, read_manifest, refuse_other_code
from grosmc_mj.sweep.worst import LEAST, WORST, worst, worst_document

if TYPE_CHECKING:
    from grosmc_mj.cli.commands.campaign.command import CampaignCommand

FOLDER = Path("renders") / "campaigns"
_MOST_EVALUATIONS = 10**7
# Options that are the specification's own.
_SPECIFIED = (
    "runs", "shard", "seed", "sampler", "controllers", "control_period", "duration", "integrator",
    "screen",
)  # fmt: skip


def run(command: CampaignCommand) -> int:
    """Carry out a campaign; returns the exit code."""
    if Folder(Path(command.target)).begun:
        raise ArgumentError(
            f"{command.target} is a campaign's folder: --replay RUN repeats one of its runs; "
            "its case file with --resume and --out goes on"
        )
    _refuse_numbers(command)
    specified: dict[str, Any] = {name: getattr(command, name) for name in _SPECIFIED}
    specification = specification_of(command.target, **specified)
    folder = Folder(command.out or FOLDER / specification.name)
    if folder.begun:
        refuse_other_code(folder.path, read_manifest(folder.path), specification)
    campaign = Campaign.of(specification)
    _refuse_axes(command.axes, campaign.family.names)
    executor = make_executor(command.executor, workers=command.workers, scheduler=command.scheduler)
    console, full = screen.console(), command.verbose
    with folder.held():
        for line in (*folder.begin(campaign, resume=command.resume), *_notices(campaign)):
            screen.notice(line)
        progress = _run_parts(campaign, folder, executor)
    result = findings(campaign, folder, command.confidence)
    documents = {RESULTS: results_document(campaign, result)}
    write_json(folder.path / RESULTS, documents[RESULTS])
    code = answer.say_verdict(console, campaign, result, command.at_least, command.confidence)
    answer.say_findings(console, campaign, result, progress, full=full)
    reached: list[Radius] = []
    if command.worst:
        laws, runs = campaign.judged, command.evaluations
        with screen.progress(2 * runs * len(laws), "runs") as advance:
            plants = [
                worst(
                    campaign, law, result.worst[law], runs, partial(advance, f"worst under {law}")
                )
                for law in laws
            ]
        documents[WORST] = worst_document(campaign, plants)
        write_json(folder.path / WORST, documents[WORST])
        answer.say_worst(console, campaign, plants, full=full)
    if command.radius:
        reached = _radii(campaign)
        documents[RADIUS] = radius_document(campaign, reached)
        write_json(folder.path / RADIUS, documents[RADIUS])
        answer.say_radius(console, campaign, reached, full=full)
    files = [folder.path / name for name in documents]
    if command.figures:
        files += maps.write_figures(campaign, folder, result, reached, command.axes)
    screen.say_files(console, *files)
    return code


def _refuse_numbers(command: CampaignCommand) -> None:
    """Refuse shares that are none, and too short a search, before anything is run."""
    for name, value in (("confidence", command.confidence), ("at-least", command.at_least)):
        if value is not None and not 0 < value < 1:
            raise ArgumentError(f"--{name} {value:g} must lie between 0 and 1")
    if command.at_least is not None and command.sampler != "random":
        raise ArgumentError(
            f"--at-least takes independent runs, which --sampler {command.sampler} does not draw: "
            "take --sampler random"
        )
    if command.worst and not LEAST <= command.evaluations <= _MOST_EVALUATIONS:
        raise ArgumentError(
            f"--evaluations {command.evaluations} must be {LEAST} or more, up to "
            f"{_MOST_EVALUATIONS}"
        )


def _refuse_axes(axes: tuple[str, ...], names: list[str]) -> None:
    """Refuse axes that are no two uncertain numbers."""
    for name in axes:
        require_known("uncertain number", name, names)
    if axes and not len(axes) == len(set(axes)) == 2:
        raise ArgumentError(f"--axes {' '.join(axes)}: name two uncertain numbers")


def _notices(campaign: Campaign) -> list[str]:
    """Lines on requirements that are not judged, loads that do not act, and another integrator."""
    late = f"never acts: runs end at {campaign.duration:g} s, before it begins."
    notices = [*campaign.not_judged, *(f"{name} {late}" for name in campaign.idle)]
    if campaign.plant.restepped:
        notices.insert(
            0,
            f"Steps by {campaign.experiment.settings.integrator} instead of the model's own "
            "integrator, which may judge some plants otherwise.",
        )
    return notices


def _run_parts(campaign: Campaign, folder: Folder, executor: Executor) -> list[str]:
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


def _radii(campaign: Campaign) -> list[Radius]:
    """How far the uncertainty may grow under each law."""
    reached = []
    with screen.progress(len(campaign.judged), "controllers") as advance:
        for law in campaign.judged:
            words = f"radius under {law}"
            advance(words, 0)
            reached.append(radius(campaign, law, lambda _, words=words: advance(words, 0)))
            advance(words)
    return reached
