"""Cases as values, from case files of the chapter, of this project and of users."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError, Mistakes
from grosmc_mj.experiments.file.parts import (
    in_model,
    known_loop_of_file,
    loop_of_file,
    machine_of_file,
    run_of_file,
)
from grosmc_mj.experiments.file.schema import CaseFile, DisturbanceTable, EditTable
from grosmc_mj.experiments.file.user_code import is_named, load_named
from grosmc_mj.loop import Loop
from grosmc_mj.machine import MachinePart
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit
from grosmc_mj.plants import System
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
from grosmc_mj.units import number_in, numbers_of, si_number

# Key of a case file for what a disturbance with an amplitude acts on.
_KEYS: Mapping[type[AnyDisturbance], str] = {
    InputDisturbance: "input",
    OutputDisturbance: "measured",
    RateDisturbance: "state",
}


@dataclass(frozen=True)
class Case:
    """Start and duration of an experiment, and its changes of the nominal plant.

    Attributes:
        system: Name of the system.
        name: ``nominal``, ``case1`` or ``case2``.
        title: Title for people.
        source: Place in the chapter, or a note that this project declares it.
        x0: Start, in the order of the system's states.
        duration: Duration [s]; the chapter prints none.
        edits: Edits of the plant; the controller keeps the nominal numbers.
        disturbances: Of bodies, inputs, measured states and rates.
        loop: Sensors, computer and actuators between laws and plant; None without them.
        known_loop: Loop that predicting laws take for theirs; None for the loop itself.
        run: Number of the run: each run of a seed has its own noise, jitter and missed samples.
        design: Name of its laws together; empty for the system's name.
    """

    system: str
    name: str
    title: str
    source: str
    x0: tuple[float, ...]
    duration: float
    edits: tuple[Edit, ...] = ()
    disturbances: tuple[AnyDisturbance, ...] = ()
    loop: Loop | None = None
    known_loop: Loop | None = None
    run: int = 0
    design: str = ""

    @property
    def parts(self) -> tuple[MachinePart, ...]:
        """Edits that are parts of a machine as built."""
        return tuple(edit for edit in self.edits if isinstance(edit, MachinePart))

    @property
    def controllers(self) -> str:
        """Name of its laws together."""
        return self.design or self.system

    @property
    def onset(self) -> float:
        """Onset of the first disturbance [s]; infinite if there is none."""
        onsets = [disturbance.window[0] for disturbance in self.disturbances]
        return min(onsets, default=math.inf)


def seed_of(case: Case) -> int | None:
    """Return the seed of the loop's random numbers; None without a loop."""
    if case.loop is None:
        return None
    return case.loop.seed


def case_document(case: Case) -> dict[str, Any]:
    """Return a case as plain values."""
    disturbances = [_disturbance_document(disturbance) for disturbance in case.disturbances]
    return {
        "system": case.system,
        "case": case.name,
        "title": case.title,
        "source": case.source,
        "x0": list(case.x0),
        "duration": case.duration,
        "edits": [asdict(edit) for edit in case.edits],
        "disturbances": disturbances,
    }


def _disturbance_document(disturbance: AnyDisturbance) -> dict[str, Any]:
    """Return a disturbance as plain values."""
    if isinstance(disturbance, Disturbance):
        document = {"body": disturbance.body, "wrench": list(disturbance.wrench)}
    else:
        key = _KEYS[type(disturbance)]
        document = {key: disturbance.of, "amplitude": disturbance.amplitudes[0]}
    return {**document, "profile": _profile_in_words(disturbance.profile)}


def _profile_in_words(profile: Any) -> str:
    """Return a profile with its numbers, or the name of its function."""
    if inspect.isfunction(profile):
        return f"{profile.__module__}:{profile.__qualname__}"
    return repr(profile)


