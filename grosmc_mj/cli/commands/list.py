"""grosmc-mj list."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Target, command
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.ground.errors import GrosmcError, name_list
from grosmc_mj.ground.wording import counted, titled, unit_after

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from rich.console import Console

    from grosmc_mj.ground.arrays import Array
    from grosmc_mj.theory.control.controller import Controller
    from grosmc_mj.theory.plants import Plant
    from grosmc_mj.theory.plants.system import Signal

# An axis of the world within rounding of a joint's frame.
_ROUNDING = 1e-9


@command
class ListCommand(Command):
    """List the systems with their cases and controllers, and the case files of the package.

    Of one target the names, too, by which case files call its states, inputs, bodies and joints,
    with their units, the joints' axes, the weights and gains of its laws by name, and the nominal
    numbers of its plant. A case file needs no more than [plant] for that.

    Attributes:
        target: A system, a case (SYSTEM/CASE) or a case file (FILE.toml).
    """

    target: Annotated[Target, Parameter(show_default="everything")] = ""

    @property
    def simulates(self) -> bool:
        """False for the list of everything, whose names stand in files."""
        return bool(self.target)

    def execute(self) -> int:
        """Print all systems and case files by name, or one target in detail."""
        if self.target:
            _say_target(screen.console(), self.target)
        else:
            _say_everything(screen.console())
        return DONE


def _say_everything(console: Console) -> None:
    """Print systems, cases and laws by the names in the files: nothing is built for it."""
    from grosmc_mj.experiments.file.shipped import (
        base_file,
        campaign_files,
        case_order,
        content,
        shipped_files,
    )

    files = shipped_files()
    campaigns = campaign_files()
    folders: dict[str, list[str]] = {}
    for name in files:
        folder = name.split("/")[0]
        folders.setdefault(folder, []).append(name)

    # Folders with a base file are systems.
    bases: dict[str, Path] = {}
    other_files: list[str] = []
    for folder, names in folders.items():
        base = base_file(folder)
        if base is None:
            other_files.extend(names)
        else:
            bases[folder] = base

    console.print(f"{counted(len(bases), 'system')}, {counted(len(files), 'case file')}.")
    for system, base in bases.items():
        cases = [name.split("/")[1] for name in sorted(folders[system], key=case_order)]
        console.print(system, style="bold")
        _say(console, "cases", ", ".join(cases))
        _say(console, "laws", name_list(content(base)["laws"]))
        if system in campaigns:
            _say(console, "campaign", content(campaigns[system])["title"])

    console.print("Other case files", style="bold")
    console.print(f"  {', '.join(other_files)}")
    console.print("A target is SYSTEM, SYSTEM/CASE such as servo/case1, or FILE.toml.")


def _say_target(console: Console, target: str) -> None:
    """Print the cases, laws and plants of a target, and the names and numbers of its parts."""
    from grosmc_mj.experiments.assumptions.growth import growth
    from grosmc_mj.experiments.catalogue import find_plants
    from grosmc_mj.experiments.weights import gains_in_words, weights_in_words
    from grosmc_mj.output.results.tables import names, table, text

    found = find_plants(target)
    first, declared = found[0]
    plant = first.plant(first.nominal.truest)
    console.print(f"{target}: {first.nominal.system.title}", style="bold", markup=False)
    for case, _ in found:
        source = f"  ({case.source})" if case.source else ""
        _say(console, case.name, case.title + source)

    laws = dict.fromkeys([*first.file.laws, *declared])
    _say(console, "laws", name_list(laws))
    _say(console, "plants", name_list(first.plant_names))
    states = _with_units(plant.system.states)
    _say(console, "states", f"{states}  (start, of [[sensor]] and [[estimator]])")
    _say(console, "inputs", f"{_with_units(plant.system.inputs)}  (of [[actuator]])")
    if plant.kind == "physics":
        _say_model(console, plant, first.x0)
    else:
        _say(console, "parameters", f"{', '.join(vars(plant.parameters))}  (of [[edit]])")

    designed: list[Controller] = []
    for law in declared:
        try:
            designed.append(first.law(first.nominal.truest, law))
        except GrosmcError as error:
            _say(console, "not designed", str(error))
    for controller in designed:
        if controller.design is not None:
            design = controller.design
            numbers = filter(None, [weights_in_words(design), gains_in_words(design)])
            _say(console, "weights", f"{controller.name}: {'; '.join(numbers)}")

    for line in growth(first, designed):
        _say(console, "grows", line)

    columns = [*names("nominal"), *text("numbers that are not zero")]
    console.print(table("", columns, _nominal_numbers(first.nominal.plant).items()))


def _with_units(signals: Sequence[Signal]) -> str:
    """Return the names of signals with their units."""
    return ", ".join(titled(signal.name, signal.unit) for signal in signals)


def _say_model(console: Console, plant: Plant, x0: Sequence[float]) -> None:
    """Print the bodies and joints of a model, those of the system with their units and axes."""
    from grosmc_mj.mechanics.physics.files import body_names, joint_names
    from grosmc_mj.mechanics.physics.wrenches import joint_axes

    system = plant.system
    axes = joint_axes(plant, x0)
    texts = {}
    for name, position in zip(system.joints, system.positions, strict=True):
        way = "along" if position.unit == "m" else "about"
        texts[name] = f"{titled(name, position.unit)} {way} {_axis_in_words(axes[name])}"
    joints = [texts.get(name, name) for name in joint_names(plant.model)]

    bodies = name_list(body_names(plant.model))
    _say(console, "bodies", f"{bodies}  (body of [[edit]])")
    _say(console, "joints", f"{', '.join(joints)}  (joint of [[edit]])")
    pushed = name_list(system.bodies)
    axes_in_words = "of joints, as the first case starts, and of wrenches are those of the world"
    _say(console, "axes", f"{axes_in_words}; body of [[disturbance]]: {pushed}")


def _axis_in_words(axis: Array) -> str:
    """Return a unit vector as ``y`` or ``-y`` or, if it is oblique, by its components."""
    for name, part in zip("xyz", axis, strict=True):
        if abs(part) > 1 - _ROUNDING:
            return f"-{name}" if part < 0 else name
    # No component reads as -0.
    components = ", ".join(f"{part:.3g}" for part in axis.round(4) + 0.0)
    return f"({components})"


def _nominal_numbers(plant: Plant) -> dict[str, str]:
    """Return the numbers that are not zero, with their units, in a text for each owner."""
    texts: dict[str, list[str]] = {}
    for owner, name, values, unit in _numbers(plant):
        if any(values):
            written = ", ".join(f"{value:.5g}" for value in values)
            texts.setdefault(owner, []).append(f"{name} {written}{unit_after(unit)}")
    return {owner: "; ".join(numbers) for owner, numbers in texts.items()}


def _numbers(plant: Plant) -> Iterator[tuple[str, str, Sequence[float], str]]:
    """Yield owner, name, values and unit of the numbers of the equations and of the model."""
    if plant.kind != "physics" or plant.system.read_parameters is not None:
        yield from _parameters(plant)
    if plant.kind == "physics":
        yield from _numbers_of_model(plant)


def _parameters(plant: Plant) -> Iterator[tuple[str, str, Sequence[float], str]]:
    """Yield the parameters of the equations that are numbers with a unit."""
    from grosmc_mj.ground.fields import range_of

    parameters = plant.analytic().parameters
    for name, value in vars(parameters).items():
        bounds = range_of(type(parameters), name)
        if bounds is None:
            yield "equations", name, [value], ""
        elif isinstance(bounds.unit, str) and bounds.unit:
            yield "equations", name, [value], bounds.unit


def _numbers_of_model(plant: Plant) -> Iterator[tuple[str, str, Sequence[float], str]]:
    """Yield the numbers of the bodies and joints of a model."""
    model = plant.model
    yield "world", "gravity", model.opt.gravity, "m/s^2"
    for index in range(1, model.nbody):
        body = model.body(index)
        yield body.name, "mass", body.mass, "kg"
        yield body.name, "principal inertia", body.inertia, "kg m^2"
        yield body.name, "centre of mass", body.ipos, "m"

    for index in range(model.njnt):
        joint = model.joint(index)
        units = plant.system.joint_units(joint.name)
        yield joint.name, "damping", joint.damping, units["damping"]
        yield joint.name, "friction", joint.frictionloss, units["friction"]
        yield joint.name, "armature", joint.armature, units["armature"]


def _say(console: Console, title: str, words: str) -> None:
    """Print words with a title, folded beside it."""
    lines = textwrap.wrap(
        f"  {title:<12} {words}",
        screen.WIDTH,
        subsequent_indent=" " * 15,
        break_long_words=False,
    )
    console.print("\n".join(lines), markup=False, soft_wrap=True)
