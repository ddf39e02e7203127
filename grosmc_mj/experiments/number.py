"""Numbers of an experiment by path: read, set on the values, written into the case file.

A path is resolved once, and then names the same number of every experiment on that file:

    mass = Number.of(experiment, "edit.pole.mass")
    heavier = mass.set(experiment, 1.2 * mass.get(experiment))
    mass.write(content, 0.3)

A number is a field of the part that its table is read as: the field's type has its unit and bounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, NamedTuple, TypeVar

from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.part_tables import in_model
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS
from grosmc_mj.experiments.file.paths import Place, edited_by, place_of
from grosmc_mj.experiments.law_numbers import OF_FILE, first_value, number_of_table
from grosmc_mj.experiments.steps import Change, Entry, Member, Onset, Steps, value_at, with_values
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, placed, unknown_name, value_text
from grosmc_mj.ground.fields import Range, range_of
from grosmc_mj.ground.units import in_units, number_in
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit
from grosmc_mj.mechanics.physics.files import body_names, joint_names
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import AnyDisturbance, Pulse
from grosmc_mj.simulation.loop.timing import TIMES, time_as_run
from grosmc_mj.theory.plants.parameter_scale import ParameterScale

# An Experiment, whose module imports this one.
Case = TypeVar("Case")
# Text of a value in a unit, as a case file has it.
Written = Callable[[float, str], float | str]

# Keys of [run] that are one value; a timestep may be the control period's, too.
_RUN: Mapping[str, Steps] = {
    "duration": ("duration",),
    "control_period": ("settings", "control_period"),
}
_EDITS: Mapping[str, Any] = {"body": BodyEdit, "joint": JointEdit, "input": InputEdit}
# Numbers that no edit has: they are these, or those of the compiled model.
_WITHOUT_EDIT = {"mass_scale": 1.0, "length_scale": 1.0, "scale": 1.0}
_OF_JOINTS = {
    "damping": "dof_damping",
    "friction": "dof_frictionloss",
    "armature": "dof_armature",
}


@dataclass(frozen=True)
class Number:
    """One number of an experiment.

    Attributes:
        path: Its path, see ``file.paths``.
        unit: Its unit; empty for a factor.
        bounds: The values that it can have.
        steps: Steps to it from the experiment.
        place: Its place in the case file.
        inherited: Steps to the numbers that count where its table does not give it.
        default: Value where no table gives one; None if it must be given.
    """

    path: str
    unit: str
    bounds: Range
    steps: Steps
    place: Place
    inherited: tuple[Steps, ...] = ()
    default: float | None = None

    @classmethod
    def of(cls, case: Any, path: str) -> Number:
        """Return the number of a path.

        Raises:
            ArgumentError: If the case has no such number.
        """
        place = place_of(case.file.content, path)
        number = find_number(case, path, place)
        if number is not None:
            return number

        line = f"{path!r}: {place.field} is no number of [{place.owner}]"
        part = _part(case, place)
        if part is not None:
            names = [item.name for item in fields(part.kind) if _bounds(part.kind, item.name)]
            line = f"{path!r}: {unknown_name('number', place.field, names)}"
        elif place.owner in LOOP_PARTS:
            line = f"{path!r}: the case file has no {place.owner}: write one"
        raise ArgumentError(line)

    @classmethod
    def of_mass(cls, case: Any, body: str, at: tuple[float, ...]) -> Number:
        """Return the number of a mass that is added to a body at a place, by the file or not yet.

        Args:
            case: The case.
            body: The body.
            at: Place of the mass in the body's frame [m], (3,).
        """
        _require_owner(case, "body", body)
        path = f"edit.{body}.added_mass"
        loads = [edit for edit in case.edits if isinstance(edit, AddedMass) and edit.of == body]
        for index, load in enumerate(loads):
            if load.position == at:
                return cls.of(case, f"edit.{body}[{index + 1}].added_mass")

        member = Member(AddedMass, body, len(loads), (("position", at),))
        table = {"body": body, "at": [written(length, "m") for length in at]}
        place = Place("edit", ("added_mass",), body, new=table)
        return cls(path, "kg", Range(0, unit="kg"), ("edits", member, "mass"), place)

    def get(self, case: Any) -> float:
        """Return the number in a case, infinite for no limit.

        Raises:
            ArgumentError: If no table gives it, and it has no default.
        """
        value = value_at(case, self.steps)
        if value is None and self.inherited:
            value = first_value(case, self.inherited)
        if value is None:
            value = self.default
        if value is None:
            value = _without_part(case, self)
        if isinstance(value, str):
            return number_in(value, self.unit)
        return float(value)

    def set(self, case: Case, value: float) -> Case:
        """Return a case with another value.

        Raises:
            GrosmcError: If it is out of its bounds.
        """
        return set_numbers(case, [(self, value)])

    def write(self, content: Content, value: float, text: Written | None = None) -> None:
        """Write a value into the content of a case file, which may get a table for it.

        Args:
            content: Values of the file, which are changed.
            value: The value.
            text: Returns a value with its unit as the file has it; with all digits by default.
        """
        text = text or written
        if self.of_file:
            value_in_file = text(value, self.unit)
            content.update(with_values(content, self._changes_inside(content, 1, value_in_file)))
            return
        if isinstance(self.steps[-1], Onset):
            table = self.place.table(content)
            length = number_in(table["stop"], "s") - number_in(table.get("start", "0 s"), "s")
            table["start"] = text(value, "s")
            table["stop"] = text(value + length, "s")
            return
        self.place.write(content, text(value, self.unit))

    def read(self, value: Any) -> float:
        """Return a value of Python, a number in the unit or a text with a unit, as a number.

        Raises:
            ArgumentError: If it is no number, or its unit does not fit.
        """
        with placed(f"{self.path}: "):
            return number_in(in_units(value), self.unit)

    def changes(self, case: Any, value: float) -> list[Change]:
        """Return the changes of a case that give it another value.

        Raises:
            ArgumentError: If the value is out of its bounds.
        """
        if not self.bounds.holds(value):
            raise ArgumentError(f"{self.path} = {value_text(value)} must be {self.bounds.wanted}")
        if not self.of_file:
            return [(self.steps, float(value))]
        is_text = isinstance(first_value(case, [self.steps, *self.inherited]), str)
        return self._changes_inside(case, 0, written(value, self.unit) if is_text else float(value))

    def _changes_inside(self, whole: Any, first: int, value: Any) -> list[Change]:
        """Return the changes of an object for a value as it is written.

        A weight that a table inherits becomes its own, whose other entries stay.

        Args:
            whole: An experiment, or the content of its file.
            first: Number of the first step inside it.
            value: The value.
        """
        change = (self.steps[first:], value)
        *table, last = self.steps[first:]
        if not isinstance(last, Entry) or value_at(whole, table) is not None:
            return [change]
        weight = first_value(whole, [steps[first:-1] for steps in self.inherited])
        return [(tuple(table), weight), change]

    def as_run(self, value: float, timestep: float, control_period: float) -> float:
        """Return the value that a run has: times of a loop are whole timesteps [s]."""
        if self.of_loop and self.place.field in TIMES:
            return time_as_run(self.place.field, value, timestep, control_period)
        return value

    def is_of(self, owner: str, name: str, field: str) -> bool:
        """Whether it is the field of a table with a name."""
        place = self.place
        return (place.owner, place.name, place.field) == (owner, name, field)

    @property
    def of_plant(self) -> bool:
        """Whether it changes the plant."""
        return self.steps[0] in ("edits", "nominal")

    @property
    def of_loop(self) -> bool:
        """Whether it changes a sensor, an estimator, an actuator or the computer."""
        return self.steps[0] == "loop"

    @property
    def of_file(self) -> bool:
        """Whether it is of a law, a task or a requirement, made from the file's tables."""
        return self.steps[0] == "file"


