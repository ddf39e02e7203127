"""grosmc-mj campaign --replay."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from rich.console import Console

from grosmc_mj.arguments import require_known
from grosmc_mj.cli import screen
from grosmc_mj.cli.commands.run import runs_table
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.errors import SetupError
from grosmc_mj.experiments import tables
from grosmc_mj.experiments.curves import draw_experiment, figure_size
from grosmc_mj.results.document import write_json
from grosmc_mj.results.figure import figure_written
from grosmc_mj.simulation.simulate import Engine
from grosmc_mj.sweep.campaign import Campaign
from grosmc_mj.sweep.replay import ReplayedRun, replay, replay_document
from grosmc_mj.sweep.store import Folder, read_campaign

if TYPE_CHECKING:
    from grosmc_mj.cli.commands.campaign.command import CampaignCommand


def replay_run(command: CampaignCommand, which: str) -> int:
    """Repeat a run of a campaign, compare, write, print, draw.

    Args:
        command: With the campaign's folder as its target.
        which: Number or name of the run.
    """
    require_known("engine", command.engine, get_args(Engine))
    console, folder, engine = screen.console(), Path(command.target), command.engine
    campaign, notices = read_campaign(folder, command.case_file)
    run: Any = (campaign, Folder(folder), which, command.controller, engine)
    replayed = replay(*run)
    result = replayed.judged
    law = re.sub(r"[^\w.+-]+", "_", result.controller.name)
    base = (command.out or folder / "replays") / f"{which}_{law}"
    unwritten = _written(command, base, replay_document(campaign, replayed, engine))
    if replayed.differences == []:
        by = " by the equations" if replayed.outcome["judged_by"][0] == "equations" else ""
        words = f"Run {which} is what the campaign stored{by}, bit for bit; engine {engine}."
        screen.say_verdict(console, words, good=True)
    elif replayed.differences:
        screen.say_verdict(console, f"Run {which} is not what the campaign stored.", good=False)
    if not result.ended:
        words = "Numbers are of the law's samples, as they are stored; costs are of the recording."
        console.print(words, style="dim")
    for line in replayed.differences or ():
        console.print(f"differs: {line}", style="bold red", soft_wrap=True)
    margins, numbers = _lines(campaign, replayed)
    screen.say_lines(console, margins, "", all=command.verbose)
    screen.say_lines(console, notices, "yellow", all=command.verbose)
    screen.say_lines(console, tables.endings([result]), all=command.verbose)
    console.print(runs_table([result]))
    screen.say_lines(console, numbers, "", all=command.verbose)
    if command.verbose:
        wide = screen.wide_console()
        wide.print(tables.results_table([result]))
        wide.print(tables.LEGEND, style="dim")
    if unwritten:
        console.print(f"Nothing is written: {unwritten}; --out DIR keeps it.", soft_wrap=True)
    else:
        _draw(console, command, campaign, replayed, base)
    return screen.DIFFERS if replayed.differences else screen.DONE


def _written(command: CampaignCommand, base: Path, content: Any) -> str:
    """Write the JSON; why it cannot be written, where the user has named no place for it.

    Raises:
        SetupError: If it cannot be written where the user wants it.
    """
    places = (base.parent, base.parent / FOLDER)
    if command.out is None and any(place.is_symlink() for place in places):
        return f"{base.parent} leads elsewhere"
    try:
        write_json(Path(f"{base}.json"), content)
    except SetupError as error:
        if command.out is not None:
            raise
        return str(error).split(";")[0]
    return ""


def _draw(
    console: Console,
    command: CampaignCommand,
    campaign: Campaign,
    replayed: ReplayedRun,
    base: Path,
) -> None:
    """The figure and the film, and where all is."""
    files = [Path(f"{base}.json")]
    if command.figures:
        files.append(Path(f"{base}.png"))
        with figure_written(files[-1], figure_size([replayed.result])) as figure:
            draw_experiment(figure, [replayed.result])
    screen.say_files(console, *files)
    if command.film:
        # Its poster and its data have the names of the figure and of the result.
        film = base.parent / FOLDER / f"{base.name}.mp4"
        film_runs(console, [replayed.result], campaign.experiment.settings, film)


def _lines(campaign: Campaign, replayed: ReplayedRun) -> tuple[list[str], list[str]]:
    """Margins of the run, the least first, and the plant's uncertain numbers, a line each."""
    outcome, drawn = replayed.outcome, []
    margins = sorted(
        (float(outcome[f"margin {limit.key}"][0]), limit.words, limit.unit)
        for limit in campaign.limits_of(outcome["controller"][0])
    )
    lines = [f"{words}: margin {margin:+.4g} {unit}".rstrip() for margin, words, unit in margins]
    values = np.array([outcome[name][0] for name in campaign.family.names])
    for of, value, nominal in campaign.pairs_as_run(values):
        unit, factor = of.shown_unit
        number = f"{of.name}: {value * factor:.6g} {unit}".rstrip()
        drawn.append(f"{number} (nominal {nominal * factor:.4g})")
    return lines or ["nothing is required of it"], drawn
