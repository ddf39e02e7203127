"""grosmc-mj replay."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

from grosmc_mj.cli import screen
from grosmc_mj.cli.campaign_commands import Replay as ReplayCommand
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.errors import ArgumentError, unknown_name

if TYPE_CHECKING:
    from grosmc_mj.campaign.campaign import Campaign
    from grosmc_mj.campaign.replay import Replay


def replay(command: ReplayCommand) -> int:
    """Run it again, compare, draw."""
    from grosmc_mj.campaign.document import replay_document
    from grosmc_mj.campaign.folder import Folder
    from grosmc_mj.campaign.replay import replay
    from grosmc_mj.campaign.work import read_campaign
    from grosmc_mj.rendering.figure import figure_written
    from grosmc_mj.simulation.simulate import Engine
    from grosmc_mj.validation import tables
    from grosmc_mj.validation.experiment_figure import SIZE, draw_experiment
    from grosmc_mj.validation.results_file import write_json

    if command.engine not in get_args(Engine):
        raise ArgumentError(unknown_name("engine", command.engine, get_args(Engine)))
    console = screen.console()
    campaign, others = read_campaign(str(command.campaign))
    for line in others:
        console.print(f"{line}: bits may differ", style="yellow")
    found = replay(
        campaign,
        Folder(command.campaign),
        command.run,
        command.controller,
        command.engine,  # pyright: ignore[reportArgumentType]
    )
    result = found.result
    name = f"{command.run}_{result.controller.name}"
    base = command.campaign / "replays" / name
    for line in _plant(campaign, found):
        console.print(line, soft_wrap=True)
    console.print(tables.results_table([result]))
    console.print(tables.LEGEND, style="dim")
    for line in tables.endings([result]):
        console.print(line, style="red", soft_wrap=True)
    console.print(_margins(campaign, found), soft_wrap=True)
    files = [base.with_suffix(".json")]
    write_json(files[0], replay_document(campaign, found, command.engine))
    if command.figures:
        with figure_written(base.with_suffix(".png"), SIZE) as figure:
            draw_experiment(figure, [result])
        files.append(base.with_suffix(".png"))
    console.print(", ".join(map(str, files)), soft_wrap=True)
    if command.film:
        # Its poster and its data have the names of the figure and of the result.
        film = base.parent / FOLDER / f"{name}.mp4"
        film_runs(console, [result], campaign.experiment.settings, film)
    if found.stored and not found.differences:
        console.print(
            f"Run {command.run} is what the campaign stored, bit for bit; engine {command.engine}.",
            style="bold green",
        )
    for line in found.differences:
        console.print(f"differs: {line}", style="bold red", soft_wrap=True)
    return screen.DIFFERS if found.differences else screen.DONE


def _plant(campaign: Campaign, found: Replay) -> list[str]:
    """The plant's uncertain numbers, a line each."""
    from grosmc_mj.campaign.pictures import shown_unit

    lines = []
    for each in campaign.family.quantities:
        unit, factor = shown_unit(each.unit)
        value, nominal = found.values[each.name] * factor, each.nominal * factor
        lines.append(f"{each.name}: {value:.6g} {unit}".rstrip() + f" (nominal {nominal:.4g})")
    return lines


def _margins(campaign: Campaign, found: Replay) -> str:
    """The margins of its requirements, in a line."""
    margins = [
        f"{each.words}: margin {found.outcome.margins[each.key][0]:+.4g} {each.unit}".rstrip()
        for each in campaign.requirements
        if found.outcome.controller in each.of
    ]
    return "; ".join(margins) or "nothing is required of it"
