"""What a case file may say of the loop and the machine as built: a table for each kind of part.

The keys of a table are the fields of the value of that name, with their units. ``assumed`` lists
those of its numbers that nobody has published: whatever shows results says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, get_type_hints

from pydantic import Field, create_model

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError, Mistakes
from grosmc_mj.experiments.file.units import Metres, Table, Three, numbers_of
from grosmc_mj.fields import range_of
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.loop.loop import LARGEST_SEED
from grosmc_mj.loop.rows import numbers_of as names_of_numbers
from grosmc_mj.machine import PARTS, MachinePart
from grosmc_mj.physics.edit import Edit
from grosmc_mj.plants import System


def table_of(part: Edit | type[Edit]) -> str:
    """What a part's table is called."""
    return part.kind.replace(" ", "_")


LOOP_PARTS: Mapping[str, Any] = {
    "computing": Computing, "sensor": Sensor, "estimator": Estimator, "actuator": Actuator,
}  # fmt: skip
MACHINE_PARTS: Mapping[str, type[MachinePart]] = {table_of(part): part for part in PARTS}
# The numbers of each kind of part with their units; {} stands for that of what it is of.
LOOP_UNITS: dict[str, dict[str, str]] = {
    kind: {
        name: bounds.unit
        for name in names_of_numbers(part)
        if (bounds := range_of(part, name)) and not bounds.whole
    }
    for kind, part in LOOP_PARTS.items()
}
# The same of a machine: of a joint's numbers that of a hinge, " or " that of a slide.
MACHINE_UNITS: dict[str, dict[str, str]] = {
    kind: {item.name: bounds.unit for item in fields(part) if (bounds := range_of(part, item.name))}
    for kind, part in MACHINE_PARTS.items()
}
_PARTS, _UNITS = {**LOOP_PARTS, **MACHINE_PARTS}, {**LOOP_UNITS, **MACHINE_UNITS}


def _table(kind: str, part: Any) -> type[Table]:
    """The table of a kind of part."""
    hints, keys = get_type_hints(part), {}
    for item in fields(part):
        name, default = item.name, ... if item.default is MISSING else item.default
        if name in _UNITS[kind]:
            keys[name] = (Any, default if default is ... else None)
        elif isinstance(default, tuple):
            numbers: Any = list[float] if name == "normal" else list[Metres]
            keys[name] = (Annotated[numbers, Three], list(default))
        else:
            # The part itself says which laws and how many states there may be.
            written = {"law": str, "of": str | list[str] if part is Estimator else str}
            keys[name] = (written.get(name, hints[name]), default)
    keys["assumed"] = (list[Literal[*_UNITS[kind]]], [])
    if part is Sensor:
        # Of an encoder: steps of its resolution in a turn.
        keys["counts"] = (Annotated[int | None, Field(gt=0)], None)
    if part is Computing:
        # Of noise, jitter and missed samples: each run of a seed has its own.
        keys["seed"] = (int, 0)
        keys["run"] = (Annotated[int | None, Field(ge=0, lt=LARGEST_SEED)], None)
    return create_model(f"{part.__name__}Table", __base__=Table, **keys)


TABLES: Mapping[str, type[Table]] = {kind: _table(kind, made) for kind, made in _PARTS.items()}


def unit_of(kind: str, of: str, quantity: str, system: System) -> str:
    """Unit of a number of a part.

    Args:
        kind: What its table is called.
        of: The state, input, joint or body that it is of.
        quantity: Which number.
        system: Whose.

    Raises:
        ArgumentError: If the system has no such state, input or joint.
    """
    unit = _UNITS[kind][quantity]
    if unit == "input":
        return system.input.unit
    if " or " in unit:
        require_known("joint", of, system.joints)
        slides = system.states[system.joints.index(of)].unit == "m"
        return unit.split(" or ")[slides]
    if "{" not in unit:
        return unit
    owner, signals = ("input", system.inputs) if kind == "actuator" else ("state", system.states)
    units = {signal.name: signal.unit for signal in signals}
    require_known(owner, of, units)
    return unit.format(units[of])


