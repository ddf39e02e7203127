"""grosmc-mj list."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command


@dataclass(frozen=True)
class ListCommand(Command):
    """List the systems with their cases and controllers, and the case files of the package."""

    def execute(self) -> int:
        """Systems, cases, controllers; with their titles and plants, if asked for."""
        from grosmc_mj.experiments.case import cases, shipped_files
        from grosmc_mj.experiments.designs import DESIGNS, controller_names
        from grosmc_mj.experiments.file.reading import read_case_file
        from grosmc_mj.experiments.runs import plant_names
        from grosmc_mj.plants import SYSTEMS

        files, console = shipped_files(), screen.console()
        others = [name for name in files if name.partition("/")[0] not in SYSTEMS]
        console.print(f"{len(SYSTEMS)} systems, {len(files)} case files.")
        for name, system in SYSTEMS.items():
            further = list(DESIGNS[name].further)
            console.print(f"[bold]{name}[/]  {system.title}")
            console.print(f"  cases        {', '.join(case.name for case in cases(name))}")
            console.print(f"  controllers  {', '.join([*controller_names(name), *further])}")
        console.print("[bold]Other case files[/]")
        console.print(f"  {', '.join(others)}")
        console.print("A target is SYSTEM, SYSTEM/CASE such as servo/case1, or FILE.toml.")
        if not self.verbose:
            return screen.DONE
        wide = screen.wide_console()
        for name in SYSTEMS:
            wide.print(f"\n[bold]{name}[/]")
            for case in cases(name):
                wide.print(f"  {case.name:<12} {case.title}  [dim]({case.source})[/]")
            wide.print(f"  plants       {', '.join(plant_names(name))}")
            if further := list(DESIGNS[name].further):
                wide.print(f"  further      {', '.join(further)}  [dim](not run by validate)[/]")
            for alias, (same, why) in DESIGNS[name].aliases.items():
                wide.print(f"  {alias} is {same}: {why}", style="dim")
        wide.print("\n[bold]Case files of the package[/]")
        for name, path in files.items():
            wide.print(f"  {name:<26} {read_case_file(path).title}")
        return screen.DONE
