"""Parts of a case file: those of the loop and of the machine as built, edits, disturbances.

``PART_KINDS`` has all kinds of tables. The keys of a table are the fields of the part's class, with
their units. ``assumed`` lists the numbers that nobody has published: whatever shows results says
so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Annotated, Any

from grosmc_mj.experiments.file.disturbance_tables import COURSES, Wrench
from grosmc_mj.experiments.file.keys import key_name
from grosmc_mj.experiments.file.part_tables import Form, PartKind, PartTable, Values, read
from grosmc_mj.ground.errors import ArgumentError, Mistakes
from grosmc_mj.ground.fields import Flag, Range, checked, range_of
from grosmc_mj.mechanics.machine import PARTS, MachinePart
from grosmc_mj.mechanics.machine.motor import Motor
from grosmc_mj.mechanics.machine.voltage_input import VoltageInput
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import (
    AddedMass,
    BodyEdit,
    InputEdit,
    JointEdit,
    require_owner,
)
from grosmc_mj.simulation.disturbances import (
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    RateDisturbance,
)
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.simulation.loop.loop import LARGEST_SEED
from grosmc_mj.theory.plants import System
from grosmc_mj.theory.plants.parameter_scale import ParameterScale


@checked()
class RandomNumbers:
    """Random numbers of a loop.

    Attributes:
        seed: Seed of noise, jitter and missed samples.
        run: Number of the run: each run of a seed has random numbers of its own.
    """

    seed: Annotated[int, Range(0, LARGEST_SEED, below=True, whole=True)] = 0
    run: Annotated[int, Range(0, LARGEST_SEED, below=True, whole=True)] = 0


@checked()
class Encoder:
    """Encoder of an angle.

    Attributes:
        counts: Steps in a turn, in place of the resolution.
    """

    counts: Annotated[int, Range(1, whole=True)] | None = None


@checked()
class Knowledge:
    """Knowledge of an edit.

    Attributes:
        known: Whether the laws know it: then the nominal plant is edited, too.
    """

    known: Flag = False


def _with_resolution(values: Values, system: System) -> Values:
    """Return the values of a sensor with its resolution, which counts in a turn may give [rad]."""
    if values.get("counts") is None:
        return values
    if "resolution" in values:
        raise ArgumentError("counts and resolution are the same number: give one of them")
    of = values["of"]
    unit = unit_of("sensor", of, "resolution", system)
    if unit != "rad":
        raise ArgumentError(f"counts: {of} is no angle: give its resolution in {unit}")
    return {**values, "resolution": 2 * math.pi / values["counts"]}


def table_of(part: Edit | type[Edit]) -> str:
    """Return the name of a part's table."""
    return part.kind.replace(" ", "_")


_EDITS = (BodyEdit, AddedMass, JointEdit, InputEdit)
_DISTURBANCES = (InputDisturbance, OutputDisturbance, RateDisturbance)
_OF_LOOP = (
    PartKind("computing", (Form(Computing, "", RandomNumbers),), assumes=True),
    PartKind("sensor", (Form(Sensor, "of", Encoder, adapt=_with_resolution),), assumes=True),
    PartKind("estimator", (Form(Estimator, "of"),), assumes=True),
    PartKind("actuator", (Form(Actuator, "of"),), assumes=True),
)
_OF_MACHINE = tuple(
    PartKind(table_of(part), (Form(part, part.owner),), assumes=True) for part in PARTS
)
_OF_PLANT = (
    PartKind(
        "edit",
        (
            *[Form(edit, edit.owner, Knowledge) for edit in _EDITS],
            Form(ParameterScale, "parameter", Knowledge),
        ),
    ),
    PartKind(
        "disturbance",
        (
            Form(Disturbance, "body", choices=(Wrench, *COURSES.values())),
            *[
                Form(kind, key_name(kind, kind.noun), choices=tuple(COURSES.values()))
                for kind in _DISTURBANCES
            ],
        ),
    ),
)
# All kinds of tables with a part, by their names.
PART_KINDS: Mapping[str, PartKind] = {
    kind.name: kind for kind in (*_OF_PLANT, *_OF_LOOP, *_OF_MACHINE)
}
# Classes of the parts of a loop, and of a machine, by the names of their tables.
LOOP_PARTS: Mapping[str, Any] = {kind.name: kind.part for kind in _OF_LOOP}
MACHINE_PARTS: Mapping[str, Any] = {kind.name: kind.part for kind in _OF_MACHINE}


