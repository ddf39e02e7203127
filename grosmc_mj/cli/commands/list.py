"""grosmc-mj list."""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.cli.targets import TARGET

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from grosmc_mj.plants import Plant


@dataclass(frozen=True)
class ListCommand(Command):
    """List the systems with their cases and controllers, and the case files of the package.

    Of one target the names, too, by which case files call its states, inputs, bodies and joints,
    with their units, and the nominal numbers of its plant.

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
        return bool(self.target)

    def execute(self) -> int:
        """All systems and case files by name, or one target in detail."""
        if self.target:
            _say_one(screen.console(), self.target)
        else:
            _say_everything(screen.console())
        return DONE


def _say_everything(console: Console) -> None:
    """Systems, cases and laws by the names in the files: nothing is built for it."""
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
        console.print(name, style="bold")
        _say(console, "cases", ", ".join(case.split("/")[1] for case in cases))
        _say(console, "laws", ", ".join(content(base)["laws"]))
        if name in campaigns:
            _say(console, "campaign", content(campaigns[name])["title"])
    others = [name for folder in folders if folder not in bases for name in folders[folder]]
    console.print("Other case files", style="bold")
    console.print(f"  {', '.join(others)}")
    console.print("A target is SYSTEM, SYSTEM/CASE such as servo/case1, or FILE.toml.")


def _say_one(console: Console, target: str) -> None:
    """The cases, laws and plants of a target, and the names and numbers of its parts."""
    from grosmc_mj.experiments.catalogue import find_experiments
    from grosmc_mj.physics.files import body_names, joint_names
    from grosmc_mj.results.tables import names, table, text

    experiments = find_experiments(target)
    first = experiments[0]
    plant = first.plant(first.nominal.truest)
    system = plant.system
    console.print(f"{target}: {first.nominal.system.title}", style="bold", markup=False)
    for case in (one.case for one in experiments):
        _say(console, case.name, case.title + (f"  ({case.source})" if case.source else ""))
    _say(console, "laws", ", ".join(dict.fromkeys([*first.file.laws, *first.controllers])))
    _say(console, "plants", ", ".join(first.plant_names))
    states, inputs = (
        ", ".join(f"{signal.name} [{signal.unit}]" for signal in signals)
        for signals in (system.states, system.inputs)
    )
    _say(console, "states", f"{states}  (start, of [[sensor]] and [[estimator]])")
    _say(console, "inputs", f"{inputs}  (of [[actuator]])")
    if plant.kind == "physics":
        units = dict(zip(system.joints, (one.unit for one in system.positions), strict=True))
        joints = (
            f"{name} [{units[name]}]" if name in units else name
            for name in joint_names(plant.model)
        )
        _say(console, "bodies", f"{', '.join(body_names(plant.model))}  (body of [[edit]])")
        _say(console, "joints", f"{', '.join(joints)}  (joint of [[edit]])")
    else:
        _say(console, "parameters", f"{', '.join(vars(plant.parameters))}  (of [[edit]])")
    columns = [*names("nominal"), *text("numbers that are not zero")]
    console.print(table("", columns, _nominal_numbers(first.nominal.plant).items()))


def _nominal_numbers(plant: Plant) -> dict[str, str]:
    """The numbers of the equations and of the model in MuJoCo with their units, by their owner."""
    from mujoco import mjtJoint

    from grosmc_mj.fields import range_of

    numbers: dict[str, list[str]] = {}

    def note(owner: str, name: str, values: Sequence[float], unit: str) -> None:
        if any(values):
            written = ", ".join(f"{value:.5g}" for value in values)
            numbers.setdefault(owner, []).append(f"{name} {written} {unit}".rstrip())

    if plant.kind != "physics" or plant.system.read_parameters is not None:
        parameters = plant.analytic().parameters
        for name, value in vars(parameters).items():
            bounds = range_of(type(parameters), name)
            if bounds is None or bounds.unit:
                note("equations", name, [value], bounds.unit if bounds else "")
    if plant.kind == "physics":
        note("world", "gravity", plant.model.opt.gravity, "m/s^2")
        for body in map(plant.model.body, range(1, plant.model.nbody)):
            note(body.name, "mass", body.mass, "kg")
            note(body.name, "principal inertia", body.inertia, "kg m^2")
            note(body.name, "centre of mass", body.ipos, "m")
        for joint in map(plant.model.joint, range(plant.model.njnt)):
            slides = joint.type[0] == mjtJoint.mjJNT_SLIDE
            note(joint.name, "damping", joint.damping, "N s/m" if slides else "N m s/rad")
            note(joint.name, "friction", joint.frictionloss, "N" if slides else "N m")
            note(joint.name, "armature", joint.armature, "kg" if slides else "kg m^2")
    return {owner: "; ".join(texts) for owner, texts in numbers.items()}


def _say(console: Console, title: str, words: str) -> None:
    """Words with a title, folded beside it."""
    line, indent = f"  {title:<12} {words}", " " * 15
    folded = textwrap.wrap(line, screen.WIDTH, subsequent_indent=indent, break_long_words=False)
    console.print("\n".join(folded), markup=False, soft_wrap=True)
