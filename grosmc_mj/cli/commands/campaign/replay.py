"""grosmc-mj campaign --replay."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands.run import runs_table
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.errors import ArgumentError, SetupError, unknown_name

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.runs.replay import ReplayedRun
    from grosmc_mj.cli.commands.campaign.command import CampaignCommand

_ODD = re.compile(r"[^\w.+-]+")


def replay_run(command: CampaignCommand, which: str) -> int:
    """Repeat a run of a campaign, compare, write, print, draw.

    Args:
        command: With the campaign's folder as its target.
        which: Number or name of the run.
    """
    from grosmc_mj.campaign.report.document import replay_document
    from grosmc_mj.campaign.runs.folder import Folder
    from grosmc_mj.campaign.runs.replay import replay
    from grosmc_mj.campaign.runs.shard import EQUATIONS
    from grosmc_mj.campaign.runs.work import read_campaign
    from grosmc_mj.experiments import tables
    from grosmc_mj.simulation.simulate import Engine

    if command.engine not in get_args(Engine):
        raise ArgumentError(unknown_name("engine", command.engine, get_args(Engine)))
    console, folder = screen.console(), Path(command.target)
    campaign, notices = read_campaign(folder, command.case_file)
    found = replay(
        campaign,
        Folder(folder),
        which,
        command.controller,
        command.engine,  # pyright: ignore[reportArgumentType]
    )
    result = found.judged
    name = f"{which}_{_ODD.sub('_', result.controller.name)}"
    base = (command.out or folder / "replays") / name
    unwritten = _written(command, base, replay_document(campaign, found, command.engine))
    if found.stored and not found.differences:
        by = " by the equations" if found.outcome.judged_by[0] == EQUATIONS else ""
        words = (
            f"Run {which} is what the campaign stored{by}, bit for bit; engine {command.engine}."
        )
        screen.say_verdict(console, words, good=True)
    elif found.stored:
        screen.say_verdict(console, f"Run {which} is not what the campaign stored.", good=False)
    if not result.ended:
        words = "Numbers are of the law's samples, as they are stored; costs are of the recording."
        console.print(words, style="dim")
    for line in found.differences:
        console.print(f"differs: {line}", style="bold red", soft_wrap=True)
    screen.say_lines(console, _margins(campaign, found), "", all=command.verbose)
    screen.say_lines(console, notices, "yellow", all=command.verbose)
    screen.say_lines(console, tables.endings([result]), all=command.verbose)
    console.print(runs_table([result]))
    screen.say_lines(console, _plant(campaign, found), "", all=command.verbose)
    if command.verbose:
        wide = screen.wide_console()
        wide.print(tables.results_table([result]))
        wide.print(tables.LEGEND, style="dim")
    if unwritten:
        console.print(f"Nothing is written: {unwritten}; --out DIR keeps it.", soft_wrap=True)
    else:
        _draw(console, command, campaign, found, base)
    return screen.DIFFERS if found.differences else screen.DONE


def _written(command: CampaignCommand, base: Path, content: Any) -> str:
    """Write the JSON; why it cannot be written, where the user has named no place for it.

    Raises:
        SetupError: If it cannot be written where the user wants it.
    """
    from grosmc_mj.results.document import write_json

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
    console: Console, command: CampaignCommand, campaign: Campaign, found: ReplayedRun, base: Path
) -> None:
    """The figure and the film, and where all is."""
    from grosmc_mj.experiments.curves.figure import draw_experiment, figure_size
    from grosmc_mj.results.figure import figure_written

    files = [Path(f"{base}.json")]
    if command.figures:
        files.append(Path(f"{base}.png"))
        with figure_written(files[-1], figure_size([found.result])) as figure:
            draw_experiment(figure, [found.result])
    screen.say_files(console, *files)
    if command.film:
        # Its poster and its data have the names of the figure and of the result.
        film = base.parent / FOLDER / f"{base.name}.mp4"
        film_runs(console, [found.result], campaign.experiment.settings, film)


def _plant(campaign: Campaign, found: ReplayedRun) -> list[str]:
    """The plant's uncertain numbers, a line each."""
    from grosmc_mj.campaign.report.tables import numbers_as_run

    drawn, lines = [found.values[name] for name in campaign.family.names], []
    for each, value, nominal in numbers_as_run(campaign, drawn):
        unit, factor = each.shown_unit
        said = f"{each.name}: {value * factor:.6g} {unit}".rstrip()
        lines.append(f"{said} (nominal {nominal * factor:.4g})")
    return lines


def _margins(campaign: Campaign, found: ReplayedRun) -> list[str]:
    """The margins of its requirements, a line each, the least first."""
    margins = [
        (
            found.outcome.margins[each.key][0],
            f"{each.words}: margin {found.outcome.margins[each.key][0]:+.4g} {each.unit}".rstrip(),
        )
        for each in campaign.requirements
        if found.outcome.controller in each.of
    ]
    return [words for _, words in sorted(margins)] or ["nothing is required of it"]