def set_numbers(case: Case, values: Iterable[tuple[Number, float]]) -> Case:
    """Return a case with other values of some numbers, all at once.

    Args:
        case: The case.
        values: Numbers and their values.

    Raises:
        GrosmcError: If a value is out of its bounds.
    """
    experiment: Any = case
    changes: list[Change] = []
    for number, value in values:
        *inherited, change = number.changes(experiment, value)
        # A weight becomes the table's own once: each of its entries stays.
        made = [steps for steps, _ in changes]
        changes += [other for other in inherited if other[0] not in made]
        changes.append(change)
    return experiment._copy(changes)


def written(value: float, unit: str) -> float | str:
    """Return a number as a case file has it, with all its digits."""
    return value if unit in {"", "1", "%"} else f"{value!r} {unit}"


# -- resolution of paths ---------------------------------------------------------------------------


class _Part(NamedTuple):
    """The part that a table is read as.

    Attributes:
        steps: Steps to it.
        kind: Its class.
        of: Name of its owner, on which units may depend.
    """

    steps: Steps
    kind: Any
    of: str


def find_number(case: Any, path: str, place: Place) -> Number | None:
    """Return the number at a place of the case file; None if it is no number of the values."""
    if place.owner in OF_FILE:
        found = number_of_table(case, path, place)
        return None if found is None else Number(path, place=place, **found._asdict())
    if place.owner == "run":
        return _of_run(case, path, place)
    part = _part(case, place)
    if part is None:
        return None

    field = place.field
    if part.kind is AddedMass and field == "added_mass":
        field = "mass"
    bounds = _bounds(part.kind, field)
    if bounds is None:
        return None
    unit = bounds.unit_in(case.nominal.system, part.of)
    last = Onset() if (part.kind, field) == (Pulse, "onset") else field
    return Number(path, unit, replace(bounds, unit=unit), (*part.steps, last), place)


