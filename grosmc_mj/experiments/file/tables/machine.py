"""What a case file may say of the machine as built: transmissions, frictions, stops, motors, loads.

The numbers of each table are those of the value of the same name, with their units.
"""

from __future__ import annotations

from typing import Annotated, Any, get_args

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import Mistakes
from grosmc_mj.experiments.file.tables.table import Metres, Table, Three, numbers_of
from grosmc_mj.plants import System
from grosmc_mj.simulation.machine import MachinePart


def table_of(part: MachinePart | type[MachinePart]) -> str:
    """What a part's table is called."""
    return part.kind.replace(" ", "_")


# The numbers of each kind of part with their units: {x} is that of the joint's coordinate, {f} of
# its force or torque, {m} of its inertia.
MACHINE_UNITS: dict[str, dict[str, str]] = {
    "transmission": {
        "inertia": "{m}",
        "stiffness": "{f}/{x}",
        "damping": "{f} s/{x}",
        "backlash": "{x}",
        "friction": "{f}",
    },
    "lugre": {
        "coulomb": "{f}",
        "static": "{f}",
        "stiffness": "{f}/{x}",
        "damping": "{f} s/{x}",
        "stribeck": "{x}/s",
    },
    "stop": {"low": "{x}", "high": "{x}", "restitution": "", "duration": "s"},
    "motor": {
        "constant": "N m/A",
        "resistance": "ohm",
        "inductance": "H",
        "ratio": "",
        "efficiency": "",
        "voltage": "V",
        "current": "A",
        "bandwidth": "rad/s",
        "inertia": "kg m^2",
        "cogging": "N m",
        "cogging_periods": "",
        "thermal_resistance": "K/W",
        "heat_capacity": "J/K",
    },
    "swinging_load": {"mass": "kg", "length": "m", "damping": "N m s/rad"},
    "sliding_load": {"mass": "kg", "stiffness": "N/m", "damping": "N s/m"},
    "wall": {"radius": "m", "restitution": "", "duration": "s"},
}
# What is no number with a unit.
_AS_WRITTEN = frozenset({"at", "point", "normal", "added"})
MACHINE_PARTS: dict[str, type[MachinePart]] = {
    table_of(made): made for made in get_args(MachinePart)
}


class TransmissionTable(Table):
    """``[[transmission]]``: see ``Transmission``; without stiffness its teeth do not give way."""

    added: bool = True
    joint: str
    inertia: Any
    stiffness: Any = None
    damping: Any = None
    backlash: Any = None
    friction: Any = None


class LuGreTable(Table):
    """``[[lugre]]``: see ``LuGre``."""

    joint: str
    coulomb: Any
    static: Any = None
    stiffness: Any = None
    damping: Any = None
    stribeck: Any = None


class StopTable(Table):
    """``[[stop]]``: see ``Stop``."""

    joint: str
    low: Any
    high: Any
    restitution: Any = None
    duration: Any = None


class MotorTable(Table):
    """``[[motor]]``: see ``Motor``; without voltage, current or bandwidth these have no end."""

    added: bool = True
    input: str
    constant: Any
    resistance: Any
    inductance: Any = None
    ratio: Any = None
    efficiency: Any = None
    voltage: Any = None
    current: Any = None
    bandwidth: Any = None
    inertia: Any = None
    cogging: Any = None
    cogging_periods: Any = None
    thermal_resistance: Any = None
    heat_capacity: Any = None


class SwingingLoadTable(Table):
    """``[[swinging_load]]``: see ``SwingingLoad``."""

    body: str
    mass: Any
    length: Any
    damping: Any = None
    at: Annotated[list[Metres], Three] = [0.0, 0.0, 0.0]


class SlidingLoadTable(Table):
    """``[[sliding_load]]``: see ``SlidingLoad``."""

    body: str
    mass: Any
    stiffness: Any
    damping: Any = None
    at: Annotated[list[Metres], Three] = [0.0, 0.0, 0.0]


class WallTable(Table):
    """``[[wall]]``: see ``Wall``; ``normal`` is without a unit."""

    body: str
    radius: Any
    at: Annotated[list[Metres], Three] = [0.0, 0.0, 0.0]
    point: Annotated[list[Metres], Three] = [0.0, 0.0, 0.0]
    normal: Annotated[list[float], Three] = [0.0, 0.0, 1.0]
    restitution: Any = None
    duration: Any = None


def machine_unit(kind: str, of: str, quantity: str, system: System) -> str:
    """Unit of a number of a part.

    Args:
        kind: A key of ``MACHINE_UNITS``.
        of: The joint, body or input that it is of.
        quantity: Which number.
        system: Whose.

    Raises:
        ArgumentError: If the system has no such joint.
    """
    unit = MACHINE_UNITS[kind][quantity]
    if "{" not in unit:
        return unit
    require_known("joint", of, system.joints)
    slides = system.states[system.joints.index(of)].unit == "m"
    x, f, m = ("m", "N", "kg") if slides else ("rad", "N m", "kg m^2")
    return unit.format(x=x, f=f, m=m)


def machine_of_file(file: Any, system: System) -> tuple[MachinePart, ...]:
    """The parts of a case file's machine.

    Args:
        file: A ``CaseFile``.
        system: Whose machine it is.

    Raises:
        GrosmcError: All numbers that do not fit.
    """
    found: list[MachinePart] = []
    mistakes = Mistakes()
    for kind, made in MACHINE_PARTS.items():
        for index, table in enumerate(getattr(file, kind)):
            with mistakes.gathered(f"{kind} {index + 1}: "):
                of = in_model(getattr(table, made.owner), made.owner, system)
                given: dict[str, Any] = {**_numbers(kind, of, table, system)}
                for name in _AS_WRITTEN & table.model_fields_set:
                    value = getattr(table, name)
                    given[name] = tuple(value) if isinstance(value, list) else value
                found.append(made(of, **given))
    mistakes.refuse()
    return tuple(found)


def in_model(name: str, owner: str, system: System) -> str:
    """What the model calls an input of the system; joints and bodies are called the same.

    Args:
        name: In a case file.
        owner: What it is a name of.
        system: Whose.

    Raises:
        ArgumentError: If the system has no such input.
    """
    inputs = [each.name for each in system.inputs]
    if owner != "input":
        return name
    require_known("input", name, inputs)
    return system.actuators[inputs.index(name)]


def _numbers(kind: str, of: str, table: Table, system: System) -> dict[str, float]:
    """The numbers that a table gives, in the units of the system."""
    return numbers_of(table, MACHINE_UNITS[kind], lambda name: machine_unit(kind, of, name, system))
