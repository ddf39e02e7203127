"""Tables of a case file for the parts of the loop and of the machine as built, one for each kind.

The keys of a table are the fields of the part's class, with their units. ``assumed`` lists
the numbers that nobody has published: whatever shows results says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from functools import partial
from typing import Annotated, Any, Literal, get_type_hints

import pydantic

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError, Mistakes
from grosmc_mj.ground.fields import range_of
from grosmc_mj.ground.units import Metres, Table, Three, numbers_of
from grosmc_mj.mechanics.machine import PARTS, MachinePart
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.simulation.loop.loop import LARGEST_SEED
from grosmc_mj.theory.plants import System


def table_of(part: Edit | type[Edit]) -> str:
    """Return the name of a part's table."""
    return part.kind.replace(" ", "_")


def _numbers(part: Any) -> tuple[str, ...]:
    """Return the names of a part's numbers with a unit; whole numbers have none."""
    ranges = {item.name: range_of(part, item.name) for item in fields(part)}
    return tuple(name for name, bounds in ranges.items() if bounds and not bounds.whole)


LOOP_PARTS: Mapping[str, Any] = {
    "computing": Computing,
    "sensor": Sensor,
    "estimator": Estimator,
    "actuator": Actuator,
}
MACHINE_PARTS: Mapping[str, type[MachinePart]] = {table_of(part): part for part in PARTS}
# Names of the numbers with a unit by kind of part.
LOOP_NUMBERS = {kind: _numbers(part) for kind, part in LOOP_PARTS.items()}
MACHINE_NUMBERS = {kind: _numbers(part) for kind, part in MACHINE_PARTS.items()}
_PARTS = {**LOOP_PARTS, **MACHINE_PARTS}
_NUMBERS = {**LOOP_NUMBERS, **MACHINE_NUMBERS}


def _table(kind: str, part: Any) -> type[Table]:
    """Make the table of a kind of part."""
    hints = get_type_hints(part)
    keys: dict[str, Any] = {
        item.name: _key(kind, part, item, hints[item.name]) for item in fields(part)
    }
    keys["assumed"] = (list[Literal[*_NUMBERS[kind]]], [])
    if part is Sensor:
        # Steps of an encoder in a turn, in place of its resolution.
        keys["counts"] = (Annotated[int | None, pydantic.Field(gt=0)], None)
    if part is Computing:
        # Seed of noise, jitter and missed samples; each run of a seed has its own.
        keys["seed"] = (int, 0)
        keys["run"] = (Annotated[int | None, pydantic.Field(ge=0, lt=LARGEST_SEED)], None)
    return pydantic.create_model(f"{part.__name__}Table", __base__=Table, **keys)


def _key(
    kind: str,
    part: Any,
    item: Field[Any],
    hint: Any,
) -> tuple[Any, Any]:
    """Return type and default of a key; ``...`` as default of a required one."""
    default = item.default
    if default is MISSING:
        default = ...
    if item.name in _NUMBERS[kind]:
        # Read later: the unit may depend on the system.
        return Any, (... if default is ... else None)
    if isinstance(default, tuple):
        numbers: Any = list[Metres]
        if item.name == "normal":
            numbers = list[float]
        return Annotated[numbers, Three], list(default)
    # The part itself checks the names of laws and the number of states.
    if item.name == "law":
        return str, default
    if item.name == "of" and part is Estimator:
        return str | list[str], default
    if item.name == "of":
        return str, default
    return hint, default


TABLES: Mapping[str, type[Table]] = {kind: _table(kind, part) for kind, part in _PARTS.items()}


def unit_of(
    kind: str,
    of: str,
    quantity: str,
    system: System,
) -> str:
    """Return the unit of a number of a part.

    Args:
        kind: Name of the part's table.
        of: State, input, joint or body that the part belongs to.
        quantity: Name of the number.
        system: The system of the file.

    Raises:
        ArgumentError: If the system has no such state, input or joint.
    """
    bounds = range_of(_PARTS[kind], quantity)
    return bounds.unit_in(system, of) if bounds else ""


