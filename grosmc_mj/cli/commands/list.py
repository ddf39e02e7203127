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
        from grosmc_mj.campaign.family.specification import campaign_files
        from grosmc_mj.experiments.catalogue import find_experiments
        from grosmc_mj.experiments.file.reading import read_case_file
        from grosmc_mj.experiments.file.shipped import shipped_files
        from grosmc_mj.experiments.laws import FURTHER
        from grosmc_mj.plants import SYSTEMS

        files, console = shipped_files(), screen.console()
        campaigns = campaign_files()
        others = [name for name in files if name.partition("/")[0] not in SYSTEMS]
        console.print(f"{len(SYSTEMS)} systems, {len(files)} case files.")
        for name, system in SYSTEMS.items():
            experiments = find_experiments(name)
            laws = [*experiments[0].controllers, *FURTHER.get(name, ())]
            console.print(f"[bold]{name}[/]  {system.title}")
            console.print(f"  cases        {', '.join(one.case.name for one in experiments)}")
            console.print(f"  controllers  {', '.join(laws)}")
            if name in campaigns:
                console.print(f"  campaign     {read_case_file(campaigns[name]).title}")
        console.print("[bold]Other case files[/]")
        console.print(f"  {', '.join(others)}")
        console.print("A target is SYSTEM, SYSTEM/CASE such as servo/case1, or FILE.toml.")
        if not self.verbose:
            return screen.DONE
        wide = screen.wide_console()
        for name in SYSTEMS:
            wide.print(f"\n[bold]{name}[/]")
            for case in (one.case for one in find_experiments(name)):
                wide.print(f"  {case.name:<12} {case.title}  [dim]({case.source})[/]")
            wide.print(f"  plants       {', '.join(find_experiments(name)[0].plant_names)}")
            if further := FURTHER.get(name, ()):
                wide.print(f"  further      {', '.join(further)}  [dim](not run by validate)[/]")
        wide.print("\n[bold]Case files of the package[/]")
        for name, path in files.items():
            wide.print(f"  {name:<26} {read_case_file(path).title}")
        return screen.DONE
