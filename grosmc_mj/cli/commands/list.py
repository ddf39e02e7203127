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
    from grosmc_mj.plants import Plant, Signal


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
        return bool(self.target) or self.verbose

    def execute(self) -> int:
        """Systems, cases, laws; with their titles, plants and names, if asked for."""
        if not self.target:
            _say_everything(screen.console())
        if self.target or self.verbose:
            _say_more(screen.wide_console(), self.target)
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
        _say(console, "", name, bold=True)
        _say(console, "cases", ", ".join(case.split("/")[1] for case in cases))
        _say(console, "laws", ", ".join(content(base)["laws"]))
        if name in campaigns:
            _say(console, "campaign", content(campaigns[name])["title"])
    others = [name for folder in folders if folder not in bases for name in folders[folder]]
    _say(console, "", "Other case files", bold=True)
    console.print(f"  {', '.join(others)}")
    console.print("A target is SYSTEM, SYSTEM/CASE such as servo/case1, or FILE.toml.")


def _say_more(console: Console, target: str) -> None:
    """Titles, plants and the names of their parts, of a target or of all systems."""
    from grosmc_mj.experiments.catalogue import find_experiments
    from grosmc_mj.experiments.file.shipped import content, shipped_files
    from grosmc_mj.plants import SYSTEMS
    from grosmc_mj.results.tables import names, table, text

    for name in [target] if target else SYSTEMS:
        experiments = find_experiments(name)
        first = experiments[0]
        _say(console, "", f"{name}: {first.nominal.system.title}", bold=True)
        for case in (one.case for one in experiments):
            source = f"  ({case.source})" if case.source else ""
            _say(console, case.name, f"{case.title}{source}")
        _say(console, "laws", ", ".join(dict.fromkeys([*first.file.laws, *first.controllers])))
        _say(console, "plants", ", ".join(first.plant_names))
        _say_names(console, first)
        found = _nominal_numbers(first.nominal.plant)
        columns = [*names("nominal"), *text("numbers that are not zero")]
        console.print(table("", columns, found.items()))
    if not target:
        _say(console, "", "Case files of the package", bold=True)
        for name, path in shipped_files().items():
            _say(console, f"{name:<26}", content(path)["title"])


def _say_names(console: Console, experiment: Experiment) -> None:
    """What case files call the parts of a plant, with the tables that ask for them."""
    from grosmc_mj.physics.files import body_names, joint_names

    plant = experiment.plant(experiment.nominal.truest)
    system = plant.system
    states, inputs = _signals(system.states), _signals(system.inputs)
    _say(console, "states", f"{states}  (start, of [[sensor]] and [[estimator]])")
    _say(console, "inputs", f"{inputs}  (of [[actuator]])")
    if plant.kind != "physics":
        names = ", ".join(vars(plant.parameters))
        _say(console, "parameters", f"{names}  (parameter of [[edit]])")
        return
    units = dict(zip(system.joints, system.positions, strict=True))
    joints = [
        f"{name} [{units[name].unit}]" if name in units else name
        for name in joint_names(plant.model)
    ]
    _say(console, "bodies", f"{', '.join(body_names(plant.model))}  (body of [[edit]])")
    _say(console, "joints", f"{', '.join(joints)}  (joint of [[edit]])")


def _nominal_numbers(plant: Plant) -> dict[str, str]:
    """The numbers of the equations and of the model in MuJoCo with their units, by their owner."""
    from mujoco import mjtJoint

    from grosmc_mj.fields import range_of

    system, physics = plant.system, plant.kind == "physics"
    rows: list[tuple[str, str, Sequence[float], str]] = []
    if not physics or system.read_parameters is not None:
        numbers = plant.analytic().parameters
        for name, value in vars(numbers).items():
            bounds = range_of(type(numbers), name)
            if bounds is None or bounds.unit:
                rows.append(("equations", name, [value], bounds.unit if bounds else ""))
    if physics:
        model = plant.model
        rows.append(("world", "gravity", model.opt.gravity, "m/s^2"))
        for body in map(model.body, range(1, model.nbody)):
            rows.append((body.name, "mass", body.mass, "kg"))
            rows.append((body.name, "principal inertia", body.inertia, "kg m^2"))
            rows.append((body.name, "centre of mass", body.ipos, "m"))
        for joint in map(model.joint, range(model.njnt)):
            slides = joint.type[0] == mjtJoint.mjJNT_SLIDE
            rows.append((joint.name, "damping", joint.damping, "N s/m" if slides else "N m s/rad"))
            rows.append((joint.name, "friction", joint.frictionloss, "N" if slides else "N m"))
            rows.append((joint.name, "armature", joint.armature, "kg" if slides else "kg m^2"))
    words: dict[str, list[str]] = {}
    for owner, name, values, unit in rows:
        if any(values):
            number = ", ".join(f"{value:.5g}" for value in values)
            words.setdefault(owner, []).append(f"{name} {number} {unit}".rstrip())
    return {owner: "; ".join(texts) for owner, texts in words.items()}


def _say(console: Console, title: str, words: str, *, bold: bool = False) -> None:
    """A line with a title, or a heading."""
    line = words if bold else f"  {title:<12} {words}"
    console.print(line, style="bold" if bold else None, markup=False)


def _signals(signals: Sequence[Signal]) -> str:
    """Names with units."""
    return ", ".join(f"{signal.name} [{signal.unit}]" for signal in signals)