def unit_of(kind: str, of: str, quantity: str, system: System) -> str:
    """Return the unit of a number of a part of the loop or the machine.

    Args:
        kind: Name of the part's table.
        of: State, input, joint or body that the part belongs to.
        quantity: Name of the number.
        system: The system of the file.

    Raises:
        ArgumentError: If the system has no such state, input or joint.
    """
    bounds = range_of(PART_KINDS[kind].part, quantity)
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
        seed = file.computing.further.seed
        with mistakes.gathered("computing: "):
            computer = read(file.computing, system)

    members = [
        tuple(mistakes.each(kind, getattr(file, kind), partial(read, system=system)))
        for kind in ("sensor", "estimator", "actuator")
    ]
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
    return file.computing.further.run


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
        tables = getattr(file, kind)
        parts += mistakes.each(kind, tables, partial(read, system=system), file.base_of(kind))
    mistakes.refuse()
    return tuple(parts)


def voltage_inputs_of_file(file: Any, system: System) -> list[VoltageInput]:
    """Return the inputs of a case file that are voltages of motors, as laws know them.

    Args:
        file: A ``CaseFile``.
        system: The system of its plant.

    Raises:
        GrosmcError: For all numbers that do not fit.
    """
    motors: dict[tuple[str, ...], Motor] = {}
    mistakes = Mistakes()
    for index, table in enumerate(file.motor, start=1):
        if table.values.get("law_input") == "voltage":
            with mistakes.gathered(f"motor {index}: "):
                motors[table.of] = read(table, system)
    mistakes.refuse()

    believed: dict[tuple[str, ...], Motor] = {}
    for table in file.known_motor:
        with mistakes.gathered(f"known_motor of {table.of[0]!r}: "):
            if table.of in believed:
                raise ArgumentError("there are two: give one")
            _refuse_known_motor(table, motors)
            believed[table.of] = replace(read(table, system), added=motors[table.of].added)
    mistakes.refuse()
    return [VoltageInput(believed.get(of, motor)) for of, motor in motors.items()]


def _refuse_known_motor(table: PartTable, motors: Mapping[tuple[str, ...], Motor]) -> None:
    """Refuse a motor that no law knows, and numbers that laws do not know.

    Args:
        table: A table ``[[known_motor]]``.
        motors: Motors whose voltage is the input of the laws, by their inputs.

    Raises:
        ArgumentError: With the reason.
    """
    if table.of not in motors:
        raise ArgumentError(
            "no [[motor]] of that input has law_input = 'voltage', so no law knows its motor"
        )
    unknown = table.values.keys() - {table.form.owner, *VoltageInput.numbers}
    if unknown:
        raise ArgumentError(
            f"laws know no {', '.join(sorted(unknown))}: give "
            f"{', '.join(VoltageInput.numbers)} alone"
        )


def keep_known_motors(content: dict[str, Any]) -> None:
    """Have laws whose input is a voltage know the motor as it is now, whatever numbers it gets.

    Args:
        content: Content of a case file, in which the tables ``[[known_motor]]`` are completed.
    """
    known = content.get("known_motor", [])
    inputs = [motor["input"] for motor in known]
    kept = ("input", *VoltageInput.numbers)
    for motor in content.get("motor", []):
        if motor.get("law_input") == "voltage" and motor["input"] not in inputs:
            known = [*known, {name: motor[name] for name in kept if name in motor}]
    if known:
        content["known_motor"] = known


def edits_of(file: Any, system: System, *, known: bool, model: Any = None) -> tuple[Edit, ...]:
    """Return the edits of the model in a case file.

    Args:
        file: A ``CaseFile``.
        system: The system of its plant.
        known: True for the edits that the laws know, False for the other ones.
        model: The model as an MjSpec, which must have what is edited; unchecked without it.

    Raises:
        GrosmcError: If a model cannot have a number, or an input is unknown.
    """
    edits: list[Edit] = []
    mistakes = Mistakes()
    for index, table in enumerate(file.edit):
        if table.form.part is ParameterScale or table.further.known is not known:
            continue
        with mistakes.gathered(f"edit {index + 1}: "):
            edit = _edit(table, system)
            if model is not None:
                require_owner(model, edit)
            edits.append(edit)
    mistakes.refuse()
    return tuple(edits)


def _edit(table: PartTable, system: System) -> Edit:
    """Return one edit of the model."""
    if table.values.keys() <= {table.form.owner, "known"}:
        raise ArgumentError("the edit changes nothing")
    return read(table, system)


def scales_of(file: Any, system: System) -> tuple[ParameterScale, ...]:
    """Return the factors on parameters of equations in a case file.

    Args:
        file: A ``CaseFile``.
        system: The system of its plant.

    Raises:
        ArgumentError: For all numbers that do not fit.
    """
    scales: list[ParameterScale] = []
    mistakes = Mistakes()
    for index, table in enumerate(file.edit):
        if table.form.part is not ParameterScale:
            continue
        with mistakes.gathered(f"edit {index + 1}: "):
            if table.further.known:
                raise ArgumentError(
                    "known is for a model: give equations of your own the numbers at once"
                )
            scales.append(read(table, system))
    mistakes.refuse()
    return tuple(scales)
