"""Cases as values, from case files: the chapter's, this project's, the user's."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
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
from grosmc_mj.experiments.file.units import number_in, numbers_of
from grosmc_mj.experiments.file.user_code import is_named, load_named
from grosmc_mj.loop import Loop
from grosmc_mj.machine import MachinePart
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.edits import AddedMass, BodyEdit, InputEdit, JointEdit
from grosmc_mj.plants import System
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Profile, Pulse, SineFrom


@dataclass(frozen=True)
class Case:
    """What an experiment changes against the nominal plant, from where it starts, for how long.

    Attributes:
        system: Name of the system.
        name: ``nominal``, ``case1`` or ``case2``.
        title: For people.
        source: Where the chapter has it, or that this project declares it.
        x0: Start, in the order of the system's states.
        duration: [s]; the chapter prints none.
        edits: Edits of the plant; the controller keeps the nominal numbers.
        disturbances: Wrenches on the plant.
        loop: What lies between laws and plant; None for nothing.
        known_loop: The loop that predicting laws take for theirs; None for the loop itself.
        run: Number of the run: each run of a seed has its own noise, jitter and missed samples.
        design: What its laws are called together; empty for the system's name.
    """

    system: str
    name: str
    title: str
    source: str
    x0: tuple[float, ...]
    duration: float
    edits: tuple[Edit, ...] = ()
    disturbances: tuple[Disturbance, ...] = ()
    loop: Loop | None = None
    known_loop: Loop | None = None
    run: int = 0
    design: str = ""

    @property
    def parts(self) -> tuple[MachinePart, ...]:
        """What of the edits makes a machine as built."""
        return tuple(edit for edit in self.edits if isinstance(edit, MachinePart))

    @property
    def controllers(self) -> str:
        """What its laws are called together."""
        return self.design or self.system

    @property
    def onset(self) -> float:
        """When the first disturbance begins [s]; infinite if there is none."""
        return min((d.window[0] for d in self.disturbances), default=math.inf)


def seed_of(case: Case) -> int | None:
    """The seed of what the loop of a case draws; None without a loop."""
    return None if case.loop is None else case.loop.seed


def case_document(case: Case) -> dict[str, Any]:
    """A case as plain values."""
    return {
        "system": case.system,
        "case": case.name,
        "title": case.title,
        "source": case.source,
        "x0": list(case.x0),
        "duration": case.duration,
        "edits": [asdict(edit) for edit in case.edits],
        "disturbances": [
            {"body": d.body, "wrench": list(d.wrench), "profile": _function(d.profile)}
            for d in case.disturbances
        ],
    }


def _function(profile: Any) -> str:
    """A profile as its numbers, or as the function that it is."""
    if inspect.isfunction(profile):
        return f"{profile.__module__}:{profile.__qualname__}"
    return repr(profile)


def case_of(
    file: CaseFile,
    system: System,
    folder: Path = Path(),
    rest: Sequence[float] | None = None,
) -> Case:
    """The experiment of a case file.

    Args:
        file: The file.
        system: What it is about.
        folder: Where profiles of the user's own are.
        rest: Where it starts but for what the file says; zero by default.

    Raises:
        ArgumentError: If a state is unknown, or a unit or profile does not fit.
    """
    x0, disturbances, mistakes = (), [], Mistakes()
    with mistakes.gathered():
        x0 = state_of(file.run.start, system, "run: start", rest)
    for i, table in enumerate(file.disturbance):
        with mistakes.gathered(f"disturbance {i + 1}: "):
            disturbances.append(_disturbance(table, system, folder))
    loop, known_loop, edits, parts = None, None, (), ()
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
    values: Mapping[str, Any], system: System, where: str, rest: Sequence[float] | None = None
) -> tuple[float, ...]:
    """A state from values by the states' names; the others are those of ``rest``, or zero.

    Raises:
        ArgumentError: If a state is unknown, or a unit does not fit; it begins with ``where``.
    """
    x = [0.0] * len(system.states) if rest is None else [float(number) for number in rest]
    for index, value in states_of(values, system, where).items():
        x[index] = value
    return tuple(x)


def states_of(values: Mapping[str, Any], system: System, where: str) -> dict[int, float]:
    """Values of states, by their indices, from values by their names; raises as ``state_of``."""
    names, by_index, mistakes = [state.name for state in system.states], {}, Mistakes()
    for name, value in values.items():
        with mistakes.gathered(f"{where}: " + (f"{name}: " if name in names else "")):
            require_known("state", name, names)
            by_index[names.index(name)] = number_in(value, system.states[names.index(name)].unit)
    mistakes.refuse()
    return by_index


def edits_of(file: CaseFile, system: System, *, known: bool) -> tuple[Edit, ...]:
    """The edits of the model that a case file makes and its laws know, or those they do not.

    Raises:
        GrosmcError: If a number is none that a model can have, or an input is unknown.
    """
    own = (table for table in file.edit if table.parameter is None)
    return tuple(_edit(table, system) for table in own if table.known is known)


def _edit(table: EditTable, system: System) -> Edit:
    """One edit of the model."""
    if table.joint is not None:
        return JointEdit(table.joint, table.damping, table.friction, table.armature, table.tilt)
    if table.input is not None:
        return InputEdit(in_model(table.input, "input", system), table.gear or 0.0)
    assert table.body is not None
    if table.added_mass is not None:
        return AddedMass(table.body, table.added_mass, (table.at[0], table.at[1], table.at[2]))
    inertia: Any = table.inertia and tuple(table.inertia)
    return BodyEdit(table.body, table.mass_scale, table.length_scale, table.mass, inertia)


# Of each profile: its keys, the one that it needs, and the profile.
_PROFILES: Mapping[str, tuple[tuple[str, ...], str, Callable[..., Profile]]] = {
    "constant": ((), "", Constant),
    "pulse": (("start", "stop"), "stop", Pulse),
    "sine": (("frequency", "onset", "phase"), "frequency", SineFrom),
}


def _disturbance(table: DisturbanceTable, system: System, folder: Path) -> Disturbance:
    """One disturbance, with its course in time."""
    wrench: Any = (*table.force, *table.torque)
    if table.body is None:
        if system.joints:
            raise ArgumentError(f"{system.name} has a model in MuJoCo: name a body")
        kind, signals = ("state", system.states) if table.state else ("input", system.inputs)
        require_known(kind, table.state or table.input, [signal.name for signal in signals])
        units = {"amplitude": system.pushes[table.of]}
        wrench = (*numbers_of(table, units, units.__getitem__).values(), 0.0, 0.0, 0.0, 0.0, 0.0)
    elif not system.bodies:
        raise ArgumentError(f"{system.name} has no bodies: name an input or a state")
    # Zero is a number too: a disturbance without effect still ends the transient.
    if not table.model_fields_set & {"force", "torque", "amplitude"}:
        lacks = "neither force nor torque" if table.body else "no amplitude"
        raise ArgumentError(f"it has {lacks}")
    if is_named(table.profile):
        profile = load_named(table.profile, folder)
    else:
        require_known("profile", table.profile, (*_PROFILES, "module:name"))
        keys, needed, kind = _PROFILES[table.profile]
        timed = {key for others, *_ in _PROFILES.values() for key in others}
        if idle := sorted((timed & table.model_fields_set) - set(keys)):
            raise ArgumentError(f"a {table.profile} has no {', '.join(idle)}")
        if needed and getattr(table, needed) is None:
            raise ArgumentError(f"a {table.profile} needs {needed}")
        profile = kind(*(getattr(table, key) for key in keys))
    return Disturbance(table.of, wrench, profile, table.label)