def loop_of_file(file: Any, system: System) -> Loop | None:
    """Return the loop of a case file, or None if it has no part of one.

    Args:
        file: A ``CaseFile``.
        system: The system of the file.

    Raises:
        ArgumentError: For all numbers that do not fit.
    """
    if not any(getattr(file, kind) for kind in LOOP_PARTS):
        return None
    mistakes = Mistakes()
    computer = Computing()
    seed = 0
    if file.computing is not None:
        seed = file.computing.seed
        with mistakes.gathered("computing: "):
            computer = _part("computing", file.computing, system)

    members = []
    for kind in ("sensor", "estimator", "actuator"):
        make = partial(_part, kind, system=system)
        members.append(tuple(mistakes.each(kind, getattr(file, kind), make)))
    loop = mistakes.attempt(partial(Loop, seed=seed), computer, *members, where="computing: ")
    mistakes.refuse()
    return loop.completed(system)


def known_loop_of_file(file: Any, system: System) -> Loop | None:
    """Return the loop that predicting laws take for theirs, None for the loop itself.

    Args:
        file: A ``CaseFile``.
        system: System of the plant.

    Raises:
        ArgumentError: With all numbers that do not fit.
    """
    if file.known_loop is None:
        return None
    return loop_of_file(file.known_loop, system) or Loop()


def run_of_file(file: Any) -> int:
    """Return the number of the run that the loop of a case file draws for; 0 if it names none."""
    if file.computing is None:
        return 0
    return file.computing.run or 0


def machine_of_file(file: Any, system: System) -> tuple[MachinePart, ...]:
    """Return the parts of a case file's machine.

    Args:
        file: A ``CaseFile``.
        system: The system of the file.

    Raises:
        GrosmcError: For all numbers that do not fit.
    """
    parts: list[MachinePart] = []
    mistakes = Mistakes()
    for kind in MACHINE_PARTS:
        parts += mistakes.each(kind, getattr(file, kind), partial(_part, kind, system=system))
    mistakes.refuse()
    return tuple(parts)


def in_model(name: str, owner: str, system: System) -> str:
    """Return the name of an actuator for an input; joints and bodies keep their names.

    Args:
        name: Name in a case file.
        owner: ``input``, ``joint`` or ``body``.
        system: The system of the file.

    Raises:
        ArgumentError: If the system has no such input.
    """
    if owner != "input":
        return name
    inputs = [signal.name for signal in system.inputs]
    require_known("input", name, inputs)
    return system.actuators[inputs.index(name)]


def _part(kind: str, table: Any, system: System) -> Any:
    """Return the part of a table, its numbers in the units of the system."""
    part = _PARTS[kind]
    keywords = {}
    for name in table.model_fields_set & {item.name for item in fields(part)}:
        value = getattr(table, name)
        keywords[name] = tuple(value) if isinstance(value, list) else value

    of = getattr(table, "of", "")
    if kind in MACHINE_PARTS:
        of = keywords[part.owner] = in_model(keywords[part.owner], part.owner, system)
    elif not isinstance(of, str):
        # An estimator of several states has the units of the first.
        of = next(iter(of), "")

    for name in table.assumed:
        if name not in table.model_fields_set:
            raise ArgumentError(f"assumed: the table gives no {name}")
    keywords.update(numbers_of(table, _NUMBERS[kind], lambda name: unit_of(kind, of, name, system)))
    if getattr(table, "counts", None) is not None:
        keywords["resolution"] = _step(table, system)
    return part(**keywords)


def _step(table: Any, system: System) -> float:
    """Return the resolution of an encoder by its counts in a turn [rad]."""
    if table.resolution is not None:
        raise ArgumentError("counts and resolution are the same number: give one of them")
    unit = unit_of("sensor", table.of, "resolution", system)
    if unit != "rad":
        raise ArgumentError(f"counts: {table.of} is no angle: give its resolution in {unit}")
    return 2 * math.pi / table.counts
