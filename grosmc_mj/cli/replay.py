"""grosmc-mj replay."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.campaign_commands import Replay as ReplayCommand
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.errors import ArgumentError, SetupError, unknown_name

if TYPE_CHECKING:
    from grosmc_mj.campaign.family.campaign import Campaign
    from grosmc_mj.campaign.runs.replay import ReplayedRun

_ODD = re.compile(r"[^\w.+-]+")


def replay(command: ReplayCommand) -> int:
    """Run it again, compare, draw."""
    from grosmc_mj.campaign.report.document import replay_document
    from grosmc_mj.campaign.runs.folder import Folder
    from grosmc_mj.campaign.runs.replay import replay
    from grosmc_mj.campaign.runs.work import read_campaign
    from grosmc_mj.experiments import tables
    from grosmc_mj.simulation.simulate import Engine

    if command.engine not in get_args(Engine):
        raise ArgumentError(unknown_name("engine", command.engine, get_args(Engine)))
    console = screen.console()
    campaign, notices = read_campaign(command.campaign, command.case_file)
    found = replay(
        campaign,
        Folder(command.campaign),
        command.run,
        command.controller,
        command.engine,  # pyright: ignore[reportArgumentType]
    )
    result = found.result
    base = (command.out or command.campaign / "replays") / _file_name(command, found)
    unwritten = _written(command, base, replay_document(campaign, found, command.engine))
    for line in notices:
        console.print(line, style="yellow", soft_wrap=True)
    for line in _plant(campaign, found):
        console.print(line, soft_wrap=True)
    console.print(tables.results_table([result]))
    console.print(tables.LEGEND, style="dim")
    for line in tables.endings([result]):
        console.print(line, style="red", soft_wrap=True)
    console.print(_margins(campaign, found), soft_wrap=True)
    if found.stored and not found.differences:
        console.print(
            f"Run {command.run} is what the campaign stored, bit for bit; engine {command.engine}.",
            style="bold green",
        )
    for line in found.differences:
        console.print(f"differs: {line}", style="bold red", soft_wrap=True)
    if unwritten:
        console.print(f"Nothing is written: {unwritten}; --out DIR keeps it.", soft_wrap=True)
    else:
        _draw(console, command, campaign, found, base)
    return screen.DIFFERS if found.differences else screen.DONE


def _file_name(command: ReplayCommand, found: ReplayedRun) -> str:
    """What its files are called: a controller's name may have anything in it."""
    return f"{command.run}_{_ODD.sub('_', found.result.controller.name)}"


def _written(command: ReplayCommand, base: Path, content: Any) -> str:
    """Write the JSON; why it cannot be written, where the user has named no place for it.

    Raises:
        SetupError: If it cannot be written where the user wants it.
    """
    from grosmc_mj.report.document import write_json

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
    console: Console, command: ReplayCommand, campaign: Campaign, found: ReplayedRun, base: Path
) -> None:
    """The figure and the film, and where all is."""
    from grosmc_mj.experiments.figure import SIZE, draw_experiment
    from grosmc_mj.report.figure import figure_written

    files = [Path(f"{base}.json")]
    if command.figures:
        files.append(Path(f"{base}.png"))
        with figure_written(files[-1], SIZE) as figure:
            draw_experiment(figure, [found.result])
    console.print(", ".join(map(str, files)), soft_wrap=True)
    if command.film:
        # Its poster and its data have the names of the figure and of the result.
        film = base.parent / FOLDER / f"{base.name}.mp4"
        film_runs(console, [found.result], campaign.experiment.settings, film)


def _plant(campaign: Campaign, found: ReplayedRun) -> list[str]:
    """The plant's uncertain numbers, a line each."""
    from grosmc_mj.report.tables import shown_unit

    lines = []
    for each in campaign.family.quantities:
        unit, factor = shown_unit(each.unit)
        value, nominal = found.values[each.name] * factor, each.nominal * factor
        lines.append(f"{each.name}: {value:.6g} {unit}".rstrip() + f" (nominal {nominal:.4g})")
    return lines


def _margins(campaign: Campaign, found: ReplayedRun) -> str:
    """The margins of its requirements, in a line."""
    margins = [
        f"{each.words}: margin {found.outcome.margins[each.key][0]:+.4g} {each.unit}".rstrip()
        for each in campaign.requirements
        if found.outcome.controller in each.of
    ]
    return "; ".join(margins) or "nothing is required of it"