def _bounds(kind: Any, field: str) -> Range | None:
    """Return the bounds of a number of a part; None of what is no number, or a whole one."""
    if kind is Pulse and field == "onset":
        return range_of(Pulse, "start")
    if field not in [item.name for item in fields(kind)]:
        return None
    bounds = range_of(kind, field)
    if bounds is None or bounds.whole:
        return None
    return bounds


def _of_run(case: Any, path: str, place: Place) -> Number | None:
    """Return the duration of a run, or a start; None for a setting."""
    steps = _RUN.get(place.field)
    if steps is not None:
        return Number(path, "s", Range(0, unit="s", above=True), steps, place)
    if place.keys[0] != "start" or len(place.keys) != 2:
        return None

    states = case.nominal.system.states
    names = [state.name for state in states]
    with placed(f"{path!r}: "):
        require_known("state", place.field, names)
    index = names.index(place.field)
    unit = states[index].unit
    return Number(path, unit, Range(unit=unit), ("x0", index), place)


def _part(case: Any, place: Place) -> _Part | None:
    """Return the part that a table is read as; None if there is none."""
    owner = place.owner
    name = place.name
    system = case.nominal.system
    steps: Steps
    if owner == "edit":
        return _edit(case, place)
    if owner == "disturbance":
        steps = ("disturbances", Member(AnyDisturbance, name, place.nth))
        if not hasattr(value_at(case, steps), place.field):
            steps = (*steps, "profile")
    elif owner == "computing":
        steps = ("loop", owner)
    elif owner in LOOP_PARTS:
        steps = ("loop", f"{owner}s", Member(LOOP_PARTS[owner], name, place.nth))
    elif owner in MACHINE_PARTS:
        kind = MACHINE_PARTS[owner]
        # A model has the name of the actuator, a file that of the input.
        in_machine = in_model(name, kind.owner, system)
        steps = ("edits", Member(kind, in_machine, place.nth))
    else:
        return None

    part: Any = value_at(case, steps)
    if not is_dataclass(part):
        return None
    # A disturbance may have the name of its label, on which no unit depends.
    of = part.of if isinstance(part, AnyDisturbance) else name
    return _Part(steps, type(part), of)


def _edit(case: Any, place: Place) -> _Part | None:
    """Return an edit, which may be made; None for one that laws know."""
    if place.row is not None and case.file.content["edit"][place.row].get("known"):
        return None

    owner = edited_by(place.field, place.field)
    name = place.name
    _require_owner(case, owner, name)
    if owner == "parameter":
        return _Part(
            ("nominal", "scales", Member(ParameterScale, name, place.nth, ())), ParameterScale, name
        )

    kind = _EDITS[owner]
    if place.field in ("added_mass", "at"):
        kind = AddedMass
    in_machine = in_model(name, owner, case.nominal.system)
    return _Part(("edits", Member(kind, in_machine, place.nth, ())), kind, name)


def _require_owner(case: Any, owner: str, name: str) -> None:
    """Refuse a body or joint of equations, a parameter of a model, and an unknown one."""
    plant = case.nominal.plant
    if owner == "parameter":
        if isinstance(plant, MujocoPlant):
            raise ArgumentError("the plant has a model in MuJoCo: name a body or joint instead")
        require_known(owner, name, vars(plant.parameters))
        return

    if not isinstance(plant, MujocoPlant):
        raise ArgumentError(f"the plant has no model in MuJoCo, so no {owner}: name a parameter")
    robot = case.nominal.robot
    model = plant.model if robot is None else robot.built.model
    if owner == "body":
        require_known(owner, name, body_names(model))
    if owner == "joint":
        require_known(owner, name, joint_names(model))


def _without_part(case: Any, number: Number) -> float:
    """Return a number that no part of the case gives: of the compiled model, or without a limit.

    Raises:
        ArgumentError: If it is a number of the file's tables.
    """
    if number.of_file:
        raise ArgumentError(f"the case file does not give {number.path}")
    *_, member, field = number.steps
    if not isinstance(member, Member) or number.of_loop or issubclass(member.kind, MachinePart):
        return math.inf
    if field in _WITHOUT_EDIT:
        return _WITHOUT_EDIT[str(field)]
    if member.kind is AddedMass:
        return 0.0

    model = case.plant(case.nominal.truest).model
    if field == "mass":
        return float(model.body(member.name).mass[0])
    if field == "gear":
        return float(model.actuator(member.name).gear[0])
    joint = model.joint(member.name)
    return float(getattr(model, _OF_JOINTS[str(field)])[joint.dofadr[0]])
