"""grosmc-mj hold."""

from __future__ import annotations

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Hold


def hold(command: Hold) -> int:
    """Run, write, print, draw."""
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.files import cannot_write
    from grosmc_mj.report.document import write_json
    from grosmc_mj.studies.cart.figure import write_holding_figure
    from grosmc_mj.studies.cart.measure import steps, study
    from grosmc_mj.studies.cart.report import cart_document, cart_tables, legend

    settings = Settings(
        switching=command.switching,
        surface=command.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
    )
    target = command.out / "hold.json"
    try:
        command.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(target, error) from error
    console = screen.console()
    with screen.progress(steps()) as advance:
        found = study(settings, advance)
    write_json(target, cart_document(found))
    for table in cart_tables(found):
        console.print(table)
        console.print()
    console.print(legend(found), style="dim")
    for each in found.held:
        if each.result.ended:
            console.print(
                f"{each.result.key}: {each.result.ended}", style="red", soft_wrap=True, markup=False
            )
    figure = write_holding_figure(found, command.out)
    console.print(f"{target}, {figure}", soft_wrap=True)
    return screen.DONE
