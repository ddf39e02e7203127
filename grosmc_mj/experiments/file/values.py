"""Tables of a case file as values: starts, edits, disturbances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.file.parts import in_model
from grosmc_mj.experiments.file.schema import CaseFile, DisturbanceTable, EditTable
from grosmc_mj.experiments.file.user_code import is_named, load_named
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, Mistakes, placed
from grosmc_mj.ground.units import number_in, numbers_of, si_number
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit
from grosmc_mj.simulation.disturbances import (
    AnyDisturbance,
    Constant,
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    RateDisturbance,
    SineFrom,
    Table,
)
from grosmc_mj.theory.plants import System


def state_of(
    values: Mapping[str, Any],
    system: System,
    where: str,
    rest: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """Return a state from values of some states by name.

    Args:
        values: Values with their units.
        system: System with the states.
        where: Beginning of messages.
        rest: Values of the other states, (n,); zero by default.

    Raises:
        ArgumentError: If a state is unknown, or a unit does not fit.
    """
    x = [0.0] * len(system.states)
    if rest is not None:
        x = [float(number) for number in rest]
    for index, value in states_of(values, system, where).items():
        x[index] = value
    return tuple(x)


def states_of(values: Mapping[str, Any], system: System, where: str) -> dict[int, float]:
    """Return values of states by index from values by name; raises as ``state_of``."""
    names = [state.name for state in system.states]
    by_index = {}
    mistakes = Mistakes()
    for name, value in values.items():
        place = f"{where}: {name}: " if name in names else f"{where}: "
        with mistakes.gathered(place):
            require_known("state", name, names)
            index = names.index(name)
            by_index[index] = number_in(value, system.states[index].unit)
    mistakes.refuse()
    return by_index


def edits_of(file: CaseFile, system: System, *, known: bool) -> tuple[Edit, ...]:
    """Return the edits of the model in a case file.

    Args:
        file: The file.
        system: The system of its plant.
        known: True for the edits that the laws know, False for the other ones.

    Raises:
        GrosmcError: If a model cannot have a number, or an input is unknown.
    """
    tables = [table for table in file.edit if table.parameter is None and table.known is known]
    return tuple(_edit(table, system) for table in tables)


def _edit(table: EditTable, system: System) -> Edit:
    """Return one edit of the model."""
    if table.joint is not None:
        numbers = _joint_numbers(table, table.joint, system)
        return JointEdit(table.joint, **numbers)
    if table.input is not None:
        actuator = in_model(table.input, "input", system)
        return InputEdit(actuator, _gear(table, table.input, system))
    assert table.body is not None
    if table.added_mass is not None:
        x, y, z = table.at
        return AddedMass(table.body, table.added_mass, (x, y, z))
    inertia: Any = table.inertia and tuple(table.inertia)
    return BodyEdit(table.body, table.mass_scale, table.length_scale, table.mass, inertia)


def _joint_numbers(table: EditTable, joint: str, system: System) -> dict[str, float]:
    """Return damping, friction and armature of an edit, as far as it has them."""
    numbers = {}
    mistakes = Mistakes()
    for name, unit in system.joint_units(joint).items():
        value = getattr(table, name)
        if value is not None:
            with mistakes.gathered(f"edit of {joint!r}: {name}: "):
                numbers[name] = si_number(value, unit)
    mistakes.refuse()
    return numbers


def _gear(table: EditTable, name: str, system: System) -> float:
    """Return the gear of an edit, in the joint's force or torque for one unit of the input."""
    (input_unit,) = [signal.unit for signal in system.inputs if signal.name == name]
    # A system does not say which joint an input drives: where it has slides and hinges, either.
    forces = {"N" if position.unit == "m" else "N m": None for position in system.positions}
    units = [_per(force, input_unit) for force in forces]
    if input_unit in forces:
        units = ["1"]
    with placed(f"edit of {name!r}: gear: "):
        for unit in units[1:]:
            try:
                return si_number(table.gear, unit)
            except ArgumentError:
                continue
        return si_number(table.gear, units[0])


def _per(unit: str, of: str) -> str:
    """Write a unit for one of another unit."""
    if of in {"", "1"}:
        return unit
    return f"{unit}/({of})" if " " in of or "/" in of else f"{unit}/{of}"


# Shipped profiles, whose fields are keys of the table.
_PROFILES: Mapping[str, Any] = {
    "constant": Constant,
    "pulse": Pulse,
    "sine": SineFrom,
    "table": Table,
}


def disturbances_of(file: CaseFile, system: System, folder: Path) -> tuple[AnyDisturbance, ...]:
    """Return the disturbances in a case file.

    Args:
        file: The file.
        system: The system of its plant.
        folder: Folder of a user's own profiles.

    Raises:
        ArgumentError: For all that do not fit.
    """
    mistakes = Mistakes()
    disturbances = mistakes.each(
        "disturbance",
        file.disturbance,
        lambda table: _disturbance(table, system, folder),
    )
    mistakes.refuse()
    return tuple(disturbances)


def _disturbance(table: DisturbanceTable, system: System, folder: Path) -> AnyDisturbance:
    """Return one disturbance with its profile."""
    if table.body is not None:
        return _on_body(table, system, folder)

    # Of each kind: the signals that it may act on, with the unit of its amplitude.
    kinds: dict[str, tuple[Any, dict[str, str]]] = {
        "input": (InputDisturbance, {signal.name: signal.unit for signal in system.inputs}),
        "measured": (OutputDisturbance, {state.name: state.unit for state in system.states}),
        "state": (RateDisturbance, {state.name: state.rate_unit for state in system.states}),
    }
    key = next(key for key in kinds if getattr(table, key) is not None)
    kind, units = kinds[key]
    if key == "state" and system.joints:
        raise ArgumentError(f"{system.name} has a model in MuJoCo: name a body or an input")
    name = getattr(table, key)
    require_known("input" if key == "input" else "state", name, units)

    if table.amplitude is None:
        raise ArgumentError("it has no amplitude")
    numbers = numbers_of(table, ["amplitude"], lambda _: units[name])
    return kind(name, **numbers, profile=_profile(table, folder), label=table.label)


def _on_body(table: DisturbanceTable, system: System, folder: Path) -> Disturbance:
    """Return a disturbance on a body."""
    if not system.bodies:
        raise ArgumentError(f"{system.name} has no bodies: name an input or a state")
    # Zero is a number too: a disturbance without effect still ends the transient.
    if not table.model_fields_set & {"force", "torque"}:
        raise ArgumentError("it has neither force nor torque")
    wrench: Any = (*table.force, *table.torque)
    assert table.body is not None
    return Disturbance(table.body, wrench, _profile(table, folder), table.label)


def _profile(table: DisturbanceTable, folder: Path) -> Any:
    """Return the profile of a disturbance over time."""
    if is_named(table.profile):
        return load_named(table.profile, folder)

    require_known("profile", table.profile, (*_PROFILES, "module:name"))
    keys = {name: [item.name for item in fields(kind)] for name, kind in _PROFILES.items()}
    valid = keys[table.profile]
    foreign = set[str]().union(*keys.values()).difference(valid)
    misplaced = sorted(table.model_fields_set & foreign)
    if misplaced:
        raise ArgumentError(f"a {table.profile} has no {', '.join(misplaced)}")

    nothing = (None, [])
    needed = [key for key in valid if DisturbanceTable.model_fields[key].default in nothing]
    numbers = {key: getattr(table, key) for key in valid}
    if any(numbers[key] in nothing for key in needed):
        raise ArgumentError(f"a {table.profile} needs {' and '.join(needed)}")
    return _PROFILES[table.profile](**numbers)