def loop_of_file(file: Any, system: System) -> Loop | None:
    """The loop of a case file, None for one without.

    Args:
        file: A ``CaseFile``.
        system: Whose loop it is.

    Raises:
        ArgumentError: All numbers that do not fit.
    """
    if not any(getattr(file, kind) for kind in LOOP_PARTS):
        return None
    mistakes, computer, seed, loop = Mistakes(), Computing(), 0, None
    parts: dict[str, list[Any]] = {"sensor": [], "estimator": [], "actuator": []}
    with mistakes.gathered("computing: "):
        if file.computing is not None:
            seed = file.computing.seed
            computer = Computing(**_numbers("computing", "", file.computing, system))
    for kind, members in parts.items():
        for index, table in enumerate(getattr(file, kind)):
            with mistakes.gathered(f"{kind} {index + 1}: "):
                first = table.of if isinstance(table.of, str) else (table.of or [""])[0]
                numbers = _numbers(kind, first, table, system)
                if getattr(table, "counts", None) is not None:
                    numbers["resolution"] = _step(table, system)
                members.append(LOOP_PARTS[kind](**_written(kind, table), **numbers))
    with mistakes.gathered("computing: "):
        loop = Loop(computer, *map(tuple, parts.values()), seed=seed)
    mistakes.refuse()
    return loop


def known_loop_of_file(file: Any, system: System) -> Loop | None:
    """Return the loop that predicting laws take for theirs, None for the loop itself.

    Args:
        file: A ``CaseFile``.
        system: Whose loop it is.

    Raises:
        ArgumentError: All numbers that do not fit.
    """
    if file.known_loop is None:
        return None
    return loop_of_file(file.known_loop, system) or Loop()


def run_of_file(file: Any) -> int:
    """Return the number of the run that the loop of a case file draws for; 0 if it names none."""
    if file.computing is None or file.computing.run is None:
        return 0
    return file.computing.run


def machine_of_file(file: Any, system: System) -> tuple[MachinePart, ...]:
    """The parts of a case file's machine.

    Args:
        file: A ``CaseFile``.
        system: Whose machine it is.

    Raises:
        GrosmcError: All numbers that do not fit.
    """
    parts: list[MachinePart] = []
    mistakes = Mistakes()
    for kind, part in MACHINE_PARTS.items():
        for index, table in enumerate(getattr(file, kind)):
            with mistakes.gathered(f"{kind} {index + 1}: "):
                of = in_model(getattr(table, part.owner), part.owner, system)
                numbers = _numbers(kind, of, table, system)
                keywords: dict[str, Any] = {**_written(kind, table), part.owner: of, **numbers}
                parts.append(part(**keywords))
    mistakes.refuse()
    return tuple(parts)


def in_model(name: str, owner: str, system: System) -> str:
    """What the model calls an input of the system; joints and bodies are called the same.

    Args:
        name: In a case file.
        owner: What it is a name of.
        system: Whose.

    Raises:
        ArgumentError: If the system has no such input.
    """
    inputs = [signal.name for signal in system.inputs]
    if owner != "input":
        return name
    require_known("input", name, inputs)
    return system.actuators[inputs.index(name)]


def _numbers(kind: str, of: str, table: Table, system: System) -> dict[str, float]:
    """The numbers that a table gives, in the units of the system."""
    for name in table.assumed:  # pyright: ignore[reportAttributeAccessIssue]
        if name not in table.model_fields_set:
            raise ArgumentError(f"assumed: the table gives no {name}")
    return numbers_of(table, _UNITS[kind], lambda name: unit_of(kind, of, name, system))


def _step(table: Any, system: System) -> float:
    """The resolution of an encoder that a sensor's table gives by its counts in a turn [rad]."""
    if table.resolution is not None:
        raise ArgumentError("counts and resolution are the same number: give one of them")
    if (unit := unit_of("sensor", table.of, "resolution", system)) != "rad":
        raise ArgumentError(f"counts: {table.of} is no angle: give its resolution in {unit}")
    return 2 * math.pi / table.counts


def _written(kind: str, table: Table) -> dict[str, Any]:
    """What else it gives, as it is written."""
    written = table.model_fields_set - _UNITS[kind].keys() - {"assumed", "counts"}
    values = {name: getattr(table, name) for name in written}
    return {key: tuple(v) if isinstance(v, list) else v for key, v in values.items()}
