"""grosmc-mj list and readme."""

from __future__ import annotations

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import List, Readme


def list_systems(_: List) -> int:
    """Systems, cases, plants, controllers."""
    from grosmc_mj.experiments.experiment import find_experiments
    from grosmc_mj.experiments.file.reading import read_case_file
    from grosmc_mj.experiments.file.shipped import shipped_files
    from grosmc_mj.experiments.laws import FURTHER
    from grosmc_mj.plants import SYSTEMS

    console = screen.console()
    for name, system in SYSTEMS.items():
        console.print(f"[bold]{name}[/]  {system.title}")
        first, *others = find_experiments(name)
        for case in (each.case for each in (first, *others)):
            console.print(f"  {case.name:<12} {case.title}  [dim]({case.source})[/]")
        console.print(f"  plants       {', '.join(first.plant_names)}")
        console.print(f"  controllers  {', '.join(first.controllers)}")
        if further := list(FURTHER.get(name, ())):
            console.print(f"  further      {', '.join(further)}  [dim](not run by validate)[/]")
        console.print()
    console.print("[bold]Case files of the package[/]  for grosmc-mj run, view and new --like")
    for name, path in shipped_files().items():
        console.print(f"  {name:<26} {read_case_file(path).title}")
    return screen.DONE


def readme(command: Readme) -> int:
    """The README's table."""
    from grosmc_mj.chapter.results_table import write_table

    write_table(command.readme, command.results)
    return screen.DONE