def case_of(
    file: CaseFile,
    system: System,
    folder: Path = Path(),
    rest: Sequence[float] | None = None,
) -> Case:
    """Return the case of a file.

    Args:
        file: The file.
        system: The system of its plant.
        folder: Folder of a user's own profiles.
        rest: Values of the states that the file does not give; zero by default.

    Raises:
        ArgumentError: If a state is unknown, or a unit or profile does not fit.
    """
    x0 = ()
    disturbances = []
    loop = None
    known_loop = None
    edits = ()
    parts = ()
    mistakes = Mistakes()
    with mistakes.gathered():
        x0 = state_of(file.run.start, system, "run: start", rest)
    for i, table in enumerate(file.disturbance):
        with mistakes.gathered(f"disturbance {i + 1}: "):
            disturbances.append(_disturbance(table, system, folder))
    with mistakes.gathered():
        loop = loop_of_file(file, system)
    with mistakes.gathered("known_loop: "):
        known_loop = known_loop_of_file(file, system)
    with mistakes.gathered():
        edits = edits_of(file, system, known=False)
    with mistakes.gathered():
        parts = machine_of_file(file, system)
    mistakes.refuse()

    return Case(
        system=system.name,
        name=file.name,
        title=file.title or file.name,
        source=file.source,
        x0=x0,
        duration=file.run.duration,
        edits=(*edits, *parts),
        disturbances=tuple(disturbances),
        loop=loop,
        known_loop=known_loop,
        run=run_of_file(file),
        design=file.task.name,
    )


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
        return JointEdit(table.joint, **numbers, tilt=table.tilt)
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
    # A system does not say which joint an input drives: a slide where it has slides alone.
    force = "N m"
    if all(position.unit == "m" for position in system.positions):
        force = "N"
    unit = f"{force}/{input_unit}"
    if input_unit == force:
        unit = "1"
    elif " " in input_unit or "/" in input_unit:
        unit = f"{force}/({input_unit})"
    try:
        return si_number(table.gear, unit)
    except ArgumentError as error:
        raise ArgumentError(f"edit of {name!r}: gear: {error}") from None


# Keys of the shipped profiles.
_PROFILE_KEYS: Mapping[str, tuple[str, ...]] = {
    "constant": (),
    "pulse": ("start", "stop"),
    "sine": ("frequency", "onset", "phase"),
    "table": ("values", "hold", "periodic"),
}


def _disturbance(table: DisturbanceTable, system: System, folder: Path) -> AnyDisturbance:
    """Return one disturbance with its profile."""
    if table.body is not None:
        return _on_body(table, system, folder)

    states = [state.name for state in system.states]
    if table.input is not None:
        inputs = [signal.name for signal in system.inputs]
        require_known("input", table.input, inputs)
        unit = system.inputs[inputs.index(table.input)].unit
        amplitude = _amplitude(table, unit)
        return InputDisturbance(table.input, amplitude, _profile(table, folder), table.label)

    if table.measured is not None:
        require_known("state", table.measured, states)
        unit = system.states[states.index(table.measured)].unit
        amplitude = _amplitude(table, unit)
        return OutputDisturbance(table.measured, amplitude, _profile(table, folder), table.label)

    if system.joints:
        raise ArgumentError(f"{system.name} has a model in MuJoCo: name a body or an input")
    assert table.state is not None
    require_known("state", table.state, states)
    unit = system.states[states.index(table.state)].rate_unit
    amplitude = _amplitude(table, unit)
    return RateDisturbance(table.state, amplitude, _profile(table, folder), table.label)


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


def _amplitude(table: DisturbanceTable, unit: str) -> float:
    """Return the amplitude of a disturbance of a signal in this unit."""
    if table.amplitude is None:
        raise ArgumentError("it has no amplitude")
    return numbers_of(table, ["amplitude"], lambda _name: unit)["amplitude"]


def _profile(table: DisturbanceTable, folder: Path) -> Any:
    """Return the profile of a disturbance over time."""
    if is_named(table.profile):
        return load_named(table.profile, folder)

    require_known("profile", table.profile, (*_PROFILE_KEYS, "module:name"))
    keys_of_others = set[str]().union(*_PROFILE_KEYS.values()) - set(_PROFILE_KEYS[table.profile])
    misplaced = sorted(table.model_fields_set & keys_of_others)
    if misplaced:
        raise ArgumentError(f"a {table.profile} has no {', '.join(misplaced)}")

    if table.profile == "constant":
        return Constant()
    if table.profile == "pulse":
        if table.stop is None:
            raise ArgumentError("a pulse needs stop")
        return Pulse(table.start, table.stop)
    if table.profile == "table":
        if not table.values or table.hold is None:
            raise ArgumentError("a table needs values and hold")
        return Table(tuple(table.values), table.hold, table.periodic)
    if table.frequency is None:
        raise ArgumentError("a sine needs frequency")
    return SineFrom(table.frequency, table.onset, table.phase)
