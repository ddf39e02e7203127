"""grosmc-mj list."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.plants import Signal


@dataclass(frozen=True)
class ListCommand(Command):
    """List the systems with their cases and controllers, and the case files of the package.

    Of one target the names, too, by which case files call its states, inputs, bodies and joints,
    with their units.

    Attributes:
        target: A system, a case of the package or a case file.
    """

    target: Annotated[
        Positional[str],
        arg(metavar=f"[{TARGET}]", name="target", help_behavior_hint="(default: everything)"),
    ] = ""

    @property
    def simulates(self) -> bool:
        """The names of everything stand in files."""
        return bool(self.target) or self.verbose

    def execute(self) -> int:
        """Systems, cases, laws; with their titles, plants and names, if asked for."""
        if not self.target:
            _say_everything(screen.console())
            if self.verbose:
                _say_more(screen.wide_console())
            return screen.DONE
        from grosmc_mj.experiments.catalogue import find_experiments

        experiments, console = find_experiments(self.target), screen.wide_console()
        title = experiments[0].nominal.system.title
        console.print(f"{self.target}: {title}", style="bold", markup=False)
        _say_cases(console, experiments)
        _say_names(console, experiments[0])
        return screen.DONE


def _say_everything(console: Console) -> None:
    """What there is, by the names in the files: nothing is built for it."""
    from grosmc_mj.experiments.file.shipped import (
        base_file,
        campaign_files,
        case_order,
        content,
        shipped_files,
    )

    files, campaigns = shipped_files(), campaign_files()
    folders: dict[str, list[str]] = {}
    for name in files:
        folders.setdefault(name.split("/")[0], []).append(name)
    bases = {name: base for name in folders if (base := base_file(name)) is not None}
    console.print(f"{len(bases)} systems, {len(files)} case files.")
    for name, base in bases.items():
        cases = sorted(folders[name], key=case_order)
        console.print(f"[bold]{name}[/]")
        console.print(f"  cases        {', '.join(each.split('/')[1] for each in cases)}")
        console.print(f"  laws         {', '.join(content(base)['laws'])}")
        if name in campaigns:
            console.print(f"  campaign     {content(campaigns[name])['title']}")
    others = [name for folder in folders if folder not in bases for name in folders[folder]]
    console.print("[bold]Other case files[/]")
    console.print(f"  {', '.join(others)}")
    console.print("A target is SYSTEM, SYSTEM/CASE such as servo/case1, or FILE.toml.")


def _say_more(console: Console) -> None:
    """Titles, plants and the names of their parts."""
    from grosmc_mj.experiments.catalogue import find_experiments
    from grosmc_mj.experiments.file.shipped import content, shipped_files
    from grosmc_mj.experiments.laws import FURTHER
    from grosmc_mj.plants import SYSTEMS

    for name, system in SYSTEMS.items():
        console.print(f"\n[bold]{name}[/]  {system.title}")
        experiments = find_experiments(name)
        _say_cases(console, experiments)
        _say_names(console, experiments[0])
        if further := FURTHER.get(name, ()):
            console.print(f"  further      {', '.join(further)}  [dim](not run by validate)[/]")
    console.print("\n[bold]Case files of the package[/]")
    for name, path in shipped_files().items():
        console.print(f"  {name:<26} {content(path)['title']}", markup=False)


def _say_cases(console: Console, experiments: Sequence[Experiment]) -> None:
    """Cases with their titles, controllers and plants."""
    from rich.markup import escape

    for case in (one.case for one in experiments):
        source = f"  [dim]({escape(case.source)})[/]" if case.source else ""
        console.print(f"  {case.name:<12} {escape(case.title)}{source}")
    first = experiments[0]
    console.print(f"  controllers  {', '.join(first.controllers)}", markup=False)
    console.print(f"  plants       {', '.join(first.plant_names)}", markup=False)


def _say_names(console: Console, experiment: Experiment) -> None:
    """What case files call the parts of a plant, with the tables that ask for them."""
    from grosmc_mj.physics.files import body_names, joint_names

    plant = experiment.plant(experiment.nominal.truest)
    system = plant.system
    rows = [
        ("states", _signals(system.states), "start, of [[sensor]] and [[estimator]]"),
        ("inputs", _signals(system.inputs), "of [[actuator]]"),
    ]
    if plant.kind == "physics":
        units = {
            joint: f" [{each.unit}]"
            for joint, each in zip(system.joints, system.positions, strict=True)
        }
        joints = [name + units.get(name, "") for name in joint_names(plant.model)]
        rows += [
            ("bodies", ", ".join(body_names(plant.model)), "body of [[edit]]"),
            ("joints", ", ".join(joints), "joint of [[edit]]"),
        ]
    else:
        rows.append(("parameters", ", ".join(vars(plant.parameters)), "parameter of [[edit]]"))
    for what, names, asked_by in rows:
        console.print(f"  {what:<12} {names}  ({asked_by})", markup=False)


def _signals(signals: Sequence[Signal]) -> str:
    """Names with units."""
    return ", ".join(f"{each.name} [{each.unit}]" for each in signals)
